"""Where the index of a folder of runs is kept: at this computer, in the user's own cache, wherever the runs are.

SQLite needs locks that file systems shared by several computers do not give reliably; an index beside
runs on a share would be damaged by the second computer. So nothing of the index is ever on the share:
each user of each computer has one of their own, told apart by the folder's path. It is a cache.
"""

from __future__ import annotations

import hashlib
import os
import platform
from collections.abc import Mapping
from pathlib import Path

VARIABLE = "HARMONIC_RIG_INDEX"
"""The environment variable that names another folder for the indexes: where the user's cache is no good place."""
APPLICATION = "harmonic-rig"


def index_path(folder: str | Path, environment: Mapping[str, str] = os.environ) -> Path:
    """The database of a folder of runs; the same one by whatever path the folder is reached."""
    whole = os.fsencode(os.path.realpath(folder))
    return indexes_folder(environment) / f"{hashlib.sha256(whole).hexdigest()[:24]}.sqlite"


def indexes_folder(environment: Mapping[str, str] = os.environ) -> Path:
    """Where the indexes of all folders are: by computer, for a home that is itself on a share."""
    computer = platform.node() or "computer"
    named = environment.get(VARIABLE, "")
    if named:
        return Path(named) / computer
    import platformdirs

    return platformdirs.user_cache_path(APPLICATION, appauthor=False) / "library" / computer
