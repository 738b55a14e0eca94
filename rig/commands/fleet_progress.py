"""How a job of thousands of runs tells its progress: one line that is renewed; in a log a line now and then."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable, Iterator

from rig.content.wording import visible
from rig.fleet.progress import Progress

ON_A_TERMINAL, IN_A_LOG = 0.2, 30.0
"""Seconds between two lines."""


@contextlib.contextmanager
def telling(now: Callable[[], float] = time.monotonic) -> Iterator[Callable[[Progress], None]]:
    """Tells each moment of a job on standard error, no oftener than a reader can follow."""
    is_terminal = sys.stderr.isatty()
    pause, start, end = (ON_A_TERMINAL, "\r\x1b[K", "") if is_terminal else (IN_A_LOG, "", "\n")
    told = now() - pause * is_terminal

    def tell(progress: Progress) -> None:
        nonlocal told
        if now() - told < pause and progress.done < progress.runs:
            return
        told = now()
        sys.stderr.write(f"{start}{visible(progress.words())}{end}")
        sys.stderr.flush()

    try:
        yield tell
    finally:
        if is_terminal:
            sys.stderr.write("\n")
