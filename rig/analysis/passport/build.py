"""The passport of one gear, made from its runs: which quantities, their series, and what is missing by name."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from experiments.quantity import Quantity
from model.identify.estimate import Estimate
from rig.analysis.alarm.laboratory import watching_in_force
from rig.analysis.alarm.promise import Watching
from rig.analysis.passport.content import Alarm, Missing, Passport, PassportSeries
from rig.analysis.passport.draw import point_table, spectrum_plots
from rig.analysis.passport.followed import FollowedQuantity, followed, largest_followed
from rig.analysis.passport.followed import watched as watched_quantities
from rig.analysis.passport.gather import AnalysedRun, Gathered, gather, runs_of
from rig.analysis.passport.series import groups_of, series_of, usable
from rig.analysis.passport.watch import Group, alarmed, days_between, watched
from rig.analysis.tare import takes_tare, tare_kind
from rig.content.phrase import counted, quoted
from rig.errors import RigError
from rig.gears.acceptance import acceptance_of_places
from rig.gears.card_places import places
from rig.library.index import IndexedRun
from rig.runfile.header import ORIGIN_WORDS


def passport(
    where: str | Path | Iterable[str | Path],
    serial: str,
    *,
    origin: str = "",
    watching: Watching | None = None,
) -> Passport:
    """The passport of gear `serial` from a folder of runs, several folders, or run files.

    `origin`: only runs of this one; without it the runs from hardware where there are any, else
    every origin for itself: no series ever holds two. `watching`: how often a gear that does not change may be told to
    have changed; without it what `rig.toml` of the present folder says. Raises `RigError` where there is no run of
    this gear; `RunFileError` for a folder that is none.
    """
    watching = watching or watching_in_force()
    where = places(where)
    gathered = gather(_runs_of_gear(where, serial), origin)
    groups = followed_groups(gathered.analysed)
    chosen = alarmed(groups)
    days = days_between(chosen, _golden(where, serial, watching, origin), watching.promise)
    acceptance = acceptance_of_places(where, serial)

    def drawn(group: Group) -> PassportSeries:
        alarm = None
        if any(group is other for other in chosen):
            alarm = watched(group, watching.promise, len(chosen), days)
        return series_of(group, alarm, watching, acceptance)

    series = tuple(map(drawn, groups))
    origins = sorted({run.origin for run in gathered.runs})
    mark = " / ".join(ORIGIN_WORDS.get(one, one.upper()) for one in origins if one != "hardware")
    return Passport(
        serial=serial,
        gear=next((run.gear for run in reversed(gathered.runs) if run.gear), ""),
        mark=mark,
        runs=gathered.runs,
        series=series,
        spectra=spectrum_plots(gathered.analysed),
        tables=tuple(point_table(one) for one in series),
        missing=(*gathered.missing, *_missing(gathered, series)),
        left_out=gathered.left_out,
        promise=watching.promise.words,
    )


def _runs_of_gear(where: str | Path | Sequence[str | Path], serial: str) -> tuple[IndexedRun, ...]:
    """The runs of a gear. Raises `RigError` where there is none."""
    runs = runs_of(where, serial)
    if not runs:
        raise RigError(
            "there is no run of this gear",
            where=_place(where),
            value=repr(serial),
            remedy="Serial numbers are compared letter for letter; `rig runs` lists what is there.",
        )
    return runs


def alarms_of(
    where: str | Path | Sequence[str | Path], serial: str, watching: Watching | None = None
) -> tuple[Alarm, ...]:
    """What has changed with a gear, by its passport; nothing, and nothing read, while no protocol has runs enough.

    `where` holds the runs of the golden gear too, if they are to be heard.
    """
    watching = watching or watching_in_force()
    runs = [run for run in runs_of(where, serial) if run.is_complete]
    most = max(Counter(run.protocol for run in runs).values(), default=0)
    if most <= watching.promise.baseline:
        return ()
    return passport(where, serial, watching=watching).alarms


def followed_groups(analysed: Sequence[AnalysedRun]) -> list[Group]:
    """The series of comparable runs of every followed quantity."""
    return [one for quantity in _followed(analysed) for one in groups_of(quantity, analysed)]


def _golden(
    where: str | Path | Iterable[str | Path], serial: str, watching: Watching, origin: str
) -> list[Group]:
    """The watched series of the golden gear; none where there is no other one, or where it has no run here."""
    golden = watching.golden_gear
    if not golden or golden == serial:
        return []
    return alarmed(followed_groups(gather(runs_of(where, golden), origin).analysed))


def _place(where: str | Path | Iterable[str | Path]) -> str:
    return ", ".join(map(str, places(where)))


def _followed(analysed: Sequence[AnalysedRun]) -> list[FollowedQuantity]:
    """The followed quantities; of a family without members of its own the largest of these runs."""
    quantities: list[FollowedQuantity] = []
    for kind, quantity in watched_quantities():
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
    expected = [one for kind, quantity in watched_quantities() for one in followed(kind, quantity)]
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
        f"rig run {tare_kind()}, then rig fit {quoted(one.run.path)}",
    )


def _nothing_of(quantity: FollowedQuantity, gathered: Gathered) -> Missing:
    analysed = [one for one in gathered.analysed if one.analysis.kind == quantity.kind]
    if analysed:
        kind = quantity.kind
        many = counted(len(analysed), f"{kind} analysis", f"{kind} analyses")
        return Missing(
            f"{quantity.title}: not among what its {many} found",
            "",
            quantity.step,
        )
    if any(run.protocol == quantity.kind for run in gathered.runs):
        return Missing(f"{quantity.title}: no {quantity.kind} run is analysed", "", "--analyse")
    return Missing(
        f"{quantity.title}: there is no {quantity.kind} run of this gear", "", quantity.step
    )
