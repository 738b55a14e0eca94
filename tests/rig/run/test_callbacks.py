"""What callbacks raise in the middle of a run: on a rig on the wire in virtual time, and the rule by itself."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from experiments.recording import Event
from experiments.steps.note import Mark, Prompt
from experiments.steps.vocabulary import HoldTime, Ramp
from rig.run.callbacks import ASK, ON_EVENT, ON_PROGRESS, SERVING, Callbacks, ends_the_run
from rig.run.opening import begin_threaded_run
from rig.run.realtime import execute_in_real_time
from rig.run.serving import Relay, _serve_until_over
from rig.run.session import execute
from rig.run.stop import StopRequest
from tests.rig.fake_rig import FakeRig, ListRun, parts_of, planned_of
from tests.rig.raising import CASES, Carrier, judge

STEPS = (Ramp(20.0, 500.0), HoldTime(0.1), Mark("in-motion", "it turns"), HoldTime(0.3))


@pytest.mark.parametrize(("way", "which", "error"), CASES)
def test_a_run_on_the_wire_is_left_through_standstill_alone(
    way: str, which: str, error: type[BaseException], tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    words = ("--backend", "wire", "--sample-rate", "250")
    carrier = Carrier({"backend": "wire", "sample_rate": 250.0}, words, tmp_path)
    judge(carrier, way, which, error, monkeypatch)


def test_the_rule() -> None:
    ends = {
        name: [
            error.__name__
            for error in (ValueError, KeyboardInterrupt, SystemExit, GeneratorExit)
            if ends_the_run(name, error())
        ]
        for name in (ON_PROGRESS, ON_EVENT, ASK, SERVING)
    }
    asked = ["KeyboardInterrupt", "SystemExit", "GeneratorExit"]
    assert ends == {
        ON_PROGRESS: asked,
        ON_EVENT: asked,
        ASK: ["ValueError", *asked],
        SERVING: ["ValueError", *asked],
    }


def test_the_second_is_an_abort_and_the_first_is_raised() -> None:
    stop = StopRequest()
    callbacks = Callbacks(stop, lambda prompt: "")
    first, second = SystemExit(3), ValueError("x")
    callbacks.took(ON_EVENT, ValueError("only tells"))
    assert (stop.level, callbacks.first) == (0, None)
    callbacks.took(ON_EVENT, first)
    assert (stop.level, stop.by) == (1, "on_event raised SystemExit: 3")
    callbacks.took(ASK, second)
    assert (stop.level, callbacks.first) == (2, first)
    assert len(stop.take_problems()) == 3


@pytest.mark.parametrize(("error", "level"), [(SystemExit(), 1), (KeyboardInterrupt(), 2)])
def test_after_a_stop_of_the_operator_only_ctrl_c_is_an_abort(
    error: BaseException, level: int
) -> None:
    stop = StopRequest()
    stop.stop()
    Callbacks(stop, lambda prompt: "").took(ON_PROGRESS, error)
    assert stop.level == level


def raises(error: BaseException) -> Any:
    """A callback that raises."""

    def call(_: object) -> None:
        raise error

    return call


@pytest.mark.parametrize("error", [ValueError("x"), SystemExit(2), GeneratorExit("x")])
@pytest.mark.parametrize("name", ["on_progress", "on_event"])
def test_served_by_another_thread_it_is_the_same(
    name: str, error: BaseException, tmp_path: Path
) -> None:
    """Real time in all but the rig: a serving thread, a turn thread, a watchdog's place."""
    rig, stop = FakeRig(), StopRequest()
    order = parts_of(planned_of(*STEPS), rig, tmp_path)

    def run() -> Any:
        return execute_in_real_time(order, begin_threaded_run, stop=stop, **{name: raises(error)})

    if isinstance(error, Exception):
        report = run()
        assert report.outcome == "COMPLETED"
        assert any(f"{name} raised" in text for text in report.warnings)
    else:
        with pytest.raises(type(error)) as raised:
            run()
        assert raised.value is error
        assert "standstill was verified" in raised.value.__notes__[-1]
    assert rig.physics.speed == 0.0
    assert rig.closed


def test_an_error_of_the_run_itself_is_not_lost_behind_that_of_a_callback() -> None:
    def fail(rig: FakeRig) -> None:
        rig.script.clear()
        raise ZeroDivisionError("a defect")

    seen: list[Event] = []

    def on_event(event: Event) -> None:
        seen.append(event)
        raise SystemExit(4)

    rig = FakeRig(script={400: fail})
    with pytest.raises(SystemExit) as raised:
        execute(parts_of(planned_of(*STEPS), rig, Path()), lambda *_: ListRun(), on_event=on_event)
    assert len(seen) == 1
    assert raised.value.code == 4
    assert rig.physics.speed == 0.0


def test_a_stop_says_who_pressed_it() -> None:
    run, rig = ListRun(), FakeRig()
    steps = (Ramp(20.0, 500.0), Prompt("warm?", "warm"), HoldTime(0.3))
    with pytest.raises(LookupError) as raised:
        execute(
            parts_of(planned_of(*steps), rig, Path(), 20),
            lambda *_: run,
            ask=raises(LookupError("nobody")),
        )
    assert raised.value.args == ("nobody",)
    texts = [event.text for event in run.events]
    assert "STOP by ask raised LookupError: nobody: controlled ramp" in texts
    assert run.outcome == "ABORTED"


class Turning:
    """A turn thread that lives for some looks, and lets Ctrl-C come at some of them."""

    def __init__(self, looks: int, errors: dict[int, BaseException]) -> None:
        self.looks, self.errors = looks, errors

    def is_alive(self) -> bool:
        self.looks -= 1
        return self.looks > 0

    def join(self, timeout: float) -> None:
        error = self.errors.pop(self.looks, None)
        if error is not None:
            raise error


def test_serving_goes_on_after_ctrl_c_and_a_defect_of_its_own() -> None:
    stop, told = StopRequest(), list[Event]()
    callbacks = Callbacks(stop, lambda prompt: "", None, told.append)
    relay = Relay(callbacks)
    thread = Turning(10, {8: KeyboardInterrupt(), 6: KeyboardInterrupt(), 3: RuntimeError("x")})
    relay.event(Event(1, "info", "a", "b", "c"))
    _serve_until_over(thread, relay)  # type: ignore[arg-type]
    assert thread.looks <= 0
    assert stop.level == 2
    assert isinstance(callbacks.first, KeyboardInterrupt)
    assert len(told) == 1
    relay.event(Event(1, "info", "a", "b", "c"))
    relay.serve()
    assert len(told) == 1


IN_ANOTHER_THREAD = """
import sys, threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
sys.path.insert(0, {root!r})
from experiments.steps.vocabulary import HoldTime, Ramp
from rig.run.realtime import execute_in_real_time
from tests.rig.fake_rig import FakeRig, ListRun, parts_of, planned_of

turns, begun = threading.Event(), threading.Event()
rig = FakeRig(script={{400: lambda rig: (begun.set(), over.wait(600.0))}})
over = threading.Event()
order = parts_of(planned_of(Ramp(20.0, 500.0), HoldTime(600.0)), rig, Path({folder!r}))

def work():
    report = execute_in_real_time(order, lambda *_: ListRun())
    print(report.outcome, report.safe, report.message, flush=True)

def released():
    # Only once the main thread is said to be over.
    import time
    while threading.main_thread().is_alive() and not getattr(threading, "_SHUTTING_DOWN", False):
        time.sleep(0.01)
    over.set()

threading.Thread(target=released, daemon=True).start()
{start}
begun.wait(600.0)
"""


@pytest.mark.parametrize(
    "start",
    [
        "threading.Thread(target=work).start()",
        "threading.Thread(target=work, daemon=False).start()",
        "ThreadPoolExecutor().submit(work)",
    ],
)
def test_the_end_of_the_main_thread_is_a_stop(start: str, tmp_path: Path) -> None:
    root = str(Path(__file__).parents[3])
    script = IN_ANOTHER_THREAD.format(root=root, folder=str(tmp_path), start=start)
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=1800, check=True
    )
    assert done.stdout.startswith("ABORTED True STOP by the end of the main thread"), done.stderr
