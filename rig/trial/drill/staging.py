"""One run in which things happen: put together, run, and looked at by the plant's truth, its file and its events."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DriverError
from drivers.readout.nd287 import Readout, ReadoutConfig
from experiments.recording import Event
from rig.bench.backends.assembly import AssembledRig
from rig.bench.backends.order import Order
from rig.run.bystander import standing_by
from rig.run.dry_run import PlannedRun
from rig.run.make_safe import Patience
from rig.run.parts import RunReport, SessionParts
from rig.run.session import GIVEN_UP, execute
from rig.run.stop import StopRequest
from rig.runfile.read import close_recording, open_run
from rig.trial.drill.catalogue import Drill
from rig.trial.drill.cause import NO_VALUE, causes_of_events, not_obeyed, reading_refused
from rig.trial.drill.disk import FailingDisk
from rig.trial.drill.marks import Marks, left_readable, look_at_file
from rig.trial.drill.protocol import breaks_closure
from rig.trial.drill.rigs import Carrier, DrilledRig, Happening, drilled_rig

BLOCK_CYCLES = 20
"""Cycles per exchange of a drill: what a rig in real time at 1 kHz would use."""
_AFTERWARDS = 10.0
"""s of the computer's own time for the process beside a run to say what it has to."""
_AFTERMATH = 1.0
"""s of rig time that pass, where standstill was not verified, before the truth is looked at: the
drive stops by itself.
"""
PATIENCE = Patience(ramp=0.3, quick_stop=0.3, servo_off=1.2)
"""Less than a real rig is given, as the simulated one stops within a few hundredths of a second or not at all; but
three times the longest silence among the faults, in which nobody can say so.
"""
SPOILED = "measurement spoiled unnoticed"
"""What a drill detects, and must not, where a completed run shows a lost revolution that nothing has marked."""
COMPARED = ("input_angle", "output_angle", "torque")
"""Channels whose counts a harmless fault must leave as they are, or mark."""


@dataclass(frozen=True)
class Reference:
    """The drill's run with nothing going wrong: rows at which things can happen, and its outcome."""

    rows: dict[str, int]
    outcome: str
    counts: dict[str, NDArray[np.int64]]
    """Counts of both encoders and the torque port in every row, by channel."""


def _made_safe_at(report: RunReport) -> int:
    """The row from which on a run was made safe: its end, where nothing had to be."""
    return report.rows - (report.make_safe.rows if report.make_safe is not None else 0)


def reference_run(planned: PlannedRun, carrier: Carrier, seed: int, folder: Path) -> Reference:
    """Run with nothing going wrong, and find the rows at which things can happen."""
    rig = drilled_rig(carrier, planned.gear, planned.motor, (), StopRequest(), seed)
    report = execute(_parts(planned, rig, folder, seed), FailingDisk("", 0).begin)
    recording = open_run(report.path)
    segments = {}
    for segment in recording.segments:
        segments.setdefault(segment.label, segment)
    counts = {name: recording.stored(name) for name in COMPARED}
    close_recording(recording)
    rows = {label: (segment.start + segment.stop) // 2 for label, segment in segments.items()}
    rows |= {
        "start": 0,
        "preflight": 100,
        "switching-on": segments["zero-before"].stop + 5,
        "ramp": segments["hold"].start - 15,
        "making-safe": _made_safe_at(report) + 5,
    }
    return Reference(rows, report.outcome, counts)


def _parts(
    planned: PlannedRun,
    rig: DrilledRig,
    folder: Path,
    seed: int,
    free_space: Callable[[], int] | None = None,
    conditions: Mapping[str, Any] = MappingProxyType({}),
) -> SessionParts:
    folder.mkdir(parents=True, exist_ok=True)
    return SessionParts(
        order=Order(
            protocol=planned.experiment.name,
            gear=planned.gear,
            motor=planned.motor,
            folder=folder,
            operator="drill",
            serial="drill",
            seed=seed,
            conditions=conditions,
        ),
        planned=planned,
        rig=AssembledRig(name="drill", port=rig, clock=rig.clock),
        cycles=BLOCK_CYCLES,
        make_safe_cycles=BLOCK_CYCLES,
        patience=PATIENCE,
        free_space=free_space,
    )


@dataclass(frozen=True)
class Placed:
    """A drill's fault at a row of the run."""

    drill: Drill
    row: int

    def happening(self) -> Happening:
        """What happens in the rig."""
        drill = self.drill
        return Happening(
            self.row,
            drill.fault,
            drill.press,
            drill.prepare,
            drill.moment == "start",
            drill.limits_factor,
        )


@dataclass(frozen=True, kw_only=True)
class Ending:
    """What came of a run in which things happened.

    `safe` is the truth of the plant: it stands without power in the end, and stood so at the
    instant at which the program said so. `evidence` has a sentence for each thing that happened,
    empty where nothing shows that it has. Without a `report` the run was refused (`message`).
    """

    report: RunReport | None
    message: str
    safe: bool
    evidence: tuple[str, ...]
    causes: tuple[str, ...] = ()
    marks: Marks = field(default_factory=lambda: Marks(""))
    file_readable: bool = False
    cycles: int = 0
    verified: bool = False
    """Whether the program has verified standstill."""
    rightly_denied: bool = False
    """Whether the motor did turn or had power within the window before the program said that
    standstill is not verified.
    """
    ended_early: bool = False
    """Whether something ended the run before its plan did."""

    @property
    def outcome(self) -> str:
        """The run's outcome; ERROR for one that was refused."""
        return self.report.outcome if self.report is not None else "ERROR"

    @property
    def detected(self) -> str:
        """What was detected, in words: what ended the run, or how its cycles are marked."""
        ended = [cause for cause in self.causes if cause not in self.marks.causes]
        wrong = [self.marks.words] if self.marks.wrong or not ended else []
        return "; ".join([*wrong, *ended])

    @property
    def action(self) -> str:
        """The stages that were taken, and who really stopped the motor when nobody could hear them."""
        if self.report is None:
            return "refused"
        if self.report.make_safe is None:
            return "none"
        if not self.ended_early:
            return "none needed"
        stages = " -> ".join(self.report.make_safe.stages)
        if self.report.safe:
            return stages
        unheard = self.report.make_safe.problem == GIVEN_UP
        return f"{stages}: not heard, the drive by itself" if unheard else f"{stages}: not verified"


@dataclass(kw_only=True)
class Staged:
    """A run about to be made, with its things to happen. `run()` once."""

    parts: tuple[Placed, ...]
    planned: PlannedRun
    carrier: Carrier
    seed: int
    folder: Path
    reference: Reference
    compares: bool = False
    """Whether every count must be that of the run with nothing going wrong, or marked."""
    events: list[Event] = field(default_factory=list)
    reacted_ns: int | None = None
    said_safe: bool = False
    stood_when_said: bool = True
    rightly_denied: bool = False

    def run(self) -> Ending:
        """Run it, look at the truth and at the file."""
        happenings = [part.happening() for part in self.parts]
        stop = StopRequest()
        rig = drilled_rig(
            self.carrier, self.planned.gear, self.planned.motor, happenings, stop, self.seed
        )
        failing = next((part for part in self.parts if part.drill.recording), None)
        disk = FailingDisk(*((failing.drill.recording, failing.row) if failing else ("", 0)))
        reading = self._read_out(rig) if any(part.drill.readout for part in self.parts) else ""
        parts = _parts(
            self.planned,
            rig,
            self.folder,
            self.seed,
            free_space=lambda: disk.free_space(rig.rows),
            conditions={"readout": reading} if reading else {},
        )
        report, message = None, ""
        try:
            report = self._executed(parts, rig, disk, stop)
        except Exception as error:  # noqa: BLE001  whatever comes out of a run, its row says so and fails
            message = f"{type(error).__name__}: {error}"
        finally:
            disk.release()
        if not (report.safe if report is not None else self.said_safe):
            rig.let_time_pass(_AFTERMATH)
        facts = [happening.evidence() for happening in happenings]
        if failing is not None:
            facts[self.parts.index(failing)] = disk.evidence()
        safe = rig.stands and self.stood_when_said
        if report is None:
            return Ending(
                report=None,
                message=message,
                safe=safe,
                evidence=tuple(facts),
                causes=(message.partition(":")[0],),
                file_readable=left_readable(self.folder),
                verified=self.said_safe,
                rightly_denied=self.rightly_denied,
            )
        return self._ending(report, rig, happenings, safe, tuple(facts), reading)

    def _executed(
        self, parts: SessionParts, rig: DrilledRig, disk: FailingDisk, stop: StopRequest
    ) -> RunReport:
        """The run, with the process beside it where the drill has a status page."""
        order = replace(parts.order, status=disk.status(self.folder))
        with standing_by(order, disk.complaints.append) as bystander:
            hears: dict[str, Any] = {"on_event": lambda event: self._take(event, rig, disk)}
            if bystander is not None:
                hears = bystander.hears(lambda prompt: "", None, hears["on_event"])
            report = execute(parts, disk.begin, stop=stop, **hears)
            if bystander is not None:
                bystander.reported(report)
        if bystander is not None:
            bystander.process.is_gone(_AFTERWARDS)
        return report

    def _ending(
        self,
        report: RunReport,
        rig: DrilledRig,
        happenings: list[Happening],
        safe: bool,
        facts: tuple[str, ...],
        reading: str,
    ) -> Ending:
        row = min((part.row for part in self.parts), default=0)
        reference = self.reference.counts if self.compares else {}
        readable, marks = look_at_file(report, row, reference)
        spoiled = (SPOILED,) if breaks_closure(report, self.planned.gear) else ()
        made_safe = report.make_safe
        escalated = made_safe.escalated if made_safe is not None else []
        ended = dict.fromkeys([*causes_of_events(self.events), *map(not_obeyed, escalated)])
        return Ending(
            report=report,
            message=report.message,
            safe=safe,
            evidence=facts,
            causes=(
                *ended,
                *([reading_refused(reading)] if reading else []),
                *marks.causes,
                *spoiled,
            ),
            marks=marks,
            file_readable=readable,
            cycles=self._cycles(report, rig, happenings, marks),
            verified=report.safe,
            rightly_denied=self.rightly_denied,
            ended_early=self.reacted_ns is not None,
        )

    def _cycles(
        self, report: RunReport, rig: DrilledRig, happenings: list[Happening], marks: Marks
    ) -> int:
        """SYNC periods from the first onset to the reaction or the first mark."""
        if self.reacted_ns is None:
            return marks.after
        if any(happening.at_start for happening in happenings):
            return _made_safe_at(report)
        onsets = [happening.onset_ns for happening in happenings if happening.onset_ns is not None]
        waited = self.reacted_ns - min(onsets, default=self.reacted_ns)
        return max(round(waited / rig.cycle_ns), 0)

    def _take(self, event: Event, rig: DrilledRig, disk: FailingDisk) -> None:
        self.events.append(event)
        if event.code == "made-safe":
            # The word is held against the truth at the instant at which it is given.
            self.said_safe, self.stood_when_said = True, rig.stands
        elif event.code == "make-safe-failed":
            window = round(PATIENCE.window * 1e9 / rig.cycle_ns)
            self.rightly_denied = rig.rows - rig.moving_row < window + BLOCK_CYCLES
        if self.reacted_ns is None and event.source == "session":
            self.reacted_ns = rig.clock.monotonic_ns()
            disk.release()

    def _read_out(self, rig: DrilledRig) -> str:
        """Read the readout on the line, as before a run: why no angle can be had, empty where one is believed."""
        assert rig.bench is not None
        rig.prepare()
        reader = Readout(rig.bench.serial(), rig.clock, ReadoutConfig(url="simulated readout"))
        try:
            reading = reader.read()
        except DriverError as error:
            return error.what
        return NO_VALUE if reading.is_fault else ""
