"""What only motion can tell: which way the encoders count, whether the ratio is the one that was described, what the
torque port makes of it, whether index marks are seen, and how far apart the two angles are latched.

The input creeps by one degree, turns once, then as often as the output takes to turn once, and at
last some turns at two speeds both ways, which show the skew. It is a protocol like any other:
planned, limited, supervised and made safe by the session that runs them all. Creeping by a degree
moves the output by half a minute of arc, less than two counts of the encoder: its sense is read
from the whole turn of the input.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from drivers.channel import INDEX_SEEN, OUTPUT_INDEX
from experiments.assumed import half_width_of
from experiments.contract import Evidence, Experiment
from experiments.evidence import BAD_CYCLE, usable
from experiments.evidence.motion import LARGEST_SKEW
from experiments.evidence.skew import skew_of_encoders
from experiments.finding import Finding, Severity, passed_if
from experiments.recording import Recording, Segment
from experiments.result import Result
from experiments.steps import vocabulary as s
from model.gear import HarmonicDrive
from model.units import DEGREE, REVOLUTION, RPM
from rig.bench.limits import kinematic_error_margin, torsion_stiffness
from rig.trial.doctor.standing import LARGEST_MISSED, gravity, share_marked

CREEP = DEGREE
_CREEP_SPEED = 1.0 * RPM
_TURN_SPEED = 30.0 * RPM
_RATIO_SPEED = 300.0 * RPM
_SKEW_SPEEDS = (900.0 * RPM, -300.0 * RPM, -900.0 * RPM)
"""Beside +300 r/min of the output's turn: both ways at two speeds, which tells skew from wind-up."""
_SKEW_TURNS = 20.0
ACCELERATION = 50.0
_CREEP_TOLERANCE = 0.25
"""Share by which the creep may differ from a degree: the speed loop rings a little on so short a way."""
LARGEST_DOUBT = 0.05
"""Share of the ratio above which what was measured says nothing about it."""
LEAST_COUNTS = 8.0
"""Counts that the output must have to turn by before its sense is believed; with half of them it moves at all."""
_LEAST_TORQUE = 0.01
"""N m that the motion must cost before the sense of the torque is believed."""
TORQUE_SCALE = 0.2
"""Share by which port and drive may differ in what the motion costs."""
_ANOTHER_SCALE = 2.0
"""Factor, or one over it, from which one of the two is described wrongly."""


@dataclass(frozen=True)
class _DoctorParameters:
    """There is nothing to choose."""


def plan(parameters: _DoctorParameters, gear: HarmonicDrive) -> Iterator[s.Step]:
    """Servo off, a degree, a turn of the input, a turn of the output, some turns at two speeds both ways, servo off."""
    yield s.ServoOff(0.5, s.SegmentLabel("zero-before"))
    yield s.MoveRevolutions(
        CREEP / REVOLUTION, _CREEP_SPEED, ACCELERATION, 5.0, s.SegmentLabel("creep", CREEP, 1)
    )
    yield s.HoldTime(0.2)
    yield s.MoveRevolutions(
        1.0, _TURN_SPEED, ACCELERATION, 15.0, s.SegmentLabel("turn", _TURN_SPEED, 1)
    )
    yield s.Ramp(_RATIO_SPEED, ACCELERATION)
    turns = gear.ratio + 1.0
    longest = 2.0 * turns * REVOLUTION / _RATIO_SPEED
    yield s.HoldRevolutions(turns, longest, s.SegmentLabel("output-turn", _RATIO_SPEED, 1))
    for speed in _SKEW_SPEEDS:
        yield s.Ramp(speed, ACCELERATION)
        seconds = _SKEW_TURNS * REVOLUTION / abs(speed)
        direction = 1 if speed > 0.0 else -1
        yield s.HoldTime(seconds, s.SegmentLabel("skew", speed, direction))
    yield s.Ramp(0.0, ACCELERATION)
    yield s.ServoOff(0.5, s.SegmentLabel("zero-after"))


def analyse(recording: Recording, evidence: Evidence) -> Result:
    """The findings are made by `inspect_motion`; a run of this protocol has no estimates of its own."""
    return Result(
        run=recording.metadata.run_id,
        kind="doctor",
        estimates={},
        metrics={},
        warnings=(),
    )


EXPERIMENT = Experiment(
    name="doctor",
    title="look over the rig",
    summary="direction of both encoders and the ratio",
    parameters=_DoctorParameters,
    plan=plan,
    analyse=analyse,
    needs=("input_angle",),
)


def inspect_motion(recording: Recording, gear: HarmonicDrive) -> Iterable[Finding]:
    """Directions, ratio, torque and index marks out of the recorded motion, also of one that was tripped on the way."""
    creep, turn, whole = (_last(recording, label) for label in ("creep", "turn", "output-turn"))
    outward = _outward(recording)
    yield _creep(recording, creep)
    if recording.has("output_angle"):
        # Of a motion that was tripped on the way, what there is of it.
        yield _output_sense(recording, turn or outward, gear)
        yield _ratio(recording, whole or outward, gear)
        yield _skew(recording, gear)
    else:
        text = "no output encoder: which way the output turns and the ratio cannot be told"
        yield Finding("output direction and ratio", Severity.NOT_LOOKED_AT, text, where="motion")
    yield from torque_findings(recording, turn or outward)
    yield _missed(recording)
    yield _index(recording)


def _last(recording: Recording, label: str) -> Segment | None:
    return next(reversed(recording.labelled(label)), None)


def _outward(recording: Recording) -> Segment:
    """From the start to where the input was farthest."""
    angle = recording.si("input_angle")
    farthest = int(np.argmax(np.abs(angle - angle[0]))) if len(angle) else 0
    return Segment(index=0, label="outward", start=0, stop=farthest + 1)


def _not_reached(name: str) -> Finding:
    return Finding(name, Severity.NOT_LOOKED_AT, "the motion ended before it", where="motion")


def _moved(recording: Recording, segment: Segment, output: bool) -> float:
    """The angle turned over a segment [rad], complete cycles only."""
    good = usable(recording, segment)
    angle = recording.output_angle(segment) if output else recording.si("input_angle", segment)
    angle = angle[good]
    return float(angle[-1] - angle[0]) if len(angle) > 1 else 0.0


def _creep(recording: Recording, segment: Segment | None) -> Finding:
    if segment is None:
        return _not_reached("input direction")
    moved = _moved(recording, segment, output=False)
    text = f"told to creep by +1 deg, moved by {moved / DEGREE:+.3f} deg"
    remedy = "Turn `direction` of the motor encoder, or the drive's own sense, until a positive speed counts up."
    if moved > 0.0 and not abs(moved - CREEP) <= _CREEP_TOLERANCE * CREEP:
        remedy = "Lines and multiplication of the motor encoder do not fit the way it went."
    return passed_if(
        "input direction",
        abs(moved - CREEP) <= _CREEP_TOLERANCE * CREEP,
        text,
        remedy,
        where="motion",
        allowed=f"1 +- {_CREEP_TOLERANCE:g} deg",
        value=moved / DEGREE,
        unit="deg",
    )


def _output_sense(recording: Recording, segment: Segment, gear: HarmonicDrive) -> Finding:
    inner, outer = _moved(recording, segment, output=False), _moved(recording, segment, output=True)
    least = LEAST_COUNTS * recording.signals["output_angle"].quantum
    mounting = recording.metadata.mounting
    text = f"{outer / DEGREE:+.3f} deg at the output for {inner / DEGREE:+.1f} deg at the input, {mounting}"
    if abs(inner) / gear.mounted_ratio(mounting) < least:
        return Finding(
            "output direction",
            Severity.NOT_LOOKED_AT,
            f"the motion was too short to tell it: {text}",
            where="motion",
        )
    if abs(outer) < 0.5 * least:
        remedy = "Is the output encoder coupled, and its signal there?"
        return Finding(
            "output direction",
            Severity.BLOCKS,
            f"{text}: it does not move",
            remedy,
            where="motion",
            value=outer / DEGREE,
            unit="deg",
        )
    return passed_if(
        "output direction",
        outer * inner > 0.0,
        text,
        "Turn `direction` of the output counter; check --mounting: it sets the sense in which the output turns.",
        where="motion",
        value=outer / DEGREE,
        unit="deg",
    )


def _ratio(recording: Recording, segment: Segment, gear: HarmonicDrive) -> Finding:
    expected = gear.mounted_ratio(recording.metadata.mounting)
    inner, outer = _moved(recording, segment, output=False), _moved(recording, segment, output=True)
    least = LEAST_COUNTS * recording.signals["output_angle"].quantum
    if abs(inner) / expected < least:
        return Finding(
            "ratio",
            Severity.NOT_LOOKED_AT,
            f"the motion was too short to tell it: {inner / DEGREE:+.1f} deg",
            where="motion",
        )
    if abs(outer) < 0.5 * least:
        return Finding(
            "ratio",
            Severity.BLOCKS,
            "the output does not move",
            "Is the output encoder coupled?",
            where="motion",
        )
    ratio = abs(inner / outer)
    doubt = ratio * _angle_doubt(recording, gear) / abs(outer)
    turns = abs(outer) / REVOLUTION
    text = f"{ratio:.4f} +- {doubt:.4f} over {turns:.3f} turns of the output, described as {expected:g}"
    if doubt > LARGEST_DOUBT * expected and abs(ratio - expected) <= doubt:
        return Finding(
            "ratio",
            Severity.NOT_LOOKED_AT,
            f"the motion was too short to tell it: {text}",
            where="motion",
        )
    remedy = "Check ratio and mounting, and lines x multiplication of both encoders."
    other = (
        expected + 1.0 if recording.metadata.mounting == "circular-spline-fixed" else expected - 1.0
    )
    if abs(ratio - other) <= doubt:
        remedy = f"{other:g} is the ratio of the other mounting: check --mounting."
    return passed_if(
        "ratio",
        abs(ratio - expected) <= doubt,
        text,
        remedy,
        where="motion",
        allowed=f"{expected:g} +- {doubt:.4f}",
        value=ratio,
        unit="1",
    )


def _angle_doubt(recording: Recording, gear: HarmonicDrive) -> float:
    """What two positions of the output may be wrong by [rad]: a count and the accuracy at each end,
    kinematic error between,
    and the wind-up by a friction that changes."""
    wind_up = gear.ratings.running_torque * gear.ratio / torsion_stiffness(gear)
    accuracy = half_width_of(recording.signals["output_angle"])
    return (
        2.0 * (recording.signals["output_angle"].quantum + accuracy)
        + kinematic_error_margin(gear)
        + wind_up
    )


def _skew(recording: Recording, gear: HarmonicDrive) -> Finding:
    """How much later the output is latched than the input."""
    estimate = skew_of_encoders(recording, gear)
    name, rate = "skew of the encoders", recording.metadata.sample_rate
    if estimate is None or not math.isfinite(estimate.value):
        why = estimate.note if estimate is not None else "there is no stamp of each cycle"
        return Finding(name, Severity.NOT_LOOKED_AT, why, where="motion")
    certain = max(abs(estimate.value) - estimate.expanded_uncertainty, 0.0) * rate
    text = (
        f"{1e6 * estimate.value:+.0f} +- {1e6 * estimate.expanded_uncertainty:.0f} us, "
        f"output after input; a cycle has {1e6 / rate:.0f} us"
    )
    return passed_if(
        name,
        certain <= LARGEST_SKEW,
        text,
        "Both angles must be latched by the same SYNC: look at the transmission types of their PDOs.",
        where="motion",
        allowed=f"{LARGEST_SKEW:g} cycles",
        value=1e6 * estimate.value,
        unit="us",
    )


def torque_findings(recording: Recording, segment: Segment) -> Iterable[Finding]:
    """What the motion costs, by the port and by the drive: the same sense, and about the same number."""
    if not recording.has("torque"):
        text = "there is no torque port"
        yield Finding("torque direction", Severity.NOT_LOOKED_AT, text, where="motion")
        return
    port = _cost(recording, segment, "torque")
    if not recording.has("drive_torque"):
        yield _against_friction(recording, segment, port)
        return
    drive = _cost(recording, segment, "drive_torque")
    text = (
        f"the motion costs {1e3 * port:+.1f} mN m by the port, {1e3 * drive:+.1f} mN m by the drive"
    )
    if abs(drive) < _LEAST_TORQUE:
        yield Finding(
            "torque direction",
            Severity.NOT_LOOKED_AT,
            f"too little to tell it: {text}",
            where="motion",
        )
        return
    scale = port / drive
    severity, remedy = Severity.PASSED, ""
    if scale < 1.0 / _ANOTHER_SCALE:
        severity = Severity.BLOCKS
        remedy = "Turn `direction` of the torque input or of the motor encoder; check that the port is connected."
    yield Finding(
        "torque direction",
        severity,
        text,
        remedy,
        where="motion",
        allowed="the same sense",
        value=scale,
        unit="1",
    )
    if severity is Severity.BLOCKS:
        return
    yield passed_if(
        "torque scale",
        abs(scale - 1.0) <= TORQUE_SCALE,
        f"{scale:.3f} by the port for 1 by the drive",
        "Check volts per rated torque of the port and the rated torque (0x6076).",
        where="motion",
        allowed=f"1 +- {TORQUE_SCALE:g}",
        value=scale,
        unit="1",
        otherwise=gravity(scale <= _ANOTHER_SCALE),
    )


def _cost(recording: Recording, segment: Segment, name: str) -> float:
    """Mean torque of a motion over that at rest before it [N m]."""
    zero, moving = _last(recording, "zero-before"), recording.si(name, segment)
    moving = moving[usable(recording, segment)]
    at_rest = recording.si(name, zero) if zero is not None else moving[:0]
    moved, stood = (float(part.mean()) if len(part) else 0.0 for part in (moving, at_rest))
    return moved - stood


def _against_friction(recording: Recording, segment: Segment, port: float) -> Finding:
    """The port alone: friction costs torque in the sense of the motion. How much it should be nobody says here."""
    moved = _moved(recording, segment, output=False)
    text = f"the motion of {moved / DEGREE:+.0f} deg costs {1e3 * port:+.1f} mN m by the port; the drive tells none"
    if abs(port) < _LEAST_TORQUE:
        text = f"too little to tell it: {text}"
        return Finding("torque direction", Severity.NOT_LOOKED_AT, text, where="motion")
    return passed_if(
        "torque direction",
        port * moved > 0.0,
        text,
        "Turn `direction` of the torque input or of the motor encoder; check that the port is connected.",
        where="motion",
        allowed="the sense of the motion",
        value=port,
        unit="N m",
    )


def _missed(recording: Recording) -> Finding:
    share = share_marked(recording.flags(), BAD_CYCLE)
    text = f"{100.0 * share:.2f} % of {recording.rows} cycles cannot be used"
    return passed_if(
        "cycles",
        share <= LARGEST_MISSED,
        text,
        "Look at the bus load, the cable and the termination, and what disturbs them in motion.",
        where="motion",
        allowed=f"<= {LARGEST_MISSED:g}",
        value=share,
        unit="1",
        otherwise=Severity.WARNS,
    )


def _index(recording: Recording) -> Finding:
    if not recording.has(OUTPUT_INDEX, INDEX_SEEN):
        text = "no latch of index marks: phases are not carried from run to run"
        return Finding(
            "index marks",
            Severity.WARNS,
            text,
            "Map the objects of the latch, where there are any.",
            where="motion",
        )
    seen = int(recording.si(INDEX_SEEN)[-1])
    words = ("not seen", "seen")
    text = f"input {words[seen & 1]}, output {words[seen >> 1 & 1]}"
    return passed_if(
        "index marks",
        seen & 3 == 3,
        text,
        "The output may not have passed its mark: turn it further, or look at the cable.",
        where="motion",
        otherwise=Severity.WARNS,
    )
