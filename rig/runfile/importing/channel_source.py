"""One channel of a foreign recording, and how it is stored: the column's own numbers with scale and offset to SI.

A channel map says for each channel: which column, its unit, and a scale whose meaning follows from the unit:

    count on an angle                counts per revolution (negative: counts against the sense of rotation)
    count on anything else           SI units per count
    A or V on a torque or a force    N m (or N) per A or V: the torque constant, the port's scale
    every other unit                 a plain factor (-1 turns the sign round)
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from drivers.channel import Calibration, Channel
from model.unit_text import Unit
from model.units import COUNT, REVOLUTION
from rig.content.phrase import phrase
from rig.errors import ConfigurationError
from rig.runfile.importing.units import (
    TEXT_TIMES,
    TIME_CHANNEL,
    UNCERTAINTY,
    dimensions_of,
    unit_of,
    units_of,
)
from rig.runfile.layout import Column


@dataclass(frozen=True, kw_only=True)
class ChannelSource:
    """One channel of a foreign recording: its name here, its column there, and what the column's numbers mean.

    `unit` "" leaves it to the column's heading; where that says nothing either, it is asked for.
    `scale` as in the table above; `offset` is added in SI; `modulus` is the range after which the
    column wraps, in the column's own numbers (0: it does not wrap). `file` is the one of several
    that holds the column, `time` its column of time where it is not that of the other channels.
    `side` "output" or "input" says on which side of the gear the column was taken, where that is
    not the side of the channel: it is brought there by the ratio.

    What is known of the channel, as the run file states it: `accuracy` in its SI unit (an
    encoder's whole curve; `accuracy_unit` is the SI unit in which it was said, "" for that one),
    `scale_uncertainty` relative and `offset_uncertainty` in SI (standard uncertainties), `lag_s` by
    how much it is late, the `sensor` that it comes from, `certificate`, `date` and `due`. None is not said.
    """

    name: str
    column: str
    unit: str = ""
    scale: float | None = None
    offset: float = 0.0
    modulus: float = 0.0
    long_name: str = ""
    file: str = ""
    time: str = ""
    side: str = ""
    accuracy: float | None = None
    accuracy_unit: str = ""
    scale_uncertainty: float | None = None
    offset_uncertainty: float | None = None
    lag_s: float | None = None
    sensor: str = ""
    certificate: str = ""
    date: str = ""
    due: str = ""

    def __post_init__(self) -> None:
        for key in ("scale", "offset", "modulus", *_NOT_NEGATIVE, "lag_s"):
            value = getattr(self, key)
            if value is not None and (
                not math.isfinite(value) or (key == "scale" and value == 0.0)
            ):
                limit = "a finite number that is not 0" if key == "scale" else "a finite number"
                raise ConfigurationError(
                    "is not usable", where=f"{self.name}.{key}", value=value, limit=limit
                )
        for key in ("modulus", *_NOT_NEGATIVE):
            value = getattr(self, key)
            if value is not None and value < 0.0:
                raise ConfigurationError(
                    "is negative",
                    where=f"{self.name}.{key}",
                    value=value,
                    limit=">= 0",
                )
        if self.side not in ("", "input", "output"):
            raise ConfigurationError(
                "is no side of the gear",
                where=f"{self.name}.side",
                value=repr(self.side),
                limit="input, output",
            )

    @property
    def option(self) -> str:
        """The channel as the command line takes it, up to its unit."""
        return f"{self.name}={self.column}{phrase('@{}', self.file)}"

    @property
    def factor(self) -> float:
        """Its scale; 1 where nobody said one."""
        return 1.0 if self.scale is None else self.scale


_NOT_NEGATIVE = ("accuracy", "scale_uncertainty", "offset_uncertainty")


def parse_channel(text: str) -> ChannelSource:
    """A channel from `name=column[@file][:unit[:scale]]`."""
    form = "name=column[@file][:unit[:scale]], for example input_angle=Position:deg"
    name, equals, rest = text.partition("=")
    parts = rest.split(":")
    if not equals or not name.strip() or not parts[0].strip() or len(parts) > 3:
        raise ConfigurationError(
            "is not a channel", where="--channel", value=repr(text), limit=form
        )
    place, unit, factor = (*parts, "", "")[:3]
    scale = None
    if factor.strip():
        try:
            scale = float(factor)
        except ValueError:
            raise ConfigurationError(
                "the scale is not a number",
                where=f"--channel {name.strip()}",
                value=repr(factor),
                limit=form,
            ) from None
    column, at, file = place.strip().rpartition("@")
    if not at or not column:
        column, file = place.strip(), ""
    return ChannelSource(
        name=name.strip(), column=column, unit=unit.strip(), scale=scale, file=file
    )


def column_of(
    source: ChannelSource,
    heading_unit: str = "",
    torque_constant: float | None = None,
    ratio: float = math.nan,
) -> Column:
    """How a channel is stored: the column's own numbers, with scale and offset to SI. Counts become int64.

    Raises `ConfigurationError` where neither the map nor the heading says the unit: it is never guessed.
    """
    allowed = dimensions_of(source.name)
    unit = source_unit(source, heading_unit, allowed)
    if unit.symbol in TEXT_TIMES:
        raise ConfigurationError(
            "is a unit of times only",
            where=source.name,
            value=unit.symbol,
            limit=units_of(*(allowed or ())),
        )
    across = _across(source, allowed, ratio)
    if unit.symbol == COUNT:
        return _counts_column(source, allowed, across)
    if allowed and unit.si not in allowed:
        if unit.si not in ("A", "V") or allowed[0] not in ("N m", "N"):
            raise ConfigurationError(
                "has a unit of another dimension",
                where=source.name,
                value=unit.symbol,
                limit=units_of(*allowed),
                remedy="Correct the unit, or give the channel another name.",
            )
        return _driven_column(source, allowed[0], unit.si, unit.scale * across, torque_constant)
    scale = unit.scale * source.factor * across
    return _column(source, unit.si, gain=scale, offset=source.offset + unit.zero)


def source_unit(
    source: ChannelSource, heading_unit: str, allowed: tuple[str, ...] | None = None
) -> Unit:
    """The unit of the map, else of the heading; what can only be a plain number needs none.

    Raises `ConfigurationError` with the line to add where nobody says it.
    """
    if source.unit or heading_unit:
        return unit_of(source.unit or heading_unit, source.name, allowed or ())
    if allowed == ("1",):
        return unit_of("1", source.name)
    (example, *_) = allowed or ("UNIT",)
    texts = f", {', '.join(TEXT_TIMES)}" if source.name == TIME_CHANNEL else ""
    plain = "" if allowed else '; "1" for a plain number'
    raise ConfigurationError(
        "nobody says its unit",
        where=f"{source.name}, column {source.column}",
        limit=units_of(*(allowed or ())) + texts + plain,
        remedy=f'Add it: --channel "{source.option}:{example}" if it is {example}, or in the map '
        f'[channels.{source.name}] unit = "{example}".',
    )


def _across(source: ChannelSource, allowed: tuple[str, ...] | None, ratio: float) -> float:
    """The factor that brings a column to the side of the gear that its channel is of.

    The input turns ratio times as far and fast, with the ratio'th part of the torque (losses left aside).
    """
    if not source.side:
        return 1.0
    own = "output" if source.name.startswith("output_") else "input"
    if source.side == own:
        return 1.0
    if not allowed or (allowed[0] not in ("rad", "rad/s", "N m") and "rad" not in allowed):
        raise ConfigurationError(
            "has no counterpart on the other side of the gear",
            where=f"{source.name}.side",
            value=source.side,
            limit="angles, speeds and torques",
        )
    if not math.isfinite(ratio):
        raise ConfigurationError(
            f"was taken at the {source.side}, and the ratio is not known",
            where=source.name,
            remedy="Give --ratio.",
        )
    to_input = 1.0 / ratio if allowed[0] in ("N m", "N") else ratio
    return to_input if own == "input" else 1.0 / to_input


_DRIVEN_BY = {"A": "current", "V": "voltage"}
"""What drives a torque or a force, by its SI unit."""


def _driven_column(
    source: ChannelSource, unit: str, si_unit: str, factor: float, torque_constant: float | None
) -> Column:
    """A torque or a force that was recorded as the current or the voltage that drives it."""
    scale = source.scale
    if scale is None and si_unit == "A":
        scale = torque_constant
    if scale is None:
        raise ConfigurationError(
            f"a {source.name} in {si_unit} needs its scale in {unit} per {si_unit}",
            where=source.name,
            remedy=f"Write {source.option}:{si_unit}:<{unit} per {si_unit}>, or name the channel "
            f"{_DRIVEN_BY[si_unit]}.",
        )
    return _column(source, unit, gain=factor * scale, offset=source.offset)


def _counts_column(source: ChannelSource, allowed: tuple[str, ...] | None, across: float) -> Column:
    if allowed and len(allowed) > 1:
        raise ConfigurationError(
            f"counts of a {source.name} may be {' or '.join(allowed)}",
            where=source.name,
            remedy=f"Name the channel input_angle or output_angle, with counts per revolution, or write "
            f"{source.option}:{allowed[0]}:<{allowed[0]} per count>.",
        )
    (unit, *_) = allowed or ("1",)
    if source.scale is None and unit != "1":
        what = "counts per revolution" if unit == "rad" else f"{unit} per count"
        raise ConfigurationError(
            f"counts need their scale in {what}",
            where=source.name,
            remedy=f"Write {source.option}:count:<{what}>.",
        )
    scale = (REVOLUTION / source.factor if unit == "rad" else source.factor) * across
    if source.modulus != int(source.modulus):
        raise ConfigurationError(
            "is not a whole number", where=f"{source.name}.modulus", value=source.modulus
        )
    return _column(source, unit, gain=scale, offset=source.offset, counts=True)


def _column(
    source: ChannelSource, unit: str, *, gain: float, offset: float, counts: bool = False
) -> Column:
    if source.name.endswith(UNCERTAINTY):
        # An uncertainty has no sign and no zero.
        gain, offset = abs(gain), 0.0
    if source.accuracy_unit not in ("", unit):
        raise ConfigurationError(
            "has an accuracy in a unit of another dimension",
            where=source.name,
            value=source.accuracy_unit,
            limit=unit,
        )
    channel = Channel(
        name=source.name,
        unit=unit,
        scale=abs(gain),
        direction=int(math.copysign(1.0, gain)),
        offset=offset,
        is_counted=counts,
        modulus=int(source.modulus) if counts else 0,
        long_name=source.long_name,
        calibration=Calibration(
            certificate=source.certificate,
            date=source.date,
            due=source.due,
            sensor=source.sensor,
            scale_relative_uncertainty=source.scale_uncertainty,
            offset_uncertainty=source.offset_uncertainty,
            accuracy=source.accuracy,
        ),
    )
    return Column(channel, "int64" if counts else "float64")
