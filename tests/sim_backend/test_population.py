"""What a wide population draws: within its table, independently, again the same, and nothing of it on the card."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Sequence

import numpy as np
import pytest

from drivers.port import Command, Mode
from model.errors import ModelError
from model.gear import Harmonic
from model.linear import dynamic_parameters
from model.units import ARCMIN, ARCSEC
from sim_backend.condition import Sideband, Stated
from sim_backend.direct import SimulatedRig
from sim_backend.imperfections import Imperfections
from sim_backend.individuals import individual_gear, individual_motor
from sim_backend.population import Drawn, drawn
from sim_backend.world import World
from tests.sim_backend.rigs import GEAR, MOTOR, NO_GUARD

SEEDS = range(300)


def world(seed: int, **others: int) -> World:
    return World(population="wide", **{"gear_seed": seed, "bench_seed": 7000 + seed, **others})


@functools.cache
def population() -> tuple[Drawn, ...]:
    return tuple(drawn(GEAR, MOTOR, world(seed)) for seed in SEEDS)


def stated(one: Drawn) -> Stated:
    assert one.sizes.stated is not None
    return one.sizes.stated


def thermal(one: Drawn, name: str) -> float:
    return float(getattr(stated(one).deviations.thermal, name))


def loss(one: Drawn) -> float:
    """Hysteresis loss [arcmin]: the loop of a sliding element is 2 T_h/K wide at zero torque."""
    torque = stated(one).deviations.hysteresis_torque
    return 2.0 * torque / dynamic_parameters(one.gear).combined_stiffness / ARCMIN


def factor(one: Drawn) -> float:
    own, card = dynamic_parameters(one.gear), dynamic_parameters(one.card)
    return own.combined_stiffness / card.combined_stiffness


def amplitude(wave: Sideband) -> float:
    return math.hypot(wave.cosine, wave.sine) / ARCSEC


PLACES = 20_000
"""Even steps of a revolution at which the orders of an encoder are added up."""


def around(series: Sequence[Harmonic]) -> np.ndarray:
    """The sum of whole orders over a revolution, by the inverse transform of their amplitudes."""
    spectrum = np.zeros(PLACES // 2 + 1, dtype=complex)
    for harmonic in series:
        assert harmonic.order == round(harmonic.order)
        spectrum[round(harmonic.order)] += complex(harmonic.cosine, -harmonic.sine)
    return np.fft.irfft(spectrum, PLACES) * (PLACES / 2)


@functools.cache
def widths(place: int, which: str) -> tuple[float, float]:
    """How much an encoder's orders change over its own revolution [arcsec]: all, and those above 8."""
    series = getattr(stated(population()[place]), f"{which}_encoder").series
    slow, fine = (
        around([h for h in series if (h.order > 8.5) == above]) / ARCSEC for above in (False, True)
    )
    return float(np.ptp(slow + fine)), float(np.ptp(fine))


def widths_of(one: Drawn, which: str) -> tuple[float, float]:
    return widths(next(k for k, other in enumerate(population()) if other is one), which)


def half_width(one: Drawn, which: str) -> float:
    return 0.5 * widths_of(one, which)[0]


def fine_share(one: Drawn) -> float:
    whole, fine = widths_of(one, "output")
    return fine / whole


# Entry of the table: what it is of one draw, its bounds, and whether its logarithm is uniform.
TABLE: dict[str, tuple[Callable[[Drawn], float], float, float, bool]] = {
    "J_o": (lambda d: d.gear.inertia.output, 0.02, 1.0, True),
    "F_c": (lambda d: d.gear.mesh_friction.coulomb, 20.0, 150.0, True),
    "F_s/F_c": (
        lambda d: d.gear.mesh_friction.static / d.gear.mesh_friction.coulomb,
        0.9,
        1.8,
        True,
    ),
    "v_s": (lambda d: d.gear.mesh_friction.stribeck_velocity, 0.3, 10.0, False),
    "shape": (lambda d: d.gear.mesh_friction.shape, 0.5, 2.0, False),
    "c_v": (lambda d: d.gear.mesh_friction.viscous, 0.05, 0.6, False),
    "viscous per kelvin": (lambda d: thermal(d, "viscous_per_kelvin"), 0.005, 0.04, False),
    "dry per kelvin": (lambda d: thermal(d, "coulomb_per_kelvin"), 0.0, 0.01, False),
    "stiffness": (factor, 0.6, 1.4, False),
    "K2/K1": (lambda d: d.gear.ratings.stiffness_2 / d.gear.ratings.stiffness_1, 1.2, 2.0, False),
    "K3/K2": (lambda d: d.gear.ratings.stiffness_3 / d.gear.ratings.stiffness_2, 1.0, 1.3, False),
    "hysteresis": (loss, 0.2, 2.0, False),
    "order 2": (lambda d: d.gear.kinematic_error[1].amplitude / ARCSEC, 0.2, 20.0, True),
    "order 5": (lambda d: d.gear.kinematic_error[4].amplitude / ARCSEC, 0.2, 20.0, True),
    "order 3 of the output": (lambda d: amplitude(stated(d).output_orders[2]), 0.2, 3.0, True),
    "sideband": (
        lambda d: amplitude(stated(d).sidebands[3]),
        0.2,
        20.0,
        True,
    ),
    "output encoder": (lambda d: half_width(d, "output"), 2.5, 5.0, False),
    "fine orders of the output encoder": (fine_share, 0.05, 0.2, False),
    "motor encoder": (lambda d: half_width(d, "input"), 15.0, 30.0, False),
    "skew": (lambda d: stated(d).output_encoder.skew, 0.0, 1e-3, False),
    "torque gain": (lambda d: stated(d).torque_port.gain_error, -0.01, 0.01, False),
    "torque zero": (lambda d: stated(d).torque_port.offset, -5e-3, 5e-3, False),
    "torque lag": (lambda d: stated(d).deviations.port_lag, 0.0, 2e-3, False),
    "output bearing": (lambda d: stated(d).deviations.output_coulomb, 0.1, 1.0, False),
    "output bearing per kelvin": (
        lambda d: stated(d).deviations.output_per_kelvin,
        0.0,
        0.01,
        False,
    ),
    "torque constant": (
        lambda d: stated(d).deviations.torque_constant_error,
        -0.02,
        0.02,
        False,
    ),
    "motor coulomb": (lambda d: d.motor.coulomb_friction / MOTOR.coulomb_friction, 0.5, 1.5, False),
    "motor viscous": (lambda d: d.motor.viscous_friction / MOTOR.viscous_friction, 0.5, 1.5, False),
    "rotor": (lambda d: d.motor.rotor_inertia / MOTOR.rotor_inertia, 0.9, 1.1, False),
    "cogging": (
        lambda d: max(h.amplitude for h in stated(d).deviations.cogging),
        0.0,
        5e-3,
        False,
    ),
    "ambient": (lambda d: thermal(d, "ambient"), 15.0, 32.0, False),
}


@functools.cache
def drawn_values(entry: str) -> np.ndarray:
    """All draws of an entry, as the share of its range (uniform between 0 and 1)."""
    of, low, high, logarithmic = TABLE[entry]
    values = np.array([of(one) for one in population()])
    scale = np.log if logarithmic else np.asarray
    return (scale(values) - scale(low)) / (scale(high) - scale(low))


@pytest.mark.parametrize("entry", TABLE)
def test_an_entry_fills_its_range_and_leaves_it_nowhere(entry: str) -> None:
    share = np.sort(drawn_values(entry))
    assert share[0] >= -1e-4
    assert share[-1] <= 1.0 + 1e-4
    even = (np.arange(len(share)) + 0.5) / len(share)
    assert np.max(np.abs(share - even)) < 2.0 / math.sqrt(len(share))  # Kolmogorov, 0.07 %


def test_entries_are_independent() -> None:
    together = np.corrcoef(np.array([drawn_values(entry) for entry in TABLE]))
    together[np.diag_indices_from(together)] = 0.0
    assert np.max(np.abs(together)) < 4.5 / math.sqrt(len(SEEDS))


def test_ratios_are_those_of_the_table_and_teeth_match() -> None:
    found = [one.card.ratio for one in population()]
    assert set(found) == {50.0, 80.0, 100.0, 120.0, 160.0}
    assert min(found.count(ratio) for ratio in set(found)) > 35
    for one in population()[:20]:
        teeth, geometry = one.gear.teeth, one.gear.geometry
        assert teeth == one.card.teeth
        assert geometry == one.card.geometry
        assert teeth.circular_spline == teeth.flexspline + 2 == 2 * one.card.ratio + 2
        assert geometry.module == pytest.approx(geometry.flexspline_diameter / teeth.flexspline)
        assert geometry.radial_deformation == pytest.approx(1.2 * geometry.module, rel=1e-6)
        assert one.card.name == f"CSF-25-{one.card.ratio:.0f}-2UH"


def test_the_three_springs_share_their_factor() -> None:
    for one in population()[:20]:
        own, card = dynamic_parameters(one.gear), dynamic_parameters(one.card)
        for spring in ("bearing_stiffness", "mesh_stiffness", "cup_stiffness"):
            assert getattr(own, spring) / getattr(card, spring) == pytest.approx(factor(one))


def test_the_card_tells_of_the_gear_what_a_nameplate_does() -> None:
    stays = ("bearing", "material", "mesh_friction", "cup", "damping")
    stated_wrong = []
    for one in population():
        assert all(getattr(one.card, part) == getattr(GEAR, part) for part in stays)
        assert one.card.kinematic_error == GEAR.kinematic_error
        assert one.motor_card is MOTOR
        stated_wrong.append(one.card.inertia.output / one.gear.inertia.output - 1.0)
    assert 0.025 < np.max(np.abs(stated_wrong)) <= 0.03 + 1e-12
    assert abs(np.mean(stated_wrong)) < 0.003


def test_encoders_have_every_order_at_any_phase_and_one_percent_between_the_lines() -> None:
    phases = []
    for one in population():
        assert [h.order for h in stated(one).output_encoder.series] == list(range(1, 65))
        assert [(w.order, w.beside) for w in stated(one).output_orders] == [
            (0, k) for k in range(1, 9)
        ]
        assert [h.order for h in stated(one).input_encoder.series] == [1, 2, 4]
        fine = stated(one).output_encoder.subdivision
        assert fine is not None
        assert fine.amplitude * fine.order / (2.0 * math.pi) == pytest.approx(0.01)
        last = stated(one).output_encoder.series[7]
        phases.append(math.atan2(last.sine, last.cosine))
    assert abs(np.mean(np.exp(1j * np.array(phases)))) < 3.0 / math.sqrt(len(SEEDS))


def test_gear_bench_and_day_have_draws_of_their_own() -> None:
    one = drawn(GEAR, MOTOR, world(3))
    assert drawn(GEAR, MOTOR, world(3)) == one
    moved = drawn(GEAR, MOTOR, world(3, bench_seed=1))
    assert (moved.gear, moved.card) == (one.gear, one.card)
    assert stated(moved).sidebands == stated(one).sidebands
    assert stated(moved).output_encoder != stated(one).output_encoder
    assert thermal(moved, "coulomb_per_kelvin") == thermal(one, "coulomb_per_kelvin")
    regeared = drawn(GEAR, MOTOR, world(3, gear_seed=4))
    assert regeared.gear != one.gear
    assert regeared.motor == one.motor
    assert stated(regeared).output_encoder == stated(one).output_encoder
    next_day = drawn(GEAR, MOTOR, world(3, day=2))
    assert (next_day.gear, next_day.motor) == (one.gear, one.motor)
    assert thermal(next_day, "ambient") != thermal(one, "ambient")
    assert stated(next_day).torque_port.offset != stated(one).torque_port.offset
    assert stated(next_day).torque_port.gain_error == stated(one).torque_port.gain_error


def test_a_narrow_world_is_parts_of_one_series() -> None:
    one = drawn(GEAR, MOTOR, World(gear_seed=5, bench_seed=6))
    assert one.gear == individual_gear(GEAR, 5)
    rotor = one.motor.rotor_inertia
    assert rotor != MOTOR.rotor_inertia
    assert abs(rotor / MOTOR.rotor_inertia - 1.0) <= 0.1
    assert dataclasses.replace(one.motor, rotor_inertia=MOTOR.rotor_inertia) == individual_motor(
        MOTOR, 6
    )
    assert one.card is GEAR
    assert one.motor_card is MOTOR
    assert one.sizes.stated is None


def test_the_rig_has_what_was_drawn_as_far_as_it_is_switched_on() -> None:
    one = drawn(GEAR, MOTOR, world(8))
    truths = []
    for on in (Imperfections(sizes=one.sizes), Imperfections.none()):
        with_sizes = dataclasses.replace(on, sizes=one.sizes)
        truths.append(SimulatedRig(one.gear, one.motor, with_sizes, World.of(1)).truth)
    full, none = truths
    have = stated(one)
    assert full["torque_port"]["gain_error"] == have.torque_port.gain_error
    assert full["timing"]["output_skew"] == have.output_encoder.skew
    assert len(full["encoders"]["output"]["orders"]) == 64
    assert len(full["kinematic_error"]["orders"]) == 6 + 8 + len(have.sidebands)
    assert none["torque_port"]["gain_error"] == none["timing"]["output_skew"] == 0.0
    assert none["encoders"]["output"]["orders"] == []
    assert len(none["kinematic_error"]["orders"]) == 6


def test_channels_state_the_class_and_never_what_was_drawn() -> None:
    two = [drawn(GEAR, MOTOR, world(seed)) for seed in (1, 2)]
    rigs = [SimulatedRig(d.gear, d.motor, Imperfections(sizes=d.sizes), World.of(1)) for d in two]
    assert rigs[0].channels == rigs[1].channels
    accuracy = {c.name: c.calibration.accuracy for c in rigs[0].channels}
    assert accuracy["output_angle"] == pytest.approx(5.0 * ARCSEC)
    assert accuracy["input_angle"] == pytest.approx(30.0 * ARCSEC)


def test_a_long_skew_is_the_output_of_a_later_instant_and_not_an_extrapolation() -> None:
    """0.75 ms after SYNC at 1 kHz is the third of the SYNCs between at 4 kHz."""
    one = drawn(GEAR, MOTOR, world(8))
    have = dataclasses.replace(
        stated(one), output_encoder=dataclasses.replace(stated(one).output_encoder, skew=0.75e-3)
    )
    every = Imperfections(sizes=dataclasses.replace(one.sizes, stated=have))
    on = every.without("sync_jitter", "random_start", "torque_noise", "temperature_noise")
    steps = np.repeat([0.0, 100.0, -30.0], 100)
    blocks = []
    for cycle_ns, skew, times in ((1_000_000, on, 1), (250_000, on.without("channel_skew"), 4)):
        rig = SimulatedRig(one.gear, one.motor, skew, World.of(1), cycle_ns=cycle_ns)
        rig.open()
        targets = np.repeat(steps, times)
        blocks.append(rig.exchange(Command(Mode.SPEED, targets), len(targets), NO_GUARD).counts)
    late, fine = (block[:, 1] for block in blocks)
    assert np.max(np.abs((late - late[0]) - (fine[3::4] - fine[3]))) <= 1
    assert np.ptp(late) > 1000
    with pytest.raises(ModelError, match="when the next SYNC has come"):
        SimulatedRig(one.gear, one.motor, on, World.of(1), cycle_ns=500_000)
