"""The marker of a run: there from before it arms until standstill is verified, and a latch when its process is gone."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from experiments.steps.vocabulary import HoldTime, Ramp
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig.bench.backends.assembly import AssembledRig
from rig.bench.backends.order import Order
from rig.bench.held import HeldFile, is_held, read_held
from rig.errors import RigError, RunFileError
from rig.run import marker as markers
from rig.run import opening
from rig.run.latch import CUT_OFF, HISTORY_NAME, LatchedTrip, LatchedTripError, TripLatch
from rig.run.marker import PREFIX, RunMarker, live_runs, orphans
from rig.run.opening import begin_inline_run
from rig.run.parts import RunReport
from rig.run.session import execute
from rig.run.start import run_on
from rig.run.stop import StopRequest
from tests.rig.fake_rig import FakeRig, parts_of, planned_of

STEPS = (Ramp(20.0, 500.0), HoldTime(0.3), Ramp(0.0, 500.0))
NOW = "2026-01-02T03:04:05+00:00"


def request_in(folder: Path) -> Order:
    return Order(
        protocol="fake", gear=shipped_gear(), motor=shipped_motor(), folder=folder, block_cycles=20
    )


def run_fake(rig: FakeRig, folder: Path, stop: StopRequest | None = None) -> RunReport:
    assembled = AssembledRig(name="sim", port=rig, clock=rig.clock)
    return run_on(assembled, request_in(folder), planned_of(*STEPS), stop)


def left_behind(folder: Path, run: str = "00001-x-y", bench: str = "bench-1") -> Path:
    """The marker of a run whose process is gone."""
    marker = RunMarker(folder, bench)
    before = set(folder.glob(f"{PREFIX}*"))
    marker.leave(run, "friction", NOW, folder / "p.h5.part")
    marker.let_go()
    (path,) = set(folder.glob(f"{PREFIX}*")) - before
    return path


def test_a_run_is_marked_before_it_arms_and_until_standstill_is_verified(tmp_path: Path) -> None:
    seen: dict[str, list[markers.MarkedRun]] = {}

    def look(name: str) -> Callable[[FakeRig], None]:
        return lambda _: seen.update({name: list(live_runs(tmp_path))})

    rig = FakeRig(script={0: look("open"), 202: look("arming"), 500: look("turning")})
    report = run_fake(rig, tmp_path)
    assert report.outcome == "COMPLETED"
    assert seen["open"] == []
    (marked,) = seen["arming"]
    assert seen["turning"] == [marked]
    assert (marked.run, marked.protocol, marked.process) == (report.run_id, "literal", os.getpid())
    assert Path(marked.part) == report.path.with_name(report.path.name + ".part")
    assert marked.boot == markers.boot_id()
    assert not list(tmp_path.glob(f"{PREFIX}*"))


def test_a_standstill_that_was_not_verified_leaves_the_marker_though_nothing_tripped(
    tmp_path: Path,
) -> None:
    rig, stop = FakeRig(), StopRequest()
    rig.physics.ignore_ramp = rig.physics.ignore_quick_stop = rig.physics.ignore_off = True
    rig.script[500] = lambda _: stop.stop()
    report = run_fake(rig, tmp_path, stop)
    assert (report.outcome, report.safe, report.trip) == ("ABORTED", False, None)
    trip = TripLatch(tmp_path).read()
    assert trip is not None
    assert (trip.cause, trip.run) == (CUT_OFF, report.run_id)


def test_a_run_that_cannot_be_marked_is_refused_and_nothing_has_moved(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(HeldFile, "write", refuse)
    rig = FakeRig()
    with pytest.raises(RigError, match=r"cannot be marked as running: No space left"):
        run_fake(rig, tmp_path)
    assert rig.physics.speed == 0.0
    assert {mode.name for mode, _ in rig.exchanged} == {"OFF"}
    assert not list(tmp_path.glob("*.part"))
    assert not list(tmp_path.glob(f"{PREFIX}*"))


def test_a_run_whose_file_cannot_be_begun_leaves_no_marker(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise RunFileError("the disk is gone")

    monkeypatch.setattr(opening, "RunWriter", refuse)
    with pytest.raises(RunFileError, match="the disk is gone"):
        run_fake(FakeRig(), tmp_path)
    assert not list(tmp_path.glob(f"{PREFIX}*"))


def test_an_exception_that_ends_in_verified_standstill_leaves_no_marker(tmp_path: Path) -> None:
    def fail(rig: FakeRig) -> None:
        rig.script.clear()
        raise ZeroDivisionError("a defect")

    marker = RunMarker(tmp_path, "")
    order = parts_of(planned_of(*STEPS), FakeRig(script={500: fail}), tmp_path, marker=marker)
    with pytest.raises(ZeroDivisionError):
        execute(order, begin_inline_run)
    assert not list(tmp_path.glob(f"{PREFIX}*"))


def test_a_marker_that_is_held_is_a_running_run_and_no_latch(tmp_path: Path) -> None:
    marker = RunMarker(tmp_path, "bench-1")
    marker.leave("00001-x-y", "friction", NOW, tmp_path / "p.h5.part")
    assert [marked.run for marked in live_runs(tmp_path)] == ["00001-x-y"]
    assert list(orphans(tmp_path)) == []
    TripLatch(tmp_path).refuse()
    # Whoever has a bench for itself knows that nobody else can be running there.
    with pytest.raises(LatchedTripError):
        TripLatch(tmp_path, bench="bench-1").refuse()
    marker.let_go()
    assert list(live_runs(tmp_path)) == []
    with pytest.raises(LatchedTripError, match=r"in run 00001-x-y, .* is in .*p\.h5\.part"):
        TripLatch(tmp_path).refuse()


def test_an_orphan_tells_a_kill_from_a_computer_that_was_started_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    left_behind(tmp_path)
    trip = TripLatch(tmp_path).read()
    assert trip is not None
    assert (
        f"process {os.getpid()} (friction) ended while the rig may have been in motion"
        in trip.message
    )
    assert "it was killed" in trip.message
    assert trip.time == NOW
    later = tmp_path / "boot_id"
    later.write_text("another-start\n")
    monkeypatch.setattr(markers, "BOOT_ID", later)
    trip = TripLatch(tmp_path).read()
    assert trip is not None
    assert "started anew" in trip.message


@pytest.mark.parametrize("text", ["\n{", "\n[]", "\n{}x", '\n{"run": 3}', "\n\0\0\0"])
def test_a_marker_that_cannot_be_read_still_refuses(tmp_path: Path, text: str) -> None:
    left_behind(tmp_path).write_text(text)
    with pytest.raises(LatchedTripError, match="NOT verified"):
        TripLatch(tmp_path).refuse()
    assert TripLatch(tmp_path).acknowledge("Ada", "now").run == "unknown"
    TripLatch(tmp_path).refuse()


def test_a_marker_that_was_never_written_was_never_armed(tmp_path: Path) -> None:
    left_behind(tmp_path).write_text("")
    TripLatch(tmp_path).refuse()
    assert TripLatch(tmp_path).read() is None


def test_each_run_that_was_cut_off_is_acknowledged_by_itself(tmp_path: Path) -> None:
    left_behind(tmp_path, "00001-x-y")
    left_behind(tmp_path, "00002-x-y")
    latch = TripLatch(tmp_path)
    assert latch.acknowledge("Ada", "now").run == "00001-x-y"
    assert latch.acknowledge("Ada", "now").run == "00002-x-y"
    assert latch.read() is None
    lines = (tmp_path / HISTORY_NAME).read_text().splitlines()
    assert [json.loads(line)["part"] for line in lines] == [str(tmp_path / "p.h5.part")] * 2


def test_a_simulation_that_was_cut_off_latches_its_folder_and_no_bench(tmp_path: Path) -> None:
    runs, state, user = (tmp_path / name for name in ("runs", "state", "user"))
    left_behind(runs, bench="0")
    assert TripLatch(runs).read() is not None
    latch = TripLatch(state, (user, runs), bench="bench-1")
    assert latch.read() is None
    left_behind(user, "00002-x-y")
    trip = latch.read()
    assert trip is not None
    assert trip.run == "00002-x-y"


def test_a_trip_whose_standstill_was_not_verified_is_acknowledged_with_its_marker(
    tmp_path: Path,
) -> None:
    left_behind(tmp_path, "00001-x-y")
    left_behind(tmp_path, "00002-x-y")
    latch = TripLatch(tmp_path)
    latch.leave(LatchedTrip("over_speed", "00002-x-y", NOW, "too fast", False))
    assert latch.acknowledge("Ada", "now").cause == "over_speed"
    assert latch.acknowledge("Ada", "now").run == "00001-x-y"
    assert latch.read() is None


def test_a_held_file_is_released_with_its_holder_and_read_meanwhile(tmp_path: Path) -> None:
    path = tmp_path / "held.json"
    held = HeldFile.hold(path, new=True)
    assert held is not None
    held.write({"a": "long text that is replaced by a shorter one"})
    held.write({"a": 1})
    assert is_held(path)
    assert read_held(path) == {"a": 1}
    assert HeldFile.hold(path) is None
    held.close()
    assert not is_held(path)
    with pytest.raises(FileExistsError):
        HeldFile.hold(path, new=True)
