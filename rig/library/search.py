"""Which runs a search finds: by words, by exact facts, and by the time they began."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import date, datetime
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rig.library.listed import IndexedRun

Day = str | date | None
"""A day or a time: ISO 8601 text, or a `date` or `datetime`."""
_SEARCHED = (
    "run_id",
    "protocol",
    "gear_serial",
    "gear",
    "operator",
    "outcome",
    "notes",
    "problem",
    "start",
)


def fits(run: IndexedRun, words: Sequence[str], exact: Mapping[str, str], outcome: str) -> bool:
    """Whether a run has these facts exactly, this outcome or state, and each of these words somewhere."""
    if any(
        value and getattr(run, name).casefold() != value.casefold() for name, value in exact.items()
    ):
        return False
    if outcome and outcome.casefold() not in (run.outcome.casefold(), run.state):
        return False
    text = " ".join(getattr(run, name) for name in _SEARCHED).casefold() if words else ""
    return all(word in text for word in words)


def bound_of(day: Day) -> str | datetime | None:
    """A day as text, a time as a time."""
    if day is None or day == "":
        return None
    if isinstance(day, str):
        moment = datetime.fromisoformat(day)
        return day if len(day) <= len("YYYY-MM-DD") else moment
    return day if isinstance(day, datetime) else day.isoformat()


def within(start: str, since: str | datetime | None, until: str | datetime | None) -> bool:
    """Whether a run began between two days or times, both included; one that does not say when is in no interval."""
    if since is None and until is None:
        return True
    try:
        began = datetime.fromisoformat(start)
    except ValueError:
        return False
    return (since is None or _order(since, began) <= 0) and (
        until is None or _order(until, began) >= 0
    )


def _order(bound: str | datetime, began: datetime) -> int:
    """-1, 0 or 1: the bound lies before, at or after the moment. A time without a zone is read in the moment's own."""
    if isinstance(bound, str):
        day = date.fromisoformat(bound)
        return (day > began.date()) - (day < began.date())
    if bound.tzinfo is None:
        bound = bound.replace(tzinfo=began.tzinfo)
    elif began.tzinfo is None:
        began = began.replace(tzinfo=bound.tzinfo)
    return (bound > began) - (bound < began)
