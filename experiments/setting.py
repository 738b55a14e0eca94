"""What an analysis lets its user choose (`rig fit KIND RUN --set NAME=VALUE`): declared beside it, shown by help."""

from __future__ import annotations

import datetime
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from experiments.errors import SettingError


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _is_above_zero(value: object) -> bool:
    return isinstance(value, int | float) and _is_number(value) and value > 0.0


def _is_whole(value: object) -> bool:
    return isinstance(value, int | float) and _is_number(value) and value >= 0.0 == value % 1.0


def _is_day(value: object) -> bool:
    try:
        datetime.date.fromisoformat(str(value))
    except ValueError:
        return False
    return True


_TAKES: Mapping[str, Callable[[object], bool]] = {
    "number": _is_number,
    "number above zero": _is_above_zero,
    "share": _is_above_zero,
    "whole number": _is_whole,
    "true, false": lambda value: isinstance(value, bool),
    "day": _is_day,
}
"""What a setting may take, and how a value shows that it is that."""
_READ_ELSEWHERE = ("channel", "value,U", "text", ":")
"""Words in what a setting takes where the analysis itself says what it can't be."""


@dataclass(frozen=True)
class Setting:
    """One setting: its name, what it takes, the value without it, its unit, and when somebody would use it."""

    name: str
    takes: str
    default: str
    unit: str = ""
    when: str = ""

    def is_taken(self, value: object) -> bool:
        """Whether it can have this value; None is none at all."""
        if value is None:
            return True
        if self.takes in _TAKES:
            return _TAKES[self.takes](value)
        if any(word in self.takes for word in _READ_ELSEWHERE):
            return True
        return str(value) in self.takes.split(", ")

    @property
    def in_words(self) -> str:
        """When, what it takes, and the value without it: one line of a help."""
        takes = " ".join((self.takes, self.unit)).strip()
        without = f"; without it: {self.default}" if self.default else ""
        return f"{self.when} ({takes}{without})"


def names_of(settings: Iterable[Setting]) -> tuple[str, ...]:
    """Their names, for `check_settings`."""
    return tuple(setting.name for setting in settings)


def check_values(values: Mapping[str, Any], settings: Iterable[Setting], kind: str) -> None:
    """Raise `SettingError` for a value that its setting can't have."""
    for setting in settings:
        value = values.get(setting.name)
        if not setting.is_taken(value):
            is_word = setting.takes not in _TAKES
            raise SettingError(
                f"no such {setting.name}" if is_word else "it can't have this value",
                where=f"{kind}.{setting.name}",
                value=str(value),
                limit=" ".join((setting.takes, setting.unit)).strip(),
                remedy=f"Without it: {setting.default}." if setting.default else "",
            )


EVERY_KIND = (
    Setting(
        "tare_age_limit",
        "number above zero",
        "7",
        "days",
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
