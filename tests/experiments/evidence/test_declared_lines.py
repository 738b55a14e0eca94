"""What a protocol declares of its channels is what happens to its numbers where the channels are wrong.

Scale, zero and delay of every channel that a protocol reads are moved by their standard uncertainty, and the recording
is analysed again. The change of a number is the line that its budget has, or that its quantity declares. The curve of
an encoder is none of these: an accuracy class bounds a curve whose orders nobody knows.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from experiments import catalogue
from experiments.contract import Evidence, Experiment
from experiments.evidence.channel_doubt import Doubt, Part, doubts_of
from experiments.evidence.channel_lines import (
    changes_of,
    channels_of,
    declared_change,
    lines_that_speak_of,
)
from experiments.evidence.holds import Recorded
from experiments.evidence.moved import Noting, moved
from experiments.evidence.table import checks_of
from experiments.protocols.motor_tare import analysis as motor_tare
from experiments.protocols.velocity_steps import analysis as velocity_steps
from experiments.recording import Recording
from experiments.result import Result
from model.gear import HarmonicDrive
from model.identify.estimate import Estimate
from model.motor import shipped_motor
from rig.bench.backends.order import Order
from rig.run.start import run_order
from rig.runfile.read import open_run
from tests.experiments.synthetic import Bench, record

CLOSE = 0.1
"""Share of itself to which a line is right."""
SMALL = 0.1
"""Share of u below which what a line misses is nothing: U is right to half a hundredth without it."""
TESTED = (Part.SCALE, Part.OFFSET, Part.ZERO, Part.DELAY)
FIRST = ("input_angle", Part.DELAY)
"""A delay is one beside another channel: beside the input, whose time is that of the recording."""

NOISE_OF_THE_ZEROS = "its line is of the zeros as read: their noise and what moved between them"
LAG_OF_THE_PORT = "its line is of a lag of 2 ms, of filters and settling: more than half a cycle"
WIND_UP_AND_SKEW = (
    "skew times speed is part of what is meant; one speed cannot tell it from the wind-up: weakly"
)
A_WHOLE_ROW = "moved by a whole row, twice as far as the torque may be late: there the fitted lag takes up less"
SENT = "the program knows at which SYNC a set-point that it sent acts; what the drive makes of it is in the numbers"
EXCEPTIONS: dict[tuple[str, str, str, Part], str] = {
    ("compensated-error", "proof_ratio", "target_speed", Part.DELAY): SENT,
    ("compensated-error", "remainder", "target_speed", Part.DELAY): SENT,
    ("torque-scale", "torque_lag", "torque", Part.DELAY): "a delay of the torque is what is meant",
    (
        "torque-scale",
        "shown_inertia",
        "torque",
        Part.DELAY,
    ): "friction that changes along a ramp: the same with every disc, so that the gain does not have it",
    **{
        (kind, "offset", "torque", part): NOISE_OF_THE_ZEROS
        for kind in ("friction", "motor-tare")
        for part in (Part.ZERO, Part.OFFSET)
    },
    **{
        ("kinematic-error", f"figure_16_{name}", "torque", Part.DELAY): LAG_OF_THE_PORT
        for name in ("conservative_amplitude", "friction_amplitude")
    },
    **{
        ("velocity-steps", name, "torque", Part.DELAY): A_WHOLE_ROW
        for name in ("output_inertia", "output_stiffness")
    },
    ("kinematic-error", "lost_motion", "output_angle", Part.DELAY): WIND_UP_AND_SKEW,
}
"""Kind, quantity, channel and way of being wrong of every line that is not the change, with the physical reason."""


@pytest.fixture
def small(
    request: pytest.FixtureRequest, bench: Bench, gear: HarmonicDrive
) -> Callable[[str], Recording]:
    """A small recording of each protocol."""

    def recording(kind: str) -> Recording:
        if kind == "kinematic-error":
            return request.getfixturevalue("kinematic_error_run")
        if kind == "motor-tare":
            return request.getfixturevalue("tare_run")
        if kind == "compensated-error":
            return request.getfixturevalue("compensated_error_run")
        if kind == "torque-scale":
            return request.getfixturevalue("torque_scale_run")
        if kind == "velocity-steps":
            return ringing(gear, request.getfixturevalue("tmp_path"))
        protocol = catalogue.load(kind)
        parameters = protocol.parameters(**SMALLER[kind])
        given = dataclasses.asdict(parameters)
        return record(protocol.plan(parameters, gear), bench, kind, parameters=given)

    return recording


def ringing(gear: HarmonicDrive, folder: Path) -> Recording:
    """Steps of the simulated rig, whose torque port shows what accelerates rotor and output."""
    values = {"speeds_rpm": (600.0, 1800.0), "repeats": 1}
    motor, named = shipped_motor(), "velocity-steps"
    asked = Order(
        protocol=named,
        gear=gear,
        motor=motor,
        folder=folder,
        values=values,
        serial="A",
        seed=5,
    )
    return open_run(run_order(asked).path)


SMALLER: dict[str, dict[str, Any]] = {
    "friction": {"lowest_rpm": 4.0, "points": 6, "up_and_down": False},
    "warm-up": {"window": 2.0, "at_most": 60.0},
    "starting-torque": {"positions": 2},
    "home": {"input_speed_rpm": 30.0, "output_speed_rpm": 120.0},
}


class Tried:
    """A recording that is analysed as its protocol, as it is and with channels that are wrong."""

    def __init__(self, kind: str, recording: Recording, evidence: Evidence) -> None:
        self.experiment: Experiment = import_module(catalogue.entry(kind).module).EXPERIMENT
        self.recorded = Recorded(recording, self.experiment, evidence)
        self.evidence = checks_of(self.recorded)
        noting = Noting(recording.source)
        self.result: Result = self.experiment.analyse(
            dataclasses.replace(recording, source=noting), self.evidence
        )
        self.channels = tuple(noting.names)

    def doubts(self) -> list[Doubt]:
        """All that is tried of the channels that were read."""
        every = [d for name in self.channels for d in doubts_of(self.recorded, name)]
        return [d for d in every if d.part in TESTED and (d.channel, d.part) != FIRST]

    def told(self, estimate: Estimate, doubt: Doubt) -> float:
        """What the budget or the declaration says that the doubt does to a number."""
        own = lines_that_speak_of(estimate, doubt)
        if own:
            return math.hypot(*(line.standard_uncertainty for line in own))
        recording = self.recorded.recording
        how = dict(channels_of(self.result, estimate.name, recording)).get(doubt.channel)
        if how is None:
            return 0.0
        is_alike = recording.signals[doubt.channel].unit == estimate.unit
        return abs(declared_change(how, estimate.value, doubt, is_alike=is_alike))

    def changes(self, doubt: Doubt) -> dict[str, float]:
        """What it does. A tare was shown by the same port: a scale that is wrong is wrong in both."""
        evidence = self.evidence
        if doubt.part is Part.SCALE and evidence.tare_recording is not None:
            other = moved(evidence.tare_recording, doubt.channel, doubt.part, doubt.size)
            tare = motor_tare.analyse(other.recording, Evidence(evidence.gear))
            evidence = dataclasses.replace(evidence, tare=tare, tare_recording=other.recording)
        analyse = self.experiment.analyse
        return dict(changes_of(analyse, self.recorded, evidence, doubt, self.result))

    def wrong(self) -> dict[tuple[str, str, str, Part], str]:
        """Every line that is not the change of its number."""
        wrong: dict[tuple[str, str, str, Part], str] = {}
        for doubt in self.doubts():
            changes = self.changes(doubt)
            for name, estimate in self.result.estimates.items():
                told, change = self.told(estimate, doubt), abs(changes[name])
                allowed = max(
                    CLOSE * max(told, change), SMALL * estimate.standard_uncertainty, 1e-12
                )
                if abs(told - change) > allowed:
                    quantity = self.result.quantity(name).name
                    place = (self.experiment.name, quantity, doubt.channel, doubt.part)
                    u = estimate.standard_uncertainty
                    said = f"the budget says {told:.3g}, it changes by {change:.3g}, u {u:.3g}"
                    wrong[place] = f"{name}: {said}"
        return wrong


@pytest.mark.parametrize("kind", catalogue.names())
def test_the_declared_line_is_the_change(
    kind: str,
    small: Callable[[str], Recording],
    request: pytest.FixtureRequest,
    gear: HarmonicDrive,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    evidence = Evidence(gear)
    if catalogue.load(kind).takes_tare:
        tare, run = request.getfixturevalue("tare"), request.getfixturevalue("tare_run")
        evidence = Evidence(gear, tare, tare_recording=run)
    if kind == "velocity-steps":
        monkeypatch.setattr(velocity_steps, "fit_ladder", once(velocity_steps.fit_ladder))
    tried = Tried(kind, small(kind), evidence)
    # What `home` reads are counts at the marks: they have no scale, no zero and no delay.
    assert bool(tried.doubts()) == (kind != "home")
    wrong = tried.wrong()
    beside = [f"{place}: {text}" for place, text in wrong.items() if place not in EXCEPTIONS]
    assert beside == [], "\n".join(beside)
    needless = [place for place in EXCEPTIONS if place[0] == kind and place not in wrong]
    assert needless == []


def once(fit: Callable[..., Any]) -> Callable[..., Any]:
    """The fit of the angles of steps, made once for the same angles: a torque that is wrong does not change them."""
    known: dict[bytes, Any] = {}

    def remembered(data: Any, *rest: Any, **named: Any) -> Any:
        key = b"".join(step.input_angle.tobytes() + step.output_angle.tobytes() for step in data)
        if key not in known:
            known[key] = fit(data, *rest, **named)
        return known[key]

    return remembered


def test_a_half_sum_without_a_zero_says_so(tare_run: Recording, gear: HarmonicDrive) -> None:
    holds = tuple(s for s in tare_run.segments if not s.label.startswith("torque-zero"))
    offset = motor_tare.analyse(
        dataclasses.replace(tare_run, segments=holds), Evidence(gear)
    ).estimates["offset"]
    (line,) = [line for line in offset.budget if line.source == "torque zero"]
    assert line.assumed == "torque zero"
    assert line.standard_uncertainty > 50.0 * offset.budget[0].standard_uncertainty
