"""What a passport holds: a gear's runs, one series per quantity and conditions, control limits, and what is missing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from experiments.recording import Origin
from experiments.result import Plot, Table
from model.gear import Provenance
from rig.library.index import IndexedRun

State = Literal["in control", "to be watched", "out of control", "no control limits yet"]


@dataclass(frozen=True, kw_only=True)
class PassportPoint:
    """One run in a series; numbers in the unit of the series (SI).

    `low`, `high` the 95 % interval (statistical part); `expanded_uncertainty` U (95 %), type B
    included; `signals` the rules of the chart that it breaks; `within_uncertainty` whether its
    distance from the centre line is no more than its U without what all runs share (None without
    limits); `remarks` what changed since the run before.
    """

    position: int
    run: str
    number: int
    path: Path
    start: str
    value: float
    low: float
    high: float
    expanded_uncertainty: float
    identifiability: str = "yes"
    analysis: str = ""
    signals: tuple[str, ...] = ()
    within_uncertainty: bool | None = None
    housing_temperature: float | None = None
    remarks: tuple[str, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """One point of `rig report --passport --json`."""
        return {**vars(self), "path": str(self.path)}


@dataclass(frozen=True, kw_only=True)
class ControlLimits:
    """Limits of an individuals chart, from the mean moving range of the first runs: centre +- 3 MR/1.128.

    `moving_range_upper` = 3.267 MR; `runs` made the limits; `false_alarms` is the share of later
    runs of an unchanged gear that fall outside all the same, limits from so few runs being
    uncertain themselves.
    """

    centre: float
    sigma: float
    lower: float
    upper: float
    moving_range: float
    moving_range_upper: float
    runs: tuple[str, ...]
    false_alarms: float

    def as_json(self) -> dict[str, Any]:
        """The limits of one series of `rig report --passport --json`."""
        return dict(vars(self))


@dataclass(frozen=True)
class CatalogueLimit:
    """What the catalogue of the gear states, with its source and provenance; it judges nothing."""

    value: float
    source: str
    provenance: Provenance


@dataclass(frozen=True, kw_only=True)
class PassportSeries:
    """One quantity over time, of runs that can be compared: one origin, one mounting, one subject,
    one protocol setting.

    `key` names the series uniquely, `title` tells it to people; `conditions` is what all its runs
    have in common and what parts them from other series of the quantity; `display_unit` with
    `factor`: SI = factor * shown number.
    """

    key: str
    quantity: str
    title: str
    definition: str
    kind: str
    unit: str
    factor: float
    display_unit: str
    origin: Origin
    conditions: Mapping[str, str]
    points: tuple[PassportPoint, ...]
    plot: Plot
    control: ControlLimits | None = None
    limit: CatalogueLimit | None = None
    notes: tuple[str, ...] = ()

    @property
    def state(self) -> State:
        """What the chart says of the newest run: out of control beyond a limit, to be watched where
        another rule speaks.

        A step alone is to be watched: the run after an outlier steps back, and is in its place again.
        """
        if self.control is None:
            return "no control limits yet"
        newest = self.points[-1].signals
        if "1" in newest:
            return "out of control"
        return "to be watched" if newest else "in control"

    def as_json(self) -> dict[str, Any]:
        """One series of `rig report --passport --json`."""
        fields = {name: getattr(self, name) for name in _TOLD}
        return fields | {
            "conditions": dict(self.conditions),
            "state": self.state,
            "points": [point.as_json() for point in self.points],
            "control_limits": None if self.control is None else self.control.as_json(),
            "catalogue_limit": None if self.limit is None else dict(vars(self.limit)),
            "notes": list(self.notes),
        }


_TOLD = (
    "key",
    "quantity",
    "title",
    "definition",
    "kind",
    "unit",
    "factor",
    "display_unit",
    "origin",
)


@dataclass(frozen=True)
class Missing:
    """Something that a whole passport would have: what, of which run ("" for none), and what to do about it."""

    what: str
    run: str = ""
    remedy: str = ""

    def as_json(self) -> dict[str, str]:
        """One line of `rig report --passport --json`."""
        return dict(vars(self))


@dataclass(frozen=True, kw_only=True)
class Passport:
    """A gear's life as its runs tell it.

    `runs` are those that count, in order of time; `mark` is SIMULATED, REPLAY or IMPORTED where
    none of them is from hardware ("" else); `plots` are one chart per series, then the order
    spectra; `left_out` are runs of this gear that do not count.
    """

    serial: str
    gear: str
    mark: str
    runs: tuple[IndexedRun, ...]
    series: tuple[PassportSeries, ...]
    spectra: tuple[Plot, ...] = ()
    tables: tuple[Table, ...] = ()
    missing: tuple[Missing, ...] = ()
    left_out: tuple[Missing, ...] = ()
    rules: Mapping[str, str] = field(default_factory=dict)
    """What the signals of the points mean."""

    @property
    def plots(self) -> tuple[Plot, ...]:
        """Every figure: one chart per series, then the order spectra."""
        return (*(one.plot for one in self.series), *self.spectra)

    def as_json(self) -> dict[str, Any]:
        """The object that `rig report --passport --json` prints."""
        from rig.analysis.result_data import plot_to_mapping

        return {
            "serial": self.serial,
            "gear": self.gear,
            "mark": self.mark,
            "runs": [run.as_json() for run in self.runs],
            "series": [one.as_json() for one in self.series],
            "plots": [plot_to_mapping(plot) for plot in self.plots],
            "missing": [one.as_json() for one in self.missing],
            "left_out": [one.as_json() for one in self.left_out],
            "rules": dict(self.rules),
        }
