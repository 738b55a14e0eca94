"""What is seen first of a demonstration, on one screen: verdict, the numbers beside the truth, what to look out for."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from textwrap import wrap

from experiments.quantity import key_names
from experiments.result import Result, Verdict
from rig.content.phrase import quoted
from rig.content.wording import Shown, fixed, number, show
from rig.trial.demo.chain import Demonstration

ROWS, SENTENCES = 8, 3
"""Numbers and sentences on the screen at most; all others are shown by `rig demo --all`."""
HEIGHT, NAME = 24, 26
"""Lines of the screen, and letters of a name beyond which it goes on in a second line."""
_LABEL = 13
"""Letters of the words before a file or a next command."""


@dataclass(frozen=True)
class Row:
    """One number: name, value and U in the laboratory's unit, limit, truth, and whether that lies in value ± U."""

    name: str
    shown: Shown
    limit: str
    truth: str
    is_inside: bool


def first_screen(demonstration: Demonstration, width: int = 80) -> list[str]:
    """The lines of the screen, none wider than `width` but a file's name that is.

    Judged quantities come first, then those that a reader looks for first.
    """
    verdict = demonstration.campaign.verdict
    passed = sum(line.outcome == "PASS" for line in verdict.lines)
    part = demonstration.fits[0].recording.metadata.gear
    head = f"SIMULATED  {part.name if part else ''} {demonstration.order.serial}"
    said = f"{verdict.verdict}  {passed} of {len(verdict.lines)} limits"
    told = _spread(_merged(_rows(demonstration))[:ROWS], width)
    files = [("certificate", str(path)) for path in demonstration.certificate[-1:]]
    files += [("next", f"rig live --runs {quoted(demonstration.order.folder)}")]
    ends = [f"{label:<{_LABEL}}{what}" for label, what in files]
    left = HEIGHT - 2 - len(told) - len(ends)
    return [
        f"{head}{said:>{max(width - len(head), len(said) + 2)}}",
        *told,
        *_look_out(demonstration, width, left),
        *ends,
    ]


def _rows(demonstration: Demonstration) -> Iterator[Row]:
    """Every number that has a truth and that a reader looks for, those with a limit first."""
    results = {fit.result.kind: fit.result for fit in demonstration.fits}
    truths = {(kind, row.estimate.name): row for kind, row in demonstration.truth}
    judged = {
        (line.kind, line.estimate.name): line for line in demonstration.campaign.verdict.lines
    }
    wanted = [*judged, *((kind, name) for kind, one in results.items() for name in _keys(one))]
    for kind, name in dict.fromkeys(wanted):
        if (kind, name) in truths:
            row, quantity = truths[kind, name], results[kind].quantity(name)
            shown, line = show(row.estimate, quantity), judged.get((kind, name))
            truth = fixed((row.estimate.value - row.error) / shown.scale, shown.decimals or 0)
            yield Row(quantity.titled(name), shown, _limit(line, shown), truth, row.within)


def _merged(rows: Iterable[Row]) -> list[Row]:
    """Two directions that say the same are one row, without its direction."""
    found: dict[tuple[str, ...], Row] = {}
    for row in rows:
        name = row.name.removesuffix(" forward").removesuffix(" reverse")
        value, half = row.shown.value.lstrip("−-"), row.shown.expanded
        key = (name, value, half, row.limit, row.truth.lstrip("−-"), str(row.is_inside))
        found[key] = row if key not in found else replace(found[key], name=name)
    return list(found.values())


def _keys(result: Result) -> Sequence[str]:
    """The names that a reader looks for first, without phases, which mean nothing alone."""
    names = [name for name in result.estimates if not name.startswith("phase_")]
    return key_names(result.quantities, names)


def _limit(line: Verdict | None, shown: Shown) -> str:
    if line is None:
        return ""
    return f"limit {number(line.limit / shown.scale)}"


def _spread(rows: Sequence[Row], width: int) -> list[str]:
    """The rows as lines with decimal points under each other, as many of the first ones as fit."""
    names = [wrap(row.name, NAME) for row in rows]
    columns = [
        [name[0] for name in names],
        [f"{value} ± {half}" for value, half in _aligned(rows)],
        [row.shown.unit for row in rows],
        [row.limit for row in rows],
        [f"true {truth}" for truth in _by_the_point([row.truth for row in rows])],
        ["inside" if row.is_inside else "outside" for row in rows],
    ]
    wide = [max(map(len, column), default=0) for column in columns]
    lines: list[str] = []
    gap = "  " if sum(wide) + 2 * (len(wide) - 1) <= width else " "
    for name, cells in zip(names, zip(*columns, strict=True), strict=True):
        line = gap.join(f"{cell:<{w}}" for cell, w in zip(cells, wide, strict=True)).rstrip()
        lines += [line, *(f"  {more}" for more in name[1:])]
    if max(map(len, lines), default=0) > width:
        return _spread(rows[:-1], width)
    return lines


def _aligned(rows: Sequence[Row]) -> list[tuple[str, str]]:
    """Values and U with their decimal points under each other."""
    values, halves = ([getattr(row.shown, part) for row in rows] for part in ("value", "expanded"))
    return list(zip(_by_the_point(values), _by_the_point(halves), strict=True))


def _by_the_point(numbers: Sequence[str]) -> list[str]:
    before, after = (
        max((len(n.partition(".")[side]) for n in numbers), default=0) for side in (0, 2)
    )
    point = after + (after > 0)

    def put(n: str) -> str:
        whole, dot, rest = n.partition(".")
        return f"{whole:>{before}}{dot + rest:<{point}}"

    return [put(n) for n in numbers]


def _look_out(demonstration: Demonstration, width: int, lines: int) -> list[str]:
    """The sentences that matter most, each wrapped whole, as many as there is room for."""
    found: list[str] = []
    for sentence in list(_sentences(demonstration))[:SENTENCES]:
        told = wrap(f"Look out: {sentence}", width, subsequent_indent="  ")
        if len(found) + len(told) <= lines:
            found += told
    return found


def _sentences(demonstration: Demonstration) -> Iterator[str]:
    """What misses the truth, then the warnings of the analyses that are judged, each once, its first sentence."""
    outside = [row for _, row in demonstration.truth if not row.within]
    if outside:
        total = len(demonstration.truth)
        yield f"{len(outside)} of {total} numbers miss the truth by more than U (rig demo --all)."
    judged = {line.kind for line in demonstration.campaign.verdict.lines}
    warned = [w for f in demonstration.fits if f.result.kind in judged for w in f.result.warnings]
    for words in dict.fromkeys(warned):
        yield words.partition(". ")[0].removesuffix(".") + "."
