"""Speed against set-point and encoders against ratio: what a part of a turn leaves open is told from what is wrong."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from experiments import catalogue
from experiments.contract import Evidence
from experiments.evidence.holds import Recorded
from experiments.evidence.motion import encoders_against_ratio, speed_against_set_point
from experiments.protocols.home import declaration as home_declaration
from experiments.protocols.home import plan as home_plan
from experiments.recording import ArraySource, Recording
from model.gear import HarmonicDrive
from model.units import REVOLUTION
from tests.experiments.synthetic import Bench, record

RIPPLE = 0.05
"""Share of the speed, once per input revolution."""


def passes(bench: Bench, gear: HarmonicDrive, scale: float) -> Recording:
    """The two half turns of an input pass that ripple the most, with an input encoder that counts `scale` times."""
    parameters = home_declaration.Parameters(input_speed_rpm=6.0, output_speed_rpm=120.0)
    run = record(home_plan.plan(parameters, gear), bench, "home")
    source = run.source
    assert isinstance(source, ArraySource)
    quantum = run.signals["input_angle"].quantum
    counts = source.arrays["input_angle"]
    angle = counts * quantum
    rippled = scale * (angle + RIPPLE * np.sin(angle)) / quantum
    arrays = {**source.arrays, "input_angle": np.rint(rippled).astype(counts.dtype)}
    segment = run.labelled("home-input")[1]
    turn = angle[segment.start : segment.stop] - angle[segment.start]
    half = segment.start + int(np.searchsorted(turn, 0.5 * REVOLUTION))
    parts = tuple(
        dataclasses.replace(segment, label="hold", start=start, stop=stop)
        for start, stop in ((segment.start, half), (half, segment.stop))
    )
    return dataclasses.replace(
        run, source=dataclasses.replace(source, arrays=arrays), segments=parts
    )


@pytest.mark.parametrize(
    ("scale", "severity"), [(1.0, "passed"), (1.15, "blocks"), (0.5, "blocks")]
)
def test_ripple_over_half_a_turn_is_told_from_a_wrong_scale(
    scale: float, severity: str, bench: Bench, gear: HarmonicDrive
) -> None:
    recorded = Recorded(passes(bench, gear, scale), catalogue.load("home"), Evidence(gear))
    speeds = [hold.speed / hold.segment.setpoint / scale for hold in recorded.turning]
    if scale == 1.0:
        # More than the loop's own part in fifty.
        assert max(abs(np.array(speeds) - 1.0)) > 0.025
    assert speed_against_set_point(recorded).severity == severity


def part_of_a_pass(bench: Bench, gear: HarmonicDrive, error: float, turns: float) -> Recording:
    """So many turns of an output pass, with an error of the output twice per input revolution that has its least value
    where they begin, and its largest where a quarter of a turn is left over.
    """
    run = record(
        home_plan.plan(home_declaration.Parameters(output_speed_rpm=120.0), gear), bench, "home"
    )
    source = run.source
    assert isinstance(source, ArraySource)
    (segment,) = run.labelled("home-output")
    angle = source.arrays["input_angle"] * run.signals["input_angle"].quantum
    begin = segment.start + 200
    turned = angle - angle[begin]
    waves = -error * np.cos(2.0 * turned) / run.signals["output_angle"].quantum
    counts = source.arrays["output_angle"]
    arrays = {**source.arrays, "output_angle": counts + np.rint(waves).astype(counts.dtype)}
    stop = begin + int(np.searchsorted(turned[begin : segment.stop], turns * REVOLUTION))
    part = dataclasses.replace(segment, label="hold", start=begin, stop=stop)
    return dataclasses.replace(
        run, source=dataclasses.replace(source, arrays=arrays), segments=(part,)
    )


@pytest.mark.parametrize(
    ("turns", "off", "severity"),
    [(1.75, 0.0, "passed"), (1.75, 1.0, "blocks"), (0.75, 0.0, "not looked at")],
)
def test_the_kinematic_error_of_a_short_turn_is_no_other_ratio(
    turns: float, off: float, severity: str, bench: Bench, gear: HarmonicDrive
) -> None:
    run = part_of_a_pass(bench, gear, 6e-4, turns)
    stated = dataclasses.replace(run.metadata, ratio=gear.ratio + off)
    recorded = Recorded(
        dataclasses.replace(run, metadata=stated), catalogue.load("home"), Evidence(gear)
    )
    (hold,) = recorded.turning
    if severity == "passed":
        # From row to row it would be a tooth pair and more.
        assert abs(hold.input_travel / hold.output_travel - gear.ratio) > 1.0
    assert encoders_against_ratio(recorded).severity == severity


def test_a_ratio_that_nobody_stated_is_not_called_stated(bench: Bench, gear: HarmonicDrive) -> None:
    run = part_of_a_pass(bench, gear, 0.0, 1.75)
    # Without a ratio that of the set stands in, here with the mounting of one tooth more.
    others = (
        ("than the one stated", {"ratio": gear.ratio + 1.0}),
        ("nobody states", {"ratio": math.nan, "mounting": "flexspline-fixed"}),
    )
    for said, changes in others:
        metadata = dataclasses.replace(run.metadata, **changes)  # type: ignore[arg-type]
        recording = dataclasses.replace(run, metadata=metadata)
        recorded = Recorded(recording, catalogue.load("home"), Evidence(gear))
        found = encoders_against_ratio(recorded)
        assert found.severity == "blocks"
        assert said in found.follows
