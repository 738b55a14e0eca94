"""A gear wears at rates of its own: each within its law, all told by the truth, none told to plan or analysis."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from drivers import channel as names
from model.linear import dynamic_parameters
from model.units import ARCMIN
from sim_backend.direct import SimulatedRig
from sim_backend.imperfections import Imperfections
from sim_backend.population import drawn
from sim_backend.wear import Wear
from sim_backend.world import LONGEST_WEAR, World
from tests.sim_backend.rigs import GEAR, MOTOR, si, turn

SEEDS = 300
LAWS = {
    "coulomb_rate": (-0.20, 0.30, False),
    "stribeck_velocity_rate": (-0.20, 0.20, False),
    "order_2_rate": (0.02, 0.50, True),
    "stiffness_rate": (-0.01, -0.15, True),
    "backlash_rate": (0.05 * ARCMIN, 0.5 * ARCMIN, True),
}


def world(hours: float, seed: int = 3, day: int = 1) -> World:
    return World(gear_seed=seed, bench_seed=4, hours=hours, day=day)


@pytest.mark.parametrize("name", LAWS)
def test_a_rate_fills_its_range(name: str) -> None:
    low, high, logarithmic = LAWS[name]
    rates = np.array([getattr(Wear.of(world(0.0, s)), name) for s in range(SEEDS)])
    scale = (lambda x: np.log(np.abs(x))) if logarithmic else np.asarray
    share = np.sort((scale(rates) - scale(low)) / (scale(high) - scale(low)))
    assert share[0] >= 0.0
    assert share[-1] <= 1.0
    assert np.max(np.abs(share - (np.arange(SEEDS) + 0.5) / SEEDS)) < 2.0 / math.sqrt(SEEDS)
    assert Wear.of(world(500.0, 5, day=9)) == dataclasses.replace(
        Wear.of(world(0.0, 5)), hours=500.0
    )


def test_hours_change_what_wears_by_its_rate_and_nothing_else() -> None:
    wear = Wear.of(world(1000.0))
    worn = wear.worn(GEAR)
    old, new = GEAR.mesh_friction, worn.mesh_friction
    assert new.coulomb == pytest.approx(old.coulomb * (1.0 + wear.coulomb_rate))
    assert new.static / new.coulomb == pytest.approx(old.static / old.coulomb)
    assert new.stribeck_velocity == pytest.approx(
        old.stribeck_velocity * (1.0 + wear.stribeck_velocity_rate)
    )
    assert (new.viscous, new.shape) == (old.viscous, old.shape)
    softer = (
        dynamic_parameters(worn).combined_stiffness / dynamic_parameters(GEAR).combined_stiffness
    )
    assert softer == pytest.approx(1.0 + wear.stiffness_rate)
    for before, after in zip(GEAR.kinematic_error, worn.kinematic_error, strict=True):
        grown = 1.0 + wear.order_2_rate if before.order == 2.0 else 1.0
        assert after.amplitude == pytest.approx(grown * before.amplitude)
    assert wear.backlash == wear.backlash_rate
    assert Wear.of(world(0.0)).worn(GEAR) is GEAR
    later = Wear.of(world(2000.0))
    assert later.factor(later.coulomb_rate) - 1.0 == pytest.approx(2.0 * wear.coulomb_rate)


def test_no_gear_wears_out_within_the_hours_that_are_allowed() -> None:
    for population in ("narrow", "wide"):
        for seed in range(60):
            end = World(
                gear_seed=seed,
                bench_seed=4,
                hours=LONGEST_WEAR,
                population=population,  # type: ignore[arg-type]
            )
            Wear.of(end).worn(drawn(GEAR, MOTOR, end).gear)


def opened(hours: float, on: Imperfections) -> SimulatedRig:
    port = SimulatedRig(GEAR, MOTOR, on, world(hours))
    port.open()
    return port


def test_the_truth_is_of_the_gear_as_it_is_and_names_what_made_it_so() -> None:
    new, worn = (opened(hours, Imperfections()).truth for hours in (0.0, 1000.0))
    rates = Wear.of(world(1000.0))
    assert worn["wear"]["hours"] == 1000.0
    assert worn["wear"]["backlash"] == rates.backlash == worn["dynamics"]["spring"]["backlash"]
    assert worn["wear"]["coulomb_rate_per_1000_hours"] == rates.coulomb_rate
    ratio = worn["friction"]["coulomb"] / new["friction"]["coulomb"]
    assert ratio == pytest.approx(1.0 + rates.coulomb_rate)
    kinks = [truth["dynamics"]["spring"] for truth in (new, worn)]
    steeper = [k["stiffness"] + k["kinks"][0]["stiffer_by"] for k in kinks]
    # K2 and K3 stay: only the first spring wears.
    assert steeper[1] == pytest.approx(steeper[0])
    # The secant at a quarter of T1 over play, spring and hysteresis element.
    told, torsion = worn["dynamics"], worn["dynamics"]["torsion_amplitude"]
    spring, element = told["spring"], told["hysteresis"]
    beside = element["torque"] * math.tanh(element["stiffness"] * torsion / element["torque"])
    torque = spring["stiffness"] * (torsion - 0.5 * spring["backlash"]) + beside
    assert torque == pytest.approx(told["torque_amplitude"])
    assert told["stiffness"] < new["dynamics"]["stiffness"]
    assert opened(1000.0, Imperfections().without("wear")).truth["wear"] == {}


def test_backlash_is_what_the_output_lies_behind_more_after_a_reversal() -> None:
    """The bench's bearing holds the output back by the whole play each way; dry friction winds it up as before."""
    on = Imperfections.none()
    on = dataclasses.replace(on, wear=True, output_bearing_friction=True)
    bare = dataclasses.replace(GEAR, kinematic_error=())
    lost = []
    for hours in (0.0, 1000.0):
        port = SimulatedRig(bare, MOTOR, on, world(hours))
        port.open()
        means = []
        for speed in (60.0, -60.0):
            turn(port, speed, 1500)
            block = turn(port, speed, 1000)
            angles = (si(port, block, n) for n in (names.OUTPUT_ANGLE, names.INPUT_ANGLE))
            output, ideal = angles
            means.append(np.mean(-output - ideal / GEAR.ratio))
        lost.append(abs(means[1] - means[0]))
    wear = Wear.of(world(1000.0))
    bearing = 2.0 * port.truth["friction"]["output_bearing_coulomb"]
    soft = dynamic_parameters(GEAR).combined_stiffness
    more = bearing / soft * (1.0 / (1.0 + wear.stiffness_rate) - 1.0)
    assert lost[1] - lost[0] == pytest.approx(wear.backlash + more, rel=0.02)
