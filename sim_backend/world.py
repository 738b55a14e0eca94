"""Which simulated world a run is made in: gear, bench, how the one was mounted on the other, the day, the run.

    gear        its parameters, its kinematic error, its own output orders and sidebands, how it wears
    bench       both encoders and their index marks, torque port, motor, output bearing, skew, thermometer, clock
    mounting    the gear's phase on output flange and motor shaft, a small eccentricity
    day         ambient temperature, zero of the torque port
    number      start angle, noise, and the small change of friction from run to run

Each of the five draws from a seed of its own, so that a gear keeps its numbers on another bench, a
bench its encoders under another gear, and both theirs from run to run. What is drawn of a seed has a
version: a run that was made by older draws is made by them again.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from typing import Any, Literal, get_args

from drivers.errors import DriverError

Population = Literal["narrow", "wide"]
"""Gears and benches like the nominal one, or as different as the analysis has to bear."""
LARGEST = 2**63 - 1
"""The largest seed or number: what a run file's integers hold."""
VERSION = 3
"""Of the draws. 1 is that of program version 0.2.0, whose runs name none: output encoders of orders 1 and 2 (narrow) or
1 to 8 (wide), rotor and clock exact, no output orders of a wide gear, days without memory, and a gear that was turned
on its flange from wherever its mounting had put it. In 1 and 2 the hysteresis element is stepped by its slope, and
damps a swing in which it slides by 5 % more than its law."""
OLDEST = 1
LONGEST_WEAR = 4000.0
"""h; rates of wear are straight lines, and further on one of them would leave nothing."""
LARGEST_CORRELATION = 0.95


@dataclass(frozen=True, kw_only=True)
class World:
    """Which simulated world a run is made in. Raises `DriverError` for a value that names none.

    `mount` is how often the gear was taken off and refitted. `mount_turn` [rad] is how far it then stands turned on
    the output flange from where the first mounting had it; None: nobody knows, a mounting draws it. `hours` is how
    long the gear has run. `day_correlation` is that of a day with the next; None: that of the population. `number`
    owns the noise, `version` is that of the draws. Everything else of the run (protocol, rate, temperature at its
    start) is not drawn.
    """

    gear_seed: int
    bench_seed: int
    mount: int = 1
    mount_turn: float | None = None
    day: int = 1
    number: int = 1
    population: Population = "narrow"
    hours: float = 0.0
    day_correlation: float | None = None
    version: int = VERSION

    def __post_init__(self) -> None:
        for name, (least, most, unit) in _RANGES.items():
            value = getattr(self, name)
            if value is not None and not least <= value <= most:
                kind = "whole number" if isinstance(least, int) else "number"
                raise DriverError(
                    "names no simulated world",
                    where=name,
                    value=value,
                    limit=f"{least} to {most}{unit}",
                    remedy=f"Give a {kind} within these.",
                )
        if self.mount_turn is not None and not math.isfinite(self.mount_turn):
            raise DriverError(
                "is no angle", where="mount_turn", value=self.mount_turn, remedy="Give a number."
            )
        if self.population not in get_args(Population):
            raise DriverError(
                "no such population",
                where="population",
                value=self.population,
                limit=", ".join(get_args(Population)),
                remedy="Choose one of these.",
            )

    @classmethod
    def of(cls, seed: int, **others: Any) -> World:
        """The world of one seed, gear and bench alike: for what needs no more than one."""
        return cls(gear_seed=seed, bench_seed=seed, **others)

    @property
    def mounting_seed(self) -> int:
        """The seed of this gear, mounted so often on this bench."""
        return self.seed_of_mounting(self.mount)

    def seed_of_mounting(self, mount: int) -> int:
        """The seed of one mounting of this gear on this bench."""
        return mixed("mounting", self.gear_seed, self.bench_seed, mount)

    def seed_of_day(self, day: int) -> int:
        """The seed of one day at this bench."""
        return mixed("day", self.bench_seed, day)

    @property
    def run_seed(self) -> int:
        """The seed of this run: another number is another noise, and so is another gear, bench, mounting or day."""
        return mixed("run", self.gear_seed, self.bench_seed, self.mount, self.day, self.number)


@dataclass(frozen=True, kw_only=True)
class ThermalState:
    """How warm a rig is [degC]: the housing with its grease, and the motor."""

    housing: float
    motor: float


_RANGES: dict[str, tuple[float, float, str]] = {
    "gear_seed": (0, LARGEST, ""),
    "bench_seed": (0, LARGEST, ""),
    "mount": (1, LARGEST, ""),
    "day": (1, LARGEST, ""),
    "number": (1, LARGEST, ""),
    "hours": (0.0, LONGEST_WEAR, " h"),
    "day_correlation": (0.0, LARGEST_CORRELATION, ""),
    "version": (OLDEST, VERSION, ""),
}


def mixed(name: str, *numbers: int) -> int:
    """One seed of 64 bits out of a name and numbers, the same on every computer."""
    text = " ".join((name, *map(str, numbers)))
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=8).digest(), "little")


FIRST_WORLD = World.of(0)
"""The world of whoever names none."""
