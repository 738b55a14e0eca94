"""A channel of a recording over one of its angles, stretch by stretch, read as it is needed."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import scipy  # pyright: ignore[reportMissingTypeStubs]

from experiments.angle.phase_reference import phase_reference
from experiments.errors import AnalysisError
from experiments.evidence import rotary_ratio, usable
from experiments.planning.parts import ZERO_AFTER, ZERO_BEFORE
from experiments.recording import Recording
from experiments.torque.zero import torque_zero
from model.arrays import BoolArray, FloatArray
from model.identify.orders.by_speed import ChangingOrder, Moved, SpeedTrend
from model.identify.orders.samples import CHUNK, Piece
from model.identify.orders.turning import DeadZone, runs_of

LABELS = ("traverse", "hold")
"""Segments of a run that turn at a constant speed."""
KINEMATIC_ERROR = "kinematic_error"
"""The name of a channel that is made here: theta_o - theta_i/N."""
LOOKED_AT, LOOKS = 20_000, 8
"""Rows of each of the parts that tell the noise of an angle, and how many these are."""
STILL = 0.1
"""rad within which a segment has not turned."""


SMOOTHED_S = 0.05
"""Seconds over which the speed of an angle is the mean."""


@dataclass(frozen=True)
class SourcePart:
    """Rows of one stretch: its number and direction, angle [rad] and value (n,), and what gives the speed (n,)."""

    number: int
    direction: int
    angle: FloatArray
    value: FloatArray
    speed: Callable[[], FloatArray]


@dataclass(frozen=True, kw_only=True)
class OrderSource:
    """The pieces of a channel over an angle, and what has to be said of them.

    reference: from where phases count; left_out: share of the rows of a run without segments that are in no stretch.
    has_line: whether its trend may have a slope. Teeth make a ratio: where it is stated the error of an angle has none,
    and a slope beside its orders would take from the slow ones. Where it is not stated the slope is the ratio's, fitted
    with the orders, so that its doubt is in each of theirs.
    """

    parts: Callable[[], Iterator[SourcePart]]
    quantum: float
    reference: str
    left_out: float
    warnings: tuple[str, ...]
    has_line: bool = True

    def pieces(self) -> Iterator[Piece]:
        """The samples, in the order they were recorded."""
        return self.without({}, {})

    def moved(self, direction: int) -> Iterator[Moved]:
        """The samples of one direction with the speed of the angle."""
        for part in self.parts():
            if part.direction == direction:
                yield Moved(part.angle, part.value, part.speed())

    def without(
        self,
        trends: Mapping[int, SpeedTrend],
        changing: Mapping[int, tuple[ChangingOrder, ...]],
    ) -> Iterator[Piece]:
        """The samples without the trend over the speed, and without what orders have beyond their amplitude at the
        middle speed, by direction.
        """
        for part in self.parts():
            value, trend = part.value, trends.get(part.direction)
            orders = changing.get(part.direction, ())
            if trend is not None or orders:
                speed = part.speed()
                if trend is not None:
                    value = value - trend.value(speed)
                for one in orders:
                    value = value - one.beyond(part.angle, speed)
            yield Piece.of(part.number, part.direction, part.angle, value, self.quantum)


def order_source(recording: Recording, angle_name: str, channel: str, ratio: float) -> OrderSource:
    """The channel over the angle: of the run's segments at constant speed, else of all that turns one way."""
    if recording.signals[angle_name].unit != "rad":
        raise AnalysisError(
            "a revolution needs an angle",
            where=recording.metadata.run_id,
            value=f"{angle_name} in {recording.signals[angle_name].unit}",
            limit="rad",
            remedy="Import the channel as an angle, or choose another one with the setting angle=NAME.",
        )
    reference, what = 0.0, "the recorded angle"
    if angle_name == "input_angle":
        phase = phase_reference(recording)
        reference, what = phase.input_angle, phase.what
    stated = rotary_ratio(recording, math.nan)
    is_exact = channel == KINEMATIC_ERROR and math.isfinite(stated)
    if (channel, angle_name) == ("output_angle", "input_angle") and math.isfinite(stated):
        # What the output is beside its share of the input is an error of the same kind.
        channel, ratio, is_exact = KINEMATIC_ERROR, stated, True
    angle = angle_of(recording, angle_name)
    value, warnings = _value(recording, channel, ratio)
    stretches, rounding, left_out = _segments(recording, angle), 0.0, 0.0
    if not stretches:
        zone = _dead_zone(recording, angle)
        stretches, rounding = _turning_rows(recording, angle, zone), zone.rounding
        kept = sum(stop - start for start, stop, _ in stretches)
        left_out = 1.0 - kept / max(recording.rows, 1)

    def parts() -> Iterator[SourcePart]:
        for number, (start, stop, direction) in enumerate(stretches):
            for rows in recording.blocks(slice(start, stop), size=CHUNK):
                good = usable(recording, rows)
                if good.any():
                    turned = angle(rows)[good] - reference

                    def speed(rows: slice = rows, good: BoolArray = good) -> FloatArray:
                        return _speed(recording, angle, rows)[good]

                    yield SourcePart(number, direction, turned, value(rows)[good], speed)

    return OrderSource(
        parts=parts,
        quantum=recording.signals[angle_name].quantum or rounding,
        reference=what,
        left_out=left_out,
        warnings=tuple(warnings),
        has_line=not is_exact,
    )


def _speed(recording: Recording, angle: Callable[[slice], FloatArray], rows: slice) -> FloatArray:
    """Speed of the angle [rad/s], its mean over some samples: of encoders that count each step would be one."""
    time, turned = recording.time(rows), angle(rows)
    if len(time) < 3:
        return np.zeros(len(time))
    width = max(5, round(SMOOTHED_S / max(float(np.median(np.diff(time))), 1e-9)))
    single: FloatArray = np.asarray(np.gradient(turned, time), dtype=np.float64)
    return np.asarray(scipy.ndimage.uniform_filter1d(single, width, mode="nearest"))


def angle_of(recording: Recording, name: str) -> Callable[[slice], FloatArray]:
    """An angle by rows; that of the output in the sense of the input."""
    if name == "output_angle":
        return recording.output_angle
    return lambda rows: recording.si(name, rows)


def _value(
    recording: Recording, channel: str, ratio: float
) -> tuple[Callable[[slice], FloatArray], list[str]]:
    """The channel by rows, its zero taken off, and what has to be said of that."""
    if channel == KINEMATIC_ERROR:
        return (
            lambda rows: recording.output_angle(rows) - recording.si("input_angle", rows) / ratio,
            [],
        )
    zeroed = channel in ("torque", "drive_torque") and recording.labelled(ZERO_BEFORE, ZERO_AFTER)
    if not zeroed:
        return lambda rows: recording.si(channel, rows), []
    zero = torque_zero(recording, channel)

    def value(rows: slice) -> FloatArray:
        return recording.si(channel, rows) - zero.at(recording.time(rows))

    return value, list(zero.warnings)


def _segments(
    recording: Recording, angle: Callable[[slice], FloatArray]
) -> list[tuple[int, int, int]]:
    """First row, end and direction of each segment that turns."""
    found: list[tuple[int, int, int]] = []
    for segment in recording.labelled(*LABELS):
        start, stop = segment.start, min(segment.stop, recording.rows)
        if stop - start < 2:
            continue
        travel = float(angle(slice(stop - 1, stop))[0] - angle(slice(start, start + 1))[0])
        if abs(travel) > STILL:
            found.append((start, stop, int(math.copysign(1.0, travel))))
    return found


def _dead_zone(recording: Recording, angle: Callable[[slice], FloatArray]) -> DeadZone:
    """The dead zone of an angle from some of its rows."""
    starts = np.linspace(0, max(recording.rows - LOOKED_AT, 0), LOOKS).astype(int)
    looks = [slice(int(s), min(int(s) + LOOKED_AT, recording.rows)) for s in np.unique(starts)]
    return DeadZone.of([angle(rows) for rows in looks])


def _turning_rows(
    recording: Recording, angle: Callable[[slice], FloatArray], zone: DeadZone
) -> list[tuple[int, int, int]]:
    """First row, end and direction of all that turns one way beyond the dead zone of the angle."""

    def ways() -> Iterator[np.ndarray]:
        for rows in recording.blocks(size=CHUNK):
            # A halo of the half width, so that blocks join without a seam.
            before = min(zone.half_width, rows.start)
            after = min(rows.stop + zone.half_width, recording.rows)
            whole = zone.ways(angle(slice(rows.start - before, after)))
            yield whole[before : before + rows.stop - rows.start]

    return runs_of(ways(), zone.blink)
