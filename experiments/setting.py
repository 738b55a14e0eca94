"""What an analysis lets its user choose (`rig fit KIND RUN --set NAME=VALUE`): declared beside it, shown by help."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Setting:
    """One setting: its name, what it takes, the value without it, its unit, and when somebody would use it."""

    name: str
    takes: str
    default: str
    unit: str = ""
    when: str = ""

    @property
    def in_words(self) -> str:
        """When, what it takes, and the value without it: one line of a help."""
        takes = " ".join((self.takes, self.unit)).strip()
        without = f"; without it: {self.default}" if self.default else ""
        return f"{self.when} ({takes}{without})"


def names_of(settings: Iterable[Setting]) -> tuple[str, ...]:
    """Their names, for `check_settings`."""
    return tuple(setting.name for setting in settings)


EVERY_KIND = (
    Setting(
        "tare_age_limit",
        "days",
        "7",
        "",
        "a tare is older than that, and nothing of the bench was changed since",
    ),
)
"""Of every kind of fit: they belong to the checks that every recording passes."""
OUTPUT_BEARING = (
    Setting(
        "output_bearing",
        "value,U",
        "assumed",
        "N m",
        "the dry friction of the bench's output bearing was measured, and stands on no card",
    ),
    Setting(
        "output_bearing_viscous",
        "value,U",
        "assumed",
        "N m s/rad",
        "the same of its viscous friction",
    ),
    Setting("output_bearing_date", "day", "", "", "to keep when the bearing was measured"),
    Setting("output_bearing_source", "text", "", "", "to keep who measured the bearing, and how"),
)
"""Of the bench's output bearing, for whoever has no card of the bench."""
DRY_PER_KELVIN = Setting(
    "dry_per_kelvin",
    "value,U",
    "assumed",
    "1/K",
    "runs at two temperatures told this gear's coefficient of dry friction",
)
PER_KELVIN_SOURCE = Setting(
    "per_kelvin_source", "text", "", "", "to keep where the coefficients are from"
)
