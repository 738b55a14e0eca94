"""What every live plot is: it takes new rows, hears of segments that have ended, and draws when it is asked to."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from experiments.recording import Recording, Segment
from rig.preview.preview import PlanPreview
from rig.run.dry_run import PlannedRun
from rig.window.live_file import Block, Envelope, RollingEnvelope, SlidingSpeed
from rig.window.palette import Palette
from rig.window.plots import LabPlot
from rig.window.session import WindowSession

RUN_TIME = "time since the start of the run [s]"
RECENT = 20.0
"""s that "latest" shows."""
GROWTH = 1.2
"""How far a time axis reaches beyond the run when it has to grow."""
MILLI = 1e-3


@dataclass(frozen=True)
class LiveContext:
    """What the views know of a run when it begins: its file; the plan and its preview where this window started it."""

    recording: Recording
    planned: PlannedRun | None = None
    prediction: PlanPreview | None = None

    @property
    def duration(self) -> float:
        """Planned duration [s]; a few seconds where no plan is known."""
        return 5.0 if self.planned is None else self.planned.nominal

    @property
    def period(self) -> float:
        """s from one cycle to the next."""
        rate = self.recording.metadata.sample_rate
        return 1.0 / rate if rate > 0.0 else 1e-3


class LiveView(Protocol):
    """One live plot."""

    @property
    def plot(self) -> LabPlot:
        """The plot to be laid out."""
        ...

    @property
    def wanted(self) -> tuple[str, ...]:
        """Channels that it draws from."""
        ...

    @property
    def is_slow(self) -> bool:
        """Whether what it shows changes with a revolution or a segment, not with every row."""
        ...

    def take(self, block: Block) -> None:
        """New rows."""
        ...

    def ended(self, segment: Segment, recording: Recording) -> None:
        """A segment has ended."""
        ...

    def draw(self, recent: bool) -> None:
        """Bring the curves up to date; `recent`: only the latest seconds, where the plot runs over time."""
        ...


class TimeAxis:
    """The time axis of a live plot: it grows in steps, so that most frames need no new axis; a look that somebody chose with
    the mouse stays until the whole or the latest is asked for again."""

    def __init__(self, plot: LabPlot, least: float = 5.0) -> None:
        self._plot, self._end, self._least = plot, 0.0, least
        self._shown: tuple[float, float] | None = None
        self._recent: bool | None = None
        self._is_chosen = False
        plot.item.enableAutoRange(x=False, y=True)
        plot.item.getViewBox().sigRangeChangedManually.connect(self._leave)

    def follow(self, now: float, recent: bool) -> None:
        """Show the run up to now [s], or its latest seconds."""
        if recent != self._recent:
            self._recent, self._is_chosen, self._shown = recent, False, None
            self._plot.item.enableAutoRange(x=False, y=True)
        if recent:
            end = math.ceil(now)
            wanted = (end - RECENT, float(end))
        else:
            if now > self._end:
                self._end = max(GROWTH * now, self._least)
            wanted = (-0.02 * self._end, self._end)
        if wanted != self._shown and not self._is_chosen:
            self._shown = wanted
            self._plot.item.setXRange(*wanted, padding=0.0)

    def _leave(self, *_: object) -> None:
        self._is_chosen = True


class Trace:
    """One signal over the time of the run: as a whole, and its latest seconds."""

    def __init__(self) -> None:
        self._whole, self._recent = Envelope(), RollingEnvelope(RECENT)
        self.latest = 0.0

    def add(self, time: Any, values: Any) -> None:
        """Take in rows."""
        if len(time):
            self.latest = float(time[-1])
        self._whole.add(time, values)
        self._recent.add(time, values)

    def curve(self, recent: bool) -> tuple[Any, Any]:
        """What to draw."""
        return (self._recent if recent else self._whole).curve()


class TraceView:
    """Signals over time: (channel, name in the legend, factor from SI, style)."""

    is_slow = False

    def __init__(
        self, session: WindowSession, title: str, y_label: str, signals: Sequence[tuple[str, str, float, Any]],
        duration: float = 0.0,
    ) -> None:  # fmt: skip
        self.plot = LabPlot(session, title, RUN_TIME, y_label)
        self._axis = TimeAxis(self.plot, duration)
        self.wanted = tuple(signal[0] for signal in signals)
        self._signals = [(name, factor, Trace(), self.plot.curve(label, k, style, dense=True))
                         for k, (name, label, factor, style) in enumerate(signals)]  # fmt: skip

    def take(self, block: Block) -> None:
        """New rows; incomplete cycles are left out."""
        for name, factor, trace, _ in self._signals:
            if name in block.si:
                trace.add(block.time[block.good], block.si[name][block.good] / factor)

    def ended(self, segment: Segment, recording: Recording) -> None:
        """Nothing: it is the rows that are drawn."""

    def draw(self, recent: bool) -> None:
        """Bring the curves up to date."""
        for _, _, trace, curve in self._signals:
            curve.item.setData(*trace.curve(recent))
        self._axis.follow(max((trace.latest for _, _, trace, _ in self._signals), default=0.0), recent)


class SpeedView:
    """Input speed over time: what was asked for and what the encoder says."""

    wanted = ("input_angle", "target_speed")
    is_slow = False

    def __init__(self, session: WindowSession, context: LiveContext) -> None:
        self.plot = LabPlot(session, "Input speed", RUN_TIME, "input speed [r/min]")
        self._axis = TimeAxis(self.plot, context.duration)
        self._speed = SlidingSpeed(context.period)
        self._measured, self._target = Trace(), Trace()
        target = self.plot.curve("set-point", 1, dense=True)
        self._curves = self.plot.curve("measured", 0, dense=True), target

    def take(self, block: Block) -> None:
        """New rows."""
        from model.units import RPM

        if "input_angle" in block.si:
            time, speed = self._speed.of(block, "input_angle")
            self._measured.add(time, speed / RPM)
        if "target_speed" in block.si:
            self._target.add(block.time[block.good], block.si["target_speed"][block.good] / RPM)

    def ended(self, segment: Segment, recording: Recording) -> None:
        """Nothing: it is the rows that are drawn."""

    def draw(self, recent: bool) -> None:
        """Bring the curves up to date."""
        measured, target = self._curves
        measured.item.setData(*self._measured.curve(recent))
        target.item.setData(*self._target.curve(recent))
        self._axis.follow(self._measured.latest, recent)


def torque_view(session: WindowSession, context: LiveContext) -> TraceView:
    """Motor torque over time, from the monitor port where the rig has one."""
    name = "torque" if context.recording.has("torque") else "drive_torque"
    label = "monitor port" if name == "torque" else "reported by the drive"
    view = TraceView(session, "Motor torque", "motor torque [mN m]", [(name, label, MILLI, "line")], context.duration)
    seen = context.prediction
    if seen is not None:
        # Drawn in advance over the nominal times of the plan: steps that wait for something shift it.
        low, high = seen.torque.low / MILLI, seen.torque.high / MILLI
        curve = view.plot.add_series("predicted", seen.time, seen.torque.value / MILLI, "band", 3, low, high)
        curve.item.setZValue(-5)
    return view


def temperature_view(session: WindowSession, context: LiveContext) -> TraceView:
    """Housing and room temperature over time."""
    signals = [("housing_temperature", "gear housing", 1.0, "line"), ("ambient_temperature", "room", 1.0, "dashed")]
    there = [signal for signal in signals if context.recording.has(signal[0])]
    return TraceView(session, "Temperature", "temperature [°C]", there, context.duration)


def restyled(views: Sequence[LiveView], palette: Palette) -> None:
    """Draw every plot in the colours of a theme."""
    for view in views:
        view.plot.restyle(palette)
