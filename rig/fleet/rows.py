"""The rows of one run: what its fit found, what was judged of it, and where all of it comes from."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments import catalogue
from experiments.result import WORST_FIRST
from model.errors import without_traceback
from rig.analysis.causes import which_mounting
from rig.analysis.judging import GearVerdict, Side, side_of, whose_limit
from rig.analysis.number_or_none import known
from rig.analysis.store import json_ready
from rig.fleet.results import NAMES, Row
from rig.program import version as program_version
from rig.runfile.header import gear_name

if TYPE_CHECKING:
    from experiments.recording import Recording
    from experiments.result import Verdict
    from model.identify.estimate import Estimate
    from rig.analysis.fit.recorded import Fit

EMPTY: Row = dict.fromkeys(NAMES)
_TIGHTEST: Mapping[Side, Callable[[Iterable[float]], float]] = {"upper": min, "lower": max}
"""Which of several limits on one side of a quantity counts."""


def _compact_json(content: Any) -> str:
    """One line of JSON, its keys in order."""
    import json

    return json.dumps(json_ready(content), sort_keys=True, ensure_ascii=False, allow_nan=False)


def _run_part(recording: Recording) -> Row:
    """The columns that tell of the run itself."""
    metadata = recording.metadata
    started, day = _moments(metadata.start_time)
    return {
        "run": metadata.run_id,
        "gear": metadata.gear_serial,
        "part": gear_name(metadata),
        "bench": str(metadata.process.get("bench", "")),
        "mounting": metadata.mounting,
        "mounted": which_mounting(metadata),
        "started": started,
        "day": day,
        "operator": metadata.operator,
        "origin": metadata.origin,
        "outcome": metadata.outcome,
        "protocol": metadata.experiment,
        "temperature": _mean(recording, "housing_temperature"),
        "ambient_temperature": _mean(recording, "ambient_temperature"),
        "conditions": _compact_json(metadata.conditions),
        "run_sha256": metadata.sha256,
        "program_version": program_version(),
    }


def rows_of_fit(fit: Fit, verdict: GearVerdict, shared: Row) -> list[Row]:
    """A row per estimate and per metric, and one per limit on what the run did not find.

    `shared` are the columns that are the same for all of them and that the fit does not know itself.
    """
    result, tare = fit.result, fit.tare_as_json()
    common = EMPTY | _run_part(fit.recording) | shared
    common |= {
        "kind": result.kind,
        "warnings": len(result.warnings),
        "tare": str(tare.get("run", "")),
        "tare_sha256": str(tare.get("sha256", "")),
        "tare_because": "; ".join(fit.found_tare.because),
        "settings": _compact_json(fit.settings),
        "gear_set_sha256": fit.gear_source.sha256,
        "gear_set_source": fit.gear_source.source,
        "analysis_version": catalogue.load(result.kind).version,
        "run_verdict": verdict.verdict,
        "run_reason": "; ".join(verdict.because),
        "acceptance": verdict.source,
        "failure": "",
        "failure_kind": "",
    }
    deciding, sides = _deciding(verdict), _sides(verdict)
    rows = []
    for name, estimate in result.estimates.items():
        quantity = result.quantity(name)
        named = {"quantity": name, "family": quantity.name, "title": quantity.titled(name)}
        judged = _judged(deciding.pop(name, None)) | sides.get(name, {})
        rows.append(common | named | _numbers(estimate) | judged)
    for name, value in result.metrics.items():
        quantity = result.quantity(name)
        named = {"quantity": name, "family": quantity.name, "title": quantity.titled(name)}
        number = {"is_metric": True, "value": known(value), "unit": quantity.unit}
        rows.append(common | named | number | _judged(None))
    for name, line in deciding.items():
        named = {"quantity": name, "family": line.quantity.name, "title": line.name}
        rows.append(common | named | _numbers(line.estimate) | _judged(line) | sides[name])
    return rows


def row_of_failure(shared: Row, error: BaseException, recording: Recording | None) -> Row:
    """The one row of a run that could not be read or analysed."""
    told = _run_part(recording) if recording is not None else {}
    failed = {"quantity": "", "failure": failure_of(error), "failure_kind": type(error).__name__}
    judged = {"run_verdict": "NOT JUDGED", "run_reason": "the run is not analysed"}
    return EMPTY | {"program_version": program_version()} | told | shared | failed | judged


def failure_of(error: BaseException) -> str:
    """Why a run has no result; never empty."""
    return without_traceback(str(error)).strip() or type(error).__name__


def _deciding(verdict: GearVerdict) -> dict[str, Verdict]:
    """Of the limits on one quantity the one that decides: the worst."""
    lines: dict[str, Verdict] = {}
    for line in sorted(verdict.lines, key=lambda one: WORST_FIRST.index(one.outcome)):
        lines.setdefault(line.estimate.name, line)
    return lines


def _sides(verdict: GearVerdict) -> dict[str, Row]:
    """Both sides of the limits on each quantity; of several on one side the tightest."""
    sides: dict[str, Row] = {}
    for line in verdict.lines:
        here = sides.setdefault(line.estimate.name, {"lower_limit": None, "upper_limit": None})
        side = side_of(line)
        limits = (here[f"{side}_limit"], line.limit)
        here[f"{side}_limit"] = _TIGHTEST[side](one for one in limits if one is not None)
    return sides


def _numbers(estimate: Estimate) -> Row:
    return {
        "is_metric": False,
        "value": known(estimate.value),
        "unit": estimate.unit,
        "standard_uncertainty": known(estimate.standard_uncertainty),
        "expanded_uncertainty": known(estimate.expanded_uncertainty),
        "coverage_factor": known(estimate.coverage_factor),
        "degrees_of_freedom": known(estimate.degrees_of_freedom),
        "low": known(estimate.low),
        "high": known(estimate.high),
        "identifiable": estimate.identifiable,
        "note": estimate.note,
    }


def _judged(line: Verdict | None) -> Row:
    if line is None:
        return {"verdict": "", "reason": ""}
    return {
        "limit_value": line.limit,
        "limit_is": side_of(line),
        "limit_source": whose_limit(line),
        "verdict": line.outcome,
        "reason": line.because,
    }


def _mean(recording: Recording, channel: str) -> float | None:
    if not recording.has(channel) or recording.rows == 0:
        return None
    return known(float(np.mean(recording.si(channel))))


def _moments(text: str) -> tuple[datetime | None, Any]:
    """When a run started in UTC, and the date that the clock of its bench showed; None where it does not say it."""
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        return None, None
    utc = moment.replace(tzinfo=UTC) if moment.tzinfo is None else moment.astimezone(UTC)
    return utc, moment.date()


def settings_part(settings: Mapping[str, Any]) -> str:
    """The settings of a job as the rows keep them."""
    return _compact_json(settings)
