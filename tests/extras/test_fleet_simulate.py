"""A simulated production: the same runs whoever makes them, its truth beside it, fitted and asked by command."""

from __future__ import annotations

import math
from datetime import UTC, datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pyarrow.parquet as pq
import pytest

from experiments.errors import PlanError
from rig.bench.backends.order import Order
from rig.errors import ConfigurationError
from rig.fleet import simulate
from rig.fleet.day_journal import JOURNAL_NAME, DayJournal, DayRun, runs_made
from rig.fleet.questions import ask
from rig.fleet.simulate import Production, days_of, make_days, simulate_fleet
from rig.library.folder import sealed_runs
from rig.run.latch import LatchedTrip, TripLatch
from rig.run.parts import RunReport
from rig.run.start import run_order
from rig.runfile.read import close_recording, open_run
from tests.rig.commands.calling import Rig

MOMENT = datetime(2026, 1, 6, 8, tzinfo=UTC)
SHORTEST = {
    "zero_time": 0.5,
    "points": 2,
    "lowest_rpm": 300.0,
    "measure_time": 0.2,
    "settle_time": 0.2,
}


def production(folder: Path, **more: object) -> Production:
    asked: dict[str, object] = {
        "gears": 3,
        "benches": 2,
        "protocols": ("home",),
        "short": True,
        "sample_rate": 100.0,
        "per_day": 1,
    }
    return Production(folder=folder, **(asked | more))  # type: ignore[arg-type]


def counts(path: Path) -> tuple[str, ...]:
    """What a run is: its gear, bench, day and start, and every count of its torque and angles."""
    run = open_run(path)
    channels = ("input_angle", "output_angle", "torque")
    stored = [run.stored(name).tobytes().hex() for name in channels]
    m = run.metadata
    world = {
        name: m.process["world"][name] for name in ("gear_seed", "bench_seed", "day", "number")
    }
    close_recording(run)
    return (m.gear_serial, m.process["bench"], str(world), m.start_time, *stored)


def files(folder: Path) -> dict[str, tuple[str, ...]]:
    return {path.relative_to(folder).as_posix(): counts(path) for path in folder.rglob("*.h5")}


def test_gears_go_to_the_benches_in_turn_day_by_day(tmp_path: Path) -> None:
    days = days_of(production(tmp_path, gears=7, per_day=2))
    assert [(day.name, tuple(one.gear for one in day.gears)) for day in days] == [
        ("bench-01/day-001", (1, 3)),
        ("bench-02/day-001", (2, 4)),
        ("bench-01/day-002", (5, 7)),
        ("bench-02/day-002", (6,)),
    ]


def test_in_a_study_of_the_gauge_every_gear_goes_to_every_bench(tmp_path: Path) -> None:
    asked = production(tmp_path, gears=2, crossed=True, mountings=2, repeats=2, per_day=4)
    days = days_of(asked)
    assert [(day.name, [tuple(one) for one in day.gears]) for day in days] == [
        ("bench-01/day-001", [(1, 1), (2, 1), (1, 1), (2, 1)]),
        ("bench-02/day-001", [(1, 1), (2, 1), (1, 1), (2, 1)]),
        ("bench-01/day-002", [(1, 2), (2, 2), (1, 2), (2, 2)]),
        ("bench-02/day-002", [(1, 2), (2, 2), (1, 2), (2, 2)]),
    ]
    # Another mounting, the same gear: what a run is made in says so.
    order = simulate._request(
        asked, days[2], making=tmp_path, moment=MOMENT, turned=("home", "G-00001", days[2].gears[0])
    )
    assert (order.world.mount, order.world.gear_seed, order.world.bench_seed) == (2, 1, 1)
    assert order.world.mount_turn is None
    spread = production(tmp_path, gears=4, spread=True)
    turns = [simulate._turn_of(spread, simulate._Mounted(gear)) for gear in (0, 1, 2, 4)]
    assert turns == [None, 0.0, pytest.approx(0.5 * math.pi), pytest.approx(1.5 * math.pi)]
    with pytest.raises(ConfigurationError, match="--mountings"):
        production(tmp_path, mountings=0)


def test_the_same_order_makes_the_same_runs_and_none_twice(tmp_path: Path) -> None:
    first = simulate_fleet(production(tmp_path / "a"))
    assert (first.runs, first.made, first.reused, first.failed) == (3, 3, 0, ())
    made = files(tmp_path / "a")
    assert set(made) == {
        "bench-01/day-001/00001-home-G_00001.h5",
        "bench-01/day-002/00001-home-G_00003.h5",
        "bench-02/day-001/00001-home-G_00002.h5",
    }
    assert made["bench-01/day-002/00001-home-G_00003.h5"][3].startswith("2026-01-06T08:00")
    assert simulate_fleet(production(tmp_path / "a")).reused == 3

    again = production(tmp_path / "b")
    for day in reversed(days_of(again)):
        assert make_days(again, [day]).runs == 1
    assert simulate_fleet(again).reused == 3
    assert not (tmp_path / "b" / ".making").exists()
    # Whoever comes to a day that somebody else has just made finds it made.
    assert make_days(again, days_of(again)).kept == 3
    assert files(tmp_path / "b") == made
    other = production(tmp_path / "c", gears=1, seed=1)
    simulate_fleet(other)
    [path] = files(tmp_path / "c")
    assert files(tmp_path / "c")[path] != made[path]

    truth = pq.read_table(tmp_path / "a" / "truth.parquet").to_pylist()
    assert {row["run_file"] for row in truth} == set(made)
    name = "friction.at_20_degrees.coulomb"
    drawn = {row["gear"]: row["value"] for row in truth if row["name"] == name}
    assert len(drawn) == len(set(drawn.values())) == 3
    assert all(30.0 < value < 150.0 for value in drawn.values())


def test_a_day_that_was_cut_off_goes_on_behind_its_last_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun: list[str] = []

    def run(request: Order, **more: Any) -> RunReport:
        begun.append(request.serial)
        if begun == ["G-00001", "G-00002"]:
            return run_order(request, **more, on_progress=lambda progress: press_ctrl_c())
        return run_order(request, **more)

    def press_ctrl_c() -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(simulate, "run_order", run)
    asked = {"gears": 2, "benches": 1, "per_day": 2}
    cut = production(tmp_path / "cut", **asked)
    with pytest.raises(KeyboardInterrupt):
        simulate_fleet(cut)
    [making] = (cut.folder / ".making").glob("bench-01/day-001")
    assert [path.name for path in sealed_runs(making)] == [
        "00001-home-G_00001.h5",
        "00002-home-G_00002.h5",
    ]
    # What a run leaves that was ended by force: its marker, a latch, numbers that it took, half a line.
    for name in (".running-00002-1-abcdef.json", ".tripped.json", ".run-numbers/00003"):
        (making / name).write_text("{}")
    with (making / JOURNAL_NAME).open("a") as journal:
        journal.write('{"name": "G-000')

    report = simulate_fleet(cut)
    assert begun == ["G-00001", "G-00002", "G-00002"]
    assert (report.runs, report.made, report.reused, report.failed) == (2, 1, 1, ())
    whole = production(tmp_path / "whole", **asked)
    assert simulate_fleet(whole).made == 2
    assert files(cut.folder) == files(whole.folder)
    assert not (cut.folder / ".making").exists()
    assert len(runs_made(cut.folder / "bench-01" / "day-001")) == 2


def test_a_day_of_another_order_is_made_anew_and_a_run_whose_file_is_gone_too(
    tmp_path: Path,
) -> None:
    folder = tmp_path / "day-001"
    journal = DayJournal(folder, "an order")
    assert journal.resume() == ()
    refused = DayRun(name="G-1 home", reason="cannot be planned")
    sealed = DayRun(name="G-2 home", file="00001-home-G_2.h5", seconds=61.5)
    (folder / sealed.file).touch()
    for run in (refused, sealed):
        journal.add(run)
    assert journal.resume() == (refused, sealed)
    (folder / sealed.file).unlink()
    assert journal.resume() == (refused,)
    assert DayJournal(folder, "another").resume() == ()
    assert [path.name for path in folder.iterdir()] == [JOURNAL_NAME]


def test_a_bench_goes_on_after_a_run_that_cannot_be_and_after_a_trip(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []

    def run(request: Order, **_: object) -> SimpleNamespace:
        latch = TripLatch(request.folder)
        latch.refuse()
        asked.append(request.serial)
        if request.serial == "G-00001":
            raise PlanError("cannot be planned")
        latch.leave(LatchedTrip("torque", "00002", "2026-01-05T08:00+00:00", "too much", True))
        path = request.folder / f"{request.serial}.h5"
        return SimpleNamespace(
            outcome="TRIPPED", rows=100, message="too much", trip=object(), path=path
        )

    monkeypatch.setattr(simulate, "run_order", run)
    report = simulate_fleet(production(tmp_path, benches=1, per_day=3))
    assert asked == ["G-00001", "G-00002", "G-00003"]
    assert (report.made, report.failed) == (
        0,
        (
            ("bench-01/day-001/G-00001 home", "cannot be planned"),
            ("bench-01/day-001/G-00002 home", "TRIPPED: too much"),
            ("bench-01/day-001/G-00003 home", "TRIPPED: too much"),
        ),
    )


def test_what_is_no_production_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="is no production"):
        production(tmp_path, gears=0)
    with pytest.raises(ConfigurationError, match="makes no run"):
        production(tmp_path, protocols=("motion",))


def test_from_a_production_to_an_answer_by_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig = Rig(capsys)
    made = rig.json(
        *("fleet", "simulate", "--gears", 2, "--protocols", "motor-tare", "--sample-rate", 100),
        *(
            word
            for name, value in SHORTEST.items()
            for word in ("--set", f"motor-tare.{name}={value}")
        ),
        *("--output", tmp_path),
    )
    assert (made["runs"], made["made"], made["failed"]) == (2, 2, [])
    fitted = rig.json("fleet", "fit", tmp_path)
    assert fitted == {
        "runs": 2,
        "fitted": 2,
        "reused": 0,
        "failed": [],
        "changed": [],
        "output": str(tmp_path / "fleet-results"),
    }
    assert rig("fleet", "fit", tmp_path) == 0
    assert rig.out.startswith("2 runs: 0 fitted, 2 done before, 0 failed")
    joined = """
        SELECT r.gear, abs(r.value - t.value) <= r.expanded_uncertainty + 0.2 * t.value FROM results r
        JOIN truth t ON r.run_file = t.run_file AND t.name = 'motor.coulomb'
        WHERE r.quantity = 'motor_coulomb' ORDER BY r.gear
    """
    assert ask(tmp_path / "fleet-results", joined).rows == [("G-00001", True), ("G-00002", True)]


def test_a_job_in_which_no_run_could_be_analysed_ends_as_an_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig = Rig(capsys)
    (tmp_path / "00001-home-G.h5").write_bytes(b"no run")
    assert rig("fleet", "fit", tmp_path) == 6
    assert "1 failed" in rig.out
    assert "00001-home-G.h5: " in rig.out
    assert rig("fleet", "fit", tmp_path, "--workers", 2, "--scheduler", "tcp://x:1") == 2
