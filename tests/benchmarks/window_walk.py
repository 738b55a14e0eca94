"""The window used by a hand: real mouse and keyboard events on a screen of its own, a picture of every step.

    python -m tests.benchmarks.window_walk FOLDER                  # all walks on all screens
    python -m tests.benchmarks.window_walk FOLDER --screen 1366x768@1.5 --walk stop

Each screen is an X server of its own (`Xvfb`), the hand is `xdotool`; Debian has both. Pictures lie in FOLDER by screen
and walk. What does not hold is printed and ends with exit code 1: a state word that the run's own file denies, a
refusal out of sight, a button that cannot be reached.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from tests.benchmarks.window_hand import LONGEST, Hand, WalkError, choose, in_view, screen_of

SCREENS = ("1366x768@1", "1366x768@1.25", "1366x768@1.5", "1920x1080@1")
ROOM = 160_000
"""kB of a disk that fills in the middle of a run."""
PART, SERIAL, PERSON = "CSF-25-120-2UH", "SN-1", "A. Example"
FOREIGN = """format = "acceptance-1"
name = "another"
source = "made up"
use = "any"
parts = ["SHG-32-100"]

[[limits]]
quantity = "starting-torque.starting_torque"
upper = 0.07
unit = "N m"
condition = "no load"
source = "made up"
standing = "customer"
"""


def acceptance(hand: Hand) -> None:
    """*New gear* to *Print certificate*: a technician's whole morning."""
    page, run = hand.window.prepare, hand.window.run
    hand.window.show_page("prepare")
    hand.look("prepare")
    hand.type(page.operator, PERSON)
    hand.click(page.gear.new_button)
    form = page.gear.new
    hand.type(form.product.editor, PART)
    hand.key("Escape")
    hand.type(form.serial.editor, SERIAL)
    hand.look("new-gear")
    hand.click(form.make_button)
    hand.wait(lambda: page.gear.choice.currentData() == SERIAL, "the gear is made")
    hand.look("gear-made")
    choose(hand, page.protocol.choice, "campaign:incoming")
    hand.wait(lambda: not page.is_stale, "the campaign is walked")
    hand.look("campaign")
    for box in page.checklist.boxes:
        if box.isEnabled() and not box.isChecked():
            hand.click(box)
    hand.wait(page.start_button.isEnabled, "it may be started")
    hand.look("signed")
    hand.click(page.start_button)
    hand.wait(lambda: run.state.state.value != "idle", "it began")
    answer_until(hand, run.campaign_end.isVisible)
    hand.look("campaign-end")
    opened: list[Path] = []
    run.campaign_end.open_paper = lambda path: bool(opened.append(path) or True)
    hand.click(run.campaign_end.print_button)
    hand.check(bool(opened) and opened[0].is_file(), f"no certificate was opened: {opened}")
    hand.hold_against_file("campaign")
    hand.click(run.campaign_end.next_button)
    hand.check(hand.window.prepare.gear.new.isVisible(), "the next gear is not asked for")
    hand.look("next-gear")


def answer_until(hand: Hand, is_over: Callable[[], bool]) -> None:
    """Give consent whenever it is asked for, once it is taken."""
    run, seen = hand.window.run, ""
    end = time.monotonic() + 3 * LONGEST
    while not is_over():
        if time.monotonic() > end:
            raise WalkError("the campaign does not end")
        hand.settle(0.05)
        prompt = run.prompt
        if prompt.isVisible() and prompt.is_armed:
            if prompt.question.text() != seen:
                seen = prompt.question.text()
                hand.look("question")
            hand.click(prompt.give)


def stop(hand: Hand) -> None:
    """Esc twice and three times while idle, running, over and arming; after the report nothing pressed is shown."""
    run = hand.window.run
    for times in (2, 3):
        hand.window.show_page("run")
        for _ in range(times):
            hand.key("Escape")
        hand.check(hand.word in ("idle", "finished"), f"idle: Esc made it {hand.word}")
        hand.start()
        hand.wait(lambda: run.plots.rows_read, "rows")
        hand.look(f"running-{times}")
        for _ in range(times):
            hand.key("Escape")
        hand.wait(lambda: run.state.ended, "the end")
        hand.look(f"stopped-{times}")
        hand.hold_against_file(f"Esc {times} times in motion")
        before = run.banner.word
        for _ in range(times):
            hand.key("Escape")
        hand.check(run.banner.word == before, f"after the end Esc made {before} {run.banner.word}")
        hand.start()
        for _ in range(times):
            hand.key("Escape")
        hand.wait(lambda: run.state.ended, "the end of what was stopped while arming")
        hand.look(f"armed-{times}")
        hand.hold_against_file(f"Esc {times} times while arming")


def until_waiting(hand: Hand) -> None:
    """A run that asks for a consent."""
    hand.start_order("motor-tare")
    hand.wait(lambda: hand.window.run.prompt.isVisible(), "the question")


def until_stopping(hand: Hand) -> None:
    """A run that was told to stop at full speed."""
    hand.start_order("friction", speeds_rpm=(3000.0,), measure_time=60.0)
    hand.wait(lambda: hand.window.run.plots.rows_read > 4500, "full speed")
    hand.key("Escape")


def until_analysing(hand: Hand) -> None:
    """A campaign between its last row and its result, which is not there at once for velocity steps."""
    hand.start_campaign("home", "velocity-steps")
    hand.wait(lambda: hand.word == "analysing", "an analysis")


STATES: dict[str, Callable[[Hand], None]] = {
    "waiting for you": until_waiting,
    "stopping": until_stopping,
    "analysing": until_analysing,
}


def states(hand: Hand) -> None:
    """Esc twice and three times in the states that `stop` does not come through."""
    run = hand.window.run
    for times in (2, 3):
        for state, reach in STATES.items():
            reach(hand)
            reached = hand.word
            hand.check(reached == state or run.state.told, f"{state}: the word is {reached}")
            for count in range(times):
                hand.key("Escape")
                is_so = hand.word == "stopping" or run.state.told
                hand.check(is_so, f"{state}: Esc {count + 1} made it {hand.word}")
            hand.look(f"{state.replace(' ', '-')}-{times}")
            hand.wait(lambda: run.state.ended, f"the end after {state}")
            hand.settle()
            print(f"  states: Esc {times} times in {reached}: {hand.word}, {run.state.outcome!r}")
            hand.hold_against_file(f"Esc {times} times while {state}")


def confirm(hand: Hand) -> None:
    """*Confirm* with each field missing: refused at the button, and the field is marked and brought into view."""
    page = hand.window.prepare
    hand.window.show_page("prepare")
    gear = page.gear
    if not gear.details_button.isChecked():
        hand.click(gear.details_button)
    told = {"serial": SERIAL, "part": "csf-25-120", "mounting": "circular-spline-fixed"}
    for missing in ("operator", *told):
        page.operator.setText("" if missing == "operator" else PERSON)
        for name, text in told.items():
            gear.form.rows[name].set_value("" if name == missing else text)
        hand.settle()
        hand.click(gear.confirm_button)
        hand.check(gear.refused.isVisible(), f"{missing} missing: nothing is refused")
        waits = page.operator if missing == "operator" else gear.form.rows[missing].editor
        hand.check(in_view(hand, waits), f"{missing} missing: its field is out of sight")
        is_marked = missing == "operator" or bool(gear.form.rows[missing].problem)
        hand.check(is_marked, f"{missing} missing: its field is not marked")
        hand.check(not gear.is_confirmed, f"{missing} missing: confirmed all the same")
        hand.look(f"without-{missing}")


def foreign(hand: Hand) -> None:
    """An acceptance file of another part says so before anything turns."""
    from rig.gears.card import now_text, save_card, with_changes, with_confirmation

    file = hand.folder / "another.toml"
    file.write_text(FOREIGN, encoding="utf-8")
    facts = {
        "serial": SERIAL,
        "part": "csf-25-120",
        "mounting": "circular-spline-fixed",
        "acceptance": str(file),
    }
    card = with_confirmation(with_changes(None, facts, PERSON, now_text()), PERSON, now_text())
    save_card(hand.folder, card)
    page = hand.window.prepare
    hand.window.show_page("prepare")
    page.gear.refresh()
    page.gear.choose(SERIAL)
    hand.type(page.operator, PERSON)
    hand.wait(lambda: not page.is_stale, "the run is looked at")
    told = " ".join((page.gear.status.text(), page.gear.digest.text(), page.summary.text()))
    told += " ".join(box.text() for box in page.checklist.boxes)
    told += " ".join(one.sentence for one in page.outlook.checks) if page.outlook else ""
    hand.check("is for" in told, f"an acceptance file of another part is not told: {told}")
    hand.look("foreign-acceptance")


def killed(hand: Hand) -> None:
    """The acquisition is killed; what it wrote is recovered by one press."""
    run = hand.window.run
    hand.start()
    hand.wait(lambda: run.plots.rows_read > 200, "rows")
    assert run.process is not None
    os.kill(run.process.pid, signal.SIGKILL)
    hand.wait(lambda: run.state.ended, "the end")
    hand.look("killed")
    for _ in range(3):
        hand.check(hand.word == "lost", f"killed: the word is {hand.word}")
        hand.key("Escape")
    hand.click(run.outcome.recover)
    hand.wait(lambda: list(hand.folder.glob("*.h5")), "a recovered run")
    hand.settle(1.0)
    hand.look("recovered")


def disk(hand: Hand) -> None:
    """A disk that fills: the run ends in standstill and says why."""
    run = hand.window.run
    place = hand.folder
    mount = ["mount", "-t", "tmpfs", "-o", f"size={ROOM}k", "tmpfs", str(place)]
    if subprocess.run(mount, capture_output=True, check=False).returncode:
        print("  disk: a small disk needs the right to mount one; left out")
        return
    try:
        hand.start()
        hand.wait(lambda: run.state.ended or run.plots.rows_read > 2000, "rows on a small disk")
        # Somebody else's file takes what is left.
        with contextlib.suppress(OSError), (place / "else").open("wb", buffering=0) as other:
            while True:
                other.write(bytes(65536))
        hand.wait(lambda: run.state.ended, "the end on a full disk")
        hand.look("disk-full")
        told = f"{run.state.what} {run.banner.word} {run.outcome.text.text()}"
        hand.check(
            bool(run.state.safe), f"full disk: standstill is not said to be verified: {told}"
        )
        hand.check("space" in told or "disk" in told, f"full disk: the reason is not told: {told}")
    finally:
        subprocess.run(["umount", "-l", str(place)], check=False, capture_output=True)


def unplugged(hand: Hand) -> None:
    """The simulated devices go away in motion: nobody can say whether the rig stands."""
    from tests.rig.served_rig import served_rig
    from tests.rig.window.test_running_backends import RATE

    run = hand.window.run
    with served_rig(RATE) as served:
        config = served.configuration(hand.folder)
        hand.start("hardware", confirmation="SN-0815", config=config, sample_rate=RATE)
        hand.wait(lambda: run.state.ended or run.plots.rows_read > 50, "rows over the hub")
        hand.look("over-the-hub")
        served.process.kill()
        hand.wait(lambda: run.state.ended, "the end without devices")
    hand.look("unplugged")
    hand.hold_against_file("unplugged")
    hand.check(run.state.safe is False, f"unplugged: standstill is {run.state.safe}")


def closing(hand: Hand) -> None:
    """Closing in motion asks; staying goes on, leaving stops first."""
    run = hand.window.run
    hand.start()
    hand.wait(lambda: run.plots.rows_read, "rows")
    hand.check(not hand.window.close(), "the window closed in motion")
    hand.wait(run.close_question.isVisible, "the question")
    hand.look("closing")
    hand.click(run.close_question.stay)
    hand.check(not run.state.ended, "staying ended the run")
    hand.window.close()
    hand.click(run.close_question.leave)
    hand.wait(lambda: run.state.ended, "the end before leaving")
    hand.settle()
    hand.hold_against_file("closing")
    hand.check(not hand.window.isVisible(), "the window is still there")


WALKS: dict[str, Callable[[Hand], None]] = {
    "acceptance": acceptance,
    "stop": stop,
    "states": states,
    "confirm": confirm,
    "foreign": foreign,
    "killed": killed,
    "disk": disk,
    "unplugged": unplugged,
    "closing": closing,
}


def walk_here(name: str, pictures: Path, size: tuple[int, int]) -> int:
    """One walk in this process, on the screen that its environment names."""
    from PySide6.QtWidgets import QApplication

    from rig.window.main import MainWindow
    from rig.window.shell.session import WindowSession
    from rig.window.shell.theme import apply_theme

    pictures.mkdir(parents=True, exist_ok=True)
    place = Path(tempfile.mkdtemp())
    folder = place / "runs"
    folder.mkdir()
    application = QApplication([])
    session = WindowSession(folder)
    apply_theme(application, session.theme)
    window = MainWindow(session)
    window.move(0, 0)
    ratio = window.devicePixelRatioF()
    window.resize(int(size[0] / ratio), int(size[1] / ratio))
    window.show()
    hand = Hand(application, window, folder, pictures)
    hand.settle(0.5)
    hand.hand("windowfocus", str(int(window.winId())))
    window.activateWindow()
    try:
        WALKS[name](hand)
    except WalkError as error:
        hand.faults.append(str(error))
    for fault in hand.faults:
        print(f"  {name}: {fault}")
    print(f"  {name}: {hand.taken} pictures, {len(hand.faults)} faults", flush=True)
    if not window.run.state.ended and window.run.state.state.value != "idle":
        window.run.stop()
        hand.wait(lambda: window.run.state.ended, "the end")
    shutil.rmtree(place, ignore_errors=True)
    # Threads that still read must not hold up the next walk.
    os._exit(1 if hand.faults else 0)


def main() -> int:
    """Walk, on every screen that is asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--screen", action="append", help=f"such as {', '.join(SCREENS)}")
    parser.add_argument("--walk", action="append", choices=WALKS)
    parser.add_argument("--here", action="store_true", help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.here:
        width, height = map(int, chosen.screen[0].partition("@")[0].split("x"))
        return walk_here(chosen.walk[0], chosen.folder, (width, height))
    failed = 0
    for screen in chosen.screen or SCREENS:
        size, _, scale = screen.partition("@")
        width, height = map(int, size.split("x"))
        print(screen, flush=True)
        with screen_of(width, height) as display:
            environment = {
                **os.environ,
                "DISPLAY": display,
                "QT_QPA_PLATFORM": "xcb",
                "QT_SCALE_FACTOR": scale or "1",
            }
            for name in chosen.walk or WALKS:
                pictures = chosen.folder / screen / name
                words = [str(pictures), "--here", "--screen", screen, "--walk", name]
                command = [sys.executable, "-m", "tests.benchmarks.window_walk", *words]
                failed += bool(subprocess.run(command, env=environment, check=False).returncode)
    print(f"{failed} walks with faults")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
