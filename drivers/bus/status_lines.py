"""A statusword out of digital lines: what an amplifier without a bus says of itself by contacts.

    alarm    power    ready        statusword of
    yes      on       -            fault reaction active (it may still produce torque)
    yes      off      -            fault
    no       on       -            operation enabled
    no       off      yes          switch on disabled, voltage at the power stage (bit 4)
    no       off      no           switch on disabled, no voltage: main circuit off, or stopped by hardware

Bit 10 (target reached) is the line that tells that the speed is the one that was asked for.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from drivers.drive_state import STATUSWORD_OF, DriveState

VOLTAGE: Final = 0x0010
TARGET_REACHED: Final = 0x0400


@dataclass(frozen=True)
class Line:
    """One contact in a word of inputs or outputs: its bit, and whether the contact means what it is named for when the
    bit is 1.
    """

    mask: int
    active_high: bool = True

    def is_active(self, word: int) -> bool:
        """Whether a word says what the line is named for."""
        return bool(word & self.mask) == self.active_high

    def put(self, word: int, is_active: bool) -> int:
        """A word with this line said or not."""
        return word | self.mask if is_active == self.active_high else word & ~self.mask


def statusword(*, alarm: bool, power: bool, ready: bool, reached: bool) -> int:
    """The statusword by the table of this module."""
    if alarm:
        return STATUSWORD_OF[DriveState.FAULT_REACTION if power else DriveState.FAULT]
    if power:
        return STATUSWORD_OF[DriveState.ENABLED] | (TARGET_REACHED if reached else 0)
    off = STATUSWORD_OF[DriveState.SWITCH_ON_DISABLED]
    return off if ready else off & ~VOLTAGE


@dataclass(frozen=True, kw_only=True)
class StatusLines:
    """The contacts of an amplifier in one word of digital inputs of up to 16 bits: alarm, power on the motor, ready to
    be switched on, and, where it is wired, speed coincidence.
    """

    alarm: Line
    power: Line
    ready: Line
    reached: Line | None = None
    _words: NDArray[np.int64] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """The statusword of every word, made once."""
        bits = max(line.mask for line in self.lines).bit_length()
        words = np.array([self._word(word) for word in range(1 << bits)], dtype=np.int64)
        object.__setattr__(self, "_words", words)

    @property
    def lines(self) -> tuple[Line, ...]:
        """Those that are wired."""
        wired = (self.alarm, self.power, self.ready, self.reached)
        return tuple(line for line in wired if line is not None)

    def _word(self, word: int) -> int:
        return statusword(
            alarm=self.alarm.is_active(word),
            power=self.power.is_active(word),
            ready=self.ready.is_active(word),
            reached=self.reached is not None and self.reached.is_active(word),
        )

    def of(self, word: int) -> int:
        """The statusword of one word of inputs."""
        return int(self._words[word & len(self._words) - 1])

    def of_all(self, words: NDArray[np.int64]) -> NDArray[np.int64]:
        """The statuswords (n,) of words (n,) of inputs."""
        return self._words[words & len(self._words) - 1]
