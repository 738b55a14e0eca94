"""Time and memory of an import: `python -m tests.benchmarks.import_study [--rows N] [--format csv|hdf5]`.

A recording of N rows of time, angle and torque is written, imported by a process of its own, and
its processor time and largest memory are printed as JSON.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import h5py
import numpy as np

BLOCK = 100_000
CHANNELS = ("time={}:s", "input_angle={}:rad", "torque={}:N m")


def write(path: Path, rows: int, kind: str) -> tuple[str, str, str]:
    """Write the recording in blocks; the names of its columns."""
    if kind == "hdf5":
        with h5py.File(path, "w") as file:
            sets = [file.create_dataset(n, (rows,), "f8", chunks=(BLOCK,)) for n in ("t", "q", "M")]
            for first in range(0, rows, BLOCK):
                for dataset, values in zip(
                    sets, _values(first, min(BLOCK, rows - first)), strict=True
                ):
                    dataset[first : first + len(values)] = values
        return "t", "q", "M"
    with path.open("w") as stream:
        stream.write("t,q,M\n")
        for first in range(0, rows, BLOCK):
            block = np.column_stack(_values(first, min(BLOCK, rows - first)))
            stream.writelines(f"{t:.6f},{q:.6f},{m:.5f}\n" for t, q, m in block.tolist())
    return "t", "q", "M"


def _values(first: int, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    seconds = (first + np.arange(count)) * 1e-3
    return seconds, 10.0 * seconds, 0.1 * np.sin(seconds)


def imported(
    path: Path, kind: str, columns: tuple[str, str, str], folder: Path
) -> dict[str, float]:
    """Import by `rig import` in a process of its own: rows, seconds, largest memory [MB]."""
    words = [
        sys.executable,
        "-m",
        "rig",
        "import",
        kind,
        str(path),
        "--runs",
        str(folder),
        "--json",
    ]
    for text, column in zip(CHANNELS, columns, strict=True):
        words += ["-c", text.format(column)]
    began = time.perf_counter()
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return {
        "rows": json.loads(done.stdout)["rows"],
        "wall_s": round(time.perf_counter() - began, 2),
        "processor_s": round(used.ru_utime + used.ru_stime, 2),
        "largest_memory_mb": round(used.ru_maxrss / 1024.0, 1),
    }


def main() -> None:
    """Write, import, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=int, default=2_000_000)
    parser.add_argument("--format", choices=("csv", "hdf5"), default="csv")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"recording.{given.format}"
        columns = write(path, given.rows, given.format)
        print(json.dumps(imported(path, given.format, columns, Path(folder) / "runs")))


if __name__ == "__main__":
    main()
