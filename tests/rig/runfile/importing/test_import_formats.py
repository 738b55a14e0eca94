"""Files of every kind come to the same channels: packed text, NumPy, HDF5, JSON, cell arrays; and damaged ones."""

import gzip
import json
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.io

from experiments.recording import Recording
from rig.errors import RigError, RunFileError
from rig.runfile.importing.adapters.arrays import ArrayTable
from rig.runfile.importing.adapters.table import split_heading
from rig.runfile.importing.adapters.text_form import TextForm
from rig.runfile.importing.channel_map import ImportOptions
from rig.runfile.importing.channel_source import parse_channel
from rig.runfile.importing.convert import import_tables
from rig.runfile.importing.opening import open_table
from rig.runfile.read import open_run
from tests.rig.importing import DEGREES, TIME, TORQUES, table

CHANNELS = ("time={}:s", "input_angle={}:deg", "torque={}:N m")


def bring(kind: str, path: Path, *columns: str, **changes: object) -> Recording:
    channels = (text.format(c) for text, c in zip(CHANNELS, columns, strict=True))
    options = ImportOptions(channels=tuple(map(parse_channel, channels)), **changes)  # type: ignore[arg-type]
    run = path.with_name("00001-import-x.h5")
    return open_run(
        import_tables(
            (open_table(kind, path, options.form_of(path, 1)),), options, lambda: run
        ).path
    )


def same(recording: Recording) -> None:
    np.testing.assert_allclose(recording.time(), TIME, atol=1e-12)
    np.testing.assert_allclose(recording.si("input_angle"), np.radians(DEGREES), rtol=1e-14)
    np.testing.assert_array_equal(recording.si("torque"), TORQUES)


def test_packed_text(tmp_path: Path) -> None:
    path = tmp_path / "bench.csv.gz"
    path.write_bytes(gzip.compress(table().encode()))
    same(bring("csv", path, "t", "Position", "M"))
    path.write_bytes(path.read_bytes()[:-12])
    with pytest.raises(RunFileError, match=r"damaged|cannot be read"):
        bring("csv", path, "t", "Position", "M")


def test_numpy_arrays_matrices_and_tables(tmp_path: Path) -> None:
    path = tmp_path / "bench.npz"
    both = np.column_stack([DEGREES, TORQUES])
    fields = np.zeros(len(TIME), dtype=[("clock", "f8"), ("word", "S3")])
    fields["clock"] = TIME
    np.savez(path, both=both, log=fields)
    same(bring("npz", path, "log.clock", "both#1", "both#2"))
    np.save(tmp_path / "one.npy", np.column_stack([TIME, both]))
    (tmp_path / "00001-import-x.h5").unlink()
    same(bring("npz", tmp_path / "one.npy", "one#1", "one#2", "one#3"))


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04rubbish", b"\x93NUMPY"])
def test_numpy_files_that_are_none(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "bench.npz"
    path.write_bytes(content)
    with pytest.raises(RunFileError, match=r"bench\.npz"):
        bring("npz", path, "a", "b", "c")


def test_numpy_objects_are_never_executed(tmp_path: Path) -> None:
    path = tmp_path / "bench.npz"
    np.savez(path, a=np.array([{"x": 1}], dtype=object))
    with pytest.raises(RunFileError, match="not a readable NumPy file"):
        bring("npz", path, "a", "b", "c")


def test_hdf5_by_path_with_the_units_of_its_attributes(tmp_path: Path) -> None:
    path = tmp_path / "bench.h5"
    with h5py.File(path, "w") as file:
        file["run/clock"] = TIME
        file["run/log"] = np.column_stack([DEGREES, TORQUES])
        file["run/q"] = DEGREES
        file["run/q"].attrs["units"] = "deg"
    same(bring("hdf5", path, "run/clock", "run/log#1", "run/log#2"))
    options = ImportOptions(channels=(parse_channel("input_angle=run/q"),), rate=500.0)
    run = tmp_path / "00002-import-x.h5"
    made = import_tables((open_table("hdf5", path),), options, lambda: run)
    np.testing.assert_allclose(open_run(made.path).si("input_angle"), np.radians(DEGREES))


def test_hdf5_files_that_lead_elsewhere_or_are_none(tmp_path: Path) -> None:
    path = tmp_path / "bench.h5"
    with h5py.File(path, "w") as file:
        file.create_dataset("a", (50,), np.float64, external=[("elsewhere.bin", 0, 400)])
    with pytest.raises(RunFileError, match="lies in other files"):
        open_table("hdf5", path)
    path.write_bytes(b"no hdf5")
    with pytest.raises(RunFileError, match="not a readable HDF5 file"):
        open_table("hdf5", path)
    with pytest.raises(RunFileError, match="no such file"):
        open_table("hdf5", tmp_path / "none.h5")


@pytest.mark.parametrize("form", ["lists", "columns", "by row", "split", "under a key"])
def test_a_table_in_json_as_people_write_it(tmp_path: Path, form: str) -> None:
    columns = {"t": list(TIME), "q": list(DEGREES), "M": list(TORQUES)}
    columns = {name: [float(v) for v in values] for name, values in columns.items()}
    rows = [list(row) for row in zip(*columns.values(), strict=True)]
    content: Any = {
        "lists": [["t", "q", "M"], *rows],
        "columns": {**columns, "mass": 0.49, "gains": [1.0, 2.0]},
        "by row": {k: {str(i): v for i, v in enumerate(vs)} for k, vs in columns.items()},
        "split": {"columns": ["t", "q", "M"], "index": list(range(len(rows))), "data": rows},
        "under a key": {"about": {"rig": 1, "limits": [1, 2, 3]}, "log": [["t", "q", "M"], *rows]},
    }[form]
    path = tmp_path / "log.json"
    path.write_text(json.dumps(content))
    assert open_table("json", path).headings == ("t", "q", "M")
    same(bring("json", path, "t", "q", "M"))


def test_columns_of_json_are_put_together_by_row_and_none_is_lost_without_a_word(
    tmp_path: Path,
) -> None:
    path = tmp_path / "log.json"
    by_row = {"t": {"0": 0.0, "1": 0.1, "2": 0.2}, "x": {"1": 5.0, "0": 4.0, "2": 6.0}}
    path.write_text(json.dumps(by_row))
    opened = open_table("json", path)
    assert isinstance(opened, ArrayTable)
    np.testing.assert_array_equal(opened._columns["x"], [4.0, 5.0, 6.0])
    del by_row["x"]["1"]
    path.write_text(json.dumps(by_row))
    opened = open_table("json", path)
    assert isinstance(opened, ArrayTable)
    np.testing.assert_array_equal(opened._columns["x"], [4.0, np.nan, 6.0])
    path.write_text(json.dumps({"t": [0.0, 0.1, 0.2], "x": [4.0, 5.0]}))
    opened = open_table("json", path)
    assert opened.headings == ("t",)
    assert "x: 2 values where other columns have 3, left out" in opened.notes


def test_rows_without_names_have_numbered_columns(tmp_path: Path) -> None:
    path = tmp_path / "log.json"
    path.write_text(json.dumps([[float(t), float(q)] for t, q in zip(TIME, DEGREES, strict=True)]))
    assert open_table("json", path).headings == ("column 1", "column 2")


@pytest.mark.parametrize(
    ("heading", "name", "unit"),
    [
        ("Torque [Nm]", "Torque", "Nm"),
        ("Torque (1)", "Torque (1)", ""),
        ("speed (rpm) (3)", "speed (3)", "rpm"),
        ("Torque (A.U.)", "Torque (A.U.)", ""),
        ("slip [1]", "slip", "1"),
        ("x [2]", "x (2)", ""),
        ("t (s)", "t", "s"),
    ],
)
def test_what_stands_in_brackets_and_is_no_unit(heading: str, name: str, unit: str) -> None:
    assert split_heading(heading) == (name, unit)


def test_a_log_in_json(tmp_path: Path) -> None:
    path = tmp_path / "log.json"
    rows = zip(TIME, DEGREES, TORQUES, strict=True)
    entries = [{"t": t, "q": q, "M": m, "on": True, "word": "x"} for t, q, m in rows]
    path.write_text(json.dumps({"mass": 0.49, "entries": entries}))
    opened = open_table("json", path)
    assert opened.headings == ("t", "q", "M", "on")
    assert any("mass 0.49" in note for note in opened.notes)
    same(bring("json", path, "t", "q", "M"))
    del entries[2]["M"]
    path.write_text(json.dumps(entries))
    with pytest.raises(RunFileError, match="row 3, column M: not finite"):
        bring("json", path, "t", "q", "M")
    path.write_text("[1, 2")
    with pytest.raises(RunFileError, match="is not JSON"):
        open_table("json", path)


def test_cell_arrays_of_matlab(tmp_path: Path) -> None:
    path = tmp_path / "x.mat"
    cells = np.empty((1, 2), dtype=object)
    cells[0, 0], cells[0, 1] = TIME, {"q": DEGREES, "M": TORQUES}
    scipy.io.savemat(path, {"log": cells})
    same(bring("mat", path, "log{1}", "log{2}.q", "log{2}.M"))


def test_cell_arrays_of_version_7_3(tmp_path: Path) -> None:
    path = tmp_path / "x.mat"
    with h5py.File(path, "w") as file:
        parts = [
            file.create_dataset(f"#refs#/{k}", data=a[None, :])
            for k, a in enumerate((TIME, DEGREES, TORQUES))
        ]
        log = file.create_dataset("log", (3, 1), dtype=h5py.ref_dtype)
        log[:, 0] = [part.ref for part in parts]
        log.attrs["MATLAB_class"] = np.bytes_("cell")
    same(bring("mat", path, "log{1}", "log{2}", "log{3}"))


def test_a_cell_array_that_holds_itself_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.mat"
    with h5py.File(path, "w") as file:
        log = file.create_dataset("log", (1, 2), dtype=h5py.ref_dtype)
        log[0] = [log.ref, log.ref]
        log.attrs["MATLAB_class"] = np.bytes_("cell")
    with pytest.raises(RigError, match="deeper than"):
        open_table("mat", path)


def test_skipped_lines_and_a_line_of_headings_by_number(tmp_path: Path) -> None:
    path = tmp_path / "bench.csv"
    path.write_text("a;b;c\n1;2;3\n4;5;6\n" + table(";"))
    with pytest.raises(RigError):
        bring("csv", path, "t", "Position", "M")
    same(bring("csv", path, "t", "Position", "M", header=4))
    (tmp_path / "00001-import-x.h5").unlink()
    same(bring("csv", path, "t", "Position", "M", skip=3))
    with pytest.raises(RigError, match="no line of headings; value 400"):
        open_table("csv", path, TextForm(header=400))


def test_decimal_marks_may_differ_between_columns(tmp_path: Path) -> None:
    path = tmp_path / "bench.csv"
    lines = table(";").splitlines()
    lines[1:] = [
        ";".join((a.replace(".", ","), b, c)) for a, b, c in (line.split(";") for line in lines[1:])
    ]
    path.write_text("\n".join(lines) + "\n")
    same(bring("csv", path, "t", "Position", "M"))


def test_separators_that_change_from_place_to_place(tmp_path: Path) -> None:
    path = tmp_path / "bench.csv"
    path.write_text(table(" ; ", head="t|q|M").replace(" ; ", ", ", 4).replace(", ", "\t", 1))
    same(bring("csv", path, "t", "q", "M", delimiter="any"))


def test_blank_lines_between_the_rows_are_no_rows(tmp_path: Path) -> None:
    path = tmp_path / "bench.csv"
    path.write_text(table().replace("\n", "\n\n"))
    same(bring("csv", path, "t", "Position", "M"))


def test_lines_that_end_early_only_where_that_is_said(tmp_path: Path) -> None:
    path = tmp_path / "bench.csv"
    path.write_text(table(head="t|q|M").strip() + "\n0.5,7.5\n")
    with pytest.raises(RunFileError, match="line 8: the line has 2 cells, the table 3"):
        bring("csv", path, "t", "q", "M")
    options = ImportOptions(channels=(parse_channel("torque=M:N m"),), rate=500.0, is_ragged=True)
    run = tmp_path / "00001-import-x.h5"
    made = import_tables((open_table("csv", path, options.form_of(path, 1)),), options, lambda: run)
    assert made.rows == len(TORQUES)
    assert any("ended at line 7" in note for note in made.notes)


def test_empty_cells_in_the_middle_are_holes_and_no_end(tmp_path: Path) -> None:
    path = tmp_path / "bench.csv"
    path.write_text("t,a,M\n0,1,0.5\n1,1,\n2,1,\n3,1,0.7\n")
    options = ImportOptions(channels=(parse_channel("torque=M:N m"),), rate=500.0)
    run = tmp_path / "00001-import-x.h5"
    with pytest.raises(
        RunFileError, match=r"line 3: the cells are empty, and rows follow; value 2 such"
    ):
        import_tables((open_table("csv", path),), options, lambda: run)
