"""A lot of gears: how many pass, how its quantities stand to their limits, which gears to look at, what is unknown.

Every gear counts once, by the newest analysed run of each kind. Verdicts are those that the results
hold: by the acceptance file as it was when the runs were fitted.
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from experiments.result import WORST_FIRST, VerdictOutcome
from rig.analysis.alarm.laboratory import watching_in_force
from rig.analysis.alarm.promise import Watching
from rig.analysis.judging import no_acceptance, worst_of
from rig.analysis.passport.build import alarms_of
from rig.errors import RigError
from rig.fleet.lot_quantity import LotQuantity, is_on, lot_quantity, quantity_as_json
from rig.fleet.lot_rows import LotData, LotRow, read_lot
from rig.fleet.lot_words import limit_words, value_words
from rig.gears.acceptance import Acceptance, acceptance_named

_BEYOND = ("FAIL", "MARGINAL")
_SHOWN_GEARS = 10
"""Gears to look at that a report names."""
_FAR_OUT = 3.5
"""Robust standard deviations from the median above which a gear is unlike the others (Iglewicz and Hoaglin 1993)."""
_LEAST_TO_COMPARE = 10
"""Gears below which none is called unlike the others."""
_VERDICTS: tuple[VerdictOutcome, ...] = ("PASS", "MARGINAL", "FAIL", "NOT JUDGED")


@dataclass(frozen=True, kw_only=True)
class LotGear:
    """A gear of the lot: its verdict, why it is not a better one, and what makes it worth a look.

    `changed` says what a passport of its runs tells to have changed; `beyond` are the limits that it breaks or may
    break, whatever else is not judged; `margin` is the smallest distance to a limit in expanded uncertainties, negative
    beyond it, infinite without one, and `nearest` that limit in words.
    """

    gear: str
    bench: str
    verdict: VerdictOutcome
    because: tuple[str, ...]
    changed: tuple[str, ...]
    beyond: tuple[str, ...]
    margin: float
    nearest: str
    unlike: tuple[str, ...]
    is_complete: bool
    """Whether it is judged by all that its acceptance file asks."""
    run_files: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Lot:
    """Everything that the report of a lot says."""

    data: LotData
    quantities: tuple[LotQuantity, ...]
    gears: tuple[LotGear, ...]
    notes: tuple[str, ...]

    @property
    def verdicts(self) -> dict[str, int]:
        """How many gears have which verdict."""
        counted = Counter(gear.verdict for gear in self.gears)
        return {word: counted[word] for word in _VERDICTS}

    @property
    def to_look_at(self) -> tuple[LotGear, ...]:
        """The gears to look at first: failed, marginal, changed or unlike the others, nearest to a limit."""
        return tuple(sorted(filter(why_of, self.gears), key=_urgency)[:_SHOWN_GEARS])

    @property
    def not_judged(self) -> dict[str, list[str]]:
        """Why gears are not judged: reason, and the gears, the most frequent reason first."""
        gears: dict[str, list[str]] = defaultdict(list)
        for gear in self.gears:
            if gear.verdict == "NOT JUDGED":
                for reason in gear.because:
                    gears[reason].append(gear.gear)
        return dict(sorted(gears.items(), key=lambda pair: (-len(pair[1]), pair[0])))

    def as_json(self) -> dict[str, object]:
        """The object that `rig fleet report --json` prints."""
        return {
            "results": str(self.data.folder),
            "origin": self.data.origin,
            "gears": len(self.gears),
            "runs": self.data.runs,
            "verdicts": self.verdicts,
            "quantities": [quantity_as_json(one) for one in self.quantities],
            "look_at": [
                {"gear": one.gear, "verdict": one.verdict, "why": list(why_of(one))}
                for one in self.to_look_at
            ],
            "not_judged": self.not_judged,
            "failures": [
                {"gear": gear, "run": run, "reason": reason}
                for gear, run, reason in self.data.failures
            ],
            "notes": list(self.notes),
        }


def lot_of(folder: Path, *, origin: str = "", part: str = "") -> Lot:
    """The lot whose results lie in a folder. Raises `RigError` where there are none of it."""
    data = read_lot(folder, origin=origin, part=part)
    accepted, notes = _acceptances(data.rows)
    rows_by_quantity: dict[tuple[str, str], list[LotRow]] = defaultdict(list)
    for row in data.rows:
        rows_by_quantity[row.kind, row.quantity].append(row)
    quantities = [lot_quantity(rows, accepted) for rows in rows_by_quantity.values()]
    quantities.sort(key=_importance)
    return Lot(
        data=data,
        quantities=tuple(quantities),
        gears=tuple(_gears(data, quantities, accepted)),
        notes=(*notes, *_notes(data, quantities)),
    )


def why_of(gear: LotGear) -> tuple[str, ...]:
    """Why a gear is worth a look, the strongest reason first."""
    near = (f"nearest to its limit: {gear.nearest}",) if gear.nearest and not gear.beyond else ()
    return (*gear.beyond, *gear.changed, *gear.unlike, *near)


def _acceptances(
    rows: Sequence[LotRow],
) -> tuple[dict[str, Acceptance | None], tuple[str, ...]]:
    """The acceptance files that the rows name, None for one that cannot be read; and what is to be said of those."""
    accepted: dict[str, Acceptance | None] = {}
    notes = []
    for name in sorted({row.acceptance for row in rows if row.acceptance}):
        try:
            accepted[name] = acceptance_named(name)
        except RigError as error:
            accepted[name] = None
            notes.append(
                f"The acceptance file {name} cannot be read, so that a limit that no gear was measured for is not "
                f"missed, and of two sides only the one that decided is known: {error}"
            )
    return accepted, tuple(notes)


def _gears(
    data: LotData, quantities: Sequence[LotQuantity], accepted: Mapping[str, Acceptance | None]
) -> list[LotGear]:
    rows_of: dict[str, list[LotRow]] = defaultdict(list)
    for row in data.rows:
        rows_of[row.gear].append(row)
    titles = {(q.kind, q.name): q for q in quantities}
    watching = watching_in_force()
    unlike = _unlike(quantities)
    failures: dict[str, list[str]] = defaultdict(list)
    for gear, run, reason in data.failures:
        failures[gear].append(f"run {run} could not be analysed: {reason}")
    return [
        _gear(
            gear,
            rows_of[gear],
            titles,
            accepted,
            _GearRemarks(_changed(data, gear, watching), unlike.get(gear, []), failures[gear]),
        )
        for gear in data.gears
    ]


@dataclass(frozen=True)
class _GearRemarks:
    """What is to be said of a gear beside its rows."""

    changed: tuple[str, ...]
    unlike: Sequence[str]
    failures: Sequence[str]


def _changed(data: LotData, gear: str, watching: Watching) -> tuple[str, ...]:
    """What has changed with a gear, by its run files as far as they are there; why nobody can tell, where it is so."""
    if gear not in data.histories:
        return ()
    named = dict.fromkeys((gear, watching.golden_gear))
    files = [Path(file) for one in named for file in data.histories.get(one, ())]
    try:
        alarms = alarms_of([file for file in files if file.is_file()], gear, watching)
    except RigError as error:
        return (f"whether it has changed cannot be told: {error}",)
    return tuple(one.sentence for one in alarms)


def _gear(
    gear: str,
    rows: Sequence[LotRow],
    quantities: Mapping[tuple[str, str], LotQuantity],
    accepted: Mapping[str, Acceptance | None],
    told: _GearRemarks,
) -> LotGear:
    lines: list[tuple[VerdictOutcome, str]] = []
    margins: list[tuple[float, str]] = []
    for row in rows:
        if not row.verdict:
            continue
        words = _words(row, quantities[row.kind, row.quantity])
        lines.append((_outcome(row.verdict), words))
        if row.is_judged and (margin := _margin(row)) is not None:
            margins.append((margin, f"{words}, {margin:.1f} U from it"))
    lines.extend(("NOT JUDGED", why) for why in _missing(gear, rows, accepted))
    lines.sort(key=lambda line: WORST_FIRST.index(line[0]))
    verdict = worst_of([outcome for outcome, _ in lines])
    because = [words for outcome, words in lines if outcome != "PASS"]
    if verdict == "NOT JUDGED":
        because = [words for outcome, words in lines if outcome == "NOT JUDGED"] + list(
            told.failures
        )
    margin, nearest = min(margins, default=(math.inf, ""))
    return LotGear(
        gear=gear,
        bench=", ".join(dict.fromkeys(row.bench for row in rows if row.bench)),
        verdict=verdict,
        because=tuple(dict.fromkeys(because)),
        changed=told.changed,
        beyond=tuple(words for outcome, words in lines if outcome in _BEYOND),
        margin=margin,
        nearest=nearest,
        unlike=tuple(told.unlike),
        is_complete=bool(lines) and all(outcome != "NOT JUDGED" for outcome, _ in lines),
        run_files=tuple(dict.fromkeys(row.run_file for row in rows)),
    )


def _missing(
    gear: str, rows: Sequence[LotRow], accepted: Mapping[str, Acceptance | None]
) -> list[str]:
    """Why a gear is judged by less than its acceptance file asks."""
    names = sorted({row.acceptance for row in rows if row.acceptance})
    if not names:
        return [no_acceptance("SERIAL")] if rows else ["no run of it is analysed"]
    missing = []
    for name in names:
        acceptance = accepted.get(name)
        for limit in acceptance.limits if acceptance is not None else ():
            if not any(row.verdict and is_on(limit, row) for row in rows):
                missing.append(f"no {limit.kind} run of this gear is analysed")
    return list(dict.fromkeys(missing))


def _words(row: LotRow, quantity: LotQuantity) -> str:
    """A row in words: title, value with its uncertainty, limit; why it is not judged."""
    if row.verdict == "NOT JUDGED":
        return f"{quantity.title}: {row.reason or 'not judged'}"
    return f"{quantity.title}: {row.verdict}, {value_words(row, quantity)}, limit {limit_words(row, quantity)}"


def _margin(row: LotRow) -> float | None:
    """Distance to the limit in expanded uncertainties, negative beyond it; None where U is not known."""
    if row.value is None or row.limit_value is None or not row.expanded_uncertainty:
        return None
    room = row.limit_value - row.value if row.limit_is == "upper" else row.value - row.limit_value
    return room / row.expanded_uncertainty


def _unlike(quantities: Sequence[LotQuantity]) -> dict[str, list[str]]:
    """Gears that are far from all others in a quantity, whatever its limit: gear, and in which how far."""
    found: dict[str, list[tuple[float, str]]] = defaultdict(list)
    for one in quantities:
        rows = one.measured
        if len(rows) < _LEAST_TO_COMPARE or one.quantity.is_circular:
            continue
        values = np.array([row.value for row in rows], dtype=float)
        from_median = values - np.median(values)
        scale = 1.4826 * float(np.median(np.abs(from_median)))
        if not scale > 0.0:
            continue
        for row, distance in zip(rows, from_median / scale, strict=True):
            if abs(distance) > _FAR_OUT:
                side = "above" if distance > 0 else "below"
                words = (
                    f"{one.title}: {abs(distance):.1f} robust standard deviations {side} the median"
                )
                found[row.gear].append((-abs(distance), words))
    return {gear: [words for _, words in sorted(several)] for gear, several in found.items()}


def _urgency(gear: LotGear) -> tuple[int, float, str]:
    """What fails first, then what is marginal, then what has changed or is unlike the others, then the rest."""
    if gear.beyond:
        return int(gear.verdict != "FAIL"), gear.margin, gear.gear
    return (2 if gear.changed or gear.unlike else 3), gear.margin, gear.gear


def _importance(one: LotQuantity) -> tuple[bool, str, str]:
    return one.limits is None, one.kind, one.name


def _outcome(word: str) -> VerdictOutcome:
    return next(one for one in _VERDICTS if one == word)


def _notes(data: LotData, quantities: Sequence[LotQuantity]) -> list[str]:
    """What a reader of the lot must know of it: what is left out, and what is doubtful of its limits."""
    notes = [
        f"{one.title}: {one.limits.note}" for one in quantities if one.limits and one.limits.note
    ]
    for origin, gears in data.other_origins:
        if gears:
            which = "that is not stated are left out"
            if origin:
                which = f"{origin} are left out: --origin {origin}"
            notes.append(f"{gears} gears of origin {which}")
    if data.nameless_runs:
        notes.append(f"{data.nameless_runs} runs name no gear and are left out")
    if data.unfinished:
        notes.append(f"{len(data.unfinished)} runs were broken off and do not count")
    return notes
