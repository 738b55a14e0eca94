"""The parts of a fleet: batches, crew, data set, questions, progress."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, date, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from rig.errors import ConfigurationError, RigError, RunFileError
from rig.extras import require
from rig.fleet import engine
from rig.fleet.dataset import DataSet
from rig.fleet.engine import Batches, BatchTask, Workforce, at_work
from rig.fleet.progress import Progress
from rig.fleet.questions import QUESTIONS, ask, results_folder
from rig.fleet.results import COLUMNS, NAMES, SCHEMA_VERSION, Row, arrow_schema
from rig.fleet.rows import EMPTY
from rig.fleet.table import table_bytes
from rig.fleet.task import Job
from rig.fleet.work import PathMap, runs_named, work_for
from rig.library.index import LibraryIndex
from tests.extras.lots import write_lot
from tests.rig.commands.calling import Rig
from tests.rig.commands.printed import Printed, tables_of

BATCH = 2.0


@dataclass(frozen=True)
class Toy:
    """A piece of work."""

    name: int
    kind: str = "toy"


@dataclass(frozen=True)
class Toys:
    """What came of some toys."""

    names: tuple[int, ...]
    lost: str = ""
    seconds: float = 1.0


def play(toys: Sequence[Toy]) -> Toys:
    if any(toy.name == 3 for toy in toys):
        raise MemoryError("three is too much")
    return Toys(tuple(toy.name for toy in toys))


def lose(toy: Toy, reason: str) -> Toys:
    return Toys((toy.name,), reason)


def row(**values: Any) -> Row:
    told = {
        "run_file": "a.h5",
        "kind": "friction",
        "quantity": "coulomb",
        "unit": "N",
        "is_metric": False,
        "identifiable": "yes",
        "outcome": "COMPLETED",
        "verdict": "",
        "surroundings": "s",
        "key": "k",
    }
    return EMPTY | told | values


def keep(folder: Path, *batches: list[Row]) -> DataSet:
    data = DataSet(folder)
    with data.writing():
        for rows in batches:
            data.append(table_bytes(rows))
    return data


def production(gears: int = 40) -> list[Row]:
    """Gears whose Coulomb force is 60 N + 0.1 N per gear, 5 N more on bench B, + 1 N a day; 61.9 N is the limit."""
    rows = []
    start = datetime(2026, 1, 5, 8, tzinfo=UTC)
    for gear in range(gears):
        bench, day = "AB"[gear % 2], gear // 4
        value = 60.0 + 0.1 * (gear % 4) + (5.0 if bench == "B" else 0.0) + day
        verdict = "PASS" if value < 61.0 else "FAIL" if value > 62.8 else "MARGINAL"
        told = {"gear": f"G{gear}", "bench": bench, "value": value, "expanded_uncertainty": 0.9}
        when = {
            "started": start + timedelta(days=day),
            "day": date(2026, 1, 5) + timedelta(days=day),
        }
        limit = {"limit_value": 61.9, "limit_is": "upper", "upper_limit": 61.9, "verdict": verdict}
        rows.append(row(run_file=f"{gear:05d}.h5", **told, **when, **limit))
    return rows


def test_batches_grow_and_shrink_with_what_their_kind_takes() -> None:
    batches = Batches([Toy(k) for k in range(40)] + [Toy(k, "long") for k in range(4)], BATCH)
    first = batches.take()
    assert len(first) == 4, "half a second each is the first guess"
    batches.learn(first, 0.5)
    second = batches.take()
    assert len(second) == 16
    batches.learn(second, 4.0)
    third = batches.take()
    assert len(third) == 10, "half of what was thought, half of what was seen"
    mixed = [*batches.take(), *batches.take()]
    assert [toy.kind for toy in mixed] == ["toy"] * 10 + ["long"] * 4
    assert not batches
    batches.suspect(third[:2])
    assert [len(batches.take()) for _ in range(2)] == [1, 1]


def test_batches_are_longer_where_workers_are_many() -> None:
    batches = Batches([Toy(k) for k in range(100)], BATCH)
    for threads, runs in ((2, 4), (100, 4), (1000, 40), (2, 4)):
        batches.suit(threads)
        assert len(batches.take()) == runs


def test_a_piece_that_no_worker_survives_is_told_and_the_others_are_done(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from distributed import LocalCluster

    options: dict[str, Any] = {
        "processes": False,
        "dashboard_address": "127.0.0.1:0",
        "memory_limit": 0,
    }
    with LocalCluster(n_workers=1, threads_per_worker=1, **options) as cluster:
        local: Any = cluster
        crew = Workforce(scheduler=local.scheduler_address)
        with at_work(crew) as hands:
            toys = [Toy(k) for k in range(10)]
            found = [outcome for _, outcome in hands.outcomes(BatchTask(play, lose), toys)]
    assert sorted(name for outcome in found for name in outcome.names) == list(range(10))
    [lost] = [outcome for outcome in found if outcome.lost]
    assert lost.names == (3,)
    assert "three is too much" in lost.lost


def test_a_crew_is_processes_or_a_cluster() -> None:
    assert Workforce().is_this_process
    for wrong in ({"workers": -1}, {"workers": 2, "scheduler": "tcp://host:8786"}):
        with pytest.raises(ConfigurationError, match="is no crew"):
            Workforce(**wrong)  # type: ignore[arg-type]


def test_workers_keep_no_profile_by_which_they_would_grow(monkeypatch: pytest.MonkeyPatch) -> None:
    from dask import config

    """What is set while processes are made goes to them: dask hands its settings on."""
    seen: list[bool] = []

    class Made(RuntimeError):
        pass

    def make(**options: object) -> object:
        seen.append(bool(config.get("distributed.worker.profile.enabled")))
        raise Made

    monkeypatch.setattr("distributed.LocalCluster", make)
    with pytest.raises(Made), engine.cluster(1):
        pass
    assert seen == [False]


def test_a_scheduler_that_does_not_answer_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engine, "CONNECT_TIMEOUT", "50ms")
    with (
        pytest.raises(RigError, match="no scheduler answers"),
        engine.cluster(0, "tcp://127.0.0.1:1"),
    ):
        pass


def test_what_is_not_installed_is_told_with_the_line_that_installs_it() -> None:
    with pytest.raises(RigError, match=r"pip install 'harmonic-rig\[fleet\]'"):
        require("a fleet of runs", "fleet", "pyarrow", "no_such_package")


def test_the_newest_rows_of_a_run_count_and_the_files_become_one(tmp_path: Path) -> None:
    old, new = row(value=1.0), row(value=2.0, key="other")
    other = row(run_file="b.h5", value=5.0)
    data = keep(tmp_path, [old, other], [new])
    assert data.known()["a.h5", "friction"].key == "other"
    assert data.has_renewed_rows()
    values = "SELECT run_file, value FROM results ORDER BY run_file"
    expected = [("a.h5", 2.0), ("b.h5", 5.0)]
    assert ask(tmp_path, values).rows == expected
    assert data.table()["value"].to_pylist() == [2.0, 5.0]
    with data.writing():
        data.put_together({("b.h5", "friction"): "t"})
    assert len(data.parts()) == 1
    assert not data.has_renewed_rows()
    assert ask(tmp_path, values).rows == expected
    assert data.known()["b.h5", "friction"].surroundings == "t"


def test_files_that_were_half_put_together_say_the_same(tmp_path: Path) -> None:
    data = keep(tmp_path, [row(value=1.0)], [row(run_file="b.h5", value=5.0)])
    before = (tmp_path / "part-00000001.parquet").read_bytes()
    with data.writing():
        data.put_together({})
    (tmp_path / "part-00000001.parquet").write_bytes(before)
    assert data.table()["value"].to_pylist() == [1.0, 5.0]


def test_a_run_whose_kind_could_not_be_read_is_not_told_twice(tmp_path: Path) -> None:
    unreadable = row(kind="", quantity="", failure="cut off", failure_kind="RunFileError")
    data = keep(tmp_path, [unreadable], [row(value=1.0)])
    assert list(data.known()) == [("a.h5", "friction")]
    assert data.table()["value"].to_pylist() == [1.0]


def test_a_file_of_another_schema_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "part-00000001.parquet"
    schema = arrow_schema().with_metadata({"harmonic-rig-fleet-schema": str(SCHEMA_VERSION + 1)})
    pq.write_table(schema.empty_table(), path)
    with pytest.raises(RunFileError, match=f"version {SCHEMA_VERSION + 1}"):
        DataSet(tmp_path).known()
    path.write_bytes(b"no table")
    with pytest.raises(RunFileError, match="is no Parquet file"):
        DataSet(tmp_path).known()


def test_other_programs_read_the_results(tmp_path: Path) -> None:
    import duckdb

    pandas = pytest.importorskip("pandas")
    keep(tmp_path, production())
    frame = pandas.read_parquet(tmp_path)
    assert list(frame.columns) == list(NAMES)
    assert frame["value"].sum() == pytest.approx(sum(r["value"] for r in production()))
    assert str(frame["started"].dtype).startswith("datetime64")
    counted = f"SELECT count(*) FROM '{tmp_path}/*.parquet' WHERE bench = 'A'"
    assert duckdb.execute(counted).fetchall() == [(20,)]
    meanings = {
        f.name: f.metadata[b"meaning"].decode()
        for f in pq.read_schema(next(tmp_path.glob("*.parquet")))
    }
    assert meanings == {column.name: column.meaning for column in COLUMNS}


def answers(folder: Path, question: str) -> list[dict[str, Any]]:
    answer = ask(folder, question)
    return [dict(zip(answer.columns, values, strict=True)) for values in answer.rows]


def test_the_ready_questions(tmp_path: Path) -> None:
    rows = production()
    undetermined = row(run_file="x.h5", value=900.0, identifiable="no", bench="A", gear="X")
    broken_off = row(run_file="y.h5", value=900.0, outcome="TRIPPED", bench="A", gear="Y")
    limit = {"limit_value": 61.9, "limit_is": "upper", "upper_limit": 61.9, "verdict": "NOT JUDGED"}
    keep(tmp_path, [*rows, undetermined | limit, broken_off])
    values = np.array([r["value"] for r in rows])
    [spread] = answers(tmp_path, "spread")
    assert (spread["gears"], spread["runs"]) == (40, 40)
    assert spread["mean"] == pytest.approx(values.mean())
    assert spread["standard_deviation"] == pytest.approx(values.std(ddof=1))
    assert spread["deviation_over_u"] == pytest.approx(values.std(ddof=1) / 0.45)

    benches = {found["bench"]: found for found in answers(tmp_path, "benches")}
    a, b = values[::2], values[1::2]
    assert benches["B"]["difference"] == pytest.approx(b.mean() - a.mean())
    error = (a.var(ddof=1) / 20 + b.var(ddof=1) / 20) ** 0.5
    assert benches["B"]["standard_error"] == pytest.approx(error)
    assert benches["A"]["difference_over_error"] == pytest.approx((a.mean() - b.mean()) / error)

    drift = {found["bench"]: found for found in answers(tmp_path, "drift")}
    assert drift["A"]["slope_per_day"] == pytest.approx(1.0)
    days = np.arange(0, 40, 2) // 4
    residual = a - (60.1 + days)
    expected = ((residual**2).sum() / 18 / ((days - days.mean()) ** 2).sum()) ** 0.5
    assert drift["A"]["standard_error"] == pytest.approx(expected)

    [capability] = answers(tmp_path, "capability")
    assert capability["cpk"] == pytest.approx((61.9 - values.mean()) / (3 * values.std(ddof=1)))
    outcomes_ = [r["verdict"] for r in rows]
    assert (capability["passed"], capability["marginal"], capability["failed"]) == tuple(
        map(outcomes_.count, ("PASS", "MARGINAL", "FAIL"))
    )

    assert (capability["results"], capability["not_judged"]) == (41, 1)

    worst = answers(tmp_path, "worst")
    assert worst[0]["gear"] == max(rows, key=lambda r: r["value"])["gear"]
    assert worst[0]["margin_over_expanded_uncertainty"] == pytest.approx(
        (61.9 - values.max()) / 0.9
    )


def test_a_limit_of_two_sides_is_one_limit_whichever_side_decides(tmp_path: Path) -> None:
    both = {"lower_limit": 59.0, "upper_limit": 75.0, "verdict": "PASS"}
    sides = ({"limit_value": 59.0, "limit_is": "lower"}, {"limit_value": 75.0, "limit_is": "upper"})
    rows = [one | both | sides[place % 2] for place, one in enumerate(production())]
    keep(tmp_path, rows)
    [found] = answers(tmp_path, "capability")
    values = np.array([r["value"] for r in rows])
    s = values.std(ddof=1)
    assert (found["gears"], found["passed"]) == (40, 40)
    assert found["cp"] == pytest.approx(16.0 / (6 * s))
    assert found["cpk"] == pytest.approx(min(75.0 - values.mean(), values.mean() - 59.0) / (3 * s))


def test_a_question_that_is_none_is_told(tmp_path: Path) -> None:
    keep(tmp_path, production(4))
    with pytest.raises(ConfigurationError, match=", ".join(QUESTIONS)):
        ask(tmp_path, "SELEKT 1")
    with pytest.raises(ConfigurationError, match="holds no results"):
        results_folder(tmp_path / "elsewhere")


def test_a_damaged_file_among_the_results_is_named(tmp_path: Path) -> None:
    keep(tmp_path, production(4))
    (tmp_path / "part-00000099.parquet").write_bytes(b"PAR1 and nothing more")
    for read in (lambda: ask(tmp_path, "spread"), DataSet(tmp_path).table):
        with pytest.raises(RunFileError, match=r"part-00000099.parquet: is no Parquet file"):
            read()


def test_the_command_asks(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rig = Rig(capsys)
    keep(tmp_path / "fleet-results", production(4))
    told = rig.json("fleet", "query", "SELECT count(*) AS n FROM results", "--results", tmp_path)
    assert told == {"columns": ["n"], "rows": [[4]]}
    assert (
        rig(
            "fleet",
            "query",
            "SELECT gear, value FROM results LIMIT 1",
            "--results",
            tmp_path,
            "--csv",
        )
        == 0
    )
    assert rig.out == "gear,value\nG0,60.0\n"
    when = "SELECT started FROM results LIMIT 1"
    ((began,),) = rig.json("fleet", "query", when, "--results", tmp_path)["rows"]
    assert datetime.fromisoformat(began).tzinfo is not None
    every = "SELECT gear, value FROM results LIMIT 1"
    assert rig("fleet", "query", every, "--results", tmp_path) == 0
    assert rig.out.splitlines()[0].split() == ["gear", "value"]
    assert rig("fleet", "query", "nonsense", "--results", tmp_path) == 2


@pytest.mark.parametrize("question", QUESTIONS)
def test_a_ready_question_is_answered_in_words_that_fit(
    question: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_lot(tmp_path / "fleet-results")
    (told,) = tables_of(["fleet", "query", question, "--results", str(tmp_path)], monkeypatch)
    assert isinstance(told, Printed)
    units = set(told.grid.texts("unit"))
    assert units <= {"arcmin", "mN m"}, units
    named = {"transmission accuracy forward", "running torque 2000 r/min at 20 °C"}
    assert named <= set(told.grid.texts("quantity"))


def test_names_of_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    places = (
        "a/1-x.h5",
        "a/deep/2-y.h5",
        "a/1-x.analysis/3-z.h5",
        "a/fleet-results/4.h5",
        "b/5.h5.part",
        "b/6.h5",
    )
    for name in places:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    monkeypatch.chdir(tmp_path)
    (tmp_path / "list.txt").write_text("b\na/1-x.h5\n", encoding="utf-8")

    def named(*names: str) -> list[str]:
        return [path.as_posix() for path in runs_named(names)]

    assert named("a") == ["a/1-x.h5", "a/deep/2-y.h5"]
    assert named("*/*.h5") == ["a/1-x.h5", "b/6.h5"]
    assert named("list.txt", "a") == ["a/1-x.h5", "a/deep/2-y.h5", "b/6.h5"]
    with pytest.raises(ConfigurationError, match="names no run"):
        named("c")
    with pytest.raises(ConfigurationError, match="is no pair of paths"):
        PathMap.of("/data")


def test_progress_tells_rate_time_left_and_failures() -> None:
    now = Progress(runs=1000, done=300, reused=100, failed=7, seconds=50.0)
    assert now.words() == "300 of 1000 runs, 4 runs/s, 3 min left, 7 failed"
    assert Progress(runs=5, done=0, reused=0, failed=0, seconds=0.0).words() == "0 of 5 runs"


def test_a_folder_is_looked_at_once_however_many_runs_lie_in_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    looked: list[Path] = []

    class Counted(LibraryIndex):
        def __init__(self, folder: Path, *, once: bool) -> None:
            looked.append(folder)
            super().__init__(folder, once=once)

    monkeypatch.setattr("rig.fleet.work.LibraryIndex", Counted)
    runs = [tmp_path / day / f"{k:05d}-home-G.h5" for day in ("one", "two") for k in range(3)]
    for run in runs:
        run.parent.mkdir(exist_ok=True)
        run.write_bytes(b"no run")
    job = Job(name="a job", created="2026-01-01T00:00:00+00:00", kind="home")
    assert len(work_for(runs, job, {}, base=tmp_path, there=PathMap()).tasks) == 6
    assert looked == [tmp_path / "one", tmp_path / "two"]
