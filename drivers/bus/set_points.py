"""Set-points in the drive's counts, and the bytes of the RPDOs that carry them: a whole block at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from drivers import channel as names
from drivers.bus.pdo import MappedPdo
from drivers.channel import Channel
from drivers.errors import DriverError
from drivers.port import Command, Mode

Key = tuple[int, int]
"""Index and sub-index of an object."""
_LONGEST_BLOCK: Final = 10_000_000
_TARGETS: Final = {Mode.SPEED: names.TARGET_SPEED, Mode.TORQUE: names.TARGET_TORQUE}
"""Channel of the set-point."""


def set_point_counts(
    command: Command, cycles: int, channels: Sequence[Channel], largest: Mapping[str, int]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Speed and torque set-points (cycles,) in counts of their channels, as the drive will receive them; where none is
    commanded, those of standstill.

    Raises `DriverError` when there is not one finite set-point per cycle, or one is beyond the `largest` count of its
    channel: none is clipped.
    """
    if not 1 <= cycles <= _LONGEST_BLOCK:
        raise DriverError(
            "a block needs at least one cycle",
            where="exchange",
            value=cycles,
            limit=f"1 to {_LONGEST_BLOCK}",
        )
    by_name = {channel.name: channel for channel in channels}
    rest = {
        mode: np.full(cycles, _rest(by_name.get(name)), dtype=np.int64)
        for mode, name in _TARGETS.items()
    }
    if command.mode in _TARGETS:
        name = _TARGETS[command.mode]
        channel = by_name.get(name)
        if channel is None:
            raise DriverError(
                f"this drive takes no set-points for {command.mode.value}",
                where=name,
                remedy="See the list of missing objects; a unit may have to be given in the rig's configuration.",
            )
        rest[command.mode] = _counts(command, cycles, channel, largest[name])
    return rest[Mode.SPEED], rest[Mode.TORQUE]


def _rest(channel: Channel | None) -> int:
    """The count of standstill; 0 where there is no such set-point."""
    return 0 if channel is None else round(-channel.offset / (channel.direction * channel.scale))


def _counts(command: Command, cycles: int, channel: Channel, largest: int) -> NDArray[np.int64]:
    """The set-points (cycles,) of a command in counts."""
    target = np.asarray(command.target, dtype=np.float64)
    if target.shape != (cycles,) or not np.isfinite(target).all():
        raise DriverError(
            "there must be one finite set-point for every cycle",
            where="exchange",
            value=target.shape,
            limit=f"({cycles},)",
        )
    counts = np.rint((target - channel.offset) / (channel.direction * channel.scale))
    if np.abs(counts).max() > largest:
        worst = float(target[np.argmax(np.abs(counts))])
        raise DriverError(
            "a set-point does not fit the drive's object",
            where=channel.name,
            value=f"{worst:g} {channel.unit}",
            limit=f"+-{largest * channel.scale:g} {channel.unit}",
        )
    return counts.astype(np.int64)


def packed_frames(
    pdos: Sequence[MappedPdo], values: Mapping[Key, NDArray[np.int64]], cycles: int
) -> list[list[bytes]]:
    """The bytes of every RPDO (outer) for every cycle (inner) of values (cycles,) by the key of their object."""
    return [_pack(pdo, values, cycles) for pdo in pdos]


def _pack(pdo: MappedPdo, values: Mapping[Key, NDArray[np.int64]], rows: int) -> list[bytes]:
    """One RPDO's bytes for every cycle: little-endian fields side by side; entries without a value are 0."""
    table = np.zeros((rows, pdo.length), dtype=np.uint8)
    offset = 0
    for entry in pdo.entries:
        size = entry.data_type.size
        if entry.key in values:
            data = values[entry.key].astype("<i8").view(np.uint8).reshape(rows, 8)
            table[:, offset : offset + size] = data[:, :size]
        offset += size
    packed = table.tobytes()
    return [packed[i * pdo.length : (i + 1) * pdo.length] for i in range(rows)]
