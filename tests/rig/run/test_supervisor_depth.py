"""What the supervisor sees beyond one cycle: heat, torque port, a lost clock, what devices tell,
how near each limit came.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from drivers.port import Abilities, Command, Guard, Mode
from drivers.samples import CycleFlag, SampleBlock
from experiments.steps.vocabulary import HoldTime, Ramp
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig.bench import limits as lim
from rig.bench.backends.assembly import AssembledRig
from rig.run import margins, trips
from rig.run.bounds import Watch
from rig.run.parts import Progress, RunReport
from rig.run.phases import Turn
from rig.run.session import execute
from rig.run.start import handle_of, watchdog_of
from rig.run.stop import StopRequest
from rig.run.supervisor import Supervisor
from rig.run.torque_review import TorqueReview, TorqueState, heat_integral
from rig.run.trips import UNKNOWN_RULE, Trip, rule_of
from rig.trial.drill.rigs import drilled_rig
from tests.rig.fake_rig import FakeRig, ListRun, parts_of, planned_of

HOLD = (Ramp(20.0, 500.0), HoldTime(0.8), Ramp(0.0, 500.0))


def run_with(rig: FakeRig, block: int = 50, **more: object) -> tuple[ListRun, RunReport]:
    run = ListRun()
    return run, execute(parts_of(planned_of(*HOLD), rig, Path(), block), lambda *_: run, **more)  # type: ignore[arg-type]


@pytest.mark.parametrize("cuts", [1, 7, 5000])
def test_heat_does_not_depend_on_how_the_run_is_cut(cuts: int) -> None:
    load = np.random.default_rng(1).uniform(0.0, 2.0, 10_000)
    expected, heat = [], 0.3
    for value in load:
        heat += (value - heat) * -np.expm1(-1e-3 / 3.0)
        expected.append(heat)
    found, before = [], 0.3
    for start in range(0, len(load), cuts):
        part = heat_integral(before, load[start : start + cuts], 1e-3 / 3.0)
        before = float(part[-1])
        found.append(part)
    assert np.allclose(np.concatenate(found), expected, rtol=1e-9)


def test_a_torque_that_hums_about_the_right_mean_is_an_event_and_then_a_trip() -> None:
    review, state = TorqueReview(Watch(), 0.637, 1e-3), TorqueState()
    hum = 0.1 + 0.3 * np.sin(2.0 * np.pi * np.arange(250) / 20.3)
    state, trips, notes = review.compared(state, hum, np.full(250, 0.1), 0)
    assert (trips, notes[0][0]) == ([], "torque-disagreement")
    state, trips, _ = review.compared(state, hum, np.full(250, 0.1), 250)
    assert trips[0].cause == "torque_disagreement"
    calm = TorqueState()
    for start in range(0, 2000, 250):
        calm, trips, notes = review.compared(calm, np.full(250, 0.11), np.full(250, 0.1), start)
        assert (trips, notes) == ([], ())
    assert calm.share < 0.5


def disagreements(port: np.ndarray, drive: np.ndarray, watch: Watch, block: int) -> list[int]:
    """The rows at which port and drive (n,) [N m], reviewed in blocks of cycles of 1 ms, are said to disagree."""
    review, state, rows = TorqueReview(watch, 0.637, 1e-3), TorqueState(), list[int]()
    for start in range(0, len(port), block):
        part = slice(start, start + block)
        state, trips, _ = review.compared(state, port[part], drive[part], start)
        rows += [trip.row for trip in trips if trip.cause == "torque_disagreement"]
    return rows


def swinging(frequency: float, lag: float) -> tuple[np.ndarray, np.ndarray]:
    """A torque about 0.25 N m that swings by 0.4 N m (n,), and what a port of that time constant [s] shows of it."""
    swing = 0.4 * np.exp(2j * np.pi * frequency * 1e-3 * np.arange(3000))
    return 0.25 + swing.imag, 0.25 + (swing / (1.0 + 2j * np.pi * frequency * lag)).imag


@pytest.mark.parametrize("frequency", [20.3, 80.3, 150.3, 400.3])
@pytest.mark.parametrize("lag", [0.5e-3, 2e-3])
def test_a_port_that_lags_behind_a_torque_that_swings_is_right(
    frequency: float, lag: float
) -> None:
    drive, port = swinging(frequency, lag)
    assert not disagreements(port, drive, Watch(), 50)


def test_it_is_the_lag_that_is_allowed_for_and_no_more() -> None:
    drive, port = swinging(150.3, 2e-3)
    assert disagreements(port, drive, Watch(torque_lag=0.0), 50)
    # The same lag twenty times as long, behind a torque that swings slowly.
    drive, port = swinging(4.3, 40e-3)
    assert disagreements(port, drive, Watch(), 50)


@pytest.mark.parametrize("gain", [-1.0, 0.0, 0.3, 2.0])
@pytest.mark.parametrize("block", [7, 50, 250])
def test_a_swing_hides_no_wrong_gain(gain: float, block: int) -> None:
    drive, port = swinging(150.3, 2e-3)
    (first, *_) = disagreements(gain * port, drive, Watch(), block)
    assert first < 500 + 2 * block


def test_a_torque_that_hums_beside_one_that_swings_is_seen() -> None:
    drive, port = swinging(80.3, 1e-3)
    hum = 0.8 * np.sin(2.0 * np.pi * 50e-3 * np.arange(len(port)))
    assert disagreements(hum, drive, Watch(), 50)
    assert not disagreements(port, drive, Watch(), 50)


@pytest.mark.parametrize("block", [1, 7])
def test_a_port_that_stands_is_held_against_all_that_the_drive_did_meanwhile(block: int) -> None:
    watch = Watch(torque_still_share=0.1, torque_still_time=0.05, torque_settling=0.02)
    review, state, causes = TorqueReview(watch, 1.0, 1e-3), TorqueState(), list[str]()
    drive = np.full(100, 0.3)
    # The drive's torque dips for two cycles: the port did not follow, whatever block the dip was in.
    drive[10:12] = 0.1
    for start in range(0, len(drive), block):
        part = drive[start : start + block]
        state, found, _ = review.compared(state, np.full(len(part), 0.3), part, start)
        causes += [trip.cause for trip in found]
    assert trips.TORQUE_FROZEN in causes


@pytest.mark.parametrize("block", [7, 50])
def test_a_clock_that_was_there_and_is_lost_trips_but_a_host_clock_does_not(block: int) -> None:
    def lose(rig: FakeRig) -> None:
        rig.physics.flags = int(CycleFlag.HOST_TIME)

    _, report = run_with(FakeRig(script={500: lose}), block=block)
    assert report.trip is not None
    assert report.trip.cause == "time_base"
    always = FakeRig()
    lose(always)
    _, report = run_with(always)
    assert report.outcome == "COMPLETED"


@dataclass
class Told:
    """An event of a device."""

    time_ns: int
    level: str
    code: str
    source: str
    text: str


class TalkingRig(FakeRig):
    """A rig whose devices tell something at a cycle."""

    at = 500

    def __post_init__(self) -> None:
        super().__post_init__()
        self.abilities = Abilities(events=self.told)

    def told(self) -> list[Told]:
        if self.physics.cycle < self.at:
            return []
        self.at = 10**9
        return [Told(123, "error", "emcy", "node 1", "0x4310 drive temperature")]


def test_what_devices_tell_is_in_the_file_at_its_own_time() -> None:
    run, report = run_with(TalkingRig())
    (event,) = [event for event in run.events if event.code == "emcy"]
    assert (event.text, event.source) == ("0x4310 drive temperature", "node 1")
    assert event.time_ns % 10**9 == 123
    assert "0x4310 drive temperature" in report.warnings


def test_a_cause_that_only_the_port_knows_is_made_safe_all_the_same() -> None:
    trip = Trip("gremlins", 3, float("nan"), float("nan"))
    assert rule_of("gremlins") is UNKNOWN_RULE
    assert trip.action is UNKNOWN_RULE.action
    assert "TRIPPED gremlins" in str(trip)


def test_how_near_every_limit_came_is_told_live_and_in_the_report() -> None:
    seen: list[Progress] = []
    _, report = run_with(FakeRig(), on_progress=seen.append)
    expected = {
        lim.INPUT_SPEED,
        lim.MOTOR_TORQUE,
        lim.TORSION_TORQUE,
        lim.RMS_TORQUE,
        lim.HOUSING_TEMPERATURE,
        margins.OUTPUT_SPEED,
        margins.TRAVEL,
        margins.FOLLOWING,
        margins.STALE,
        margins.MISSED,
        margins.DIFFERENCE,
    }
    assert expected == set(report.margins)
    for found in report.margins.values():
        assert found["margin"] == pytest.approx(1.0 - found["peak"] / found["limit"])
        assert found["margin"] > 0.0
    nearest = min(report.margins, key=lambda name: report.margins[name]["margin"])
    assert seen[-1].nearest == nearest
    assert seen[-1].margin == pytest.approx(report.margins[nearest]["margin"])
    assert report.margins[margins.OUTPUT_SPEED]["peak"] == pytest.approx(20.0, rel=0.2)
    assert report.margins[lim.HOUSING_TEMPERATURE]["peak"] == pytest.approx(25.0)


@pytest.mark.parametrize("lost", [1, 3])
def test_the_longest_run_of_lost_cycles_is_kept(lost: int) -> None:
    def flag(value: int) -> Callable[[FakeRig], None]:
        return lambda rig: setattr(rig.physics, "flags", value)

    rig = FakeRig(script={500: flag(int(CycleFlag.INCOMPLETE)), 500 + lost: flag(0)})
    _, report = run_with(rig)
    assert report.outcome == "COMPLETED"
    assert report.margins[margins.STALE]["peak"] == lost


@dataclass(frozen=True)
class TwoHandledRig(AssembledRig):
    """A rig with a second handle on its bus."""

    second_bus: Callable[[], object] = object


def test_the_watchdog_stops_the_drive_over_its_own_bus_without_the_loop() -> None:
    rig = drilled_rig("wire", shipped_gear(), shipped_motor(), (), StopRequest(), 0)
    assert rig.bench is not None
    port, bench = rig.port, rig.bench
    two_handled = TwoHandledRig(
        name="wire", port=port, clock=rig.clock, real_time=True, second_bus=bench.bus
    )
    handle = handle_of(two_handled)
    watchdog = watchdog_of(two_handled, handle, 20)
    assert handle is not None
    assert watchdog is not None
    port.open()
    handle.open()
    port.exchange(Command(Mode.SPEED, np.full(150, 20.0)), 150, Guard())
    assert bench.plant.input_speed == pytest.approx(20.0, rel=0.1)
    watchdog._quick_stop()
    for _ in range(10):
        port.exchange(Command(Mode.SPEED, np.full(1, 20.0)), 1, Guard())
        if bench.drive.drive_state.value != "operation enabled":
            break
    assert bench.drive.drive_state.value in ("quick stop active", "switch on disabled")
    watchdog.stop()
    port.close()


def test_a_rig_without_a_second_handle_has_no_watchdog() -> None:
    rig = FakeRig()
    handle = handle_of(AssembledRig(name="fake", port=rig, clock=rig.clock, real_time=True))
    assert handle is None
    assert watchdog_of(AssembledRig(name="fake", port=rig, clock=rig.clock), handle, 20) is None


PERIOD_NS = 1_000_000


def reviewed(
    time_ns: np.ndarray, sync_ns: np.ndarray | None, modes: tuple[Mode, Mode]
) -> Trip | None:
    """The trip of two blocks at standstill whose SYNCs were at these times, in two modes."""
    rig, state = FakeRig(), None
    watcher = Supervisor(rig.channels, PERIOD_NS, planned_of(*HOLD).limits, None)
    half = len(time_ns) // 2
    for mode, part in zip(modes, (slice(0, half), slice(half, None)), strict=True):
        rows = len(time_ns[part])
        target = np.empty(0) if mode is Mode.OFF else np.zeros(rows)
        turn = Turn(Command(mode, target), rows, enabled=mode is not Mode.OFF)
        block = SampleBlock(
            part.start,
            time_ns[part],
            np.zeros((rows, len(rig.channels)), dtype=np.int64),
            np.zeros(rows, dtype=np.uint16),
            sync_ns=None if sync_ns is None else sync_ns[part],
        )
        state = watcher.review(block, turn)
    return state


@pytest.mark.parametrize("at", [20, 50])
@pytest.mark.parametrize("stamps_late_ns", [0, 3_000_000])
def test_a_computer_that_was_late_is_a_late_turn_and_a_clock_that_jumped_is_not(
    at: int, stamps_late_ns: int
) -> None:
    regular = np.arange(100, dtype=np.int64) * PERIOD_NS + 10**9
    late = regular.copy()
    late[at:] += 150 * PERIOD_NS
    speeds = (Mode.SPEED, Mode.SPEED)
    found = reviewed(late + stamps_late_ns, late, speeds)
    assert found is not None
    assert (found.cause, found.row, found.value, found.limit) == (trips.LATE_TURN, at, 151.0, 100.0)
    assert "Stop other programs on this computer" in str(found)
    found = reviewed(late, regular, speeds)
    assert found is not None
    assert (found.cause, found.row) == (trips.TIME_BASE, at)
    # Who has no time of sending has the stamps alone; where the mode changes the SYNC may stand.
    found = reviewed(late, None, speeds)
    assert found is not None
    assert found.cause == trips.TIME_BASE
    assert reviewed(late, late, (Mode.OFF, Mode.OFF)) is None
    assert (reviewed(late, late, (Mode.SPEED, Mode.TORQUE)) is None) == (at == 50)


def test_the_speed_that_is_followed_is_over_the_time_between_the_syncs() -> None:
    # Stamps of reception that come in bunches: by them 40 rad/s would be anything.
    rig = FakeRig()
    watcher = Supervisor(rig.channels, PERIOD_NS, planned_of(*HOLD).limits, None)
    angle = [c.name for c in rig.channels].index("input_angle")
    sync = np.arange(2000, dtype=np.int64) * PERIOD_NS
    received = sync // (60 * PERIOD_NS) * (60 * PERIOD_NS) + np.arange(2000)
    counts = np.zeros((2000, len(rig.channels)), dtype=np.int64)
    counts[:, angle] = np.rint(20.0 * sync * 1e-9 / rig.channels[angle].scale)
    turn = Turn(Command(Mode.SPEED, np.full(2000, 20.0)), 2000, enabled=True)
    block = SampleBlock(0, received, counts, np.zeros(2000, dtype=np.uint16), sync_ns=sync)
    assert watcher.review(block, turn) is None
    assert watcher.state.following.longest == 0
    assert watcher.margins()["input_speed"]["peak"] == pytest.approx(20.0, rel=0.01)
