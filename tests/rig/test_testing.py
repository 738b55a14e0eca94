"""The checks that are offered to other packages find what is not kept."""

from __future__ import annotations

import dataclasses
import itertools
import textwrap
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from drivers.channel import Channel
from drivers.clock import Clock
from drivers.event import Event
from drivers.source import Reading, taken_channel
from experiments import catalogue
from experiments.steps.vocabulary import HoldTime, Ramp, SegmentLabel
from rig.testing import source as checks
from rig.testing.protocol import check_protocol
from rig.testing.source import check_source
from tests.outside_package import found_in, installed_into

HOME = catalogue.load("home")


def planned(change: Callable[[list[Any]], Sequence[Any]]) -> Any:
    """The plan of `home`, changed."""
    return lambda parameters, gear: iter(change(list(HOME.plan(parameters, gear))))


counter = itertools.count()


@pytest.mark.parametrize(
    ("broken", "why"),
    [
        ({"plan": planned(lambda p: p[1:])}, "begins and ends with the servo off"),
        ({"plan": planned(lambda p: p[:-2] + p[-1:])}, "stand still before the power goes off"),
        (
            {"plan": planned(lambda p: [*p[:1], Ramp(1e6, 10.0), *p[1:]])},
            "1000000.0 rad/s, rated",
        ),
        (
            {"plan": planned(lambda p: [*p[:1], HoldTime(1.0, SegmentLabel("somewhere")), *p[1:]])},
            "no analysis knows the label somewhere",
        ),
        (
            {"plan": planned(lambda p: [*p[:1], HoldTime(1.0 + next(counter)), *p[1:]])},
            "two plans of one order differ",
        ),
        ({"quantities": ()}, "no quantity is declared"),
        ({"name": "Home run"}, "small letters"),
    ],
)
def test_a_protocol_that_keeps_not_all_is_told(broken: dict[str, Any], why: str) -> None:
    check_protocol(HOME)
    with pytest.raises(AssertionError, match=why):
        check_protocol(dataclasses.replace(HOME, **broken))


def test_an_analysis_that_plans_is_told() -> None:
    broken = dataclasses.replace(catalogue.load("skew"), plan=lambda parameters, gear: iter(()))
    with pytest.raises(AssertionError, match="has no plan, and yet makes one"):
        check_protocol(broken)


class Thermometer:
    """A source that keeps all of it."""

    name = "thermometer"
    largest_steps: Sequence[int] = (0, 0)

    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        room = Channel(name="room", unit="degC", acquired="polled")
        self.channels: Sequence[Channel] = (room, taken_channel(room))

    def open(self, cycle_ns: int) -> dict[str, str]:
        return {"model": "none"}

    def request(self, cycle: int) -> None: ...

    def collect(self, cycle: int, until_ns: int) -> Reading | None:
        return Reading((cycle, 0))

    def events(self) -> list[Event]:
        return []

    def close(self) -> None: ...


class Waiting(Thermometer):
    def collect(self, cycle: int, until_ns: int) -> Reading | None:
        self.clock.wait_until_ns(until_ns + 1)
        return None


class Asking(Thermometer):
    def request(self, cycle: int) -> None:
        self.clock.wait_until_ns(self.clock.monotonic_ns() + 1)


class Raising(Thermometer):
    def collect(self, cycle: int, until_ns: int) -> Reading | None:
        raise OSError("the line is gone")


class Short(Thermometer):
    def collect(self, cycle: int, until_ns: int) -> Reading | None:
        return Reading((cycle,))


class Broken(Thermometer):
    def collect(self, cycle: int, until_ns: int) -> Reading | None:
        return Reading((0.5, 0))  # type: ignore[arg-type]


class Untimed(Thermometer):
    def __init__(self, clock: Clock) -> None:
        super().__init__(clock)
        self.channels = self.channels[:1]
        self.largest_steps = (0,)


@pytest.mark.parametrize(
    ("source", "why"),
    [
        (Waiting, "comes back after `until`"),
        (Asking, "waits, and the next SYNC with it"),
        (Raising, "collect: raises OSError: the line is gone"),
        (Short, "1 counts for 2 channels"),
        (Broken, "counts are whole"),
        (Untimed, "room_taken is missing"),
    ],
)
def test_a_source_that_keeps_not_all_is_told(source: type[Thermometer], why: str) -> None:
    check_source(Thermometer)
    with pytest.raises(AssertionError, match=why):
        check_source(source)


def test_a_source_that_does_not_come_back_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    from threading import Event as Never

    never = Never()

    class Blocking(Thermometer):
        def request(self, cycle: int) -> None:
            never.wait()

    monkeypatch.setattr(checks, "_PATIENCE_S", 0.05)
    try:
        with pytest.raises(AssertionError, match="request: does not come back"):
            check_source(Blocking)
    finally:
        never.set()


def test_a_package_that_could_turn_the_motor_is_told(tmp_path: Path) -> None:
    site = installed_into(tmp_path)
    code = """
    from lab_noise.helper import SPEED
    from tests.rig.test_testing import Thermometer as Other


    class Thermometer(Other):
        speed = SPEED
    """
    helper = "def turn():\n    import drivers.bus.cyclic\n\n\nSPEED = 1.0\n"
    (site / "lab_noise" / "helper.py").write_text(helper, encoding="utf-8")
    (site / "lab_noise" / "turning.py").write_text(textwrap.dedent(code), encoding="utf-8")
    with found_in(site):
        from lab_noise.turning import Thermometer as Turning  # type: ignore[import-not-found]

        with pytest.raises(AssertionError, match=r"helper\.py: imports drivers\.bus\.cyclic"):
            check_source(Turning)
