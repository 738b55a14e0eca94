"""Every compiled (numba) function of the project, and nothing else.

numba cannot see an edit in another file: a cached kernel that calls one of a changed file returns
the old number. So all kernels live in this folder and their cache is named by the hash of the whole
folder; it is set here, before any kernel is imported. Every kernel is compiled with `nogil`, so
that a run's other threads keep turning.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from pathlib import Path

import numba
import numba.core.config


def _cache_folder() -> Path:
    """The folder for compiled kernels: below the user's cache, named by the hash of the sources here."""
    digest = hashlib.sha256(numba.__version__.encode())
    for source in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(source.name.encode() + b"\0" + source.read_bytes())
    base = (
        os.environ.get("XDG_CACHE_HOME")
        or os.environ.get("LOCALAPPDATA")
        or str(Path.home() / ".cache")
    )
    for root in (Path(base), Path(tempfile.gettempdir())):
        folder = root / "harmonic-rig" / "kernels" / digest.hexdigest()[:16]
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        return folder
    raise OSError(
        "no folder can be written for compiled kernels; set XDG_CACHE_HOME to a writable folder"
    )


numba.core.config.CACHE_DIR = str(_cache_folder())  # pyright: ignore[reportAttributeAccessIssue]
"""numba reads this when a cached kernel is declared."""
