"""Every reader of files from outside with files that it accepts; read in a child process, which may die of them."""

from __future__ import annotations

import contextlib
import faulthandler
import os
import signal
import tempfile
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.io

from drivers.bus.dictionary.device_file import load_device_file
from drivers.errors import DriverError
from model.errors import WordedError
from model.gear_file import load_gear
from rig.bench.config.load import load_configuration
from rig.gears.card import load_card
from rig.runfile.importing.channel_map import ImportOptions, read_channel_map
from rig.runfile.importing.channel_source import parse_channel
from rig.runfile.read import close_recording, open_run
from rig.runfile.seal import allowing_unsealed
from rig.runfile.verify import verify_run
from tests.drivers.eds_files import load_eds
from tests.drivers.test_eds import GOOD
from tests.rig.importing import import_csv, import_mat

OWN = (DriverError, WordedError)
"""What a decoder or a reader may raise."""
OLD = Path(__file__).parents[1] / "data" / "0.1.0"
ROOT = Path(__file__).parents[2]
LONGEST = 20
"""Seconds of the processor that the reading of one small file may take: a busy computer does not count."""
CHANNELS = ("time=t [ms]", "input_angle=Position [deg]", "torque=Monitor [V]:V:0.637")


@dataclass(frozen=True)
class Reader:
    """A way in for files: accepted ones, the name's ending, and how they are read; it raises our own errors alone."""

    seeds: Callable[[], Sequence[bytes]]
    suffix: str
    read: Callable[[Path], object]


def _run(path: Path) -> None:
    # Made by the mutator, without a note: what is looked at is the reading.
    with allowing_unsealed():
        recording = open_run(path)
    try:
        recording.time()
        for name in recording.signals:
            recording.si(name)
    finally:
        close_recording(recording)


def _verify(path: Path) -> None:
    verify_run(path)


def _import(read: Callable[..., object], *channels: str) -> Callable[[Path], None]:
    def brought_in(path: Path) -> None:
        made = path.with_name("00001-import-x.h5")
        try:
            read(path, ImportOptions(channels=tuple(map(parse_channel, channels))), lambda: made)
        finally:
            for left in path.parent.glob("00001-*"):
                left.chmod(0o600)
                left.unlink()

    return brought_in


def _mat() -> Sequence[bytes]:
    time = np.arange(6) * 0.002
    with tempfile.TemporaryDirectory() as folder:
        path, files = Path(folder) / "bench.mat", []
        for version in ("5", "4"):
            scipy.io.savemat(
                path, {"t": time, "q": 100.0 * time, "tau": np.sin(time)}, format=version
            )
            files.append(path.read_bytes())
    return files


def _files(*paths: Path) -> Callable[[], Sequence[bytes]]:
    return lambda: [path.read_bytes() for path in paths]


def _template() -> Sequence[bytes]:
    return _files(ROOT / "rig" / "bench" / "config" / "template.toml")()


GEAR = next((ROOT / "model" / "gears").glob("*.toml"))
RUN = _files(OLD / "runs" / "00005-import-SN_010.h5", OLD / "runs" / "00002-motor_tare-SN_010.h5")
READERS: dict[str, Reader] = {
    "EDS": Reader(lambda: [GOOD.encode()], ".eds", lambda path: load_eds(path, 3)),
    "EDS, both readers": Reader(
        lambda: [GOOD.encode()], ".eds", lambda path: load_device_file(path, 3)
    ),
    "run file": Reader(RUN, ".h5", _run),
    "run file, verified": Reader(RUN, ".h5", _verify),
    "CSV": Reader(
        lambda: [b"\n".join((OLD / "foreign.csv").read_bytes().splitlines()[:60]) + b"\n"],
        ".csv",
        _import(import_csv, *CHANNELS),
    ),
    "MAT": Reader(_mat, ".mat", _import(import_mat, "time=t:s", "input_angle=q:rad", "torque=tau:N m")),
    "channel map": Reader(_files(OLD / "foreign.toml"), ".toml", read_channel_map),
    "gear card": Reader(
        _files(*sorted((OLD / "runs" / ".gears").glob("*.toml"))), ".toml", load_card
    ),
    "gear": Reader(_files(GEAR), ".toml", load_gear),
    "rig.toml": Reader(_template, ".toml", load_configuration),
}  # fmt: skip


def failures(reader: Reader, inputs: Iterable[bytes]) -> list[tuple[bytes, str]]:
    """Inputs that raise something else than our own errors, end the process, or take too long; with what happened."""
    waiting, failed = list(inputs), []
    while waiting:
        with tempfile.TemporaryDirectory(prefix="harmonic-rig-fuzz-") as folder:
            done, told = _read_in_child(reader, waiting, Path(folder))
        failed += [(waiting[index], text) for index, text in told]
        waiting = waiting[done:]
    return failed


def _read_in_child(
    reader: Reader, inputs: Sequence[bytes], folder: Path
) -> tuple[int, list[tuple[int, str]]]:
    """How many inputs are over, and what is to be told of them; a child that dies has died of the last one begun."""
    notes = folder / "notes"
    child = os.fork()
    if child == 0:
        _read_all(reader, inputs, folder, notes)
    _, status = os.waitpid(child, 0)
    lines = notes.read_text().splitlines()
    told = [(int(line.split(" ", 1)[0]), line.split(" ", 1)[1]) for line in lines if " " in line]
    begun = len(lines) - len(told)
    if os.WIFSIGNALED(status):
        return begun, [*told, (begun - 1, f"the process ended by signal {os.WTERMSIG(status)}")]
    return begun, told


def _read_all(reader: Reader, inputs: Sequence[bytes], folder: Path, notes: Path) -> None:
    """In the child: each input is begun with a line of its number; a failure is a line with more."""
    signal.signal(signal.SIGPROF, signal.SIG_DFL)
    faulthandler.disable()
    path = folder / f"input{reader.suffix}"
    with notes.open("a", buffering=1) as told:
        for index, data in enumerate(inputs):
            told.write(f"{index}\n")
            path.write_bytes(data)
            signal.setitimer(signal.ITIMER_PROF, LONGEST)
            try:
                with contextlib.suppress(*OWN):
                    reader.read(path)
            except BaseException as error:  # noqa: BLE001  anything else is what is looked for
                text = " ".join(f"{type(error).__name__}: {error}".split())
                told.write(f"{index} {text[:300]}\n")
    os._exit(0)
