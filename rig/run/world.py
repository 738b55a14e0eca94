"""The simulated world of a run: refused where there is none, and how warm the rig is when it starts.

A run starts as warm as the rig was left: at the end state of the highest sealed run of the same
gear, bench, mounting and day in its folder. How long the pause was is not known: it starts as that
one ended. A run that was cut off has no end state; then the one before it counts.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from experiments.recording import RunMetadata
from rig.bench.backends.assembly import WORLD_OF_0_2_0
from rig.bench.backends.order import AMBIENT, AUTO, StartState, WorldChoice, world_word
from rig.bench.backends.registry import is_simulated
from rig.errors import ConfigurationError, RunFileError
from rig.library.folder import run_named, sealed_runs
from rig.runfile.read import glance

OUTPUT_BEARINGS: Mapping[str, Mapping[str, Any]] = {
    "narrow": {
        "coulomb": 0.5,
        "coulomb_u": 0.12,
        "viscous": 0.4,
        "viscous_u": 0.1,
        "source": "card of the simulated bench: within 20 %",
    },
    "wide": {
        "coulomb": 0.55,
        "coulomb_u": 0.52,
        "viscous": 0.0,
        "viscous_u": 0.0,
        "source": "card of the simulated bench: 0.1 to 1 N m",
    },
}
"""What the card of a simulated bench says of its output bearing, by population: Coulomb friction [N m] and viscous
friction [N m s/rad] with their expanded uncertainties (k = 2)."""
_BODIES = ("gear_seed", "bench_seed", "population", "version")
"""What has the temperatures: those of another gear or bench are not to be had."""
_LEFT_WARM = (*_BODIES, "mount", "mount_turn", "day", "day_correlation", "hours")
"""What two runs share that follow each other: nobody took the gear off or ran it elsewhere, no night was between."""


@dataclass(frozen=True)
class Ending:
    """In which world a run was made, and how warm the rig was at its end."""

    world: Mapping[str, Any]
    state: StartState

    def shares(self, names: tuple[str, ...], world: Mapping[str, Any]) -> bool:
        """Whether these of its world are those of another one."""
        own = {**WORLD_OF_0_2_0, **self.world}
        return all(own.get(name) == world[name] for name in names)


def refuse_world(backend: str, choice: WorldChoice) -> None:
    """Raise `ConfigurationError` where a world is chosen for a rig that lives in the real one, or in a recorded one."""
    if is_simulated(backend):
        return
    usual = WorldChoice()
    chosen = {name: value for name, value in vars(choice).items() if value != getattr(usual, name)}
    if chosen:
        raise ConfigurationError(
            "only a simulated rig lives in a world that can be chosen",
            where=", ".join(map(world_word, chosen)),
            value=", ".join(map(str, chosen.values())),
            limit="--backend sim or wire",
            remedy=f"Leave it away for {backend}.",
        )


def start_state(
    folder: Path, word: str, world: Mapping[str, Any], serial: str | None = None
) -> StartState:
    """How warm a run starts in this world: `auto`, `ambient`, or as the run that is named ended.

    `serial`: the gear's, where runs of the same gear bear it in their names.
    Raises `ConfigurationError` for a named run that has no end state, or that of another gear or bench.
    """
    if word == AMBIENT:
        return StartState()
    if word != AUTO:
        return _as_named(folder, word, world)
    sealed = sealed_runs(folder, serial) if folder.is_dir() else ()
    endings = (_ending_of(path) for path in reversed(sealed))
    fitting = (e.state for e in endings if e is not None and e.shares(_LEFT_WARM, world))
    return next(fitting, StartState())


def _as_named(folder: Path, word: str, world: Mapping[str, Any]) -> StartState:
    path = run_named(folder, word)
    ending = ending_of(glance(path).metadata)
    if ending is None or not ending.shares(_BODIES, world):
        what = "ended with the temperatures of another gear or bench"
        if ending is None:
            what = "has no temperatures to start from"
        raise ConfigurationError(
            what,
            where="--world start-state",
            value=word,
            limit="a sealed run of this gear on this bench, simulated, that came to its end",
            remedy=f"Name another run, or {AUTO} or {AMBIENT}.",
        )
    return ending.state


def _ending_of(path: Path) -> Ending | None:
    """The ending of a run file; None for one without, and for one that cannot be read."""
    try:
        status = path.stat()
        return _ending_as_it_is(
            path, (status.st_dev, status.st_ino), status.st_size, status.st_mtime_ns
        )
    except OSError:
        return None


@functools.lru_cache(maxsize=256)
def _ending_as_it_is(
    path: Path, number: tuple[int, int], size: int, changed_ns: int
) -> Ending | None:
    """The ending of a sealed run, read once in a process; once more where another file has taken its place."""
    try:
        return ending_of(glance(path).metadata)
    except RunFileError:
        return None


def ending_of(metadata: RunMetadata) -> Ending | None:
    """The ending of a run; None where it knows of none: no simulated rig, not ended, or an older version's."""
    world: Mapping[str, Any] | None = metadata.process.get("world")
    state: Mapping[str, Any] | None = metadata.process.get("acquisition", {}).get("thermal_state")
    if not isinstance(world, Mapping) or not isinstance(state, Mapping):
        return None
    return Ending(world, StartState(metadata.run_id, state["end"]))
