"""What one check found of a recording."""

from __future__ import annotations

from dataclasses import dataclass

from experiments.result import CheckOutcome


@dataclass(frozen=True)
class Finding:
    """Outcome of one check; `found` and `allowed` are values with their units, `words` say what follows."""

    outcome: CheckOutcome
    found: str = ""
    allowed: str = ""
    words: str = ""


def not_checked(words: str) -> Finding:
    """The recording lacks what the check needs, or the run has nothing that it applies to."""
    return Finding("not checked", words=words)


def refused_beyond(is_beyond: bool, found: str, allowed: str, words: str) -> Finding:
    """Refused in these words where the value is beyond what is allowed, else ok."""
    return Finding("refused", found, allowed, words) if is_beyond else Finding("ok", found, allowed)
