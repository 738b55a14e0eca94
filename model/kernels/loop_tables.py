"""Compiled look-up in what `model.loop_tables` makes: the wedge's error, the cogging torque and the friction; and how
a hysteresis element slides.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import njit

from model.arrays import FloatArray

_Kernel = TypeVar("_Kernel", bound=Callable[..., Any])
_HOW: dict[str, Any] = {
    "cache": True,
    "nogil": True,
    "error_model": "numpy",
    "fastmath": {"contract"},
}
"""How the closed loop and what it calls are compiled."""
_PART: dict[str, Any] = {"forceinline": True, "_nrt": False}
"""Beside it, how a part of a step is."""


def compiled(function: _Kernel) -> _Kernel:
    """A function of the closed loop."""
    return cast("_Kernel", njit(**_HOW)(function))


def inlined(function: _Kernel) -> _Kernel:
    """A part of a step: it becomes part of the loop that calls it. It allocates nothing: if numba counted who holds the
    arrays that it takes, as it does elsewhere, a step would take four times as long.
    """
    return cast("_Kernel", njit(**_HOW | _PART)(function))


@compiled
def error_at(table: FloatArray, turns: float, points: float, angle: float) -> tuple[float, float]:
    """e and de/dtheta of the wedge at an input angle, from cubic pieces (points + 1, 4) of one period (1/turns rad)."""
    place = angle * turns
    place = (place - math.floor(place)) * points
    index = int(place)
    f = place - index
    c1, c2, c3 = table[index, 1], table[index, 2], table[index, 3]
    return table[index, 0] + f * (c1 + f * (c2 + f * c3)), (c1 + f * (2.0 * c2 + 3.0 * f * c3)) * (
        turns * points
    )


@compiled
def cogging_at(table: FloatArray, points: float, angle: float) -> float:
    """Cogging torque at an input angle, linear between (points + 2,) values of one revolution."""
    place = angle * (0.5 / math.pi)
    place = (place - math.floor(place)) * points
    index = int(place)
    return table[index] + (place - index) * (table[index + 1] - table[index])


@compiled
def slid(x: float) -> float:
    """What is left of how far a Dahl element is from its limit, moved by x of the travel in which it slides: exp(-x) of
    its first terms, less than 1e-3 off up to 0.4, and never beyond the limit.
    """
    return 1.0 / (1.0 + x * (1.0 + x * (0.5 + x * (1.0 / 6.0))))


@compiled
def _between(table: FloatArray, index: int, column: int, f: float) -> float:
    """A column of a table at the share `f` between two of its rows."""
    return table[index, column] + f * (table[index + 1, column] - table[index, column])


@compiled
def friction_at(
    table: FloatArray, scale: float, last: int, speed: float
) -> tuple[float, float, float, float]:
    """Mesh dry, mesh viscous, bearing above its low-speed value [N m], wind-up [rad] at a speed >= 0, over its root."""
    place = math.sqrt(speed) * scale
    index = min(int(place), last)
    f = place - index
    return (
        _between(table, index, 0, f),
        _between(table, index, 1, f),
        _between(table, index, 2, f),
        _between(table, index, 3, f),
    )
