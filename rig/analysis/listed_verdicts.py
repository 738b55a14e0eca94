"""The verdicts of listed runs: the acceptance file of each gear read once, each run judged by its stored analysis."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from pathlib import Path

from model.errors import WordedError
from rig.analysis.in_force import in_force
from rig.analysis.judging import GearVerdict, judge_listed, not_judged
from rig.gears.acceptance import Acceptance, acceptance_for
from rig.library.index import IndexedRun


def verdicts_of(listed: Sequence[IndexedRun]) -> dict[Path, GearVerdict]:
    """The verdict on what each sealed run measured; what cannot be judged says why, what cannot be read has none."""
    accepted = functools.cache(acceptance_for)
    return {run.path: _verdict_of(run, accepted) for run in listed if run.state == "sealed"}


def _verdict_of(run: IndexedRun, accepted: Callable[[Path, str], Acceptance | None]) -> GearVerdict:
    try:
        acceptance = accepted(run.path.parent, run.gear_serial)
        return judge_listed(
            run.path, run.protocol, run.origin, run.outcome, run.gear_serial, acceptance
        )
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
