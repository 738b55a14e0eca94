"""The torque of the ramps against the inertia that they move: what knows a torque without any torque sensor.

Port and drive of one sensor are wrong together. The inertia on the input shaft is known beside them, by the cards of
motor, gear and load; where a ramp speeds up and the next one slows down through the same speeds, friction is the same
in both and falls out of their difference:

    J = (M_up - M_down)/(alpha_up - alpha_down),   J = J_rotor + J_w + J_o/N^2

An inertia that stands on no card (a coupling, an encoder's disc) makes J larger, never smaller.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from experiments.assumed import ROTOR
from experiments.budget import PAIR, is_one_instrument, torque_scale_uncertainty
from experiments.evidence import BAD_CYCLE
from experiments.evidence.holds import RAMP, Recorded, part_of
from experiments.evidence.outcomes import not_checked, noted, passed, refused
from experiments.evidence.tare import share_subtracted
from experiments.finding import Finding
from experiments.load import load_of
from experiments.recording import Recording, Segment
from model.errors import ParameterError
from model.gear import HarmonicDrive
from model.identify.estimate import NORMAL_COVERAGE_FACTOR
from model.motor import shipped_motor

MOVE = "approach"
"""Label of moves from standstill to standstill: the speed rises in their first half and falls in their second."""
EDGE = 0.2
"""Share at either end of a ramp that is left out: lag of the port, rounding of the corner."""
LEAST_ROWS = 24
"""Rows of a ramp, without its ends, that tell its acceleration."""
LONGEST_PERIOD = 1.5e-3
"""s between rows beyond which it was seen to fail: at 250 Hz ramps of good torques show a quarter too little."""
LEAST_MOVE_ROWS = 100
"""The same of either half of a move: those of a slow one are all stick and slip."""
MOVE_PART = 0.2, 0.8
"""Shares of a move's top speed between which its halves are looked at."""
SPEED_ROWS = 10
"""Rows over which the speed of a move is taken, so that its counts do not show."""
LEAST_PAIRS = 6
SAME_SPEED = 0.1
"""Share by which the mean speeds of two ramps may differ that go through the same speeds."""
METHOD = 0.02
"""What warm magnets, the lag of the port and the ring of the load leave of the ratio (standard, relative)."""
LOAD = 0.03
"""Relative standard uncertainty of a load's inertia whose card states none."""
TOO_SMALL = 2.0
"""U below one beyond which the torque is too small for what it moves. No coupling that was forgotten explains that."""


@dataclass(frozen=True)
class Moved:
    """The inertia that the torque shows over the one of the cards, with its standard uncertainty."""

    ratio: float
    uncertainty: float

    @property
    def is_apart(self) -> bool:
        """Whether the two differ by more than what is known of them explains."""
        return abs(self.ratio - 1.0) > NORMAL_COVERAGE_FACTOR * self.uncertainty

    @property
    def scale(self) -> float:
        """How far the torque may be wrong (standard, relative): anywhere up to the difference and its doubt."""
        return (abs(self.ratio - 1.0) + NORMAL_COVERAGE_FACTOR * self.uncertainty) / math.sqrt(3.0)


def torque_against_inertia(recorded: Recorded) -> Finding:
    """The torque of the ramps against the inertia of the cards."""
    found = _moved(recorded)
    if found is None:
        return not_checked("ramps through the same speeds and an inertia that is stated are needed")
    u = NORMAL_COVERAGE_FACTOR * found.uncertainty
    words = f"{found.ratio:.3g} ± {u:.2g} of the torque that the inertia on the cards takes"
    allowed = f"1 within its U, and not {TOO_SMALL:g} U below"
    if found.ratio + TOO_SMALL * u < 1.0:
        said = "the torque is too small for the inertia that it moves: its scale is wrong"
        return refused(words, allowed, said)
    if found.is_apart:
        said = (
            f"The ramps show {words}: the scale of the torque is widened by the difference. Check it, "
            "and the inertia of rotor, coupling, gear and load on the cards."
        )
        return noted(words, allowed, said)
    return passed(words, allowed)


def widened(recorded: Recorded) -> Recorded:
    """The recording with the scale of its torque known as well as the ramps leave it, where they contradict it."""
    found = _moved(recorded)
    if found is None or not found.is_apart:
        return recorded
    recording = recorded.recording
    # The gain may have changed since the tare: then the whole torque is wrong, and what the tare leaves by more.
    share = share_subtracted(recorded)
    scale = found.scale / (1.0 - share) if 0.0 < share < 1.0 else found.scale
    both = is_one_instrument(recording) and recorded.torque in PAIR
    names = PAIR if both else (recorded.torque,)
    signals = dict(recording.signals)
    for name in names:
        stated = torque_scale_uncertainty(recording, name)[0]
        wider = dataclasses.replace(
            signals[name].calibration, scale_relative_uncertainty=math.hypot(stated, scale)
        )
        signals[name] = dataclasses.replace(signals[name], calibration=wider)
    return dataclasses.replace(recorded, recording=dataclasses.replace(recording, signals=signals))


def _moved(recorded: Recorded) -> Moved | None:
    """None where the recording has too few ramps, or nobody stated what they move."""
    known = _inertia_of_the_cards(recorded)
    if known is None or not recorded.torque:
        return None
    pairs = list(_pairs([r for s in recorded.recording.segments for r in _ramps(recorded, s)]))
    if len(pairs) < LEAST_PAIRS:
        return None
    torque = np.array([up.torque - down.torque for up, down in pairs])
    change = np.array([up.acceleration - down.acceleration for up, down in pairs])
    weight = np.array([min(up.rows, down.rows) for up, down in pairs])
    shown = torque / change
    weight = weight * change**2 / float((weight * change**2).sum())
    mean = float((weight * shown).sum())
    scatter = math.sqrt(float((weight**2 * (shown - mean) ** 2).sum()))
    inertia, u = known
    own = torque_scale_uncertainty(recorded.recording, recorded.torque)[0]
    ratio = mean / inertia
    relative = math.hypot(u / inertia, own, METHOD, scatter / abs(mean))
    return Moved(ratio, abs(ratio) * relative)


def _inertia_of_the_cards(recorded: Recorded) -> tuple[float, float] | None:
    """Inertia on the input shaft with its standard uncertainty [kg m2]; None where a part of it is not stated."""
    recording, gear = recorded.recording, recorded.evidence.gear
    metadata = recording.metadata
    load, inner = load_of(recording, gear), inertia_of_the_input(recording, gear)
    is_known = metadata.gear_mounted and load.is_stated and math.isfinite(metadata.ratio)
    if inner is None or not is_known:
        return None
    output = load.inertia / metadata.ratio**2
    value, u = inner
    return value + output, math.hypot(u, (load.relative_uncertainty or LOAD) * output)


def inertia_of_the_input(recording: Recording, gear: HarmonicDrive) -> tuple[float, float] | None:
    """Inertia of rotor and wave generator with its standard uncertainty [kg m2]; None for a motor without a card."""
    try:
        motor = shipped_motor(str(recording.metadata.process.get("motor", "")).lower())
    except ParameterError:
        return None
    parts = motor.rotor_inertia, gear.inertia.wave_generator
    # Both by data sheets alike, each as far off as rotors are.
    return sum(parts), ROTOR.standard_uncertainty * math.hypot(*parts)


@dataclass(frozen=True)
class _Ramp:
    """Mean speed [rad/s], acceleration [rad/s2] and torque [N m] of the middle of a ramp."""

    speed: float
    acceleration: float
    torque: float
    rows: int

    @property
    def speeds_up(self) -> bool:
        return self.speed * self.acceleration > 0.0


def _ramps(recorded: Recorded, segment: Segment) -> Iterator[_Ramp]:
    """The ramps of speed in a segment: it is one, or it is a move, which has two."""
    if recorded.recording.metadata.time_base == "none":
        return
    whole = part_of(segment, recorded.recording.rows)
    if segment.label == RAMP:
        edge = int(EDGE * (whole.stop - whole.start))
        yield from _ramp(recorded, slice(whole.start + edge, whole.stop - edge), LEAST_ROWS)
    elif segment.label == MOVE:
        for half in _halves(recorded.recording, whole):
            yield from _ramp(recorded, half, LEAST_MOVE_ROWS)


def _halves(recording: Recording, rows: slice) -> Iterator[slice]:
    """The rows of a move in which its speed rises, and those in which it falls, without their ends."""
    blocks = (rows.stop - rows.start - 1) // SPEED_ROWS
    if blocks * SPEED_ROWS < 2 * LEAST_MOVE_ROWS:
        return
    angle = recording.si("input_angle", rows)[: blocks * SPEED_ROWS + 1 : SPEED_ROWS]
    speed = np.abs(np.diff(angle))
    low, high = (share * float(np.percentile(speed, 95.0)) for share in MOVE_PART)
    between = (speed > low) & (speed < high)
    for first, last in ((0, blocks // 2), (blocks // 2, blocks)):
        at = first + np.flatnonzero(between[first:last])
        if len(at):
            ends = int(at[0]) * SPEED_ROWS, (int(at[-1]) + 1) * SPEED_ROWS
            yield slice(rows.start + ends[0], rows.start + ends[1])


def _ramp(recorded: Recorded, rows: slice, least: int) -> Iterator[_Ramp]:
    """The ramp of these rows; none where they are too few, or have a gap."""
    recording = recorded.recording
    if rows.stop - rows.start < least or np.any(recording.flags(rows) & BAD_CYCLE):
        return
    time = recording.time(rows)
    if time[-1] - time[0] > LONGEST_PERIOD * len(time):
        return
    angle = recording.si("input_angle", rows)
    beside = time - time.mean()
    powers = np.column_stack([beside**2, beside, np.ones_like(beside)])
    fitted = np.linalg.lstsq(powers, angle, rcond=None)[0]
    bend, speed = float(fitted[0]), float(fitted[1])
    torque = float(recording.si(recorded.torque, rows).mean())
    yield _Ramp(speed, 2.0 * bend, torque, rows.stop - rows.start)


def _pairs(ramps: list[_Ramp]) -> Iterator[tuple[_Ramp, _Ramp]]:
    """Each ramp that speeds up with the next one, where that slows down through the same speeds."""
    for up, down in itertools.pairwise(ramps):
        is_same = abs(up.speed - down.speed) <= SAME_SPEED * abs(up.speed)
        if is_same and up.speeds_up and not down.speeds_up:
            yield up, down
