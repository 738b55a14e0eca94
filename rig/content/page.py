"""A report as plain words: its head, its verdict, its sections and annexes. Page and paper paint it."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace

from rig.content.grid import Grid, Tone


@dataclass(frozen=True, kw_only=True)
class Figure:
    """A drawing (SVG, made by this program alone) with its number and caption; two of half the width share a row."""

    number: int
    svg: str
    title: str
    after: str = ""
    note: str = ""
    half: bool = False


@dataclass(frozen=True, kw_only=True)
class Section:
    """What stands under one heading, in this order; `annex` are long tables, which stand behind everything else."""

    title: str
    anchor: str
    subtitle: str = ""
    text: str = ""
    warnings: tuple[str, ...] = ()
    figures: tuple[Figure, ...] = ()
    grids: tuple[Grid, ...] = ()
    terms: tuple[tuple[str, str], ...] = ()
    items: tuple[str, ...] = ()
    note: str = ""
    annex: tuple[Grid, ...] = ()


@dataclass(frozen=True)
class State:
    """A verdict in a word, its meaning in a sentence, and how it is to be taken."""

    word: str
    sentence: str
    tone: Tone = "muted"


@dataclass(frozen=True)
class Signature:
    """Whether there is room for signatures, and why not."""

    allowed: bool
    reason: str = ""


@dataclass(frozen=True, kw_only=True)
class Page:
    """A report: everything that stands on it, in order."""

    kind: str = "Test report"
    number: str
    heading: str
    created: str
    version: str
    subtitle: str = ""
    note: str = ""
    facts: tuple[tuple[str, str], ...] = ()
    marks: tuple[tuple[str, str], ...] = ()
    """Words that tell what is no measurement, each with its sentence; they stand across every page."""
    states: tuple[State, ...] = ()
    alarms: tuple[str, ...] = ()
    judged: tuple[Grid, ...] = ()
    """Limits and catalogue, under the verdict."""
    warnings: tuple[tuple[str, str, str], ...] = ()
    """Title and anchor of a section, and what there is to beware of in it."""
    summary: tuple[Grid, ...] = ()
    sections: tuple[Section, ...] = ()
    annexes: tuple[Section, ...] = ()
    signature: Signature
    run_line: str = ""
    """The runs that it is of, for the foot of every page."""
    made_from: str = "run files whose SHA-256 stands under Provenance"

    def only(self, wanted: Collection[str]) -> Page:
        """The report with these sections alone, by their words (`word_of`), with all where none is named; its head and
        its verdict always stay.
        """
        if not wanted:
            return self
        return replace(
            self,
            sections=tuple(one for one in self.sections if word_of(one) in wanted),
            annexes=tuple(one for one in self.annexes if word_of(one) in wanted),
        )

    @property
    def words(self) -> str:
        """The words that tell what is no measurement."""
        return ", ".join(word for word, _ in self.marks)


SECTIONS = (
    "results",
    "numbers",
    "truth",
    "conditions",
    "calibrations",
    "provenance",
    "definitions",
    "scope",
    "parameters",
    "data",
)
"""The sections of a report by the words in which they are asked for, in the order in which they stand."""


def word_of(section: Section) -> str:
    """By which word a section is asked for: every analysed run is one of the results."""
    return "results" if section.anchor.startswith("part-") else section.anchor


def annexes_of(
    sections: Iterable[Section], title: str, grids: Iterable[Grid]
) -> tuple[Section, ...]:
    """The annexes of a report: one of its own, and the long tables of its sections; empty ones are left out."""
    annexes = (
        Section(title=f"Annex: {title}", anchor="parameters", grids=tuple(grids)),
        Section(
            title="Annex: tables of data",
            anchor="data",
            grids=tuple(grid for section in sections for grid in section.annex),
        ),
    )
    return tuple(annex for annex in annexes if annex.grids)
