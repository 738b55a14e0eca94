"""The wire bench: drive, counter, analogue input and readout in front of one plant, the same as the direct rig's.

At SYNC k: synchronous set-points received before it take effect, every channel is latched and sent,
then the plant goes on by one cycle (`shown_plant`); target[k] acts from SYNC k. Time: the plant
goes on with the SYNC; when the SYNC stays away for longer than `silence_cycles` of the clock,
it goes on alone, as a real motor would, by the set-points that the drive holds, whoever wrote them
(None: it never does).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from drivers import channel as names
from drivers.clock import Clock, VirtualClock
from drivers.drive_state import POWERED_STATES
from drivers.errors import DriverError
from drivers.samples import CycleFlag
from model.gear import HarmonicDrive, Mounting
from model.motor import ServoMotor
from model.units import REVOLUTION
from sim_backend.assembly import assemble
from sim_backend.faults import BusLost, Fault, IncompleteCycles, MarkedCycles, Stall
from sim_backend.imperfections import Imperfections
from sim_backend.wire.analog_amplifier import AnalogAmplifier, ReferenceDevice
from sim_backend.wire.analog_input import AnalogInput
from sim_backend.wire.counter import Counter
from sim_backend.wire.counter_box import BoxLine, CounterBox
from sim_backend.wire.drive import Drive, DriveDevice
from sim_backend.wire.line import BenchBus, BenchSerial, Frame, WireFault
from sim_backend.wire.readout import Readout
from sim_backend.wire.shown_plant import ShownPlant
from sim_backend.wire.slave import Slave
from sim_backend.world import FIRST_WORLD, ThermalState, World

Listener = Callable[[int, bytes, int], None]
"""Takes a frame from the bus: COB-ID, data, time stamp [ns]."""

DRIVE_NODE, COUNTER_NODE, ANALOG_INPUT_NODE, MOTOR_COUNTER_NODE = 1, 2, 3, 4
SYNC = 0x080
_SILENCE_CYCLES = 20
"""Periods without SYNC after which the plant goes on alone."""
_LONGEST_CATCH_UP = 5000
"""Cycles that are made up for at once; after a longer silence (a suspended process) the rest did not happen."""
_FRAME_NS = 111_000
"""Time that a frame of eight bytes takes at 1 Mbit/s."""
FIRST_STAMP_NS = 1_000_000_000
"""The adapter's clock at the first SYNC: it has been running for a second."""


def synchronise(slaves: Sequence[Slave], now_ns: int) -> None:
    """What a SYNC does to slaves while the plant stands: latch, act, send."""
    for slave in slaves:
        slave.hear_sync(now_ns)
        slave.latch()
        slave.apply_synchronous()
        slave.send_synchronous()


class WireBench(ShownPlant):
    """A rig on a simulated CAN bus and a simulated serial line; parameters as of `SimulatedRig`.

    `bus()` opens the bus for a client in this process, `pump` lets the devices run until an instant
    of the clock, `serial()` opens the readout's line. With a `reference` the motor is turned by an
    amplifier by analog reference behind a coupler, and its divided pulses go to a counter of their
    own. `faults` are those of `sim_backend.faults` and `sim_backend.wire.faults`; cycles count the
    SYNCs.
    """

    def __init__(
        self,
        gear: HarmonicDrive,
        motor: ServoMotor,
        imperfections: Imperfections | None = None,
        world: World = FIRST_WORLD,
        *,
        cycle_ns: int = 1_000_000,
        mounting: Mounting = "circular-spline-fixed",
        gear_mounted: bool = True,
        disc_inertia: float = 0.0,
        clock: Clock | None = None,
        faults: Sequence[Fault] = (),
        start: ThermalState | None = None,
        silence_cycles: int | None = _SILENCE_CYCLES,
        reference: ReferenceDevice | None = None,
        start_ns: int = FIRST_STAMP_NS,
    ) -> None:
        on = imperfections or Imperfections()
        if not (on.adc_steps and on.drive_torque_steps):
            raise DriverError(
                "a converter without steps cannot be shown on the wire",
                where="wire bench",
                value="adc_steps or drive_torque_steps off",
                remedy="Leave both imperfections on.",
            )
        self.clock: Clock = clock or VirtualClock()
        assembly = assemble(
            gear,
            motor,
            on,
            world,
            cycle_ns=cycle_ns,
            mounting=mounting,
            gear_mounted=gear_mounted,
            disc_inertia=disc_inertia,
            start=start,
            start_ns=start_ns,
        )
        super().__init__(assembly, cycle_ns)
        self._silence_cycles = silence_cycles
        what = f"{gear.name} on {motor.name}" if gear_mounted else f"bare {motor.name}"
        self.title = f"simulated rig on the wire: {what}"
        self._make_devices(motor, reference)
        self._begin(faults)

    def _make_devices(self, motor: ServoMotor, reference: ReferenceDevice | None) -> None:
        by_name = {c.name: c for c in self.channels}
        revolution = {
            name: round(REVOLUTION / by_name[name].scale)
            for name in (names.INPUT_ANGLE, names.OUTPUT_ANGLE)
        }
        self.drive: Drive | AnalogAmplifier
        self.motor_counter: Counter | None = None
        if reference is None:
            self.drive = Drive(
                DRIVE_NODE,
                self._drive_device(motor, revolution[names.INPUT_ANGLE]),
                self._from_device,
            )
        else:
            self.drive = AnalogAmplifier(DRIVE_NODE, reference, self.cycle_ns, self._from_device)
            self.motor_counter = Counter(
                MOTOR_COUNTER_NODE, revolution[names.INPUT_ANGLE], self._from_device
            )
        self.counter = Counter(COUNTER_NODE, revolution[names.OUTPUT_ANGLE], self._from_device)
        self.analog_input = AnalogInput(ANALOG_INPUT_NODE, self._from_device)
        pulses = () if self.motor_counter is None else (self.motor_counter,)
        self.slaves: tuple[Slave, ...] = (self.drive, self.counter, self.analog_input, *pulses)
        self.counter_box = CounterBox(
            lambda: int(self._counts[self._column[names.OUTPUT_ANGLE]]),
            revolution[names.OUTPUT_ANGLE],
        )
        self._output_scale = by_name[names.OUTPUT_ANGLE].scale
        self.readout = Readout(
            lambda: float(self._counts[self._column[names.OUTPUT_ANGLE]]) * self._output_scale
        )

    def _drive_device(self, motor: ServoMotor, counts_per_revolution: int) -> DriveDevice:
        return DriveDevice(
            counts_per_revolution=counts_per_revolution,
            rated_torque=motor.rated_torque,
            peak_torque=motor.peak_torque,
            maximum_speed=motor.maximum_speed,
            cycle_ns=self.cycle_ns,
            serial_number=self._assembly.world.bench_seed & 0xFFFF_FFFF,
        )

    def _begin(self, faults: Sequence[Fault]) -> None:
        self._listeners: list[tuple[object, Listener]] = []
        self._held: list[tuple[int, Frame]] = []
        self._consumed: set[int] = set()
        self._last_sync_ns: int | None = None
        self._elapsed_ns = self.clock.monotonic_ns()
        self._stamp_ns = self._assembly.sync.start_ns - _FRAME_NS
        self._frames_since = 0
        self.is_gone = False
        self.bus_off = False
        self._fell: dict[int, int] = {}
        self.inject(*faults)
        now = self.clock.monotonic_ns()
        for slave in self.slaves:
            slave.dictionary.on_change(self._note_consumed)
            slave.boot(now)
        self._note_consumed(0x1400, 1)
        self._read_at_rest()

    # What a client sees -------------------------------------------------------------------------------------------

    @property
    def stamp_ns(self) -> int:
        """The adapter's time stamp of the latest frame [ns]."""
        return self._stamp_ns + self._frames_since * _FRAME_NS

    @property
    def input_encoder(self) -> Drive | Counter:
        """The device that counts the motor's encoder."""
        if self.motor_counter is not None:
            return self.motor_counter
        assert isinstance(self.drive, Drive)
        return self.drive

    @property
    def is_powered(self) -> bool:
        """Whether the drive's power stage may produce torque now."""
        return self.drive.drive_state in POWERED_STATES

    def bus(self, *, receive_own_messages: bool = True) -> BenchBus:
        """Open the bus for one client: a python-can bus without a thread."""
        return BenchBus(self, receive_own_messages=receive_own_messages)

    def serial(self) -> BenchSerial:
        """Open the readout's serial line."""
        return BenchSerial(self)

    def box_line(self) -> BoxLine:
        """Open the line to the counter box."""
        return BoxLine(self)

    def slave(self, node_id: int) -> Slave:
        """The device of this number."""
        return next(slave for slave in self.slaves if slave.node_id == node_id)

    def listen(self, owner: object, listener: Listener) -> None:
        """Hand every frame on the bus to `listener`, except those that `owner` sends."""
        self._listeners.append((owner, listener))

    def leave(self, owner: object) -> None:
        """Forget the listeners of an owner."""
        self._listeners = [(o, heard) for o, heard in self._listeners if o is not owner]

    def inject(self, *faults: Fault) -> None:
        """Let faults happen. Raises `DriverError` for one that only marks cycles: on the wire the frames decide."""
        for fault in faults:
            if isinstance(fault, IncompleteCycles) or (
                isinstance(fault, MarkedCycles) and fault.flag is not CycleFlag.SIGNAL_ERROR
            ):
                raise DriverError(
                    "a fault that only marks cycles cannot happen on the wire",
                    where="wire bench",
                    value=fault,
                    remedy="Use the faults of frames: lost, late, doubled or short TPDOs.",
                )
        self._faults += faults
        for fault in faults:
            if isinstance(fault, WireFault) and fault.active(self._cycle):
                self._let_fall(fault)

    def _let_fall(self, fault: WireFault) -> None:
        """Once in a cycle: what turns something round would undo itself the second time."""
        if self._fell.get(id(fault)) != self._cycle:
            self._fell[id(fault)] = self._cycle
            fault.fall_on(self, self._cycle)

    @property
    def is_lost(self) -> bool:
        """Whether nobody can send or receive any more."""
        return self.is_gone or (bool(self._faults) and bool(self._active(BusLost)))

    def note_refusal(self) -> None:
        """A client has found the bus gone."""
        for fault in self._active(BusLost):
            fault.effects.refusals += 1

    def _active(self, kind: type[Fault]) -> list[Fault]:
        return [f for f in self._faults if isinstance(f, kind) and f.active(self._cycle)]

    def _unless_stalled(self, frame: Frame) -> Sequence[Frame]:
        """Nothing arrives anywhere while everything stalls, though the computer's adapter goes on."""
        stalls = self._active(Stall) if self._faults else []
        for fault in stalls:
            fault.effects.frames += 1
        return () if stalls else (frame,)

    def wire_faults(self) -> list[WireFault]:
        """Those of them that touch frames and lines."""
        return [f for f in self._faults if isinstance(f, WireFault) and f.active(self._cycle)]

    def line_faults(self) -> list[WireFault]:
        """Those of the cycle whose SYNC has been, for lines that are used between two SYNCs."""
        at = max(self._cycle - 1, 0)
        return [f for f in self._faults if isinstance(f, WireFault) and f.active(at)]

    # Frames and time ----------------------------------------------------------------------------------------------

    def send(self, cob_id: int, data: bytes, owner: object = None) -> None:
        """A client sends a frame: all others on the bus hear it, the SYNC runs one cycle."""
        now = self.clock.monotonic_ns()
        if cob_id == self.drive.sync_cob_id:
            self._follow_clock(now)
            self._last_sync_ns = now
            self._stamp_ns, self._frames_since = self._stamp_of(self._cycle), 0
            self._deliver(cob_id, data, owner)
            self._run_cycle(cob_id, data)
            return
        self._deliver(cob_id, data, owner)
        frames = self._unless_stalled((cob_id, data))
        for fault in self.wire_faults():
            frames = fault.alter_to_devices(frames, self)
        for cob, payload in frames:
            for slave in self.slaves:
                if cob == slave.sync_cob_id:
                    # A SYNC of its own, which the plant does not run with.
                    synchronise([slave], now)
                else:
                    slave.receive(cob, payload, now)

    def pump(self, deadline_ns: int) -> None:
        """Let the devices run: up to the next thing that one of them has to do, or to `deadline_ns` of the clock."""
        for owner, _ in self._listeners:
            if getattr(owner, "is_waiting", False):
                # Time does not pass before what has arrived has been looked at; who moved the clock
                # himself is followed.
                if self.clock.monotonic_ns() > self._elapsed_ns:
                    self.elapse()
                return
        due = min(deadline_ns, self.next_due_ns())
        if due > self.clock.monotonic_ns():
            self.clock.wait_until_ns(due)
        self.elapse()

    def elapse(self) -> None:
        """The clock has moved: timers of the devices, and the plant where the SYNC stays away."""
        now = self._elapsed_ns = self.clock.monotonic_ns()
        self._tick(now)
        self._follow_clock(now)

    def next_due_ns(self) -> int:
        """The next instant at which a device has something to do."""
        due = min(slave.next_due_ns() for slave in self.slaves)
        if self._last_sync_ns is not None and self._silence_cycles is not None:
            due = min(due, self._last_sync_ns + (self._silence_cycles + 1) * self.cycle_ns)
        return due

    def answer(self, cob_id: int, data: bytes) -> None:
        """Let a frame come from the devices that none of them sent."""
        self._deliver(cob_id, data, None)

    def hold(self, frame: Frame, until_cycle: int) -> None:
        """Keep a frame back; it is delivered right after the SYNC of that cycle."""
        self._held.append((until_cycle, frame))

    # Inside -------------------------------------------------------------------------------------------------------

    def _tick(self, now: int) -> None:
        for slave in self.slaves:
            if now >= slave.next_due_ns():
                slave.tick(now)

    def _from_device(self, cob_id: int, data: bytes) -> None:
        frames: Sequence[Frame] = [(cob_id, data)]
        if self._faults:
            frames = self._unless_stalled((cob_id, data))
            for fault in self.wire_faults():
                frames = fault.alter_from_devices(frames, self)
        for cob, payload in frames:
            self._deliver(cob, payload, None)
            if 0x700 < cob < 0x780 or cob in self._consumed:
                # Devices hear each other: one may consume another's heartbeat or process data.
                for slave in self.slaves:
                    if cob != 0x700 + slave.node_id:
                        slave.receive(cob, payload, self.clock.monotonic_ns())

    def _note_consumed(self, index: int, sub: int) -> None:
        if 0x1400 <= index < 0x1600 and sub == 1:
            self._consumed = {
                pdo.cob_id for slave in self.slaves for pdo in slave.rpdos if pdo.exists
            }

    def _deliver(self, cob_id: int, data: bytes, owner: object) -> None:
        stamp = self._stamp_ns + self._frames_since * _FRAME_NS
        self._frames_since += 1
        for listening, listener in self._listeners:
            if listening is not owner or getattr(listening, "receives_own", False):
                listener(cob_id, data, stamp)

    def _stamp_of(self, cycle: int) -> int:
        late = np.array([self._lateness(cycle)], dtype=np.int64)
        stamp = int(self._assembly.sync.stamps_ns(cycle, late)[0])
        for fault in self.wire_faults():
            stamp += fault.stamp_offset_ns
            fault.effects.stamps += fault.stamp_offset_ns != 0
        return stamp

    def _run_cycle(self, cob_id: int, data: bytes) -> None:
        """The drive's SYNC: latch, act, advance, send; for all that follow the same."""
        wire = self.wire_faults()
        for fault in wire:
            self._let_fall(fault)
        reached = self._unless_stalled((cob_id, data))
        for fault in wire:
            reached = fault.alter_to_devices(reached, self)
        following = [slave for slave in self.slaves if reached and slave.sync_cob_id == cob_id]
        for slave in following:
            slave.hear_sync(self.clock.monotonic_ns())
            slave.latch()
            slave.apply_synchronous()
        for frame in [frame for until, frame in self._held if until <= self._cycle]:
            self._deliver(*frame, None)
        self._held = [(until, frame) for until, frame in self._held if until > self._cycle]
        self._advance_plant()
        if reached:
            self.counter_box.trigger()
        for slave in following:
            slave.send_synchronous()
        self._cycle += 1
        for fault in self._faults:
            if fault.end == self._cycle and isinstance(fault, WireFault):
                fault.end_of(self)

    def _follow_clock(self, now: int) -> None:
        """The SYNC stayed away: the plant runs the cycles of the clock that nobody latched."""
        if self._last_sync_ns is None and self.drive.drive_state in POWERED_STATES:
            # Nobody has ever sent a SYNC, and the drive has power all the same.
            self._last_sync_ns = now
        if self._last_sync_ns is None or self._silence_cycles is None:
            return
        missed = (now - self._last_sync_ns) // self.cycle_ns - 1
        if missed < self._silence_cycles:
            return
        for _ in range(min(missed, _LONGEST_CATCH_UP)):
            self._advance_plant()
            self._cycle += 1
        self._last_sync_ns += missed * self.cycle_ns
