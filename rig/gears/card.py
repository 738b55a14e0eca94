"""Gear cards: what is known of one mounted gear, remembered between days, confirmed by name, never guessed.

One TOML file per gear, `<folder of runs>/.gears/<serial>.toml`. It holds the facts (`rig.gears.facts`) and the history
of who changed and who confirmed what, and when.

A gear whose runs lie in folders of folders (year, month) has one card: in a folder without a card of this serial number
the one of the nearest folder above counts, and what is changed is changed there.

A confirmation keeps what was confirmed (`rig.gears.card_history`), and holds until something of `CONFIRMED_FIELDS`
changes, by a command or an editor: what decides about limits, directions and results.
"""

from __future__ import annotations

import dataclasses
import os
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.errors import PlanError
from experiments.parameters import parameter_fields
from rig.content.phrase import phrase, quoted
from rig.content.wording import named
from rig.errors import ConfigurationError, RigError, misstated
from rig.gears.card_history import (
    CardEvent,
    confirmation_of,
    event_of,
    latest_confirmed,
    value_text,
)
from rig.gears.card_places import above, card_path, cards_folder, from_cards
from rig.gears.facts import GearFacts, make_facts, stated_facts

if TYPE_CHECKING:
    from model.gear import HarmonicDrive

FORMAT = "gear-card-1"
"""The value of `format` in the files that this program reads and writes."""
UNNAMED = ("", "unknown")
"""Serial numbers of runs that name no gear, such as those of a bare motor."""
LARGEST_FILE = 5_000_000
"""Bytes; a card with a long history is some hundred kilobytes."""

_REQUIRED = ("part", "mounting")
"""Without these a card cannot be confirmed: limits and directions rest on them."""
EXPECTED = ("lubricant", "hours", "load_inertia_kg_m2", "load_inertia_uncertainty_kg_m2")
"""A confirmed card without these is worth a warning: results are told with them."""
_NOT_CONFIRMED = frozenset({"hours", "hours_counted", "acceptance"})
CONFIRMED_FIELDS = tuple(
    f.name for f in dataclasses.fields(GearFacts) if f.name not in _NOT_CONFIRMED
)
"""Fields whose change asks for a new confirmation; hours grow by themselves, and what a gear must show changes
nothing about how it turns."""


@dataclass(frozen=True)
class GearCard:
    """The card of one gear: its facts, and who changed and confirmed them."""

    facts: GearFacts
    history: tuple[CardEvent, ...] = ()

    @property
    def serial(self) -> str:
        """Serial number of the gear."""
        return self.facts.serial

    @property
    def part_name(self) -> str:
        """The name in its parameter set; what the card says where that is no file, or cannot be read."""
        from model.errors import ParameterError
        from model.gear_file import load_gear

        try:
            return load_gear(self.facts.part).name
        except ParameterError:
            return self.facts.part

    @property
    def confirmation(self) -> CardEvent | None:
        """The latest confirmation, None when there was none."""
        return next((event for event in reversed(self.history) if event.what == "confirmed"), None)

    @property
    def last_change(self) -> CardEvent | None:
        """The latest change of something that asks for a confirmation."""
        return next((event for event in reversed(self.history) if _asks(event)), None)

    @property
    def is_confirmed(self) -> bool:
        """Whether the latest confirmation is younger than the latest change that asks for one, and is of what
        the card says.
        """
        last = next(
            (
                event
                for event in reversed(self.history)
                if event.what == "confirmed" or _asks(event)
            ),
            None,
        )
        return last is not None and last.what == "confirmed" and not self.edited

    @property
    def edited(self) -> str:
        """What the card says besides what its latest confirmation is of, in words; "" where it says the same.

        Every change by a command stands in the history: this one was made by hand.
        """
        if self.confirmation is None:
            return ""
        before = latest_confirmed(self.history)
        if before is None:
            return "what was confirmed"
        changes = self.history[self.history.index(self.confirmation) :]
        since = {name for event in changes if event.what == "changed" for name in event.values}
        now, before = _kept(stated_facts(self.facts)), _kept(before)
        return ", ".join(
            f"{named(name)[0]} {now.get(name, 'unknown')}, confirmed was {before.get(name, 'unknown')}"
            for name in CONFIRMED_FIELDS
            if name not in since and _differ(now.get(name), before.get(name))
        )

    @property
    def warning(self) -> str:
        """Why the card should not be relied on; "" for a confirmed one."""
        if self.is_confirmed:
            return ""
        change, before = self.last_change, self.confirmation
        if before is None:
            return f"the card of gear {self.serial} has never been confirmed"
        if self.edited:
            return (
                f"the card of gear {self.serial} was edited by hand ({self.edited}) "
                f"after its last confirmation ({before.by}, {before.at})"
            )
        changed = ""
        if change is not None:
            names = ", ".join(name for name in change.values if name in CONFIRMED_FIELDS)
            changed = f" ({names} by {change.by}, {change.at})"
        return f"the card of gear {self.serial} was changed{changed} after its last confirmation ({before.at})"

    def as_json(self) -> dict[str, Any]:
        """The card as `rig gear show --json` prints it."""
        return {
            "serial": self.serial,
            "facts": stated_facts(dataclasses.replace(self.facts, part=self.part_name)),
            "confirmed": self.is_confirmed,
            "warning": self.warning,
            "history": [
                {
                    "at": e.at,
                    "by": e.by,
                    "what": e.what,
                    "values": dict(e.values),
                    "sha256": e.sha256,
                }
                for e in self.history
            ],
        }


def _kept(values: Mapping[str, Any]) -> dict[str, Any]:
    """Facts as a card and its history keep them."""
    return {n: from_cards(str(value)) if n == "part" else value for n, value in values.items()}


def _differ(one: Any, other: Any) -> bool:
    """Whether two values of a fact are not the same; empty text and None are what nobody told."""
    untold = ("", None)
    return one != other and not (one in untold and other in untold)


def _asks(event: CardEvent) -> bool:
    return event.what == "changed" and any(name in CONFIRMED_FIELDS for name in event.values)


def now_text() -> str:
    """The present moment, ISO 8601 with zone, to the second."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def with_changes(card: GearCard | None, values: Mapping[str, Any], by: str, at: str) -> GearCard:
    """The card with new values (text or numbers; empty text forgets a fact) and who changed what in its history.

    `values` need the serial number where there is no card yet. Nothing changed: the card as it was. Raises `PlanError`,
    `ConfigurationError` without a name.
    """
    _named(by, "change")
    before: dict[str, Any] = {}
    history: tuple[CardEvent, ...] = ()
    if card is not None:
        before, history = stated_facts(card.facts), card.history
    facts = make_facts({**before, **values})
    if card is not None and facts.serial != card.serial:
        raise ConfigurationError(
            "a serial number does not change: it is another gear",
            where="gear.serial",
            value=facts.serial,
            limit=card.serial,
        )
    after = stated_facts(facts)
    changed = {
        name: after.get(name, "")
        for name in (*before, *after)
        if before.get(name) != after.get(name)
    }
    if not changed and card is not None:
        return card
    return GearCard(facts, (*history, CardEvent(at, by.strip(), "changed", _kept(changed))))


def with_confirmation(card: GearCard, by: str, at: str) -> GearCard:
    """The card confirmed by name. Raises `ConfigurationError` without a name, or while something that limits rest on is
    unknown."""
    _named(by, "confirm")
    missing = [name for name in _REQUIRED if name not in stated_facts(card.facts)]
    if missing:
        raise ConfigurationError(
            "the card cannot be confirmed while this is unknown",
            where=f"gear {card.serial}",
            value=", ".join(missing),
            remedy="Look at the gear and its papers, then fill it in.",
        )
    facts = _kept(stated_facts(card.facts))
    values = {name: facts[name] for name in CONFIRMED_FIELDS if name in facts}
    return GearCard(card.facts, (*card.history, confirmation_of(by.strip(), at, values)))


def _named(by: str, what: str) -> None:
    if not by.strip():
        raise ConfigurationError(
            f"nobody is named who would {what} the gear card",
            where="--by",
            remedy="Give your name.",
        )


def gear_of(facts: GearFacts, otherwise: HarmonicDrive) -> HarmonicDrive:
    """The parameter set of a card's gear with the load inertia that it tells, and that inertia's uncertainty.

    `otherwise` is taken where the card names no part. Raises `ParameterError` for a set that cannot be read.
    """
    from model.errors import ParameterError
    from model.gear import Origin
    from model.gear_file import load_gear, shipped_gear

    gear = otherwise
    if facts.part:
        if facts.part.lower().endswith(".toml"):
            if not os.path.exists(facts.part):
                raise ParameterError(
                    "the parameter set that the card names is not there",
                    where=facts.part,
                    remedy=f"Name its place: rig gear set {quoted(facts.serial)} --by NAME --part FILE",
                )
            gear = load_gear(facts.part)
        else:
            gear = shipped_gear(facts.part)
    if facts.load_inertia_kg_m2 is None:
        return gear
    origin = Origin(
        "measured", f"gear card of {facts.serial}", facts.load_inertia_uncertainty_kg_m2
    )
    return gear.with_values({"inertia.output": facts.load_inertia_kg_m2}, origin)


def conditions_of(card: GearCard) -> dict[str, Any]:
    """What a run file keeps of a card among its conditions (/entry/sample): every fact that stands
    nowhere else there (but not what the gear must show: no verdict depends on a sealed file), the
    confirmation, and the warning where the card was not confirmed."""
    conditions = {
        name: value
        for name, value in stated_facts(card.facts).items()
        if name not in ("serial", "part", "mounting", "acceptance")
    }
    confirmation = card.confirmation
    if card.is_confirmed and confirmation is not None:
        conditions["gear_card_confirmed"] = f"{confirmation.by}, {confirmation.at}"
        if confirmation.sha256:
            conditions["gear_card_sha256"] = confirmation.sha256
    else:
        conditions["gear_card_warning"] = card.warning
    return conditions


def card_for(folder: str | Path, serial: str) -> GearCard | None:
    """The card of a gear, None when there is none. Raises `ConfigurationError` for one that cannot be read."""
    path = card_path(folder, serial)
    if not serial.strip() or not path.exists():
        return None
    card = load_card(path)
    if card.serial != serial.strip():
        # File systems that do not tell capitals from small letters find another gear's file.
        raise ConfigurationError(
            "is the card of another gear",
            where=str(path),
            value=card.serial,
            limit=serial.strip(),
            remedy="Serial numbers are compared letter for letter.",
        )
    return card


@dataclass(frozen=True)
class ListedCard:
    """One line of the list of cards: the card, or why its file cannot be read."""

    path: Path
    card: GearCard | None
    problem: str = ""


def list_cards(folder: str | Path) -> tuple[ListedCard, ...]:
    """The cards that count in a folder of runs, by serial number; unreadable ones with their reason."""
    nearest: dict[str, Path] = {}
    for place in (folder, *above(folder)):
        for path in cards_folder(place).glob("*.toml"):
            nearest.setdefault(path.name, path)
    cards = []
    for _, path in sorted(nearest.items()):
        try:
            cards.append(ListedCard(path, load_card(path)))
        except RigError as error:
            cards.append(ListedCard(path, None, str(error)))
    return tuple(cards)


def load_card(path: Path) -> GearCard:
    """The card of a file. Raises `ConfigurationError` with the file, the path of the value and what
    is wrong with it.
    """
    where = str(path)
    try:
        if path.stat().st_size > LARGEST_FILE:
            raise ConfigurationError(
                "is too large for a gear card", where=where, limit=f"{LARGEST_FILE} bytes"
            )
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigurationError(
            f"cannot be read: {error.strerror or error}", where=where
        ) from error
    except (ValueError, RecursionError) as error:
        raise ConfigurationError(
            f"is not valid TOML: {error}", where=where, remedy="Correct the line, or restore it."
        ) from error
    if content.get("format") != FORMAT:
        raise ConfigurationError(
            "is no gear card",
            where=where,
            value=repr(content.get("format")),
            limit=f'format "{FORMAT}"',
        )
    facts, events = content.get("facts", {}), content.get("history", [])
    if not isinstance(facts, dict) or not isinstance(events, list):
        raise ConfigurationError("has no table [facts] or no list [[history]]", where=where)
    part = os.path.join(path.parent.resolve(), str(facts.get("part", "")))
    if os.path.isfile(part):
        facts["part"] = part
    try:
        return GearCard(
            make_facts(facts), tuple(event_of(entry, i, where) for i, entry in enumerate(events))
        )
    except PlanError as error:
        raise misstated(error, f"{where}: {error.where}") from error
    except TypeError as error:
        raise ConfigurationError("has no serial number", where=f"{where}: facts.serial") from error


def save_card(folder: str | Path, card: GearCard) -> Path:
    """Write a card: whole or not at all. Raises `ConfigurationError` where that is not possible."""
    path = card_path(folder, card.serial)
    _refuse_same_letters(path)
    fresh = path.with_name(f"{path.name}.{os.getpid()}.new")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with fresh.open("w", encoding="utf-8", newline="\n") as out:
            out.write(card_text(dataclasses.replace(card, facts=_beside(card.facts, path.parent))))
            out.flush()
            os.fsync(out.fileno())
        fresh.replace(path)
    except OSError as error:
        fresh.unlink(missing_ok=True)
        raise ConfigurationError(
            f"the gear card cannot be written: {error.strerror or error}",
            where=str(path),
            remedy="Name a folder that can be written.",
        ) from error
    return path


def _beside(facts: GearFacts, cards: Path) -> GearFacts:
    """Facts whose parameter set is named by its path from the cards, where it lies with them."""
    kept = from_cards(facts.part)
    is_here = (cards / kept).resolve() == Path(facts.part).resolve()
    return dataclasses.replace(facts, part=kept) if is_here else facts


def _refuse_same_letters(path: Path) -> None:
    """Refuse a serial that differs from another's in capitals alone: on Windows and macOS their cards are one file."""
    if not path.parent.is_dir():
        return
    for other in path.parent.iterdir():
        if other.name != path.name and other.name.casefold() == path.name.casefold():
            raise ConfigurationError(
                "another gear has a card whose serial number differs in capitals alone",
                where=str(other),
                value=path.name.removesuffix(".toml"),
                limit="serial numbers that differ in more: on some systems both cards are one file",
                remedy="Write the serial as on that card, if it is the same gear.",
            )


def card_text(card: GearCard) -> str:
    """A card as TOML that a person can read; it reads back to the same card."""
    from model.quantities import quote

    lines = [
        f"# What is known of gear {card.serial!r}. Unknown facts are left away.",
        f"format = {quote(FORMAT)}",
        "",
        "[facts]",
    ]
    fields = {f.name: f for f in parameter_fields(GearFacts)}
    for name, value in stated_facts(card.facts).items():
        unit = phrase("  # {}", fields[name].unit)
        lines.append(f"{name} = {value_text(value)}{unit}")
    for event in card.history:
        lines += [
            "",
            "[[history]]",
            f"at = {quote(event.at)}",
            f"by = {quote(event.by)}",
            f"what = {quote(event.what)}",
        ]
        if event.values:
            inside = ", ".join(
                f"{name} = {value_text(value)}" for name, value in event.values.items()
            )
            lines.append(f"values = {{ {inside} }}")
        if event.sha256:
            lines.append(f"sha256 = {quote(event.sha256)}")
    return "\n".join(lines) + "\n"
