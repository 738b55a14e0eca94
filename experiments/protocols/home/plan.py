"""Home: what a run does."""

from __future__ import annotations

from collections.abc import Iterator

from experiments.planning.parts import between_zeros, checked, longest, output_travel, ramp, stop
from experiments.planning.speeds import refuse_speed
from experiments.protocols.home.declaration import NAME, Parameters
from experiments.steps.vocabulary import FindIndex, SegmentLabel, Step
from model.gear import HarmonicDrive
from model.units import RPM


def plan(parameters: Parameters, gear: HarmonicDrive) -> Iterator[Step]:
    """Torque zero; the input mark, then the output mark, each passed forward only; torque zero."""
    checked(parameters, Parameters, NAME)
    for name in ("input_speed_rpm", "output_speed_rpm"):
        refuse_speed(getattr(parameters, name), gear, f"{NAME}.{name}")
    turn = output_travel(gear, parameters.mounting, 1.0, NAME)
    return between_zeros(_marks(parameters, turn), parameters.zero_time)


def _marks(p: Parameters, output_turn: float) -> Iterator[Step]:
    """Every pass goes on from where the last one ended: a whole revolution ahead the mark comes
    again, from the same side.
    """
    searches = (
        ("input", p.input_speed_rpm, 1.0, p.input_passes),
        ("output", p.output_speed_rpm, output_turn, p.output_passes),
    )
    for which, rpm, turns, passes in searches:
        speed = rpm * RPM
        for repeat in range(passes):
            yield ramp(speed, p.acceleration, 1)
            label = SegmentLabel(f"home-{which}", speed, 1, repeat)
            yield FindIndex(which, speed, longest(1.05 * turns, speed), label)
            yield stop(p.acceleration)
