"""Files that are built as no run is: refused at opening, before anything in them is read."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import h5py
import numpy as np
import pytest

from rig.errors import RunFileError
from rig.library.index import LibraryIndex
from rig.runfile import structure
from rig.runfile.read import close_recording, open_run
from rig.runfile.recover import recover_run
from rig.runfile.seal import part_path
from rig.runfile.structure import LARGEST_RATIO, LARGEST_TIME_RATIO, refuse_foreign_structure
from rig.runfile.verify import verify_run
from rig.runfile.write import RunWriter
from tests.rig.runfile.making import CHANNELS, block, edit, header, reseal, write_run

ROWS = 300
TORQUE = "entry/data/torque"


def _instead(file: Any, path: str) -> h5py.Group:
    """The group of an object that is taken away."""
    group = file[path].parent
    del file[path]
    return group


def virtual(file: Any, folder: Path) -> None:
    with h5py.File(folder / "elsewhere.h5", "w") as other:
        other["x"] = np.zeros(ROWS, np.int32)
    made = h5py.VirtualLayout((ROWS,), np.int32)
    made[:] = h5py.VirtualSource(folder / "elsewhere.h5", "x", (ROWS,))
    _instead(file, TORQUE).create_virtual_dataset("torque", made)


def external(file: Any, folder: Path) -> None:
    (folder / "elsewhere.bin").write_bytes(bytes(4 * ROWS))
    place = [(str(folder / "elsewhere.bin"), 0, 4 * ROWS)]
    _instead(file, TORQUE).create_dataset("torque", (ROWS,), np.int32, external=place)


def external_link(file: Any, folder: Path) -> None:
    with h5py.File(folder / "elsewhere.h5", "w") as other:
        other.create_dataset("x", data=np.zeros(ROWS, np.int32), chunks=(ROWS,))
    _instead(file, TORQUE)["torque"] = h5py.ExternalLink("elsewhere.h5", "x")


def soft_link(file: Any, _: Path) -> None:
    _instead(file, TORQUE)["torque"] = h5py.SoftLink("/entry/data/statusword")


def second_name(file: Any, _: Path) -> None:
    _instead(file, TORQUE)["torque"] = file["entry/data/statusword"]


def group_in_itself(file: Any, _: Path) -> None:
    file["entry/sample/again"] = file["entry"]


def unknown_filter(file: Any, _: Path) -> None:
    plan = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    plan.set_chunk((64,))
    plan.set_filter(32_123, h5py.h5z.FLAG_OPTIONAL)
    space = h5py.h5s.create_simple((ROWS,))
    group = _instead(file, TORQUE)
    h5py.h5d.create(group.id, b"torque", h5py.h5t.STD_I32LE, space, plan)


def packed_twice(file: Any, _: Path) -> None:
    plan = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    plan.set_chunk((64,))
    plan.set_deflate(9)
    plan.set_deflate(9)
    space = h5py.h5s.create_simple((ROWS,))
    group = _instead(file, TORQUE)
    h5py.h5d.create(group.id, b"torque", h5py.h5t.STD_I32LE, space, plan)


def billions_of_rows(file: Any, _: Path) -> None:
    for dataset in file["entry/data"].values():
        dataset.resize((4_000_000_000,))


def a_few_rows_never_stored(file: Any, _: Path) -> None:
    for dataset in file["entry/data"].values():
        dataset.resize((ROWS + 2000,))


def absurd_chunk(file: Any, _: Path) -> None:
    group = _instead(file, TORQUE)
    group.create_dataset("torque", (ROWS,), np.int32, chunks=(1 << 28,), maxshape=(None,))


def absurd_scalar(file: Any, _: Path) -> None:
    group = _instead(file, "entry/sample/ratio")
    group.create_dataset("ratio", (1 << 40,), np.float64)


def absurd_attribute(file: Any, _: Path) -> None:
    file["entry"].attrs["note"] = np.zeros(100_000)


def absurd_number_of_attributes(file: Any, _: Path) -> None:
    for index in range(100):
        file["entry"].attrs[f"a{index}"] = index


def contiguous_column(file: Any, _: Path) -> None:
    group = _instead(file, TORQUE)
    group.create_dataset("torque", data=np.zeros(ROWS, np.int32))


def two_dimensions(file: Any, _: Path) -> None:
    group = _instead(file, TORQUE)
    group.create_dataset("torque", data=np.zeros((ROWS, 2), np.int32), chunks=(64, 2))


def texts_without_length(file: Any, _: Path) -> None:
    group = _instead(file, "entry/title")
    group.create_dataset("title", data="title", dtype=h5py.string_dtype())


def named_type(file: Any, _: Path) -> None:
    file["entry/type"] = np.dtype("f8")


def deep(file: Any, _: Path) -> None:
    file.create_group("entry/a/b/c/d/e/f")


def bomb(file: Any, _: Path) -> None:
    """Chunks that unpack to far more than a chunk."""
    import zlib

    data = file[TORQUE]
    data.id.write_direct_chunk((0,), zlib.compress(bytes(200_000_000), 9), 0)


HOSTILE: dict[Callable[[Any, Path], None], str] = {
    virtual: "is put together from other datasets",
    external: "lies in another file",
    external_link: "is a link that points elsewhere",
    soft_link: "is a link that points elsewhere",
    second_name: "has a second name",
    group_in_itself: "has a second name",
    unknown_filter: "filters that no run uses",
    packed_twice: "filters that no run uses",
    billions_of_rows: "has more rows than its file can hold",
    a_few_rows_never_stored: "has rows that were never stored",
    absurd_chunk: "has chunks of absurd size",
    absurd_scalar: "is larger than its file",
    absurd_attribute: "larger than any attribute",
    absurd_number_of_attributes: "more attributes",
    contiguous_column: "is a column that is not in chunks",
    two_dimensions: "has more than one dimension",
    texts_without_length: "has a type that no run uses",
    named_type: "neither a group nor a dataset",
    deep: "lies deeper",
    bomb: "larger packed than unpacked",
}


@pytest.mark.parametrize("build", HOSTILE, ids=lambda build: build.__name__)
def test_what_no_run_is_built_of_is_refused_before_it_is_read(
    tmp_path: Path, build: Callable[[Any, Path], None]
) -> None:
    path = write_run(tmp_path, ROWS)
    with edit(path) as file:
        build(file, tmp_path)
    reseal(path)
    for digest in (True, False):
        with pytest.raises(RunFileError, match=HOSTILE[build]):
            open_run(path, digest=digest)
    assert HOSTILE[build] in next(f.found for f in verify_run(path) if f.what == "readable")
    # As a file whose writer was killed: its columns may be a little ahead of what is stored, no more.
    if build is not a_few_rows_never_stored:
        part = path.rename(part_path(tmp_path / "00002-friction-A1.h5"))
        with pytest.raises(RunFileError, match=HOSTILE[build]):
            recover_run(part)


def test_the_list_of_runs_names_it(tmp_path: Path) -> None:
    path = write_run(tmp_path, ROWS)
    with edit(path) as file:
        billions_of_rows(file, tmp_path)
    (listed,) = LibraryIndex(tmp_path).search()
    assert "has more rows than its file can hold" in listed.problem


def test_shared_chunks_make_no_rows(tmp_path: Path) -> None:
    """Entries of the index that all point at one chunk: many rows out of few bytes."""
    path = tmp_path / "x.h5"
    with h5py.File(path, "w", libver="earliest") as file:
        rows = file.create_dataset("entry/data/torque", (60 * 8192,), np.int64, chunks=(8192,))
        rows[:] = 1
        places = [rows.id.get_chunk_info(index).byte_offset for index in range(60)]
    raw = bytearray(path.read_bytes())
    for place in places[1:]:
        at = raw.index(place.to_bytes(8, "little"))
        raw[at : at + 8] = places[0].to_bytes(8, "little")
    end = places[0] + 8192 * 8
    raw[40:48] = end.to_bytes(8, "little")
    path.write_bytes(raw[:end])
    with h5py.File(path) as file:
        assert cast(Any, file["entry/data/torque"])[-1] == 1
        with pytest.raises(RunFileError, match="stores more than the file holds"):
            refuse_foreign_structure(file, grows=False)


@pytest.mark.parametrize("compress", [True, False], ids=["while writing", "at the end"])
def test_constant_channels_are_an_honest_run(tmp_path: Path, compress: bool) -> None:
    """As far as rows of a run can be packed: everything stands still, and time goes by in even steps."""
    from drivers.samples import SampleBlock

    writer = RunWriter(tmp_path / "1-x-y.h5", header(), compress=compress)
    for first in range(0, 200_000, 50_000):
        cycles = np.arange(first, first + 50_000)
        counts = np.zeros((50_000, len(CHANNELS)), np.int64)
        writer.append(SampleBlock(first, cycles * 1024, counts, np.zeros(50_000, np.uint16)))
    path = writer.seal("COMPLETED")
    recording = open_run(path)
    assert recording.rows == 200_000
    close_recording(recording)
    with h5py.File(path) as file:
        ratios = {
            name: dataset.size * dataset.dtype.itemsize / dataset.id.get_storage_size()
            for name, dataset in cast(Any, file["entry/data"]).items()
        }
    assert 100.0 < max(ratios.values()) < LARGEST_RATIO / 1.4
    assert ratios["time"] < LARGEST_TIME_RATIO / 2.0


def test_a_file_that_grows_is_examined_and_followed(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path / "1-x-y.h5", header(), compress=False, chunk_rows=64)
    for first in range(0, 600, 50):
        writer.append(block(first, 50))
        writer.flush()
        recording = open_run(writer.part)
        assert recording.rows == first + 50
        close_recording(recording)
    writer.abandon()


def test_a_file_that_grows_while_it_is_examined_is_no_damaged_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Between the look at its size and that at its chunks the writer goes on: then these lie beyond that size."""
    writer = RunWriter(tmp_path / "1-x-y.h5", header(), compress=False, chunk_rows=64)
    writer.append(block(0, 50))
    writer.flush()
    check, first = structure._check_attributes, iter((50,))

    def going_on(path: str, item: Any) -> None:
        for begin in first:
            for row in range(begin, 2000, 50):
                writer.append(block(row, 50))
            writer.flush()
        check(path, item)

    monkeypatch.setattr(structure, "_check_attributes", going_on)
    recording = open_run(writer.part)
    assert recording.rows >= 50
    close_recording(recording)
    writer.abandon()
