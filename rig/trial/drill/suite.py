"""Runs the drills and says what came of each: what was detected, how soon, how the rig was made
safe, what is in the file, and what becomes of it all with the fault taken out.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig.errors import ConfigurationError, nearest
from rig.run.dry_run import PlannedRun, plan_run
from rig.trial.drill.catalogue import Drill, every_drill
from rig.trial.drill.protocol import EXPERIMENT, DrillParameters
from rig.trial.drill.rigs import CARRIERS, SPEED_ONLY, Carrier, refuse_hardware
from rig.trial.drill.staging import BLOCK_CYCLES, Ending, Placed, Reference, Staged, reference_run


@dataclass(frozen=True, kw_only=True)
class DrillRow:
    """What came of one drill.

    `detected` says what was detected in words, `causes` in the vocabulary of `rig.trial.drill.cause`;
    `expected_cause` must be among them, and where the drill claims no detection there must be none.
    `cycles` are the SYNC periods from onset to the reaction. `safe`: the motor of the simulated rig
    really stands without power; `verified`: the program has verified it as well. `evidence` says by
    what it shows that the fault happened, empty where it did not. `expected` is the outcome that the
    drill must have; `wrong_counts` stand in the file without a mark.
    """

    fault: str
    detected: str
    causes: tuple[str, ...]
    expected_cause: str
    claims_detection: bool
    evidence: str
    cycles: int
    action: str
    safe: bool
    outcome: str
    file_readable: bool
    verified: bool
    carrier: str
    expected: str
    wrong_counts: int = 0
    message: str = ""

    @property
    def happened(self) -> bool:
        """Whether it shows that the fault happened."""
        return bool(self.evidence)

    @property
    def names_cause(self) -> bool:
        """Whether what was detected is what the drill expects."""
        return self.expected_cause in self.causes if self.claims_detection else not self.causes

    @property
    def passed(self) -> bool:
        """Whether the drill ended as it must."""
        return (
            self.happened
            and self.names_cause
            and self.safe
            and self.file_readable
            and not self.wrong_counts
            and self.outcome == self.expected
        )

    def as_json(self) -> dict[str, Any]:
        """The row as `rig sim drill --json` prints it."""
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
            "claims_detection": self.claims_detection,
            "expected_cause": self.expected_cause,
            "causes": list(self.causes),
            "names_cause": self.names_cause,
            "happened": self.happened,
            "evidence": self.evidence,
        }


def chosen(names: Sequence[str], backend: str | None = None) -> list[Drill]:
    """The drills of these names (all without any) that the rig carries. Raises `ConfigurationError`
    for unknown names.
    """
    if backend is not None:
        refuse_hardware(backend)
    unknown = [name for name in names if name not in every_drill()]
    if unknown:
        raise ConfigurationError(
            "no such fault",
            where="--fault",
            value=", ".join(unknown),
            remedy=nearest(unknown[0], every_drill()),
        )
    found = [every_drill()[name] for name in names or every_drill()]
    carried = [drill for drill in found if backend is None or backend in drill.carriers]
    if names and len(carried) < len(found):
        missing = [drill.name for drill in found if drill not in carried]
        raise ConfigurationError(
            "this rig does not carry the fault",
            where="--backend",
            value=f"{backend}: {', '.join(missing)}",
        )
    return carried


@dataclass(kw_only=True)
class Stage:
    """Where runs are staged: a folder, and plan and run of each rig with nothing going wrong."""

    root: Path
    seed: int
    is_compensated: bool = False
    references: dict[Carrier, Reference] = field(default_factory=dict)
    plans: dict[Carrier, PlannedRun] = field(default_factory=dict)
    staged: int = 0

    def planned(self, carrier: Carrier) -> PlannedRun:
        """The drill's run as this rig can do it; planned once."""
        if carrier not in self.plans:
            parameters = DrillParameters(
                has_torque=carrier not in SPEED_ONLY, is_compensated=self.is_compensated
            )
            self.plans[carrier] = plan_run(EXPERIMENT, parameters, shipped_gear(), shipped_motor())
        return self.plans[carrier]

    def reference(self, carrier: Carrier) -> Reference:
        """The run with nothing going wrong on this rig; made once."""
        if carrier not in self.references:
            folder = self.root / f"reference-{carrier}"
            self.references[carrier] = reference_run(
                self.planned(carrier), carrier, self.seed, folder
            )
        return self.references[carrier]

    def run(
        self, name: str, carrier: Carrier, parts: tuple[Placed, ...], *, compares: bool = False
    ) -> Ending:
        """Run with these things happening, in a folder of its own."""
        self.staged += 1
        return Staged(
            parts=parts,
            planned=self.planned(carrier),
            carrier=carrier,
            seed=self.seed,
            folder=self.root / f"{self.staged:03d}-{_in_path(name)}",
            reference=self.reference(carrier),
            compares=compares,
        ).run()


_sound: dict[tuple[int, bool], dict[Carrier, Reference]] = {}
"""By seed, whether along a table, and rig: the runs with nothing going wrong that this process has made. They come out
alike each time."""


@contextmanager
def stage(
    seed: int, output: Path | None = None, *, is_compensated: bool = False
) -> Iterator[Stage]:
    """Where runs are staged; their files stay in `output`, or nowhere."""
    known = {} if output is not None else _sound.setdefault((seed, is_compensated), {})
    with tempfile.TemporaryDirectory(prefix="harmonic-rig-drill-") as scratch:
        yield Stage(
            root=output or Path(scratch),
            seed=seed,
            is_compensated=is_compensated,
            references=known,
        )


def run_drills(
    drills: Sequence[Drill],
    *,
    backend: str | None = None,
    seed: int = 0,
    output: Path | None = None,
    offset: Callable[[Drill], int] | None = None,
    without_faults: bool = False,
    is_compensated: bool = False,
) -> Iterator[DrillRow]:
    """Run each drill on a rig of its own and yield its row. The run files stay in `output`, or nowhere.

    `offset` moves the moment of a drill by so many cycles (random drills). `without_faults` takes
    every fault out: a drill that still names its cause then proves nothing. `is_compensated` turns along a table.
    """
    with stage(seed, output, is_compensated=is_compensated) as staged, stage(seed) as plain:
        # Along a table a run takes as long: its faults happen at the same cycles.
        timed = plain if is_compensated else staged
        for drill in drills:
            carrier = carrier_of(drill, backend)
            moved = offset(drill) if offset is not None else 0
            row = max(0, timed.reference(carrier).rows[drill.moment] + moved)
            happening = drill.taken_out() if without_faults else drill
            ending = staged.run(
                drill.name, carrier, (Placed(happening, row),), compares=drill.is_harmless
            )
            yield row_of(drill, carrier, ending, staged.reference(carrier).outcome)


def carrier_of(drill: Drill, backend: str | None = None) -> Carrier:
    """The rig on which a drill is run: the one that is asked for, or the drill's own choice."""
    return next(each for each in CARRIERS if each == (backend or drill.carriers[0]))


def row_of(drill: Drill, carrier: Carrier, ending: Ending, sound_outcome: str) -> DrillRow:
    """The row of a drill, by how its run ended."""
    return DrillRow(
        fault=drill.name,
        detected=ending.detected,
        causes=ending.causes,
        expected_cause=drill.cause_on(carrier),
        claims_detection=drill.claims_detection,
        evidence="; ".join(filter(None, ending.evidence)),
        cycles=ending.cycles,
        action=ending.action,
        safe=ending.safe,
        outcome=ending.outcome,
        file_readable=ending.file_readable,
        verified=ending.verified,
        carrier=carrier,
        expected=_expected(drill, sound_outcome),
        wrong_counts=ending.marks.wrong,
        message=ending.message,
    )


def _expected(drill: Drill, sound_outcome: str) -> str:
    if drill.is_harmless or (drill.press is not None and drill.moment == "making-safe"):
        return sound_outcome
    if drill.press is not None:
        return "ABORTED"
    if drill.recording in ("disk full", "writer stalled") or drill.moment == "start":
        return "ERROR"
    return "TRIPPED"


def proves_detection(rows: Sequence[DrillRow]) -> bool:
    """Whether, with every fault taken out, each drill that claims a detection fails for want of its cause.

    That nothing happened would fail it too, but would prove nothing of what it detects.
    """
    return not any(row.names_cause for row in rows if row.claims_detection)


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
    "proves_detection",
    "random_drills",
    "random_offset",
    "reference_run",
    "run_drills",
]
