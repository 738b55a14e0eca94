"""What goes wrong slowly: seen within the times that the safety concept states, and honest signals are left alone."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from drivers import channel as names
from drivers.clock import VirtualClock
from drivers.port import Command, Mode
from drivers.samples import SampleBlock
from experiments.steps.vocabulary import HoldTime, Ramp, ServoOff, Step
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from model.units import RPM
from rig.bench.backends.assembly import AssembledRig
from rig.bench.backends.order import Order
from rig.run import trips
from rig.run.bounds import Watch
from rig.run.parts import RunReport, SessionParts
from rig.run.phases import Turn
from rig.run.session import execute
from rig.run.supervisor import Supervisor
from rig.run.thermometer_review import ThermometerState, stood
from rig.run.torque_review import TorqueReview, TorqueState
from sim_backend import faults
from sim_backend.direct import SimulatedRig
from sim_backend.imperfections import Imperfections
from sim_backend.world import World
from tests.rig.fake_rig import FakeRig, ListRun, planned_of

AT = 700
"""Cycle at which the lie begins: in the middle of the first hold."""
STAND = 1560
PERIOD = 1e-3
PLAN: tuple[Step, ...] = (
    ServoOff(0.1),
    Ramp(60.0, 1500.0),
    HoldTime(0.6),
    Ramp(-60.0, 1500.0),
    HoldTime(0.4),
    Ramp(0.0, 1500.0),
    HoldTime(0.9),
    ServoOff(0.1),
)


def run_with(
    *lies: faults.Fault,
    plan: tuple[Step, ...] = PLAN,
    seed: int = 3,
    block: int = 50,
    imperfections: Imperfections | None = None,
) -> tuple[ListRun, RunReport]:
    clock, run = VirtualClock(1_800_000_000_000_000_000), ListRun()
    port: Any = SimulatedRig(
        shipped_gear(), shipped_motor(), imperfections, World.of(seed), clock=clock, faults=lies
    )
    parts = SessionParts(
        order=Order(protocol=""),
        planned=planned_of(*plan),
        rig=AssembledRig(name="sim", port=port, clock=clock),
        cycles=block,
    )
    return run, execute(parts, lambda *_: run)


@pytest.mark.parametrize("block", [20, 250])
@pytest.mark.parametrize(
    ("lie", "cause", "within"),
    [
        (faults.ChannelFrozen(AT), trips.TORQUE_FROZEN, 400),
        (faults.TorqueZeroDrifts(AT), trips.TORQUE_ZERO, 1000),
        (faults.TorqueZeroDrifts(AT, counts_per_cycle=-0.5), trips.TORQUE_ZERO, 1000),
        (faults.CountsLost(AT, counts=23), trips.SLIP, 300),
        (faults.CountsLost(AT, counts=-23), trips.SLIP, 300),
        # What a skew of the encoders could be at this speed, it cannot be the other way round.
        (faults.CountsLost(AT), trips.SLIP, 520),
        (faults.CountsLost(AT, counts=-20), trips.SLIP, 520),
        (faults.CountsLost(AT, channel=names.INPUT_ANGLE, counts=-30), trips.LOST_COUNTS, 220),
        (faults.RunAway(STAND, speed=29.0 * RPM, cycles=600), trips.CREEP, 400),
        (faults.RunAway(STAND, speed=-29.0 * RPM, cycles=600), trips.CREEP, 400),
        (faults.ThermometerOpen(AT), trips.THERMOMETER, 12),
        (faults.ThermometerOpen(AT, counts=32767), trips.THERMOMETER, 12),
    ],
    ids=lambda value: value if isinstance(value, str) else None,
)
def test_a_slow_lie_is_seen_within_its_time_and_named(
    lie: faults.Fault, cause: str, within: int, block: int
) -> None:
    run, report = run_with(lie, block=block)
    assert report.outcome == "TRIPPED", report.message
    assert report.trip is not None
    assert report.trip.cause == cause, report.message
    # Some windows end with a block.
    assert lie.at_cycle <= report.trip.row <= lie.at_cycle + within + 2 * block
    assert trips.TRIPS[cause].remedy in report.message
    assert "limit" in report.message
    assert report.safe
    assert cause in run.codes()


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_healthy_rig_is_not_marked(seed: int) -> None:
    run, report = run_with(plan=(*PLAN[:-1], HoldTime(8.0), PLAN[-1]), seed=seed)
    assert report.trip is None, report.message
    assert not {"thermometer", "torque-disagreement", "index-mark"} & set(run.codes())


def test_instruments_that_see_everything_are_not_marked() -> None:
    # Without noise a reading may stand still, and nothing is wrong with it.
    run, report = run_with(
        imperfections=Imperfections().without("torque_noise", "temperature_noise")
    )
    assert report.trip is None, report.message
    assert "thermometer" not in run.codes()


def test_a_thermometer_that_trembled_and_stands_is_told_of_once() -> None:
    plan = (ServoOff(0.1), Ramp(60.0, 1500.0), HoldTime(14.0), Ramp(0.0, 1500.0), ServoOff(0.1))
    frozen = faults.ChannelFrozen(AT, channel=names.HOUSING_TEMPERATURE)
    run, report = run_with(frozen, plan=plan, block=250)
    assert report.trip is None
    told = [event for event in run.events if event.code == "thermometer"]
    assert len(told) == 1
    assert "may be dead" in told[0].text


def test_a_coarse_thermometer_stands_honestly() -> None:
    watch, state = Watch(), ThermometerState()
    random = np.random.default_rng(2)
    for _ in range(60):
        # 0.1 K per count, a tenth of a count of noise, warming by a count in ten seconds.
        counts = np.rint(250.0 + np.arange(10_000) / 10_000 + 0.1 * random.standard_normal(10_000))
        state, notes = stood(state, counts.astype(np.int64), watch, PERIOD)
        assert notes == ()


def frozen(port: np.ndarray, drive: np.ndarray, block: int) -> int | None:
    """The row at which a port (n,) against a drive (n,) [N m] is called frozen, reviewed in blocks."""
    review, state = TorqueReview(Watch(), 0.637, PERIOD), TorqueState()
    for start in range(0, len(port), block):
        part = slice(start, start + block)
        state, found, _ = review.compared(state, port[part], drive[part], start)
        for trip in found:
            if trip.cause == trips.TORQUE_FROZEN:
                return trip.row
    return None


@pytest.mark.parametrize("block", [1, 7, 100, 2000])
def test_a_frozen_port_is_seen_in_the_same_cycle_however_the_run_is_cut(block: int) -> None:
    drive = np.where(np.arange(2000) < 900, 0.02, -0.02) + 6e-4 * (np.arange(2000) % 3)
    port = np.where(np.arange(2000) < 300, 0.02 + 2e-4 * (np.arange(2000) % 2), 0.02)
    assert frozen(port, drive, block) == 900 + 49


@pytest.mark.parametrize("step", [0.8e-3, 3.1e-3])
def test_a_coarse_converter_stands_honestly_and_follows_late(step: float) -> None:
    # The torque steps by more than the limit; the port, filtered and averaged, follows 20 ms later.
    torque = np.where(np.arange(4000) // 1000 % 2 == 0, 0.05, -0.05)
    drive = torque + 6.37e-4 * (np.arange(4000) % 5 - 2)
    port = np.rint(np.roll(torque, 20) / step) * step
    assert frozen(port, drive, 50) is None


def at_standstill(speed: np.ndarray, block: int) -> int | None:
    """The row at which an input with this speed (n,) [rad/s] is said to creep; the set-point is zero."""
    rig = FakeRig()
    limits = planned_of(*PLAN).limits
    watcher = Supervisor(rig.channels, 1_000_000, limits, None)
    angle = [c.name for c in rig.channels].index(names.INPUT_ANGLE)
    counts = np.zeros((len(speed), len(rig.channels)), dtype=np.int64)
    counts[:, angle] = np.cumsum(speed) * PERIOD / rig.channels[angle].scale
    for start in range(0, len(speed), block):
        part = counts[start : start + block]
        times = np.arange(start, start + len(part), dtype=np.int64) * 1_000_000
        turn = Turn(Command(Mode.SPEED, np.zeros(len(part))), len(part), enabled=True)
        flags = np.zeros(len(part), dtype=np.uint16)
        trip = watcher.review(SampleBlock(start, times, part, flags), turn)
        if trip is not None and trip.cause == trips.CREEP:
            return trip.row
    return None


@pytest.mark.parametrize("deceleration", [50.0, 300.0, 3000.0])
def test_a_drive_that_brakes_does_not_creep(deceleration: float) -> None:
    speed = np.maximum(60.0 - deceleration * PERIOD * np.arange(3000), 0.0)
    assert at_standstill(speed, 50) is None


@pytest.mark.parametrize("block", [7, 50, 1000])
def test_creep_is_seen_in_the_same_cycle_however_the_run_is_cut(block: int) -> None:
    row = at_standstill(np.full(1000, 3.04), block)
    assert row is not None
    assert 300 <= row <= 360
    assert row == at_standstill(np.full(1000, 3.04), 1)
    assert at_standstill(np.full(1000, 0.3), block) is None
