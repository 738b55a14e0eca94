"""Units and channel names of recordings from other rigs, and what one stored number of a column means in SI.

A channel map says for each channel: which column, its unit, and a scale whose meaning follows from the unit:

    count on an angle                counts per revolution (negative: counts against the sense of rotation)
    count on anything else           SI units per count
    A or V on a torque or a force    N m (or N) per A or V: the torque constant, the port's scale
    every other unit                 a plain factor (-1 turns the sign round)
"""

from __future__ import annotations

import difflib
import math
from dataclasses import dataclass

from drivers.channel import Channel
from model.units import ARCMIN, ARCSEC, DEGREE, REVOLUTION, RPM
from rig.errors import ConfigurationError
from rig.runfile.layout import Column

TIME_CHANNEL = "time"
COUNT = "count"

UNITS: dict[str, tuple[str, float]] = {
    "rad": ("rad", 1.0), "mrad": ("rad", 1e-3), "deg": ("rad", DEGREE), "arcmin": ("rad", ARCMIN),
    "arcsec": ("rad", ARCSEC), "rev": ("rad", REVOLUTION),
    "m": ("m", 1.0), "mm": ("m", 1e-3), "um": ("m", 1e-6),
    "s": ("s", 1.0), "ms": ("s", 1e-3), "us": ("s", 1e-6), "ns": ("s", 1e-9), "min": ("s", 60.0), "h": ("s", 3600.0),
    "rad/s": ("rad/s", 1.0), "deg/s": ("rad/s", DEGREE), "rev/s": ("rad/s", REVOLUTION), "r/min": ("rad/s", RPM),
    "m/s": ("m/s", 1.0), "mm/s": ("m/s", 1e-3),
    "rad/s2": ("rad/s2", 1.0), "m/s2": ("m/s2", 1.0),
    "N m": ("N m", 1.0), "mN m": ("N m", 1e-3), "N mm": ("N m", 1e-3), "N cm": ("N m", 1e-2),
    "N": ("N", 1.0), "kN": ("N", 1e3), "mN": ("N", 1e-3),
    "A": ("A", 1.0), "mA": ("A", 1e-3), "V": ("V", 1.0), "mV": ("V", 1e-3), "W": ("W", 1.0), "Hz": ("Hz", 1.0),
    "degC": ("degC", 1.0), "K": ("degC", 1.0), "%": ("1", 1e-2), "1": ("1", 1.0),
}  # fmt: skip
"""Units that a column may have: the SI unit that it becomes and the factor to it."""

_SPELLINGS = {
    "°": "deg",
    "degree": "deg",
    "degrees": "deg",
    "'": "arcmin",
    '"': "arcsec",
    "turn": "rev",
    "turns": "rev",
    "r": "rev",
    "revolution": "rev",
    "revolutions": "rev",
    "rpm": "r/min",
    "1/min": "r/min",
    "rev/min": "r/min",
    "nm": "N m",
    "n*m": "N m",
    "n.m": "N m",
    "n·m": "N m",
    "n-m": "N m",
    "mnm": "mN m",
    "nmm": "N mm",
    "ncm": "N cm",
    "µm": "um",
    "μm": "um",
    "µs": "us",
    "μs": "us",
    "sec": "s",
    "seconds": "s",
    "second": "s",
    "°c": "degC",
    "celsius": "degC",
    "counts": COUNT,
    "cnt": COUNT,
    "inc": COUNT,
    "increments": COUNT,
    "amp": "A",
    "volt": "V",
    "-": "1",
    "": "1",
    "rad/s^2": "rad/s2",
    "m/s^2": "m/s2",
}

DIMENSIONS: dict[str, tuple[str, ...]] = {
    TIME_CHANNEL: ("s",),
    "input_angle": ("rad",),
    "output_angle": ("rad",),
    "input_index": ("rad",),
    "output_index": ("rad",),
    "torque": ("N m",),
    "drive_torque": ("N m",),
    "target_torque": ("N m",),
    "target_speed": ("rad/s",),
    "housing_temperature": ("degC",),
    "ambient_temperature": ("degC",),
    "statusword": ("1",),
    "index_seen": ("1",),
    "position": ("m", "rad"),
    "force": ("N",),
    "current": ("A",),
    "voltage": ("V",),
}
"""What the channels with a standard name measure; every other name may have any unit."""


@dataclass(frozen=True, kw_only=True)
class ChannelSource:
    """One channel of a foreign recording: its name here, its column there, and what the column's numbers mean.

    `unit` "" leaves it to the column's heading, or else to SI. `scale` as in the table above; `offset` is added in SI;
    `modulus` is the range after which the column wraps, in the column's own numbers (0: it does not wrap).
    """

    name: str
    column: str
    unit: str = ""
    scale: float | None = None
    offset: float = 0.0
    modulus: float = 0.0
    long_name: str = ""

    def __post_init__(self) -> None:
        for key in ("scale", "offset", "modulus"):
            value = getattr(self, key)
            if value is not None and (
                not math.isfinite(value) or (key == "scale" and value == 0.0)
            ):
                limit = "a finite number that is not 0" if key == "scale" else "a finite number"
                raise ConfigurationError(
                    "is not usable", where=f"{self.name}.{key}", value=value, limit=limit
                )
        if self.modulus < 0.0:
            raise ConfigurationError(
                "is negative", where=f"{self.name}.modulus", value=self.modulus, limit=">= 0"
            )


def parse_channel(text: str) -> ChannelSource:
    """A channel from `name=column[:unit[:scale]]`."""
    form = "name=column[:unit[:scale]], for example input_angle=Position:deg"
    name, equals, rest = text.partition("=")
    parts = rest.split(":")
    if not equals or not name.strip() or not parts[0].strip() or len(parts) > 3:
        raise ConfigurationError(
            "is not a channel", where="--channel", value=repr(text), limit=form
        )
    scale = None
    if len(parts) == 3 and parts[2].strip():
        try:
            scale = float(parts[2])
        except ValueError:
            raise ConfigurationError(
                "the scale is not a number",
                where=f"--channel {name.strip()}",
                value=repr(parts[2]),
                limit=form,
            ) from None
    unit = parts[1].strip() if len(parts) > 1 else ""
    return ChannelSource(name=name.strip(), column=parts[0].strip(), unit=unit, scale=scale)


def unit_of(text: str, where: str) -> str:
    """The unit in the spelling of this program; a unit that is not known is refused with those that are."""
    stripped = text.strip()
    for candidate in (stripped, _SPELLINGS.get(stripped.lower(), "")):
        if candidate in UNITS or candidate == COUNT:
            return candidate
    near = difflib.get_close_matches(stripped, [*UNITS, COUNT], n=1)
    raise ConfigurationError(
        "has a unit that is not known",
        where=where,
        value=repr(text),
        limit=", ".join([*UNITS, COUNT]),
        remedy=f'Did you mean "{near[0]}"?'
        if near
        else "Convert the column, or give SI and a scale.",
    )


def column_of(
    source: ChannelSource, heading_unit: str = "", torque_constant: float | None = None
) -> Column:
    """How a channel is stored: the column's own numbers, with scale and offset to SI. Counts become int64."""
    allowed = DIMENSIONS.get(source.name)
    unit = unit_of(source.unit or heading_unit or (allowed[0] if allowed else ""), source.name)
    if unit == COUNT:
        return _counts_column(source, allowed)
    si_unit, factor = UNITS[unit]
    if allowed and si_unit not in allowed:
        if si_unit not in ("A", "V") or allowed[0] not in ("N m", "N"):
            raise ConfigurationError(
                "has a unit of another dimension",
                where=source.name,
                value=unit,
                limit=", ".join([*(u for u, (si, _) in UNITS.items() if si in allowed), COUNT]),
                remedy="Correct the unit, or give the channel another name.",
            )
        scale = (
            source.scale
            if source.scale is not None
            else torque_constant
            if si_unit == "A"
            else None
        )
        if scale is None:
            raise ConfigurationError(
                f"a {source.name} in {unit} needs its scale in {allowed[0]} per {si_unit}",
                where=source.name,
                remedy=f"Write {source.name}={source.column}:{unit}:<{allowed[0]} per {si_unit}>, or name the channel "
                f"{'current' if si_unit == 'A' else 'voltage'}.",
            )
        return _column(source, allowed[0], gain=factor * scale, offset=source.offset)
    scale = factor * (1.0 if source.scale is None else source.scale)
    offset = source.offset - (273.15 if unit == "K" else 0.0)
    return _column(source, si_unit, gain=scale, offset=offset)


def _counts_column(source: ChannelSource, allowed: tuple[str, ...] | None) -> Column:
    unit = allowed[0] if allowed else "1"
    if source.scale is None and unit != "1":
        what = "counts per revolution" if unit == "rad" else f"{unit} per count"
        raise ConfigurationError(
            f"counts need their scale in {what}",
            where=source.name,
            remedy=f"Write {source.name}={source.column}:count:<{what}>.",
        )
    given = 1.0 if source.scale is None else source.scale
    scale = REVOLUTION / given if unit == "rad" else given
    if source.modulus != int(source.modulus):
        raise ConfigurationError(
            "is not a whole number", where=f"{source.name}.modulus", value=source.modulus
        )
    return _column(source, unit, gain=scale, offset=source.offset, counts=True)


def _column(
    source: ChannelSource, unit: str, *, gain: float, offset: float, counts: bool = False
) -> Column:
    channel = Channel(
        name=source.name,
        unit=unit,
        scale=abs(gain),
        direction=int(math.copysign(1.0, gain)),
        offset=offset,
        is_counted=counts,
        modulus=int(source.modulus) if counts else 0,
        long_name=source.long_name,
    )
    return Column(channel, "int64" if counts else "float64")
