"""One finding: what was looked at, how it came out, and what to do about it.

Whoever looks at something (the evidence of a recording, a rig before a run, a run file, a certificate) says it by this
one type, so that it is worded, written as JSON and shown in one way. A finding is no error: who refuses because of one
raises the error of its own floor.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import KW_ONLY, dataclass
from enum import StrEnum
from typing import TypeVar


class Severity(StrEnum):
    """How a finding came out, the gravest last: what may go on because of it."""

    PASSED = "passed"
    """It was looked at, and is as it must be."""
    NOT_LOOKED_AT = "not looked at"
    """It could not, or was not to, be looked at; `Finding.found` says why."""
    NOTES = "notes"
    """It is not, and was allowed for in the numbers: an uncertainty became wider."""
    WARNS = "warns"
    """It is worth knowing, and stops nobody."""
    BLOCKS = "blocks"
    """What was to be done with the thing is not done."""

    @property
    def mark(self) -> str:
        """The word that stands before a finding, in a terminal and in a window."""
        return _MARKS[self]


_MARKS = {
    Severity.PASSED: "ok",
    Severity.NOTES: "note",
    Severity.WARNS: "WARNING",
    Severity.BLOCKS: "FAILED",
    Severity.NOT_LOOKED_AT: "not looked at",
}


@dataclass(frozen=True, slots=True)
class Finding:
    """What was looked at (`what`) and how it came out; `found` and `allowed` are values with their units, in words.

    `remedy` is what to do, "" where nothing is. `where` is the part of the rig or the file that was looked at. `value`
    [`unit`] is the number behind `found`, where there is one. `follows` says in a sentence what a reader of the numbers
    has to know of it. `is_evidence`: a verdict needs that it was looked at.
    """

    what: str
    severity: Severity
    found: str = ""
    remedy: str = ""
    _: KW_ONLY
    where: str = ""
    allowed: str = ""
    value: float | None = None
    unit: str = ""
    follows: str = ""
    is_evidence: bool = True

    @property
    def outcome(self) -> str:
        """How it came out: what was found, and what follows of it."""
        follows = self.follows.removesuffix(".")
        # What begins small goes on from what was found: a reason behind a value.
        between = ": " if follows[:1].islower() else ". "
        return between.join(part for part in (self.found, follows) if part)

    @property
    def sentence(self) -> str:
        """The finding in words: what, what was found, and what to do where something is to be done."""
        remedy = "" if self.severity is Severity.PASSED else self.remedy
        text = ". ".join(part for part in (self.outcome, remedy) if part)
        return ": ".join(part for part in (self.what, text) if part)

    def as_json(self) -> dict[str, str | float | None]:
        """The form that every `--json` gives a finding."""
        return {
            "what": self.what,
            "severity": self.severity.value,
            "where": self.where,
            "found": self.found,
            "allowed": self.allowed,
            "remedy": self.remedy,
            "value": self.value,
            "unit": self.unit,
            "follows": self.follows,
        }


def passed_if(
    what: str,
    is_fine: bool,
    found: str,
    remedy: str = "",
    *,
    where: str = "",
    allowed: str = "",
    value: float | None = None,
    unit: str = "",
    otherwise: Severity = Severity.BLOCKS,
) -> Finding:
    """A finding that passed or not: the remedy stays only where it is needed."""
    severity = otherwise
    if is_fine:
        severity, remedy = Severity.PASSED, ""
    return Finding(
        what,
        severity,
        found,
        remedy,
        where=where,
        allowed=allowed,
        value=value,
        unit=unit,
    )


_AnyFinding = TypeVar("_AnyFinding", bound=Finding)


def first_blocking(findings: Iterable[_AnyFinding]) -> _AnyFinding | None:
    """The first finding that blocks; None where none does."""
    return next((one for one in findings if one.severity is Severity.BLOCKS), None)
