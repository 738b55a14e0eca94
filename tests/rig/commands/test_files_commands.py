"""`rig runs`, `show`, `export`, `import`, `recover`, `verify` as people and programs call them."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from model.units import DEGREE
from rig.runfile.read import close_recording, open_run
from rig.runfile.write import RunWriter
from tests.rig.commands.calling import Rig
from tests.rig.runfile.making import CHANNELS, CYCLE_NS, block, counts_of, header, write_run

RUN = "00001-friction-A1.h5"
ROWS = 250


@pytest.fixture(autouse=True)
def _in_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "160")
    monkeypatch.delenv("HARMONIC_RIG_DEBUG", raising=False)


@pytest.fixture
def rig(capsys: pytest.CaptureFixture[str]) -> Rig:
    return Rig(capsys)


@pytest.fixture
def run(tmp_path: Path) -> Path:
    return write_run(tmp_path, ROWS)


def dead_run(folder: Path, rows: int = 70) -> Path:
    """What a writer left behind that died after a flush."""
    writer = RunWriter(folder / "00002-friction-A1.h5", header("00002-friction-A1"))
    writer.append(block(0, rows))
    writer.flush()
    writer.abandon()
    return writer.part


def si() -> dict[str, np.ndarray]:
    counts = counts_of(np.arange(ROWS))
    return {channel.name: channel.to_si(counts[:, index]) for index, channel in enumerate(CHANNELS)}


def test_show(rig: Rig, run: Path) -> None:
    found = rig.json("show", run)
    assert (found["run"], found["protocol"], found["origin"], found["outcome"]) == (
        "00001-friction-A1",
        "friction",
        "simulated",
        "COMPLETED",
    )
    assert (found["rows"], found["sample_rate"], found["operator"]) == (ROWS, 1000.0, "Ada Grün")
    assert found["parameters"] == {"speeds_rpm": [1.0, 2.5], "repeats": 2, "note": "τ"}
    for channel, values in zip(found["channels"], si().values(), strict=True):
        assert channel["minimum"] == pytest.approx(values.min(), rel=1e-14)
        assert channel["maximum"] == pytest.approx(values.max(), rel=1e-14)
    assert [(s["start"], s["stop"], s["direction"]) for s in found["segments"]] == [
        (0, 125, 1),
        (125, 250, -1),
    ]
    assert found["events"][0]["text"] == "Öl nachgefüllt"
    assert rig("show", run) == 0
    for word in (
        "00001-friction-A1",
        "SIMULATED",
        "input_angle",
        "hold",
        "Öl nachgefüllt",
        "Ada Grün",
    ):
        assert word in rig.out


def test_runs(rig: Rig, run: Path, tmp_path: Path) -> None:
    (tmp_path / "00003-broken-A1.h5").write_bytes(b"no run at all")
    part = dead_run(tmp_path)
    found = rig.json("runs", tmp_path)["runs"]
    assert [Path(entry["file"]).name for entry in found] == [
        run.name,
        part.name,
        "00003-broken-A1.h5",
    ]
    assert found[0]["outcome"] == "COMPLETED"
    assert found[0]["verdict"] == "NOT JUDGED"
    assert found[0]["because"] == [f"the run is not analysed: rig fit {run}"]
    assert found[1]["verdict"] is None
    assert (found[0]["rows"], found[0]["unfinished"]) == (ROWS, False)
    assert found[0]["duration_s"] == pytest.approx((ROWS - 1) * 1e-3, abs=2e-3)
    assert (found[1]["rows"], found[1]["unfinished"]) == (70, True)
    assert "HDF5" in found[2]["problem"] or "run file" in found[2]["problem"]
    assert rig("runs", tmp_path) == 0
    for word in (run.stem, "COMPLETED", "SIMULATED", "unfinished", "unreadable"):
        assert word in rig.out


def test_the_list_of_runs_fits_eighty_columns(
    rig: Rig, run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert rig("runs", run.parent) == 0
    lines = rig.out.splitlines()
    assert max(map(len, lines)) <= 80
    (row,) = [line for line in lines if run.stem in line]
    assert "COMPLETED" in row
    assert "NOT JUDGED" in row


def test_runs_of_an_empty_folder_and_of_none(rig: Rig, tmp_path: Path) -> None:
    assert rig.json("runs", tmp_path)["runs"] == []
    assert rig("runs", tmp_path) == 0
    assert "No runs" in rig.out
    assert rig("runs", tmp_path / "nowhere") == 6
    assert "nowhere" in rig.err


@pytest.mark.parametrize("command", ["show", "export"])
def test_a_run_that_is_none(rig: Rig, tmp_path: Path, command: str) -> None:
    assert rig(command, tmp_path / "nowhere.h5") == 6
    assert "nowhere.h5" in rig.err
    (tmp_path / "x.h5").write_bytes(b"no run at all")
    assert rig(command, tmp_path / "x.h5", "--json") == 6
    assert "x.h5" in rig.err
    assert json.loads(rig.out)["error"]["kind"] == "RunFileError"
    assert not list(tmp_path.glob("*.csv"))


def test_export_csv_round_trip(rig: Rig, run: Path) -> None:
    made = rig.json("export", run)
    assert made == {
        "run": "00001-friction-A1",
        "file": str(run.with_suffix(".csv")),
        "format": "csv",
        "rows": ROWS,
    }
    lines = run.with_suffix(".csv").read_text(encoding="utf-8").splitlines()
    head = [line for line in lines if line.startswith("#")]
    assert "SIMULATED" in head[0]
    assert "not measurements" in head[1]
    names, *rows = list(csv.reader(lines[len(head) :]))
    assert names == ["time [s]", *(f"{c.name} [{c.unit}]" for c in CHANNELS), "flags", "segment"]
    values = np.array(rows, dtype=np.float64)
    np.testing.assert_allclose(values[:, 0], np.arange(ROWS) * CYCLE_NS * 1e-9, atol=1e-12)
    longest = 0
    for index, (channel, expected) in enumerate(zip(CHANNELS, si().values(), strict=True), 1):
        # Rounded to a tenth of a count: every count can be told again, and no digit claims more.
        np.testing.assert_allclose(values[:, index], expected, atol=0.0501 * abs(channel.scale))
        longest = max(
            longest, *(len(row[index].partition(".")[2]) for row in rows if "e" not in row[index])
        )
    assert longest <= 9
    np.testing.assert_array_equal(values[:, -2], np.where(np.arange(ROWS) % 97 == 0, 1, 0))
    np.testing.assert_array_equal(values[:, -1], np.repeat([0, 1], ROWS // 2))


def test_export_mat_round_trip(rig: Rig, run: Path, tmp_path: Path) -> None:
    target = tmp_path / "out.mat"
    assert rig.json("export", run, "--format", "mat", "-o", target)["rows"] == ROWS
    content = scipy.io.loadmat(target, simplify_cells=True)
    for name, expected in si().items():
        np.testing.assert_array_equal(content[name], expected)
    np.testing.assert_allclose(content["time"], np.arange(ROWS) * 1e-3, atol=1e-12)
    assert content["run"]["origin"] == "SIMULATED"
    assert "SIMULATED" in content["run"]["description"]
    assert content["run"]["operator"] == "Ada Grün"
    assert content["units"]["torque"] == "N m"
    assert content["segments"]["first_row"].tolist() == [1.0, 126.0]
    assert content["segments"]["last_row"].tolist() == [125.0, 250.0]


def test_an_export_is_read_by_pandas_with_its_title(rig: Rig, run: Path, tmp_path: Path) -> None:
    pandas = pytest.importorskip("pandas")
    parquet = pytest.importorskip("pyarrow.parquet")
    text, binary = tmp_path / "out.csv", tmp_path / "out.parquet"
    assert rig("export", run, "-o", text) == 0
    assert rig("export", run, "-o", binary) == 0
    frame = pandas.read_csv(text, comment="#")
    whole = parquet.read_table(binary)
    assert list(frame.columns) == whole.column_names
    for name in frame.columns:
        np.testing.assert_allclose(frame[name], whole.column(name).to_numpy(), rtol=0.0, atol=1e-12)
    assert "SIMULATED" in whole.schema.metadata[b"description"].decode()
    assert rig("export", run, "-o", binary) == 6
    assert "is there already" in rig.err


@pytest.mark.parametrize("fmt", ["csv", "mat", "parquet"])
def test_export_and_import_again(rig: Rig, run: Path, tmp_path: Path, fmt: str) -> None:
    if fmt == "parquet":
        pytest.importorskip("pyarrow")
    assert rig("export", run, "--format", fmt) == 0
    assert f"{ROWS} rows" in rig.out
    made = rig.json(
        "import",
        fmt,
        run.with_suffix(f".{fmt}"),
        "-c",
        "time=time:s",
        "-c",
        "torque=torque:N m",
        "-o",
        tmp_path / "in",
    )
    recording = open_run(Path(made["run"]), verify=True)
    scale = next(channel.scale for channel in CHANNELS if channel.name == "torque")
    rounding = 0.0 if fmt == "mat" else 0.0501 * abs(scale)
    np.testing.assert_allclose(recording.si("torque"), si()["torque"], rtol=0.0, atol=rounding)
    assert recording.metadata.origin == "imported"
    close_recording(recording)
    assert rig("export", made["run"], "--format", "csv") == 0
    assert (
        "IMPORTED"
        in Path(made["run"]).with_suffix(".csv").read_text(encoding="utf-8").splitlines()[0]
    )


def test_export_never_overwrites_unasked(rig: Rig, run: Path, tmp_path: Path) -> None:
    target = tmp_path / "kept.csv"
    target.write_text("mine")
    assert rig("export", run, "-o", target) == 6
    assert "--force" in rig.err
    assert target.read_text() == "mine"
    assert rig("export", run, "-o", target, "--force") == 0
    assert target.read_text(encoding="utf-8").startswith("# harmonic-rig export")
    assert rig("export", run, "-o", tmp_path / "nowhere" / "x.csv") == 6
    assert "x.csv" in rig.err
    assert not list(tmp_path.glob(".*.tmp"))
    assert rig("export", run, "--format", "xls") == 2


def test_export_of_a_dead_run(rig: Rig, tmp_path: Path) -> None:
    part = dead_run(tmp_path)
    assert rig.json("export", part)["rows"] == 70
    assert (tmp_path / "00002-friction-A1.csv").is_file()


def test_import(rig: Rig, tmp_path: Path) -> None:
    source = tmp_path / "bench.csv"
    source.write_text(
        "t [ms];q [deg];M\n0;1,5;0,1\n1;2,5;0,2\n2;x;0,3\n3;4,5;0,4\n", encoding="utf-8"
    )
    words = (
        "import",
        "csv",
        source,
        "-c",
        "time=t",
        "-c",
        "input_angle=q",
        "-c",
        "torque=M:N m",
        "-o",
        tmp_path / "runs",
    )
    assert rig(*words) == 6
    for word in ("bench.csv", "line 4", "q [deg]", "'x'", "--drop-bad-rows"):
        assert word in rig.err
    made = rig.json(
        *words, "--drop-bad-rows", "--gear", "B7", "--ratio", "100", "--operator", "Ada"
    )
    assert (made["rows"], made["rows_left_out"]) == (3, 1)
    assert any("line 4" in note for note in made["notes"])
    shown = rig.json("show", made["run"])
    assert (shown["origin"], shown["gear_serial"], shown["ratio"], shown["operator"]) == (
        "imported",
        "B7",
        100.0,
        "Ada",
    )
    assert shown["channels"][0]["maximum"] == pytest.approx(4.5 * DEGREE)
    assert rig(*words, "--drop-bad-rows") == 0
    assert "IMPORTED" in rig.out
    assert "1 rows left out" in rig.out
    numbers = [
        Path(entry["file"]).name[:5] for entry in rig.json("runs", tmp_path / "runs")["runs"]
    ]
    assert len(set(numbers)) == 2


@pytest.mark.parametrize(
    "words",
    [
        ("-c", "x"),
        ("-c", "torque=M:furlong"),
        ("-c", "torque=7:N m"),
        (),
        ("-c", "torque=M:N m", "--ratio", "0"),
        ("-c", "torque=M:N m", "--ratio", "nan"),
        ("-c", "torque=M:N m", "--rate", "-1"),
        ("-c", "torque=M:N m", "--map", "nowhere.toml"),
        ("-c", "torque=M:N m", "--start", "yesterday"),
        ("-c", "torque=M:N m", "--mounting", "upside-down"),
        ("-c", "torque=M"),
    ],
)
def test_an_import_that_is_asked_for_wrongly(
    rig: Rig, tmp_path: Path, words: tuple[str, ...]
) -> None:
    (tmp_path / "bench.csv").write_text("t,M\n0,1\n1,2\n2,3\n")
    assert rig("import", "csv", "bench.csv", "-c", "time=t:s", "-o", "runs", *words) == 2
    assert rig.err
    assert "Traceback" not in rig.err
    assert not list(tmp_path.glob("runs/*"))


def test_recover(rig: Rig, tmp_path: Path) -> None:
    part = dead_run(tmp_path)
    (found,) = rig.json("recover", part)["recovered"]
    assert (found["rows"], found["outcome"]) == (70, "INTERRUPTED")
    assert Path(found["run"]).name == "00002-friction-A1.h5"
    assert rig.json("show", found["run"])["outcome"] == "INTERRUPTED"
    recording = open_run(Path(found["run"]), verify=True)
    np.testing.assert_array_equal(recording.stored("torque"), counts_of(np.arange(70))[:, 2])
    close_recording(recording)
    assert rig("recover", tmp_path / "nowhere.h5.part") == 6
    assert "nowhere" in rig.err


def test_recover_takes_all_parts_of_a_folder_and_one_stops_no_other(
    rig: Rig, tmp_path: Path
) -> None:
    inner = tmp_path / "inner"
    inner.mkdir()
    dead = dead_run(inner)
    before = dead.read_bytes()
    damaged = tmp_path / "00001-a-b.h5.part"
    damaged.write_bytes(before[: len(before) // 2])
    (tmp_path / "00003-a-b.h5.part").touch()
    living = RunWriter(tmp_path / "00004-a-b.h5", header())
    assert rig("recover", tmp_path, "--json") == 6
    told = json.loads(rig.out)
    living.abandon()
    gone, run = sorted(told["recovered"], key=lambda found: found["rows"])
    assert (gone["removed"], run["rows"], run["rows_unread"]) == (True, 70, 0)
    assert Path(run["kept"]).read_bytes() == before
    (refused,) = told["refused"]
    assert refused["part"] == str(damaged)
    assert refused["error"]["message"]
    assert "left as it is" in rig.err
    assert damaged.exists()
    assert told["being_written"] == [str(living.part)]
    damaged.unlink()
    living.part.unlink()
    assert rig("recover", tmp_path) == 0
    assert "Nothing to recover" in rig.out
    assert rig("recover", tmp_path / "nowhere") == 6


def test_recover_says_so(rig: Rig, tmp_path: Path) -> None:
    assert rig("recover", dead_run(tmp_path)) == 0
    assert "70 rows recovered" in rig.out
    assert ".part.kept, byte for byte" in rig.out
    assert "INTERRUPTED" in rig.out


def test_verify(rig: Rig, run: Path, tmp_path: Path) -> None:
    found = rig.json("verify", run)
    assert found["trusted"] is True
    (entry,) = found["runs"]
    levels = {finding["check"]: finding["level"] for finding in entry["findings"]}
    assert levels["hash"] == levels["rows"] == levels["time"] == levels["sequence"] == "ok"
    assert levels["flags"] == "warning"
    assert rig("verify", run) == 0
    assert "SHA-256" in rig.out


def test_verify_of_a_changed_run(rig: Rig, run: Path, tmp_path: Path) -> None:
    whole = run.read_bytes()
    run.chmod(0o644)
    run.write_bytes(whole[:-1] + bytes([whole[-1] ^ 1]))
    found = rig.json("verify", run, code=6)
    assert found["trusted"] is False
    assert any(f["check"] == "hash" and f["level"] == "error" for f in found["runs"][0]["findings"])
    assert rig("verify", run) == 6
    assert "was changed" in rig.out
    assert rig.json("verify", run, tmp_path / "nowhere.h5", code=6)["trusted"] is False
