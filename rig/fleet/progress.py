"""How far a job is: what is done, at which rate, how long it will still take, and what failed so far."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Progress:
    """A moment of a job. `done` of `runs` are done, `reused` of them were done before; `seconds` since its start.

    `what` is what is being done, where that is not yet the work itself.
    """

    runs: int
    done: int
    reused: int
    failed: int
    seconds: float
    what: str = ""

    @property
    def rate(self) -> float:
        """Runs per second that this job did; 0 before the first."""
        made = self.done - self.reused
        return made / self.seconds if self.seconds > 0.0 else 0.0

    @property
    def left(self) -> float | None:
        """Seconds that the rest will take at this rate; None where there is none yet."""
        return (self.runs - self.done) / self.rate if self.rate > 0.0 else None

    def words(self) -> str:
        """One line."""
        left = "" if self.left is None else f", {duration(self.left)} left"
        rate = f", {self.rate:.2g} runs/s{left}" if self.rate else ""
        failed = f", {self.failed} failed" if self.failed else ""
        what = f"{self.what}: " if self.what else ""
        return f"{what}{self.done} of {self.runs} runs{rate}{failed}"


def duration(seconds: float) -> str:
    """A time to wait in words."""
    if seconds < 100.0:
        return f"{seconds:.0f} s"
    minutes = seconds / 60.0
    return f"{minutes:.0f} min" if minutes < 100.0 else f"{minutes / 60.0:.1f} h"
