"""Channels that no column holds and that follow from others: the angle by a stated speed, the output by its error.

The angle of a log at constant speed is that speed times the time; it serves the orders alone, and is called
`nominal_angle`. A column that holds the difference theta_o - theta_i/N is `transmission_error`: with the input angle
and a stated ratio the output angle is its sum with theta_i/N.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drivers.channel import Channel
from experiments.need import ANGLES, NOMINAL_ANGLE
from rig.errors import ConfigurationError
from rig.runfile.importing.channel_map import ImportOptions
from rig.runfile.importing.stated import stated_speed
from rig.runfile.importing.units import TRANSMISSION_ERROR
from rig.runfile.layout import Column

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Derived:
    """One channel that is made: how it is stored, from what (in words), and its numbers in SI.

    `values` takes the other channels in SI by name (n,) and the seconds since the first row (n,).
    """

    column: Column
    origin: str
    values: Callable[[Mapping[str, FloatArray], FloatArray], FloatArray]


def derived_channels(options: ImportOptions, columns: Sequence[Column]) -> tuple[Derived, ...]:
    """What follows from these channels and from what was said. Raises `ConfigurationError` where that contradicts."""
    by_name = {column.name: column for column in columns}
    found: list[Derived] = []
    speed = stated_speed(options)
    if speed is not None:
        found.append(_nominal_angle(speed, options, by_name))
    if TRANSMISSION_ERROR in by_name and "output_angle" not in by_name:
        found.append(_output_angle(options, by_name))
    return tuple(found)


def _nominal_angle(speed: float, options: ImportOptions, by_name: Mapping[str, Column]) -> Derived:
    there = next((name for name in ANGLES if name in by_name), "")
    if there or options.no_time:
        found, remedy = "no time", "Give the time: --channel time=COLUMN:s, or --rate."
        if there:
            found, remedy = there, "Leave --speed away."
        raise ConfigurationError(
            "the speed stands for an angle that was not recorded",
            where="--speed",
            value=f"there is {found}",
            remedy=remedy,
        )
    channel = Channel(
        name=NOMINAL_ANGLE,
        unit="rad",
        scale=1.0,
        is_counted=False,
        long_name="angle of the input by its stated speed",
    )
    origin = f"the stated speed of {speed:.6g} rad/s times the time"
    return Derived(Column(channel, "float64"), origin, lambda _, seconds: speed * seconds)


def _output_angle(options: ImportOptions, by_name: Mapping[str, Column]) -> Derived:
    ratio = options.known_ratio
    if "input_angle" not in by_name or not math.isfinite(ratio):
        raise ConfigurationError(
            "the transmission error is output - input/ratio: with it are needed the input angle and the ratio",
            where=TRANSMISSION_ERROR,
            value="no input_angle" if "input_angle" not in by_name else "no ratio",
            remedy="Add -c input_angle=COLUMN:UNIT and --ratio; or give the column a name of your own.",
        )
    error = by_name[TRANSMISSION_ERROR].channel
    channel = replace(
        error,
        name="output_angle",
        long_name="output angle: transmission error and input over ratio",
        scale=1.0,
        direction=1,
        offset=0.0,
        is_counted=False,
        modulus=0,
    )
    return Derived(
        Column(channel, "float64"),
        f"{TRANSMISSION_ERROR} + input_angle/{ratio:g}",
        lambda si, _: si[TRANSMISSION_ERROR] + si["input_angle"] / ratio,
    )
