"""Page one of a certificate: what was tested for whom, the verdict in a sentence, the limits, two pictures."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from experiments.quantity import key_names
from experiments.result import WORST_FIRST, Verdict
from model.identify.estimate import Estimate
from rig.analysis.fit.recorded import Fit
from rig.analysis.judging import held_against, room_left, whose_limit
from rig.analysis.rows import coverage
from rig.content.grid import Grid, Kind, Tone, columns, tone_of
from rig.content.phrase import shortened
from rig.content.wording import number, show
from rig.present.certificate.gather import Certified
from rig.present.certificate.laboratory import LaboratoryWords
from rig.present.certificate.pictures import Picture, pictures_of
from rig.present.certificate.words import ENGLISH, Words

MOST_LIMITS = 10
"""Lines of the table of limits; the others are counted."""
VALUES = 5
"""Lines of a gear without a limit: the first key quantity of every kind in turn."""
_KINDS: Final[tuple[Kind, ...]] = (
    "quantity",
    "number",
    "number",
    "number",
    "number",
    "text",
    "word",
)
"""Of the columns of the table of limits."""
_SOURCE: Final = 5
MOST_REASONS, LONGEST_REASON = 3, 150
"""Why a limit is not judged: so many are said, in no more letters each."""


@dataclass(frozen=True, kw_only=True)
class Front:
    """What page one shows."""

    facts: tuple[tuple[str, str], ...]
    verdict: str
    tone: Tone
    sentence: str
    incomplete: str
    because: tuple[str, ...]
    values: Grid
    pictures: tuple[Picture, ...]


def front_of(gathered: Certified, laboratory: LaboratoryWords) -> Front:
    """Page one."""
    words = laboratory.words
    values = value_grid(gathered, words)
    verdict = gathered.verdict.verdict
    because = tuple(_because(gathered.verdict.lines, words))
    above = len(values.rows) + 2 * len(because) + 2 * bool(gathered.missing)
    incomplete = ""
    if gathered.missing:
        incomplete = words.INCOMPLETE.format(missing=", ".join(map(words.name, gathered.missing)))
    return Front(
        facts=_facts(gathered, laboratory),
        verdict=words.coded(words.VERDICTS, verdict),
        tone=tone_of(verdict) or "muted",
        sentence=sentence_of(gathered, words),
        incomplete=incomplete,
        because=because,
        values=values,
        pictures=pictures_of(gathered, above, words),
    )


def _facts(gathered: Certified, laboratory: LaboratoryWords) -> tuple[tuple[str, str], ...]:
    words = laboratory.words
    said = (laboratory.customer, laboratory.order, _item_of(gathered, words))
    return tuple(
        (name, text or words.NOT_STATED) for name, text in zip(words.FACTS, said, strict=True)
    )


def _item_of(gathered: Certified, words: Words = ENGLISH) -> str:
    """What was tested, in one line."""
    mounted = [fit for fit in gathered.fits if fit.recording.metadata.gear_mounted]
    fit = (mounted or gathered.fits)[0]
    metadata = fit.recording.metadata
    ratio = mounting = words.NOT_STATED
    if math.isfinite(metadata.ratio):
        ratio = words.numbers(number(metadata.ratio))
    if metadata.is_said("mounting"):
        mounting = words.name(metadata.mounting.replace("-", " "))
    return words.ITEM.format(
        name=fit.gear.name if fit.gear_known else words.UNKNOWN_GEAR,
        serial=gathered.serial,
        ratio=ratio,
        mounting=mounting,
    )


def sentence_of(gathered: Certified, words: Words = ENGLISH) -> str:
    """The verdict in one plain sentence."""
    verdict, acceptance = gathered.verdict, gathered.acceptance
    if verdict.verdict == "NOT JUDGED" or acceptance is None:
        because = next(iter(verdict.because), words.NOTHING_HELD)
        return words.NOT_JUDGED.format(serial=gathered.serial, because=_cut(because.rstrip(".")))
    bad = sum(line.outcome == verdict.verdict for line in verdict.lines)
    said = words.COUNTED[verdict.verdict].format(
        all=len(verdict.lines), bad=bad, name=acceptance.name
    )
    return words.VERDICT.format(serial=gathered.serial, words=said)


def _because(lines: Sequence[Verdict], words: Words) -> Iterator[str]:
    """Why limits are not judged; values that break a limit stand in the table, and nowhere else."""
    reasons = list(dict.fromkeys(f"{one.name}: {one.because}" for one in lines if one.because))
    # The first of them is the sentence of the verdict.
    yield from map(_cut, reasons[1 : MOST_REASONS + 1])
    if len(reasons) > MOST_REASONS + 1:
        yield words.MORE_REASONS.format(count=len(reasons) - MOST_REASONS - 1)


def _cut(text: str) -> str:
    return shortened(text, LONGEST_REASON)


def value_grid(gathered: Certified, words: Words = ENGLISH) -> Grid:
    """Quantity, value ± U, k, degrees of freedom, limit, its source and the verdict; what is nearest to its limit
    comes first. Of a gear without a limit its key quantities.
    """
    lines = sorted(gathered.verdict.lines, key=_nearness)
    shown, others = lines[:MOST_LIMITS], lines[MOST_LIMITS:]
    sources = list(dict.fromkeys(whose_limit(line) for line in shown))
    marks = {source: str(place) for place, source in enumerate(sources, 1)}
    rows = [_judged_row(line, marks[whose_limit(line)], words) for line in shown]
    rows = rows or list(_unjudged_rows(gathered.fits, words))
    heads = columns(*zip(words.HEADS_VALUES, _KINDS, strict=True))
    notes = [words.OF_VALUES]
    said = words.SOURCE if len(marks) > 1 else words.ONE_SOURCE
    notes += [said.format(mark=mark, source=_cut(one)) for one, mark in marks.items()]
    if others:
        counted = Counter(line.outcome for line in others)
        outcomes = ", ".join(
            f"{counted[one]} {words.VERDICTS.get(one, one)}" for one in WORST_FIRST if counted[one]
        )
        told = {"count": len(others), "outcomes": outcomes, "record": words.THE_RECORD}
        notes.append(words.MORE_LIMITS.format(**told))
    grid = Grid("", heads, rows, " ".join(notes))
    return grid if len(marks) > 1 else grid.without(heads[_SOURCE].heading)


def _nearness(line: Verdict) -> tuple[bool, float]:
    """What a value leaves of its limit, in U: what is not judged comes first, then what breaks it by the most."""
    estimate = line.estimate
    if line.outcome == "NOT JUDGED" or not math.isfinite(estimate.value):
        return False, 0.0
    u = estimate.expanded_uncertainty
    return True, room_left(estimate.value, line.limit, u, is_upper=line.is_upper)


def _judged_row(line: Verdict, mark: str, words: Words) -> tuple[str, ...]:
    value, limit = held_against(line)
    title = words.named(line.quantity.headed(line.estimate.name))
    numbers = map(words.numbers, (value, *coverage(line.estimate), limit))
    return (title, *numbers, mark, words.coded(words.VERDICTS, line.outcome))


def _unjudged_rows(fits: Sequence[Fit], words: Words) -> Iterator[tuple[str, ...]]:
    for place, (fit, estimate) in enumerate(_key_quantities(fits)):
        if place >= VALUES:
            return
        quantity = fit.result.quantity(estimate.name)
        value = show(estimate, quantity).with_uncertainty
        title = words.named(quantity.headed(estimate.name))
        yield (title, *map(words.numbers, (value, *coverage(estimate))), "–", "–", words.NOT_LISTED)


def _key_quantities(fits: Sequence[Fit]) -> Iterator[tuple[Fit, Estimate]]:
    """Key quantities: the first of every kind in turn, then the second, and so on."""
    queues = [
        [
            (fit, fit.result.estimates[name])
            for name in key_names(fit.result.quantities, fit.result.estimates)
            if fit.result.estimates[name].identifiable != "no"
        ]
        for fit in fits
        if fit.recording.metadata.gear_mounted
    ]
    for place in range(max(map(len, queues), default=0)):
        yield from (queue[place] for queue in queues if place < len(queue))
