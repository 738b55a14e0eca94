"""The bench: the rig on the table, by the identity that it got once and the folder in which its state lies.

hardware              `[bench] id` of rig.toml; the state folder of `rig.bench.state`
a hub                 its address; the user's state folder. The rules are those of hardware
sim, wire, replay     the seed of the simulated instruments; the folder of the runs, so that tests,
                      demonstrations and two people at one computer never meet each other's latches
"""

from __future__ import annotations

import re
import secrets
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from rig.bench.backends.registry import HARDWARE, REPLAY
from rig.bench.hub import hub_of
from rig.bench.state import Scope, state_places
from rig.errors import ConfigurationError

ALPHABET = "23456789bcdfghjkmnpqrstvwxz"
"""Read aloud, copied by hand and never a word: no vowels, nothing that looks like something else."""


@dataclass(frozen=True, kw_only=True)
class Bench:
    """One physical rig.

    `state` is the folder where its latch, its markers and its lock lie, `scope` whose that folder is,
    `elsewhere` are folders in which version 0.1.0 or another user may have left a latch. `option`
    names the bench on the command line.
    """

    id: str
    state: Path
    scope: Scope
    elsewhere: tuple[Path, ...] = ()
    option: str

    @property
    def has_one_master(self) -> bool:
        """Whether one process at a time may have it; runs in this process's own simulation never meet."""
        return self.scope != "runs"


def new_bench_id(choose: Callable[[Sequence[str]], str] = secrets.choice) -> str:
    """An identity that no other bench has: eight characters drawn from 27, some 10¹¹ of them."""
    letters = [choose(ALPHABET) for _ in range(8)]
    return "".join(letters[:4]) + "-" + "".join(letters[4:])


def bench_of(backend: str, runs: Path, description: Path | None = None, seed: int = 0) -> Bench:
    """The bench of a rig by this name whose runs go to `runs`.

    Raises `ConfigurationError` where a rig of hardware has no identity, or no state folder that can be written.
    """
    option = option_of(backend, runs, description)
    if backend != HARDWARE:
        # A replay turns nobody's instruments: the run that it plays names its bench itself.
        identity = "" if backend.startswith(REPLAY) else str(seed)
        return Bench(id=identity, state=runs, scope="runs", option=option)
    # Only hardware is described in text: a simulated run does without pydantic.
    from rig.bench.config.load import load_configuration
    from rig.bench.config.place import DEFAULT_PATH

    path = description or DEFAULT_PATH
    configuration = load_configuration(path)
    bus = configuration.bus
    hub = hub_of(bus.interface, bus.channel, bus.arguments)
    identity = hub or configuration.bench.id
    if not identity:
        raise ConfigurationError(
            "this bench has no identity: its trips could not be latched to it",
            where=str(path),
            value="no [bench] id",
            limit="an id of its own, made once and never used again",
            remedy=f'Add the table [bench] with id = "{new_bench_id()}": drawn now, for this rig only.',
        )
    (scope, state), *others = state_places(identity, site=not hub)
    if hub and scope == "user":
        scope = "hub"
    # Version 0.1.0 latched in the folder of the runs.
    elsewhere = (*(path for _, path in others), runs)
    return Bench(id=identity, state=state, scope=scope, elsewhere=elsewhere, option=option)


def bench_on_bus(interface: str, channel: str, arguments: Mapping[str, str | int]) -> Bench:
    """The bench behind a bus that no description names yet: a hub by its address, another bus by this computer's name
    for it.

    Raises `ConfigurationError` where no state folder can be written.
    """
    hub = hub_of(interface, channel, arguments)
    identity = hub or "bus-" + re.sub(r"[^a-z0-9]+", "-", f"{interface}-{channel}".lower()).strip(
        "-"
    )
    (scope, state), *others = state_places(identity, site=not hub)
    if hub and scope == "user":
        scope = "hub"
    elsewhere = tuple(path for _, path in others)
    return Bench(
        id=identity, state=state, scope=scope, elsewhere=elsewhere, option="--interface, --channel"
    )


def option_of(backend: str, runs: Path, description: Path | None = None) -> str:
    """How `rig acknowledge` is told which bench is meant."""
    return f"--config {description or 'rig.toml'}" if backend == HARDWARE else f"--runs {runs}"
