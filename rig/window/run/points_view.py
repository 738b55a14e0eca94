"""Points that fill in as segments end: running torque over speed, starting torque over position.

The same averaging as the analysis uses (`experiments.torque.running_torque`), over the latest zero that is
known: a live estimate.
"""

from __future__ import annotations

import math
from collections import defaultdict
from functools import partial

import numpy as np

from experiments.errors import ExperimentError
from experiments.recording import Recording, Segment
from experiments.torque.running_torque import measured_holds
from experiments.torque.zero import torque_zero
from model.errors import ModelError
from model.friction import friction_torque
from model.identify.running_torque import RunningTorque
from model.units import DEGREE, REVOLUTION, RPM
from rig.window.plot.plots import LabPlot
from rig.window.run.live_view import (
    MILLI,
    WAYS,
    LiveContext,
    SegmentView,
    torque_channel,
    way_of,
)
from rig.window.shell.session import WindowSession

COUNTED = ("hold", "bracket")
_PREDICTED = "predicted"


class TorquePoints(SegmentView):
    """Running torque over input speed, one point per hold and direction, over the curve of the parameter set."""

    wanted = ("input_angle",)

    def __init__(self, session: WindowSession, context: LiveContext) -> None:
        mounted = context.recording.metadata.gear_mounted
        subject = "motor + gear" if mounted else "motor alone"
        self.plot = LabPlot(
            session, "Running torque", "input speed [r/min]", f"running torque, {subject} [mN m]"
        )
        self.plot.item.setLogMode(x=True)
        self._channel = torque_channel(context.recording)
        self._points: dict[tuple[int, str], list[tuple[float, float]]] = defaultdict(list)
        self._curves = {
            way: self.plot.curve(name, k, "points") for k, (way, name) in enumerate(WAYS)
        }
        self._mean = self.plot.curve("half-difference", 2)
        self._predict(context, mounted)
        self._changed, self._work = False, context.work

    @property
    def points(self) -> int:
        """How many points there are."""
        return sum(map(len, self._points.values()))

    def _predict(self, context: LiveContext, mounted: bool) -> None:
        """The curve of the parameter sets of gear and motor, drawn in advance over the speeds that are planned."""
        seen, planned = context.prediction, context.planned
        if seen is not None and len(seen.curve_speed):
            low, high = seen.curve.low / MILLI, seen.curve.high / MILLI
            self.plot.add_series(
                _PREDICTED,
                seen.curve_speed / RPM,
                seen.curve.value / MILLI,
                "band",
                group=3,
                low=low,
                high=high,
                logs=(True, False),
            )
            return
        if planned is None:
            return
        planned_speeds = [abs(step.speed) for step in planned.steps if step.speed]
        if not planned_speeds:
            return
        speed = np.geomspace(max(min(planned_speeds), 0.01), max(planned_speeds), 200)
        torque = planned.motor.coulomb_friction + planned.motor.viscous_friction * speed
        if mounted:
            torque = torque + friction_torque(planned.gear, speed)
        self.plot.curve(_PREDICTED, 3, "dashed").item.setData(speed / RPM, torque / MILLI)

    def ended(self, segment: Segment, recording: Recording) -> None:
        """A hold has ended: its running torque, over whole input revolutions."""
        if segment.label in COUNTED and recording.has(self._channel):
            self._work.put(partial(self._measured, segment, recording), self._keep)

    def _measured(self, segment: Segment, recording: Recording) -> list[RunningTorque]:
        try:
            holds, _ = measured_holds(
                recording, (segment,), torque_zero(recording, self._channel), self._channel
            )
        except (ExperimentError, ModelError):
            return []
        return [hold.torque for hold in holds]

    def _keep(self, torques: list[RunningTorque]) -> None:
        for torque in torques:
            if math.isfinite(torque.torque) and torque.speed:
                way = way_of(torque.speed)
                self._points[way, "all"].append((abs(torque.speed), way * torque.torque))
                self._changed = True

    def draw(self, recent: bool) -> None:
        """Bring the points up to date."""
        if not self._changed:
            return
        self._changed = False
        both: list[dict[float, float]] = []
        for way, curve in self._curves.items():
            points = np.array(self._points[way, "all"]).reshape(-1, 2)
            curve.item.setData(points[:, 0] / RPM, points[:, 1] / MILLI)
            groups = defaultdict(list)
            for speed, torque in points.tolist():
                groups[float(f"{speed:.2g}")].append(torque)
            both.append({speed: float(np.mean(values)) for speed, values in groups.items()})
        shared = sorted(both[0].keys() & both[1].keys())
        if len(shared) > 1:
            mean = np.array([0.5 * (both[0][speed] + both[1][speed]) for speed in shared])
            self._mean.item.setData(np.array(shared) / RPM, mean / MILLI)
        self.plot.set_title(f"Running torque, {self.points} points")


class StartingPoints(SegmentView):
    """No-load starting torque over the wave-generator position, one point per ramp: the torque at
    which it began to turn.
    """

    wanted = ("input_angle",)

    def __init__(self, session: WindowSession, context: LiveContext) -> None:
        self.plot = LabPlot(
            session,
            "Starting torque",
            "wave-generator angle [deg]",
            "starting torque, motor + gear [mN m]",
        )
        self.plot.item.setXRange(0.0, 360.0)
        self._channel = torque_channel(context.recording)
        self._points: dict[int, list[tuple[float, float]]] = {1: [], -1: []}
        self._curves = {
            way: self.plot.curve(name, k, "points") for k, (way, name) in enumerate(WAYS)
        }
        self._drawn = 0

    @property
    def points(self) -> int:
        """How many points there are."""
        return sum(map(len, self._points.values()))

    def ended(self, segment: Segment, recording: Recording) -> None:
        """A ramp has ended in motion: the largest torque of it, the noise averaged out."""
        if (
            segment.label != "torque-ramp"
            or not recording.has(self._channel)
            or segment.stop - segment.start < 20
        ):
            return
        torque = recording.si(self._channel, segment)
        torque = torque - torque_zero(recording, self._channel).at(recording.time(segment))
        smooth = np.convolve(segment.direction * torque, np.full(10, 0.1), "valid")
        self._points[way_of(segment.direction)].append(
            (segment.setpoint % REVOLUTION, float(smooth.max()))
        )

    def draw(self, recent: bool) -> None:
        """Bring the points up to date."""
        if self._drawn == self.points:
            return
        self._drawn = self.points
        for way, curve in self._curves.items():
            points = np.array(self._points[way]).reshape(-1, 2)
            curve.item.setData(points[:, 0] / DEGREE, points[:, 1] / MILLI)
