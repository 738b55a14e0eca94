"""What is stated of single channels beside their columns: range, lag, accuracy, each with the unit that was said."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace

from model.unit_text import understood
from model.units import COUNT
from rig.errors import ConfigurationError
from rig.runfile.importing.channel_map import ImportOptions
from rig.runfile.importing.channel_source import ChannelSource
from rig.runfile.importing.units import TEXT_TIMES, TIME_CHANNEL, unit_of

Said = Mapping[str, str | float]
"""By channel: a text such as `2ms`, or a number."""
_NUMBER_AND_UNIT = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*")


def with_stated(
    options: ImportOptions, *, modulus: Said, lag: Said, accuracy: Said
) -> ImportOptions:
    """The options with what was stated of channels.

    modulus: range after which a column wraps, a number of the column's own. lag: by how much a channel
    is late. accuracy: half-width of an encoder's whole error curve. A text of these two needs its unit;
    a number is in SI. Raises `ConfigurationError` for a channel that is not imported, and for a value
    without its unit.
    """
    names = [source.name for source in options.channels if source.name != TIME_CHANNEL]
    sources = list(options.channels)
    for flag, said in (("--modulus", modulus), ("--lag", lag), ("--accuracy", accuracy)):
        for name, value in said.items():
            if name not in names:
                raise ConfigurationError(
                    "is no channel of the import",
                    where=f"{flag} {name}",
                    limit=", ".join(names),
                )
            sources = [
                _with_value(one, flag, value) if one.name == name else one for one in sources
            ]
    return replace(options, channels=tuple(sources))


def stated_speed(options: ImportOptions) -> float | None:
    """The constant speed of the input [rad/s] that was said; None where nobody did. Raises `ConfigurationError`."""
    if options.speed in ("", None):
        return None
    speed, unit = _in_si("--speed", options.speed, "60 r/min")
    if unit not in ("", "rad/s") or not speed:
        raise ConfigurationError(
            "is no speed that turns",
            where="--speed",
            value=options.speed,
            limit=", ".join(understood(("rad/s",))),
        )
    return speed


def _with_value(source: ChannelSource, flag: str, value: str | float) -> ChannelSource:
    """The channel with one value stated."""
    if flag == "--modulus":
        return replace(source, modulus=_plain(f"{flag} {source.name}", value))
    if flag == "--lag":
        seconds, unit = _in_si(f"{flag} {source.name}", value, "2ms")
        if unit not in ("", "s"):
            raise ConfigurationError(
                "is no time",
                where=f"{flag} {source.name}",
                value=value,
                limit=", ".join(understood(("s",))),
            )
        return replace(source, lag_s=seconds)
    half_width, unit = _in_si(f"{flag} {source.name}", value, "5arcsec")
    return replace(source, accuracy=half_width, accuracy_unit=unit)


def _plain(where: str, value: str | float) -> float:
    try:
        return float(value)
    except ValueError:
        raise ConfigurationError(
            "is not a number", where=where, value=repr(value), limit="a number of the column's own"
        ) from None


def _in_si(where: str, value: str | float, example: str) -> tuple[float, str]:
    """A value in SI with its unit there; "" for a number, which is in SI already."""
    if not isinstance(value, str):
        return value, ""
    match = _NUMBER_AND_UNIT.fullmatch(value)
    if match is None:
        raise ConfigurationError(
            "is not a number with a unit", where=where, value=repr(value), limit=example
        )
    number, text = match.groups()
    if not text:
        raise ConfigurationError(
            "nobody says its unit",
            where=where,
            value=value,
            remedy=f"Write it behind the number, for instance {example}.",
        )
    unit = unit_of(text, where)
    if unit.symbol in (COUNT, *TEXT_TIMES):
        raise ConfigurationError(
            "is no unit of such a value", where=where, value=unit.symbol, limit=example
        )
    return float(number) * unit.scale, unit.si
