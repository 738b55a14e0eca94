"""A fit in Python: values with their uncertainties by name, covariance, figures, and the comparison with a model."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import TYPE_CHECKING, overload

from experiments.errors import AnalysisError
from experiments.quantity import key_names
from rig.analysis.adopt import comparison_grid
from rig.analysis.rows import LIMIT, estimate_grid, metric_grid
from rig.api.tables import Tabular
from rig.content.grid import Column, Grid
from rig.content.phrase import phrase
from rig.content.wording import show
from rig.errors import RigError
from rig.extras import optional

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

    from experiments.finding import Finding
    from experiments.result import Covariance, Plot, Table
    from experiments.result import Result as Analysed
    from model.gear import HarmonicDrive
    from model.identify.estimate import BudgetLine, Estimate, Identifiable
    from rig.analysis.adopt import Comparison as Compared
    from rig.analysis.fit.recorded import Fit


@dataclass(frozen=True)
class Value:
    """One identified number in SI. `uncertainty` is U = k u: value ± U holds the measurand with 95 %."""

    name: str
    title: str
    value: float
    uncertainty: float
    unit: str
    shown: str
    """Value and U in the unit of a laboratory, rounded by U."""
    estimate: Estimate

    @property
    def standard_uncertainty(self) -> float:
        """u: root sum of squares of the budget."""
        return self.estimate.standard_uncertainty

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval of the statistical part alone."""
        return self.estimate.low, self.estimate.high

    @property
    def identifiable(self) -> Identifiable:
        """Whether the data determine it: "yes", "weakly" or "no"."""
        return self.estimate.identifiable

    @property
    def note(self) -> str:
        """Why it is not identifiable, where it is not."""
        return self.estimate.note

    @property
    def budget(self) -> tuple[BudgetLine, ...]:
        """What the uncertainty is made of."""
        return self.estimate.budget

    def __float__(self) -> float:
        return self.value

    def __repr__(self) -> str:
        doubt = "" if self.identifiable == "yes" else f" (identifiable: {self.identifiable})"
        return f"{self.title}: {self.shown}{doubt}"


class Result(Tabular, Mapping[str, Value]):
    """What one analysis found of one run: `result["coulomb"]` is a `Value`; iterating gives the names."""

    def __init__(self, fit: Fit) -> None:
        self.fit = fit
        """Recording, parameter set, tare and result, as all of the program has them (`rig.analysis.fit.recorded`)."""

    @property
    def kind(self) -> str:
        """The kind of analysis."""
        return self._result.kind

    @property
    def run_id(self) -> str:
        """The run that was analysed."""
        return self._result.run

    @property
    def covariance(self) -> Covariance | None:
        """Of the parameters that were fitted together: `names`, `matrix` (type A), `whole()` with what they share."""
        return self._result.covariance

    @property
    def metrics(self) -> dict[str, float]:
        """Figures of merit in SI, such as errors, skills and counts."""
        return dict(self._result.metrics)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What to beware of."""
        return self._result.warnings

    @property
    def checks(self) -> tuple[Finding, ...]:
        """What was looked at of the recording before anything was computed from it."""
        return self._result.checks

    @property
    def options(self) -> dict[str, object]:
        """The conventions used: parameter set, tare, laws, orders."""
        return dict(self._result.options)

    @property
    def tare(self) -> tuple[str, ...]:
        """The tare that was subtracted, or why there is none; nothing where none belongs."""
        return self.fit.tare_words

    @property
    def tables(self) -> dict[str, Table]:
        """The tables of the analysis as data, by name: points, budgets, ladders."""
        return {table.name: table for table in self._result.tables}

    @property
    def figures(self) -> dict[str, str]:
        """The figures that `plot` can draw: name and title."""
        return {plot.name: plot.title for plot in self._result.plots}

    def __getitem__(self, name: str) -> Value:
        estimate = self._result.estimates.get(name)
        if estimate is None:
            raise UnknownQuantityError(
                "this result has no such value",
                where=f"{self.kind} of run {self.run_id}",
                value=repr(name),
                limit=", ".join(self._result.estimates),
            )
        quantity = self._result.quantity(name)
        return Value(
            name=name,
            title=quantity.titled(name),
            value=estimate.value,
            uncertainty=estimate.expanded_uncertainty,
            unit=estimate.unit,
            shown=show(estimate, quantity).with_uncertainty,
            estimate=estimate,
        )

    def __iter__(self) -> Iterator[str]:
        return iter(self._result.estimates)

    def __len__(self) -> int:
        return len(self._result.estimates)

    def to_pandas(self) -> pandas.DataFrame:
        """One row per value in SI: value, uncertainty (U, 95 %), unit, statistical part, identifiable, note."""
        frame = optional("pandas", "a data frame of results").DataFrame
        rows = {name: _row(value) for name, value in self.items()}
        made = frame.from_dict(rows, orient="index")
        made.attrs = {"run": self.run_id, "kind": self.kind}
        return made

    def plot(self, which: str = "") -> Figure:
        """A figure of the analysis: by its name, by the number it has in the paper ("17"), or the first one.

        Raises `AnalysisError` that lists those there are.
        """
        return _draw(self._result.plots, which, self.fit.origin, f"{self.kind} of {self.run_id}")

    def compare(self, gear: HarmonicDrive | None = None) -> Comparison:
        """A parameter set held against the run, nothing fitted; without one that of the fit."""
        from rig.analysis.adopt import compare_with
        from rig.analysis.fit.recorded import score, with_gear

        fit = self.fit if gear is None else with_gear(self.fit, gear)
        return Comparison(fit.gear, compare_with(fit.gear, fit.result), score(fit), self.fit.origin)

    def store(self) -> str:
        """Append it to the analyses beside its run file, as `rig fit` does; the name under which it lies there."""
        from rig.analysis.fit.recorded import store

        if self.fit.path is None:
            raise RigError(
                "a recording in memory has no store of analyses",
                where=self.run_id,
                remedy="Import it with `rig import`, and fit that run.",
            )
        self.fit = store(self.fit, datetime.now().astimezone().isoformat(timespec="seconds"))
        return self.fit.stored

    @property
    def _result(self) -> Analysed:
        return self.fit.result

    def _grid(self) -> Grid:
        keys = key_names(self._result.quantities, self)
        names = [*keys, *(name for name in self if name not in keys)]
        grid = estimate_grid(self._result).without(LIMIT, "remark")
        rows = dict(zip(self, grid.rows, strict=True))
        origin = self.fit.recording.metadata.origin.upper()
        remarks = [f"tare: {words}" for words in self.tare]
        remarks += [f"warning: {text}" for text in self.warnings]
        return Grid(
            f"{self.kind} of run {self.run_id} ({origin})",
            (Column("name"), *grid.columns),
            [(name, *rows[name]) for name in names],
            "\n".join(remarks),
        )


class UnknownQuantityError(RigError, KeyError):
    """A name that a result does not have."""

    __str__ = RigError.__str__


def _row(value: Value) -> dict[str, object]:
    low, high = value.interval
    return {
        "value": value.value,
        "uncertainty": value.uncertainty,
        "unit": value.unit,
        "low": low,
        "high": high,
        "identifiable": value.identifiable,
        "title": value.title,
        "note": value.note,
    }


def _draw(plots: Sequence[Plot], which: str, origin: str, where: str) -> Figure:
    from rig.present.figure import draw_figure

    named = [plot for plot in plots if which in ("", plot.name, *plot.figure.split(", "))]
    if not named:
        raise AnalysisError(
            "there is no such figure",
            where=where,
            value=repr(which) if which else None,
            limit=", ".join(p.name + phrase(" ({})", p.figure) for p in plots),
        )
    return draw_figure(named[0], origin)


class Results(Sequence[Result]):
    """The results of several runs, in the order in which these were given."""

    def __init__(self, results: Sequence[Result]) -> None:
        self._results = tuple(results)

    @overload
    def __getitem__(self, place: int) -> Result: ...
    @overload
    def __getitem__(self, place: slice) -> tuple[Result, ...]: ...
    def __getitem__(self, place: int | slice) -> Result | tuple[Result, ...]:
        return self._results[place]

    def __len__(self) -> int:
        return len(self._results)

    def to_pandas(self) -> pandas.DataFrame:
        """One row per run and value: see `Result.to_pandas`."""
        pandas = optional("pandas", "a data frame of results")
        return pandas.concat({one.run_id: one.to_pandas() for one in self}, names=["run", "name"])

    @property
    def pooled(self) -> dict[str, tuple[float, float]]:
        """Mean and standard deviation between the runs (SI) of every value that several of them have."""
        from rig.analysis.adopt import pooled

        spread = pooled([one.fit.result for one in self])
        return {one.key: (one.mean, one.deviation) for one in spread}

    def __repr__(self) -> str:
        return "\n\n".join(map(repr, self))

    def _repr_html_(self) -> str:
        return "".join(one._repr_html_() for one in self)


class Comparison(Tabular):
    """A parameter set held against a run: what it says, what the run identified, and how well it predicts the run."""

    def __init__(
        self, gear: HarmonicDrive, rows: Sequence[Compared], scored: Analysed, origin: str
    ) -> None:
        self.gear, self.rows = gear, tuple(rows)
        self._scored, self._origin = scored, origin

    @property
    def metrics(self) -> dict[str, float]:
        """How well the set predicts the run, in SI: errors, and skills against null models."""
        return dict(self._scored.metrics)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What to beware of."""
        return self._scored.warnings

    def to_pandas(self) -> pandas.DataFrame:
        """One row per value of the set: value of the set, identified value, U, normalised error, whether they agree."""
        frame = optional("pandas", "a data frame of a comparison").DataFrame
        return frame.from_dict({row.path: row.as_json() for row in self.rows}, orient="index")

    def plot(self, which: str = "") -> Figure:
        """A figure of the comparison: by its name, by the number it has in the paper, or the first one."""
        return _draw(self._scored.plots, which, self._origin, f"comparison with {self.gear.name}")

    def _grid(self) -> Grid:
        grid = comparison_grid(self.rows, self.gear)
        rows = [(one.path, *cells) for one, cells in zip(self.rows, grid.rows, strict=True)]
        merits = [
            f"{title}: {' / '.join(texts)}" for title, *texts in metric_grid(self._scored).rows
        ]
        nothing = [] if rows else ["This run identifies no value that a parameter set holds."]
        title = f"{self._scored.kind} of run {self._scored.run} against {self.gear.name}"
        return Grid(
            title,
            (Column("name"), *grid.columns),
            rows,
            "\n".join([*nothing, *merits, *self.warnings]),
        )
