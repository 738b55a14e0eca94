"""How often a gear that does not change may be told to have changed, and what else a laboratory wants of alarms."""

from __future__ import annotations

from dataclasses import dataclass

from rig.bench.config.ranges import ALARM_RANGES
from rig.errors import RigError

MOST_QUANTITIES = 3
"""Quantities of a gear whose change is told; each one more costs sight of all."""


@dataclass(frozen=True)
class Promise:
    """At most `false_alarms` of unchanged gears are told to have changed within `over` runs after `baseline` runs."""

    false_alarms: float = 0.05
    over: int = 20
    baseline: int = 10

    def __post_init__(self) -> None:
        for name, (low, high) in ALARM_RANGES.items():
            value = getattr(self, name)
            if not low <= value <= high:
                raise RigError(
                    "no threshold can be drawn for this",
                    where=f"alarms.{name}",
                    value=value,
                    limit=f"{low:g} to {high:g}",
                    remedy="Leave it out for 5 % over 20 runs after a baseline of 10.",
                )

    @property
    def words(self) -> str:
        """The promise in a sentence."""
        return (
            f"of gears that do not change, {100.0 * self.false_alarms:g} % are told to have changed within {self.over} "
            f"runs after the first {self.baseline}"
        )


@dataclass(frozen=True)
class Watching:
    """What a laboratory wants of alarms: the promise, and its golden gear by serial ("" none): one that is kept to be
    measured again and again, so that what changes with it is the bench; every how many days (0: whenever).
    """

    promise: Promise = Promise()
    golden_gear: str = ""
    golden_days: float = 0.0
