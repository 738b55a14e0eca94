"""Each imperfection shows exactly where it says, and can be switched off."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from drivers import channel as names
from drivers.errors import DriverError
from drivers.port import Command, Mode
from model.units import ARCSEC, RPM
from sim_backend.drawing import bench_encoder, draw, half_width
from sim_backend.imperfections import Imperfections, Sizes
from sim_backend.individuals import individual_gear, individual_motor
from sim_backend.sensors import FINE
from sim_backend.world import World
from tests.sim_backend.rigs import GEAR, MOTOR, NO_GUARD, clean, column, off, si, turn

ANGLES = {names.INPUT_ANGLE, names.OUTPUT_ANGLE}
MARKS = {names.INPUT_INDEX, names.OUTPUT_INDEX, names.INDEX_SEEN}
TORQUES = {names.TORQUE, names.DRIVE_TORQUE}
TEMPERATURES = {names.HOUSING_TEMPERATURE, names.AMBIENT_TEMPERATURE}

# What must change when one imperfection is added to a perfect rig, and what may: through the servo,
# or because a mark is passed in another cycle.
MOTION = ANGLES | MARKS
SHOWS_IN: dict[str, tuple[set[str], set[str]]] = {
    "quantisation": (ANGLES, MARKS),
    "sub_divisional_error": (ANGLES, MARKS),
    "encoder_revolution_error": (ANGLES, MARKS),
    "output_orders": ({names.OUTPUT_ANGLE}, MOTION | TORQUES),
    "sidebands": ({names.OUTPUT_ANGLE}, MOTION | TORQUES),
    "torque_offset": ({names.TORQUE}, set()),
    "torque_scale_error": (TORQUES, MOTION),
    "torque_lag": ({names.TORQUE}, set()),
    "torque_noise": ({names.TORQUE}, set()),
    "adc_steps": ({names.TORQUE}, set()),
    "drive_torque_steps": ({names.DRIVE_TORQUE}, set()),
    "motor_friction": (TORQUES, MOTION),
    "motor_cogging": (TORQUES, MOTION),
    "output_bearing_friction": ({names.OUTPUT_ANGLE, *TORQUES}, MOTION),
    "hardening": ({names.OUTPUT_ANGLE}, MOTION | TORQUES),
    "hysteresis": ({names.OUTPUT_ANGLE}, MOTION | TORQUES),
    "friction_windup": ({names.OUTPUT_ANGLE}, set()),
    "mesh_depth_friction": (TORQUES, MOTION),
    "warming": ({names.HOUSING_TEMPERATURE}, MOTION | TORQUES),
    "temperature_noise": (TEMPERATURES, set()),
    "sync_jitter": (ANGLES, MARKS),
    "channel_skew": (ANGLES, MARKS),
    "random_start": (ANGLES, MARKS | TORQUES),
    "mounting": ({names.INPUT_INDEX}, MARKS),
    "eccentricity": ({names.OUTPUT_ANGLE}, MOTION | TORQUES),
    "ambient_temperature": ({names.AMBIENT_TEMPERATURE}, set()),
    "run_to_run_friction": (TORQUES, MOTION),
    # The clock's error is in the stamps alone, and a new gear is not worn.
    "clock_error": (set(), set()),
    "wear": (set(), set()),
}


def run(*switched_on: str) -> dict[str, np.ndarray]:
    """A step to 3000 r/min with only these imperfections: the gear's hardening is passed."""
    port = clean(*switched_on)
    block = turn(port, 3000.0, 900)
    return {c.name: block.counts[:, i] for i, c in enumerate(port.channels)}


@pytest.fixture(scope="module")
def perfect() -> dict[str, np.ndarray]:
    return run()


def test_every_switch_is_listed_here_and_on_by_default() -> None:
    assert set(SHOWS_IN) == set(Imperfections.names())
    assert all(getattr(Imperfections(), name) for name in Imperfections.names())
    assert not any(getattr(Imperfections.none(), name) for name in Imperfections.names())


@pytest.mark.parametrize("name", Imperfections.names())
def test_an_imperfection_shows_where_it_says(name: str, perfect: dict[str, np.ndarray]) -> None:
    must, may = SHOWS_IN[name]
    changed = {key for key, counts in run(name).items() if not np.array_equal(counts, perfect[key])}
    assert must <= changed
    assert changed <= must | may


def test_with_all_switched_off_it_is_perfect_and_switching_one_off_leaves_the_others() -> None:
    every = Imperfections()
    assert every.without(*every.names()) == Imperfections.none()
    full, less = (
        draw(on, 120.0, World.of(2))
        for on in (every, every.without("motor_cogging", "torque_noise"))
    )
    assert full.output_encoder == less.output_encoder
    assert full.deviations.kinematic_error == less.deviations.kinematic_error
    assert full.torque_port.offset == less.torque_port.offset
    with pytest.raises(DriverError, match="no such imperfection"):
        every.without("gravity")


def test_quantisation_is_the_floor_of_the_angle() -> None:
    fine, coarse = clean(), clean("quantisation")
    blocks = turn(fine, 3000.0, 900), turn(coarse, 3000.0, 900)
    for which in ("input", "output"):
        encoders = [port.truth["encoders"][which] for port in (fine, coarse)]
        offsets = [round(e["angle_offset"] / e["quantum"] + 0.5) for e in encoders]
        exact = column(fine, blocks[0], f"{which}_angle") - offsets[0]
        assert np.array_equal(
            column(coarse, blocks[1], f"{which}_angle"), exact // FINE + offsets[1]
        )


def test_torque_port_reads_gain_and_zero() -> None:
    port = clean("torque_offset", "torque_scale_error", "adc_steps", seed=3)
    truth = port.truth["torque_port"]
    zero = si(port, off(port, 300), names.TORQUE)
    assert np.mean(zero) == pytest.approx(truth["offset"], abs=4.1e-4)
    reading = si(
        port, port.exchange(Command(Mode.TORQUE, np.full(50, 0.05)), 50, NO_GUARD), names.TORQUE
    )
    reference = 78 * 1e-3 * MOTOR.rated_torque
    assert np.mean(reading[-10:]) == pytest.approx(
        truth["offset"] + (1.0 + truth["gain_error"]) * reference, abs=4.1e-4
    )
    assert np.all(column(port, off(port, 5), names.TORQUE) % 4 == 0)


def test_noise_has_its_size_and_is_white() -> None:
    port = clean("torque_noise")
    noise = si(port, off(port, 4000), names.TORQUE)
    assert np.std(noise) == pytest.approx(0.0015, rel=0.05)
    assert abs(np.mean(noise[1:] * noise[:-1])) < 4.0 * 0.0015**2 / math.sqrt(4000)


def test_jitter_is_in_the_stamps_and_harmless_with_them() -> None:
    port, level = clean("sync_jitter"), clean()
    for each in (port, level):
        turn(each, 300.0, 1500)
    block = turn(port, 300.0, 1200)
    moved = si(port, block, names.INPUT_ANGLE) - si(
        level, turn(level, 300.0, 1200), names.INPUT_ANGLE
    )
    late = (block.time_ns - 1_000_000 * np.arange(1500, 2700)) * 1e-9
    assert np.std(late) == pytest.approx(15e-6, rel=0.1)
    assert np.std(moved) == pytest.approx(300.0 * RPM * 15e-6, rel=0.1)
    assert np.std(moved - 300.0 * RPM * late) < 0.01 * np.std(moved)


def test_a_wrong_clock_is_in_the_stamps_and_leaves_every_count() -> None:
    wrong, right = clean("clock_error"), clean()
    share = wrong.truth["timing"]["clock_error"]
    assert 1e-6 < abs(share) <= 50e-6
    assert right.truth["timing"]["clock_error"] == 0.0
    first, second = (turn(port, 300.0, 1200) for port in (wrong, right))
    assert np.array_equal(first.counts, second.counts)
    passed = first.time_ns - first.time_ns[0]
    assert np.all(np.abs(passed - 1_000_000 * np.arange(1200) * (1.0 + share)) <= 1.0)


def test_clocks_are_anywhere_within_fifty_parts_in_a_million() -> None:
    errors = [draw(Imperfections(), 120.0, World.of(s)).clock_error for s in range(400)]
    assert 48e-6 < max(errors) <= 50e-6
    assert -50e-6 <= min(errors) < -48e-6
    assert abs(np.mean(errors)) < 4.0 * 50e-6 / math.sqrt(3.0 * 400)


def test_a_narrow_output_encoder_has_orders_1_to_8_within_its_class() -> None:
    waves = []
    for seed in range(200):
        bench = World.of(seed)
        series = bench_encoder(Imperfections(), "output", bench).series
        assert [h.order for h in series] == list(range(1, 9))
        assert half_width(series) <= Sizes().output_accuracy * (1.0 + 1e-9)
        # What the bench had before it has still.
        older = bench_encoder(Imperfections(), "output", dataclasses.replace(bench, version=1))
        assert older.series == series[:2]
        waves.append(half_width(series[2:]) / ARCSEC)
    assert min(waves) >= 0.0
    assert np.median(waves) == pytest.approx(1.0, abs=0.1)
    assert max(waves) <= 1.4 + 1e-9


def test_skew_is_angle_by_speed() -> None:
    late, level = clean("channel_skew"), clean()
    skew = late.truth["timing"]["output_skew"]
    first, second = (turn(p, 1000.0, 2000) for p in (late, level))
    moved = si(late, first, names.OUTPUT_ANGLE) - si(level, second, names.OUTPUT_ANGLE)
    assert np.mean(moved[-600:]) == pytest.approx(-1000.0 * RPM / 120.0 * skew, rel=1e-2)


def test_index_marks_are_latched_where_they_stand_from_both_sides() -> None:
    port = clean("quantisation", "random_start")
    encoder = port.truth["encoders"]["input"]
    forward = turn(port, 200.0, 900)
    seen = column(port, forward, names.INDEX_SEEN) & 1
    assert seen[0] == 0
    assert np.all(column(port, forward, names.INPUT_INDEX)[seen == 0] == 0)
    marks = si(port, forward, names.INPUT_INDEX)[seen == 1]
    per_turn = 2.0 * math.pi
    assert np.all(
        np.abs((marks - encoder["index_angle"] + math.pi) % per_turn - math.pi)
        <= encoder["quantum"]
    )
    backward = turn(port, -200.0, 900)
    latest = column(port, backward, names.INPUT_INDEX)[-1]
    assert (latest - column(port, forward, names.INPUT_INDEX)[-1] - 1) % (8192 * 4) == 0


def test_individual_gears_differ_and_repeat() -> None:
    one, again, other = individual_gear(GEAR, 1), individual_gear(GEAR, 1), individual_gear(GEAR, 2)
    assert one == again
    assert one.mesh_friction != other.mesh_friction
    assert one.kinematic_error != other.kinematic_error
    friction = np.array([individual_gear(GEAR, s).mesh_friction.coulomb for s in range(200)])
    assert np.std(np.log(friction / GEAR.mesh_friction.coulomb)) == pytest.approx(0.10, rel=0.2)
    assert all(individual_gear(GEAR, s).mesh_friction.static > friction[s] for s in range(200))
    assert (
        individual_motor(MOTOR, 1).coulomb_friction != individual_motor(MOTOR, 2).coulomb_friction
    )
