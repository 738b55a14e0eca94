"""The passport of one gear, made from its runs: which quantities, their series, and what is missing by name."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from experiments.quantity import Quantity
from model.identify.estimate import Estimate
from rig.analysis.passport.chart import BASELINE_RUNS, RULES
from rig.analysis.passport.content import Missing, Passport, PassportSeries
from rig.analysis.passport.draw import point_table, spectrum_plots
from rig.analysis.passport.followed import FollowedQuantity, followed, largest_followed, watched
from rig.analysis.passport.gather import AnalysedRun, Gathered, gather, runs_of
from rig.analysis.passport.series import series_of, usable
from rig.analysis.tare import takes_tare, tare_kind
from rig.errors import RigError
from rig.runfile.header import ORIGIN_WORDS


def passport(
    where: str | Path | Iterable[str | Path],
    serial: str,
    *,
    origin: str = "",
    baseline: int = BASELINE_RUNS,
) -> Passport:
    """The passport of gear `serial` from a folder of runs, several folders, or run files.

    `origin`: only runs of this one; without it the runs from hardware where there are any, else
    every origin for itself: no series ever holds two. `baseline`: how many first runs make the
    control limits. Raises `RigError` where there is no run of this gear, or fewer than two runs are
    to make limits; `RunFileError` for a folder that is none.
    """
    if baseline < 2:
        raise RigError(
            "control limits need runs that can scatter",
            where="baseline",
            value=baseline,
            limit=">= 2",
        )
    runs = runs_of(where, serial)
    if not runs:
        raise RigError(
            "there is no run of this gear",
            where=_place(where),
            value=repr(serial),
            remedy="Serial numbers are compared letter for letter; `rig runs` lists what is there.",
        )
    gathered = gather(runs, origin)
    analysed = gathered.analysed
    series = tuple(
        one for quantity in _followed(analysed) for one in series_of(quantity, analysed, baseline)
    )
    origins = sorted({run.origin for run in gathered.runs})
    mark = " / ".join(ORIGIN_WORDS.get(one, one.upper()) for one in origins if one != "hardware")
    return Passport(
        serial=serial,
        gear=next((run.gear for run in reversed(gathered.runs) if run.gear), ""),
        mark=mark,
        runs=gathered.runs,
        series=series,
        spectra=spectrum_plots(analysed),
        tables=tuple(point_table(one) for one in series),
        missing=(*gathered.missing, *_missing(gathered, series)),
        left_out=gathered.left_out,
        rules=RULES,
    )


def _place(where: str | Path | Iterable[str | Path]) -> str:
    return str(where) if isinstance(where, (str, Path)) else ", ".join(str(one) for one in where)


def _followed(analysed: Sequence[AnalysedRun]) -> list[FollowedQuantity]:
    """The followed quantities; of a family without members of its own the largest of these runs."""
    quantities: list[FollowedQuantity] = []
    for kind, quantity in watched():
        expected = followed(kind, quantity)
        if not expected:
            sizes = [
                _sizes(quantity, one.estimates) for one in analysed if one.analysis.kind == kind
            ]
            expected = largest_followed(kind, quantity, sizes)
        quantities += expected
    return quantities


def _sizes(quantity: Quantity, estimates: Mapping[str, Estimate]) -> dict[str, float]:
    return {
        quantity.member(name): estimate.value
        for name, estimate in estimates.items()
        if quantity.matches(name) and usable(estimate)
    }


def _missing(gathered: Gathered, series: Sequence[PassportSeries]) -> list[Missing]:
    """What a whole passport would have besides: quantities without a run, numbers that the data
    could not tell, tares.
    """
    charted = {(one.kind, one.quantity) for one in series}
    expected = [one for kind, quantity in watched() for one in followed(kind, quantity)]
    missing = [_nothing_of(one, gathered) for one in expected if (one.kind, one.key) not in charted]
    for one in gathered.analysed:
        for quantity in expected:
            estimate = one.estimates.get(quantity.key)
            if quantity.kind == one.analysis.kind and estimate is not None and not usable(estimate):
                why = estimate.note or "not identifiable from this run"
                missing.append(Missing(f"{quantity.title}: {why}", one.run.run_id))
        if takes_tare(one.analysis.kind) and one.facts.get("torque of") != "gear":
            missing.append(_without_tare(one))
    return missing


def _without_tare(one: AnalysedRun) -> Missing:
    """That the torque of a run is not the gear's own, and what helps: a tare is then found by itself."""
    tare = one.analysis.tare.get("run", "")
    why = f"the tare {tare} could not be subtracted" if tare else "no motor tare was subtracted"
    return Missing(
        f"its running torque is that of motor and gear together: {why}",
        one.run.run_id,
        f"rig run {tare_kind()}, then rig fit {one.run.path}",
    )


def _nothing_of(quantity: FollowedQuantity, gathered: Gathered) -> Missing:
    analysed = [one for one in gathered.analysed if one.analysis.kind == quantity.kind]
    if analysed:
        return Missing(
            f"{quantity.title}: not among what its {len(analysed)} {quantity.kind} analyses found",
            "",
            quantity.step,
        )
    if any(run.protocol == quantity.kind for run in gathered.runs):
        return Missing(f"{quantity.title}: no {quantity.kind} run is analysed", "", "--analyse")
    return Missing(
        f"{quantity.title}: there is no {quantity.kind} run of this gear", "", quantity.step
    )
