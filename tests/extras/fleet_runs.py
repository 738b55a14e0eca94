"""Forty short runs for the tests of a fleet: some simulated, the others copies under names and gears of their own."""

from __future__ import annotations

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py

from rig.fleet.simulate import Production, simulate_fleet
from rig.library.folder import run_number
from rig.runfile.seal import file_sha256, hash_path, protect

RUNS = 24
BATCH_SECONDS = 0.2


def make_runs(folder: Path) -> Path:
    """One tare, two friction runs that need it, twenty-one of `home`: one bench, one day. Returns their folder."""
    made = simulate_fleet(
        Production(
            folder=folder,
            gears=2,
            protocols=("friction", "home"),
            short=True,
            sample_rate=100.0,
            values={"friction": {"points": 6}},
        )
    )
    assert (made.runs, made.failed) == (5, ())
    day = folder / "bench-01" / "day-001"
    homes = sorted(day.glob("*-home-*.h5"))
    for number in range(6, RUNS + 1):
        _copy(homes[number % len(homes)], number)
    return folder


def _copy(run: Path, number: int) -> None:
    """The same run under another number, of another gear, sealed anew."""
    gear = f"G-{number:05d}"
    copy = run.with_name(f"{number:05d}-home-{gear.replace('-', '_')}.h5")
    shutil.copyfile(run, copy)
    copy.chmod(0o600)
    with h5py.File(copy, "r+") as file:
        for name, text in (("run_id", copy.stem), ("sample/serial_number", gear)):
            _write(file, name, text)
    hash_path(copy).write_text(f"{file_sha256(copy)}  {copy.name}\n", encoding="ascii")
    protect(copy)


def _write(file: h5py.File, name: str, text: str) -> None:
    field = file[f"entry/{name}"]
    assert isinstance(field, h5py.Dataset)
    field[()] = text


def renew(run: Path, motor: str = "") -> None:
    """Let a run be another one: its gear gets another serial number, its motor this name (as long as the old
    one: the field keeps its length), and it is sealed anew.
    """
    assert run_number(run.name)
    for path in (run, hash_path(run)):
        path.chmod(0o600)
    with h5py.File(run, "r+") as file:
        _write(file, "sample/serial_number", "G-RENEW")
        if motor:
            details = json.loads(file["entry/process/details"][()])
            _write(file, "process/details", json.dumps(details | {"motor": motor}))
    hash_path(run).write_text(f"{file_sha256(run)}  {run.name}\n", encoding="ascii")
    protect(run)


class Cluster:
    """A scheduler and workers, each a process of its own, over TCP on this computer."""

    def __init__(self) -> None:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{port}"
        self.workers: list[subprocess.Popen[bytes]] = []
        self._scheduler = self._start(
            "scheduler",
            "--host",
            "127.0.0.1",
            "--port",
            str(port),
            "--no-dashboard",
            "--dashboard-address",
            "127.0.0.1:0",
        )

    def _start(self, *words: str) -> subprocess.Popen[bytes]:
        return subprocess.Popen(
            [sys.executable, "-m", "dask", *words],
            env=os.environ | {"OMP_NUM_THREADS": "1"},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )

    def join(self) -> subprocess.Popen[bytes]:
        """A worker that joins; its process."""
        words = ("--nthreads", "1", "--no-nanny", "--no-dashboard", "--memory-limit", "0")
        worker = self._start("worker", self.address, *words, "--host", "127.0.0.1")
        self.workers.append(worker)
        return worker

    def close(self) -> None:
        """End all of it."""
        for process in (*self.workers, self._scheduler):
            if process.poll() is None:
                process.send_signal(signal.SIGKILL)
            process.wait()


@contextmanager
def running_cluster(workers: int) -> Iterator[Cluster]:
    """A cluster with so many workers."""
    cluster = Cluster()
    try:
        for _ in range(workers):
            cluster.join()
        yield cluster
    finally:
        cluster.close()
