"""A first look at a motion: where its noise begins, how fast it goes, how late its other channels are.

The spectrum of the position falls with frequency until it lies on the floor of its noise. Where it
is still ten times that floor is motion; the highest such frequency is the cut-off of the filter,
and 2.5 times the one below which 99 % of the acceleration lies where that is more.
The floor also tells the noise of the speed after that filter,

    u_v^2 = integral of (2 pi f)^2 S_0 from 0 to f_c = (2 pi)^2 S_0 f_c^3 / 3

and with it the dead zone: slower than five times this noise is not told from standstill. Creep,
wind-up and the filter's own ringing after a stop go with it: it is half a hundredth of the highest
speed at least.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy  # pyright: ignore[reportMissingTypeStubs]

from model.errors import IdentificationError
from model.identify.checks import Array
from model.identify.least_squares import student_quantile
from model.identify.motion_columns import MotionFilter, low_pass, slope
from model.identify.motion_source import MotionSource

LOOKED_AT = 1 << 19
"""Rows that are looked at, in pieces over the whole recording where it has more."""
PIECES = 8
LEAST_CORRELATION, SHARE_TOLERANCE = 0.9, 0.1
"""What a channel that guides a fit has in common with the position: correlation, or slope of the accelerations."""
_SPECTRUM_ROWS = 1 << 15
_ABOVE_NOISE = 10.0
"""Power over the noise floor that still is motion."""
_ABOVE_MOTION = 2.5
"""Times the frequency below which 99 % of the acceleration lies: there the filter takes less than a thousandth off."""
FLOOR_BAND = (0.6, 0.95)
"""Of half the sampling frequency, or of a lower end of the band: where the floor is looked for."""
_HIGHEST_CUTOFF = 0.2
"""Of the sampling frequency: central differences need five samples of a period; twice that is still tried."""
_DEAD_ZONE = 5.0
"""Standard deviations of the speed's noise."""
_CREEP_SHARE = 0.005
"""Of the highest speed: creep, wind-up and ringing after a stop."""
LEAST_ROWS = 200
_LEAST_LINES = 24
"""Of the spectrum, that a part of it must have."""
LONGEST_LAG = 0.5
"""s by which a drive may be late with its speed."""


@dataclass(frozen=True)
class Look:
    """What a first look shows: cut-off [Hz] by the data, noise floor [unit^2/Hz] of what is differentiated, top speed.

    `of_position` says whether that is a position; otherwise it is a speed.
    """

    cutoff_hz: float
    floor: float
    top_speed: float
    of_position: bool

    def speed_noise(self, cutoff_hz: float) -> float:
        """Standard deviation of the speed after a filter of this cut-off."""
        if self.of_position:
            return 2.0 * math.pi * math.sqrt(self.floor * cutoff_hz**3 / 3.0)
        return math.sqrt(self.floor * cutoff_hz)

    def least_speed(self, cutoff_hz: float) -> float:
        """The dead zone of a filter of this cut-off."""
        return max(_DEAD_ZONE * self.speed_noise(cutoff_hz), _CREEP_SHARE * self.top_speed)


def look_at(source: MotionSource, highest_hz: float = math.inf) -> Look:
    """Cut-off, noise and top speed of a motion. Raises `IdentificationError` for one that does not move.

    `highest_hz`: where what lies above is noise of another level, the floor is looked for below that.
    """
    rate = 1.0 / source.period
    band = min(0.5 * rate, highest_hz)
    pieces = [(is_position, values) for is_position, values in _pieces(source)]
    if not pieces:
        raise IdentificationError(
            "has too few samples without a gap",
            where="motion",
            value=max((s.rows for s in source.stretches), default=0),
            limit=f">= {LEAST_ROWS}",
            remedy="Record longer without interruption.",
        )
    of_position = pieces[0][0]
    if max(float(np.ptp(values)) for _, values in pieces) <= 0.0:
        raise IdentificationError(
            "does not move",
            where="position" if of_position else "speed",
            value=float(pieces[0][1][0]),
            remedy="Choose a part of the run with motion.",
        )
    frequency, power = _spectrum([values for _, values in pieces], rate)
    seen = frequency <= band
    if np.count_nonzero(seen) > _LEAST_LINES:
        frequency, power = frequency[seen], power[seen]
    inside = (frequency > FLOOR_BAND[0] * band) & (frequency < FLOOR_BAND[1] * band)
    # The median of a spectrum of few averages lies ln 2 under its mean.
    floor = float(np.median(power[inside])) / math.log(2.0)
    # The window spreads the mean over the first bins.
    above = power[4:] > _ABOVE_NOISE * floor
    end = 4 + (int(np.argmin(above)) if not above.all() else len(above) - 1)
    # Of the acceleration that is no noise: where all but a hundredth of it lies below. A motion of few
    # lines has valleys between them: it ends where the mean over an octave is noise.
    total = np.concatenate([[0.0], np.cumsum(power)])
    start = np.arange(4, len(power) // 2)
    octave = (total[2 * start + 1] - total[start]) / (start + 1)
    quiet = np.flatnonzero(octave < _ABOVE_NOISE * floor)
    last = max(2 * int(start[quiet[0]]) if len(quiet) else len(power), end)
    is_motion = (power > _ABOVE_NOISE * floor) & (np.arange(len(power)) <= last)
    moving = np.where(is_motion, power, 0.0) * frequency ** (4 if of_position else 2)
    share = np.cumsum(moving) / max(float(moving.sum()), 1e-300)
    fastest = _ABOVE_MOTION * float(frequency[int(np.searchsorted(share, 0.99))])
    limits = float(frequency[5]), min(_HIGHEST_CUTOFF * rate, float(frequency[-1]))
    cutoff = float(np.clip(max(float(frequency[end]), fastest), *limits))
    return Look(cutoff, floor, _top_speed(source, pieces, cutoff), of_position)


def _spectrum(pieces: list[Array], rate: float) -> tuple[Array, Array]:
    """Frequencies [Hz] and power density of the pieces, each by its length."""
    rows = min(_SPECTRUM_ROWS, min(len(values) for values in pieces) // 4)
    spectra: list[Array] = []
    frequency = np.empty(0)
    for values in pieces:
        frequency, power = scipy.signal.welch(
            values, rate, window="blackmanharris", nperseg=rows, detrend="linear"
        )
        spectra.append(power * len(values))
    return frequency, np.sum(spectra, axis=0) / sum(len(values) for values in pieces)


def _pieces(source: MotionSource) -> list[tuple[bool, Array]]:
    """Position (or speed) on an even axis, in pieces from all over the recording."""
    total = sum(s.rows for s in source.stretches)
    found: list[tuple[bool, Array]] = []
    for stretch in source.stretches:
        if stretch.rows < LEAST_ROWS:
            continue
        share = LOOKED_AT * stretch.rows / total
        count = 1 if stretch.rows <= share else PIECES
        length = min(stretch.rows, max(LEAST_ROWS, int(share / count)))
        for k in range(count):
            start = stretch.start + (stretch.rows - length) * k // max(count - 1, 1)
            block = source.read(start, start + length)
            values = block.place
            if values is None or len(block.time) < LEAST_ROWS // 2:
                continue
            if not source.is_even:
                axis = np.arange(block.time[0], block.time[-1], source.period)
                values = np.interp(axis, block.time, values)
            found.append((block.position is not None, values))
    return found


def _top_speed(source: MotionSource, pieces: list[tuple[bool, Array]], cutoff: float) -> float:
    """The speed [unit/s] that one sample in a hundred exceeds."""
    recipe = MotionFilter(cutoff_hz=cutoff, decimation=1)
    speeds: list[Array] = []
    for is_position, values in pieces:
        smooth = low_pass(values, recipe, source.period)
        speeds.append(np.abs(slope(smooth, source.period) if is_position else smooth))
    return float(np.quantile(np.concatenate(speeds), 0.99))


@dataclass(frozen=True)
class SpeedChannel:
    """A measured speed beside the derivative of the position: how late [s] with its U, and its scale to it."""

    lag: float
    lag_uncertainty: float
    scale: float
    correlation: float
    """Of both accelerations, once the lag is taken off."""
    share: float
    """Slope of the position's acceleration over the channel's: 1 for the same motion, less by the channel's noise."""
    share_uncertainty: float
    """U of it, from the scatter over parts of the recording."""

    @property
    def is_instrument(self) -> bool:
        """Whether it guides a fit: by its correlation, or, beside a noisy position, by its own motion in that.

        Noise of the position lowers the correlation and not the slope: just there an instrument is needed.
        """
        alike = (
            abs(self.share - 1.0) <= SHARE_TOLERANCE and self.share_uncertainty <= SHARE_TOLERANCE
        )
        return self.correlation >= LEAST_CORRELATION or alike


def compare_speed(
    source: MotionSource, cutoff_hz: float, *, of_position: bool
) -> SpeedChannel | None:
    """The instrument channel against the derivative of the position, after the same filter; None for too little motion.

    `of_position`: whether the channel is itself a position (a set-point). Its lag is where the cross-correlation of
    both speeds is largest, to a part of a sample; its U is from the scatter over parts of the recording.
    """
    stretch = max(source.stretches, key=lambda s: s.rows)
    block = source.read(stretch.start, min(stretch.stop, stretch.start + LOOKED_AT))
    if block.position is None or block.instrument is None or len(block.time) < LEAST_ROWS:
        return None
    recipe = MotionFilter(cutoff_hz=cutoff_hz, decimation=1)
    axis = np.arange(block.time[0], block.time[-1], source.period)
    own, other = (
        low_pass(np.interp(axis, block.time, values), recipe, source.period)
        for values in (block.position, block.instrument)
    )
    own = slope(own, source.period)
    if of_position:
        other = slope(other, source.period)
    edge = recipe.settling(source.period)
    own, other = own[edge:-edge], other[edge:-edge]
    most = min(int(LONGEST_LAG / source.period), len(own) // 4)
    if len(own) < 8 * PIECES or not (own.std() > 0.0 and other.std() > 0.0):
        return None
    lag = _late(own, other, most)
    parts = [
        _late(a, b, most)
        for a, b in zip(np.array_split(own, PIECES), np.array_split(other, PIECES), strict=True)
        if a.std() > 0.3 * own.std() and b.std() > 0.3 * other.std()
    ]
    spread = math.nan
    if len(parts) > 2:
        spread = student_quantile(len(parts) - 1) * float(np.std(parts, ddof=1))
        spread /= math.sqrt(len(parts))
    place = np.arange(len(own), dtype=np.float64)
    aligned = np.interp(place + lag, place, other)
    scale = float(own @ aligned / (own @ own))
    ours, theirs = slope(own, source.period), slope(aligned, source.period)
    share, share_spread = _share(ours, theirs)
    return SpeedChannel(
        lag=lag * source.period,
        lag_uncertainty=spread * source.period,
        scale=scale,
        correlation=float(np.corrcoef(ours, theirs)[0, 1]),
        share=share,
        share_uncertainty=share_spread,
    )


def _share(ours: Array, theirs: Array) -> tuple[float, float]:
    """Slope of our acceleration over theirs with its U, by parts of the recording."""
    pairs = zip(np.array_split(ours, PIECES), np.array_split(theirs, PIECES), strict=True)
    # Each part by its weight in the whole slope, so that a quiet one says little.
    misses = np.array([b @ (a - b * (ours @ theirs) / (theirs @ theirs)) for a, b in pairs])
    error = math.sqrt(PIECES / (PIECES - 1) * float(misses @ misses)) / float(theirs @ theirs)
    return float(ours @ theirs / (theirs @ theirs)), student_quantile(PIECES - 1) * error


def _late(own: Array, other: Array, most: int) -> float:
    """Samples by which `other` is later than `own`, where their cross-correlation is largest."""
    most = min(most, len(own) // 2)
    both = scipy.signal.correlate(other - other.mean(), own - own.mean(), mode="full")
    middle = len(own) - 1
    window = both[middle - most : middle + most + 1]
    k = int(np.argmax(window))
    if not 0 < k < len(window) - 1:
        return float(k - most)
    before, here, after = window[k - 1 : k + 2]
    return k - most + 0.5 * (before - after) / (before - 2.0 * here + after)
