"""The part of a rig's description that its commissioning rests on: devices, channels, limits, guard."""

from __future__ import annotations

from typing import Any

from rig.bench.commissioning import hash_of
from rig.bench.config.schema import RigConfiguration

_TABLES = (
    "bus",
    "drive",
    "motor_encoder",
    "counters",
    "analog_modules",
    "sources",
    "guard",
    "limits",
    "ratings",
)
"""What a stage shows to be right. Who tests for whom, where runs go, who is told and when alarms are raised
is not among it."""
_NOT_SHOWN = frozenset({"calibration", "model", "title"})
"""Words in these tables that a stage says nothing of: a certificate that is renewed changes no wire."""


def description_hash(configuration: RigConfiguration) -> str:
    """The hash over the tables that a commissioning rests on, with the SYNC rate and the motor."""
    tables: dict[str, Any] = {
        name: _readable(_dumped(getattr(configuration, name))) for name in _TABLES
    }
    about = {"sample_rate": configuration.rig.sample_rate_hz, "motor": configuration.rig.motor}
    return hash_of({**tables, **about})


def _dumped(table: Any) -> Any:
    if isinstance(table, tuple):
        return [_dumped(one) for one in table]
    return None if table is None else table.model_dump(mode="json")


def _readable(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _readable(one) for key, one in value.items() if key not in _NOT_SHOWN}
    return [_readable(one) for one in value] if isinstance(value, list) else value
