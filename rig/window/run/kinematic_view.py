"""Kinematic error as it builds up: over the wave-generator angle, revolution by revolution, and
over the output revolution.

(15) ke = theta_o - theta_i/N, with both encoders and the mounted ratio. A live estimate: every
input revolution counts from its own mean, so that what changes once per output revolution stands in
the second plot and not in the first. After a change of set-point the first revolution and a half
are left out, as the analysis leaves out the approach.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from experiments.angle.phase_reference import PhaseReference, phase_reference
from experiments.protocols.velocity_steps.data import carries
from model.units import ARCMIN, DEGREE, REVOLUTION
from rig.window.plot.plots import CurveStyle, LabPlot
from rig.window.run.live_axes import ValueAxis
from rig.window.run.live_view import WAYS, LiveContext, RowView, way_of
from rig.window.shell.session import WindowSession
from rig.window.work.live_file import Block

FloatArray = NDArray[np.float64]
WAVE_BINS = 360
_WIDEST_HOLE = WAVE_BINS // 10
"""Bins in a row that may be empty within a whole revolution: a fast one has fewer rows than bins."""
WIND_UP = 1.5 * REVOLUTION
"""Input angle after a change of set-point that is not shown."""
_FASTEST = 400.0 * REVOLUTION / 60.0
"""rad/s; above, the output's vibration hides the error (the protocol's own highest speed is 300 r/min)."""


class SteadyRows:
    """Which rows turn steadily: the set-point has not changed for `WIND_UP` of the input, and is not zero."""

    def __init__(self) -> None:
        self._target: float | None = None
        self._changed_at = 0.0

    def of(self, target: FloatArray, angle: FloatArray) -> NDArray[np.bool_]:
        """A mask over rows in order."""
        if self._target is None:
            self._target, self._changed_at = float(target[0]), float(angle[0])
        changes = np.diff(target, prepend=self._target) != 0.0
        marks = np.where(changes, np.arange(len(target)), -1)
        latest = np.maximum.accumulate(marks)
        since = np.where(latest >= 0, angle[np.maximum(latest, 0)], self._changed_at)
        self._target, self._changed_at = float(target[-1]), float(since[-1])
        return (np.abs(angle - since) >= WIND_UP) & (target != 0.0) & (np.abs(target) <= _FASTEST)


class Revolutions:
    """Means over angle bins of whole input revolutions, one after the other, added up per direction."""

    def __init__(self) -> None:
        self.total = {1: np.zeros(WAVE_BINS), -1: np.zeros(WAVE_BINS)}
        self.low = {w: np.full(WAVE_BINS, np.inf) for w, _ in WAYS}
        self.high = {w: np.full(WAVE_BINS, -np.inf) for w, _ in WAYS}
        self.count = {1: 0, -1: 0}
        self.latest: FloatArray | None = None
        self._which: tuple[int, int] | None = None
        self._sum, self._hits = np.zeros(WAVE_BINS), np.zeros(WAVE_BINS)

    def add(self, angle: FloatArray, error: FloatArray, way: int) -> None:
        """Rows of one direction in order."""
        turn = np.floor(angle / REVOLUTION).astype(np.int64)
        edges = np.flatnonzero(np.diff(turn)) + 1
        for a, b in zip(np.split(angle, edges), np.split(error, edges), strict=True):
            which = (int(np.floor(a[0] / REVOLUTION)), way)
            if which != self._which:
                self._finish()
                self._which = which
            bins = np.minimum(
                (np.mod(a, REVOLUTION) / REVOLUTION * WAVE_BINS).astype(np.int64), WAVE_BINS - 1
            )
            self._sum += np.bincount(bins, b, WAVE_BINS)
            self._hits += np.bincount(bins, minlength=WAVE_BINS)

    def cut(self) -> bool:
        """The turning was interrupted: a revolution that is not whole does not count. Whether there
        was one under way.
        """
        was = bool(self._hits.any())
        self._finish()
        self._which = None
        return was

    def current(self) -> FloatArray:
        """The revolution that is under way, about its own mean; NaN where it has not been."""
        been = np.flatnonzero(self._hits)
        if not len(been):
            return np.full(WAVE_BINS, np.nan)
        mean = self._sum[been] / self._hits[been]
        curve = np.interp(np.arange(WAVE_BINS), been, mean - mean.mean(), np.nan, np.nan)
        for hole in np.flatnonzero(np.diff(been) > _WIDEST_HOLE):
            curve[been[hole] + 1 : been[hole + 1]] = np.nan
        return curve

    def mean(self, way: int) -> FloatArray | None:
        """The mean of all whole revolutions in one direction."""
        count = self.count[way]
        return np.asarray(self.total[way] / float(count), dtype=np.float64) if count else None

    def _finish(self) -> None:
        been = np.flatnonzero(self._hits)
        if (
            self._which is not None
            and len(been)
            and np.diff(been, append=been[0] + WAVE_BINS).max() <= _WIDEST_HOLE
        ):
            curve = np.interp(
                np.arange(WAVE_BINS), been, self._sum[been] / self._hits[been], period=WAVE_BINS
            )
            curve -= curve.mean()
            way = self._which[1]
            self.total[way] += curve
            self.low[way], self.high[way] = (
                np.minimum(self.low[way], curve),
                np.maximum(self.high[way], curve),
            )
            self.count[way] += 1
            self.latest = curve
        self._sum[:], self._hits[:] = 0.0, 0.0


class _ErrorRows:
    """The kinematic error of the steady rows of a run, block by block."""

    def __init__(self, context: LiveContext) -> None:
        metadata = context.recording.metadata
        self.ratio, self._sense = metadata.ratio, metadata.output_sense
        self._context = context
        self._steady = SteadyRows()
        self.reference: PhaseReference | None = None

    def of(self, block: Block) -> tuple[FloatArray, FloatArray, FloatArray, int] | None:
        """Input angle from the reference, output angle, error [rad] and direction of the steady
        rows; None without any.
        """
        if (
            not {"input_angle", "output_angle", "target_speed"} <= block.si.keys()
            or not block.good.any()
        ):
            return None
        inner, target = block.si["input_angle"][block.good], block.si["target_speed"][block.good]
        steady = self._steady.of(target, inner)
        if not steady.any():
            return None
        if self.reference is None:
            self.reference = phase_reference(self._context.recording)
        outer = self._sense * block.si["output_angle"][block.good][steady]
        inner, target = inner[steady], target[steady]
        way = way_of(float(target[-1]))
        same = np.sign(target) == way
        inner, outer = inner[same] - self.reference.input_angle, outer[same]
        return inner, outer, outer - inner / self.ratio, way


class WaveView(RowView):
    """Kinematic error over the wave-generator angle: the revolution under way, and the mean of
    those before, each direction.
    """

    wanted = ("input_angle", "output_angle", "target_speed")

    def __init__(self, session: WindowSession, context: LiveContext) -> None:
        self.plot = LabPlot(
            session, "Kinematic error", "wave-generator angle [deg]", "error [arcmin]"
        )
        self.plot.item.setXRange(0.0, 360.0, padding=0.0)
        self._context, self._predicted = context, False
        self._rows, self.revolutions = _ErrorRows(context), Revolutions()
        styles: tuple[CurveStyle, CurveStyle] = ("line", "dashed")
        self._current = self.plot.curve("this revolution", 2, dense=True)
        self._mean = {
            way: self.plot.curve(name, k, styles[k], still=True)
            for k, (way, name) in enumerate(WAYS)
        }
        self._degrees = (np.arange(WAVE_BINS) + 0.5) * 360.0 / WAVE_BINS
        self._values = ValueAxis(self.plot)
        self._changed, self._drawn = False, dict.fromkeys(self._mean, 0)

    def take(self, block: Block) -> None:
        """New rows."""
        rows = self._rows.of(block)
        if rows is None:
            self._changed |= self.revolutions.cut()
        else:
            inner, _, error, way = rows
            self.revolutions.add(inner, error, way)
            self._changed = True

    def draw(self, recent: bool) -> None:
        """Bring the curves up to date: the revolution under way with every row, the means when a
        revolution is whole.
        """
        if self._changed:
            self._changed = False
            self._current.item.setData(self._degrees, self.revolutions.current() / ARCMIN)
        for way, curve in self._mean.items():
            mean, count = self.revolutions.mean(way), self.revolutions.count[way]
            if mean is not None and count != self._drawn[way]:
                self._drawn[way] = count
                curve.item.setData(self._degrees, mean / ARCMIN)
                self.plot.rename(curve, f"{dict(WAYS)[way]} ({count})")
        if self._rows.reference is not None:
            where = "index mark" if self._rows.reference.carries else "start of the run"
            self.plot.set_x_label(f"wave-generator angle from the {where} [deg]")
            self._draw_prediction(self._rows.reference)
        self._values.follow(recent)

    def _draw_prediction(self, reference: PhaseReference) -> None:
        """The error of the parameter set, where it was identified against the index marks that this
        run has seen as well.
        """
        seen, gear = self._context.prediction, self._context.recording.metadata.gear
        if (
            self._predicted
            or seen is None
            or seen.error is None
            or gear is None
            or not carries(gear, reference)
        ):
            return
        self._predicted = True
        error = seen.error.value - seen.error.value.mean()
        self.plot.curve("predicted", 3, "dotted", still=True).item.setData(
            seen.error.angle / DEGREE, error / ARCMIN
        )


class OutputView(RowView):
    """Kinematic error over the output revolution, each direction: the smallest and the largest error of every input
    revolution. The whole height is what transmission accuracy is taken from."""

    wanted = WaveView.wanted

    def __init__(self, session: WindowSession, context: LiveContext) -> None:
        self.plot = LabPlot(
            session,
            "Kinematic error over the output",
            "output angle from the start of the run [deg]",
            "error [arcmin]",
        )
        self.plot.item.setXRange(0.0, 360.0, padding=0.0)
        self._rows = _ErrorRows(context)
        if np.isfinite(self._rows.ratio):
            self._bins = max(12, min(round(abs(self._rows.ratio)), 720))
        else:
            self._bins = 120
        self._low = {way: np.full(self._bins, np.nan) for way, _ in WAYS}
        self._high = {way: np.full(self._bins, np.nan) for way, _ in WAYS}
        styles: tuple[CurveStyle, CurveStyle] = ("line", "dashed")
        self._curves = {
            way: (
                self.plot.curve(name, k, styles[k], still=True),
                self.plot.curve("", k, styles[k], still=True),
            )
            for k, (way, name) in enumerate(WAYS)
        }
        self._origin: float | None = None
        self._values, self._changed = ValueAxis(self.plot), set[int]()

    def take(self, block: Block) -> None:
        """New rows."""
        rows = self._rows.of(block)
        if rows is None:
            return
        _, outer, error, way = rows
        if self._origin is None:
            self._origin = float(outer[0])
        angle = np.mod((outer - self._origin) / REVOLUTION, 1.0)
        bins = np.minimum((angle * self._bins).astype(np.int64), self._bins - 1)
        edges = np.flatnonzero(np.diff(bins, prepend=-1))
        for store, ufunc in ((self._low[way], np.fmin), (self._high[way], np.fmax)):
            before = store[bins[edges]]
            ufunc.at(store, bins[edges], ufunc.reduceat(error, edges))
            if not np.array_equal(before, store[bins[edges]], equal_nan=True):
                self._changed.add(way)

    def draw(self, recent: bool) -> None:
        """Bring the curves up to date, about the middle of what there is in each direction."""
        degrees = (np.arange(self._bins) + 0.5) * 360.0 / self._bins
        while self._changed:
            way = self._changed.pop()
            low, high, curves = self._low[way], self._high[way], self._curves[way]
            filled = np.isfinite(low)
            if filled.any():
                middle = 0.5 * (float(low[filled].min()) + float(high[filled].max()))
                for curve, edge in zip(curves, (low, high), strict=True):
                    curve.item.setData(degrees[filled], (edge[filled] - middle) / ARCMIN)
        self._values.follow(recent)
