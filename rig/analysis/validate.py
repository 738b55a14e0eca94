"""A ladder of models validated: each rung fitted to some runs, judged on others that the fit has not seen.

    hold-out error  r.m.s. of what a rung leaves of the runs that it was not fitted to
    skill           1 - sum of squares left / sum of squares that the null model leaves, of the same rows
    BIC             n_e ln(SSE/n) + p ln n_e  on the runs that were fitted

n_e is how many independent values the rows are worth, by the autocorrelation of what the richest rung leaves: rows
of an encoder are not as many observations as they are rows. Schwarz 1978; the lower BIC is the better model.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments import catalogue
from experiments.errors import analysing
from experiments.result import Plot, Series, Table
from model.unit_text import scale_in
from rig.analysis.fit.recorded import kind_of
from rig.analysis.fit.run import Choices, evidence_for
from rig.analysis.store import read_analyses
from rig.errors import RigError
from rig.runfile import read

if TYPE_CHECKING:
    from experiments.ladder import Ladder, Rung, Sample
    from model.arrays import FloatArray


@dataclass(frozen=True, kw_only=True)
class ValidatedRung:
    """One model: numbers that it fits, r.m.s. left of the fitted and of the held-out runs [SI], skill, BIC."""

    name: str
    parameters: int
    fitted_error: float
    held_out_error: float
    skill: float
    bic: float

    def as_json(self) -> dict[str, Any]:
        """As `rig validate --json` prints it."""
        return dict(vars(self))


@dataclass(frozen=True, kw_only=True)
class Validation:
    """Every rung of a ladder, the null model first. `fitted` and `judged` are the runs; one run in both was held out
    in its turn.
    """

    kind: str
    quantity: str
    unit: str
    shown: str
    fitted: tuple[str, ...]
    judged: tuple[str, ...]
    rungs: tuple[ValidatedRung, ...]
    origin: str
    """Of the runs: one that is not from hardware marks the whole."""
    independent: float
    """n_e of the fitted runs."""

    @property
    def best(self) -> ValidatedRung:
        """The rung with the least hold-out error."""
        return min(self.rungs, key=lambda rung: rung.held_out_error)

    @property
    def best_by_bic(self) -> ValidatedRung:
        """The rung with the least BIC."""
        return min(self.rungs, key=lambda rung: rung.bic)

    @property
    def is_held_out_in_turn(self) -> bool:
        """Whether every run was judged by what the others say."""
        return self.fitted == self.judged

    def as_json(self) -> dict[str, Any]:
        """As `rig validate --json` prints it; errors in `unit`."""
        return {
            "kind": self.kind,
            "quantity": self.quantity,
            "unit": self.unit,
            "shown": self.shown,
            "origin": self.origin,
            "fitted": list(self.fitted),
            "judged": list(self.judged),
            "held_out_in_turn": self.is_held_out_in_turn,
            "independent_values": self.independent,
            "rungs": [rung.as_json() for rung in self.rungs],
            "best": self.best.name,
            "best_by_bic": self.best_by_bic.name,
        }

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> Validation:
        """What `rig validate --json` printed."""
        return cls(
            kind=content["kind"],
            quantity=content["quantity"],
            unit=content["unit"],
            shown=content["shown"],
            fitted=tuple(content["fitted"]),
            judged=tuple(content["judged"]),
            rungs=tuple(ValidatedRung(**rung) for rung in content["rungs"]),
            origin=content["origin"],
            independent=content["independent_values"],
        )

    @property
    def sentence(self) -> str:
        """What was judged on what."""
        if self.is_held_out_in_turn:
            return f"each of {len(self.judged)} runs predicted by a fit of the others"
        return f"fitted on {', '.join(self.fitted)}; judged on {', '.join(self.judged)}"

    def table(self) -> Table:
        """The ladder as a table: r.m.s. left of fitted and of held-out runs, in the unit of a laboratory."""
        factor = scale_in(self.shown, self.unit) or 1.0
        rows = tuple(
            (
                f"{number}  {r.name}",
                r.parameters,
                _rounded(r.fitted_error / factor),
                _rounded(r.held_out_error / factor),
                round(r.skill, 4) if abs(r.skill) < 10.0 else _rounded(r.skill),
                round(r.bic, 1),
            )
            for number, r in enumerate(self.rungs, 1)
        )
        columns = (
            "model",
            "numbers",
            f"fitted [{self.shown}]",
            f"held out [{self.shown}]",
            "skill",
            "BIC",
        )
        return Table("validation", f"Models of the {self.quantity}", columns, rows, self.sentence)

    def plot(self) -> Plot:
        """What every rung leaves of the fitted and of the held-out runs."""
        factor = scale_in(self.shown, self.unit) or 1.0
        place = np.arange(1.0, len(self.rungs) + 1.0)
        series = tuple(
            Series(label=label, x=place, y=np.array(values) / factor, style="points", group=group)
            for group, (label, values) in enumerate(
                (
                    ("held-out runs", [r.held_out_error for r in self.rungs]),
                    ("fitted runs", [r.fitted_error for r in self.rungs]),
                )
            )
        )
        names = "; ".join(f"{number}: {r.name}" for number, r in enumerate(self.rungs, 1))
        return Plot(
            name="validation",
            title=f"What each model leaves of the {self.quantity}",
            x_label="model",
            y_label=f"root mean square [{self.shown}]",
            series=series,
            y_scale="log",
            note=f"What each model leaves of runs that it was not fitted to: the lower the better. {names}.",
        )


def _rounded(value: float) -> float:
    return float(f"{value:.4g}")


def validate_runs(
    fitted: Sequence[Path],
    judged: Sequence[Path] = (),
    kind: str = "",
    choices: Choices | None = None,
) -> Validation:
    """Fit every rung of the ladder to runs, and judge it on others.

    Without `judged` each run is predicted by a fit of all the others. The kind follows from the protocol of the runs.
    Raises `RigError` where nothing is left to judge by, `PlanError` for a kind without a ladder, and the errors of
    an analysis.
    """
    runs = list(dict.fromkeys(map(Path, fitted)))
    others = list(dict.fromkeys(map(Path, judged)))
    _refuse_unjudged(runs, others)
    kind = _one_kind([*runs, *others], kind)
    ladder = catalogue.ladder(kind)
    samples = {path: _sample(ladder, path, kind, choices) for path in [*runs, *others]}
    train = [samples[path] for path in runs]
    # In its turn each run is held out: who fits them all can judge none.
    if others:
        turns = [(train, [samples[path] for path in others])]
    else:
        turns = [([s for s in train if s is not one], [one]) for one in train]
    unit, shown = _units(ladder, list(samples.values()))
    rungs, independent = _validated(ladder, list(samples.values()), train, turns, kind)
    return Validation(
        kind=kind,
        quantity=ladder.quantity,
        unit=unit,
        shown=shown,
        fitted=tuple(sample.run for sample in train),
        judged=tuple(samples[path].run for path in (others or runs)),
        rungs=rungs,
        origin=next((s.origin for s in samples.values() if s.origin != "hardware"), "hardware"),
        independent=independent,
    )


def _refuse_unjudged(runs: Sequence[Path], others: Sequence[Path]) -> None:
    both = [path.name for path in runs if path in others]
    if both:
        raise RigError(
            "a run that is fitted cannot judge the fit",
            where=", ".join(both),
            remedy="Name it once.",
        )
    if not others and len(runs) < 2:
        raise RigError(
            "one run cannot be fitted and judge the fit",
            value=f"{len(runs)} runs",
            limit="at least 2, or one to judge on",
            remedy="Give further runs, or name with --on those to judge on.",
        )


def _units(ladder: Ladder, samples: Sequence[Sample]) -> tuple[str, str]:
    """The SI unit of the runs and the one in which they are shown. Raises `RigError` where runs have several."""
    units = {sample.unit or ladder.unit: sample.run for sample in samples}
    if len(units) > 1:
        raise RigError(
            "the runs have channels of several units",
            value=", ".join(f"{unit} ({run})" for unit, run in units.items()),
            limit="one",
            remedy="Name the channel, or runs that have the same.",
        )
    (unit,) = units
    return unit, ladder.shown if unit == ladder.unit else unit


def _one_kind(paths: Sequence[Path], kind: str) -> str:
    """The kind of all runs: of their protocol, or of their newest fit. Raises `RigError` where they are of several."""
    if kind:
        return kind
    kinds: dict[str, str] = {}
    for path in paths:
        recording = read.open_run(path)
        # A recording of another rig has no protocol: what it was fitted as stands beside it.
        fits = () if recording.metadata.experiment else read_analyses(path)
        try:
            kinds.setdefault(kind_of(recording, fits[-1].kind if fits else ""), path.name)
        finally:
            read.close_recording(recording)
    if len(kinds) > 1:
        raise RigError(
            "the runs are of several protocols",
            value=", ".join(f"{kind} ({name})" for kind, name in kinds.items()),
            limit="one",
            remedy="Name runs of one protocol, or the kind.",
        )
    return next(iter(kinds))


def _sample(ladder: Ladder, path: Path, kind: str, choices: Choices | None) -> Sample:
    recording, evidence = evidence_for(path, kind, choices)
    try:
        with analysing(recording.metadata.run_id):
            return ladder.sample(recording, evidence)
    finally:
        read.close_recording(recording)


def _held_out(
    ladder: Ladder, rung: Rung, turns: Sequence[tuple[list[Sample], list[Sample]]]
) -> FloatArray:
    """What a rung leaves of all runs that it was judged on (n,)."""
    left = []
    for train, judged in turns:
        fitted = rung.fit(train)
        left += [ladder.left(rung, fitted, sample) for sample in judged]
    return np.concatenate(left)


def _validated(
    ladder: Ladder,
    samples: list[Sample],
    train: list[Sample],
    turns: Sequence[tuple[list[Sample], list[Sample]]],
    kind: str,
) -> tuple[tuple[ValidatedRung, ...], float]:
    """Every rung that applies to the samples, fitted to `train` and judged in turn; and n_e of the fitted runs."""
    rungs = ladder.rungs_for(samples)
    with analysing(f"the ladder of {kind}"):
        all_fitted = [rung.fit(train) for rung in rungs]
        held = [_held_out(ladder, rung, turns) for rung in rungs]
    within = [
        np.concatenate([ladder.left(rung, one, sample) for sample in train])
        for rung, one in zip(rungs, all_fitted, strict=True)
    ]
    independent = independent_values(min(within, key=lambda left: float(left @ left)))
    validated = tuple(
        ValidatedRung(
            name=rung.name,
            parameters=rung.numbers(one),
            fitted_error=_rms(inside),
            held_out_error=_rms(outside),
            skill=1.0 - float(outside @ outside) / float(held[0] @ held[0]),
            bic=_bic(inside, rung.numbers(one), independent),
        )
        for rung, one, inside, outside in zip(rungs, all_fitted, within, held, strict=True)
    )
    return validated, independent


def _rms(left: FloatArray) -> float:
    return math.sqrt(float(np.mean(left**2)))


def independent_values(left: FloatArray) -> float:
    """How many independent values a residual (n,) is worth: n over the sum of its autocorrelation up to the first zero.

    By the initial positive sequence (Geyer 1992); never more than n.
    """
    n = len(left)
    centred = left - left.mean()
    power = np.abs(np.fft.rfft(centred, 2 * n)) ** 2
    correlation = np.fft.irfft(power)[:n]
    if not correlation[0] > 0.0:
        return float(n)
    correlation = correlation / correlation[0]
    negative = np.flatnonzero(correlation <= 0.0)
    end = int(next(iter(negative), n))
    return min(float(n), n / (1.0 + 2.0 * float(correlation[1:end].sum())))


def _bic(left: FloatArray, parameters: int, independent: float) -> float:
    """Schwarz' criterion of a residual worth so many independent values."""
    return independent * math.log(float(np.mean(left**2))) + parameters * math.log(independent)
