"""Values that somebody reads off a nameplate or a catalogue and types: a path, a number and its unit."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterable, Mapping
from typing import Any

from model import quantities
from model.errors import ParameterError, path_of
from model.sections import Section, allowed_range
from model.unit_text import read, understood
from rig.content.phrase import phrase

_NUMBER = re.compile(r"\s*([-+]?[0-9]*\.?[0-9]+(?:[eE][-+]?[0-9]+)?)\s*(.*?)\s*")


def declared(sections: Mapping[str, type[Section]]) -> dict[str, Mapping[str, Any]]:
    """What is declared of every number, by its path "section.name"."""
    return {
        path_of(section, f.name): f.metadata
        for section, kind in sections.items()
        for f in dataclasses.fields(kind)  # type: ignore[arg-type]
        if "unit" in f.metadata
    }


def read_stated(texts: Iterable[str], known: Mapping[str, Mapping[str, Any]]) -> dict[str, float]:
    """The values [SI] of texts such as "ratings.rated_torque=137 N m", by path.

    Raises `ParameterError` naming the path, what was typed, and what is allowed.
    """
    values: dict[str, float] = {}
    for text in texts:
        path, sign, value = (part.strip() for part in text.partition("="))
        if not sign:
            raise ParameterError(
                "states nothing",
                where="--set",
                value=repr(text),
                limit='PATH="VALUE UNIT", such as ratings.rated_torque="137 N m"',
            )
        quantities.check_keys([path], known, "")
        if path in values:
            raise ParameterError("is stated twice", where=path, value=repr(value), limit="once")
        values[path] = value_of(path, value, known[path])
    return values


def value_of(path: str, text: str, meta: Mapping[str, Any]) -> float:
    """A typed number with its unit, in SI. A quantity that has a unit needs one: 5600 could be r/min or rad/s."""
    match = _NUMBER.fullmatch(text)
    unit = meta["unit"]
    if match is None or not (match[2] or unit == "1"):
        raise ParameterError(
            "is no number with its unit",
            where=path,
            value=repr(text),
            limit=f"{allowed_range(meta)}, in {', '.join(_units_for(unit))}",
            remedy=f'Write {path}="VALUE {unit}".',
        )
    return quantities.to_si(float(match[1]), match[2], unit, path)


def remark_of(path: str, text: str, meta: Mapping[str, Any]) -> str:
    """What should be known of how a typed unit was read, a pound taken for a force; "" for nothing."""
    match = _NUMBER.fullmatch(text)
    if match is None or not match[2]:
        return ""
    return phrase("{1}: {0}", read(match[2], (meta["unit"],)).remark, path)


def _units_for(si_unit: str) -> tuple[str, ...]:
    """The units in which a quantity of this SI unit can be typed."""
    return understood((si_unit,))
