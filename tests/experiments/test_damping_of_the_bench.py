"""What the bench's output bearing damps is taken off the damping of the gear, with the doubt of its card."""

from __future__ import annotations

import dataclasses
import math

import pytest

from experiments.assumed import OUTPUT_INERTIA
from experiments.load import Load, load_of
from experiments.protocols.friction.bearing import UNKNOWN, VISCOUS, OutputBearing
from experiments.protocols.velocity_steps.bearing import BY_LOAD, without_bearing
from experiments.recording import Recording
from model.gear import HarmonicDrive, Origin
from model.identify.estimate import BudgetLine, Estimate

INERTIA, FREQUENCY = 0.1, 110.0
PER_VISCOUS = 0.5 / (INERTIA * 2.0 * math.pi * FREQUENCY)


def estimate(name: str, value: float, half: float) -> Estimate:
    return Estimate(
        name=name,
        value=value,
        unit="1",
        low=value - half,
        high=value + half,
        identifiable="yes",
        budget=(BudgetLine("noise", "A", 0.5 * half),),
    )


ESTIMATES = {
    e.name: e
    for e in (
        estimate("damping_ratio", 0.021, 0.002),
        estimate("frequency", FREQUENCY, 0.5),
        estimate("damping_ratio_forward", 0.022, 0.002),
        estimate("frequency_forward", FREQUENCY, 0.5),
        estimate("damping_ratio_reverse", 0.022, 0.002),
    )
}


def test_a_bearing_that_is_known_is_taken_off_with_its_doubt() -> None:
    bearing = OutputBearing(
        coulomb=0.5, coulomb_uncertainty=0.06, viscous=0.4, viscous_uncertainty=0.05, source="card"
    )
    changed, off = without_bearing(ESTIMATES, bearing, Load(inertia=INERTIA))
    assert off == pytest.approx(0.4 * PER_VISCOUS)
    for name in ("damping_ratio", "damping_ratio_forward"):
        before, after = ESTIMATES[name], changed[name]
        assert after.value == pytest.approx(before.value - off)
        assert after.high - after.low == pytest.approx(before.high - before.low)
        line = after.budget[-1]
        assert (line.source, line.kind) == (VISCOUS, "B")
        assert line.standard_uncertainty == pytest.approx(0.05 * PER_VISCOUS)
        assert after.expanded_uncertainty > before.expanded_uncertainty
    # A direction without a frequency of its own has nothing to go by.
    assert changed["damping_ratio_reverse"] is ESTIMATES["damping_ratio_reverse"]
    assert changed["frequency"] is ESTIMATES["frequency"]


def test_a_bearing_of_which_nothing_viscous_is_known_changes_nothing() -> None:
    changed, off = without_bearing(ESTIMATES, UNKNOWN, Load(inertia=INERTIA))
    assert off == 0.0
    assert changed["damping_ratio"].value == ESTIMATES["damping_ratio"].value
    assert changed["damping_ratio"].budget == ESTIMATES["damping_ratio"].budget


def test_the_load_of_another_gear_takes_nothing_off_and_is_a_doubt() -> None:
    bearing = OutputBearing(
        coulomb=0.5, coulomb_uncertainty=0.06, viscous=0.4, viscous_uncertainty=0.05, source="card"
    )
    whole = 0.4 * PER_VISCOUS
    nobodys = Load(inertia=INERTIA, is_stated=False)
    changed, off = without_bearing(ESTIMATES, bearing, nobodys)
    assert off == 0.0
    assert changed["damping_ratio"].value == ESTIMATES["damping_ratio"].value
    line = next(b for b in changed["damping_ratio"].budget if b.source == BY_LOAD)
    assert line.standard_uncertainty == pytest.approx(2.0 * whole / math.sqrt(3.0))
    assert line.assumed == OUTPUT_INERTIA.kind
    # Where it is stated, its own doubt is in what is taken off.
    stated = Load(inertia=INERTIA, relative_uncertainty=0.1)
    changed, off = without_bearing(ESTIMATES, bearing, stated)
    line = next(b for b in changed["damping_ratio"].budget if b.source == BY_LOAD)
    assert (off, line.standard_uncertainty) == (pytest.approx(whole), pytest.approx(0.1 * whole))
    assert line.assumed == ""


def test_an_inertia_of_the_shipped_set_is_stated_only_where_it_was_simulated(
    gear: HarmonicDrive, friction_run: Recording
) -> None:
    def load(origin: str, whose: HarmonicDrive) -> Load:
        metadata = dataclasses.replace(friction_run.metadata, origin=origin, process={})
        return load_of(dataclasses.replace(friction_run, metadata=metadata), whose)

    own = gear.with_values({"inertia.output": 0.2}, Origin("measured", "its card", 0.01))
    assert not load("hardware", gear).is_stated
    assert load("simulated", gear).is_stated
    known = load("hardware", own)
    assert (known.inertia, known.is_stated) == (0.2, True)
    assert known.relative_uncertainty == pytest.approx(0.05)
