"""The end of a console on Windows (its window closed, logging off, shutting down), which no signal tells of there.

The system calls a handler in a thread of its own and ends the process when that returns, or five
seconds after. This file follows the documentation of `SetConsoleCtrlHandler`; it was never run on
Windows. Its tests replace that one call.
"""

from __future__ import annotations

import contextlib
import ctypes
from collections.abc import Callable, Generator
from typing import Any, Protocol

CLOSE, LOGOFF, SHUTDOWN = 2, 5, 6
"""CTRL_CLOSE_EVENT, CTRL_LOGOFF_EVENT, CTRL_SHUTDOWN_EVENT. Ctrl-C (0) and Ctrl-Break (1) are signals of Python's."""
LONGEST_WAIT = 4.0
"""s that the handler waits for the run; the system allows five."""


class _Abortable(Protocol):
    """What can be asked for a quick stop."""

    def abort(self) -> None: ...


@contextlib.contextmanager
def aborted_by_console(
    stop: _Abortable, wait: Callable[[float], object]
) -> Generator[None, None, None]:
    """ABORT when the console ends: there is no time for a ramp. `wait` returns once the run is over, or after s."""

    def handle(event: int) -> bool:
        if event not in (CLOSE, LOGOFF, SHUTDOWN):
            return False
        stop.abort()
        wait(LONGEST_WAIT)
        return True

    take_away = set_handler(handle)
    try:
        yield
    finally:
        take_away()


def set_handler(handle: Callable[[int], bool]) -> Callable[[], None]:
    """Have the system call `handle` with each event of the console; returns what ends that.

    Raises `OSError` where the system refuses.
    """
    # The names exist on Windows only.
    library: Any = ctypes
    kernel = library.WinDLL("kernel32", use_last_error=True)
    # Kept by the closure below: the system holds the address only.
    routine = library.WINFUNCTYPE(ctypes.c_int, ctypes.c_uint)(handle)
    if not kernel.SetConsoleCtrlHandler(routine, 1):
        raise library.WinError(library.get_last_error())

    def take_away() -> None:
        kernel.SetConsoleCtrlHandler(routine, 0)

    return take_away
