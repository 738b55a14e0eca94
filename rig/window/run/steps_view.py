"""Velocity steps as they end: the output's speed over the model's prediction, and what is left between them.

The prediction is equation 2 with the measured input and the parameter set of the run, nothing
fitted: what `rig validate --against` scores. Its kinematic error is the set's where that was identified, else
it comes from the run's own slow steps so far.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import partial

import numpy as np

from experiments.angle.certified import certified_angles
from experiments.angle.phase_reference import phase_reference
from experiments.errors import ExperimentError
from experiments.evidence import rotary_ratio
from experiments.planning.speeds import first_resonances
from experiments.protocols.velocity_steps.data import (
    SLOW,
    carries,
    recorded_steps,
    simulated_output,
)
from experiments.recording import Recording, Segment
from model.errors import ModelError
from model.gear import HarmonicDrive
from model.identify.step_data import StepScore, score_step
from model.units import REVOLUTION, RPM
from rig.window.plot.plots import LabPlot
from rig.window.run.live_view import WAYS, LiveContext, SegmentView, way_of
from rig.window.shell.session import WindowSession

SHOWN = 0.6
"""s of a step that are shown at least: the rise and the ring-down."""
_SHOWN_REVOLUTIONS = 3.0


@dataclass(frozen=True)
class _Scored:
    """A step that was held against its prediction: its number in the run, its score, or why there is none."""

    number: int
    segment: Segment
    score: StepScore | None
    problem: str = ""


class StepView(SegmentView):
    """The latest step: output speed measured, predicted, and of a rigid gear. Feeds the residual's plot as well."""

    wanted = ("input_angle", "output_angle")

    def __init__(self, session: WindowSession, context: LiveContext) -> None:
        self.plot = LabPlot(
            session, "Step response", "time since the step [s]", "output speed [r/min]"
        )
        self.residual = _ResidualView(session)
        self._rigid = self.plot.curve("rigid gear", 2, "dotted", dense=True)
        self._measured = self.plot.curve("measured", 0, dense=True)
        self._predicted = self.plot.curve("predicted", 1, "dashed", dense=True)
        self._slow: list[Segment] = []
        """Slow steps so far; the thread of the work alone writes and reads them."""
        self._rests: list[Segment] = []
        self._work = context.work
        self.steps = 0
        self.problem = ""
        self._latest: _Scored | None = None

    def ended(self, segment: Segment, recording: Recording) -> None:
        """A step has ended: predict its output from its measured input and score it."""
        if segment.label == "rest":
            self._rests.append(segment)
        if segment.label != "step" or recording.metadata.gear is None:
            return
        self.steps += 1
        rests = tuple(self._rests[-8:])
        self._work.put(
            partial(
                self._worked_out, self.steps, segment, rests, recording, recording.metadata.gear
            ),
            self._keep,
        )

    def _worked_out(
        self,
        number: int,
        segment: Segment,
        rests: tuple[Segment, ...],
        recording: Recording,
        gear: HarmonicDrive,
    ) -> _Scored:
        try:
            score = self._score(segment, (*self._slow, *rests, segment), recording, gear)
        except (ExperimentError, ModelError) as error:
            return _Scored(number, segment, None, str(error))
        if abs(segment.setpoint) <= SLOW:
            self._slow.append(segment)
        return _Scored(number, segment, score)

    def _keep(self, scored: _Scored) -> None:
        self.problem = scored.problem or self.problem
        if scored.score is not None:
            self._latest = scored
            self.residual.add(scored.segment, scored.score)

    def _score(
        self,
        segment: Segment,
        chosen: tuple[Segment, ...],
        recording: Recording,
        gear: HarmonicDrive,
    ) -> StepScore | None:
        one = dataclasses.replace(recording, segments=tuple(sorted(chosen, key=lambda s: s.start)))
        reference = phase_reference(recording)
        ratio = rotary_ratio(recording, gear.mounted_ratio(recording.metadata.mounting))
        source = gear if carries(gear, reference) else None
        certified, _ = certified_angles(one)
        steps, _, _ = recorded_steps(
            one,
            ratio=ratio,
            reference=reference,
            zero=None,
            source=source,
            resonance=first_resonances(gear)[-1],
            certified=certified,
        )
        scored = next((step for step in steps if step.segment.index == segment.index), None)
        if scored is None:
            return None
        driven = dataclasses.replace(gear, kinematic_error=scored.data.kinematic_error)
        return score_step(scored.data, simulated_output(scored, driven))

    def draw(self, recent: bool) -> None:
        """Show the latest step."""
        latest, self._latest = self._latest, None
        if latest is None or latest.score is None:
            return
        segment, score = latest.segment, latest.score
        shown = score.time <= max(
            SHOWN, _SHOWN_REVOLUTIONS * REVOLUTION / max(abs(segment.setpoint), 1.0)
        )
        x = score.time[shown]
        self._measured.item.setData(x, score.measured_speed[shown] / RPM)
        self._predicted.item.setData(x, score.predicted_speed[shown] / RPM)
        self._rigid.item.setData(x, score.rigid_speed[shown] / RPM)
        way = dict(WAYS)[way_of(segment.setpoint)]
        speed = abs(segment.setpoint) / RPM
        self.plot.set_title(
            f"Step {latest.number}: {speed:.4g} r/min {way}, skill {score.metrics['skill_speed']:.2f}"
        )
        self.residual.show(segment, score, shown)


class _ResidualView:
    """What the prediction of the latest step leaves: measured minus predicted output speed."""

    def __init__(self, session: WindowSession) -> None:
        self.plot = LabPlot(
            session, "Residual of the step", "time since the step [s]", "residual [r/min]"
        )
        self._rigid = self.plot.curve("of a rigid gear", 2, "dotted", dense=True)
        self._residual = self.plot.curve("measured - predicted", 0, dense=True)
        self.skills: list[tuple[float, float]] = []

    def add(self, segment: Segment, score: StepScore) -> None:
        """Keep the skill of a step."""
        self.skills.append((segment.setpoint, score.metrics["skill_speed"]))

    def show(self, segment: Segment, score: StepScore, shown: np.ndarray) -> None:
        """Draw the residual of a step."""
        x = score.time[shown]
        self._residual.item.setData(x, (score.measured_speed - score.predicted_speed)[shown] / RPM)
        self._rigid.item.setData(x, (score.measured_speed - score.rigid_speed)[shown] / RPM)
