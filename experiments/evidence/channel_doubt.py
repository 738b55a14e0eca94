"""What is not known of a channel: scale, zero, curve and delay, each with the line of a budget that says so.

A recording says what its channels show. How far that may be from what was there stands in the calibration of each
channel, and where nobody calibrated it, in what is assumed of its kind. This is the one place that knows which of both.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from experiments.assumed import ENCODERS, THERMOMETER, TORQUE_ZERO, Assumed
from experiments.budget import scale_line
from experiments.evidence.holds import Recorded
from experiments.recording import Recording
from model.channel import Channel
from model.identify.estimate import BudgetLine, Cause

_EFFORT_UNITS = ("N m", "N", "A", "V")
"""Units of channels that are a torque, a force, or what stands for one: they have a gain and a zero."""
_INDEX = "_index"
"""Ending of the names of channels that keep where an index mark was."""
_TEMPERATURE_UNITS = ("°C", "degC", "K")
_ONE_ZERO = 0.003 / math.sqrt(3.0)
"""N m; how far a torque zero may have moved that was read once only."""
FEW = 1000
"""Rows that tell the time from one to the next."""
_ENCODER_CAUSES = {"input_angle": Cause.MOTOR_ENCODER, "output_angle": Cause.OUTPUT_ENCODER}


class Part(StrEnum):
    """In which way a channel may be wrong."""

    SCALE = "scale"
    """All readings by a factor."""
    OFFSET = "offset"
    """All readings by a constant, those of the zero among them."""
    ZERO = "zero"
    """The readings of the run by a constant beside those of its zeros."""
    CURVE = "curve"
    """An angle by a wave per revolution of its encoder."""
    DELAY = "delay"
    """All readings too late."""


@dataclass(frozen=True, kw_only=True)
class Doubt:
    """One way in which a channel may be wrong by one standard uncertainty.

    `size` is relative for a scale, s for a delay, in the channel's unit else. `line` is what stands in a budget, but
    for its size.
    """

    channel: str
    part: Part
    size: float
    line: BudgetLine

    def of(self, change: float) -> BudgetLine:
        """The line of a number that changes by so much."""
        return replace(self.line, standard_uncertainty=abs(change))


def doubts_of(recorded: Recorded, channel: str) -> tuple[Doubt, ...]:
    """All that is not known of a channel of a recording; nothing of one that is no measured quantity."""
    signal = recorded.recording.signals[channel]
    if signal.unit == "rad" and channel in _ENCODER_CAUSES:
        found = _curve(signal)
    elif signal.unit in _EFFORT_UNITS:
        found = (_scale(recorded, signal), *_zero(recorded, signal))
    elif signal.unit in _TEMPERATURE_UNITS:
        found = (_thermometer(signal),)
    elif signal.unit == "1" or channel.endswith(_INDEX):
        return ()
    else:
        found = _stated_doubts(signal)
    return tuple(doubt for doubt in (*found, _delay(recorded, signal)) if doubt.size > 0.0)


def titled(channel: str) -> str:
    """How a budget calls a channel."""
    return channel.replace("_", " ")


def _doubt(
    signal: Channel, part: Part, size: float, note: str, cause: Cause | None = None
) -> Doubt:
    line = BudgetLine(f"{titled(signal.name)} {part}", "B", 0.0, note, cause)
    return Doubt(channel=signal.name, part=part, size=size, line=line)


def _assumed(
    signal: Channel, part: Part, size: float, row: Assumed, cause: Cause | None = None
) -> Doubt:
    """What nobody said of a channel, by the table of what is assumed."""
    doubt = _doubt(signal, part, size, "", cause)
    return replace(doubt, line=row.marked(doubt.line))


def _curve(signal: Channel) -> tuple[Doubt, ...]:
    accuracy, cause = signal.calibration.accuracy, _ENCODER_CAUSES[signal.name]
    if accuracy is None:
        row = ENCODERS[signal.name]
        return (_assumed(signal, Part.CURVE, row.half_width, row, cause),)
    note = "accuracy of the encoder, as one wave per revolution of any phase"
    return (_doubt(signal, Part.CURVE, accuracy, note, cause),)


def _scale(recorded: Recorded, signal: Channel) -> Doubt:
    line = scale_line(recorded.recording, 1.0, signal.name)
    return Doubt(channel=signal.name, part=Part.SCALE, size=line.standard_uncertainty, line=line)


def _zero(recorded: Recorded, signal: Channel) -> tuple[Doubt, ...]:
    """A zero that was read is moved with the run and beside it; one that was not, by what its calibration says."""
    before, after = recorded.zeros if signal.name == recorded.torque else (math.nan, math.nan)
    read = [value for value in (before, after) if math.isfinite(value)]
    if not read:
        size = signal.calibration.offset_uncertainty
        if size is None:
            share = TORQUE_ZERO.standard_uncertainty
            return (_assumed(signal, Part.OFFSET, share * _largest(recorded, signal), TORQUE_ZERO),)
        return (_doubt(signal, Part.OFFSET, size, "calibration of the channel"),)
    moved = abs(after - before) / math.sqrt(12.0) if len(read) == 2 else _ONE_ZERO
    largest = max(abs(value) for value in read)
    return (
        _doubt(signal, Part.OFFSET, largest, "what the port shows with the servo off"),
        _doubt(signal, Part.ZERO, moved, "between the servo-off zeros"),
    )


def _largest(recorded: Recorded, signal: Channel) -> float:
    """The largest reading of a channel, whatever its sign; block by block."""
    recording = recorded.recording
    sizes = (np.abs(recording.si(signal.name, block)).max() for block in recording.blocks())
    return float(max(sizes, default=0.0))


def _thermometer(signal: Channel) -> Doubt:
    stated = signal.calibration.offset_uncertainty
    if stated is None:
        return _assumed(signal, Part.OFFSET, THERMOMETER.standard_uncertainty, THERMOMETER)
    return _doubt(signal, Part.OFFSET, stated, "calibration of the channel")


def _stated_doubts(signal: Channel) -> tuple[Doubt, ...]:
    own, note = signal.calibration, "calibration of the channel"
    return (
        _doubt(signal, Part.SCALE, own.scale_relative_uncertainty or 0.0, note),
        _doubt(signal, Part.OFFSET, own.offset_uncertainty or 0.0, note),
    )


def _delay(recorded: Recorded, signal: Channel) -> Doubt:
    """More than half a cycle would have been seen (the check of the encoders' skew)."""
    period = cycle_of(recorded.recording)
    return _doubt(signal, Part.DELAY, period / math.sqrt(12.0), "within half a cycle")


def cycle_of(recording: Recording) -> float:
    """Time from one row to the next [s]; 0 for rows without time."""
    if recording.metadata.time_base == "none" or recording.rows < 2:
        return 0.0
    return float(np.median(np.diff(recording.time(slice(0, FEW)))))
