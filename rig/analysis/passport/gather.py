"""From the runs of a gear to what was found of each: which runs count, their newest analyses, and
the facts to compare by.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from drivers.channel import HOUSING_TEMPERATURE
from experiments.recording import Origin, Recording, mapping_of
from model.identify.estimate import Estimate, Ground
from rig.analysis.alarm.noted import NotedRun
from rig.analysis.causes import Grounds, grounds_of, simulated_bench, which_mounting
from rig.analysis.fit.recorded import NOT_SEALED
from rig.analysis.in_force import in_force_by_kind
from rig.analysis.number_or_none import known
from rig.analysis.passport.content import Missing
from rig.analysis.passport.followed import FACTS, facts_of, watched, watched_kinds
from rig.analysis.store import Analysis, unsealed_words
from rig.content.phrase import quoted
from rig.errors import ChangedRunError, RigError, RunFileError
from rig.gears.card_places import places
from rig.library.index import IndexedRun, LibraryIndex
from rig.library.listed import COUNTED_OUTCOMES
from rig.runfile.header import gear_name
from rig.runfile.read import close_recording, open_run
from rig.runfile.seal import check_seal

LUBRICANT, MOUNTED, BENCH = "lubricant", "mounted on", "bench"
"""What may change from run to run, and is noted."""
_ROWS = 500


@dataclass(frozen=True, kw_only=True)
class AnalysedRun:
    """One run with one analysis: the facts that make runs comparable, what may change from run to
    run, the estimates. `hours` that the gear had run, NaN where nobody noted them.
    """

    run: IndexedRun
    analysis: Analysis
    origin: Origin
    facts: Mapping[str, str]
    changing: Mapping[str, str]
    grounds: Grounds
    estimates: Mapping[str, Estimate]
    housing_temperature: float | None
    hours: float = math.nan

    @property
    def noted(self) -> NotedRun:
        """What was noted of it and may move a quantity without the gear having changed."""
        return NotedRun(
            temperature=self.housing_temperature,
            bench=self.changing[BENCH],
            lubricant=self.changing[LUBRICANT],
            mounting=self.changing[MOUNTED],
        )


@dataclass(frozen=True)
class Gathered:
    """Everything of one gear: runs that count in order of time, their analyses, what is missing,
    what does not count.
    """

    runs: tuple[IndexedRun, ...]
    analysed: tuple[AnalysedRun, ...]
    missing: tuple[Missing, ...]
    left_out: tuple[Missing, ...]


def runs_of(where: str | Path | Iterable[str | Path], serial: str) -> tuple[IndexedRun, ...]:
    """The runs of a gear in a folder, in several, or among run files, in order of time; each file once.

    Raises `RunFileError` for what is neither.
    """
    runs_by_file: dict[Path, IndexedRun] = {}
    names_by_folder: dict[Path, set[str]] = {}
    for place in map(Path, places(where)):
        if place.is_dir():
            names_by_folder.setdefault(place, set()).add("")
        else:
            names_by_folder.setdefault(place.parent, set()).add(place.name)
    for folder, names in names_by_folder.items():
        for run in LibraryIndex(folder, nested="" in names).search():
            if run.gear_serial == serial and ("" in names or run.path.name in names):
                runs_by_file.setdefault(run.path.resolve(), run)
    return tuple(
        sorted(
            runs_by_file.values(), key=lambda run: (moment(run.start), run.number, run.path.name)
        )
    )


def moment(text: str) -> datetime:
    """The time of an ISO 8601 text; one without a zone counts as UTC, one that is none as the beginning of time."""
    try:
        time = datetime.fromisoformat(text)
    except ValueError:
        return datetime.min.replace(tzinfo=UTC)
    return time if time.tzinfo else time.replace(tzinfo=UTC)


def gather(runs: Sequence[IndexedRun], origin: str = "") -> Gathered:
    """Read what was found of each run. Without `origin`: hardware alone where there is any, else
    every origin for itself. Raises `ChangedRunError` for a run or an analysis that is not as it was sealed.
    """
    only = counted_origin(runs, origin)
    counted: list[IndexedRun] = []
    left_out: list[Missing] = []
    missing: list[Missing] = []
    runs_by_hash: dict[str, IndexedRun] = {}
    for run in runs:
        reason = _does_not_count(run, only)
        if not reason:
            seal = check_seal(run.path)
            if not seal.is_whole:
                missing.append(Missing(NOT_SEALED, run.run_id))
            first = runs_by_hash.setdefault(seal.sha256, run)
            reason = "" if first is run else f"is a copy of {first.path}"
        if reason:
            left_out.append(Missing(reason, run.run_id))
        else:
            counted.append(run)
    analysed: list[AnalysedRun] = []
    for run in counted:
        of_run, lacks = _read(run)
        analysed += of_run
        missing += lacks
    return Gathered(tuple(counted), tuple(analysed), tuple(missing), tuple(left_out))


def counted_origin(runs: Sequence[IndexedRun], origin: str = "") -> str:
    """The origin that alone counts: the one asked for, hardware where there is any; "" where every
    one counts for itself.
    """
    return origin or ("hardware" if any(run.origin == "hardware" for run in runs) else "")


def _does_not_count(run: IndexedRun, origin: str) -> str:
    if run.state != "sealed":
        return run.problem if run.state == "unreadable" else run.state
    if origin and run.origin != origin:
        return f"is {run.origin}: runs of several origins never stand in one passport"
    if run.outcome not in COUNTED_OUTCOMES:
        return f"ended {run.outcome}: it was not brought to its end"
    return ""


def _read(run: IndexedRun) -> tuple[list[AnalysedRun], list[Missing]]:
    """The analyses in force of a run of the kinds that are followed, and what it lacks."""
    command, kinds = f"rig fit {quoted(run.path)}", watched_kinds()
    try:
        stored = {
            kind: found for kind, found in in_force_by_kind(run.path).items() if kind in kinds
        }
    except ChangedRunError:
        raise
    except RunFileError as error:
        return [], [
            Missing(str(error), run.run_id, "Move the damaged file away and fit the run again.")
        ]
    missing = []
    if run.protocol in kinds and run.protocol not in stored:
        missing.append(Missing(f"its {run.protocol} is not analysed", run.run_id, command))
    if not stored:
        return [], missing
    try:
        recording = open_run(run.path)
    except RigError as error:
        return [], [*missing, Missing(str(error), run.run_id)]
    try:
        analysed = []
        for found in stored.values():
            analysis = found.analysis
            assert analysis is not None
            if str(analysis.content.get("run_sha256", "")) != recording.metadata.sha256:
                missing.append(
                    Missing(
                        f"analysis {analysis.number} is of another file of this name",
                        run.run_id,
                        command,
                    )
                )
                continue
            missing += [
                Missing(
                    f"its {found.kind} analysis {found.number} is stale: {reason}",
                    run.run_id,
                    found.renewed_by,
                )
                for reason in found.stale
            ]
            if not analysis.seal.is_whole:
                missing.append(Missing(unsealed_words(analysis), run.run_id))
            analysed.append(_analysed(run, recording, analysis))
        return analysed, missing
    finally:
        close_recording(recording)


def _analysed(run: IndexedRun, recording: Recording, analysis: Analysis) -> AnalysedRun:
    m = recording.metadata
    result = analysis.result
    options, settings = result.options, analysis.content.get("settings", {})
    facts = {"part": gear_name(m), "mounting": m.mounting}
    names = [name for _, quantity in watched() for name in quantity.conditions if name not in facts]
    facts |= facts_of(dict.fromkeys((*FACTS, *names)), m.parameters, options, settings)
    grounds = grounds_of(recording, analysis)
    changing = {
        LUBRICANT: str(m.conditions.get("lubricant", "")),
        MOUNTED: which_mounting(m),
        "torque calibration": grounds[Ground.TORQUE_CHANNEL],
        BENCH: simulated_bench(m) or run.bench,
        "program version of the analysis": str(analysis.content.get("program_version", "")),
        "settings of the analysis": ", ".join(
            f"{name} = {value}" for name, value in settings.items()
        ),
    }
    return AnalysedRun(
        run=run,
        analysis=analysis,
        origin=m.origin,
        facts=facts,
        changing=changing,
        grounds=grounds,
        estimates=result.estimates,
        housing_temperature=_housing_temperature(recording, result.metrics),
        hours=float(
            m.conditions.get("hours", mapping_of(m.process.get("world")).get("hours", math.nan))
        ),
    )


def _housing_temperature(recording: Recording, metrics: Mapping[str, float]) -> float | None:
    """Of the gear's housing [degC]: as the analysis took it, else the mean at beginning, middle and end of the run."""
    found = metrics.get("housing_temperature", math.nan)
    if math.isnan(found) and recording.has(HOUSING_TEMPERATURE):
        rows = recording.rows
        places = (slice(at, at + _ROWS) for at in (0, rows // 2, max(rows - _ROWS, 0)))
        values = np.concatenate([recording.si(HOUSING_TEMPERATURE, place) for place in places])
        values = values[np.isfinite(values)]
        found = float(values.mean()) if len(values) else math.nan
    return known(found)
