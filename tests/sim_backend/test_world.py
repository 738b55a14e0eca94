"""Gear, bench, mounting, day and run are five things: each keeps what is its own when another one changes."""

from __future__ import annotations

import dataclasses
import hashlib
import math
from typing import Any

import numpy as np
import pytest

from drivers import channel as names
from drivers.errors import DriverError
from model.kinematic_error import series_value
from model.units import ARCSEC
from sim_backend.condition import Condition, EncoderErrors, Seating
from sim_backend.direct import SimulatedRig
from sim_backend.drawing import draw
from sim_backend.imperfections import Imperfections, Sizes
from sim_backend.population import drawn
from sim_backend.world import LARGEST, ThermalState, World
from tests.sim_backend.rigs import GEAR, MOTOR, column, si, turn

RATIO = GEAR.ratio
WORLD = World(gear_seed=11, bench_seed=22, mount=3, day=4, number=5)
ANOTHER = {
    "gear": {"gear_seed": 12},
    "bench": {"bench_seed": 23},
    "mounting": {"mount": 4},
    "day": {"day": 5},
    "number": {"number": 6},
}


def marked_angle(encoder: EncoderErrors) -> np.ndarray:
    """One revolution from the encoder's own mark on."""
    return encoder.index_angle + np.linspace(0.0, 2.0 * math.pi, 360, endpoint=False)


def curve(encoder: EncoderErrors) -> np.ndarray:
    """The error of an encoder over one revolution from its own mark on."""
    return series_value(encoder.series, marked_angle(encoder))


def owned(condition: Condition) -> dict[str, list[Any]]:
    """What was drawn, by who owns it."""
    extra, port = condition.deviations, condition.torque_port
    assert extra.thermal is not None
    gears = [h for h in extra.kinematic_error if h not in condition.seating.eccentricity]
    return {
        "gear": gears,
        "bench": [
            *curve(condition.input_encoder).round(12),
            *curve(condition.output_encoder).round(12),
            condition.output_encoder.skew,
            port.gain_error,
            extra.torque_constant_error,
            extra.output_coulomb,
            extra.output_viscous,
            condition.housing_offset,
            condition.clock_error,
            *series_value(extra.cogging, marked_angle(condition.input_encoder)).round(12),
        ],
        "mounting": [*dataclasses.astuple(condition.seating)],
        "day": [port.offset, condition.ambient, extra.thermal.ambient],
        "number": [condition.start_angle, condition.input_count, condition.dry_friction],
    }


# A gear or a bench that is another one is mounted anew, at another bench it is another day, and all of them make
# another run.
CHANGES = {
    "gear": {"gear", "mounting", "number"},
    "bench": {"bench", "mounting", "day", "number"},
    "mounting": {"mounting", "number"},
    "day": {"day", "number"},
    "number": {"number"},
}


@pytest.mark.parametrize("which", ANOTHER)
def test_each_owns_its_own_and_leaves_the_others_theirs(which: str) -> None:
    on = Imperfections()
    first = owned(draw(on, RATIO, WORLD))
    other = owned(draw(on, RATIO, dataclasses.replace(WORLD, **ANOTHER[which])))
    assert {name for name in first if first[name] != other[name]} == CHANGES[which]
    for name in CHANGES[which]:
        same = [a for a, b in zip(first[name], other[name], strict=True) if a == b]
        assert same == [], name
    assert owned(draw(on, RATIO, WORLD)) == first


def test_turning_the_gear_moves_it_against_the_output_encoder_alone() -> None:
    angle = math.radians(30.0)
    before, after = (
        draw(Imperfections(), RATIO, dataclasses.replace(WORLD, mount_turn=turned))
        for turned in (0.0, angle)
    )
    # Seen from its own mark the encoder is the same; the gear, in whose angles the mark is told, is not.
    assert np.allclose(curve(before.output_encoder), curve(after.output_encoder), atol=1e-12)
    moved = before.output_encoder.index_angle - after.output_encoder.index_angle
    assert math.remainder(moved - angle, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-12)
    assert before.input_encoder == after.input_encoder
    assert before.deviations == after.deviations
    assert (before.start_angle, before.torque_port) == (after.start_angle, after.torque_port)


def seated(**world: Any) -> Seating:
    return draw(Imperfections(), RATIO, dataclasses.replace(WORLD, **world)).seating


def test_a_gear_that_is_fitted_anew_at_a_stated_angle_stands_there_and_is_eccentric_anew() -> None:
    first = seated(mount=1)
    for mount, degrees in ((2, 0.0), (2, 30.0), (3, 150.0)):
        again = seated(mount=mount, mount_turn=math.radians(degrees))
        moved = again.output_phase - first.output_phase
        assert moved == pytest.approx(math.radians(degrees), abs=1e-12)
        assert again.input_phase != first.input_phase
        for one, other in zip(again.eccentricity, first.eccentricity, strict=True):
            assert abs(complex(one.cosine - other.cosine, one.sine - other.sine)) > 0.1 * ARCSEC
    # Where nobody states the angle it is another one each time.
    unstated = {seated(mount=mount).output_phase for mount in (1, 2, 3)}
    assert len(unstated) == 3


# What versions 1 (of program version 0.2.0) and 2 made of these worlds: 600 cycles at 300 r/min, counts and stamps.
OLDER_COUNTS: dict[tuple[str, str], dict[str, Any]] = {
    ("2e3ca00bcac9aaef", "053f1fca279e85c7"): {"gear_seed": 11, "bench_seed": 22},
    ("b74cb588a4febb1d", "efe1bcbab1acfd62"): {
        "gear_seed": 11,
        "bench_seed": 22,
        "mount": 3,
        "mount_turn": 0.3,
        "day": 4,
        "number": 5,
    },
    ("cd5d114a64513298", "579f70fffe36c030"): {
        "gear_seed": 5,
        "bench_seed": 6,
        "population": "wide",
        "mount": 2,
        "mount_turn": 0.0,
        "day": 3,
    },
}


@pytest.mark.parametrize("digests", OLDER_COUNTS)
def test_a_world_of_the_older_draws_is_as_it_was(digests: tuple[str, str]) -> None:
    def made(version: int) -> str:
        world = World(version=version, **OLDER_COUNTS[digests])
        parts = drawn(GEAR, MOTOR, world)
        port = SimulatedRig(parts.gear, parts.motor, Imperfections(sizes=parts.sizes), world)
        port.open()
        block = turn(port, 300.0, 600)
        passed = block.time_ns - block.time_ns[0]
        both = np.ascontiguousarray(block.counts).tobytes() + passed.tobytes()
        return hashlib.sha256(both).hexdigest()[:16]

    assert (made(1), made(2)) == digests


def test_hysteresis_follows_its_law_from_version_3_on() -> None:
    by_slope = [
        draw(
            Imperfections(), RATIO, dataclasses.replace(WORLD, version=version)
        ).deviations.hysteresis_by_slope
        for version in (1, 2, 3)
    ]
    assert by_slope == [True, True, False]


def test_a_gear_that_is_turned_by_180_degrees_shows_its_odd_output_orders_with_another_sign() -> (
    None
):
    """Over one turn of the output: what both recordings share is even or the encoder's, what differs is the gear's."""
    sizes = Sizes(output_orders=(40.0 * ARCSEC, 30.0 * ARCSEC))
    on = dataclasses.replace(
        Imperfections.none(), output_orders=True, encoder_revolution_error=True, sizes=sizes
    )
    seen = []
    for turned in (0.0, math.pi):
        world = dataclasses.replace(WORLD, mount_turn=turned)
        bare = dataclasses.replace(GEAR, kinematic_error=())
        port = SimulatedRig(bare, MOTOR, on, world)
        port.open()
        encoder = port.truth["encoders"]["output"]
        turn(port, 1500.0, 400)
        block = turn(port, 1500.0, 4800)
        output, ideal = (si(port, block, name) for name in (names.OUTPUT_ANGLE, names.INPUT_ANGLE))
        error = -(output + ideal / RATIO)
        angle = output - encoder["index_angle"]
        seen.append([2.0 * np.mean(error * np.exp(-1j * k * angle)) for k in (1, 2)])
    (one, two), (one_turned, two_turned) = seen
    assert abs(one - one_turned) / 2.0 == pytest.approx(40.0 * ARCSEC, rel=0.35)
    assert abs(two - two_turned) < 0.05 * abs(two)


def test_no_two_numbers_give_the_same_counts_and_one_gives_the_same_again() -> None:
    def counts(number: int, on: Imperfections) -> np.ndarray:
        port = SimulatedRig(GEAR, MOTOR, on, dataclasses.replace(WORLD, number=number))
        port.open()
        return turn(port, 600.0, 200).counts

    quiet = Imperfections().without("random_start", "temperature_noise", "torque_noise")
    for on in (Imperfections(), quiet):
        first = counts(5, on)
        assert np.array_equal(counts(5, on), first)
        assert not np.array_equal(counts(6, on), first)


def test_dry_friction_changes_by_a_hundredth_from_run_to_run() -> None:
    on = Imperfections()
    changes = [
        draw(on, RATIO, dataclasses.replace(WORLD, number=n)).dry_friction for n in range(1, 301)
    ]
    assert np.std(changes) == pytest.approx(0.01, rel=0.15)
    assert np.mean(changes) == pytest.approx(1.0, abs=0.002)
    gear = draw(on, RATIO, WORLD).gear_of(GEAR)
    factor = gear.mesh_friction.coulomb / GEAR.mesh_friction.coulomb
    assert factor != 1.0
    assert gear.mesh_friction.static == pytest.approx(factor * GEAR.mesh_friction.static)
    assert gear.mesh_friction.viscous == GEAR.mesh_friction.viscous


def test_days_are_within_a_degree_and_a_half() -> None:
    rooms = [
        draw(Imperfections(), RATIO, dataclasses.replace(WORLD, day=d)).ambient
        for d in range(1, 201)
    ]
    assert 20.5 <= min(rooms) < 20.8
    assert 23.2 < max(rooms) <= 23.5


def test_a_rig_starts_as_warm_as_it_is_told_and_says_how_warm_it_became() -> None:
    start = ThermalState(housing=37.25, motor=51.5)
    port = SimulatedRig(
        GEAR, MOTOR, Imperfections().without("temperature_noise"), WORLD, start=start
    )
    port.open()
    assert port.thermal_state == start
    block = turn(port, 600.0, 2000)
    assert column(port, block, names.HOUSING_TEMPERATURE)[0] == 3725
    assert port.thermal_state.motor < start.motor
    cold = SimulatedRig(GEAR, MOTOR, Imperfections(), WORLD).thermal_state
    assert cold.housing == cold.motor == draw(Imperfections(), RATIO, WORLD).ambient


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("gear_seed", -1),
        ("bench_seed", LARGEST + 1),
        ("mount", 0),
        ("day", 0),
        ("number", 0),
        ("mount_turn", math.nan),
        ("population", "huge"),
        ("hours", -1.0),
        ("hours", math.nan),
        ("day_correlation", 0.96),
        ("version", 4),
    ],
)
def test_what_names_no_world_is_refused_by_name(field: str, value: Any) -> None:
    with pytest.raises(DriverError) as refused:
        dataclasses.replace(WORLD, **{field: value})
    assert refused.value.where == field
    assert refused.value.remedy
