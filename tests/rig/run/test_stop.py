"""STOP and ABORT from outside: what handlers do with a terminal that is gone, and the end of a Windows console."""

from __future__ import annotations

import os
import select
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import cast

import pytest

from rig.run import console_windows, stop
from rig.run.console_windows import CLOSE, LOGOFF, LONGEST_WAIT, SHUTDOWN, aborted_by_console
from rig.run.stop import StopRequest, pressed_by_signals

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
Handler = Callable[[int, FrameType | None], None]


@pytest.fixture(autouse=True)
def usual_signals() -> Iterator[None]:
    """As in a terminal, also where the tests were started by `nohup` or in the background."""
    usual = {
        signal.SIGINT: signal.default_int_handler,
        signal.SIGTERM: signal.SIG_DFL,
        signal.SIGQUIT: signal.SIG_DFL,
        signal.SIGHUP: signal.SIG_DFL,
    }
    before = {number: signal.signal(number, handler) for number, handler in usual.items()}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def handler_of(number: int) -> Handler:
    return cast(Handler, signal.getsignal(number))


def test_the_handlers_before_are_put_back_and_ignored_signals_are_left_alone() -> None:
    numbers = [signal.SIGINT, signal.SIGTERM, signal.SIGQUIT, signal.SIGHUP]
    usual = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        before = [signal.getsignal(number) for number in numbers]
        with pressed_by_signals(StopRequest()):
            during = [signal.getsignal(number) for number in numbers]
        assert [signal.getsignal(number) for number in numbers] == before
        assert [a == b for a, b in zip(before, during, strict=True)] == [False, False, False, True]
    finally:
        signal.signal(signal.SIGHUP, usual)


def test_a_terminal_that_hangs_up_is_one_stop_however_often_it_is_said() -> None:
    request = StopRequest()
    with pressed_by_signals(request):
        for _ in range(3):
            handler_of(signal.SIGHUP)(signal.SIGHUP, None)
            assert request.level == 1


def test_a_handler_on_a_terminal_that_is_gone_presses_and_raises_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def gone(*_: object) -> int:
        raise OSError(5, "Input/output error")

    request = StopRequest()
    monkeypatch.setattr(os, "write", gone)
    with pressed_by_signals(request):
        for expected in (1, 2, 2):
            handler_of(signal.SIGTERM)(signal.SIGTERM, None)
            assert request.level == expected


def test_a_handler_never_waits_for_a_reader(monkeypatch: pytest.MonkeyPatch) -> None:
    request, written = StopRequest(), list[bytes]()
    monkeypatch.setattr(os, "write", lambda _, data: written.append(data))
    monkeypatch.setattr(select, "select", lambda *_: ([], [], []))
    with pressed_by_signals(request):
        handler_of(signal.SIGINT)(signal.SIGINT, None)
        assert (request.level, written) == (1, [])
        monkeypatch.setattr(select, "select", lambda *_: ([], [2], []))
        handler_of(signal.SIGINT)(signal.SIGINT, None)
    assert (request.level, written) == (2, [b"\nABORT: quick stop\n"])


class Console:
    """What the system would do with the one call: keep the handler, and call it."""

    def __init__(self) -> None:
        self.handlers: list[Callable[[int], bool]] = []

    def set_handler(self, handle: Callable[[int], bool]) -> Callable[[], None]:
        self.handlers.append(handle)
        return lambda: self.handlers.remove(handle)


@contextmanager
def console(
    monkeypatch: pytest.MonkeyPatch, request: StopRequest, waited: list[float]
) -> Iterator[Console]:
    system = Console()
    monkeypatch.setattr(console_windows, "set_handler", system.set_handler)
    with aborted_by_console(request, waited.append):
        yield system
    assert system.handlers == []


@pytest.mark.parametrize("event", [CLOSE, LOGOFF, SHUTDOWN])
def test_the_end_of_a_windows_console_is_an_abort_that_waits_for_the_run(
    monkeypatch: pytest.MonkeyPatch, event: int
) -> None:
    request, waited = StopRequest(), list[float]()
    with console(monkeypatch, request, waited) as system:
        assert system.handlers[0](event)
    assert request.level == 2
    assert waited == [LONGEST_WAIT]
    assert LONGEST_WAIT <= 4.0


@pytest.mark.parametrize("event", [0, 1])
def test_ctrl_c_on_a_windows_console_is_left_to_the_signals(
    monkeypatch: pytest.MonkeyPatch, event: int
) -> None:
    request, waited = StopRequest(), list[float]()
    with console(monkeypatch, request, waited) as system:
        assert not system.handlers[0](event)
    assert (request.level, waited) == (0, [])


def test_on_windows_a_run_hears_the_console_until_it_is_over(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    request, system, results = StopRequest(), Console(), list[object]()
    monkeypatch.setattr(console_windows, "set_handler", system.set_handler)
    waits: list[Callable[[float], object]] = []

    @contextmanager
    def noted(pressed: StopRequest, wait: Callable[[float], object]) -> Iterator[None]:
        waits.append(wait)
        with aborted_by_console(pressed, wait):
            yield

    monkeypatch.setattr(stop, "on_windows", lambda: True)
    monkeypatch.setattr(stop.console_windows, "aborted_by_console", noted)
    with pressed_by_signals(request):
        assert len(system.handlers) == 1
        results.append(waits[0](0.0))
    # Safe and sealed: whoever waits is let go at once.
    results.append(waits[0](0.0))
    assert results == [False, True]
