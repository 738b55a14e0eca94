"""The supervisor: a per-cycle guard for the port and a pure review of every block, independent of the protocol.

The guard holds what is linear in the counts of a cycle (speed, torque, torsion of the gear, travel,
drive state, stale data); the review holds what needs windows (following error, missed cycles, heat,
the time base). A trip names cause, value, limit and remedy, is latched, and the table
`rig.run.trips` says how the rig is made safe. Python is not protection: below this are the drive's
own limits, and below those the hardwired stop.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from drivers.channel import (
    DRIVE_TORQUE,
    HOUSING_TEMPERATURE,
    OUTPUT_ANGLE,
    STATUSWORD,
    TORQUE,
    Channel,
)
from drivers.counting import changes
from drivers.drive_state import drive_state
from drivers.port import STALE_DATA, Bound, Guard, Mode
from drivers.samples import Break, CycleFlag, SampleBlock
from model.units import RPM
from rig.bench import limits as lim
from rig.bench.limits import Limits
from rig.run.bounds import BoundMaker, Geometry, Watch
from rig.run.following_review import FollowingReview, FollowingState, first_run
from rig.run.index_review import NO_MARKS, IndexReview, IndexState
from rig.run.margins import DIFFERENCE, FOLLOWING, MISSED, MarginWatch, Peaks
from rig.run.phases import Turn
from rig.run.slip_review import SlipReview, SlipState
from rig.run.thermometer_review import ThermometerState, stood
from rig.run.torque_review import TorqueReview, TorqueState
from rig.run.trips import (
    COUNT_JUMP,
    DEVICE_CAUSES,
    DISAGREEMENT,
    DRIVE_FAULT,
    FOREIGN_COMMAND,
    GUARD_OPEN,
    LATE_TURN,
    MISSED_CYCLES,
    OVER_SPEED,
    OVER_SPEED_OUTPUT,
    OVER_TEMPERATURE,
    OVER_TORQUE,
    SIGNAL_ERROR,
    THERMOMETER,
    TIME_BASE,
    TORQUE_PORT,
    TORSION_TORQUE,
    TRAVEL,
    TRIPS,
    UNEXPECTED_STATE,
    Trip,
)

LONGEST_STEP = 100
"""Periods between two SYNCs above which the computer, or the clock that stamps them, has failed."""


_MISSED_FLAGS = np.uint16(CycleFlag.INCOMPLETE | CycleFlag.LATE | CycleFlag.SHORT)
"""A cycle with one of these was missed. A number of numpy: with a flag of Python every `&` takes far longer."""


@dataclass(frozen=True, kw_only=True)
class _WatchState:
    """What the supervisor carries from block to block. Immutable: a review makes the next one."""

    rows: int = 0
    trip: Trip | None = None
    next_cycle: int | None = None
    last_time: int | None = None
    last_sync: int | None = None
    mode: Mode = Mode.OFF
    lost: int = 0
    flagged: int = 0
    window_rows: int = 0
    window_missed: int = 0
    following: FollowingState = field(default_factory=FollowingState)
    flag_runs: tuple[int, int, int] = (0, 0, 0)
    has_stamps: bool = False
    """Whether some cycle so far carried a stamp of the hardware or the device."""
    torque: TorqueState = field(default_factory=TorqueState)
    index: IndexState = NO_MARKS
    slip: SlipState = field(default_factory=SlipState)
    thermometer: ThermometerState = field(default_factory=ThermometerState)
    notes: tuple[tuple[str, str], ...] = ()
    """What the latest review saw that is worth an event: code and text."""
    peaks: Peaks = field(default_factory=Peaks)

    @property
    def missed_share(self) -> float:
        """Share of the cycles so far that were lost, incomplete or late."""
        total = self.rows + self.lost
        return (self.flagged + self.lost) / total if total else 0.0


class Supervisor:
    """Guards and reviews one run. `geometry` None: the bare motor, or a rig without output encoder."""

    def __init__(
        self,
        channels: Sequence[Channel],
        cycle_ns: int,
        limits: Limits,
        geometry: Geometry | None,
        travel: tuple[float, float] = (-math.inf, math.inf),
        watch: Watch | None = None,
    ) -> None:
        self.watch = watch or Watch()
        self.limits = limits
        self.state = _WatchState()
        self._channels = {channel.name: channel for channel in channels}
        self._column = {channel.name: i for i, channel in enumerate(channels)}
        self._period = cycle_ns * 1e-9
        self._cycle_ns = cycle_ns
        self._geometry = geometry if OUTPUT_ANGLE in self._column else None
        self._maker = BoundMaker(
            self._channels, self._period, limits, self._geometry, travel, self.watch
        )
        self._always: tuple[Bound, ...] = ()
        self._enabled: tuple[Bound, ...] = ()
        self._margins = self._margin_watch(())
        self._torque_review = TorqueReview(self.watch, limits.value(lim.RMS_TORQUE), self._period)
        self._following_review = FollowingReview(
            watch=self.watch,
            period=self._period,
            channels=self._channels,
            column=self._column,
            limits=limits,
        )
        self._index_review = IndexReview(self.watch, self._channels, self._column)
        self._slip_review = self._slip_review_from({})

    def begin(self, reference: NDArray[np.int64], rows: int = 0) -> None:
        """Take the position at standstill with the servo off (counts of all channels) as untwisted,
        and set up the guard.
        """
        self.state = replace(self.state, rows=rows)
        self._always, self._enabled = self._maker.always(reference), self._maker.enabled()
        self._margins = self._margin_watch(self._always)
        counts = dict(zip(self._channels, reference.tolist(), strict=True))
        self._slip_review = self._slip_review_from(counts)

    def _slip_review_from(self, reference: Mapping[str, int]) -> SlipReview:
        return SlipReview(
            watch=self.watch,
            period=self._period,
            channels=self._channels,
            column=self._column,
            geometry=self._geometry,
            reference=reference,
        )

    def _margin_watch(self, bounds: tuple[Bound, ...]) -> MarginWatch:
        return MarginWatch(
            channels=self._channels,
            column=self._column,
            period=self._period,
            limits=self.limits,
            watch=self.watch,
            geometry=self._geometry,
            bounds=bounds,
        )

    def guard(self, turn: Turn) -> Guard:
        """The bounds for the next cycles: everything that must never happen, and what ends the present phase."""
        if self.state.trip is not None:
            return Guard(turn.until)
        state = self._enabled if turn.enabled else ()
        return Guard((*self._always, *state, *turn.until), self.watch.stale_cycles)

    def review(self, block: SampleBlock, turn: Turn) -> Trip | None:
        """Look at a block that has been recorded; the trip that is latched, if there is one."""
        self.state = self.reviewed(self.state, block, turn)
        return self.state.trip

    def latch(self, trip: Trip) -> None:
        """Latch a trip that was seen outside the blocks (bus, disk); an earlier one stays."""
        if self.state.trip is None:
            self.state = replace(self.state, trip=trip)

    def name_silence(self, late: str) -> Trip | None:
        """The latched trip under its right name, once missing answers have turned out to be `late` and not lost."""
        trip = self.state.trip
        if not late or trip is None or trip.cause != STALE_DATA:
            return None
        trip = replace(trip, cause=MISSED_CYCLES, detail=late)
        self.state = replace(self.state, trip=trip)
        return trip

    def explain(self, text: str, cause: str = "") -> None:
        """What a device said of the latched trip, where the trip itself has no words for it.

        A state to which a stranger's command led the drive in the same block bears the stranger's name.
        """
        trip = self.state.trip
        if trip is not None and trip.cause == UNEXPECTED_STATE and cause == FOREIGN_COMMAND:
            self.state = replace(self.state, trip=replace(trip, cause=cause, detail=text))
            return
        if trip is not None and text and not trip.detail and trip.cause in DEVICE_CAUSES:
            self.state = replace(self.state, trip=replace(trip, detail=text))

    # The rest is pure: state and block in, state out.

    def reviewed(self, state: _WatchState, block: SampleBlock, turn: Turn) -> _WatchState:
        """The state after a block. The break of the guard comes first: it is the earliest."""
        if not len(block):
            return state
        start = state.rows
        if state.notes:
            state = replace(state, notes=())
        trips: list[Trip] = []
        if block.broken is not None and block.broken.is_trip:
            trips.append(self._trip_of(block, block.broken, start))
        state, new = self._cycles(state, block, turn)
        trips += new
        state, new = self._flags(state, block, start)
        trips += new
        following, new = self._following_review.reviewed(state.following, block, turn, start)
        trips += new
        state, new = self._torques(state, block, start)
        trips += new
        state, new = self._slow(state, block, start)
        trips += new
        index, new, notes = self._index_review.reviewed(state.index, block, start)
        trips += new
        return replace(
            state,
            following=following,
            index=index,
            notes=(*state.notes, *notes),
            peaks=self._margins.after(state.peaks, block).with_values(self._shares(state)),
            rows=start + len(block),
            trip=trips[0] if state.trip is None and trips else state.trip,
        )

    def _shares(self, state: _WatchState) -> dict[str, float]:
        """How far the review's own quantities have come."""
        length = max(1, round(self.watch.missed_window / self._period))
        shares = {
            FOLLOWING: state.following.longest * self._period,
            MISSED: state.window_missed / max(state.window_rows, length),
            DIFFERENCE: state.torque.share,
        }
        if state.torque.hottest:
            shares[lim.RMS_TORQUE] = math.sqrt(state.torque.hottest) * self.limits.value(
                lim.RMS_TORQUE
            )
        return shares

    def _si(self, block: SampleBlock, name: str) -> NDArray[np.float64]:
        return self._channels[name].to_si(block.counts[:, self._column[name]])

    def _trip_of(self, block: SampleBlock, broken: Break, start: int) -> Trip:
        """The trip for a broken guard; a twist without the torque that would make it is a
        disagreement of the encoders.
        """
        row = start + broken.row
        units = {
            OVER_SPEED: ("r/min", RPM),
            OVER_SPEED_OUTPUT: ("r/min at the input", RPM),
            OVER_TORQUE: ("N m", 1.0),
            TORSION_TORQUE: ("N m", 1.0),
            TRAVEL: ("rev", 2.0 * math.pi),
            OVER_TEMPERATURE: ("degC", 1.0),
            STALE_DATA: ("cycles", 1.0),
            MISSED_CYCLES: ("cycles in a row whose time is not known", 1.0),
        }
        if broken.cause in (DRIVE_FAULT, UNEXPECTED_STATE):
            word = int(block.counts[broken.row, self._column[STATUSWORD]])
            detail = f"statusword 0x{word:04X}, {drive_state(word).value}"
            return Trip(broken.cause, row, math.nan, math.nan, detail=detail)
        if broken.cause in DEVICE_CAUSES or broken.cause == GUARD_OPEN:
            # The port says what happened in an event, or a contact has opened: there is no number to compare.
            return Trip(broken.cause, row, math.nan, math.nan)
        geometry = self._geometry
        if broken.cause == TORSION_TORQUE and geometry is not None and TORQUE in self._column:
            recent = self._si(block, TORQUE)[max(0, broken.row - 20) : broken.row + 1]
            carried = geometry.ratio * float(np.max(np.abs(recent)))
            if carried < 0.5 * abs(broken.value):
                allowed = math.degrees(abs(broken.limit) / geometry.stiffness) * 60.0
                twist = math.degrees(broken.value / geometry.stiffness) * 60.0
                detail = f"the motor's torque accounts for at most {carried:.3g} N m of {abs(broken.value):.3g} N m"
                return Trip(
                    DISAGREEMENT, row, twist, math.copysign(allowed, twist), "arcmin", detail
                )
        unit, factor = units.get(broken.cause, ("", 1.0))
        if broken.cause == OVER_TEMPERATURE and not (
            self.watch.coldest <= broken.value <= self.watch.hottest
        ):
            limit = self.watch.coldest if broken.value < 0.0 else self.watch.hottest
            return Trip(THERMOMETER, row, broken.value, limit, unit)
        if broken.cause not in TRIPS:
            return Trip(broken.cause, row, math.nan, math.nan)
        return Trip(broken.cause, row, broken.value / factor, broken.limit / factor, unit)

    def _cycles(
        self, state: _WatchState, block: SampleBlock, turn: Turn
    ) -> tuple[_WatchState, list[Trip]]:
        """Lost, incomplete and late cycles over a window, SYNCs that the computer sent far too late,
        and stamps that run backwards or away from the SYNCs.
        """
        lost = 0 if state.next_cycle is None else max(0, block.first_cycle - state.next_cycle)
        bad = int(np.count_nonzero(block.flags & _MISSED_FLAGS))
        rows, missed = state.window_rows + len(block) + lost, state.window_missed + bad + lost
        trips: list[Trip] = []
        length = max(1, round(self.watch.missed_window / self._period))
        allowed = max(self.watch.missed_share * max(rows, length), self.watch.stale_cycles)
        if missed > allowed:
            share = 100.0 * missed / max(rows, length)
            trips.append(
                Trip(MISSED_CYCLES, state.rows, share, 100.0 * self.watch.missed_share, "%")
            )
        if rows >= length:
            rows = missed = 0
        trips += self._intervals(state, block, turn, lost)
        state = replace(
            state,
            next_cycle=block.first_cycle + len(block),
            last_time=int(block.time_ns[-1]),
            last_sync=int(block.interval_ns[-1]),
            mode=turn.command.mode,
            lost=state.lost + lost,
            flagged=state.flagged + bad,
            window_rows=rows,
            window_missed=missed,
        )
        return state, trips

    def _intervals(
        self, state: _WatchState, block: SampleBlock, turn: Turn, lost: int
    ) -> list[Trip]:
        """SYNCs that the computer sent far too late, and stamps that run backwards or away from the SYNCs."""
        longest = LONGEST_STEP * self._cycle_ns
        steps = self._steps(block.time_ns, state.last_time, lost)
        raised = [(TIME_BASE, (steps <= 0) | (steps > longest), steps)]
        if block.sync_ns is not None:
            sent = self._steps(block.sync_ns, state.last_sync, lost)
            overdue = (sent > longest) & turn.enabled
            # Changing the mode goes by SDO and may take its time.
            overdue[0] &= state.mode is turn.command.mode
            # Where the computer itself was late, the stamps are right to say so.
            late = np.maximum(sent - self._cycle_ns, 0)
            away = (steps <= 0) | (steps - late > longest)
            raised = [(LATE_TURN, overdue, sent), (TIME_BASE, away, steps)]
        trips: list[Trip] = []
        for cause, rows, step in raised:
            if rows.any():
                row = int(np.argmax(rows))
                value, limit = float(step[row]) * 1e-6, longest * 1e-6
                trips.append(Trip(cause, state.rows + row, value, limit, "ms between SYNCs"))
        return trips

    def _steps(self, times: NDArray[np.int64], last: int | None, lost: int) -> NDArray[np.int64]:
        """Times (n,) between a block's cycles and the ones before them [ns], without those of lost cycles."""
        before = times[0] - self._cycle_ns if last is None else last + lost * self._cycle_ns
        return changes(times, before)

    def _flags(
        self, state: _WatchState, block: SampleBlock, start: int
    ) -> tuple[_WatchState, list[Trip]]:
        """Flags that devices and decoders raise, several cycles in a row; a jump of a count at once."""
        trips: list[Trip] = []
        if not block.flags.any():
            if not state.has_stamps or any(state.flag_runs):
                state = replace(state, flag_runs=(0, 0, 0), has_stamps=True)
            return state, trips
        jumps = np.flatnonzero(block.flags & CycleFlag.JUMPED)
        if len(jumps):
            trips.append(Trip(COUNT_JUMP, start + int(jumps[0]), math.nan, math.nan))
        runs: list[int] = []
        for flag, before, cause, allowed in (
            (CycleFlag.SIGNAL_ERROR, state.flag_runs[0], SIGNAL_ERROR, self.watch.signal_cycles),
            (CycleFlag.SATURATED, state.flag_runs[1], TORQUE_PORT, self.watch.torque_port_cycles),
            # Only a clock that was there can be lost.
            (
                CycleFlag.HOST_TIME if state.has_stamps else 0,
                state.flag_runs[2],
                TIME_BASE,
                self.watch.host_time_cycles,
            ),
        ):
            raised = (block.flags & flag) != 0
            at, run, _ = first_run(raised, before, allowed)
            runs.append(run)
            if at is not None:
                trips.append(
                    Trip(cause, start + at, float(allowed), float(allowed), "cycles in a row")
                )
        has_stamps = state.has_stamps or bool(((block.flags & CycleFlag.HOST_TIME) == 0).any())
        return replace(state, flag_runs=(runs[0], runs[1], runs[2]), has_stamps=has_stamps), trips

    def _slow(
        self, state: _WatchState, block: SampleBlock, start: int
    ) -> tuple[_WatchState, list[Trip]]:
        """What goes wrong slowly: slip between the encoders, a thermometer that does not move any more."""
        slip, trips = self._slip_review.reviewed(state.slip, block, start)
        thermometer, notes = state.thermometer, ()
        if HOUSING_TEMPERATURE in self._column:
            counts = block.complete_counts[:, self._column[HOUSING_TEMPERATURE]]
            thermometer, notes = stood(state.thermometer, counts, self.watch, self._period)
        notes = (*state.notes, *notes)
        return replace(state, slip=slip, thermometer=thermometer, notes=notes), trips

    def _torques(
        self, state: _WatchState, block: SampleBlock, start: int
    ) -> tuple[_WatchState, list[Trip]]:
        """Heat of the motor, and port against drive in complete cycles while nothing has tripped."""
        name = TORQUE if TORQUE in self._column else DRIVE_TORQUE
        if name not in self._column:
            return state, []
        torque = self._si(block, name)
        reviewed, trips, notes = self._torque_review.heated(state.torque, torque, start)
        if TORQUE in self._column and DRIVE_TORQUE in self._column and state.trip is None:
            good = block.complete
            drive = self._si(block, DRIVE_TORQUE)[good]
            reviewed, new, notes = self._torque_review.compared(
                reviewed, torque[good], drive, start
            )
            trips = trips + new
        return replace(state, torque=reviewed, notes=(*state.notes, *notes)), trips

    def acquisition(self) -> dict[str, object]:
        """What the review has seen of the acquisition: counts at the index marks, and torque port against drive."""
        figures: dict[str, object] = {}
        if index := self._index_review.figures(self.state.index):
            figures["index_marks"] = index
        if agreement := self.state.torque.agreement.figures():
            figures["torque_port_against_drive"] = agreement
        return figures

    def margins(self) -> dict[str, dict[str, float]]:
        """Peak, limit and what was left of it (share) for every quantity that was watched."""
        return self._margins.report(self.state.peaks, self._following_review.patience)
