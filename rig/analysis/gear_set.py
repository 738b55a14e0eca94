"""Which parameter set an analysis leans on: given by hand, else that of the gear's card, else the run's own.

What runs of the same gear identified, and an analysis builds on (`Experiment.builds_on`), is
written into it: velocity steps are compared with the kinematic error that the gear showed.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from model.gear_file import gear_to_mapping
from rig.analysis.store import json_text

if TYPE_CHECKING:
    from model.gear import HarmonicDrive

SourceWord = Literal["by hand", "card", "run", "shipped"]


@dataclass(frozen=True)
class GearSource:
    """Where the parameter set of an analysis came from.

    `sha256` is of the set before anything identified was written into it; `builds_on` names the
    analysis that was (run, file, kind, number), empty where none was.
    """

    source: SourceWord = "run"
    serial: str = ""
    sha256: str = ""
    builds_on: Mapping[str, Any] = field(default_factory=dict)

    def as_json(self) -> dict[str, Any]:
        """As the analysis store keeps it."""
        return {
            "source": self.source,
            "serial": self.serial,
            "sha256": self.sha256,
            "builds_on": dict(self.builds_on),
        }

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> GearSource:
        """Out of what the analysis store keeps; what an analysis of an earlier version does not say is left open."""
        return cls(
            content.get("source", "run"),
            str(content.get("serial", "")),
            str(content.get("sha256", "")),
            dict(content.get("builds_on", {})),
        )


def set_sha256(gear: HarmonicDrive) -> str:
    """The SHA-256 of a parameter set, by which it is told from another one.

    Of its numbers with unit, standing and standard uncertainty, and of its options: what an analysis
    reads. Where a number is from is told in words, and other words make no other set.
    """
    return mapping_sha256(gear_to_mapping(gear))


def mapping_sha256(mapping: Mapping[str, Any]) -> str:
    """The SHA-256 of a parameter set as a mapping, without the words of its sources."""
    return _sha256(_without_sources(mapping))


def names_of_set(gear: HarmonicDrive | None) -> frozenset[str]:
    """Every hash by which a stored analysis may name this set: the one of today, and the earlier one of the whole set,
    the words of its sources included; none where there is no set.
    """
    if gear is None:
        return frozenset()
    whole = gear_to_mapping(gear)
    return frozenset((mapping_sha256(whole), _sha256(whole)))


def _without_sources(content: Any) -> Any:
    if isinstance(content, Mapping):
        return {k: _without_sources(v) for k, v in content.items() if k != "source"}
    if isinstance(content, list):
        return [_without_sources(one) for one in content]
    return content


def _sha256(mapping: Mapping[str, Any]) -> str:
    return hashlib.sha256(json_text(mapping).encode()).hexdigest()


def card_set(
    folder: Path, serial: str, own: Callable[[], HarmonicDrive | None]
) -> HarmonicDrive | None:
    """The parameter set of a gear as its card in this folder has it now; None where no card says anything of it.

    `own` is the set that the run carries, asked for where the card names no part and only adds its
    load inertia. Raises `ConfigurationError` for a card that cannot be read, `ParameterError` for a
    part that cannot.
    """
    from model.gear_file import shipped_gear
    from rig.gears.card import card_for, gear_of

    card = card_for(folder, serial)
    if card is None:
        return None
    if card.facts.part:
        return gear_of(card.facts, shipped_gear())
    if card.facts.load_inertia_kg_m2 is not None and (otherwise := own()) is not None:
        return gear_of(card.facts, otherwise)
    return None
