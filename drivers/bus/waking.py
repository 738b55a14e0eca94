"""Whether the process has slept while the drive was on: suspended, its interpreter kept by another thread, or starved.

Set-points that were made before are old then, and the drive may have given the computer up meanwhile. So the clock is
looked at before each cycle's first frame, the heartbeat among them; after a sleep that frame is the quick stop.
"""

from __future__ import annotations

from typing import Final

from drivers.clock import Clock

LATE_TURN: Final = "late-turn"
"""The code of the event, and by it the cause of the trip."""
_WAITED_FOR: Final = 2.0
"""Times the longest that a cycle may wait for its frames, below which a pause is no sleep."""


def longest_pause_ns(computer_lost_ms: int, cycle_ns: int, patient_cycles: float) -> int:
    """The longest time between two SYNCs after which a set-point may still go out [ns]: as long as the drive waits
    for the computer's heartbeat, and never less than a cycle that waits in full (`patient_cycles`) may take.
    """
    return max(computer_lost_ms * 1_000_000, round(_WAITED_FOR * (1.0 + patient_cycles) * cycle_ns))


class Waking:
    """Looks at the clock between two SYNCs; `allowed_ns` may pass between them."""

    def __init__(self, clock: Clock, allowed_ns: int) -> None:
        self.allowed_ns = allowed_ns
        self.overslept_ms = 0.0
        """How long it was, once it was too long; 0 before."""
        self._clock = clock
        self._last_ns = clock.monotonic_ns()

    def cycled(self) -> None:
        """A SYNC goes out, or the drive has just been switched on."""
        self._last_ns = self._clock.monotonic_ns()

    def has_slept(self) -> bool:
        """Whether too long has passed since."""
        return self._pause_ns() > self.allowed_ns

    def woke(self) -> None:
        """It has slept, and the quick stop goes out."""
        self.overslept_ms = self._pause_ns() * 1e-6

    def _pause_ns(self) -> int:
        return self._clock.monotonic_ns() - self._last_ns

    def words_of(self, pause_ms: float) -> str:
        """What happened, for an event."""
        return (
            f"no cycle for {pause_ms:.0f} ms, allowed {self.allowed_ns * 1e-6:.0f} ms: the process slept; "
            "the quick stop went out in place of the set-point"
        )
