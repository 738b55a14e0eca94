"""The history of a gear card: who changed and who confirmed what, when, and of what the latest confirmation was.

A card is a file that people edit, so nothing seals it. A confirmation holds the values that were
confirmed and their SHA-256; a card that says anything else is not confirmed, whatever its history says.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from rig.errors import ConfigurationError

_EventKind = Literal["changed", "confirmed"]


@dataclass(frozen=True)
class CardEvent:
    """One line of a card's history: when (ISO 8601 with zone), by whom, what.

    `values` are the new values where some changed, and what was confirmed where it is a confirmation;
    `sha256` is that of the values confirmed, "" in a confirmation by version 0.2.0, which held none.
    """

    at: str
    by: str
    what: _EventKind
    values: Mapping[str, Any] = field(default_factory=dict)
    sha256: str = ""


def value_text(value: Any) -> str:
    """A value as it stands in a card: text in quotes, or a number."""
    from model.quantities import quote

    if isinstance(value, (int, float)):
        return repr(float(value))
    return quote(str(value))


def values_sha256(values: Mapping[str, Any]) -> str:
    """The SHA-256 of values as a card has them: a line each, `name = value`."""
    lines = "".join(f"{name} = {value_text(value)}\n" for name, value in values.items())
    return hashlib.sha256(lines.encode()).hexdigest()


def confirmation_of(by: str, at: str, values: Mapping[str, Any]) -> CardEvent:
    """The confirmation of these values."""
    return CardEvent(at, by, "confirmed", dict(values), values_sha256(values))


def latest_confirmed(history: Sequence[CardEvent]) -> Mapping[str, Any] | None:
    """The values of which the latest confirmation is; None without one, and for one whose hash is not theirs.

    Of one that holds no values those count that the changes before it made, one after the other.
    """
    places = [place for place, event in enumerate(history) if event.what == "confirmed"]
    if not places:
        return None
    last = history[places[-1]]
    if last.sha256:
        return last.values if values_sha256(last.values) == last.sha256 else None
    values: dict[str, Any] = {}
    for event in history[: places[-1]]:
        if event.what == "changed":
            values |= event.values
    return values


def event_of(entry: Any, index: int, where: str) -> CardEvent:
    """A line of a history as the file has it. Raises `ConfigurationError` with the place for one that is none."""
    fields = entry if isinstance(entry, dict) else {}
    at, by, what, values = (fields.get(name) for name in ("at", "by", "what", "values"))
    values, sha256 = {} if values is None else values, fields.get("sha256", "")
    texts = all(isinstance(text, str) for text in (at, by, sha256))
    if not (texts and isinstance(values, dict)):
        raise ConfigurationError(
            "is no line of a history",
            where=f"{where}: history[{index}]",
            limit="at, by, what, values",
        )
    if what not in ("changed", "confirmed"):
        raise ConfigurationError(
            "is none of the words there are",
            where=f"{where}: history[{index}].what",
            value=repr(what),
            limit="changed, confirmed",
        )
    return CardEvent(str(at), str(by), what, values, str(sha256))
