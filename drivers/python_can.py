"""python-can as everything here imports it: without asammdf.

Where asammdf is installed, `import can` imports it for log files that nothing here reads, and with it pandas and arrow:
0.3 s of processor time and 100 MB for every process that only wants a bus. python-can does without it, as it does where
the package is missing. canopen imports python-can, and stands behind the same door. Whoever does read measurement files
imports asammdf itself, before or after.
"""

from __future__ import annotations

import sys
from collections.abc import Generator
from contextlib import contextmanager

_UNUSED = "asammdf"


@contextmanager
def without_log_files() -> Generator[None]:
    """An import of asammdf within fails, as if it were not installed; one that was imported before stays."""
    if _UNUSED in sys.modules:
        yield
        return
    # What the import system takes for a package that cannot be had.
    sys.modules[_UNUSED] = None  # pyright: ignore[reportArgumentType]
    try:
        yield
    finally:
        del sys.modules[_UNUSED]


with without_log_files():
    import can

__all__ = ["can", "without_log_files"]
