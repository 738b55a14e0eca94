"""A gear of one's own: its parameter set made from its part number, its card beside it, and cards that hold what can
be loaded."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from model.catalogue.proportions import gear_of_product, open_questions
from model.catalogue.table import Product, read_product
from model.errors import ParameterError
from model.gear import HarmonicDrive, Origin
from model.gear_file import save_gear, shipped_gear
from rig.errors import ConfigurationError
from rig.gears.acceptance import acceptance_named
from rig.gears.card import GearCard, card_for, gear_of, save_card, with_changes
from rig.gears.card_places import card_file, cards_folder
from rig.gears.facts import stated_facts

_SETS = "sets"
"""Folder of the parameter sets that were made for cards, in the folder of the cards."""


@dataclass(frozen=True)
class NewGear:
    """A gear that was made: its card, its parameter set and the file of it, and what nobody has looked at yet."""

    card: GearCard
    gear: HarmonicDrive
    path: Path

    @property
    def open_questions(self) -> tuple[str, ...]:
        """Nameplate values that are only assumed."""
        return open_questions(self.gear)


def set_path(folder: str | Path, serial: str) -> Path:
    """The file of the parameter set that is made for a gear."""
    return cards_folder(folder) / _SETS / card_file(serial)


def made_gear(
    product: str | Product, stated: Mapping[str, float], by: str, at: str
) -> HarmonicDrive:
    """The parameter set of a part number, with what `by` read from the nameplate [SI]. Raises `ParameterError`."""
    known = read_product(product) if isinstance(product, str) else product
    origin = Origin("catalogue", f"nameplate or maker's papers, read by {by.strip()}, {at}")
    return gear_of_product(known, {path: (value, origin) for path, value in stated.items()})


def write_new_gear(
    folder: str | Path, gear: HarmonicDrive, values: Mapping[str, str], by: str, at: str
) -> NewGear:
    """Write a parameter set and the card that names it; `values` are the card's facts, the serial number among them.

    Raises `ConfigurationError` where there is one already, `PlanError` for a fact that is refused.
    """
    serial = values.get("serial", "").strip()
    before = card_for(folder, serial) if serial else None
    if before is not None and stated_facts(before.facts).get("part"):
        raise ConfigurationError(
            "has a card that names its part already",
            where=f"gear {serial}",
            value=before.facts.part,
            remedy="Change that file, or name another part with `rig gear set`.",
        )
    path = set_path(folder, serial)
    card = with_changes(before, {**values, "part": str(path.resolve())}, by, at)
    if path.exists():
        raise ConfigurationError(
            "is there already and may hold what somebody typed",
            where=str(path),
            remedy="Name it with `rig gear set --part`, or take it away.",
        )
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigurationError(
            f"cannot be made: {error.strerror or error}",
            where=str(path.parent),
            remedy="Name a folder that can be written.",
        ) from error
    save_gear(gear, path)
    write_card(folder, card)
    return NewGear(card, gear, path)


def write_card(folder: str | Path, card: GearCard) -> Path:
    """Write a card whose part and acceptance file can be loaded; every command and form writes cards so.

    Raises `ConfigurationError` that names the fact, the file, and what is wrong with it.
    """
    facts = card.facts
    try:
        if facts.part:
            gear_of(facts, shipped_gear())
    except ParameterError as error:
        raise _refusal("part", facts.part, error) from error
    try:
        if facts.acceptance:
            acceptance_named(facts.acceptance)
    except ConfigurationError as error:
        raise _refusal("acceptance", facts.acceptance, error) from error
    return save_card(folder, card)


def _refusal(
    fact: str, named: str, error: ParameterError | ConfigurationError
) -> ConfigurationError:
    return ConfigurationError(
        f"cannot be loaded ({error.where}: {error.what})",
        where=f"gear.{fact}",
        value=error.value if error.value is not None else named,
        limit=error.limit,
        remedy=error.remedy or "Correct the file, or name another.",
    )
