"""Runs the drills and says what came of each: what was detected, how soon, how the rig was made
safe, what is in the file.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock, VirtualClock
from drivers.drive_state import POWERED_STATES
from drivers.errors import DriverError
from drivers.nd287 import Readout, ReadoutConfig
from drivers.samples import CycleFlag
from experiments.recording import Event, Recording
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig.errors import ConfigurationError, RigError
from rig.run.dry_run import PlannedRun, plan_run
from rig.run.judge import judge_by
from rig.run.make_safe import Patience
from rig.run.order import RunOrder, RunReport
from rig.run.session import GIVEN_UP, execute
from rig.run.stop import StopRequest
from rig.runfile.read import close_recording, open_run
from rig.runfile.recover import recover_run
from rig.trial.drill.catalogue import DRILLS, Drill
from rig.trial.drill.disk import FailingDisk
from rig.trial.drill.protocol import EXPERIMENT, DrillParameters
from rig.trial.drill.rigs import (
    CARRIERS,
    STANDING_SPEED,
    DrilledRig,
    Happening,
    drilled_rig,
    refuse_hardware,
)
from sim_backend.wire.bench import WireBench

BLOCK_CYCLES = 20
"""Cycles per exchange of a drill: what a rig in real time at 1 kHz would use."""
AFTERMATH = 1.0
"""s of rig time that pass, where standstill was not verified, before the truth is looked at: the
drive stops by itself.
"""
PATIENCE = Patience(ramp=0.3, quick_stop=0.3, servo_off=0.6)
"""Less than a real rig is given: the simulated one stops within a few hundredths of a second or not at all."""
COMPARED = ("input_angle", "output_angle", "torque")
"""Channels whose counts a harmless fault must leave as they are, or mark."""
MILLISECOND = 1_000_000


@dataclass(frozen=True, kw_only=True)
class DrillRow:
    """What came of one drill.

    `detected` is the cause that was latched or the mark that was set, `cycles` the SYNC periods
    from onset to the reaction. `safe`: the motor of the simulated rig really stands without power;
    `verified`: the program has verified it as well. `expected` is the outcome that the drill must
    have.
    """

    fault: str
    detected: str
    cycles: int
    action: str
    safe: bool
    outcome: str
    file_readable: bool
    verified: bool
    carrier: str
    expected: str
    message: str = ""

    @property
    def passed(self) -> bool:
        """Whether the drill ended as it must."""
        return (
            self.safe
            and self.file_readable
            and bool(self.detected)
            and self.outcome == self.expected
        )

    def as_json(self) -> dict[str, Any]:
        """The row as `rig drill --json` prints it."""
        return {
            "fault": self.fault,
            "detected": self.detected,
            "cycles": self.cycles,
            "action": self.action,
            "safe": self.safe,
            "outcome": self.outcome,
            "file_readable": self.file_readable,
            "verified": self.verified,
            "backend": self.carrier,
            "expected": self.expected,
            "passed": self.passed,
            "message": self.message,
        }


@dataclass(frozen=True)
class Reference:
    """The drill's run with nothing going wrong: rows at which things can happen, and its outcome."""

    rows: dict[str, int]
    outcome: str
    counts: dict[str, NDArray[np.int64]]
    """Counts of both encoders and the torque port in every row, by channel."""


def chosen(names: Sequence[str], backend: str | None = None) -> list[Drill]:
    """The drills of these names (all without any) that the rig carries. Raises `ConfigurationError`
    for unknown names.
    """
    if backend is not None:
        refuse_hardware(backend)
    unknown = [name for name in names if name not in DRILLS]
    if unknown:
        raise ConfigurationError(
            "no such fault",
            where="--fault",
            value=", ".join(unknown),
            limit=", ".join(DRILLS),
            remedy="Choose one of these.",
        )
    found = [DRILLS[name] for name in names] if names else list(DRILLS.values())
    carried = [drill for drill in found if backend is None or backend in drill.carriers]
    if names and len(carried) < len(found):
        missing = [drill.name for drill in found if drill not in carried]
        raise ConfigurationError(
            "this rig does not carry the fault",
            where="--backend",
            value=f"{backend}: {', '.join(missing)}",
        )
    return carried


def run_drills(
    drills: Sequence[Drill],
    *,
    backend: str | None = None,
    seed: int = 0,
    output: Path | None = None,
    offset: Callable[[Drill], int] | None = None,
) -> Iterator[DrillRow]:
    """Run each drill on a rig of its own and yield its row. The run files stay in `output`, or nowhere.

    `offset` moves the moment of a drill by so many cycles (random drills).
    """
    planned = plan_run(EXPERIMENT, DrillParameters(), shipped_gear(), shipped_motor())
    references: dict[str, Reference] = {}
    with tempfile.TemporaryDirectory(prefix="harmonic-rig-drill-") as scratch:
        root = output if output is not None else Path(scratch)
        for number, drill in enumerate(drills, 1):
            carrier = backend or drill.carriers[0]
            if carrier not in references:
                references[carrier] = reference_run(
                    planned, carrier, seed, root / f"reference-{carrier}"
                )
            reference = references[carrier]
            row = max(
                0, reference.rows[drill.moment] + (offset(drill) if offset is not None else 0)
            )
            folder = root / f"{number:03d}-{_in_path(drill.name)}"
            yield _Staged(
                drill=drill,
                planned=planned,
                carrier=carrier,
                seed=seed,
                folder=folder,
                row=row,
                reference=reference,
            ).run()


def reference_run(planned: PlannedRun, carrier: str, seed: int, folder: Path) -> Reference:
    """Run with nothing going wrong, and find the rows at which things can happen."""
    rig = drilled_rig(carrier, planned.gear, planned.motor, Happening(2**62), StopRequest(), seed)
    report = execute(
        _order(planned, rig, folder, seed), FailingDisk("", 0).begin, judge=judge_by(planned)
    )
    recording = open_run(report.path)
    segments = {}
    for segment in recording.segments:
        segments.setdefault(segment.label, segment)
    counts = {name: recording.stored(name) for name in COMPARED}
    close_recording(recording)
    rows = {label: (segment.start + segment.stop) // 2 for label, segment in segments.items()}
    made_safe = report.rows - (report.make_safe.rows if report.make_safe else 0)
    rows |= {
        "start": 0,
        "preflight": 100,
        "switching-on": segments["zero-before"].stop + 5,
        "ramp": segments["hold"].start - 15,
        "making-safe": made_safe + 5,
    }
    return Reference(rows, report.outcome, counts)


def _order(planned: PlannedRun, rig: DrilledRig, folder: Path, seed: int, **more: Any) -> RunOrder:
    folder.mkdir(parents=True, exist_ok=True)
    return RunOrder(
        planned=planned,
        port=rig,
        clock=rig.clock,
        backend="drill",
        output=folder,
        operator="drill",
        gear_serial="drill",
        seed=seed,
        block_cycles=BLOCK_CYCLES,
        make_safe_cycles=BLOCK_CYCLES,
        patience=PATIENCE,
        **more,
    )


@dataclass(kw_only=True)
class _Staged:
    """One drill about to be run."""

    drill: Drill
    planned: PlannedRun
    carrier: str
    seed: int
    folder: Path
    row: int
    reference: Reference
    reacted_ns: int | None = None

    def run(self) -> DrillRow:
        """Run it, look at the truth and at the file."""
        drill, stop = self.drill, StopRequest()
        happening = Happening(
            self.row,
            drill.fault,
            drill.press,
            drill.prepare,
            drill.moment == "start",
            drill.limits_factor,
        )
        rig = drilled_rig(
            self.carrier, self.planned.gear, self.planned.motor, happening, stop, self.seed
        )
        disk = FailingDisk(drill.recording, self.row)
        readout = self._read_out(rig) if drill.readout else ""

        def on_event(event: Event) -> None:
            if self.reacted_ns is None and event.source == "session":
                self.reacted_ns = rig.clock.monotonic_ns()
                disk.release()

        order = _order(
            self.planned,
            rig,
            self.folder,
            self.seed,
            free_space=lambda: disk.free_space(rig.rows),
            conditions={"readout": readout} if readout else {},
        )
        try:
            report = execute(
                order, disk.begin, stop=stop, judge=judge_by(self.planned), on_event=on_event
            )
        except (RigError, DriverError) as error:
            return self._refused(rig, error)
        finally:
            disk.release()
        safe = self._stands(rig, report)
        return self._row(rig, report, safe, readout)

    def _row(self, rig: DrilledRig, report: RunReport, safe: bool, readout: str) -> DrillRow:
        reference = self.reference.counts if self.drill.is_harmless else {}
        readable, marks = _look_at_file(report, self.row, reference)
        made_safe, trip = report.make_safe, report.trip
        ended = self.reacted_ns is not None
        onset = rig.happened_ns if rig.happened_ns is not None else self.row * rig.cycle_ns
        cycles = (
            round((self.reacted_ns - onset) / rig.cycle_ns)
            if self.reacted_ns is not None
            else marks.after
        )
        if trip is not None:
            detected = trip.cause
        elif readout:
            detected = f"reading refused: {readout}"
        elif ended:
            detected = self._reason(report)
        elif self.drill.press is not None:
            detected = "STOP, already making safe"
        else:
            detected = marks.words
        action = self._action(report) if ended else "none needed"
        if made_safe is not None and made_safe.escalated:
            detected += f"; {', '.join(made_safe.escalated)} not seen to be obeyed"
        if ended and rig.happening.at_start:
            cycles = report.rows - (made_safe.rows if made_safe is not None else 0)
        safe = safe and not marks.wrong
        return DrillRow(
            fault=self.drill.name,
            detected=detected,
            cycles=max(cycles, 0),
            action=action,
            safe=safe,
            outcome=report.outcome,
            file_readable=readable,
            verified=report.safe,
            carrier=self.carrier,
            expected=self._expected(),
            message=report.message,
        )

    def _action(self, report: RunReport) -> str:
        """The stages that were taken, and who really stopped the motor when nobody could hear them."""
        if report.make_safe is None:
            return "none"
        stages = " -> ".join(report.make_safe.stages)
        if report.safe:
            return stages
        unheard = report.make_safe.problem == GIVEN_UP
        return f"{stages}: not heard, the drive by itself" if unheard else f"{stages}: not verified"

    def _reason(self, report: RunReport) -> str:
        """What ended a run that did not trip: the operator's word, a refusal before arming, the recorder."""
        if report.outcome == "ABORTED":
            return report.message.split(" ", 1)[0]
        if "nothing has moved" in report.message:
            return "refused before arming"
        return "recorder" if not report.readable else "error"

    def _expected(self) -> str:
        drill = self.drill
        if drill.is_harmless or (drill.press is not None and drill.moment == "making-safe"):
            return self.reference.outcome
        if drill.press is not None:
            return "ABORTED"
        if drill.recording in ("disk full", "writer stalled") or drill.moment == "start":
            return "ERROR"
        return "TRIPPED"

    def _read_out(self, rig: DrilledRig) -> str:
        """Read the readout on the faulty line, as before a run: what the driver says instead of an angle."""
        assert rig.bench is not None
        assert self.drill.fault is not None
        rig.bench.inject(self.drill.fault(rig.bench.cycle))
        reader = Readout(rig.bench.serial(), rig.clock, ReadoutConfig(url="simulated readout"))
        try:
            reading = reader.read()
        except DriverError as error:
            return f"{error.what}"
        return (
            "the readout says that its value is none (?)"
            if reading.is_fault
            else f"BELIEVED {reading.value:g}"
        )

    def _refused(self, rig: DrilledRig, error: Exception) -> DrillRow:
        """A run that was refused before it had a file."""
        return DrillRow(
            fault=self.drill.name,
            detected=type(error).__name__,
            cycles=0,
            action="refused",
            safe=self._truth(rig.bench),
            outcome="ERROR",
            file_readable=False,
            verified=False,
            carrier=self.carrier,
            expected=self._expected(),
            message=str(error),
        )

    def _stands(self, rig: DrilledRig, report: RunReport) -> bool:
        """The truth: whether the motor stands without power once the drive has had time for its own reactions."""
        if rig.bench is None:
            return report.safe
        if not report.safe:
            let_time_pass(rig.bench, rig.clock, AFTERMATH)
        return self._truth(rig.bench)

    def _truth(self, bench: WireBench | None) -> bool:
        if bench is None:
            return True
        return (
            abs(bench.plant.input_speed) < STANDING_SPEED
            and bench.drive.drive_state not in POWERED_STATES
        )


def let_time_pass(bench: WireBench, clock: Clock, seconds: float) -> None:
    """Time passes with nobody on the bus: the devices' own watches act."""
    assert isinstance(clock, VirtualClock)
    for _ in range(round(seconds * 1e3)):
        clock.advance_ns(MILLISECOND)
        bench.elapse()


@dataclass(frozen=True)
class _Marks:
    """What the cycles of a file are marked with, how long after the onset the first is, and how
    many are wrong unmarked.
    """

    words: str
    after: int
    wrong: int = 0


def _look_at_file(
    report: RunReport, row: int, reference: Mapping[str, NDArray[np.int64]]
) -> tuple[bool, _Marks]:
    """Whether the file of a run can be read and has the rows that it must, and what its cycles are marked with."""
    path = report.path
    try:
        if path.name.endswith(".part"):
            path = recover_run(path).path
        recording = open_run(path, verify=True)
    except RigError as error:
        return False, _Marks(str(error), 0)
    try:
        whole = (
            recording.rows == report.rows if report.readable else 0 < recording.rows <= report.rows
        )
        fits = recording.metadata.outcome in (report.outcome, "INTERRUPTED")
        return whole and fits and len(recording.si("input_angle")) == recording.rows, _marks(
            recording, row, reference
        )
    finally:
        close_recording(recording)


def _marks(recording: Recording, row: int, reference: Mapping[str, NDArray[np.int64]]) -> _Marks:
    flags = recording.flags()
    counted = [(flag, int(np.count_nonzero(flags & flag))) for flag in CycleFlag if flag]
    marked = np.flatnonzero(flags)
    wrong = 0
    if reference:
        rows = min(len(flags), *(len(counts) for counts in reference.values()))
        differs = np.zeros(rows, dtype=bool)
        for name, counts in reference.items():
            found, origin = recording.stored(name)[:rows], name.endswith("angle")
            # A counter may begin elsewhere; how far it has turned is what counts.
            differs |= found - origin * found[0] != counts[:rows] - origin * counts[0]
        wrong = int(np.count_nonzero(differs & (flags[:rows] == 0)))
    words = ", ".join(f"{count} x {flag.name}" for flag, count in counted if count and flag.name)
    text = f"marked {words}" if words else "nothing to detect: counts are right"
    text = f"{wrong} WRONG COUNTS NOT MARKED; {text}" if wrong else text
    return _Marks(text, max(int(marked[0]) - row, 0) if len(marked) else 0, wrong)


def _in_path(name: str) -> str:
    return "".join(c if c.isalnum() else "-" for c in name).strip("-")


def random_drills(number: int, seed: int, backend: str | None = None) -> list[Drill]:
    """So many drills drawn at random; `random_offset` of the same seed moves them in time."""
    candidates = chosen((), backend)
    picks = np.random.default_rng([seed, 1]).integers(0, len(candidates), number)
    return [replace(candidates[i]) for i in picks.tolist()]


def random_offset(seed: int) -> Callable[[Drill], int]:
    """Moves the faults of random drills by up to 60 cycles; presses and faults from the start stay where they are."""
    generator = np.random.default_rng([seed, 2])

    def offset(drill: Drill) -> int:
        moved = int(generator.integers(-60, 61))
        return moved if drill.moment == "hold" else 0

    return offset


__all__ = [
    "BLOCK_CYCLES",
    "CARRIERS",
    "DrillRow",
    "chosen",
    "random_drills",
    "random_offset",
    "run_drills",
]
