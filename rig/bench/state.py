"""The state folder of a bench of hardware: where the latch of a trip outlives runs, programs and folders of runs.

It lies outside every folder of runs, site-wide, so that everybody at this computer meets the same
latch; where the site's cannot be written, the user's own. That of a hub is always the user's.
`rig doctor` prints which.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

from rig.errors import ConfigurationError

Scope = Literal["site", "user", "hub", "named", "runs"]
"""Whose a state folder is: everybody's at this computer, one user's, one user's for a hub, one that was named,
or that of a simulated rig.
"""
Place = tuple[Scope, Path]
VARIABLE = "HARMONIC_RIG_STATE"
"""The environment variable that names another place: for containers, and for tests."""
APPLICATION = "harmonic-rig"


def state_places(
    bench_id: str, environment: Mapping[str, str] = os.environ, *, site: bool = True
) -> list[Place]:
    """The folders of a bench's state, the one that can be written first: the others may hold state of earlier days.

    `site`: whether a place for everybody at this computer comes first. Raises `ConfigurationError`
    naming all of them where none can be written.
    """
    places = _places(bench_id, environment)
    places = [place for place in places if site or place[0] != "site"]
    refusals = []
    for place in places:
        reason = _refusal(place[1])
        if not reason:
            return sorted(places, key=lambda other: other is not place)
        refusals.append(f"{place[1]}: {reason}")
    raise ConfigurationError(
        "the state of this bench cannot be kept: a trip could not be latched",
        where=f"bench {bench_id}",
        value="; ".join(refusals),
        limit="one folder that can be written",
        remedy=f"Make {places[0][1]} writable for everybody who runs the rig.",
    )


def _places(bench_id: str, environment: Mapping[str, str]) -> list[Place]:
    own = Path("benches", bench_id)
    named = environment.get(VARIABLE, "")
    if named:
        return [("named", Path(named) / own)]
    import platformdirs

    # Not the site's data folder: on a Linux desktop XDG_DATA_DIRS moves it from one session to the
    # next, and a latch that depends on how somebody logged in is none.
    site = platformdirs.site_state_path(APPLICATION, appauthor=False)
    return [
        ("site", site / own),
        ("user", platformdirs.user_state_path(APPLICATION, appauthor=False) / own),
    ]


def _refusal(folder: Path) -> str:
    """Why nothing can be written there; "" where it can. Only trying tells: permission bits do not on every system."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return ""
    except OSError as error:
        return error.strerror or str(error)
