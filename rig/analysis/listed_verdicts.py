"""The verdicts of listed runs: the acceptance file of each gear read once, each run judged by its stored analysis."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from model.errors import WordedError
from rig.analysis.in_force import in_force
from rig.analysis.judging import GearVerdict, judge_listed, not_judged
from rig.gears.acceptance import Acceptance, acceptance_for
from rig.library.index import IndexedRun

if TYPE_CHECKING:
    from experiments.recording import RunMetadata


Accepted = Callable[[Path, str], Acceptance | None]
"""What a gear must show, by folder of runs and serial number."""


def verdicts_of(listed: Sequence[IndexedRun]) -> dict[Path, GearVerdict]:
    """The verdict on what each sealed run measured; what cannot be judged says why, what cannot be read has none."""
    accepted = functools.cache(acceptance_for)
    return {run.path: _verdict_of(run, accepted) for run in listed if run.state == "sealed"}


def verdict_of_run(path: Path, metadata: RunMetadata) -> GearVerdict | None:
    """The verdict on what one run measured; None for a file that is not sealed yet."""
    if path.name.endswith(".part"):
        return None
    return _judged(
        path,
        metadata.experiment,
        metadata.origin,
        metadata.outcome,
        metadata.gear_serial,
        acceptance_for,
    )


def told(verdict: GearVerdict | None) -> dict[str, Any]:
    """Verdict, reasons and what is stale of one run of several; null for a file that cannot be read."""
    if verdict is None:
        return {"verdict": None, "because": [], "stale": []}
    return {
        "verdict": verdict.verdict,
        "because": list(verdict.because),
        "stale": list(verdict.stale),
    }


def _verdict_of(run: IndexedRun, accepted: Accepted) -> GearVerdict:
    return _judged(run.path, run.protocol, run.origin, run.outcome, run.gear_serial, accepted)


def _judged(
    path: Path, kind: str, origin: str, outcome: str, serial: str, accepted: Accepted
) -> GearVerdict:
    try:
        acceptance = accepted(path.parent, serial)
        return judge_listed(path, kind, origin, outcome, serial, acceptance)
    except (WordedError, KeyError, TypeError, ValueError) as error:
        return not_judged(f"analysis or acceptance file cannot be read: {error}")


def in_force_of(run: IndexedRun) -> dict[str, object] | None:
    """The analysis of a listed run that everybody reads, as `--json` tells it; None where there is none."""
    if run.state != "sealed":
        return None
    try:
        found = in_force(run.path, run.protocol)
    except WordedError:
        return None
    return found.as_json() if found.analysis is not None else None
