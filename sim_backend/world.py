"""Which simulated world a run is made in: gear, bench, how the one was mounted on the other, the day, the run.

    gear        its parameters, its kinematic error, its own output orders and sidebands
    bench       both encoders and their index marks, torque port, motor, output bearing, skew, thermometer
    mounting    the gear's phase on output flange and motor shaft, a small eccentricity
    day         ambient temperature, zero of the torque port
    number      start angle, noise, and the small change of friction from run to run

Each of the five draws from a seed of its own, so that a gear keeps its numbers on another bench, a
bench its encoders under another gear, and both theirs from run to run.
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


@dataclass(frozen=True, kw_only=True)
class World:
    """Which simulated world a run is made in. Raises `DriverError` for a value that names none.

    `mount` is how often the gear was taken off and refitted, `mount_turn` [rad] how far it was then
    turned on the output flange; `number` owns the noise. Everything else of the run (protocol,
    rate, temperature at its start) is not drawn.
    """

    gear_seed: int
    bench_seed: int
    mount: int = 1
    mount_turn: float = 0.0
    day: int = 1
    number: int = 1
    population: Population = "narrow"

    def __post_init__(self) -> None:
        for name, least in _LEAST.items():
            value = getattr(self, name)
            if not least <= value <= LARGEST:
                raise DriverError(
                    "names no simulated world",
                    where=name,
                    value=value,
                    limit=f"{least} to {LARGEST}",
                    remedy="Give a whole number within these.",
                )
        if not math.isfinite(self.mount_turn):
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
        return mixed("mounting", self.gear_seed, self.bench_seed, self.mount)

    @property
    def day_seed(self) -> int:
        """The seed of this day at this bench."""
        return mixed("day", self.bench_seed, self.day)

    @property
    def run_seed(self) -> int:
        """The seed of this run: another number is another noise, and so is another gear, bench, mounting or day."""
        return mixed("run", self.gear_seed, self.bench_seed, self.mount, self.day, self.number)


@dataclass(frozen=True, kw_only=True)
class ThermalState:
    """How warm a rig is [degC]: the housing with its grease, and the motor."""

    housing: float
    motor: float


_LEAST = {"gear_seed": 0, "bench_seed": 0, "mount": 1, "day": 1, "number": 1}


def mixed(name: str, *numbers: int) -> int:
    """One seed of 64 bits out of a name and numbers, the same on every computer."""
    text = " ".join((name, *map(str, numbers)))
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=8).digest(), "little")


FIRST_WORLD = World.of(0)
"""The world of whoever names none."""
