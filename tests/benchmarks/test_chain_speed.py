"""How fast whole runs are: the recorder alone, and the chain from set-point to sealed file."""

from __future__ import annotations

import dataclasses
import time
from pathlib import Path
from typing import Any

import numpy as np

from drivers.channel import Channel
from drivers.clock import WallClock
from drivers.samples import SampleBlock
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig.bench.backends.order import Order
from rig.run.recorder import ThreadedRecorder
from rig.run.start import plan_order, run_order
from rig.runfile.layout import Column
from rig.runfile.read import open_run
from rig.runfile.write import RunWriter
from tests.benchmarks.conftest import Note
from tests.rig.runfile.making import header

ROWS_PER_BLOCK = 1000
CHANNELS = tuple(Channel(name=f"channel_{i}", unit="rad", scale=1e-3) for i in range(8))


def test_recorder(tmp_path: Path, note: Note) -> None:
    """Eight channels as fast as they come, for five seconds: how many rows a second reach the file, none lost."""
    rng = np.random.default_rng(1)
    counts = np.cumsum(rng.integers(-3, 4, (ROWS_PER_BLOCK, 8)), axis=0)
    fast = dataclasses.replace(header(), columns=tuple(Column.of(c) for c in CHANNELS))
    recorder = ThreadedRecorder(
        RunWriter(tmp_path / "1-fast-x.h5", fast, compress=False), 100_000.0
    )
    start, rows = time.perf_counter(), 0
    while time.perf_counter() - start < 5.0:
        stamps = np.arange(rows, rows + ROWS_PER_BLOCK, dtype=np.int64) * 10_000
        recorder.put(SampleBlock(rows, stamps, counts, np.zeros(ROWS_PER_BLOCK, np.uint16)))
        rows += ROWS_PER_BLOCK
        WallClock().wait_until_ns(
            time.monotonic_ns() + max(0, int((rows / 150_000 - time.perf_counter() + start) * 1e9))
        )
    taken = time.perf_counter() - start
    path = recorder.close("COMPLETED")
    assert open_run(path).rows == rows
    note(
        "recorder, 8 channels, none lost, offered at 150 000 rows/s",
        rows / taken,
        "rows/s",
        ">= 100 000",
    )


def test_whole_chain(benchmark: Any, tmp_path: Path, note: Note) -> None:
    """A kinematic-error run on the simulated rig at 1 kHz with noise, checks and gzip."""
    durations = []

    def chain() -> None:
        request = Order(
            protocol="kinematic-error",
            gear=shipped_gear(),
            motor=shipped_motor(),
            folder=tmp_path,
            values={},
            seed=len(durations),
        )
        report = run_order(request, plan_order(request))
        recording = open_run(Path(report.path))
        durations.append(recording.rows * 1e-3)

    benchmark.pedantic(chain, rounds=3, warmup_rounds=1)
    ratio = durations[-1] / float(benchmark.stats.stats.min)
    note(
        "whole chain at 1 kHz (noise, checks, gzip)",
        ratio,
        "x real time",
        ">= 300",
    )
    assert min(durations) > 60.0
