"""Who can say that the rig stands: the statusword and both encoders, by the cyclic data or, where
those stay away, when asked.

Without the statusword and the input encoder standstill is not verified, whatever the others say. The output encoder is
named as missing where it is silent: statusword and input encoder then carry the verdict without it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from drivers.channel import INPUT_ANGLE, OUTPUT_ANGLE, STATUSWORD
from drivers.drive_state import POWERED_STATES, DriveState, drive_state
from rig.run.phases import Machine

WORDS = {STATUSWORD: "statusword", INPUT_ANGLE: "input encoder", OUTPUT_ANGLE: "output encoder"}


@dataclass
class Observers:
    """The observers of one rig over windows of `window` cycles. Speeds in rad/s; `ratio` NaN: no gear is mounted."""

    machine: Machine
    ratio: float
    window: int
    input_speed: float
    output_speed: float
    asked: dict[str, int] = field(default_factory=dict)
    """What silent ones said when they were asked: the statusword, and counts moved over at least one window."""

    @property
    def wanted(self) -> tuple[str, ...]:
        """The observers that this rig has."""
        m = self.machine
        observers = [STATUSWORD] if m.has(STATUSWORD) else []
        observers.append(INPUT_ANGLE)
        if m.has(OUTPUT_ANGLE) and math.isfinite(self.ratio):
            observers.append(OUTPUT_ANGLE)
        return tuple(observers)

    def unheard(self) -> tuple[str, ...]:
        """Those whose cyclic data did not arrive in every cycle of the latest window."""
        return tuple(name for name in self.wanted if not self.machine.is_heard(name, self.window))

    def silent(self) -> tuple[str, ...]:
        """Those that are unheard and did not answer when they were asked, or were not."""
        return tuple(name for name in self.unheard() if name not in self.asked)

    def moving(self) -> str | None:
        """Which encoder shows motion over the latest window, or why that cannot be said; None at standstill."""
        m = self.machine
        if not m.rows:
            return "no cycle has come back"
        silent = self.silent()
        if INPUT_ANGLE in silent:
            everybody = m.has(STATUSWORD) and set(silent) == set(self.wanted)
            return "cycles are incomplete" if everybody else f"the {WORDS[INPUT_ANGLE]} is silent"
        inner = abs(self._speed(INPUT_ANGLE))
        if inner > self.input_speed:
            return f"the input turns at {inner:.3g} rad/s"
        if OUTPUT_ANGLE in self.wanted and OUTPUT_ANGLE not in silent:
            outer = abs(self._speed(OUTPUT_ANGLE)) * self.ratio
            if outer > self.output_speed:
                return f"the output turns at {outer / self.ratio:.3g} rad/s"
        return None

    def powered(self) -> str | None:
        """Why the drive may still have power, or None."""
        if STATUSWORD not in self.wanted or not self.machine.rows:
            return None
        if STATUSWORD in self.silent():
            return "the statusword is silent"
        state = (
            self.machine.state
            if STATUSWORD not in self.unheard()
            else drive_state(self.asked[STATUSWORD])
        )
        return (
            f"the drive is in {state.value}"
            if state in POWERED_STATES or state is DriveState.UNKNOWN
            else None
        )

    def problem(self) -> str | None:
        """Why standstill without power is not verified; None where it is."""
        return self.moving() or self.powered()

    def names(self) -> tuple[str, ...]:
        """Who verified it."""
        unheard, silent = self.unheard(), self.silent()
        return tuple(
            f"{name} (asked by SDO)" if name in unheard else name
            for name in self.wanted
            if name not in silent
        )

    def hear(self, before: Mapping[str, int], after: Mapping[str, int]) -> None:
        """Take the answers of silent observers, asked twice with a window between."""
        self.asked = {
            name: count if name == STATUSWORD else self._moved(name, before[name], count)
            for name, count in after.items()
            if name in before
        }

    def _moved(self, name: str, before: int, after: int) -> int:
        modulus = self.machine.channels[name].modulus
        moved = after - before
        return (moved + modulus // 2) % modulus - modulus // 2 if modulus else moved

    def _speed(self, name: str) -> float:
        """Mean speed of an angle over the window [rad/s]."""
        if name not in self.unheard():
            return self.machine.speed(name, self.window)
        return (
            self.asked[name]
            * self.machine.channels[name].scale
            / (self.window * self.machine.period)
        )
