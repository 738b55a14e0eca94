"""Who can say that the rig stands: the statusword and both encoders, by the cyclic data or, where
those stay away, when asked.

Without the statusword and the input encoder standstill is not verified, whatever the others say. The output encoder is
named as missing where it is silent: statusword and input encoder then carry the verdict without it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field

from drivers.channel import INPUT_ANGLE, OUTPUT_ANGLE, STATUSWORD
from drivers.drive_state import POWERED_STATES, DriveState, drive_state
from drivers.port import Answer, Ask
from rig.run.phases import Machine

WORDS = {STATUSWORD: "statusword", INPUT_ANGLE: "input encoder", OUTPUT_ANGLE: "output encoder"}
_FRESH = 3
"""Windows after which an answer says nothing any more about now."""


@dataclass(frozen=True)
class _Heard:
    """One answer: the cycle in which it came and the row up to which the rig had run, and the count."""

    cycle: int
    row: int
    count: int


@dataclass
class Observers:
    """The observers of one rig over windows of `window` cycles. Speeds in rad/s; `ratio` NaN: no gear is mounted."""

    machine: Machine
    ratio: float
    window: int
    input_speed: float
    output_speed: float
    mute: set[str] = field(default_factory=set[str])
    """Those whose device refused or did not answer when it was asked last."""
    _asked: dict[str, list[_Heard]] = field(default_factory=dict[str, list[_Heard]])

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
        """Those that are unheard and have not said enough when they were asked, or were not."""
        return tuple(name for name in self.unheard() if self._pair(name) is None)

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
        pair = self._pair(STATUSWORD) if STATUSWORD in self.unheard() else None
        state = self.machine.state if STATUSWORD not in self.unheard() else None
        if pair is not None:
            state = drive_state(pair[1].count)
        if state is None:
            return "the statusword is silent"
        if state in POWERED_STATES or state is DriveState.UNKNOWN:
            return f"the drive is in {state.value}"
        return None

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

    def hear(self, answers: Iterable[Answer]) -> None:
        """Take what silent observers said when they were asked; counts are unwrapped."""
        for answer in answers:
            name = answer.request.channel
            if answer.count is None:
                # A controlword is acknowledged without a count: it says nothing of who can be read.
                if answer.request.ask is Ask.READ:
                    self.mute.add(name)
                continue
            self.mute.discard(name)
            heard = self._asked.setdefault(name, [])
            count = answer.count
            if heard and name != STATUSWORD:
                count = heard[-1].count + self._moved(name, heard[-1].count, count)
            heard.append(_Heard(answer.cycle, self.machine.rows, count))

    def _pair(self, name: str) -> tuple[_Heard, _Heard] | None:
        """The latest answer and, of an encoder, one that is at least a window older; None where that is not enough."""
        heard = self._asked.get(name, [])
        if not heard or self.machine.rows - heard[-1].row > _FRESH * self.window:
            return None
        last = heard[-1]
        before = [h for h in heard if h.cycle <= last.cycle - self.window]
        if name == STATUSWORD:
            return last, last
        return (before[-1], last) if before else None

    def _moved(self, name: str, before: int, after: int) -> int:
        modulus = self.machine.channels[name].modulus
        moved = after - before
        return (moved + modulus // 2) % modulus - modulus // 2 if modulus else moved

    def _speed(self, name: str) -> float:
        """Mean speed of an angle over the window [rad/s]."""
        pair = self._pair(name) if name in self.unheard() else None
        if pair is None:
            return self.machine.speed(name, self.window)
        before, last = pair
        moved = (last.count - before.count) * self.machine.channels[name].scale
        return moved / ((last.cycle - before.cycle) * self.machine.period)
