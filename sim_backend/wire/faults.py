"""What can go wrong with devices, frames and lines, each from a given SYNC cycle on: for drills and tests.

Faults of the plant and of signals (`sim_backend.faults`: run-away, load, count jump, stuck encoder,
saturated or open torque port, drive trip, stall, bus lost) work on the wire as well; here are those
that only a wire can have. All are values: the same fault at the same cycle of the same seed gives
the same frames. `DRILLS` names one of each.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from drivers import channel as names
from drivers.samples import CycleFlag
from sim_backend.faults import (
    BusLost,
    ChannelFrozen,
    CountJump,
    CountsLost,
    DriveFault,
    Fault,
    MarkedCycles,
    QuickStopIgnored,
    RunAway,
    Sensed,
    SignalFault,
    Stall,
    StuckEncoder,
    ThermometerOpen,
    TorquePortOpen,
    TorquePortSaturated,
    TorqueZeroDrifts,
)
from sim_backend.wire.bench import ANALOG_INPUT_NODE, COUNTER_NODE, DRIVE_NODE, SYNC, WireBench
from sim_backend.wire.dictionary import Abort
from sim_backend.wire.drive import Drive
from sim_backend.wire.line import Frame, WireFault
from sim_backend.wire.readout_faults import (
    ReadoutEncoderFault,
    ReadoutGarbage,
    ReadoutHalfLine,
    ReadoutSilent,
)

_NO_FRAME: tuple[Frame, ...] = ()
_UPLOAD_ANSWER, _UPLOAD_REQUEST, _DOWNLOAD_REQUEST = 0x40, 0x40, 0x20


def _lost(is_lost: bool, frame: Frame) -> Sequence[Frame]:
    """What arrives of a frame: nothing where it is lost."""
    return _NO_FRAME if is_lost else (frame,)


# Devices ------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class HeartbeatLost(WireFault):
    """A node's heartbeat stays away; everything else of it goes on."""

    node_id: int = DRIVE_NODE

    def from_devices(self, frame: Frame, bench: WireBench) -> Sequence[Frame]:
        return _lost(frame[0] == 0x700 + self.node_id and frame[1] != b"\0", frame)


@dataclass(frozen=True)
class NodeReset(WireFault):
    """A node restarts in motion, as after a dip of its supply: boot-up message, pre-operational,
    everything at its default.
    """

    node_id: int = COUNTER_NODE

    def act(self, bench: WireBench, cycle: int) -> None:
        if cycle == self.at_cycle:
            bench.slave(self.node_id).restart(bench.clock.monotonic_ns())


@dataclass(frozen=True)
class NodeSilent(WireFault):
    """A node's transmitter is dead: nothing of it arrives any more, while it goes on as it was told."""

    node_id: int = COUNTER_NODE

    def from_devices(self, frame: Frame, bench: WireBench) -> Sequence[Frame]:
        return _lost(frame[0] & 0x7F == self.node_id and frame[0] > 0x80, frame)


@dataclass(frozen=True)
class EmergencyMessage(WireFault):
    """A node sends an emergency message and goes on working."""

    node_id: int = DRIVE_NODE
    code: int = 0x4310
    register: int = 0x08
    vendor: bytes = b""

    def act(self, bench: WireBench, cycle: int) -> None:
        if cycle == self.at_cycle:
            bench.slave(self.node_id).emergency(self.code, self.register, self.vendor)


@dataclass(frozen=True)
class DriveTrip(WireFault):
    """The drive reports a fault in its statusword: fault reaction by 0x605E, or the motor `coasts`."""

    code: int = 0x8611
    coasts: bool = False

    def act(self, bench: WireBench, cycle: int) -> None:
        if cycle == self.at_cycle:
            bench.drive.fault(self.code, coasts=self.coasts)


@dataclass(frozen=True)
class FollowingWindowLeft(WireFault):
    """The shaft is further behind its target position than the drive allows: its window (0x6065) has become narrow."""

    window: int = 20

    def act(self, bench: WireBench, cycle: int) -> None:
        bench.drive.dictionary.store(0x6065, 0, self.window)


@dataclass(frozen=True)
class TargetsIgnored(WireFault):
    """The drive stays enabled, holds still and says that it does not follow its target position."""

    def act(self, bench: WireBench, cycle: int) -> None:
        if isinstance(bench.drive, Drive):
            bench.drive.ignores_targets = True


@dataclass(frozen=True)
class QuickStopNotObeyed(WireFault):
    """The drive says QUICK STOP ACTIVE and goes on turning; servo off still works."""

    def act(self, bench: WireBench, cycle: int) -> None:
        bench.drive.ignores_quick_stop = True

    def end_of(self, bench: WireBench) -> None:
        bench.drive.ignores_quick_stop = False


@dataclass(frozen=True)
class SafeTorqueOff(WireFault):
    """Somebody presses the emergency stop: the hardwired contacts take the torque; software only sees it."""

    def act(self, bench: WireBench, cycle: int) -> None:
        bench.drive.safe_torque_off(True)

    def end_of(self, bench: WireBench) -> None:
        bench.drive.safe_torque_off(False)


@dataclass(frozen=True)
class GuardOpened(WireFault):
    """Somebody opens the guard: nothing happens to the drive, its input only tells."""

    def act(self, bench: WireBench, cycle: int) -> None:
        bench.drive.open_guard(True)

    def end_of(self, bench: WireBench) -> None:
        bench.drive.open_guard(False)


@dataclass(frozen=True)
class EncoderReversed(WireFault):
    """An encoder's sense of counting turns round, as with two swapped lines; it goes on from where it is."""

    node_id: int = COUNTER_NODE

    def act(self, bench: WireBench, cycle: int) -> None:
        if cycle == self.at_cycle:
            self._turn(bench)

    def end_of(self, bench: WireBench) -> None:
        self._turn(bench)

    def _turn(self, bench: WireBench) -> None:
        (bench.counter if self.node_id == COUNTER_NODE else bench.input_encoder).reverse()


# Signals ------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class EncoderWrapped(SignalFault):
    """A counter that is narrower than it says: its count wraps at `modulus`."""

    channel: str = names.OUTPUT_ANGLE
    modulus: int = 1 << 16

    def corrupt(self, sensed: Sensed) -> None:
        rows, column = sensed.rows(self.at_cycle, self.end), sensed.column[self.channel]
        sensed.counts[rows, column] %= self.modulus


@dataclass(frozen=True)
class OutputSlips(SignalFault):
    """Output and input go apart by `counts_per_cycle` of the output encoder: a coupling slips, teeth jump."""

    counts_per_cycle: float = 3.0

    def corrupt(self, sensed: Sensed) -> None:
        rows, slipped = sensed.grown(self.at_cycle, self.end, self.counts_per_cycle)
        sensed.counts[rows, sensed.column[names.OUTPUT_ANGLE]] += slipped


# Frames -------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _TpdoFault(WireFault):
    """A fault of a node's process data; `number` 0 means all of its TPDOs."""

    node_id: int = COUNTER_NODE
    number: int = 0

    def _is_mine(self, frame: Frame, bench: WireBench) -> bool:
        chosen = bench.slave(self.node_id).tpdos
        if self.number:
            chosen = chosen[self.number - 1 : self.number]
        return any(pdo.exists and pdo.cob_id & 0x7FF == frame[0] for pdo in chosen)


@dataclass(frozen=True)
class TpdoLost(_TpdoFault):
    """Process data do not arrive."""

    def from_devices(self, frame: Frame, bench: WireBench) -> Sequence[Frame]:
        return _lost(self._is_mine(frame, bench), frame)


@dataclass(frozen=True)
class TpdoLate(_TpdoFault):
    """Process data arrive `late_cycles` SYNCs too late, right after that SYNC."""

    late_cycles: int = 1

    def from_devices(self, frame: Frame, bench: WireBench) -> Sequence[Frame]:
        if not self._is_mine(frame, bench):
            return (frame,)
        bench.hold(frame, bench.cycle + self.late_cycles)
        return _NO_FRAME


@dataclass(frozen=True)
class AnswersHeld(WireFault):
    """Everything that the devices send is held back and delivered in one burst at the end: a hub or an adapter's
    driver that the computer gives no time.
    """

    def from_devices(self, frame: Frame, bench: WireBench) -> Sequence[Frame]:
        bench.hold(frame, self.end)
        return _NO_FRAME


@dataclass(frozen=True)
class TpdoDoubled(_TpdoFault):
    """Process data arrive twice."""

    def from_devices(self, frame: Frame, bench: WireBench) -> Sequence[Frame]:
        return (frame, frame) if self._is_mine(frame, bench) else (frame,)


@dataclass(frozen=True)
class TpdoShort(_TpdoFault):
    """Process data arrive with `missing` bytes too few."""

    missing: int = 1

    def from_devices(self, frame: Frame, bench: WireBench) -> Sequence[Frame]:
        if not self._is_mine(frame, bench):
            return (frame,)
        cob_id, data = frame
        return ((cob_id, data[: max(0, len(data) - self.missing)]),)


@dataclass(frozen=True)
class SyncLost(WireFault):
    """The SYNC does not reach the devices: they latch and send nothing, and the motor goes on as it was told last."""

    def to_devices(self, frame: Frame, bench: WireBench) -> Sequence[Frame]:
        return _lost(frame[0] == SYNC, frame)


@dataclass(frozen=True)
class BusOff(WireFault):
    """The controller of the computer is bus-off: an error frame, then nothing can be sent or received."""

    def act(self, bench: WireBench, cycle: int) -> None:
        bench.bus_off = bench.is_gone = True

    def end_of(self, bench: WireBench) -> None:
        bench.bus_off = bench.is_gone = False


@dataclass(frozen=True)
class HubGone(WireFault):
    """The hub or the adapter disappears: clients are disconnected and cannot come back."""

    def act(self, bench: WireBench, cycle: int) -> None:
        bench.is_gone = True

    def end_of(self, bench: WireBench) -> None:
        bench.is_gone = False


@dataclass(frozen=True)
class ClockJump(WireFault):
    """The adapter's clock jumps by `stamp_offset_ns`; on the way back too when the fault ends."""

    stamp_offset_ns: int = 5_000_000_000


# SDO ----------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _SdoFault(WireFault):
    """A fault of a node's SDO server; `index` 0 means every object."""

    node_id: int = DRIVE_NODE
    index: int = 0

    def _is_request(self, frame: Frame) -> bool:
        cob_id, data = frame
        if cob_id != 0x600 + self.node_id or len(data) != 8:
            return False
        is_initiate = data[0] & 0xE0 in (_UPLOAD_REQUEST, _DOWNLOAD_REQUEST)
        return is_initiate and self.index in (0, int.from_bytes(data[1:3], "little"))


@dataclass(frozen=True)
class SdoAborted(_SdoFault):
    """The device refuses every request for the object with this abort code."""

    code: int = Abort.HARDWARE

    def to_devices(self, frame: Frame, bench: WireBench) -> Sequence[Frame]:
        if not self._is_request(frame):
            return (frame,)
        bench.answer(0x580 + self.node_id, b"\x80" + frame[1][1:4] + struct.pack("<I", self.code))
        return _NO_FRAME


@dataclass(frozen=True)
class SdoSilent(_SdoFault):
    """The device does not answer requests for the object: the client's time-out."""

    def to_devices(self, frame: Frame, bench: WireBench) -> Sequence[Frame]:
        return _lost(self._is_request(frame), frame)


@dataclass(frozen=True)
class ReadsBackDifferently(WireFault):
    """An object, a limit for example, reads back as `factor` times what was written (expedited answers)."""

    node_id: int = DRIVE_NODE
    index: int = 0x6072
    factor: float = 0.5

    def from_devices(self, frame: Frame, bench: WireBench) -> Sequence[Frame]:
        cob_id, data = frame
        is_answer = cob_id == 0x580 + self.node_id and data[0] & 0xE2 == _UPLOAD_ANSWER | 2
        if not is_answer or int.from_bytes(data[1:3], "little") != self.index:
            return (frame,)
        size = 4 - (data[0] >> 2 & 3)
        value = round(int.from_bytes(data[4 : 4 + size], "little") * self.factor) % (1 << 8 * size)
        return ((cob_id, data[:4] + value.to_bytes(size, "little").ljust(4, b"\0")),)


# Another master, and the SYNC ---------------------------------------------------------------------------------------


def _write_as_master(bench: WireBench, index: int, value: int, size: int) -> None:
    """Another master writes an object of the drive by SDO; its answer is on the bus."""
    head = bytes([0x23 | (4 - size) << 2]) + struct.pack("<HB", index, 0)
    request = head + value.to_bytes(size, "little").ljust(4, b"\0")
    bench.drive.receive(0x600 + DRIVE_NODE, request, bench.clock.monotonic_ns())


@dataclass(frozen=True)
class NmtFromOutside(WireFault):
    """Another master sends NMT commands to a node (0: all of them): `commands` as (cycles after the onset, command).

    `reacts`: whether the drive does by itself what its 0x6007 says; many do nothing.
    """

    commands: tuple[tuple[int, int], ...] = ((0, 0x80),)
    node_id: int = DRIVE_NODE
    reacts: bool = True

    def act(self, bench: WireBench, cycle: int) -> None:
        if not self.reacts:
            bench.drive.ignore_lost_master()
        for after, command in self.commands:
            if cycle == self.at_cycle + after:
                frame = bytes([command, self.node_id])
                bench.answer(0x000, frame)
                for slave in bench.slaves:
                    slave.receive(0x000, frame, bench.clock.monotonic_ns())


@dataclass(frozen=True)
class ModeFromOutside(WireFault):
    """Another master writes the drive's mode of operation (4: profile torque), whose set-point acts then."""

    mode: int = 4

    def act(self, bench: WireBench, cycle: int) -> None:
        if cycle == self.at_cycle:
            _write_as_master(bench, 0x6060, self.mode, 1)


@dataclass(frozen=True)
class SupervisedSyncLost(SyncLost):
    """The drive supervises the SYNC by a period of its own (0x1006) when the SYNC stays away."""

    period_us: int = 1000

    def act(self, bench: WireBench, cycle: int) -> None:
        if cycle == self.at_cycle:
            _write_as_master(bench, 0x1006, self.period_us, 4)


DRILLS: Mapping[str, Callable[[int], Fault]] = {
    "heartbeat of the drive lost": lambda at: HeartbeatLost(at, DRIVE_NODE),
    "heartbeat of the counter lost": lambda at: HeartbeatLost(at, COUNTER_NODE),
    "drive reset in motion": lambda at: NodeReset(at, DRIVE_NODE),
    "counter reset in motion": lambda at: NodeReset(at, COUNTER_NODE),
    "analogue input dead": lambda at: NodeSilent(at, ANALOG_INPUT_NODE),
    "emergency message": EmergencyMessage,
    "drive fault": DriveTrip,
    "drive fault, motor coasts": lambda at: DriveTrip(at, 0x2310, coasts=True),
    "power stage trips": DriveFault,
    "run-away": lambda at: RunAway(at, speed=250.0),
    "quick stop not obeyed": QuickStopNotObeyed,
    "neither quick stop nor servo off obeyed": QuickStopIgnored,
    "emergency stop pressed": SafeTorqueOff,
    "TPDO lost": TpdoLost,
    "one TPDO lost": lambda at: TpdoLost(at, cycles=1),
    "TPDO late": lambda at: TpdoLate(at, cycles=1),
    "TPDO doubled": TpdoDoubled,
    "TPDO short": TpdoShort,
    "SYNC lost": SyncLost,
    "bus off": BusOff,
    "bus lost": BusLost,
    "hub gone": HubGone,
    "everything stalls": lambda at: Stall(at, cycles=400),
    "SDO aborted": lambda at: SdoAborted(at, DRIVE_NODE, 0x6060),
    "SDO silent": SdoSilent,
    "drive limit reads back differently": ReadsBackDifferently,
    "output encoder jumps": CountJump,
    "output encoder stuck": StuckEncoder,
    "input encoder stuck": lambda at: StuckEncoder(at, channel=names.INPUT_ANGLE),
    "output encoder reversed": EncoderReversed,
    "output encoder wrapped": EncoderWrapped,
    "output encoder signal error": lambda at: MarkedCycles(at, CycleFlag.SIGNAL_ERROR),
    "output and input disagree": OutputSlips,
    "torque port saturated": TorquePortSaturated,
    "torque port open": TorquePortOpen,
    "clock jumps forward": ClockJump,
    "clock jumps back": lambda at: ClockJump(at, stamp_offset_ns=-5_000_000_000),
    "readout garbage": ReadoutGarbage,
    "readout half lines": ReadoutHalfLine,
    "readout silent": ReadoutSilent,
    "readout encoder fault": ReadoutEncoderFault,
    "NMT PRE-OPERATIONAL from outside": NmtFromOutside,
    "NMT STOPPED from outside": lambda at: NmtFromOutside(at, ((0, 0x02),)),
    "mode changed from outside": ModeFromOutside,
    "supervised SYNC lost": SupervisedSyncLost,
    "torque port frozen": ChannelFrozen,
    "torque port's zero drifts": TorqueZeroDrifts,
    "output encoder slips": CountsLost,
    "input encoder slips": lambda at: CountsLost(at, channel=names.INPUT_ANGLE, counts=-30),
    "creep": lambda at: RunAway(at, speed=3.04),
    "thermometer open": ThermometerOpen,
    "thermometer frozen": lambda at: ChannelFrozen(at, channel=names.HOUSING_TEMPERATURE),
}
"""One of every fault that the rig is drilled with: its name, and what makes it begin at a cycle."""
