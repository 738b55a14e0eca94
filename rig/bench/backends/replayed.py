"""The replay of a run: its counts come out of the file instead of a rig."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from drivers.clock import VirtualClock
from rig.bench.backends.assembly import AssembledRig
from rig.errors import ConfigurationError


def replayed(path: Path) -> AssembledRig:
    """A run recorded in counts, played back. Raises `ConfigurationError` for one that holds no counts."""
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
