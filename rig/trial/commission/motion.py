"""The stages in which the motor turns and nothing is stopped on purpose: uncoupled, coupled, full speed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

from experiments.contract import Evidence, Experiment
from experiments.evidence import usable
from experiments.finding import Finding, Severity, passed_if
from experiments.recording import Recording, Segment
from experiments.result import Result
from experiments.steps import vocabulary as s
from model.gear import HarmonicDrive
from model.units import REVOLUTION, RPM
from rig.bench import limits as lim
from rig.bench.commissioning import FIRST_SPEED, FIRST_TORQUE
from rig.run.dry_run import PlannedRun
from rig.run.start import plan_order
from rig.trial.commission.work import ROOM, Seen, Work, read_back
from rig.trial.doctor import motion as doctor
from rig.trial.doctor.examine import ending_of, examine_standing

GENTLE = 10.0
"""Acceleration of the first motion [rad/s2]."""
_TURNS = 5.0
"""Turns of the input each way: many enough to be counted by eye."""
_SPEED_TOLERANCE = 0.1
_SHARES = (0.25, 0.5, 1.0)
"""Of the highest speed that the limits allow."""
_HELD = 2.0
"""s for which each of them is held."""
_BELOW_THE_LIMIT = 0.9
"""Share of the speed limit that a set-point goes to: what overshoots it would trip."""


@dataclass(frozen=True)
class FirstTurns:
    """There is nothing to choose."""


def _first_turns(parameters: FirstTurns, gear: HarmonicDrive) -> Iterator[s.Step]:
    """Servo off, 30 r/min one way and the other, servo off."""
    yield s.ServoOff(0.5, s.SegmentLabel("zero-before"))
    for direction in (1, -1):
        speed = direction * FIRST_SPEED
        yield s.Ramp(speed, GENTLE)
        longest = 3.0 * _TURNS * REVOLUTION / FIRST_SPEED
        yield s.HoldRevolutions(_TURNS, longest, s.SegmentLabel("turn", speed, direction))
    yield s.Ramp(0.0, GENTLE)
    yield s.ServoOff(0.5, s.SegmentLabel("zero-after"))


@dataclass(frozen=True)
class _FullSpeed:
    """`fastest` [rad/s]: the highest speed of the stage; `acceleration` [rad/s2] in which it is reached."""

    fastest: float = FIRST_SPEED
    acceleration: float = GENTLE


def _full_speed_steps(parameters: _FullSpeed, gear: HarmonicDrive) -> Iterator[s.Step]:
    """A quarter, a half, the whole; forward, then in reverse."""
    yield s.ServoOff(0.5, s.SegmentLabel("zero-before"))
    for direction in (1, -1):
        for share in _SHARES:
            speed = direction * share * parameters.fastest
            yield s.Ramp(speed, parameters.acceleration)
            yield s.HoldTime(_HELD, s.SegmentLabel("turn", speed, direction))
        yield s.Ramp(0.0, parameters.acceleration)
    yield s.ServoOff(0.5, s.SegmentLabel("zero-after"))


def _nothing(recording: Recording, evidence: Evidence) -> Result:
    """What a stage shows is read by the stage; its run has no estimates of its own."""
    return Result(
        run=recording.metadata.run_id, kind="commissioning", estimates={}, metrics={}, warnings=()
    )


UNCOUPLED = Experiment(
    name="commission-uncoupled",
    title="commissioning: the bare motor at 30 r/min",
    summary="the motor turns as it is told, the output stands",
    parameters=FirstTurns,
    plan=_first_turns,
    analyse=_nothing,
    needs=("input_angle",),
    gear_mounted=False,
)
_FULL_SPEED = Experiment(
    name="commission-full-speed",
    title="commissioning: up to the speed that the limits allow",
    summary="no trip and no limit nearer than planned",
    parameters=_FullSpeed,
    plan=_full_speed_steps,
    analyse=_nothing,
    needs=("input_angle",),
)


def uncoupled(work: Work, seen: Seen) -> None:
    """Look while it stands, then switch on for the first time."""
    rig = work.rig(coupled=False)
    text = (
        "Uncouple the gear from the motor. Release the emergency stop and keep a hand on it, close the guard, "
        "hands away: the motor will turn at 30 r/min, five turns one way and five back."
    )
    work.consents(seen, rig, "uncoupled", text, "the gear is uncoupled and nobody is near")
    if not seen.is_fine:
        return
    planned = gentle(work, UNCOUPLED)
    seen.add(*(f for f in examine_standing(rig, planned, work.order) if _matters(f)))
    if not seen.is_fine:
        return
    report, turned = work.turn(seen, planned)
    seen.add(ending_of(report), *read_back(report, _first_turns_seen))
    if seen.is_fine:
        text = f"Did the shaft turn {_TURNS:g} turns one way and then {_TURNS:g} back, two seconds a turn?"
        work.consents(seen, turned, "turned-as-told", text, "it turned as told")


def gentle(work: Work, experiment: Experiment) -> PlannedRun:
    """A plan at 30 r/min with a tenth of the rated torque; of a drive whose limits are set by hand, with those."""
    if not work.rig(coupled=False).port.abilities.reads_limits_back:
        return plan_order(work.order, experiment)
    torque = FIRST_TORQUE * plan_order(work.order, UNCOUPLED).motor.rated_torque
    return work.plan(experiment, fastest=FIRST_SPEED, torque=torque)


def _matters(finding: Finding) -> bool:
    """Whether a line of the doctor's checklist is one of the commissioning: its warnings and what failed."""
    return finding.severity in (Severity.BLOCKS, Severity.WARNS) and finding.where not in (
        "calibration",
        "bench",
    )


def _first_turns_seen(recording: Recording) -> Iterable[Finding]:
    segments = recording.labelled("turn")
    for segment in segments:
        yield _speed(recording, segment)
    if recording.has("output_angle"):
        yield _output_stands(recording)
    if segments:
        yield from doctor.torque_findings(recording, segments[0])


def _speed(recording: Recording, segment: Segment) -> Finding:
    """The speed that was counted, against the one that was set."""
    good = usable(recording, segment)
    angle, time = recording.si("input_angle", segment)[good], recording.time(segment)[good]
    seconds = float(time[-1] - time[0]) if len(time) > 1 else 0.0
    speed = float(angle[-1] - angle[0]) / seconds if seconds else 0.0
    wanted = segment.setpoint
    return passed_if(
        f"speed {wanted / RPM:+.0f} r/min",
        abs(speed - wanted) <= _SPEED_TOLERANCE * abs(wanted),
        f"{speed / RPM:+.2f} r/min counted",
        "Speed unit of the drive, scale of the reference, lines and direction of the motor encoder.",
        where="motion",
        allowed=f"{wanted / RPM:+.0f} r/min +- {100 * _SPEED_TOLERANCE:g} %",
    )


def _output_stands(recording: Recording) -> Finding:
    """An output that moves is coupled."""
    angle = recording.si("output_angle")
    moved = float(angle.max() - angle.min()) / recording.signals["output_angle"].quantum
    return passed_if(
        "output",
        moved <= 8.0,
        f"moved by {moved:.0f} counts while the input made {2 * _TURNS:g} turns",
        "The gear is coupled, or the output encoder shares a signal with the motor's.",
        where="motion",
    )


def coupled(work: Work, seen: Seen) -> None:
    """What the doctor does in motion."""
    text = "Couple the gear, close the guard, hands away: the output will make a little more than one turn."
    work.consents(seen, work.rig(), "coupled", text, "the gear is coupled and nobody is near")
    if not seen.is_fine:
        return
    planned = plan_order(work.order, doctor.EXPERIMENT)
    report, _ = work.turn(seen, planned)
    seen.add(
        ending_of(report), *read_back(report, lambda one: doctor.inspect_motion(one, planned.gear))
    )


def full_speed(work: Work, seen: Seen) -> None:
    """As fast as the limits allow."""
    bounds = plan_order(work.order, doctor.EXPERIMENT).limits.of_the_rig
    fastest = _BELOW_THE_LIMIT * bounds.value(lim.INPUT_SPEED) / ROOM
    acceleration = min(0.25 * bounds.value(lim.ACCELERATION), 200.0)
    text = f"Close the guard, hands away: up to {fastest / RPM:.0f} r/min, both ways."
    work.consents(seen, work.rig(), "full-speed", text, "nobody is near")
    if not seen.is_fine:
        return
    values = {"fastest": fastest, "acceleration": acceleration}
    planned = plan_order(replace(work.order, values=values), _FULL_SPEED)
    report, rig = work.turn(seen, planned)
    seen.add(ending_of(report), *read_back(report, _speeds))
    if seen.is_fine:
        work.consents(
            seen, rig, "sounds-right", "Did it sound and smell as it should?", "nothing was wrong"
        )


def _speeds(recording: Recording) -> Iterable[Finding]:
    return [_speed(recording, segment) for segment in recording.labelled("turn")]
