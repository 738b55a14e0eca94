"""The process beside a run: a page and a command are told each state, and what fails there costs the run nothing."""

from __future__ import annotations

import json
import os
import queue
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from rig.bench.backends.order import Order
from rig.errors import ConfigurationError
from rig.present.bystander import CALLED_AT, LOST, PATIENCE, Bystander, stand_by
from rig.present.status_page import COLOURS, EVERY, painted
from rig.run.bystander import standing_by
from rig.run.parts import Progress
from rig.run.start import run_order
from rig.run.state import State
from rig.run.stop import StopRequest
from rig.runfile.read import close_recording, open_run

WRITER = (
    "import os, sys, pathlib; told = [*sys.argv[1:], os.environ['HARMONIC_RIG_NOTIFY_STATE']]; "
    "pathlib.Path('called.txt').open('a').write(' '.join(told) + chr(10)); "
    "sys.exit(os.environ.get('HARMONIC_RIG_STATE') in told)"
)
"""Writes down what it was told; fails where the place of the latch was overwritten by the state."""
LONGEST = 600.0
"""s of this computer's time that a process may take to end, however loaded it is."""


def word_of(page: Path) -> str:
    found = re.search(r"<h1>(.*)</h1>", page.read_text(encoding="utf-8"))
    assert found
    return found[1]


def order_of(folder: Path, command: list[str] | None = None, **more: object) -> Order:
    config = None
    if command is not None:
        config = folder / "rig.toml"
        config.write_text(f"[notify]\ncommand = {json.dumps(command)}\n", encoding="utf-8")
    return Order(protocol="home", serial="SN-1", folder=folder, config=config, **more)  # type: ignore[arg-type]


def told(order: Order, act: Callable[[object], None]) -> list[str]:
    """What the process complained of, once it has ended."""
    complaints: list[str] = []
    with standing_by(order, complaints.append) as bystander:
        assert bystander is not None
        act(bystander)
    assert bystander.process.is_gone(LONGEST)
    return complaints


def test_a_run_is_told_on_its_page_and_to_the_command(tmp_path: Path) -> None:
    page = tmp_path / "status.html"
    order = order_of(tmp_path, [sys.executable, "-c", WRITER], status=page)
    ended: list[str] = []
    complaints: list[str] = []
    with standing_by(order, complaints.append) as bystander:
        assert bystander is not None
        hears = bystander.hears(lambda prompt: "", None, lambda event: ended.append(event.code))
        report = run_order(Order(protocol="home", serial="SN-1", folder=tmp_path), **hears)
        bystander.reported(report)
    assert bystander.process.is_gone(LONGEST)
    assert "made-safe" in ended, "the run's own callbacks are called too"
    assert complaints == []
    assert word_of(page) == "finished"
    text = page.read_text(encoding="utf-8")
    assert len(re.findall("<dt>", text)) == 4
    assert "<polyline" in text
    assert "home SN-1" in text
    assert (tmp_path / "called.txt").read_text().splitlines() == [
        f"finished {report.path} finished"
    ]


def test_an_order_with_neither_has_no_process(tmp_path: Path) -> None:
    with standing_by(order_of(tmp_path), lambda text: None) as bystander:
        assert bystander is None


def test_a_command_that_is_not_there_is_told_at_each_state(tmp_path: Path) -> None:
    order = order_of(tmp_path, [str(tmp_path / "nobody")])
    complaints = told(order, lambda b: b._change(b.state.asked("Take the guard off")))  # type: ignore[attr-defined]
    # At the question, and at the end that nobody reported.
    assert complaints == 2 * ["the notification cannot be called: No such file or directory"]


def test_what_fails_beside_a_run_is_an_event_of_it_and_the_run_completes(tmp_path: Path) -> None:
    stop = StopRequest()
    problems: list[str] = []
    stop.problem = lambda text: (problems.append(text), StopRequest.problem(stop, text))[1]  # type: ignore[method-assign]

    def wait(progress: Progress) -> None:
        # The rig has its own time: it does not notice.
        while not problems:
            pass

    order = order_of(tmp_path, status=tmp_path / "gone" / "status.html")
    report = run_order(order, stop=stop, on_progress=wait)
    assert report.outcome == "COMPLETED"
    recording = open_run(report.path)
    found = [event.text for event in recording.events if event.code == "callback"]
    close_recording(recording)
    assert found == ["the status page is not written: No such file or directory"]


def test_a_page_that_cannot_be_written_is_told_once(tmp_path: Path) -> None:
    order = order_of(tmp_path, status=tmp_path / "gone" / "status.html")

    def act(bystander: object) -> None:
        for word in ("asked", "answered"):
            state = bystander.state  # type: ignore[attr-defined]
            bystander._change(state.asked("x") if word == "asked" else state.answered())  # type: ignore[attr-defined]

    assert told(order, act) == ["the status page is not written: No such file or directory"]


def test_a_notify_table_that_says_nothing_is_refused_before_anything_moves(tmp_path: Path) -> None:
    order = order_of(tmp_path, [])
    with pytest.raises(ConfigurationError, match="notify"):
        run_order(order)
    assert not list(tmp_path.glob("*.h5*"))


def test_a_run_that_is_refused_says_so_on_its_page(tmp_path: Path) -> None:
    page = tmp_path / "status.html"
    with (
        pytest.raises(ConfigurationError),
        standing_by(order_of(tmp_path, status=page), lambda text: None) as bystander,
    ):
        raise ConfigurationError("no such rig", where="--backend")
    assert bystander is not None
    assert bystander.process.is_gone(LONGEST)
    assert word_of(page) == State.REFUSED.value


def test_its_words_are_those_of_the_table_of_states() -> None:
    words = {state.value for state in State}
    assert {*CALLED_AT, *COLOURS, LOST["state"]} <= words


def test_a_closed_terminal_and_ctrl_c_are_left_to_the_run(tmp_path: Path) -> None:
    page = tmp_path / "status.html"
    asked = json.dumps({"status": str(page), "command": [], "title": "friction SN-1"})
    words = [sys.executable, "-m", "rig.present.bystander", asked]
    pipe = subprocess.PIPE
    with subprocess.Popen(words, stdin=pipe, stdout=pipe, text=True) as process:
        assert process.stdin is not None
        process.stdin.write('{"state": "running"}\n')
        process.stdin.flush()
        while not page.exists():
            pass
        for number in (signal.SIGINT, signal.SIGHUP):
            process.send_signal(number)
        process.stdin.write('{"state": "finished", "over": true}\n')
        process.stdin.close()
        assert process.wait(LONGEST) == 0
    assert word_of(page) == "finished"


def test_when_the_process_that_turns_is_killed_the_page_says_so(tmp_path: Path) -> None:
    page = tmp_path / "status.html"
    script = f"""
import os, pathlib, signal
from rig.bench.backends.order import Order
from rig.run.bystander import standing_by
from rig.run.parts import Progress
with standing_by(Order(protocol="home", status=pathlib.Path({str(page)!r})), print) as b:
    b._go_on(Progress(step=1, steps=2, what="hold", elapsed=0.0, left=1.0, speed=0.0, events=0))
    while not pathlib.Path({str(page)!r}).exists(): pass
    os.kill(os.getpid(), signal.SIGKILL)
"""
    with subprocess.Popen([sys.executable, "-c", script], stderr=subprocess.PIPE) as process:
        # The process beside the run has this pipe too: it ends with the last page.
        assert process.stderr is not None
        process.stderr.read()
    assert process.returncode == -signal.SIGKILL
    assert word_of(page) == State.LOST.value
    assert "press the emergency stop" in page.read_text(encoding="utf-8")


def spectator(folder: Path, complaints: list[str], *command: str) -> Bystander:
    return Bystander(folder / "status.html", command, "friction SN-1", complaints.append)


def test_a_page_is_written_every_two_seconds_and_at_each_change(tmp_path: Path) -> None:
    bystander = spectator(tmp_path, [])
    seen = []
    for now in (0.0, 0.5, 1.9, 2.0, 3.0, 4.1):
        bystander.tend(now)
        page = tmp_path / "status.html"
        seen.append(page.exists())
        page.unlink(missing_ok=True)
    assert seen == [True, False, False, True, False, True]
    bystander.take({"state": "running"}, 4.2)
    bystander.tend(4.2)
    assert word_of(tmp_path / "status.html") == "running"
    assert [path.name for path in tmp_path.iterdir()] == ["status.html"], "no scratch file is left"


def test_a_full_disk_costs_the_page_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    complaints: list[str] = []
    bystander = spectator(tmp_path, complaints)
    bystander.tend(0.0)

    def full(self: Path, *words: object, **more: object) -> int:
        raise OSError(28, os.strerror(28))

    with monkeypatch.context() as disk:
        disk.setattr(Path, "write_text", full)
        for now in (EVERY, 2 * EVERY, 3 * EVERY):
            bystander.tend(now)
    assert complaints == ["the status page is not written: No space left on device"]
    assert word_of(tmp_path / "status.html") == "armed", "the last whole page stays"
    bystander.take({"state": "running"}, 4 * EVERY)
    bystander.tend(4 * EVERY)
    assert word_of(tmp_path / "status.html") == "running"


def test_a_command_that_hangs_is_ended_and_told(tmp_path: Path) -> None:
    complaints: list[str] = []
    hangs = (sys.executable, "-c", "import sys; sys.stdin = None\nwhile True: pass")
    bystander = spectator(tmp_path, complaints, *hangs)
    bystander.take({"state": "tripped"}, 0.0)
    bystander.tend(PATIENCE - 0.1)
    assert len(bystander.calls) == 1
    bystander.tend(PATIENCE)
    assert (bystander.calls, complaints) == ([], ["the notification was ended after 5 s"])


def test_lines_that_end_without_the_end_of_the_run_are_a_loss(tmp_path: Path) -> None:
    bystander = spectator(tmp_path, [])
    lines: queue.Queue[str | None] = queue.Queue()
    for line in ('{"state": "running", "point": [0, 0]}', "no json", '{"point": [1, 60]}', None):
        lines.put(line)
    stand_by(bystander, lines)
    assert word_of(tmp_path / "status.html") == "lost"


def test_nothing_that_is_told_becomes_markup() -> None:
    told = {"state": "<b>", "title": "SN<x>", "what": "a & b", "numbers": {"<i>": "<u>"}}
    page = painted(told, [(0.0, 0.0), (1.0, 5.0), (2.0, -3.0)], 1.0, "now")
    assert not re.search("<b>|<x>|<i>|<u>", page)
    assert "SN&lt;x&gt;" in page


def test_a_page_of_a_run_that_is_over_does_not_grow_old() -> None:
    assert 'data-old="10"' in painted({"state": "running"}, [], 1.0, "now")
    assert 'data-old=""' in painted({"state": "finished", "over": True}, [], 1.0, "now")


@pytest.mark.parametrize(
    "course", [[], [(0.0, 1.0)], [(0.0, 0.0), (1.0, 0.0)], [(1.0, 2.0), (1.0, 3.0)]]
)
def test_a_course_that_is_no_picture_is_left_out(course: list[tuple[float, float]]) -> None:
    assert "<svg" not in painted({"state": "running"}, course, 1.0, "now")


def test_a_long_run_keeps_its_whole_course(tmp_path: Path) -> None:
    bystander = spectator(tmp_path, [])
    for second in range(10_000):
        bystander.take({"point": [second, 60.0]}, 0.0)
    assert len(bystander.course) < 1300
    assert (bystander.course[0][0], bystander.course[-1][0]) == (0.0, 9999.0)


def test_what_waits_for_a_process_that_does_not_read_is_left_out_but_for_the_state(
    tmp_path: Path,
) -> None:
    order = order_of(tmp_path, status=tmp_path / "status.html")
    with standing_by(order, lambda text: None) as bystander:
        assert bystander is not None
        now = Progress(step=1, steps=2, what="hold", elapsed=0.0, left=1.0, speed=0.0, events=0)
        for second in range(5000):
            bystander._go_on(Progress(**{**vars_of(now), "elapsed": float(second)}))
        bystander._change(bystander.state.pressed("STOP"))
    assert bystander.process.is_gone(LONGEST)
    # Without a report: the run is gone while it was being stopped.
    assert word_of(tmp_path / "status.html") == "lost"


def vars_of(progress: Progress) -> dict[str, object]:
    return {name: getattr(progress, name) for name in progress.__slots__}
