"""The small marks of check boxes and spin boxes as pictures in the colours of a theme: a style sheet draws none."""

from __future__ import annotations

import atexit
import functools
import shutil
import tempfile
from pathlib import Path

_STROKES = {
    "tick": ("M2.5 6.8l2.9 3L10.5 3.2", 1.9),
    "up": ("M3 8.5l3.5-4 3.5 4", 1.6),
    "down": ("M3 4.5l3.5 4 3.5-4", 1.6),
}
"""Path in a square of 13, and width of its line."""


@functools.cache
def _folder() -> Path:
    """Where this process keeps them until it ends."""
    folder = Path(tempfile.mkdtemp(prefix="harmonic-rig-marks-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


@functools.cache
def mark(name: str, colour: str) -> str:
    """The file of a mark ("tick", "up", "down") in a colour (CSS hex), as a style sheet names it."""
    path, width = _STROKES[name]
    file = _folder() / f"{name}-{colour.lstrip('#')}.svg"
    file.write_text(
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 13 13" width="13" height="13">'
        f'<path d="{path}" fill="none" stroke="{colour}" stroke-width="{width}" stroke-linecap="round" '
        'stroke-linejoin="round"/></svg>',
        encoding="utf-8",
    )
    return file.as_posix()
