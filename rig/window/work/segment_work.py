"""Working out what a segment says once it has ended, beside the window: averaging a slow hold takes
as long as eight frames.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, TypeVar

T = TypeVar("T")
MOST_WAITING = 4
"""Segments that wait while the run goes on. A run in virtual time brings more: they are told when there is room."""


class SegmentWork:
    """One thread that works things out one after the other; what comes of them is handed over in
    the window's own thread.
    """

    def __init__(self) -> None:
        self._thread = ThreadPoolExecutor(1, "segments")
        self._waiting: deque[tuple[Future[Any], Callable[[Any], None]]] = deque()

    @property
    def is_idle(self) -> bool:
        """Whether everything was done and handed over."""
        return not self._waiting

    @property
    def is_full(self) -> bool:
        """Whether no more should be put in while others come."""
        return len(self._waiting) >= MOST_WAITING

    def put(self, work: Callable[[], T], then: Callable[[T], None]) -> None:
        """Have `work` done in the thread, and `then` called with what it returns by `deliver` or
        `finish`, in this order.
        """
        self._waiting.append((self._thread.submit(work), then))

    def deliver(self) -> int:
        """Hand over what is done by now; returns how much. Raises what the work raised."""
        count = 0
        while self._waiting and self._waiting[0][0].done():
            self._hand_over()
            count += 1
        return count

    def finish(self) -> None:
        """Wait until all is done, and hand it over."""
        while self._waiting:
            self._hand_over()

    def close(self) -> None:
        """Forget what is not done, and wait for what is being done: it reads from a file that is about to be closed."""
        self._waiting.clear()
        self._thread.shutdown(wait=True, cancel_futures=True)

    def _hand_over(self) -> None:
        future, then = self._waiting.popleft()
        then(future.result())
