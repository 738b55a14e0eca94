"""The segment of a CAN bus with the drive on it: the actuator of a cycled rig, and what is latched on its bus.

Every cycle: set-points (RPDO), SYNC, one TPDO of every kind. The frames are kept raw and decoded for the whole block at
once; cycle k holds what was latched at SYNC k. The next SYNC goes out when it is due and the cycle is complete, or when
the patience with a missing frame is over: a slow computer lowers the achieved rate, which is reported, and never shifts
a sample to another cycle. Enabling the servo and choosing a mode go by SDO, while the SYNC goes on.

The time of a cycle is the stamp of its own SYNC where the bus hands it back, else that of its first
frame; with a host's stamps, or with none, the cycle says `HOST_TIME`.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Generator, Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from drivers.acquisition_statistics import AcquisitionReport, AcquisitionStatistics
from drivers.bus.amplifier import Left
from drivers.bus.cia301 import SYNC_COB_ID, ObjectRef
from drivers.bus.columns import ColumnDecoder
from drivers.bus.frame_log import FrameLog
from drivers.bus.frames import CycleStore
from drivers.bus.letting_go import command_once, let_go
from drivers.bus.listening import listen_for_masters, listening_time_ns
from drivers.bus.network import Pump, PumpedBus, RawBus, TimeBase
from drivers.bus.pace import Pace
from drivers.bus.request_line import RequestLine
from drivers.bus.rig_config import CanRigConfig
from drivers.bus.rig_nodes import RigNodes
from drivers.bus.set_points import set_point_counts
from drivers.bus.silence import Silence
from drivers.bus.strangers import Strangers
from drivers.bus.sync_time import SyncTime
from drivers.bus.waking import LATE_TURN, Waking, longest_pause_ns
from drivers.channel import Channel
from drivers.clock import Clock
from drivers.cycled import Cycle
from drivers.errors import BusLostError, DriverError
from drivers.event import Event
from drivers.port import (
    Abilities,
    Command,
    DriveLimits,
    Mode,
    Origin,
    RigDescription,
)
from drivers.samples import NOT_JUDGED, Break, CycleFlag

_ACTIVE: Final = frozenset({Mode.SPEED, Mode.TORQUE})


class CanSegment:
    """A rig on a CAN bus. `connect` opens the raw bus; `pump` lets devices of the same process run;
    see `drivers.bus.network`.
    """

    def __init__(
        self,
        config: CanRigConfig,
        clock: Clock,
        connect: Callable[[], RawBus],
        *,
        pump: Pump | None = None,
        time_base: TimeBase = "host",
        origin: Origin = "hardware",
        truth: Mapping[str, object] | None = None,
    ) -> None:
        self.config = self._config = config
        self._clock, self._connect, self._pump = clock, connect, pump
        self._wanted_base: TimeBase = time_base
        self._origin: Origin = origin
        self._truth = truth
        self._bus: PumpedBus | None = None
        self._nodes: RigNodes | None = None
        self._line: RequestLine | None = None
        self._left_events: list[Event] = []
        self._lost: BusLostError | None = None
        self._log: FrameLog | None = None
        self.on_sync: Callable[[], None] | None = None
        self._frames: Sequence[Sequence[bytes]] = ()
        self._speeds = self._torques = np.empty(0, dtype=np.int64)
        self._commanded = Mode.OFF

    # --- RigPort

    @property
    def channels(self) -> Sequence[Channel]:
        """The channels in the order of the columns; known once the rig is open, because the drive tells its units."""
        return [column.channel for column in self._opened().columns]

    @property
    def title(self) -> str:
        """What the rig is called."""
        return self._config.title

    @property
    def cycle_ns(self) -> int:
        """The nominal SYNC period [ns]."""
        return self._config.cycle_ns

    @property
    def time_base(self) -> TimeBase:
        """What the time stamps are: the bus's base, or the host's where neither SYNC nor frames carry a stamp."""
        return self._wanted_base

    @property
    def line(self) -> RequestLine | None:
        """The line to each device beside the cyclic data, once the rig is open."""
        return self._line

    @property
    def abilities(self) -> Abilities:
        """Devices on a bus tell events, and the drive can be stopped from another handle on it."""
        return Abilities(
            events=self.events,
            acquisition=self.acquisition,
            quick_stop_frames=self.quick_stop_frames,
            unwatched=lambda: self.nodes.drive.unwatched,
            has_quick_stop=self._config.drive.has_quick_stop,
            reads_limits_back=self._config.drive.reads_limits_back,
            keep_frames=self.keep_frames,
        )

    def open(self) -> RigDescription:
        """Bring every node from any state to OPERATIONAL with the servo off, mapped and watched.
        Raises `DriverError`.
        """
        raw = self._connect()
        bus = PumpedBus(
            raw,
            self._clock,
            pump=self._pump,
            time_base=self._wanted_base,
            own_node_id=self._config.own_node_id,
        )
        self._bus = bus
        config = self._config
        bus.log = self._log = FrameLog(config.cycle_ns)
        try:
            self._left_events += listen_for_masters(
                raw,
                self._clock,
                self._pump,
                node_ids=config.node_ids,
                own_node_id=config.own_node_id,
                duration_ns=listening_time_ns(config.drive.computer_heartbeat_ms),
            )
            nodes = RigNodes(
                bus=bus,
                cycle_ns=config.cycle_ns,
                drive=config.drive,
                motor_encoder=config.motor_encoder,
                counters=config.counters,
                modules=config.modules,
                guard=config.guard,
            )
            nodes.bring_up()
            self._nodes = nodes
            self._prepare(bus, nodes)
            nodes.start()
            nodes.require_unbroken()
            nodes.drive.to_off()
        except DriverError:
            self._nodes = None
            self._left_events += bus.events()
            bus.close()
            self._bus = None
            raise
        self._errors_seen = bus.errors_seen
        origin = "simulated" if nodes.are_simulated else self._origin
        return RigDescription(origin, config.title, nodes.describe(), self._truth)

    def write_limits(self, limits: DriveLimits) -> DriveLimits:
        """Write the limits into the drive and return what reads back; infinite where the drive holds none."""
        self._pause()
        return self._opened().drive.write_limits(limits)

    def begin(self, command: Command, cycles: int) -> None:
        """Enter the mode and build the frames of so many cycles. Raises `DriverError`."""
        nodes, line = self._opened(), self._line
        self._live_bus()
        if self._lost is not None or line is None:
            raise self._lost or BusLostError("the rig has been closed", where=self._config.title)
        speeds, torques = set_point_counts(
            command, cycles, self.channels, nodes.drive.largest_counts
        )
        self._enter(command.mode)
        # A drive that says nothing is not waited for when it is to be stopped: what it held last goes on.
        may_ask = command.mode in _ACTIVE or not self._silence.cycles
        self._frames = nodes.drive.frames(command.mode, speeds, torques, may_ask=may_ask)
        self._speeds, self._torques, self._commanded = speeds, torques, command.mode
        self._store.begin_block(cycles)

    def cycle(self, row: int) -> Cycle:
        """One SYNC cycle with the set-points of a row. Raises `BusLostError`."""
        return self._cycle([frames[row] for frames in self._frames], row)

    def row(self, row: int, flags: int) -> list[int]:
        """The counts of the cycle that has just been."""
        speed, torque = int(self._speeds[row]), int(self._torques[row])
        return self._decoder.row(self._store.last_record, speed, torque, flags)

    def lose(self, error: BusLostError) -> None:
        """What was measured until now is kept; the loss itself is raised by the next block."""
        self._store.drop_open()
        if self._store.rows:
            self._lost = error
            self._live_bus().emit("error", "bus-lost", "bus", str(error))

    def reset_fault(self) -> None:
        """Acknowledge a drive fault; the servo stays off."""
        self._pause()
        self._opened().drive.reset_fault()
        self._mode = Mode.OFF

    def close(self) -> None:
        """Servo off, the drive's watch over the computer off, bus released. Never raises."""
        bus, nodes = self._bus, self._nodes
        if bus is None:
            return
        if nodes is not None and self._lost is None:
            let_go(bus, nodes)
        bus.close()
        self._left_events += bus.events()
        self._bus = None

    # --- beyond the port

    def events(self) -> list[Event]:
        """What happened since the last call: emergencies, losses, transitions, warnings; oldest first."""
        drained, self._left_events = self._left_events, []
        return drained + (self._bus.events() if self._bus is not None else [])

    def acquisition(self) -> AcquisitionReport:
        """Achieved rate, jitter, missed cycles and latency since the rig was opened."""
        self._opened()
        return self._statistics.report()

    def read_integer(self, node_id: int, entry: ObjectRef) -> int:
        """An object of a node by SDO, between two cycles. Raises `DriverError`."""
        self._pause()
        return self._opened().read_integer(node_id, entry)

    @property
    def nodes(self) -> RigNodes:
        """The devices, for checks that go beyond running: doctor, drills."""
        return self._opened()

    def keep_frames(self, path: Path, seconds: float) -> int:
        """Write the frames of the last `seconds`, as python-can does; how many. Raises `OSError`."""
        epoch = self._clock.calendar_ns() - self._clock.monotonic_ns()
        return 0 if self._log is None else self._log.write(path, epoch, seconds)

    def quick_stop_frames(self) -> list[tuple[int, bytes]]:
        """(COB-ID, data) of the frames that quick-stop the drive without this loop: for a watchdog
        with a bus of its own.

        Process data, and the SYNC with which they act: the drive's SDO channel belongs to this loop.
        """
        commands = command_once(self._opened().drive, Mode.QUICK_STOP)
        self._strangers.announce(commands)
        return [*commands, (SYNC_COB_ID, b"")]

    # --- inside

    def _opened(self) -> RigNodes:
        if self._nodes is None:
            raise DriverError(
                "the rig is not open", where=self._config.title, remedy="Open it first."
            )
        return self._nodes

    def _live_bus(self) -> PumpedBus:
        if self._bus is None:
            raise BusLostError("the rig has been closed", where=self._config.title)
        return self._bus

    def _prepare(self, bus: PumpedBus, nodes: RigNodes) -> None:
        """Everything that one opening of the rig needs anew."""
        self._store = CycleStore(nodes.layout)
        self._decoder = ColumnDecoder(
            nodes.layout, nodes.columns, nodes.validities, self._config.cycle_ns
        )
        self._statistics = AcquisitionStatistics(self._config.cycle_ns)
        self._mode = Mode.OFF
        self._first_cycle = 0
        self._pace = Pace(self._config, self._clock, self._store, self._decoder, self._statistics)
        self._echo_stamp = self._errors_seen = 0
        self._silence = Silence(self._store, bus.emit)
        self._sync_time = SyncTime(bus.time_base, self._config.stamp_wrap_ns)
        self._was_enabled = False
        self._waking = Waking(
            self._clock,
            longest_pause_ns(
                self._config.drive.computer_lost_ms,
                self._config.cycle_ns,
                self._config.patience_cycles * self._config.settle_factor,
            ),
        )
        nodes.drive.find(nodes.layout)
        self._line = RequestLine(bus, nodes.places(self._store.is_absent), nodes.drive)
        self._lost = None
        bus.sample_time_ns = self._event_time
        for slot, pdo in enumerate(nodes.layout.pdos):
            bus.subscribe(pdo.cob_id, self._store.receiver(slot))
        self._watch_for_strangers(bus, nodes)

    def _watch_for_strangers(self, bus: PumpedBus, nodes: RigNodes) -> None:
        """Listen to SYNCs and to the drive's commands. Whether the bus hands back what was sent has shown by now."""
        cob_ids = [pdo.cob_id for pdo in nodes.drive.commands]
        self._strangers = Strangers(self._store, self._clock, bus.emit, cob_ids, echoes=bus.echoes)
        bus.subscribe(SYNC_COB_ID, self._on_sync)
        for number, cob_id in enumerate(cob_ids):
            bus.subscribe(cob_id, self._strangers.listener(number))

    def _on_sync(self, data: bytes, stamp_ns: int) -> None:
        if self._strangers.sync_heard():
            self._echo_stamp = stamp_ns
            self._store.echo()

    def _event_time(self) -> int:
        """Now, in the base of the samples: the latest stamp and what has passed since."""
        return self._sync_time.now(self._clock.monotonic_ns(), self._clock.calendar_ns())

    def _enter(self, mode: Mode) -> None:
        """Bring the drive into the mode, or make sure that it is still in it. No automatic restart."""
        if mode not in _ACTIVE:
            self._mode = mode
            return
        self._opened().require_unbroken()
        drive = self._opened().drive
        if self._mode is not mode:
            self._pause()
            self._mode, self._was_enabled = Mode.OFF, False
            # An `enable` that raises half-way leaves OFF behind: the next call begins anew and never trusts the drive.
            with self._sync_goes_on(self._live_bus()):
                drive.enable(mode)
            self._mode, self._was_enabled = mode, True
            self._waking.cycled()
        elif not self._was_enabled:
            state = drive.state()
            raise DriverError(
                f"the drive is no longer enabled: {drive.error_text()}",
                where=drive.device.where,
                value=state.value,
                remedy="Command OFF, find and remove the cause, acknowledge the fault; there is no automatic restart.",
            )
        self._silence.require_shorter(self._config.stale_cycles)

    @contextlib.contextmanager
    def _sync_goes_on(self, bus: PumpedBus) -> Generator[None]:
        """While something goes by SDO every SYNC that is due goes out; its answers are paired, not kept. A drive that
        must be led meanwhile sees them and says what goes out.
        """
        drive = self._opened().drive

        def turn() -> int:
            due = self._pace.due_ns
            if due is None or self._clock.monotonic_ns() < due:
                return due or 1 << 62
            bus.while_waiting = None
            try:
                self._store.begin_block(1)
                cycle = self._cycle(drive.frames_between(), 0)
                if not cycle.flags & CycleFlag.INCOMPLETE:
                    drive.latched(self._store.last_record)
            finally:
                bus.while_waiting = turn
            return 0

        cycles, bus.while_waiting = self._sync_time.cycles, turn
        try:
            yield
        finally:
            bus.while_waiting = None
            if self._sync_time.cycles > cycles:
                self._pace.pause()

    def _pause(self) -> None:
        """Something goes by SDO between two cycles: time passes, and what an RPDO keeps may be another value then."""
        drive = self._opened().drive
        self._pace.is_pause_pending = True
        drive.paused()

    def _cycle(self, commands: Sequence[bytes], row: int) -> Cycle:
        """One SYNC cycle with these frames before it."""
        bus, line = self._live_bus(), self._line
        if row == 0:
            self._host_rows: list[int] = []
        self._pace.wait_for_turn(bus, is_first_row=row == 0, is_active=self._mode in _ACTIVE)
        if self._mode in _ACTIVE and self._waking.has_slept():
            commands = [data for _, data in command_once(self._opened().drive, Mode.QUICK_STOP)]
            self._was_enabled = False
            self._waking.woke()
        strangers = self._strangers
        if not self._sync_time.cycles:
            strangers.begin()
        strangers.sends(commands)
        # The turn itself sends the heartbeat that the drive watches: when this loop is dead, the drive stops.
        bus.send_heartbeat()
        # Set-points go out before the SYNC that makes them act: target[k] acts from SYNC k.
        for pdo, data in zip(self._opened().drive.commands, commands, strict=bool(commands)):
            bus.send(pdo.cob_id, data)
        patience = self._pace.patience(is_first=not self._first_cycle and not row)
        self._echo_stamp = 0
        self._store.begin_cycle(strangers.echoes)
        sent = self._clock.monotonic_ns()
        calendar = self._clock.calendar_ns()
        bus.send(SYNC_COB_ID, b"")
        self._waking.cycled()
        if self.on_sync is not None:
            self.on_sync()
        if line is not None and line.is_busy:
            line.turn(self._first_cycle + row)
        self._pace.collect(bus, sent, patience)
        latency = self._clock.monotonic_ns() - sent
        flags = self._store.end_cycle()
        stamp, is_host = self._sync_time.of_cycle(
            self._echo_stamp, self._store.stamps(), sent, calendar
        )
        if is_host:
            self._host_rows.append(row)
        self._silence.count(bool(flags & CycleFlag.INCOMPLETE))
        strangers.close_cycle(flags)
        if not self._waking.has_slept():
            # After a sleep of ours nobody was heard: they were not silent.
            bus.check_heartbeats()
        times = self._sync_time
        return Cycle(stamp, latency, flags, times.sync_ns, times.doubt(latency))

    def trouble(self, row: int, flags: int) -> Break | None:
        """The onset of something that the guard cannot see: an emergency, a lost node, the drive dropping out."""
        bus, mode, waking = self._live_bus(), self._commanded, self._waking
        if waking.overslept_ms:
            overslept, waking.overslept_ms = waking.overslept_ms, 0.0
            allowed = waking.allowed_ns * 1e-6
            bus.emit("error", LATE_TURN, "bus", waking.words_of(overslept))
            self._errors_seen = bus.errors_seen
            return Break(row, LATE_TURN.replace("-", "_"), overslept, allowed, True)
        if bus.errors_seen != self._errors_seen:
            self._errors_seen = bus.errors_seen
            event = bus.last_error
            return Break(
                row, event.code.replace("-", "_") if event else "bus_error", 1.0, 0.0, True
            )
        if mode in _ACTIVE and not flags & NOT_JUDGED and self._was_enabled:
            left = self._opened().drive.left(self._store.last_record)
            if left is not None:
                return self._left(left, row)
        return None

    def _left(self, left: Left, row: int) -> Break:
        """The drive is not any more as it was enabled."""
        self._was_enabled = False
        bus = self._live_bus()
        bus.emit("error", left.code, f"node {self._config.drive.node_id}", left.text)
        self._errors_seen = bus.errors_seen
        return Break(row, left.code.replace("-", "_"), left.value, 0.0, True)

    def finish(
        self, cycles: Sequence[Cycle], marks: NDArray[np.uint16] | None
    ) -> tuple[int, NDArray[np.int64], NDArray[np.uint16]]:
        """First cycle, counts (n, channels) and flags (n,): the block decoded, marked and counted. `marks` (n,) are
        added to the flags.
        """
        rows = len(cycles)
        self._opened().drive.sent(rows)
        raw, bad = self._store.decoded()
        flags = self._store.flags()
        counts = self._decoder.block(
            raw,
            bad,
            flags,
            speeds=self._speeds[:rows],
            torques=self._torques[:rows],
            absent=self._store.absent(),
            sent=np.array([cycle.sync_ns for cycle in cycles], dtype=np.int64),
            doubt=np.array([cycle.doubt_ns for cycle in cycles], dtype=np.int64),
        )
        host_rows = [row for row in self._host_rows if row < rows]
        flags[host_rows] |= np.uint16(CycleFlag.HOST_TIME)
        if marks is not None:
            flags |= marks
        stamps = np.array([cycle.stamp_ns for cycle in cycles], dtype=np.int64)
        latencies = np.array([cycle.latency_ns for cycle in cycles], dtype=np.int64)
        self._statistics.add(stamps, latencies, flags)
        first, self._first_cycle = self._first_cycle, self._first_cycle + rows
        return first, counts, flags
