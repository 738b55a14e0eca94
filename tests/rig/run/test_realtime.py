"""Runs in real time: turn thread, writer thread and watchdog; clocks are handed in, nothing sleeps."""

from __future__ import annotations

import gc
import json
import os
import threading
from dataclasses import replace
from pathlib import Path

import pytest

from drivers.clock import VirtualClock
from experiments.recording import Event
from experiments.steps.vocabulary import HoldTime, Prompt, Ramp
from rig.run.callbacks import Callbacks
from rig.run.opening import begin_threaded_run
from rig.run.parts import Progress
from rig.run.realtime import (
    block_cycles,
    collector_off,
    execute_in_real_time,
    watchdog_deadline,
)
from rig.run.remote import RemoteOperator, lines_of
from rig.run.serving import Relay
from rig.run.session import execute
from rig.run.stop import StopRequest
from rig.run.watchdog import Watchdog
from rig.runfile.read import close_recording, open_run
from tests.rig.fake_rig import FakeRig, ListRun, parts_of, planned_of

SHORT = (Ramp(20.0, 500.0), HoldTime(0.3), Ramp(0.0, 500.0))


def test_a_run_in_real_time_keeps_everything_and_ends_with_the_collector_on(tmp_path: Path) -> None:
    threads: set[str] = set()
    collecting: list[bool] = []

    def look(_: FakeRig) -> None:
        threads.add(threading.current_thread().name)
        collecting.append(gc.isenabled())

    events: list[Event] = []
    order = parts_of(planned_of(*SHORT), FakeRig(script={400: look}), tmp_path)
    report = execute_in_real_time(order, begin_threaded_run, on_event=events.append)
    assert (report.outcome, report.safe) == ("COMPLETED", True)
    assert threads == {"turn"}
    assert collecting == [False]
    assert gc.isenabled()
    recording = open_run(report.path, verify=True)
    assert recording.rows == report.rows
    close_recording(recording)
    assert any(event.code == "made-safe" for event in events)


def test_what_a_run_in_real_time_raises_is_raised_here(tmp_path: Path) -> None:
    def fail(_: FakeRig) -> None:
        raise ZeroDivisionError("a defect")

    rig = FakeRig(script={400: fail})
    order = parts_of(planned_of(*SHORT), rig, tmp_path)
    rig.script[400] = lambda r: (r.script.clear(), fail(r))  # type: ignore[func-returns-value]
    with pytest.raises(ZeroDivisionError):
        execute_in_real_time(order, begin_threaded_run)
    assert gc.isenabled()
    assert rig.physics.speed == 0.0


def test_the_watchdog_stops_the_drive_once_when_turns_stay_away() -> None:
    clock, stops = VirtualClock(), list[int]()
    watchdog = Watchdog(clock, 0.25, lambda: stops.append(clock.monotonic_ns()))
    clock.advance_ns(10**9)
    assert not watchdog.check()
    watchdog.turned()
    clock.advance_ns(250_000_000)
    assert not watchdog.check()
    clock.advance_ns(1)
    assert watchdog.check()
    assert watchdog.check()
    assert len(stops) == 1
    assert watchdog.acted
    watchdog.rest()
    assert not watchdog.check()


def test_a_watchdog_whose_bus_is_gone_keeps_the_problem() -> None:
    clock = VirtualClock()

    def gone() -> None:
        raise OSError("no such device")

    watchdog = Watchdog(clock, 0.25, gone)
    watchdog.turned()
    clock.advance_ns(10**9)
    assert watchdog.check()
    assert "no such device" in watchdog.problem


def test_a_late_turn_trips_the_run() -> None:
    stopped: list[bool] = []
    rig = FakeRig()
    watchdog = Watchdog(rig.clock, 0.25, lambda: stopped.append(True))

    def stall(rig: FakeRig) -> None:
        rig.clock.advance_ns(400_000_000)
        watchdog.check()

    rig.script[450] = stall
    order = parts_of(planned_of(*SHORT), rig, Path(), watchdog=watchdog)
    run = ListRun()
    report = execute(order, lambda *_: run)
    assert stopped == [True]
    assert report.outcome == "TRIPPED"
    assert report.trip is not None
    assert report.trip.cause == "late_turn"
    assert report.trip.value > 250.0
    assert report.safe


def test_the_watchdog_does_not_bark_at_a_run_that_turns() -> None:
    rig = FakeRig()
    watchdog = Watchdog(rig.clock, 0.25, lambda: None)
    report = execute(
        replace(parts_of(planned_of(*SHORT), rig, Path()), watchdog=watchdog), lambda *_: ListRun()
    )
    assert report.outcome == "COMPLETED"
    assert not watchdog.acted
    assert watchdog.longest_pause < 0.25


def test_the_watchdog_thread_ends_and_releases_its_bus() -> None:
    closed: list[bool] = []
    watchdog = Watchdog(VirtualClock(), 0.02, lambda: None, close=lambda: closed.append(True))
    watchdog.start()
    watchdog.stop()
    assert closed == [True]
    assert "watchdog" not in {thread.name for thread in threading.enumerate()}


def test_blocks_and_deadlines_in_real_time() -> None:
    assert block_cycles(1000.0, 1000) == 20
    assert block_cycles(250.0, 1000) == 5
    assert block_cycles(250.0, 2) == 2
    assert watchdog_deadline(20, 1000.0) == 0.25
    assert watchdog_deadline(50, 250.0) > 2.0


def test_a_prompt_is_put_in_the_main_thread_and_the_turn_never_waits() -> None:
    asked: list[str] = []
    prompt = Prompt("temperature?", "temperature")
    told: list[Progress] = []
    stop = StopRequest()
    relay = Relay(Callbacks(stop, lambda p: (asked.append(p.text), "22")[1], told.append))
    assert relay.ask(prompt) is None
    relay.progress(Progress(step=1, steps=2, what="x", elapsed=0.0, left=1.0, speed=0.0, events=0))
    relay.serve()
    assert asked == ["temperature?"]
    assert relay.ask(prompt) == "22"
    assert len(told) == 1


def test_the_collector_is_as_it_was_even_after_an_error() -> None:
    seen: list[bool] = []

    def fail() -> None:
        with collector_off():
            seen.append(gc.isenabled())
            raise KeyError("x")

    with pytest.raises(KeyError):
        fail()
    assert seen == [False]
    assert gc.isenabled()


def test_words_on_the_line_and_the_dead_mans_switch() -> None:
    lines: list[dict[str, object]] = []
    stop, clock = StopRequest(), VirtualClock()
    remote = RemoteOperator(stop, lambda line: lines.append(json.loads(line)), clock)
    remote.take("note oil looks dark\n")
    remote.take("dance")
    remote.take("")
    assert stop.level == 0
    assert stop.take_notes()[0] == "oil looks dark"
    prompt = Prompt("ready?", "ready")
    assert remote.ask(prompt) is None
    assert remote.ask(prompt) is None
    remote.take("answer yes")
    assert remote.ask(prompt) == "yes"
    remote.take("STOP")
    assert stop.level == 1
    remote.take("ABORT")
    assert stop.level == 2
    progress = Progress(
        step=1,
        steps=2,
        what="hold",
        elapsed=0.0,
        left=1.0,
        speed=0.0,
        events=0,
        nearest="input_speed",
        margin=0.4,
    )
    remote.on_progress(progress)
    remote.on_progress(progress)
    clock.advance_ns(10**9)
    remote.on_progress(progress)
    remote.on_event(Event(1, "info", "made-safe", "make-safe", "stands"))
    assert [line["kind"] for line in lines] == ["prompt", "progress", "progress", "event"]
    gone = StopRequest()
    quiet = RemoteOperator(gone, lambda line: None, clock)
    quiet.listen(iter(["note a"]))
    assert gone.level == 1
    assert quiet.ask(prompt) == "(nobody there: not answered)"


def test_lines_come_from_a_descriptor_whole() -> None:
    reader, writer = os.pipe()
    os.write(writer, b"STOP\nnote half")
    os.write(writer, b" a line\nlast")
    os.close(writer)
    assert list(lines_of(reader)) == ["STOP", "note half a line", "last"]
    os.close(reader)


def test_notes_of_the_operator_become_events() -> None:
    stop = StopRequest()
    rig = FakeRig(script={300: lambda _: stop.note("smells of oil")})
    run = ListRun()
    report = execute(parts_of(planned_of(*SHORT), rig, Path()), lambda *_: run, stop=stop)
    assert report.outcome == "COMPLETED"
    assert [event.text for event in run.events if event.code == "note"] == ["smells of oil"]
    assert (
        json.loads(json.dumps(report.as_json(), allow_nan=False))["margins"]["input_speed"][
            "margin"
        ]
        > 0.0
    )
