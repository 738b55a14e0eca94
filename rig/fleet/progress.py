"""How far a job is: what is done, at which rate, how long it will still take, and what failed so far."""

from __future__ import annotations

from dataclasses import dataclass

from model.arrays import quotient
from rig.content.phrase import phrase


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
        return quotient(made, self.seconds, 0.0)

    @property
    def left(self) -> float | None:
        """Seconds that the rest will take at this rate; None where there is none yet."""
        return (self.runs - self.done) / self.rate if self.rate > 0.0 else None

    def words(self) -> str:
        """One line."""
        words = [f"{phrase('{}: ', self.what)}{self.done} of {self.runs} runs"]
        if self.rate:
            words.append(f"{self.rate:.2g} runs/s")
            if self.left is not None:
                words.append(f"{duration(self.left)} left")
        if self.failed:
            words.append(f"{self.failed} failed")
        return ", ".join(words)


def duration(seconds: float) -> str:
    """A time to wait in words."""
    if seconds < 100.0:
        return f"{seconds:.0f} s"
    minutes = seconds / 60.0
    return f"{minutes:.0f} min" if minutes < 100.0 else f"{minutes / 60.0:.1f} h"
