"""The state folder of a bench of hardware: where the latch of a trip outlives runs, programs and folders of runs.

It lies outside every folder of runs, site-wide, so that everybody at this computer meets the same
latch; where the site's cannot be written, the user's own. `rig doctor` prints which.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from rig.errors import ConfigurationError

Scope = Literal["site", "user", "named"]
VARIABLE = "HARMONIC_RIG_STATE"
"""The environment variable that names another place: for containers, and for tests."""
APPLICATION = "harmonic-rig"


@dataclass(frozen=True)
class StateFolder:
    """The folder that a bench writes, for whom it is the same, and where else state of it may lie from earlier days."""

    path: Path
    scope: Scope
    elsewhere: tuple[Path, ...] = ()


def state_folder(bench_id: str, environment: Mapping[str, str] = os.environ) -> StateFolder:
    """The first of the places that can be written. Raises `ConfigurationError` naming all of them where none can."""
    places = _places(bench_id, environment)
    refusals = []
    for scope, path in places:
        reason = _refusal(path)
        if not reason:
            others = tuple(other for _, other in places if other != path)
            return StateFolder(path, scope, others)
        refusals.append(f"{path}: {reason}")
    raise ConfigurationError(
        "the state of this bench cannot be kept: a trip could not be latched",
        where=f"bench {bench_id}",
        value="; ".join(refusals),
        limit="one folder that can be written",
        remedy=f"Make {places[0][1]} writable for everybody who runs the rig.",
    )


def _places(bench_id: str, environment: Mapping[str, str]) -> tuple[tuple[Scope, Path], ...]:
    named = environment.get(VARIABLE, "")
    if named:
        return (("named", Path(named) / "benches" / bench_id),)
    import platformdirs

    # Not the site's data folder: on a Linux desktop XDG_DATA_DIRS moves it from one session to the
    # next, and a latch that depends on how somebody logged in is none.
    site = platformdirs.site_state_path(APPLICATION, appauthor=False)
    user = platformdirs.user_state_path(APPLICATION, appauthor=False)
    return ("site", site / "benches" / bench_id), ("user", user / "benches" / bench_id)


def _refusal(folder: Path) -> str:
    """Why nothing can be written there; "" where it can. Only trying tells: permission bits do not on every system."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return ""
    except OSError as error:
        return error.strerror or str(error)
