"""The replay of a run: its counts come out of the file instead of a rig.

What comes back is what was recorded, whatever is commanded: a plan that is not the recorded one would
look like a rig that does not obey. It is refused here, before anything seems to move.
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from drivers.clock import VirtualClock
from experiments.recording import RunMetadata
from rig.bench.backends.assembly import AssembledRig
from rig.bench.backends.order import Order, Setup
from rig.errors import ConfigurationError

_ENDED_EARLY = frozenset({"ABORTED", "ERROR", "INTERRUPTED"})
"""Outcomes of runs whose plan goes on where the recording ends. A trip ends the replay as it ended the run."""


def replayed(path: Path, order: Order, setup: Setup = Setup()) -> AssembledRig:
    """A run recorded in counts, played back for the same protocol with the same parameters.

    Raises `ConfigurationError` for a run that holds no counts, and for one that was recorded otherwise.
    """
    from rig.runfile.read import open_run
    from rig.runfile.source import FileSource
    from sim_backend.replay import ReplayRig

    recording = open_run(path)
    source = recording.source
    if not isinstance(source, FileSource) or any(
        column.dtype == "float64" for column in source.columns
    ):
        raise ConfigurationError(
            "only a run recorded in counts can be replayed",
            where=str(path),
            remedy="Analyse an imported run with `rig fit`.",
        )
    _refuse_another(path, recording.metadata, order, setup)
    channels = tuple(column.channel for column in source.columns)
    counts = np.column_stack([source.stored(channel.name, 0, source.rows) for channel in channels])
    clock = VirtualClock(time.time_ns())
    port = ReplayRig(
        channels,
        source.time_ns(0, source.rows),
        counts,
        source.flags(0, source.rows),
        cycle_ns=round(1e9 / recording.metadata.sample_rate),
        title=f"replay of {recording.metadata.run_id}",
        truth=recording.metadata.process.get("truth"),
        clock=clock,
    )
    return AssembledRig(name="replay", port=port, clock=clock)


def _refuse_another(path: Path, recorded: RunMetadata, order: Order, setup: Setup) -> None:
    """Raise `ConfigurationError` where the run that is asked for is not the one that was recorded."""
    differences = [
        f"{what} {_text(asked)} (recorded: {_text(then)})"
        for what, asked, then in _compared(recorded, order, setup)
        if _plain(asked) != _plain(then)
    ]
    if differences:
        raise ConfigurationError(
            "a replay plays the recorded run and no other; nothing was played",
            where=str(path),
            value=", ".join(differences),
            limit=f"{recorded.experiment} as it was recorded",
            remedy="Ask for it with the recorded values, or analyse it again with `rig fit`.",
        )
    if recorded.outcome in _ENDED_EARLY:
        raise ConfigurationError(
            "a run that was ended early cannot be replayed: its plan goes on where the recording ends",
            where=str(path),
            value=recorded.outcome,
            limit="a run that was completed, or that tripped",
            remedy="Look at it with `rig show`, analyse it with `rig fit`.",
        )


def _compared(
    recorded: RunMetadata, order: Order, setup: Setup
) -> Iterable[tuple[str, object, object]]:
    """What is compared: its name, as asked, as recorded. Of another protocol the parameters say nothing."""
    yield "protocol", order.protocol, recorded.experiment
    if order.protocol == recorded.experiment:
        yield "mounting", order.mounting, recorded.mounting
        yield "ratio", order.gear.mounted_ratio(order.mounting), recorded.ratio
        for name, asked in setup.parameters.items():
            # A parameter that is younger than the recording is taken as it is.
            yield name, asked, recorded.parameters.get(name, asked)


def _plain(value: object) -> object:
    """As a run file gives it back: lists for tuples."""
    return list(value) if isinstance(value, tuple) else value


def _text(value: object) -> str:
    items = value if isinstance(value, list | tuple) else [value]
    return " ".join(f"{item:g}" if isinstance(item, float) else str(item) for item in items)
