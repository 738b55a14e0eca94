"""The latch of a trip: the next run is refused until somebody acknowledges by name."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from experiments.steps.vocabulary import HoldTime, Ramp
from rig.errors import RigError
from rig.main import app
from rig.run.latch import HISTORY_NAME, LatchedTrip, LatchedTripError, TripLatch
from rig.run.session import execute
from tests.rig.fake_rig import FakeRig, ListRun, parts_of, planned_of

TRIP = LatchedTrip("over_speed", "00007-friction-G1", "2026-01-02T03:04:05+00:00", "too fast", True)


def trip_a_run(folder: Path) -> LatchedTrip:
    def block(rig: FakeRig) -> None:
        rig.physics.fault = True

    order = parts_of(
        planned_of(Ramp(20.0, 500.0), HoldTime(0.3)),
        FakeRig(script={350: block}),
        folder,
        latch=TripLatch(folder),
    )
    report = execute(order, lambda *_: ListRun())
    assert report.outcome == "TRIPPED"
    latched = TripLatch(folder).read()
    assert latched is not None
    return latched


def test_a_trip_is_latched_and_the_next_run_refused_before_the_rig_is_touched(
    tmp_path: Path,
) -> None:
    latched = trip_a_run(tmp_path)
    assert (latched.cause, latched.run, latched.standstill_verified) == (
        "drive_fault",
        "00001-fake-G1",
        True,
    )
    assert latched.time.startswith("2023-11-14T")
    rig = FakeRig()
    order = parts_of(planned_of(Ramp(20.0, 500.0)), rig, tmp_path, latch=TripLatch(tmp_path))
    with pytest.raises(
        LatchedTripError, match=r"drive_fault in run 00001-fake-G1.*rig acknowledge --operator NAME"
    ):
        execute(order, lambda *_: ListRun())
    assert rig.exchanged == []
    assert rig.limits is None
    TripLatch(tmp_path).acknowledge("Ada", "2026-01-02T10:00:00+00:00", "loose cable")
    assert execute(order, lambda *_: ListRun()).outcome == "COMPLETED"
    kept = json.loads((tmp_path / HISTORY_NAME).read_text())
    assert (kept["acknowledged_by"], kept["cause"], kept["remark"]) == (
        "Ada",
        "drive_fault",
        "loose cable",
    )


def test_the_first_cause_stays(tmp_path: Path) -> None:
    latch = TripLatch(tmp_path)
    latch.leave(TRIP)
    latch.leave(LatchedTrip("bus_lost", "later", "", "", False))
    assert latch.read() == TRIP


def test_nothing_is_latched_by_an_end_or_a_stop(tmp_path: Path) -> None:
    order = parts_of(
        planned_of(Ramp(20.0, 500.0), Ramp(0.0, 500.0)),
        FakeRig(),
        tmp_path,
        latch=TripLatch(tmp_path),
    )
    assert execute(order, lambda *_: ListRun()).outcome == "COMPLETED"
    assert TripLatch(tmp_path).read() is None


def test_a_latch_that_cannot_be_read_still_holds(tmp_path: Path) -> None:
    latch = TripLatch(tmp_path)
    for text in ("{", "[]", '{"cause": 3}'):
        latch.path.write_text(text)
        with pytest.raises(LatchedTripError, match="NOT verified"):
            latch.refuse()


def test_a_trip_is_acknowledged_by_name_only(tmp_path: Path) -> None:
    latch = TripLatch(tmp_path)
    with pytest.raises(RigError, match="no trip is latched"):
        latch.acknowledge("Ada", "now")
    latch.leave(TRIP)
    for nobody in ("", "  "):
        with pytest.raises(RigError, match="by name"):
            latch.acknowledge(nobody, "now")
    assert latch.read() == TRIP


def test_a_latch_that_cannot_be_written_says_so(tmp_path: Path) -> None:
    taken = tmp_path / "taken"
    taken.write_text("a file where the folder would be")
    with pytest.raises(RigError, match="could not be latched"):
        TripLatch(taken).leave(TRIP)


def test_a_latch_makes_the_folder_that_it_needs(tmp_path: Path) -> None:
    TripLatch(tmp_path / "not" / "there").leave(TRIP)
    assert TripLatch(tmp_path / "not" / "there").read() == TRIP


def test_the_command_releases_the_latch(tmp_path: Path) -> None:
    TripLatch(tmp_path).leave(TRIP)
    run = ["run", "starting-torque", "--output", str(tmp_path)]
    refused = CliRunner().invoke(app, run)
    assert isinstance(refused.exception, LatchedTripError)
    assert CliRunner().invoke(app, ["acknowledge", "--output", str(tmp_path)]).exit_code == 2
    done = CliRunner().invoke(
        app, ["acknowledge", "--operator", "Ada", "--output", str(tmp_path), "--json"]
    )
    assert done.exit_code == 0
    assert json.loads(done.stdout)["acknowledged"]["by"] == "Ada"
    assert TripLatch(tmp_path).read() is None


def test_a_run_for_another_program_speaks_json_lines_and_hears_the_end_of_its_input(
    tmp_path: Path,
) -> None:
    arguments = ["run", "starting-torque", "--positions", "2", "--zero-time", "0.5"]
    arguments += ["--output", str(tmp_path), "--events"]
    done = CliRunner().invoke(app, arguments)
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    assert {line["kind"] for line in lines} == {"event", "progress", "report"}
    assert lines[-1]["kind"] == "report"
    assert lines[-1]["make_safe"]["safe"] is True
    assert 0.0 < [line for line in lines if line["kind"] == "progress"][-1]["margin"] < 1.0
