"""Stopping after an exception that nobody expected goes on whatever is raised meanwhile, and tells of it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from drivers.event import Event
from drivers.port import Abilities, Mode
from drivers.samples import SampleBlock
from experiments.steps.vocabulary import HoldTime, Ramp
from rig.run.make_safe import MakeSafe
from rig.run.phases import Machine
from rig.run.session import execute
from tests.rig.fake_rig import FakeRig, ListRun, parts_of, planned_of

SHORT = (Ramp(20.0, 500.0), HoldTime(0.3), Ramp(0.0, 500.0))
AT = 400
"""The cycle of the exception, at speed."""


class FailingRun(ListRun):
    """A recorder that raises what no recorder should, from the exception on."""

    broken = False

    def put(self, block: SampleBlock) -> None:
        if self.broken:
            raise ValueError("the writer has a defect")
        super().put(block)


def ended(run: ListRun, *more: Callable[[FakeRig], None]) -> tuple[FakeRig, ZeroDivisionError]:
    """A run in whose motion something raises; `more` happens in the cycles after it."""
    rig = FakeRig()

    def fail(_: FakeRig) -> None:
        rig.script.clear()
        for k, happening in enumerate(more):
            rig.script[rig.physics.cycle + k] = happening
        if isinstance(run, FailingRun):
            run.broken = True
        raise ZeroDivisionError("a defect")

    rig.script[AT] = fail
    with pytest.raises(ZeroDivisionError) as raised:
        execute(parts_of(planned_of(*SHORT), rig, Path(), 20), lambda *_: run)
    return rig, raised.value


def told(run: ListRun) -> list[str]:
    return [event.text for event in run.events if event.code == "emergency"]


def test_recording_that_fails_does_not_end_the_stopping() -> None:
    run = FailingRun()
    rig, error = ended(run)
    assert rig.physics.speed == 0.0
    assert run.outcome == "ERROR"
    assert {"exception", "made-safe"} < set(run.codes())
    (text,) = told(run)
    assert text.startswith("while the rig was stopped: ValueError: the writer has a defect (")
    assert text in error.__notes__
    assert "standstill was verified" in error.__notes__[-1]


def test_an_exchange_that_raises_is_counted_and_the_next_one_is_made() -> None:
    def once(rig: FakeRig) -> None:
        rig.script.pop(rig.physics.cycle)
        raise KeyError("again")

    run = ListRun()
    rig, error = ended(run, once)
    assert rig.physics.speed == 0.0
    assert "made-safe" in run.codes()
    assert told(run) == ["while the rig was stopped: KeyError: 'again'"]
    assert told(run)[0] in error.__notes__


def test_make_safe_that_fails_is_begun_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    accept, broken = Machine.accept, [True]

    def accept_once(machine: Machine, *block: Any) -> None:
        if machine.rows >= AT - 20 and block[1].command.mode is Mode.QUICK_STOP and broken.pop():
            broken.append(False)
            raise IndexError("no such row")
        broken[:] = broken or [False]
        accept(machine, *block)

    monkeypatch.setattr(Machine, "accept", accept_once)
    run = ListRun()
    rig, _ = ended(run)
    assert rig.physics.speed == 0.0
    assert "made-safe" in run.codes()
    assert told(run) == ["while the rig was stopped: IndexError: no such row"]


def test_where_make_safe_fails_every_time_it_is_stopped_blindly_and_that_is_said(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def never(*_: object) -> None:
        raise RuntimeError("make-safe has a defect")

    monkeypatch.setattr(MakeSafe, "next", never)
    run = ListRun()
    rig, error = ended(run)
    assert rig.physics.speed == 0.0
    assert [mode for mode, _ in rig.exchanged[-2:]] == [Mode.OFF, Mode.OFF]
    assert Mode.QUICK_STOP in {mode for mode, _ in rig.exchanged}
    assert "make-safe-failed" in run.codes()
    assert told(run) == [
        "while the rig was stopped: RuntimeError: make-safe has a defect (3 times)"
    ]
    assert "STANDSTILL WAS NOT VERIFIED" in error.__notes__[-1]


def test_a_rig_that_does_not_answer_is_given_up() -> None:
    run = ListRun()
    rig, error = ended(run, lambda rig: setattr(rig, "dead", True))
    assert rig.dead
    assert "make-safe-failed" in run.codes()
    assert told(run) == ["while the rig was stopped: BusLostError: fake: the bus is gone (3 times)"]
    assert "STANDSTILL WAS NOT VERIFIED" in error.__notes__[-1]


def test_a_file_that_cannot_be_closed_hides_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    run = ListRun()
    monkeypatch.setattr(ListRun, "close", lambda *_: 1 // 0)
    with pytest.raises(ZeroDivisionError) as raised:
        execute(
            parts_of(planned_of(*SHORT), FakeRig(script={AT: _defect}), Path(), 20), lambda *_: run
        )
    assert raised.value.args == ("a defect",)
    assert "The run file was not closed" in raised.value.__notes__[-1]
    assert run.abandoned


def _defect(rig: FakeRig) -> None:
    rig.script.clear()
    raise ZeroDivisionError("a defect")


def test_what_the_devices_told_before_the_exception_is_in_the_file() -> None:
    events = iter([[Event(1, "warning", "emcy", "drive", "code 0x8611")]])
    run = ListRun()
    rig = FakeRig(
        abilities=Abilities(events=lambda: next(events, []) if rig.physics.cycle > AT else [])
    )

    def fail(_: FakeRig) -> None:
        rig.script.clear()
        rig.physics.cycle += 1
        raise ZeroDivisionError("a defect")

    rig.script[AT] = fail
    with pytest.raises(ZeroDivisionError):
        execute(parts_of(planned_of(*SHORT), rig, Path(), 20), lambda *_: run)
    assert [event.text for event in run.events if event.code == "emcy"] == ["code 0x8611"]
