"""The file of a torque scale that a bench learnt: what its torque channels show per newton metre, and how late.

format = "harmonic-rig-torque-scale-1"
bench = "..."
date = 2026-03-01
housing_temperature = 24.1

[[channel]]
name = "torque"
gain = 0.9967
relative_uncertainty = 0.0019
"""

from __future__ import annotations

import datetime
import tomllib
from dataclasses import dataclass, field
from typing import Annotated, Any, Final, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from model.toml_text import toml_value

FORMAT: Final = "harmonic-rig-torque-scale-1"
_Number = Annotated[float, Field(allow_inf_nan=False)]
_Part = Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, str_strip_whitespace=True)


class ScaleLine(_Strict):
    """A contribution to the relative standard uncertainty of a gain."""

    source: str
    kind: Literal["A", "B"]
    relative_uncertainty: _Part
    degrees_of_freedom: Annotated[float, Field(gt=0.0, allow_inf_nan=False)] | None = None
    note: str = ""


class ChannelScale(_Strict):
    """What one channel shows per true torque (`gain`), its relative standard uncertainty, and its lag [s]."""

    name: Literal["torque", "drive_torque"]
    model: str = ""
    serial_number: str = ""
    sensor: str = ""
    gain: Annotated[float, Field(gt=0.2, lt=5.0, allow_inf_nan=False)]
    relative_uncertainty: _Part
    coverage_factor: Annotated[float, Field(ge=1.0, le=13.0, allow_inf_nan=False)] = 2.0
    lag: _Number | None = None
    lag_uncertainty: Annotated[float, Field(ge=0.0, allow_inf_nan=False)] | None = None
    line: tuple[ScaleLine, ...] = ()


class TorqueScale(_Strict):
    """The scales of a bench: of which bench and motor, from which runs, and at which temperature they hold."""

    format: Literal["harmonic-rig-torque-scale-1"]
    bench: str = Field(min_length=1)
    origin: str
    motor: str = ""
    certificate: str = Field(min_length=1)
    date: datetime.date
    due: datetime.date | None = None
    housing_temperature: _Number | None = None
    rotor_inertia: Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
    runs: tuple[str, ...]
    channel: Annotated[tuple[ChannelScale, ...], Field(min_length=1)]


@dataclass(frozen=True)
class TorqueScaleFile:
    """A torque scale as its file has it, with the bytes that were read."""

    path: str
    scale: TorqueScale
    content: bytes = field(default=b"", repr=False, compare=False)


def torque_scale_from(path: str, raw: bytes) -> TorqueScaleFile:
    """The scale of the bytes of a file. Raises `ValueError` that names file, key and value."""
    try:
        content = tomllib.loads(raw.decode())
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise ValueError(f"{path} cannot be read: {error}") from error
    try:
        return TorqueScaleFile(path, TorqueScale.model_validate(content), raw)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise ValueError(f"{path}, {where}: {first['msg']}") from error


def torque_scale_text(scale: TorqueScale) -> str:
    """The file of a scale."""
    values = scale.model_dump(exclude_none=True)
    channels = values.pop("channel")
    lines = _keys(values)
    for channel in channels:
        parts = channel.pop("line")
        lines += ["", "[[channel]]", *_keys(channel)]
        for part in parts:
            lines += ["", "[[channel.line]]", *_keys(part)]
    return "\n".join(lines) + "\n"


def _keys(values: dict[str, Any]) -> list[str]:
    return [
        f"{key} = {toml_value(value)}" for key, value in values.items() if value not in ("", ())
    ]
