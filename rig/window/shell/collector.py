"""Python's garbage collector, kept in the window's own thread.

The collector runs in whichever thread happens to ask for memory. In a thread that only reads lines
of a run it would take old plots apart while the window paints, and Qt dies of that (a segmentation
fault, and with the window the line to the run ends: a STOP). So it is switched off, and a timer of
the window does its work.
"""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager

from PySide6.QtCore import QTimer

_INTERVAL_MS = 500


@contextmanager
def collector_in_this_thread() -> Iterator[None]:
    """While the block runs, garbage is collected by a timer of this thread's event loop and by nothing else."""
    was_on = gc.isenabled()
    gc.collect()
    # What the program itself is made of never becomes garbage; looking through it again and again would cost frames.
    gc.freeze()
    gc.disable()
    timer = QTimer()
    timer.timeout.connect(_collect_what_is_due)
    timer.start(_INTERVAL_MS)
    try:
        yield
    finally:
        timer.stop()
        gc.unfreeze()
        if was_on:
            gc.enable()


def _collect_what_is_due() -> None:
    """The young objects at every call, the older ones when enough has come together, as the
    collector does it by itself.
    """
    gc.collect(0)
    for generation in (1, 2):
        if gc.get_count()[generation] > gc.get_threshold()[generation]:
            gc.collect(generation)
