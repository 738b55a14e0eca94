"""A servo amplifier on another CANopen stack, in front of the simulated plant: the whole rig runs with it, stops it
and is stopped by it.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import pytest
from durand.services.nmt import StateEnum

from drivers.bus.cia301 import U8, U32
from drivers.bus.cia402.plausible import counts_per_revolution, velocity_unit
from drivers.bus.cia402.tables import OperationMode
from drivers.bus.cyclic import CanRig, CanRigConfig
from drivers.bus.dictionary.device_file import read_device_file
from drivers.bus.discover import discover
from drivers.channel import INPUT_ANGLE, OUTPUT_ANGLE, TORQUE
from drivers.errors import DriverError, OtherMasterError
from drivers.event import Event
from drivers.port import STALE_DATA, Command, DriveLimits, Guard, Mode
from drivers.samples import SampleBlock
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from model.units import REVOLUTION, RPM
from rig.bench.backends.simulated import wire_config
from rig.trial.doctor.discover.proposal import Bus, propose
from rig.trial.drill import rigs
from rig.trial.drill.catalogue import every_drill
from rig.trial.drill.staging import Placed
from rig.trial.drill.suite import row_of, stage
from sim_backend.wire import faults as wire
from tests.drivers.amplifier import CYCLIC_POSITION, CYCLIC_TORQUE, Power
from tests.drivers.can_bench import servo
from tests.drivers.durand_drive import DurandBench, DurandDrive
from tests.drivers.durand_node import COMMUNICATION_ERROR, HEARTBEAT_ERROR

GEAR, MOTOR = shipped_gear(), shipped_motor()
LIMITS = DriveLimits(1.0, 300.0, 1000.0, 1000.0, 500.0)
SPEED = 600.0 * RPM
PRE_OPERATIONAL, STOPPED, START = 0x80, 0x02, 0x01


@dataclass
class Made:
    bench: DurandBench
    port: CanRig
    told: list[Event]

    @property
    def drive(self) -> DurandDrive:
        return self.bench.amplifier

    def open(self) -> None:
        self.port.open()
        self.port.write_limits(LIMITS)

    def exchange(
        self, mode: Mode, value: float = 0.0, cycles: int = 40, guard: Guard | None = None
    ) -> SampleBlock:
        target = np.full(cycles, value) if mode in (Mode.SPEED, Mode.TORQUE) else np.empty(0)
        return self.port.exchange(Command(mode, target), cycles, guard or Guard())

    def column(self, block: SampleBlock, name: str) -> np.ndarray:
        at = [channel.name for channel in self.port.channels].index(name)
        return self.port.channels[at].to_si(block.counts[:, at])

    def codes(self) -> set[str]:
        self.told += self.port.abilities.events() if self.port.abilities.events else []
        return {event.code for event in self.told}

    def let_time_pass(self, seconds: float) -> None:
        """The computer does nothing; devices and plant go on."""
        for _ in range(round(seconds * 1e3)):
            self.bench.clock.wait_until_ns(self.bench.clock.monotonic_ns() + 1_000_000)
            self.bench.elapse()

    def stands(self) -> bool:
        return abs(self.bench.input_speed) < 0.01 and not self.bench.is_powered


@contextlib.contextmanager
def rig(**drive: Any) -> Iterator[Made]:
    """The drivers before a bench with this drive, closed in the end; then the motor stands without power."""
    bench = DurandBench(GEAR, MOTOR)
    usual = wire_config(bench, MOTOR)
    config: CanRigConfig = replace(usual, drive=replace(usual.drive, **drive))
    port = CanRig(
        config, bench.clock, bench.bus, pump=bench.pump, time_base="hardware", origin="simulated"
    )
    made = Made(bench, port, [])
    yield made
    port.close()
    made.let_time_pass(0.05)
    assert made.stands()
    assert made.drive.od.read(0x1016, 1) == 0


# Bringing up --------------------------------------------------------------------------------------------------------

LEFT = [
    *((power, StateEnum.OPERATIONAL) for power in Power if power is not Power.NOT_READY),
    (Power.ENABLED, StateEnum.PRE_OPERATIONAL),
    (Power.DISABLED, StateEnum.PRE_OPERATIONAL),
    (Power.ENABLED, StateEnum.STOPPED),
]


@pytest.mark.parametrize(("power", "nmt"), LEFT, ids=lambda value: value.name)
def test_it_is_brought_up_from_whatever_state_another_master_left_it_in(
    power: Power, nmt: StateEnum
) -> None:
    with rig() as made:
        drive = made.drive
        drive.stack.nmt.set_state(nmt)
        drive.put(power, speed=SPEED)
        made.let_time_pass(0.1)
        turned = made.bench.input_speed
        assert (turned > 0.9 * SPEED) == (power is Power.ENABLED)
        made.open()
        assert (drive.power, drive.nmt) == (Power.DISABLED, StateEnum.OPERATIONAL)
        assert made.stands()
        assert not made.exchange(Mode.OFF, cycles=5).flags.any()
        # The shaft that turned was quick-stopped, and nothing was enabled on the way.
        assert ("found-enabled" in made.codes()) == (power is Power.ENABLED)
        assert ("found-faulted" in made.codes()) == (power in (Power.FAULT, Power.REACTION))
        assert 0x0F not in drive.words
        block = made.exchange(Mode.SPEED, SPEED)
        assert (block.broken, drive.power) == (None, Power.ENABLED)


def test_a_drive_that_is_not_ready_is_waited_for_and_then_refused() -> None:
    with rig(state_timeout_ms=200) as made:
        made.drive.put(Power.NOT_READY)
        with pytest.raises(DriverError, match="does not reach servo off; value not ready"):
            made.port.open()


def test_a_sync_that_the_drive_produces_is_switched_off() -> None:
    with rig() as made:
        made.drive.od.write(0x1006, 0, 2000)
        made.drive.od.write(0x1005, 0, 0x4000_0080)
        made.open()
        assert made.drive.od.read(0x1005, 0) == 0x80
        assert "sync-producer" in made.codes()
        block = made.exchange(Mode.SPEED, SPEED, 200)
        assert (block.broken, block.flags.any()) == (None, False)


def test_a_sync_of_somebody_else_is_refused_before_anything_is_written() -> None:
    with rig() as made:
        timers = made.drive.timers

        def beat() -> None:
            made.bench.answer(0x080, b"")
            timers.add(2e-3, beat)

        beat()
        with pytest.raises(OtherMasterError, match="SYNC"):
            made.port.open()
        assert not made.drive.words


# Turning ------------------------------------------------------------------------------------------------------------


def test_speeds_torques_and_angles_mean_what_they_say() -> None:
    with rig() as made:
        made.open()
        assert asdict(made.drive.limits()) == pytest.approx(asdict(LIMITS), rel=1e-3)
        assert (made.drive.od.read(0x60C2, 1), made.drive.od.read(0x60C2, 2)) == (1, -3)
        block = made.exchange(Mode.SPEED, SPEED, 700)
        late = slice(300, None)
        seconds = (block.time_ns[-1] - block.time_ns[late][0]) * 1e-9
        turned = made.column(block, INPUT_ANGLE)
        # The position passes the end of its 32 bits on the way.
        assert made.drive.od.read(0x6064, 0) < 0
        assert (turned[-1] - turned[late][0]) / seconds == pytest.approx(SPEED, rel=2e-3)
        out = made.column(block, OUTPUT_ANGLE)[late]
        ratio = (turned[-1] - turned[late][0]) / abs(out[-1] - out[0])
        assert ratio == pytest.approx(GEAR.mounted_ratio("circular-spline-fixed"), rel=5e-3)
        torque = made.column(block, TORQUE)[late].mean()
        drive_torque = made.column(block, "drive_torque")[late].mean()
        assert drive_torque == pytest.approx(torque, abs=0.01)
        assert drive_torque > 0.01
        made.exchange(Mode.OFF, cycles=600)
        before = made.bench.input_speed
        pushed = made.exchange(Mode.TORQUE, 0.35, 60)
        assert made.drive.od.read(0x6061, 0) == CYCLIC_TORQUE
        assert made.drive.od.read(0x6071, 0) == round(0.35 / MOTOR.rated_torque * 1000)
        assert pushed.broken is None
        assert made.bench.input_speed > before + 1.0


def test_the_length_of_a_block_changes_no_count() -> None:
    taken = []
    for block in (150, 7, 1):
        with rig() as made:
            made.open()
            parts = [made.exchange(Mode.SPEED, SPEED, block) for _ in range(150 // block)]
            taken.append(np.concatenate([part.counts for part in parts])[:147])
    assert np.array_equal(taken[0], taken[1])
    assert np.array_equal(taken[0], taken[2])


def test_a_quick_stop_goes_down_its_ramp_and_the_power_with_it() -> None:
    with rig() as made:
        made.open()
        made.exchange(Mode.SPEED, SPEED, 300)
        ramp = round(SPEED / LIMITS.quick_stop_deceleration * 1e3)
        made.exchange(Mode.QUICK_STOP, cycles=ramp // 2)
        assert made.bench.input_speed == pytest.approx(SPEED / 2, rel=0.1)
        assert made.drive.power is Power.QUICK_STOP
        made.exchange(Mode.QUICK_STOP, cycles=ramp // 2 + 60)
        assert made.drive.power is Power.DISABLED


def test_a_drive_that_stays_in_quick_stop_holds_until_it_is_let_go() -> None:
    with rig(quick_stop_option=6) as made:
        made.open()
        made.exchange(Mode.SPEED, SPEED, 200)
        made.exchange(Mode.QUICK_STOP, cycles=200)
        assert made.drive.power is Power.QUICK_STOP
        assert abs(made.bench.input_speed) < 0.01
        made.exchange(Mode.OFF)
        assert made.drive.power is Power.DISABLED


def test_a_fault_ends_the_block_stays_until_it_is_acknowledged_and_then_is_gone() -> None:
    with rig() as made:
        made.open()
        made.exchange(Mode.SPEED, SPEED, 100)
        made.drive.fault(0x7305)
        block = made.exchange(Mode.SPEED, SPEED)
        assert block.broken is not None
        assert block.broken.cause == "emcy"
        assert any("0x7305" in event.text for event in made.port.segment.events())
        made.exchange(Mode.OFF, cycles=200)
        assert made.drive.power is Power.FAULT
        with pytest.raises(DriverError, match="0x7305"):
            made.exchange(Mode.SPEED, SPEED)
        assert made.drive.power is Power.FAULT
        made.exchange(Mode.OFF)
        made.port.reset_fault()
        assert made.drive.power is Power.DISABLED
        assert made.exchange(Mode.SPEED, SPEED, 100).broken is None


# Led by target positions --------------------------------------------------------------------------------------------


def by_position(**drive: Any) -> contextlib.AbstractContextManager[Made]:
    return rig(**drive, speed_modes=(OperationMode.CYCLIC_POSITION,))


def test_it_is_led_by_target_positions_over_the_end_of_their_32_bits() -> None:
    with by_position() as made:
        made.open()
        ramp = np.minimum(np.arange(1, 401) * 0.5, SPEED)
        assert made.port.exchange(Command(Mode.SPEED, ramp), 400, Guard()).broken is None
        assert made.drive.od.read(0x6061, 0) == CYCLIC_POSITION
        block = made.exchange(Mode.SPEED, SPEED, 300)
        assert (block.broken, block.flags.any()) == (None, False)
        assert made.drive.od.read(0x607A, 0) < 0, "the target has passed the end of its 32 bits"
        turned = made.column(block, INPUT_ANGLE)
        seconds = (block.time_ns[-1] - block.time_ns[0]) * 1e-9
        assert (turned[-1] - turned[0]) / seconds == pytest.approx(SPEED, rel=2e-3)
        stop = made.port.exchange(Command(Mode.SPEED, ramp[::-1]), 400, Guard())
        assert stop.broken is None
        made.exchange(Mode.SPEED, 0.0, 300)
        assert abs(made.bench.input_speed) < 0.2


def test_a_shaft_that_coasts_while_the_drive_is_enabled_is_not_pulled_back() -> None:
    """Its intermediate circuit and its brake take 19 ms; the shaft turns on in them."""
    with by_position() as made:
        made.open()
        made.exchange(Mode.TORQUE, 0.5, 300)
        speed = made.bench.input_speed
        assert speed > 20.0
        # As a run is brought to rest out of torque: from the speed that was measured.
        pulled: list[float] = []
        position = made.drive.od.read(0x6064, 0)
        made.drive.od.update_callbacks[(0x607A, 0)].add(
            lambda target: pulled.append(_apart(target, made.drive.od.read(0x6064, 0)))
        )
        block = made.port.exchange(Command(Mode.SPEED, np.full(50, speed)), 50, Guard())
        assert block.broken is None
        coasted = _apart(made.drive.od.read(0x6064, 0), position)
        per_cycle = speed * 1e-3 / REVOLUTION * made.drive.device.counts_per_revolution
        assert coasted > 60 * per_cycle, "it has turned on while it was being enabled"
        assert len(pulled) > 50 + 15, "the target went with it"
        assert max(map(abs, pulled)) < 4.0 * per_cycle
        gone = np.diff(made.column(block, INPUT_ANGLE)) / 1e-3
        assert gone.min() > 0.5 * speed


def test_after_a_fault_it_is_led_from_where_it_stands() -> None:
    with by_position() as made:
        made.open()
        made.exchange(Mode.SPEED, 20.0, 100)
        made.drive.fault(0x7305)
        made.exchange(Mode.SPEED, 20.0)
        made.exchange(Mode.OFF, cycles=300)
        made.port.reset_fault()
        # Somebody turns the shaft.
        made.drive.od.write(0x607A, 0, 12345)
        made.exchange(Mode.SPEED, 0.0, 60)
        assert made.drive.power is Power.ENABLED
        assert _apart(made.drive.od.read(0x607A, 0), made.drive.od.read(0x6064, 0)) == 0
        assert abs(made.bench.input_speed) < 0.2


@pytest.mark.parametrize(
    ("low", "high", "is_taken"),
    [
        (0, 0, True),
        (-(1 << 31), (1 << 31) - 1, True),
        (-1_000_000_000, 1_000_000_000, False),
        (0, (1 << 31) - 1, False),
        (0, 32_767, False),
    ],
)
@pytest.mark.parametrize("index", [0x607B, 0x607D])
def test_a_position_that_ends_elsewhere_than_32_bits_do_is_refused(
    index: int, low: int, high: int, is_taken: bool
) -> None:
    with by_position() as made:
        made.drive.od.write(index, 1, low)
        made.drive.od.write(index, 2, high)
        if is_taken:
            made.open()
        else:
            with pytest.raises(DriverError, match=f"0x{index:04X}"):
                made.port.open()
            made.drive.put(Power.DISABLED)


def _apart(target: int, position: int) -> int:
    return (target - position + (1 << 31)) % (1 << 32) - (1 << 31)


# Who watches whom ---------------------------------------------------------------------------------------------------


def test_without_the_computer_the_drive_stops_by_itself() -> None:
    with rig() as made:
        made.open()
        made.exchange(Mode.SPEED, SPEED, 200)
        heard: list[tuple[int, bytes]] = []
        made.bench.listen(made, lambda cob_id, data, _stamp: heard.append((cob_id, data)))
        made.let_time_pass(0.2)
        assert made.bench.input_speed > 0.9 * SPEED
        made.let_time_pass(0.06 + SPEED / LIMITS.quick_stop_deceleration + 0.05)
        assert made.stands()
        told = HEARTBEAT_ERROR.to_bytes(2, "little") + bytes([COMMUNICATION_ERROR])
        assert [data[:3] for cob_id, data in heard if cob_id == 0x81] == [told]
        assert made.drive.nmt is StateEnum.PRE_OPERATIONAL
        assert made.exchange(Mode.SPEED, SPEED).broken is not None
        assert made.stands()


def test_a_drive_whose_heartbeat_stays_away_is_noticed() -> None:
    with rig() as made:
        made.open()
        made.exchange(Mode.SPEED, SPEED, 100)
        made.bench.inject(wire.HeartbeatLost(made.bench.cycle, 1))
        block = made.exchange(Mode.SPEED, SPEED, 400)
        assert block.broken is not None
        assert block.broken.cause == "heartbeat_lost"
        assert 200 <= len(block) <= 310


def test_a_drive_that_restarts_in_motion_has_forgotten_everything_and_is_not_trusted() -> None:
    with rig() as made:
        made.open()
        made.exchange(Mode.SPEED, SPEED, 100)
        made.drive.restart(made.bench.clock.monotonic_ns())
        assert made.drive.od.read(0x1A00, 0) == 0
        block = made.exchange(Mode.SPEED, SPEED)
        assert block.broken is not None
        assert (block.broken.cause, block.broken.row) == ("boot_up", 0)
        with pytest.raises(DriverError, match="the node has restarted"):
            made.exchange(Mode.SPEED, SPEED)
        made.drive.words.clear()
        made.port.close()
        assert 0x0F not in made.drive.words
        made.open()
        assert made.exchange(Mode.SPEED, SPEED, 200).broken is None
        assert made.bench.input_speed > 0.9 * SPEED


@pytest.mark.parametrize(
    ("command", "reacts"), [(PRE_OPERATIONAL, False), (STOPPED, True), (STOPPED, False)]
)
def test_taken_out_of_operational_by_another_master_it_is_stopped_all_the_same(
    command: int, reacts: bool
) -> None:
    """CiA 402 lets it turn on in PRE-OPERATIONAL, deaf for process data; STOPPED is a lost connection (0x6007), and
    a node in it answers no SDO before it is woken.
    """
    with rig() as made:
        made.open()
        made.exchange(Mode.SPEED, SPEED, 100)
        made.drive.od.write(0x6007, 0, 3 if reacts else 0)
        made.drive.receive(0x000, bytes([command, 1]), made.bench.clock.monotonic_ns())
        assert (made.drive.power is Power.QUICK_STOP) == reacts
        # Its process data are missed at once; its next heartbeat says why.
        block = made.exchange(Mode.SPEED, SPEED, 60, Guard((), 5))
        assert block.broken is not None
        assert (block.broken.cause, block.broken.row) == ("stale_data", 4)
        assert "not-operational" not in made.codes()
        made.exchange(Mode.QUICK_STOP, cycles=100)
        assert "not-operational" in made.codes()
        assert (made.bench.input_speed > 0.9 * SPEED) != reacts
        made.drive.words.clear()
        made.port.close()
        made.let_time_pass(0.1)
        assert made.stands()
        assert 0x0F not in made.drive.words


# The whole program --------------------------------------------------------------------------------------------------

DRILLED = (
    every_drill()["node reset in motion, drive"],
    # Its heartbeat comes every 0.1 s: that its process data stay away is seen before it.
    replace(every_drill()["NMT PRE-OPERATIONAL from outside"], cause=STALE_DATA),
    # It has no profile torque.
    replace(
        every_drill()["mode changed by another master"],
        fault=lambda at: wire.ModeFromOutside(at, CYCLIC_TORQUE),
    ),
)


def test_runs_with_it_end_as_they_must(monkeypatch: pytest.MonkeyPatch) -> None:
    """Order, session, supervisor, making safe and run file; the run with nothing going wrong is one of them."""
    monkeypatch.setattr(rigs, "WireBench", DurandBench)
    with stage(seed=3) as staged:
        sound = staged.reference("wire")
        assert sound.outcome == "COMPLETED"
        for drill in DRILLED:
            at = Placed(drill, sound.rows[drill.moment])
            row = row_of(drill, "wire", staged.run(drill.name, "wire", (at,)), sound.outcome)
            assert row.passed, row
            assert (row.outcome, row.verified) == ("TRIPPED", True)


# An unknown bus -----------------------------------------------------------------------------------------------------


def test_it_is_discovered_by_asking_and_nothing_is_asked_that_it_states() -> None:
    with rig() as made:
        drive, bench = made.drive, made.bench
        before = {key: drive.od.read(*key) for key, variable in drive._variables()}
        nodes = discover(bench.bus(), bench.clock, bench.pump)
        assert {key: drive.od.read(*key) for key in before} == before
        assert drive.nmt is StateEnum.PRE_OPERATIONAL
        assert [node.profile for node in nodes] == [402, 406, 401]
        proposal = propose(nodes, Bus("socketcan", "can0", 1_000_000), "bcdf-2345")
        assert not [word for word, _ in proposal.questions if word.startswith("[drive]")]
        told, counts = nodes[0].statement, drive.device.counts_per_revolution
        assert counts_per_revolution(told) == counts
        assert velocity_unit(told, counts) == pytest.approx(REVOLUTION / counts)
        made.open()
        assert servo(made.port.nodes).readings.velocity_unit == pytest.approx(REVOLUTION / counts)


def test_it_is_not_discovered_while_it_has_power() -> None:
    with rig() as made:
        made.drive.put(Power.ENABLED)
        with pytest.raises(OtherMasterError, match="this drive has power"):
            discover(made.bench.bus(), made.bench.clock, made.bench.pump)
        assert made.drive.power is Power.ENABLED
        made.drive.put(Power.DISABLED)


# What the stack tells of itself --------------------------------------------------------------------------------------


def test_the_device_file_that_the_stack_writes_of_itself_is_read_as_the_node_is() -> None:
    """25 kB in segments out of 0x1021, arrays and records taken for each other in it."""
    with rig() as made:
        made.open()
        client = made.port.nodes.drive.device.sdo
        text = client.upload(0x1021, 0)
        assert text == made.drive.stack.eds.content.encode()
        described = read_device_file(text, 1)
        for key, variable in made.drive._variables():
            entry = described.entry(*key)
            assert entry is not None, key
            if variable.size is not None:
                assert (entry.data_type.code, entry.data_type.size) == (
                    variable.datatype,
                    variable.size,
                )
        assert client.read_as(0x1A00, 0, U8) == 3
        assert client.read_as(0x608F, 1, U32) == round(REVOLUTION / made.port.channels[0].scale)
