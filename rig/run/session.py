"""The session: one execution of a protocol on a rig, and the only loop in which a rig turns, in both clocks.

    while turn is not None:
        block = port.exchange(turn.command, turn.cycles, supervisor.guard(turn))
        logbook.put(block)                     record first, so that the tripping block is kept
        supervisor.review(block, turn)         pure
        turn = engine or make-safe .next(block)

Whatever ends the run (the plan's end, STOP, ABORT, a trip, a step that fails, an exception),
make-safe has the last word and is verified. The outcome: TRIPPED, ABORTED and ERROR say why it
ended early, COMPLETED that the plan was carried out. What the recording says of the gear is worked
out from the sealed file, by whoever asks: no analysis can cost the data.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from datetime import UTC, datetime

import numpy as np

from drivers.channel import OUTPUT_ANGLE
from drivers.errors import BusLostError, DriverError, StaleDataError
from drivers.port import STALE_DATA, Command, Guard, Mode
from drivers.samples import SampleBlock
from experiments.finding import Finding, Severity
from experiments.recording import Event
from experiments.steps.profile import cycles_of
from rig.bench import limits as lim
from rig.errors import LimitError, RigError
from rig.run.acquisition import AcquisitionLog
from rig.run.bounds import Geometry
from rig.run.callbacks import ON_PROGRESS, Callbacks, brought_to_its_end, how_it_ended
from rig.run.devices import DeviceListener
from rig.run.direct_line import STOP
from rig.run.dry_run import PlannedRun
from rig.run.emergency import GIVEN_UP, Emergency
from rig.run.engine import Ask, Engine, StepFailedError
from rig.run.latch import LatchedTrip
from rig.run.logbook import Logbook, iso_time
from rig.run.make_safe import Action, MakeSafe
from rig.run.margins import worded
from rig.run.parts import Begin, Progress, RunReport, SessionParts
from rig.run.phases import Journal, Machine, Turn
from rig.run.preflight import (
    STANDING_TIME,
    channel_checks,
    drive_limits_check,
    refuse_failed,
    set_point_checks,
    standing_checks,
    static_checks,
)
from rig.run.stop import StopRequest
from rig.run.supervisor import Supervisor
from rig.run.telling import ProgressTeller
from rig.run.trips import BUS_LOST, DEVICE_ERROR, DISK_SPACE, LATE_TURN, MAKE_SAFE_FAILED, Trip
from rig.run.watchdog import Watchdog

_STOP_SHARE = 0.25
"""Share of the allowed deceleration that a controlled stop uses."""
_SPACE_CHECK_CYCLES = 1000
"""Cycles between two looks at the free space of the disk."""
LEVELS = {Severity.WARNS: "warning", Severity.BLOCKS: "error"}
"""How the run's log ranks what preflight found; what is not listed is for information."""
_EXCHANGE_ATTEMPTS = 3
"""Exchanges in a row without an answer after which the run trips, and again as many until making safe is given up."""


def execute(
    parts: SessionParts,
    begin: Begin,
    *,
    stop: StopRequest | None = None,
    ask: Ask = lambda prompt: "",
    on_progress: Callable[[Progress], None] | None = None,
    on_event: Callable[[Event], None] | None = None,
) -> RunReport:
    """Run what was put together, from preflight to the sealed file. What callbacks raise: see `rig.run.callbacks`.

    Raises (`RigError`, `LimitError`, `DriverError`) for what is wrong before there is a file and
    before anything moves; afterwards every ending is in the report. A rig that is connected and
    refuses (its limits read back differently, it does not stand) leaves a file that says so.
    """
    stop = stop or StopRequest()
    callbacks = Callbacks(stop, ask, on_progress, on_event)
    return brought_to_its_end(lambda: _execute(parts, begin, stop, callbacks), callbacks, stop)


def _execute(
    parts: SessionParts, begin: Begin, stop: StopRequest, callbacks: Callbacks
) -> RunReport:
    planned, port, clock = parts.planned, parts.rig.port, parts.rig.clock
    if parts.latch is not None:
        parts.latch.refuse()
    checks = static_checks(planned, parts.order.folder)
    refuse_failed(checks)
    try:
        description = port.open()
        today = datetime.fromtimestamp(clock.calendar_ns() * 1e-9, UTC).date()
        checks = (*checks, *channel_checks(port.channels, planned.experiment.needs, today))
        checks = (*checks, *set_point_checks(port.channels, planned.plan))
        refuse_failed(checks)
        checks = (*checks, _write_limits(parts), *(parts.arm() if parts.arm is not None else ()))
        # One cycle with the servo off ties the rig's time stamps to the calendar.
        calendar = clock.calendar_ns()
        first = port.exchange(Command(Mode.OFF), 1, Guard())
        if not len(first):
            raise StaleDataError(
                "no cycle came back", where="preflight", remedy="Check the bus and the SYNC."
            )
        epoch = calendar - int(first.time_ns[0])
        begun = begin(parts, description, epoch, iso_time(calendar))
        logbook = Logbook(begun, epoch, callbacks.on_event)
        session = Session(parts, logbook, stop, callbacks)
        return session.run(first, checks)
    finally:
        port.close()


class Session:
    """One run that has its file and has not moved yet. `run()` once."""

    def __init__(
        self,
        parts: SessionParts,
        logbook: Logbook,
        stop: StopRequest,
        callbacks: Callbacks,
    ) -> None:
        port, planned = parts.rig.port, parts.planned
        self._parts, self._port, self._planned = parts, port, planned
        self._logbook, self._stop, self._callbacks = logbook, stop, callbacks
        self._machine = Machine(port.channels, port.cycle_ns)
        geometry = _geometry(planned) if self._machine.has(OUTPUT_ANGLE) else None
        self._supervisor = Supervisor(
            port.channels, port.cycle_ns, planned.limits, geometry, planned.travel, parts.watch
        )
        self._engine = Engine(planned.plan, self._machine, logbook, callbacks.ask, parts.cycles)
        self._make_safe: MakeSafe | None = None
        self._outcome = self._message = ""
        self._devices = DeviceListener(port, logbook)
        self._acquisition = AcquisitionLog(port, logbook)
        self._silent = 0
        self._teller = ProgressTeller(
            planned, self._engine, self._machine, self._supervisor, str(logbook.run.part)
        )
        self._space_rows = 0

    def run(self, first: SampleBlock, checks: tuple[Finding, ...]) -> RunReport:
        """Stand and look, execute the plan, make safe, seal."""
        try:
            self._stand(first, checks)
            self._turn_until_safe()
        except BaseException as error:
            self._outcome = "ABORTED" if isinstance(error, KeyboardInterrupt) else "ERROR"
            self._message = f"{type(error).__name__}: {error}"
            self._emergency(error)
            try:
                error.add_note(how_it_ended(self._report()))
            except Exception as failed:  # noqa: BLE001  the first error is the one that is raised
                error.add_note(f"The run file was not closed: {type(failed).__name__}: {failed}")
                self._logbook.run.recorder.abandon()
            raise
        finally:
            if self._parts.watchdog is not None:
                self._parts.watchdog.rest()
        self._outcome = self._outcome or "COMPLETED"
        return self._report()

    def _stand(self, first: SampleBlock, checks: tuple[Finding, ...]) -> None:
        """Stand for a moment with the servo off, look, and take the position as reference; refuse a
        rig that is not fit.
        """
        turn = Turn(Command(Mode.OFF), 1)
        blocks = [first]
        self._keep(first, turn)
        left = cycles_of(STANDING_TIME, self._machine.period)
        while left > 0:
            turn = Turn(Command(Mode.OFF), min(left, self._parts.cycles))
            block = self._port.exchange(turn.command, turn.cycles, Guard())
            if not len(block):
                raise StaleDataError(
                    "no cycle came back", where="preflight", remedy="Check the bus and the SYNC."
                )
            self._keep(block, turn)
            blocks.append(block)
            left -= len(block)
        counts = np.concatenate([block.counts for block in blocks])
        flags = np.concatenate([block.flags for block in blocks])
        standing = standing_checks(
            self._port.channels, counts, flags, self._planned.motor.rated_torque
        )
        checks = (*checks, *standing)
        for check in checks:
            self._logbook.event(
                LEVELS.get(check.severity, "info"), "preflight", "preflight", check.sentence
            )
        self._supervisor.begin(np.rint(counts.mean(axis=0)).astype(np.int64), self._machine.rows)
        try:
            refuse_failed(checks)
        except RigError as error:
            self._end(Action.ZERO_TORQUE, "ERROR", str(error), "preflight")

    # The loop.

    def _turn_until_safe(self) -> None:
        turn = self._advance(None)
        while turn is not None:
            block = self._exchange(turn)
            if self._parts.watchdog is not None:
                self._watch_turns(self._parts.watchdog)
            if block is not None:
                self._keep(block, turn)
                self._name_silence()
                self._supervisor.review(block, turn)
                self._supervisor.explain(self._devices.latest_error, self._devices.latest_cause)
                for code, text in self._supervisor.state.notes:
                    self._logbook.event("warning", code, "supervisor", text)
            self._watch_space()
            self._hear_operator()
            turn = self._advance(block)
            self._tell_progress()

    def _hear_operator(self) -> None:
        """What was said beside the run: notes, and what has failed on the operator's side."""
        self._stop.heed_main_thread()
        for note in self._stop.take_notes():
            self._logbook.event("info", "note", "operator", note)
        for text in self._stop.take_problems():
            self._logbook.event("warning", "callback", "session", text)

    def _name_silence(self) -> None:
        """A silence that ended the run and whose answers came after all was the computer's, not a cable's."""
        trip = self._supervisor.name_silence(self._devices.late_answers)
        if trip is not None and self._outcome == "TRIPPED":
            self._message = str(trip)
            self._logbook.event("error", trip.cause, "session", self._message)

    def _watch_turns(self, watchdog: Watchdog) -> None:
        """Tell the watchdog that a turn has happened; if it has acted, it knew better."""
        watchdog.turned()
        if problem := watchdog.take_problem():
            self._logbook.event("error", "watchdog", "watchdog", problem)
        if watchdog.acted:
            pause, allowed = watchdog.longest_pause * 1e3, watchdog.deadline * 1e3
            self._supervisor.latch(
                Trip(LATE_TURN, self._machine.rows, pause, allowed, "ms without a turn")
            )

    def _watch_space(self) -> None:
        if (
            self._machine.rows - self._space_rows < _SPACE_CHECK_CYCLES
            or self._parts.free_space is None
        ):
            return
        self._space_rows = self._machine.rows
        free, least = self._parts.free_space(), self._supervisor.watch.smallest_free_space
        if free < least:
            self._supervisor.latch(
                Trip(DISK_SPACE, self._machine.rows, free / 1e6, least / 1e6, "MB free")
            )

    def _keep(self, block: SampleBlock, turn: Turn) -> None:
        """Record first, then take notice."""
        self._logbook.put(block)
        self._acquisition.put(block)
        self._machine.accept(block, turn)
        self._devices.keep_events()

    def _exchange(self, turn: Turn) -> SampleBlock | None:
        """One exchange; None when the rig did not answer (which latches a trip)."""
        row = self._machine.rows
        mode, watchdog = turn.command.mode, self._parts.watchdog
        if watchdog is not None and mode is not self._machine.mode and mode not in STOP:
            # The drive is switched on or over by SDO within this exchange, which may take its time at standstill.
            watchdog.rest()
        try:
            block = self._port.exchange(turn.command, turn.cycles, self._supervisor.guard(turn))
        except DriverError as error:
            stale = isinstance(error, StaleDataError)
            cause = BUS_LOST if isinstance(error, BusLostError) else DEVICE_ERROR
            if stale:
                cause = STALE_DATA
            self._silent += 1
            self._devices.keep_events()
            if self._silent == 1:
                self._logbook.event("error", cause, "port", str(error))
            self._supervisor.latch(Trip(cause, row, math.nan, math.nan, detail=str(error)))
            return None
        if len(block):
            self._silent = 0
            return block
        self._silent += 1
        if self._silent >= _EXCHANGE_ATTEMPTS:
            self._supervisor.latch(Trip(STALE_DATA, row, float(self._silent), 0.0, "empty blocks"))
        return None

    def _advance(self, block: SampleBlock | None) -> Turn | None:
        """Who leads from here (plan or make-safe), and its next turn."""
        if self._change_leader():
            # The block belongs to a phase of the leader before; the new one starts with none.
            block = None
        if self._make_safe is not None and self._silent >= 2 * _EXCHANGE_ATTEMPTS:
            self._make_safe.give_up(GIVEN_UP)
            return None
        if self._make_safe is None:
            try:
                turn = self._engine.next(block)
            except StepFailedError as error:
                self._end(Action.CONTROLLED_STOP, "ERROR", str(error), "step-failed")
            else:
                if turn is not None:
                    return turn
                self._make_safe = self._make_safe_by(Action.ZERO_TORQUE)
            block = None
        assert self._make_safe is not None
        return self._make_safe.next(block)

    def _change_leader(self) -> bool:
        """Hand over to make-safe, or to a harder action, when a trip, the recorder or the operator says so."""
        # In the order of rank: a trip takes over from whatever goes on, the operator from the plan or a softer stop.
        trip, error = self._supervisor.state.trip, self._logbook.error
        # A ramp is given up for any trip, whatever it was begun for: the drive may not follow it any more.
        made = self._make_safe
        ramps = made is not None and made.report.action is Action.CONTROLLED_STOP
        if trip is not None and (ramps or self._outcome not in ("TRIPPED", "ERROR")):
            failed = self._outcome == "ERROR"
            message = f"{self._message} (While it was stopped: {trip})" if failed else str(trip)
            self._end(trip.action, "ERROR" if failed else "TRIPPED", message, trip.cause)
            return True
        if error is not None and self._outcome in ("", "ABORTED"):
            self._end(Action.QUICK_STOP, "ERROR", str(error), "recorder")
            return True
        level = self._stop.level
        if level and self._make_safe is None:
            stop = level == 1
            action = Action.CONTROLLED_STOP if stop else Action.QUICK_STOP
            if stop:
                text = f"STOP by {self._stop.by}: controlled ramp"
            else:
                text = f"ABORT by {self._stop.by}: quick stop"
            self._end(action, "ABORTED", text, "STOP" if stop else "ABORT")
            return True
        if level == 2 and ramps:
            text = f"ABORT by {self._stop.by}: quick stop"
            self._end(Action.QUICK_STOP, self._outcome, text, "ABORT")
            return True
        return False

    def _end(self, action: Action, outcome: str, message: str, code: str) -> None:
        """Leave the plan: cut the open segment, say why, and hand over to make-safe."""
        self._engine.cut()
        self._outcome, self._message = outcome, message
        self._logbook.event(
            "warning" if outcome == "ABORTED" else "error", code, "session", message
        )
        self._make_safe = self._make_safe_by(action)

    def _make_safe_by(self, action: Action, journal: Journal | None = None) -> MakeSafe:
        limits = self._planned.limits
        if action is Action.CONTROLLED_STOP:
            deceleration = _STOP_SHARE * limits.value(lim.DECELERATION)
        else:
            deceleration = limits.value(lim.QUICK_STOP_DECELERATION)
        ratio = self._planned.load.ratio if self._planned.experiment.gear_mounted else math.nan
        cycles = min(self._parts.make_safe_cycles, self._parts.cycles)
        return MakeSafe(
            action=action,
            machine=self._machine,
            journal=journal or self._logbook,
            deceleration=deceleration,
            ratio=ratio,
            block_cycles=cycles,
            patience=self._parts.patience,
            line=self._port.line,
            has_quick_stop=self._port.abilities.has_quick_stop,
        )

    def _emergency(self, error: BaseException) -> None:
        """Make safe after an exception that nobody expected; nothing that happens here may hide it."""
        cycles = min(self._parts.make_safe_cycles, self._parts.cycles)

        def make_safe(journal: Journal) -> MakeSafe:
            self._make_safe = self._make_safe_by(Action.QUICK_STOP, journal)
            return self._make_safe

        emergency = Emergency(self._port, self._machine, cycles, make_safe)
        emergency.stop()
        with emergency.caught.catching():
            self._devices.keep_events()
        with emergency.caught.catching():
            self._engine.cut()
        with emergency.caught.catching():
            self._logbook.event("error", "exception", "session", self._message)
        emergency.keep(self._keep_late, self._logbook)
        for text in emergency.caught.texts():
            error.add_note(text)

    def _keep_late(self, block: SampleBlock) -> None:
        """Record a block after the rig was stopped."""
        self._logbook.put(block)
        self._acquisition.put(block)

    def _tell_progress(self) -> None:
        if self._callbacks.hears(ON_PROGRESS):
            events, leads = len(self._logbook.warnings), self._make_safe is None
            self._callbacks.on_progress(self._teller.progress(events, engine_leads=leads))

    # The end.

    def _report(self) -> RunReport:
        logbook, supervisor = self._logbook, self._supervisor
        ending = self._make_safe.report if self._make_safe else None
        trip = supervisor.state.trip
        if ending is not None and not ending.safe:
            failure = Trip(
                MAKE_SAFE_FAILED, self._machine.rows, math.nan, math.nan, detail=ending.problem
            )
            if self._outcome not in ("TRIPPED", "ERROR", "ABORTED"):
                self._outcome, trip = "TRIPPED", failure
            if self._message:
                self._message = f"{failure} (What ended the run: {self._message})"
            else:
                self._message = str(failure)
        margins = supervisor.margins()
        for name, margin in margins.items():
            words, unit, factor = worded(name)
            peak, limit = margin["peak"] / factor, margin["limit"] / factor
            numbers = f"peak {peak:.4g} {unit}, limit {limit:.4g} {unit}, margin {100 * margin['margin']:.0f} %"
            logbook.event("info", "margin", "supervisor", f"{words}: {numbers}")
        metrics = {"missed_share": supervisor.state.missed_share}
        counted, figures = self._acquisition.figures(supervisor.acquisition())
        metrics.update(counted)
        if self._parts.rig.thermal_state is not None:
            figures["thermal_state"] = dict(self._parts.rig.thermal_state())
        self._hear_operator()
        if trip is not None:
            self._latch_trip(trip)
        if ending is not None and ending.safe and self._parts.marker is not None:
            self._parts.marker.remove()
        path, readable = logbook.close(self._outcome, figures)
        if not readable:
            self._outcome = self._outcome if self._outcome in ("TRIPPED", "ABORTED") else "ERROR"
            self._message = self._message or str(logbook.error)
        return RunReport(
            run_id=logbook.run.run_id,
            outcome=self._outcome,
            path=path,
            rows=self._machine.rows,
            message=self._message,
            trip=trip,
            make_safe=ending,
            warnings=logbook.warnings,
            metrics=metrics,
            margins=margins,
            readable=readable,
        )

    def _latch_trip(self, trip: Trip) -> None:
        """Latch the first cause until it is acknowledged by name."""
        latch, logbook = self._parts.latch, self._logbook
        if latch is None:
            return
        verified = self._make_safe is not None and self._make_safe.report.safe
        try:
            latch.leave(
                LatchedTrip(trip.cause, logbook.run.run_id, logbook.now, self._message, verified)
            )
        except RigError as error:
            logbook.event("error", "latch", "session", str(error))


def _write_limits(parts: SessionParts) -> Finding:
    """What the drive holds of the limits; a drive that holds others is not armed."""
    try:
        return drive_limits_check(parts.rig.port, parts.planned.limits)
    except (LimitError, DriverError) as error:
        return Finding("drive limits", Severity.BLOCKS, str(error))


def _geometry(planned: PlannedRun) -> Geometry | None:
    """What ties both encoders together; None for the bare motor."""
    if not planned.experiment.gear_mounted:
        return None
    stiffness, free = lim.torsion_stiffness(planned.gear), lim.kinematic_error_margin(planned.gear)
    return Geometry(planned.load.ratio, output_sense(planned.mounting), stiffness, free)


def output_sense(mounting: str) -> int:
    """-1 when the output turns against the input (circular spline fixed), +1 when it turns with it."""
    return -1 if mounting == "circular-spline-fixed" else 1
