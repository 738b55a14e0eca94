"""Takes a bench through its stages in their order, each one recorded before the next begins."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial

from drivers.errors import DriverError
from experiments.errors import ExperimentError
from experiments.finding import Finding, Severity
from rig.bench.commissioning import (
    NAMES,
    STAGES,
    Missing,
    Stage,
    StageDone,
    keep,
    missing_stages,
    read_record,
)
from rig.bench.identity import Bench
from rig.errors import ConfigurationError, RigError
from rig.program import this_program
from rig.trial.commission.motion import coupled, full_speed, uncoupled
from rig.trial.commission.standing import hand, listen, read
from rig.trial.commission.stops import ACTS, look_afterwards, try_stop
from rig.trial.commission.work import Seen, Work

BEGUN = "begun"
"""The answer that marks a stage from which the program was not to come back."""
_WORK: Mapping[str, Callable[[Work, Seen], None]] = {
    "listen": listen,
    "read": read,
    "hand": hand,
    "uncoupled": uncoupled,
    **{name: partial(try_stop, name) for name in ACTS},
    "coupled": coupled,
    "full-speed": full_speed,
}


def missing_of(bench: Bench, description: str) -> tuple[Missing, ...]:
    """The stages that a bench lacks with this description. Raises `RunFileError`, `ChangedRunError`."""
    return missing_stages(read_record(bench.state), description)


def stages_to_do(missing: Sequence[Missing], asked: Sequence[str]) -> tuple[Stage, ...]:
    """The stages that come next: those that are missing, or those that were asked for.

    Raises `ConfigurationError` for a stage that there is not, and for one before which others are missing.
    """
    by_name = {stage.name: stage for stage in STAGES}
    if not asked:
        return tuple(by_name[one.stage] for one in missing)
    unknown = [name for name in asked if name not in by_name]
    if unknown:
        raise ConfigurationError(
            "no such stage", where="STAGE", value=unknown[0], limit=", ".join(NAMES)
        )
    chosen = sorted(set(asked), key=NAMES.index)
    before = [str(one) for one in missing if NAMES.index(one.stage) < NAMES.index(chosen[0])]
    if before:
        raise ConfigurationError(
            "stages before it are missing",
            where="STAGE",
            value=", ".join(before),
            remedy="Each stage is looked at before the next may begin: leave STAGE away.",
        )
    return tuple(by_name[name] for name in chosen)


def do_stage(stage: Stage, work: Work, description: str) -> Seen:
    """Do one stage and record how it came out, whatever happens. Raises only where it cannot be recorded."""
    record, seen = read_record(work.bench.state), Seen()
    # Who was read is whom the later stages are done with: exchanged, none of them counts.
    known = next((one.devices for one in reversed(record) if one.stage == "read"), {})

    def done(*, begun: bool = False) -> StageDone:
        answers = dict(seen.answers)
        if begun:
            answers[BEGUN] = work.now()
        return StageDone(
            stage=stage.name,
            at=work.now(),
            operator=work.order.operator,
            passed=seen.is_fine and not begun,
            description=description,
            devices=dict(seen.devices or known),
            findings=[finding.as_json() for finding in seen.findings],
            answers=answers,
            runs=dict(seen.runs),
            program=this_program().as_json(),
        )

    work.record = lambda _: keep(work.bench.state, done(begun=True))
    newest = next((one for one in reversed(record) if one.stage == stage.name), None)
    came_back = newest is not None and BEGUN in newest.answers and newest.description == description
    try:
        if came_back:
            look_afterwards(stage.name, work, seen)
        else:
            _WORK[stage.name](work, seen)
    except (DriverError, RigError, ExperimentError) as error:
        seen.add(Finding(stage.name, Severity.BLOCKS, str(error), where="stage"))
    if work.stop.level and stage.name != "stop-key":
        seen.add(Finding(stage.name, Severity.BLOCKS, "stopped by the operator", where="stage"))
    keep(work.bench.state, done())
    return seen
