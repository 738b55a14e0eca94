"""Forty runs fitted as a fleet: the same table whoever works, whoever dies, and however often it is asked for."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow
import pyarrow.parquet as pq
import pytest

import rig
from experiments import catalogue
from rig.analysis.fit.recorded import Fit
from rig.analysis.fit.run import FitInputs, fit_run
from rig.analysis.store import read_analyses
from rig.errors import ConfigurationError, RigError
from rig.fleet import survey
from rig.fleet.dataset import DataSet
from rig.fleet.engine import Workforce, at_work
from rig.fleet.fit import FleetOrder, FleetReport, fit_fleet
from rig.fleet.progress import Progress
from rig.fleet.work import PathMap
from rig.gears.acceptance import acceptance_text, shipped_acceptance
from rig.library.index import LibraryIndex
from rig.runfile.seal import hash_path
from tests.extras.fleet_runs import (
    BATCH_SECONDS,
    RUNS,
    Cluster,
    make_runs,
    renew,
    running_cluster,
)


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_runs(tmp_path_factory.mktemp("fleet") / "production")


@pytest.fixture(scope="module")
def alone(runs: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results as this process makes them alone."""
    return fleet(runs, tmp_path_factory.mktemp("alone")).output


@pytest.fixture(scope="module")
def table(alone: Path) -> pyarrow.Table:
    return DataSet(alone).table()


def fleet(
    runs: Path, output: Path, watch: Callable[[Progress], None] = lambda now: None, **more: Any
) -> FleetReport:
    """Fit the runs in small batches; `more` are fields of crew and order."""
    kinds = ("workers", "scheduler", "batch_seconds")
    crew = {name: more.pop(name) for name in kinds if name in more}
    names = more.pop("names", [runs])
    crew = Workforce(**{"batch_seconds": BATCH_SECONDS, **crew})
    return fit_fleet(FleetOrder(names=names, output=output, crew=crew, **more), watch)


def by_quantity(table: pyarrow.Table, run: str) -> dict[str, dict[str, Any]]:
    return {row["quantity"]: row for row in table.to_pylist() if run in row["run_file"]}


def test_the_rows_say_what_a_fit_of_the_run_says(runs: Path, table: pyarrow.Table) -> None:
    assert len(set(table["run_file"].to_pylist())) == RUNS
    path = next(runs.rglob("*-friction-*.h5"))
    fit = fit_run(path)
    rows = by_quantity(table, path.name)
    assert set(rows) == {*fit.result.estimates, *fit.result.metrics}
    for name, estimate in fit.result.estimates.items():
        row = rows[name]
        assert (row["value"], row["expanded_uncertainty"], row["unit"], row["identifiable"]) == (
            estimate.value,
            estimate.expanded_uncertainty,
            estimate.unit,
            estimate.identifiable,
        )
    assert rows["coulomb"]["tare"] == fit.tare_as_json()["run"] == "00001-motor_tare-bench_01"
    assert rows["coulomb"]["tare_sha256"] == fit.tare_as_json()["sha256"]
    assert rows["coulomb"]["run_sha256"] == fit.recording.metadata.sha256
    assert str(rows["coulomb"]["day"]) == "2026-01-05"


def test_processes_of_this_computer_give_the_same_table(
    runs: Path, table: pyarrow.Table, tmp_path: Path
) -> None:
    report = fleet(runs, tmp_path, workers=2)
    assert (report.fitted, report.failed) == (RUNS, ())
    assert DataSet(tmp_path).table().equals(table)


def test_a_cluster_gives_the_same_table_though_client_and_workers_die(
    runs: Path, table: pyarrow.Table, tmp_path: Path
) -> None:
    with running_cluster(workers=2) as cluster:
        client = _client_that_dies(runs, tmp_path, cluster)
        assert client.returncode == -signal.SIGKILL, client.stderr
        there = len(DataSet(tmp_path).known())
        assert 0 < there < RUNS
        report = fleet(runs, tmp_path, _Reaper(cluster, there), scheduler=cluster.address)
    assert (report.reused, report.fitted, report.failed) == (there, RUNS - there, ())
    assert DataSet(tmp_path).table().equals(table)


def _client_that_dies(
    runs: Path, output: Path, cluster: Cluster
) -> subprocess.CompletedProcess[str]:
    """A client that is killed when the first results are there."""
    script = (
        "import os, signal, sys\n"
        "from pathlib import Path\n"
        "from tests.extras.test_fleet import fleet\n"
        "def watch(now):\n"
        "    if now.done >= 4:\n"
        "        os.kill(os.getpid(), signal.SIGKILL)\n"
        "fleet(Path(sys.argv[1]), Path(sys.argv[2]), watch, scheduler=sys.argv[3])\n"
    )
    return subprocess.run(
        [sys.executable, "-c", script, str(runs), str(output), cluster.address],
        cwd=Path(__file__).parents[2],
        env=os.environ | {"OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )


class _Reaper:
    """Kills both workers of a cluster one after the other, and lets a third one join before the second dies."""

    def __init__(self, cluster: Cluster, there: int) -> None:
        self._cluster, self._there = cluster, there
        self._workers = list(cluster.workers)

    def __call__(self, now: Progress) -> None:
        since = now.done - self._there
        if since >= 4 and len(self._workers) == 2:
            self._workers.pop().send_signal(signal.SIGKILL)
        elif since >= 8 and len(self._workers) == 1 and now.done < RUNS - 4:
            self._cluster.join()
            from distributed import Client

            with Client(self._cluster.address, set_as_default=False) as client:
                client.wait_for_workers(2)
            self._workers.pop().send_signal(signal.SIGKILL)


def test_what_is_done_is_not_done_again_and_what_is_stale_is(
    runs: Path, alone: Path, tmp_path: Path
) -> None:
    production, results = shutil.copytree(runs, tmp_path / "p"), tmp_path / "r"
    home = sorted(production.rglob("*-home-*.h5"))[-1]
    friction = sorted(production.rglob("*-friction-*.h5"))[0]
    chosen = [home, friction]
    first = fleet(production, results, names=chosen)
    assert (first.fitted, first.reused) == (2, 0)
    assert fleet(production, results, names=chosen).reused == 2

    renew(home)
    report = fleet(production, results, names=chosen)
    assert (report.fitted, report.reused) == (1, 1)
    rows = by_quantity(DataSet(results).table(), home.name)
    assert {row["gear"] for row in rows.values()} == {"G-RENEW"}

    # Another tare in the folder, of another motor: it is looked at, and nothing is fitted.
    tare = next(production.rglob("*-motor_tare-*.h5"))
    renew(other := _as_number(tare, 90), motor="SGMJV-99")
    moments: list[Progress] = []
    report = fleet(production, results, moments.append, names=chosen)
    assert (report.fitted, report.reused, len(moments)) == (0, 2, 2)
    assert fleet(production, results, moments.append, names=chosen).reused == 2
    assert len(moments) == 3, "that it was looked at is remembered"

    # One of this motor bears witness of the tare that is subtracted.
    renew(witness := _as_number(tare, 91))
    assert fleet(production, results, names=chosen).fitted == 1

    for path in (tare, other, witness):
        path.unlink()
    report = fleet(production, results, names=chosen)
    assert (report.fitted, report.reused) == (1, 1)
    rows = by_quantity(DataSet(results).table(), friction.name)
    assert "there is no simulated motor-tare run" in rows["coulomb"]["tare_because"]


def _as_number(run: Path, number: int) -> Path:
    """The same run once more, under another number."""
    copy = run.with_name(f"{number:05d}{run.name[5:]}")
    for suffix in ("", ".sha256"):
        shutil.copyfile(f"{run}{suffix}", f"{copy}{suffix}")
    return copy


def test_another_version_of_an_analysis_is_another_work(
    runs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = [next(runs.rglob("*-home-*.h5"))]
    assert fleet(runs, tmp_path, names=home).fitted == 1
    load = catalogue.load
    newer = replace(load("home"), version=99)
    for name in ("load", "declared"):
        monkeypatch.setattr(catalogue, name, lambda kind: newer if kind == "home" else load(kind))
    assert fleet(runs, tmp_path, names=home).fitted == 1
    table = DataSet(tmp_path).table()
    assert set(table["analysis_version"].to_pylist()) == {99}
    assert len(table) == len(set(table["quantity"].to_pylist()))


def test_a_run_that_cannot_be_analysed_is_a_row_with_its_reason(runs: Path, tmp_path: Path) -> None:
    broken = tmp_path / "00001-home-G_1.h5"
    broken.write_bytes(b"no run")
    tare = next(runs.rglob("*-motor_tare-*.h5"))
    report = fleet(runs, tmp_path / "r", names=[broken, tare])
    assert (report.fitted, [run for run, _ in report.failed]) == (1, [broken.name])
    [row] = by_quantity(DataSet(tmp_path / "r").table(), broken.name).values()
    assert row["failure"] == report.failed[0][1]
    assert (row["failure_kind"], row["quantity"], row["run_verdict"]) == (
        "RunFileError",
        "",
        "NOT JUDGED",
    )
    again = fleet(runs, tmp_path / "r", names=[broken, tare])
    assert (again.fitted, again.reused, again.failed) == (0, 1, report.failed)


def test_ctrl_c_keeps_what_is_done(runs: Path, table: pyarrow.Table, tmp_path: Path) -> None:
    def press(now: Progress) -> None:
        if now.done >= 4:
            raise KeyboardInterrupt

    homes = sorted(runs.rglob("*-home-*.h5"))[:8]
    # One run a batch, however fast the computer is: what is told is told run by run.
    with pytest.raises(KeyboardInterrupt):
        fleet(runs, tmp_path, press, names=homes, batch_seconds=1e-9)
    there = DataSet(tmp_path).known()
    assert 4 <= len(there) < 8
    assert len(DataSet(tmp_path).parts()) == 1, "the files are put together"
    assert fleet(runs, tmp_path, names=homes).reused == len(there)


def test_workers_may_see_the_runs_elsewhere(runs: Path, tmp_path: Path) -> None:
    home = next(runs.rglob("*-home-*.h5"))
    there = tmp_path / "there"
    there.symlink_to(runs)
    report = fleet(runs, tmp_path / "r", names=[home], mapped=PathMap.of(f"{runs}={there}"))
    assert report.fitted == 1
    lost = fleet(runs, tmp_path / "s", names=[home], mapped=PathMap.of(f"{runs}=/nowhere"))
    assert "/nowhere" in lost.failed[0][1]
    with pytest.raises(ConfigurationError, match="lies outside"):
        PathMap.of(f"{tmp_path}/elsewhere=/x").path(home)


def test_a_verdict_stands_beside_what_it_judges(runs: Path, tmp_path: Path) -> None:
    friction = next(runs.rglob("*-friction-*.h5"))
    limits = tmp_path / "acceptance.toml"
    one_sided = acceptance_text(shipped_acceptance("demonstration"))
    assert "upper = 119.0" in one_sided
    limits.write_text(one_sided.replace("upper = 119.0", "upper = 119.0\nlower = 20.0"))
    fleet(runs, tmp_path, names=[friction], acceptance=str(limits))
    rows = by_quantity(DataSet(tmp_path).table(), friction.name)
    judged = {name: row for name, row in rows.items() if row["verdict"]}
    torque = judged["running_torque_2000_rpm_at_20_degrees"]
    value, u, limit = (torque[n] for n in ("value", "expanded_uncertainty", "limit_value"))
    expected = "PASS" if value + u <= limit else "FAIL" if value - u > limit else "MARGINAL"
    assert (torque["verdict"], torque["limit_is"]) == (expected, "upper")
    assert limit == 0.119
    assert (torque["lower_limit"], torque["upper_limit"]) == (0.02, 0.119)
    assert rows["coulomb"]["upper_limit"] is None
    assert not rows["coulomb"]["verdict"]


def test_the_analyses_are_kept_beside_the_runs_where_somebody_wants_it(
    runs: Path, tmp_path: Path
) -> None:
    production = shutil.copytree(runs, tmp_path / "p")
    home = next(production.rglob("*-home-*.h5"))
    fleet(production, tmp_path / "r", names=[home])
    assert read_analyses(home) == ()
    shutil.rmtree(tmp_path / "r")
    fleet(production, tmp_path / "r", names=[home], stored=True)
    assert [analysis.kind for analysis in read_analyses(home)] == ["home"]


def test_python_gets_the_table(runs: Path, tmp_path: Path) -> None:
    home = next(runs.rglob("*-home-*.h5"))
    table = rig.fleet_fit(home, output=tmp_path / "r")
    assert table.equals(pq.read_table(tmp_path / "r"))
    assert set(table["kind"].to_pylist()) == {"home"}


def test_headers_are_read_by_the_workers(
    runs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(survey, "FEW", 2)
    for home in sorted(runs.rglob("*-home-*.h5"))[:3]:
        shutil.copyfile(home, tmp_path / home.name)
    told: list[Progress] = []
    with at_work(Workforce()) as hands:
        for _ in range(2):
            survey.survey(hands, [tmp_path], str, told.append)
    assert LibraryIndex(tmp_path).outdated() == 0
    assert [now.words().partition(",")[0] for now in told] == ["headers read: 3 of 3 runs"]


def test_results_have_one_writer(runs: Path, tmp_path: Path) -> None:
    with (
        DataSet(tmp_path).writing(),
        pytest.raises(RigError, match="another program is writing these results"),
    ):
        fleet(runs, tmp_path)


def test_a_defect_of_one_analysis_does_not_end_the_others_and_is_tried_again(
    runs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    homes = sorted(runs.rglob("*-home-*.h5"))[:2]

    def fit(inputs: FitInputs) -> Fit:
        if inputs.path == homes[0].resolve():
            raise AttributeError("no such thing")
        return whole(inputs)

    whole = FitInputs.fit
    with monkeypatch.context() as patched:
        patched.setattr(FitInputs, "fit", fit)
        report = fleet(runs, tmp_path, names=homes)
    assert (report.fitted, report.failed[0][1]) == (1, "no such thing")
    report = fleet(runs, tmp_path, names=homes)
    assert (report.fitted, report.reused, report.failed) == (1, 1, ())
    assert not any(DataSet(tmp_path).table()["failure"].to_pylist())


def test_a_run_without_its_note_is_a_row_that_says_so_and_is_tried_again(
    runs: Path, tmp_path: Path
) -> None:
    tare = next(runs.rglob("*-motor_tare-*.h5"))
    path = tmp_path / tare.name
    shutil.copy2(tare, path)
    report = fleet(tmp_path, tmp_path / "r", names=[path])
    assert report.changed == (path.name,)
    assert "is not sealed" in report.failed[0][1]
    shutil.copy2(hash_path(tare), hash_path(path))
    again = fleet(tmp_path, tmp_path / "r", names=[path])
    assert (again.fitted, again.changed) == (1, ())
