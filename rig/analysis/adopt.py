"""Identified numbers and parameter sets: taking results over into a gear, and holding a gear against results."""

from __future__ import annotations

import dataclasses
import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from rig.content.grid import Grid, columns
from rig.content.phrase import yes_or_no
from rig.content.wording import laboratory_unit, number, readable

if TYPE_CHECKING:
    from experiments.quantity import Quantity
    from experiments.result import Result
    from model.gear import HarmonicDrive


@dataclass(frozen=True)
class _Adopted:
    """A parameter set with identified values in it, and the paths of what was identified."""

    gear: HarmonicDrive
    changed: tuple[str, ...]


@dataclass(frozen=True)
class Comparison:
    """One value of a parameter set beside what a run identified for it, both in `unit` (SI);
    `uncertainty` is U (95 %).
    """

    path: str
    unit: str
    parameter: float
    identified: float
    uncertainty: float

    @classmethod
    def from_json(cls, path: str, row: Mapping[str, Any]) -> Comparison:
        """What `rig validate --against --json` printed of a value."""
        values = (row["parameter"], row["identified"], row["expanded_uncertainty"])
        return cls(path, str(row["unit"]), *map(float, values))

    @property
    def normalised_error(self) -> float:
        """|difference| / U: above one, set and run disagree."""
        difference = abs(self.identified - self.parameter)
        if not self.uncertainty > 0:
            return 0.0 if difference == 0 else math.inf
        return difference / self.uncertainty

    @property
    def agrees(self) -> bool:
        """Whether the value of the set lies inside identified ± U."""
        return self.normalised_error <= 1.0

    def as_json(self) -> dict[str, Any]:
        """The row as `rig validate --against --json` prints it."""
        return {
            "parameter": self.parameter,
            "identified": self.identified,
            "unit": self.unit,
            "expanded_uncertainty": self.uncertainty,
            "normalised_error": self.normalised_error,
            "agrees": self.agrees,
        }


@dataclass(frozen=True)
class _Pooled:
    """How one quantity spreads between runs: mean, standard deviation, number of runs (SI)."""

    kind: str
    name: str
    unit: str
    mean: float
    deviation: float
    runs: int

    @property
    def key(self) -> str:
        """The name under which `--json` lists it."""
        return f"{self.kind}.{self.name}"

    def as_json(self) -> dict[str, Any]:
        """Mean, standard deviation, unit, runs."""
        return {
            "mean": self.mean,
            "standard_deviation": self.deviation,
            "unit": self.unit,
            "runs": self.runs,
        }


def adopt(gear: HarmonicDrive, results: Sequence[Result]) -> _Adopted:
    """The set with everything that these results identify, marked "identified" with its uncertainty; later results win.

    What an analysis takes over, and what it leaves because the data cannot identify it, is the analysis' own decision.
    """
    from experiments import catalogue

    # Taken over into a set without origins as well: what carries one afterwards is what these results identify.
    bare = dataclasses.replace(gear, origins=MappingProxyType({}))
    for result in results:
        take_over = catalogue.load(result.kind).identified
        if take_over is not None:
            gear, bare = take_over(result, gear), take_over(result, bare)
    return _Adopted(
        gear,
        tuple(path for path, origin in bare.origins.items() if origin.provenance == "identified"),
    )


def compare_with(gear: HarmonicDrive, result: Result) -> tuple[Comparison, ...]:
    """What a result identifies beside what the set says, value by value; orders of the kinematic error by amplitude."""
    adopted = adopt(gear, [result])
    theirs, ours = _numbers(gear), _numbers(adopted.gear)
    rows = []
    for path in adopted.changed:
        if path not in ours:
            continue
        value, unit = ours[path]
        u = adopted.gear.origins[path].standard_uncertainty
        rows.append(
            Comparison(path, unit, theirs.get(path, (0.0, unit))[0], value, 2.0 * (u or 0.0))
        )
    return tuple(rows)


def comparison_grid(rows: Sequence[Comparison], gear: HarmonicDrive | None) -> Grid:
    """The values side by side in the units of a laboratory; `gear` knows what they are called."""
    described: dict[str, str] = {}
    if gear is not None:
        described = {v.path: f"{v.description} {v.symbol}".rstrip() for v in gear.values()}
    heads = columns(
        ("parameter", "quantity"),
        ("set", "number"),
        ("run", "number"),
        ("± U", "number"),
        ("unit", "unit"),
        ("|Δ| / U", "number"),
        ("agrees", "word"),
    )
    cells = []
    for row in rows:
        factor, unit = laboratory_unit(row.unit, row.identified)
        cells.append(
            (
                described.get(row.path, readable(row.path.replace(".", " "))),
                number(row.parameter / factor),
                number(row.identified / factor),
                number(row.uncertainty / factor, 2),
                unit,
                number(row.normalised_error, 2),
                yes_or_no(row.agrees),
            )
        )
    return Grid("Parameter set against run", heads, cells)


def _numbers(gear: HarmonicDrive) -> dict[str, tuple[float, str]]:
    from model.gear_file import harmonic_path

    numbers = {value.path: (value.value, value.unit) for value in gear.values()}
    return numbers | {harmonic_path(h.order): (h.amplitude, "rad") for h in gear.kinematic_error}


def _is_phase(quantity: Quantity) -> bool:
    """Whether it is the phase of an order, which has no mean without the way round the circle."""
    return quantity.is_circular and quantity.placeholder == "order"


def pooled(results: Sequence[Result]) -> tuple[_Pooled, ...]:
    """Mean and spread of every quantity that at least two runs of one kind give."""
    groups: dict[tuple[str, str, str], list[float]] = {}
    for result in results:
        for name, estimate in result.estimates.items():
            if math.isfinite(estimate.value) and not _is_phase(result.quantity(name)):
                groups.setdefault((result.kind, name, estimate.unit), []).append(estimate.value)
    return tuple(
        _Pooled(kind, name, unit, statistics.fmean(v), statistics.stdev(v), len(v))
        for (kind, name, unit), v in groups.items()
        if len(v) > 1
    )
