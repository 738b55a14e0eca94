"""What every live plot is: it takes new rows, hears of segments that have ended, and draws when it is asked to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from experiments.recording import Recording, Segment
from rig.present.preview.plan import PlanPreview
from rig.run.dry_run import PlannedRun
from rig.window.plot.plots import LabPlot
from rig.window.run.live_axes import RECENT, TimeAxis, ValueAxis
from rig.window.shell.session import WindowSession
from rig.window.work.live_file import Block, Envelope, RollingEnvelope, SlidingSpeed
from rig.window.work.segment_work import SegmentWork

_RUN_TIME = "time since the start of the run [s]"
MILLI = 1e-3
FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
WAYS = ((1, "forward"), (-1, "reverse"))
"""Both directions of the input."""
_TORQUE_LABELS = {"torque": "monitor port", "drive_torque": "reported by the drive"}


def way_of(value: float) -> int:
    """The direction of a speed, a set-point or a turn that is not zero."""
    return 1 if value > 0.0 else -1


def torque_channel(recording: Recording) -> str:
    """The channel of the motor torque: the monitor port where the rig has one."""
    return "torque" if recording.has("torque") else "drive_torque"


def cycle_period(recording: Recording) -> float:
    """s from one cycle to the next; a millisecond where the run does not say."""
    rate = recording.metadata.sample_rate
    return 1.0 / rate if rate > 0.0 else 1e-3


@dataclass
class LiveContext:
    """What the views know of a run when it begins: its file; the plan and its preview where this window started it."""

    recording: Recording
    """The file that is open now: the growing one, and from its end on the sealed one."""
    planned: PlannedRun | None = None
    prediction: PlanPreview | None = None
    work: SegmentWork = field(default_factory=SegmentWork)
    """Where what a segment says is worked out."""
    begun: list[float] = field(default_factory=list)
    """When each step of the plan began, so far, since the start of the run [s]."""

    @property
    def duration(self) -> float:
        """Planned duration [s]; a few seconds where no plan is known."""
        return 5.0 if self.planned is None else self.planned.nominal

    @property
    def period(self) -> float:
        """s from one cycle to the next."""
        return cycle_period(self.recording)


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

    def take(self, block: Block) -> None:
        """New rows."""
        ...

    def ended(self, segment: Segment, recording: Recording) -> None:
        """A segment has ended. What takes long is left to the work of the context."""
        ...

    def draw(self, recent: bool) -> None:
        """Bring the curves up to date that have changed; `recent`: only the latest seconds, where
        the plot runs over time.
        """
        ...


class RowView:
    """A live plot of the rows as they come: a segment that has ended adds nothing to it."""

    def ended(self, segment: Segment, recording: Recording) -> None:
        """Nothing: it is the rows that are drawn."""


class SegmentView:
    """A live plot of what whole segments say: nothing of it is drawn before one has ended."""

    def take(self, block: Block) -> None:
        """Nothing: it is whole segments that are drawn."""


class _Trace:
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


class _TraceView(RowView):
    """Signals over time: (channel, name in the legend, factor from SI, style)."""

    def __init__(
        self,
        session: WindowSession,
        title: str,
        y_label: str,
        signals: Sequence[tuple[str, str, float, Any]],
        duration: float = 0.0,
    ) -> None:
        self.plot = LabPlot(session, title, _RUN_TIME, y_label)
        self._axis, self._values = TimeAxis(self.plot, duration), ValueAxis(self.plot)
        self.wanted = tuple(signal[0] for signal in signals)
        self._signals = [
            (name, factor, _Trace(), self.plot.curve(label, k, style, dense=True))
            for k, (name, label, factor, style) in enumerate(signals)
        ]
        self._drawn: tuple[float, bool] | None = None

    def take(self, block: Block) -> None:
        """New rows; incomplete cycles are left out."""
        for name, factor, trace, _ in self._signals:
            if name in block.si:
                trace.add(block.time[block.good], block.si[name][block.good] / factor)

    def draw(self, recent: bool) -> None:
        """Bring the curves up to date."""
        latest = max((trace.latest for _, _, trace, _ in self._signals), default=0.0)
        if self._drawn == (latest, recent):
            return
        self._drawn = latest, recent
        for _, _, trace, curve in self._signals:
            curve.item.setData(*trace.curve(recent))
        self._axis.follow(latest, recent)
        self._values.follow(recent)


class PredictedTorque(_TraceView):
    """A trace over what was predicted of it: drawn in advance over the nominal times of the plan, and each
    step over the times since it has begun.
    """

    def __init__(
        self,
        session: WindowSession,
        title: str,
        y_label: str,
        signals: Sequence[tuple[str, str, float, Any]],
        context: LiveContext,
        seen: PlanPreview,
    ) -> None:
        super().__init__(session, title, y_label, signals, context.duration)
        self._context, self._seen, self._known = context, seen, 0
        low, high = seen.torque.low / MILLI, seen.torque.high / MILLI
        self.predicted = self.plot.add_series(
            "predicted", seen.time, seen.torque.value / MILLI, "band", group=3, low=low, high=high
        )
        self.predicted.item.setZValue(-5)

    def draw(self, recent: bool) -> None:
        """Bring the curves up to date; what is predicted moves to where its steps have begun."""
        begun = self._context.begun
        if len(begun) != self._known:
            self._known = len(begun)
            self.predicted.move(since_begun(self._seen.time, self._seen.step, begun))
        super().draw(recent)


def since_begun(time: FloatArray, step: IntArray, begun: Sequence[float]) -> FloatArray:
    """Nominal times [s] of instants, each in a `step` of the plan, as they are once steps have begun at `begun` [s].

    A step that was over sooner than planned ends where the next one begins; what has not begun is as
    late as the latest step that has.
    """
    if not len(time) or not len(begun):
        return time
    starts = np.asarray(begun, dtype=np.float64)
    own = np.minimum(step, len(starts) - 1)
    # Steps that take no time have no instants: one of them begins nominally where the next instant is.
    nominal = time[np.minimum(np.searchsorted(step, np.arange(len(starts))), len(time) - 1)]
    moved = time + (starts - nominal)[own]
    ends = np.append(starts[1:], np.inf)
    over = step < len(starts)
    return np.where(over, np.minimum(moved, ends[own]), moved)


class SpeedView(RowView):
    """Input speed over time: what was asked for and what the encoder says."""

    wanted = ("input_angle", "target_speed")

    def __init__(self, session: WindowSession, context: LiveContext) -> None:
        self.plot = LabPlot(session, "Input speed", _RUN_TIME, "input speed [r/min]")
        self._axis, self._values = TimeAxis(self.plot, context.duration), ValueAxis(self.plot)
        self._speed = SlidingSpeed(context.period)
        self._measured, self._target = _Trace(), _Trace()
        target = self.plot.curve("set-point", 1, dense=True)
        self._curves = self.plot.curve("measured", 0, dense=True), target
        self._drawn: tuple[float, float, bool] | None = None

    def take(self, block: Block) -> None:
        """New rows."""
        from model.units import RPM

        if "input_angle" in block.si:
            time, speed = self._speed.of(block, "input_angle")
            self._measured.add(time, speed / RPM)
        if "target_speed" in block.si:
            self._target.add(block.time[block.good], block.si["target_speed"][block.good] / RPM)

    def draw(self, recent: bool) -> None:
        """Bring the curves up to date."""
        now = self._measured.latest, self._target.latest, recent
        if self._drawn == now:
            return
        self._drawn = now
        measured, target = self._curves
        measured.item.setData(*self._measured.curve(recent))
        target.item.setData(*self._target.curve(recent))
        self._axis.follow(self._measured.latest, recent)
        self._values.follow(recent)


def torque_view(session: WindowSession, context: LiveContext) -> _TraceView:
    """Motor torque over time, from the monitor port where the rig has one."""
    name = torque_channel(context.recording)
    signals = [(name, _TORQUE_LABELS[name], MILLI, "line")]
    words = "Motor torque", "motor torque [mN m]"
    if context.prediction is None:
        return _TraceView(session, *words, signals, context.duration)
    return PredictedTorque(session, *words, signals, context, context.prediction)


def temperature_view(session: WindowSession, context: LiveContext) -> _TraceView:
    """Housing and room temperature over time."""
    signals = [
        ("housing_temperature", "gear housing", 1.0, "line"),
        ("ambient_temperature", "room", 1.0, "dashed"),
    ]
    there = [signal for signal in signals if context.recording.has(signal[0])]
    return _TraceView(session, "Temperature", "temperature [°C]", there, context.duration)
