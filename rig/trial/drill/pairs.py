"""Pairs of faults at random: two things go wrong in one run, the second while the first is still being dealt with.

What is asked of a pair is not which cause was named, but the truth of the plant: whether the motor
stands without power in the end, and whether the program says so.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from rig.trial.drill.catalogue import Drill, every_drill
from rig.trial.drill.rigs import CARRIERS, IN_PAIRS, Carrier, refuse_hardware
from rig.trial.drill.staging import Ending, Placed
from rig.trial.drill.suite import stage

APART = 400
"""Cycles within which the second fault follows the first: the time in which a rig is made safe."""

Verdict = Literal[
    "safe",
    "safe, nobody can be heard",
    "safe later, rightly not verified",
    "SAFE AND NOT SAID",
    "UNSAFE",
]
"""By the truth of the plant and the word of the program."""


@dataclass(frozen=True)
class Pair:
    """Two drills whose faults happen at these rows of one run."""

    number: int
    carrier: Carrier
    drills: tuple[Drill, Drill]
    rows: tuple[int, int]


@dataclass(frozen=True, kw_only=True)
class PairRow:
    """What came of a pair; `evidence` of each fault, empty where the run was over before it happened."""

    pair: Pair
    ending: Ending

    @property
    def verdict(self) -> Verdict:
        """Whether the motor stands without power, and whether the program says so."""
        if not self.ending.safe:
            return "UNSAFE"
        if self.ending.verified:
            return "safe"
        if any(drill.is_unheard for drill in self.pair.drills):
            return "safe, nobody can be heard"
        # What was still turning when it was given up has come to rest since: the word was true.
        if self.ending.rightly_denied:
            return "safe later, rightly not verified"
        return "SAFE AND NOT SAID"

    @property
    def passed(self) -> bool:
        """Whether it is safe, and the program's word is true wherever anybody can be heard."""
        return self.verdict not in ("SAFE AND NOT SAID", "UNSAFE")

    def sentence(self) -> str:
        """Which pair it was, and how it ended."""
        pair, ending = self.pair, self.ending
        faults = " + ".join(
            f"{drill.name} at row {row}" for drill, row in zip(pair.drills, pair.rows, strict=True)
        )
        return f"pair {pair.number} on {pair.carrier}, {faults}: {ending.detected}. {ending.action}. {ending.message}"

    def as_json(self) -> dict[str, Any]:
        """The row as `rig sim drill --pairs N --json` prints it."""
        ending = self.ending
        return {
            "number": self.pair.number,
            "faults": [drill.name for drill in self.pair.drills],
            "rows": list(self.pair.rows),
            "backend": self.pair.carrier,
            "happened": [bool(fact) for fact in ending.evidence],
            "evidence": list(ending.evidence),
            "detected": ending.detected,
            "causes": list(ending.causes),
            "action": ending.action,
            "safe": ending.safe,
            "verified": ending.verified,
            "outcome": ending.outcome,
            "file_readable": ending.file_readable,
            "verdict": self.verdict,
            "passed": self.passed,
            "message": ending.message,
        }


def candidates(backend: str | None = None) -> list[Drill]:
    """The drills whose fault can happen at any moment, each fault once."""
    if backend is not None:
        refuse_hardware(backend)
    apart: dict[tuple[object, ...], Drill] = {}
    for drill in every_drill().values():
        carried = set(IN_PAIRS if backend is None else (backend,)).intersection(drill.carriers)
        if drill.moment != "start" and carried:
            apart.setdefault((drill.fault, drill.press, drill.recording), drill)
    return list(apart.values())


def drawn(number: int, seed: int, rows: int, backend: str | None = None) -> Pair:
    """Pair `number` of a seed: the same whichever pairs are drawn before it."""
    generator = np.random.default_rng([seed, 3, number])
    of = candidates(backend)
    while True:
        first, second = (of[i] for i in generator.integers(0, len(of), 2).tolist())
        carriers: list[Carrier] = [
            carrier
            for carrier in IN_PAIRS
            if carrier in first.carriers
            and carrier in second.carriers
            and backend in (None, carrier)
        ]
        # One disk fails in one way.
        if first is not second and carriers and not (first.recording and second.recording):
            break
    carrier = carriers[int(generator.integers(len(carriers)))]
    at = int(generator.integers(1, rows))
    return Pair(number, carrier, (first, second), (at, at + int(generator.integers(0, APART))))


def run_pairs(
    numbers: Sequence[int], *, seed: int, backend: str | None = None, output: Path | None = None
) -> Iterator[PairRow]:
    """Run the pairs of these numbers, each on a rig of its own."""
    with stage(seed, output) as staged:
        for number in numbers:
            length = len(staged.reference(CARRIERS[0]).counts["torque"])
            pair = drawn(number, seed, length, backend)
            parts = tuple(map(Placed, pair.drills, pair.rows))
            name = "-".join(drill.name for drill in pair.drills)
            yield PairRow(pair=pair, ending=staged.run(name, pair.carrier, parts))
