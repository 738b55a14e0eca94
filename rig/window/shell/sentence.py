"""Sentences that the window says in more than one place."""

from __future__ import annotations

from collections.abc import Sequence


def first_of(reasons: Sequence[str]) -> str:
    """The first of some reasons, and how many more there are; nothing of none."""
    if len(reasons) < 2:
        return "".join(reasons)
    return f"{reasons[0]} (and {len(reasons) - 1} more)"


def listed_of(shown: int, every: int, what: str) -> str:
    """How many of all are listed."""
    return f"{every} {what}" if shown == every else f"{shown} of {every} {what}"


def cut_short(text: str, longest: int) -> str:
    """A text in so many letters at most; no space stands where it ends."""
    return text if len(text) <= longest else f"{text[: longest - 1].rstrip()}…"


def give_or_take(uncertainty: float | None) -> str:
    """An uncertainty as it follows its value; nothing where none is known."""
    return "" if uncertainty is None else f" ± {uncertainty:g}"
