"""Make-safe over a bus that misbehaves, by the plant's truth: which channel is used, how soon the power is off, and
that nothing enables again.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import pytest

from drivers.drive_state import POWERED_STATES, DriveState
from drivers.port import DriveLimits, Guard, Mode
from drivers.python_can import can
from drivers.samples import Break
from experiments.steps.profile import Constant
from experiments.steps.vocabulary import SegmentLabel
from model.units import RPM
from rig.run.make_safe import Action, MakeSafe, MakeSafeReport, Patience
from rig.run.phases import Machine, Phase, PhaseRunner, Phases
from sim_backend.faults import Fault
from sim_backend.wire import faults as wire
from sim_backend.wire.bench import COUNTER_NODE, DRIVE_NODE, WireBench
from sim_backend.wire.line import BenchBus, Frame, WireFault
from sim_backend.wire.slave import NmtState
from tests.sim_backend.wire.rigs import wire_rig

SPEED = 298.0 * RPM
DECELERATION = 200.0
LIMITS = DriveLimits(1.0, 300.0, 2000.0, 2000.0, DECELERATION)
RAMP = SPEED / DECELERATION
WINDOW = Patience().window
BOUND = RAMP + WINDOW + 0.1
"""s from the trip to power off, wherever the drive answers SDO."""
HEARTBEAT = 0.1
"""s until a node has said that it is STOPPED."""
ONSET = 200
"""The cycle of the fault."""
QUICK_STOP, SERVO_OFF, ENABLE = 0x02, 0x00, 0x0F
PRE_OPERATIONAL, STOPPED, START = 0x80, 0x02, 0x01


@dataclass(frozen=True)
class Truth(WireFault):
    """Not a fault: looks at the plant at every SYNC that the computer sends."""

    rows: list[tuple[int, float, DriveState]] = field(default_factory=list)

    def act(self, bench: WireBench, cycle: int) -> None:
        now = bench.clock.monotonic_ns()
        self.rows.append((now, bench.plant.input_speed, bench.drive.drive_state))


@dataclass
class Story:
    """What happened: the trip, the plant at every SYNC, every frame that the computer sent, and the report."""

    trip: Break
    trip_ns: int
    truth: list[tuple[int, float, DriveState]]
    sent: list[tuple[int, int, bytes]]
    report: MakeSafeReport
    nmt: NmtState

    def after(self) -> list[tuple[int, float, DriveState]]:
        return [row for row in self.truth if row[0] >= self.trip_ns]

    @property
    def power_off(self) -> float:
        """s from the trip until the power was off for good."""
        on = [now for now, _, state in self.after() if state in POWERED_STATES]
        return (max(on, default=self.trip_ns) - self.trip_ns) * 1e-9

    def told_by_sdo(self) -> list[tuple[int, int]]:
        """When and what the drive was told by SDO since the trip, in order and without repetitions."""
        words: list[tuple[int, int]] = []
        for now, cob_id, data in self.sent:
            if now >= self.trip_ns and (cob_id, data[1:3]) == (0x601, b"\x40\x60"):
                word = data[4]
                words += [(now, word)] if not words or words[-1][1] != word else []
        return words

    def told_by_process_data(self) -> list[tuple[int, int]]:
        return [
            (now, d[0]) for now, cob_id, d in self.sent if now >= self.trip_ns and cob_id == 0x201
        ]


class Notes:
    def segment(self, label: SegmentLabel, start: int, stop: int) -> None:
        raise AssertionError("making safe has no segments")

    def event(self, level: str, code: str, source: str, text: str) -> None:
        return


def story(
    *make: Callable[[int], Fault],
    block: int = 20,
    action: Action = Action.QUICK_STOP,
    patience: Patience | None = None,
) -> Story:
    """Turn at 298 r/min until the fault trips the guard, then make safe in blocks of `block` cycles."""
    sent: list[tuple[int, int, bytes]] = []
    truth = Truth(0)

    def tap(bus: BenchBus) -> None:
        send = bus.send

        def noted(msg: can.Message, timeout: float | None = None) -> None:
            sent.append((made.clock.monotonic_ns(), msg.arbitration_id, bytes(msg.data)))
            send(msg, timeout)

        bus.send = noted  # type: ignore[method-assign]

    with wire_rig(is_open=False, tap=tap) as made:
        port, bench = made.port, made.bench
        port.open()
        port.write_limits(LIMITS)
        machine = Machine(port.channels, port.cycle_ns)
        bench.inject(truth, *(fault(ONSET) for fault in make))

        def approach() -> Phases:
            yield Phase(Mode.SPEED, 1000, Constant(SPEED))

        trip = _turn(made, machine, PhaseRunner(approach(), machine, block), Guard((), 5))
        trip_ns = made.clock.monotonic_ns()
        assert trip is not None
        make_safe = MakeSafe(
            action,
            machine,
            Notes(),
            DECELERATION,
            120.0,
            block,
            patience=patience,
            line=port.line,
        )
        _turn(made, machine, make_safe, Guard())
        return Story(
            trip, trip_ns, list(truth.rows), list(sent), make_safe.report, bench.drive.state
        )


def _turn(made, machine: Machine, source: PhaseRunner | MakeSafe, guard: Guard) -> Break | None:
    turn = source.next(None)
    while turn is not None:
        block = made.port.exchange(turn.command, turn.cycles, guard)
        machine.accept(block, turn)
        if block.broken is not None and guard.stale_cycles:
            return block.broken
        turn = source.next(block)
    return None


def by_nmt(*commands: tuple[int, int], node: int = DRIVE_NODE) -> Callable[[int], Fault]:
    return lambda at: wire.NmtFromOutside(at, commands, node, reacts=False)


CASES: dict[str, tuple[Callable[[int], Fault], float]] = {
    "PRE-OPERATIONAL": (by_nmt((0, PRE_OPERATIONAL)), BOUND),
    "all PRE-OPERATIONAL": (by_nmt((0, PRE_OPERATIONAL), node=0), BOUND),
    "STOPPED": (by_nmt((0, STOPPED)), BOUND + HEARTBEAT),
    "all STOPPED": (by_nmt((0, STOPPED), node=0), BOUND + HEARTBEAT),
    "SYNC gone": (wire.SyncLost, BOUND),
    "SYNC back": (lambda at: wire.SyncLost(at, cycles=60), BOUND),
    "SYNC gone, supervised": (wire.SupervisedSyncLost, BOUND),
    "START in the ramp": (by_nmt((0, PRE_OPERATIONAL), (60, START)), BOUND),
    "START at standstill": (by_nmt((0, PRE_OPERATIONAL), (250, START)), BOUND),
    "drive restarts": (lambda at: wire.NodeReset(at, DRIVE_NODE), BOUND),
}


@pytest.fixture(scope="module")
def stories() -> dict[str, Story]:
    return {name: story(fault) for name, (fault, _) in CASES.items()}


@pytest.mark.parametrize("name", CASES)
def test_the_power_is_off_in_time_and_nothing_enables_again(
    name: str, stories: dict[str, Story]
) -> None:
    told = stories[name]
    assert told.report.safe, told.report.problem
    assert told.power_off <= CASES[name][1]
    assert abs(told.after()[-1][1]) < 0.01
    states = [state for _, _, state in told.after()]
    left = next(i for i, state in enumerate(states) if state is not DriveState.ENABLED)
    assert DriveState.ENABLED not in states[left:]
    words = {word for _, word in (*told.told_by_sdo(), *told.told_by_process_data())}
    assert words <= {QUICK_STOP, SERVO_OFF}


@pytest.mark.parametrize("name", ["PRE-OPERATIONAL", "all PRE-OPERATIONAL", "SYNC gone"])
def test_the_quick_stop_goes_by_sdo_in_the_first_cycle_with_the_process_data(
    name: str, stories: dict[str, Story]
) -> None:
    told = stories[name]
    (quick, word), (off, last) = told.told_by_sdo()
    assert (word, last) == (QUICK_STOP, SERVO_OFF)
    assert (quick, QUICK_STOP) == told.told_by_process_data()[0]
    assert quick - told.trip_ns < 1_000_000
    # Power is taken away only from a motor that stands.
    assert abs(next(speed for now, speed, _ in told.truth if now >= off)) < 0.2
    # Answers are judged as soon as they are a window apart, not at the end of the next whole window.
    assert told.power_off <= RAMP + WINDOW + 0.02
    assert told.report.stages == ["quick stop by SDO", "servo off by SDO"]


def test_a_stopped_node_is_woken_and_never_started(stories: dict[str, Story]) -> None:
    told = stories["STOPPED"]
    nmt = [d for now, cob_id, d in told.sent if cob_id == 0 and now >= told.trip_ns]
    assert nmt[0] == bytes([PRE_OPERATIONAL, DRIVE_NODE])
    assert all(d[0] == PRE_OPERATIONAL for d in nmt)
    assert told.nmt is NmtState.PRE_OPERATIONAL


def test_nobody_is_started_whatever_happens(stories: dict[str, Story]) -> None:
    for told in stories.values():
        after = [d for now, cob_id, d in told.sent if cob_id == 0 and now >= told.trip_ns]
        assert START not in {d[0] for d in after}


@pytest.mark.parametrize("name", ["PRE-OPERATIONAL", "all STOPPED"])
def test_block_length_changes_nothing(name: str, stories: dict[str, Story]) -> None:
    fault, told = CASES[name][0], stories[name]
    for block in (1, 7, 100):
        other = story(fault, block=block)
        assert (other.trip.cause, other.trip_ns) == (told.trip.cause, told.trip_ns)
        assert other.truth == told.truth
        assert other.sent == told.sent
        assert other.report == told.report


def test_a_silent_node_delays_nobody(stories: dict[str, Story]) -> None:
    def silent(at: int) -> Fault:
        return wire.NodeSilent(at, COUNTER_NODE)

    patience = Patience(servo_off=1.0)
    told = story(by_nmt((0, PRE_OPERATIONAL)), silent, patience=patience)
    assert told.report.safe
    assert told.report.silent == ("output_angle",)
    assert told.power_off == pytest.approx(stories["PRE-OPERATIONAL"].power_off, abs=0.002)
    for cob_id, longest in ((0x080, 5_000_000), (0x77F, 52_000_000)):
        at = [
            now for now, sent, _ in told.sent if sent == cob_id and now >= told.trip_ns - 20_000_000
        ]
        assert max(b - a for a, b in pairwise(at)) <= longest
    # One request on its way at a time, and the node's own time for each.
    asked = [t for t, cob_id, d in told.sent if (cob_id, d[:1]) == (0x602, b"\x40")]
    times = [t for t in asked if t >= told.trip_ns]
    assert times
    assert all(b - a >= 300_000_000 for a, b in pairwise(times))


def test_at_most_one_request_for_each_node_in_a_cycle(stories: dict[str, Story]) -> None:
    told = stories["all STOPPED"]
    syncs = [now for now, cob_id, _ in told.sent if cob_id == 0x080]
    for node in (DRIVE_NODE, COUNTER_NODE):
        times = [
            now
            for now, cob_id, d in told.sent
            if now >= told.trip_ns and (cob_id == 0x600 + node or (cob_id == 0 and d[1] == node))
        ]
        assert times
        assert set(times) <= set(syncs)
        assert len(set(times)) == len(times)


def test_a_drive_that_answers_nothing_is_said_so_and_the_cycles_go_on() -> None:
    patience = Patience(ramp=0.3, quick_stop=0.3, servo_off=0.6)
    told = story(
        by_nmt((0, PRE_OPERATIONAL)), lambda at: wire.SdoSilent(at, DRIVE_NODE), patience=patience
    )
    assert not told.report.safe
    assert told.report.problem == "the input encoder is silent"
    assert told.report.silent == ("statusword", "input_angle")
    gaps = [b[0] - a[0] for a, b in pairwise(told.after())]
    assert max(gaps) <= 5_000_000
    assert {word for _, word in told.told_by_process_data()} == {QUICK_STOP, SERVO_OFF}


@pytest.mark.parametrize("action", [Action.CONTROLLED_STOP, Action.ZERO_TORQUE])
def test_whatever_the_action_a_deaf_drive_is_stopped_before_its_power_goes(action: Action) -> None:
    told = story(by_nmt((0, PRE_OPERATIONAL)), action=action)
    assert [word for _, word in told.told_by_sdo()] == [QUICK_STOP, SERVO_OFF]
    assert told.power_off <= BOUND


def test_process_data_that_are_heard_and_not_obeyed_are_repeated_by_sdo() -> None:
    def disobeys(at: int) -> Fault:
        return wire.QuickStopNotObeyed(at)

    def trips(at: int) -> Fault:
        return wire.EmergencyMessage(at)

    told = story(disobeys, trips, patience=Patience(quick_stop=0.1, servo_off=0.5))
    assert told.report.safe
    assert told.report.stages == ["quick stop", "servo off by SDO"]
    assert [word for _, word in told.told_by_sdo()] == [SERVO_OFF]
    assert math.isclose(told.truth[-1][1], 0.0, abs_tol=0.01)


@dataclass(frozen=True)
class MappedBlocked(wire.SdoAborted):
    """While it is OPERATIONAL the drive takes no SDO for the controlword, which an RPDO carries."""

    def to_devices(self, frame: Frame, bench: WireBench) -> Sequence[Frame]:
        blocks = bench.drive.state is NmtState.OPERATIONAL
        return super().to_devices(frame, bench) if blocks else (frame,)


def test_a_drive_that_refuses_the_controlword_while_operational_is_taken_out_of_it() -> None:
    told = story(wire.SyncLost, lambda at: MappedBlocked(at, DRIVE_NODE, 0x6040, code=0x06010006))
    assert told.report.safe
    assert told.power_off <= BOUND
    nmt = [d for now, cob_id, d in told.sent if cob_id == 0 and now >= told.trip_ns]
    assert set(nmt) == {bytes([PRE_OPERATIONAL, DRIVE_NODE])}
