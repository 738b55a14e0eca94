"""What a passport holds: a gear's runs, a series per quantity and conditions, what has changed, what is missing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from experiments.recording import Origin
from experiments.result import Plot, Table
from model.gear import Provenance
from rig.analysis.number_or_none import finite
from rig.library.index import IndexedRun

State = Literal["changed", "learning", "no change seen", "not watched"]
"""What a series says of its gear; "learning" within the baseline, "not watched" where it is drawn alone."""


@dataclass(frozen=True, kw_only=True)
class PassportPoint:
    """One run in a series; numbers in the unit of the series (SI).

    `low`, `high` the 95 % interval (statistical part); `expanded_uncertainty` U (95 %), type B
    included; `expected` what the runs before it let expect at its warmth, bench and mounting (None: nothing yet);
    `upper_sum`, `lower_sum` the sums that are held against the threshold (None in a series that is not watched);
    `is_alarm` at the run at which a change was told; `is_changed` from the run on since which it is told; `remarks`
    what changed since the run before.
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
    expected: float | None = None
    upper_sum: float | None = None
    lower_sum: float | None = None
    is_alarm: bool = False
    is_changed: bool = False
    housing_temperature: float | None = None
    remarks: tuple[str, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """One point of `rig report --passport --json`."""
        return {**vars(self), "path": str(self.path)}


@dataclass(frozen=True, kw_only=True)
class Alarm:
    """A lasting change of one quantity: how much (`size` with its 95 % interval, SI), since which run, told at which.

    `scatter` is that of one run, `per_run` the change in one run in units of it, with its interval; `beside` what was
    noted to change about then; `within_uncertainty` whether the size is no more than U of one run without what all
    share; `decides` and `command`: one run that tells gear from bench.
    """

    quantity: str
    title: str
    direction: Literal["larger", "smaller"]
    since: str
    run: str
    runs_until_told: int
    size: float
    size_low: float
    size_high: float
    scatter: float
    per_run: tuple[float, float, float]
    unit: str
    beside: tuple[str, ...]
    within_uncertainty: bool
    sentence: str
    decides: str
    command: str

    @property
    def size_in_scatters(self) -> float:
        """The size in standard deviations of one run."""
        return self.size / self.scatter

    def as_json(self) -> dict[str, Any]:
        """One alarm of `rig report --passport --json`."""
        return {**vars(self), "size_in_scatters": self.size_in_scatters}


@dataclass(frozen=True, kw_only=True)
class Wear:
    """What hours do to a quantity: slope per 1000 h with its 95 % interval (SI), and hours from the newest run to the
    limit where a straight line meets one. No remaining life is promised.
    """

    per_1000_hours: tuple[float, float, float]
    hours_to_limit: tuple[float, float, float] | None
    sentence: str

    def as_json(self) -> dict[str, Any]:
        """The trend of one series of `rig report --passport --json`; an open end of an interval is null."""
        to_limit = self.hours_to_limit
        ends = to_limit and [finite(one) for one in to_limit]
        return {
            "per_1000_hours": list(self.per_1000_hours),
            "hours_to_limit": ends,
            "sentence": self.sentence,
        }


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
    sums: Plot | None = None
    state: State = "not watched"
    threshold: float | None = None
    alarm: Alarm | None = None
    wear: Wear | None = None
    limit: CatalogueLimit | None = None
    notes: tuple[str, ...] = ()

    @property
    def plots(self) -> tuple[Plot, ...]:
        """Its chart, and where it is watched the sums that decide."""
        return tuple(plot for plot in (self.plot, self.sums) if plot is not None)

    def as_json(self) -> dict[str, Any]:
        """One series of `rig report --passport --json`."""
        fields = {name: getattr(self, name) for name in _TOLD}
        return fields | {
            "conditions": dict(self.conditions),
            "state": self.state,
            "points": [point.as_json() for point in self.points],
            "threshold": self.threshold,
            "alarm": self.alarm and self.alarm.as_json(),
            "wear": self.wear and self.wear.as_json(),
            "catalogue_limit": self.limit and dict(vars(self.limit)),
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
    promise: str = ""
    """How often a gear that does not change is told to have changed, in a sentence."""

    @property
    def alarms(self) -> tuple[Alarm, ...]:
        """What has changed."""
        return tuple(one.alarm for one in self.series if one.alarm is not None)

    @property
    def plots(self) -> tuple[Plot, ...]:
        """Every figure: one chart per series, then the order spectra."""
        return (*(plot for one in self.series for plot in one.plots), *self.spectra)

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
            "alarms": [one.as_json() for one in self.alarms],
            "promise": self.promise,
        }
