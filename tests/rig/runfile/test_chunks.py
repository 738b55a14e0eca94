"""Whole chunks are compressed beside the library: to every reader the same numbers, and damage in them is refused."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

from rig.runfile import layout
from rig.runfile.chunks import ChunkWriter
from rig.runfile.write import RunWriter
from tests.rig.runfile.making import block, header

ROWS = 64
KINDS = {
    "<i8": np.array([-(2**63), 2**63 - 1, 0, -1]),
    "<i4": np.array([-(2**31), 2**31 - 1, 0, -1]),
    "<u2": np.array([0, 1, 2**15, 2**16 - 1]),
    "<f8": np.array([-1.5e300, 5e-324, -0.0, np.inf]),
}


def column(file: h5py.File, kind: str, name: str = "column") -> h5py.Dataset:
    return file.create_dataset(
        name, (0,), kind, maxshape=(None,), chunks=(ROWS,), **layout._FILTERS
    )


@pytest.mark.parametrize("kind", KINDS)
def test_a_reader_finds_the_numbers_bit_for_bit(tmp_path: Path, kind: str) -> None:
    wide = {"<u2": np.uint16, "<f8": np.float64}.get(kind, np.int64)
    values = np.tile(KINDS[kind].astype(wide), 3 * ROWS // 4)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        writer = ChunkWriter(column(file, kind))
        for first in range(0, 3 * ROWS, ROWS):
            writer.append(first, values[first : first + ROWS])
    with h5py.File(tmp_path / "a.h5") as file:
        found = file["column"][()]
    assert found.dtype == np.dtype(kind)
    assert found.tobytes() == values.astype(kind).tobytes()


def test_what_the_library_compressed_stands_beside_it(tmp_path: Path) -> None:
    values = np.arange(2 * ROWS + 5)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        made = column(file, "<i4")
        writer = ChunkWriter(made)
        writer.append(0, values[:ROWS])
        made.resize((2 * ROWS,))
        made[ROWS:] = values[ROWS : 2 * ROWS]
        made.resize((len(values),))
        made[2 * ROWS :] = values[2 * ROWS :]
    with h5py.File(tmp_path / "a.h5") as file:
        assert np.array_equal(file["column"][()], values)


def test_damage_in_a_chunk_is_refused_by_its_own_checksum(tmp_path: Path) -> None:
    values = np.random.default_rng(4).integers(-1000, 1000, ROWS)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        ChunkWriter(column(file, "<i4")).append(0, values)
    with h5py.File(tmp_path / "a.h5", "r+") as file:
        mask, raw = file["column"].id.read_direct_chunk((0,))
        # The last bytes are the sum: a wrong one is a number that nobody can trust.
        file["column"].id.write_direct_chunk((0,), raw[:-1] + bytes([raw[-1] ^ 1]), mask)
    with h5py.File(tmp_path / "a.h5") as file, pytest.raises(OSError, match="filter"):
        file["column"][()]


@pytest.mark.parametrize("flushed", [0, 10, ROWS, ROWS + 10])
def test_a_run_that_was_flushed_on_the_way_has_the_same_numbers(
    tmp_path: Path, flushed: int
) -> None:
    rows = 3 * ROWS + 7
    writer = RunWriter(tmp_path / "00001-friction-A1.h5", header(), chunk_rows=ROWS)
    for first, stop in ((0, flushed), (flushed, rows)):
        if stop > first:
            writer.append(block(first, stop - first))
            writer.flush()
    path = writer.seal("COMPLETED")
    with h5py.File(path) as file:
        cycles = file[f"{layout.DATA}/cycle"][()]
    assert np.array_equal(cycles, np.arange(rows))
