"""The newest analysed run of every kind: by these, and by no others, a gear is judged.

Certificate, report of the gear and passport choose here, so that they speak of the same runs.
Nothing is fitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from experiments import catalogue
from rig.analysis.in_force import InForce, in_force
from rig.analysis.judging import GearVerdict, judge, stored_result
from rig.errors import ChangedRunError, RunFileError
from rig.gears.acceptance import Acceptance
from rig.library.listed import COUNTED_OUTCOMES, IndexedRun
from rig.runfile.seal import check_seal


@dataclass(frozen=True)
class Newest:
    """The newest analysed run of every kind, in the order of the catalogue, each with its analysis in force.

    `passed_over` says of which newer runs nothing is told, and why.
    """

    runs: tuple[tuple[IndexedRun, InForce], ...]
    passed_over: tuple[str, ...] = ()

    def judged(self, acceptance: Acceptance | None) -> GearVerdict:
        """The verdict on the gear whose runs these are."""
        found = [
            stored_result(analysis, run.origin, run.outcome, run.gear_serial)
            for run, analysis in self.runs
        ]
        return judge(found, acceptance)


def newest_analysed(runs: Sequence[IndexedRun]) -> Newest:
    """The newest of these runs, which are in order of time, by kind.

    Raises `ChangedRunError` for a run or an analysis that is not as it was sealed.
    """
    passed_over: list[str] = []
    chosen = [_newest(kind, runs, passed_over) for kind in catalogue.names()]
    return Newest(tuple(one for one in chosen if one is not None), tuple(passed_over))


def _newest(
    kind: str, runs: Sequence[IndexedRun], passed_over: list[str]
) -> tuple[IndexedRun, InForce] | None:
    """The newest run of a kind that was brought to its end and has an analysis; newer ones are noted."""
    for run in reversed([run for run in runs if run.protocol in (kind, "")]):
        try:
            found = in_force(run.path, kind)
        except ChangedRunError:
            # Nobody may go on without it: what was changed would make room for an older run.
            raise
        except RunFileError as error:
            passed_over.append(f"Run {run.run_id} ({kind}) cannot be read: {error}")
            continue
        if found.analysis is not None and not found.of_this_run:
            # A run that was changed since it was sealed is refused by name, for the same reason.
            check_seal(run.path)
        is_analysed = found.analysis is not None and found.of_this_run
        if is_analysed and run.outcome in COUNTED_OUTCOMES:
            return run, found
        if run.protocol != kind:
            continue
        passed_over.append(
            f"Run {run.run_id} ({kind}) is not analysed: rig fit {run.path}"
            if run.outcome in COUNTED_OUTCOMES
            else f"Run {run.run_id} ({kind}) ended {run.outcome} and does not stand here."
        )
    return None
