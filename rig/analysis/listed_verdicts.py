"""The verdicts of listed runs: the acceptance file of each gear read once, each run judged by its stored analysis."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from model.errors import WordedError
from rig.analysis.in_force import in_force
from rig.analysis.judging import GearVerdict, Look, judge_listed, not_judged
from rig.gears.acceptance import Acceptance, acceptance_for
from rig.library.index import IndexedRun

if TYPE_CHECKING:
    from experiments.recording import RunMetadata


Accepted = Callable[[Path, str], Acceptance | None]
"""What a gear must show, by folder of runs and serial number."""


def verdicts_of(listed: Sequence[IndexedRun]) -> dict[Path, GearVerdict]:
    """The verdict on what each sealed run measured; what cannot be judged says why, what cannot be read has none."""
    accepted = functools.cache(acceptance_for)
    return {
        run.path: _verdict_of(run, accepted, in_force) for run in listed if run.state == "sealed"
    }


def listed_as_json(listed: Sequence[IndexedRun]) -> list[dict[str, Any]]:
    """Listed runs with their verdicts and analyses in force, as `rig runs --json` tells them.

    The analyses of a run, read for its verdict, are at hand for what is told of them.
    """
    accepted, look = functools.cache(acceptance_for), functools.lru_cache(maxsize=1)(in_force)
    return [_as_json(run, accepted, look) for run in listed]


def _as_json(run: IndexedRun, accepted: Accepted, look: Look) -> dict[str, Any]:
    verdict = _verdict_of(run, accepted, look) if run.state == "sealed" else None
    return {**run.as_json(), **told(verdict), "analysis": in_force_of(run, look)}


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
        look=in_force,
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


def _verdict_of(run: IndexedRun, accepted: Accepted, look: Look) -> GearVerdict:
    return _judged(
        run.path, run.protocol, run.origin, run.outcome, run.gear_serial, accepted, look=look
    )


def _judged(
    path: Path,
    kind: str,
    origin: str,
    outcome: str,
    serial: str,
    accepted: Accepted,
    *,
    look: Look,
) -> GearVerdict:
    try:
        acceptance = accepted(path.parent, serial)
        return judge_listed(path, kind, origin, outcome, serial, acceptance, look=look)
    except (WordedError, KeyError, TypeError, ValueError) as error:
        return not_judged(f"analysis or acceptance file cannot be read: {error}")


def in_force_of(run: IndexedRun, look: Look = in_force) -> dict[str, object] | None:
    """The analysis of a listed run that everybody reads, as `--json` tells it; None where there is none."""
    if run.state != "sealed":
        return None
    try:
        found = look(run.path, run.protocol)
    except WordedError:
        return None
    return found.as_json() if found.analysis is not None else None
