"""The zero of the torque port: mean over servo-off segments before and after the run, and its drift in between.

Only with the power stage off is nothing held: servo-on at standstill reads whatever stiction holds.
The reference is 0, so that the mean reading is the offset to subtract, interpolated in time between
the two zeros; drift is a warning.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from experiments.assumed import Assumed
from experiments.budget import zero_uncertainty
from experiments.evidence import usable
from experiments.planning.parts import ZERO_AFTER, ZERO_BEFORE
from experiments.recording import Recording, Segment
from model.arrays import FloatArray, joined
from model.identify.estimate import BudgetLine

ZERO = "torque zero"
"""Its line in budgets."""
SETTLED_SHARE = 0.25
"""Share at the start of a servo-off segment that is left out: the rotor unwinds, the port settles."""
_DRIFT_LIMIT = 0.003
"""N m of drift between the zeros above which it is said; about 5 mV of a port with 0.637 N m/V."""


@dataclass(frozen=True)
class Zero:
    """One servo-off reading: time of its middle [s], mean and standard error of the torque [N m]."""

    time: float
    value: float
    standard_error: float


@dataclass(frozen=True)
class TorqueZero:
    """The torque zero of a run as a function of time, with its uncertainty."""

    before: Zero | None
    after: Zero | None
    standard_uncertainty: float
    warnings: tuple[str, ...] = ()
    assumed: Assumed | None = None

    @property
    def is_measured(self) -> bool:
        """Whether any servo-off segment was recorded."""
        return self.before is not None or self.after is not None

    @property
    def drift(self) -> float:
        """Zero after minus zero before [N m]; NaN without both."""
        if self.before is None or self.after is None:
            return math.nan
        return self.after.value - self.before.value

    def at(self, time: FloatArray | float) -> FloatArray:
        """The reading that stands for zero torque at these times [s since the first row]."""
        zeros = [z for z in (self.before, self.after) if z is not None]
        if not zeros:
            return np.zeros_like(np.asarray(time, dtype=np.float64))
        return np.asarray(
            np.interp(time, [z.time for z in zeros], [z.value for z in zeros]), dtype=np.float64
        )

    def budget(self) -> BudgetLine:
        """The line of an uncertainty budget."""
        if self.assumed is not None:
            return self.assumed.line(ZERO, self.standard_uncertainty)
        if not self.is_measured:
            note = "no servo-off zero in this recording; from the channel's calibration"
        elif math.isnan(self.drift):
            note = "one servo-off zero only"
        else:
            note = f"servo-off zeros before and after, drift {self.drift * 1e3:.2f} mN m"
        return BudgetLine(ZERO, "B", self.standard_uncertainty, note)


def torque_zero(recording: Recording, channel: str = "torque") -> TorqueZero:
    """The zero of a torque channel from the servo-off segments of a run."""
    before = _mean_zero(recording, recording.labelled(ZERO_BEFORE), channel)
    after = _mean_zero(recording, recording.labelled(ZERO_AFTER), channel)
    zeros = [z for z in (before, after) if z is not None]
    if not zeros:
        text = (
            "There is no servo-off segment, so the zero of the torque is not known: "
            "half-differences of the directions are "
            "friction, half-sums hold the offset of the port."
        )
        stated, assumed = zero_uncertainty(recording, channel)
        return TorqueZero(None, None, stated, (text,), assumed)
    error = math.sqrt(sum(z.standard_error**2 for z in zeros)) / len(zeros)
    if before is None or after is None:
        missing = ZERO_BEFORE if before is None else ZERO_AFTER
        return TorqueZero(
            before,
            after,
            math.hypot(error, _DRIFT_LIMIT / math.sqrt(3.0)),
            (f"The run has no {missing} segment: drift of the torque zero is not known.",),
        )
    drift = after.value - before.value
    # Linear interpolation is right to a fraction of the drift; rectangular between the two readings.
    uncertainty = math.hypot(error, abs(drift) / math.sqrt(12.0))
    warnings = ()
    if abs(drift) > max(_DRIFT_LIMIT, 6.0 * error):
        warnings = (
            f"The torque zero drifted by {drift * 1e3:.2f} mN m during the run (limit {_DRIFT_LIMIT * 1e3:.0f} mN m): "
            "it is interpolated in time and enters the budget.",
        )
    return TorqueZero(before, after, uncertainty, warnings)


def recorded_zero(recording: Recording) -> TorqueZero | None:
    """The zero of the torque port; None where the run has no torque."""
    return torque_zero(recording) if recording.has("torque") else None


def _mean_zero(recording: Recording, segments: tuple[Segment, ...], channel: str) -> Zero | None:
    values: list[FloatArray] = []
    times: list[FloatArray] = []
    for segment in segments:
        start = segment.start + int(SETTLED_SHARE * (segment.stop - segment.start))
        rows = slice(start, segment.stop)
        good = usable(recording, rows)
        values.append(recording.si(channel, rows)[good])
        times.append(recording.time(rows)[good])
    value = joined(values)
    if len(value) < 8:
        return None
    time = np.concatenate(times)
    blocks = np.array([part.mean() for part in np.array_split(value, min(16, len(value) // 2))])
    error = max(
        float(blocks.std(ddof=1)) / math.sqrt(len(blocks)),
        recording.signals[channel].quantum / math.sqrt(12.0),
    )
    return Zero(float(time.mean()), float(value.mean()), error)
