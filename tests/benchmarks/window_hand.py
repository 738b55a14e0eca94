"""A hand at the window: mouse and keys through an X server (`Xvfb`, `xdotool`), and a picture of what it sees."""

from __future__ import annotations

import contextlib
import os
import subprocess
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from PySide6.QtWidgets import QApplication, QComboBox, QWidget

    from rig.bench.backends.order import Order
    from rig.window.main import MainWindow

LONGEST = 180.0
"""s that anything may take."""


class WalkError(Exception):
    """What a walk came upon and must not be."""


@dataclass
class Hand:
    """One window on one screen, and who uses it."""

    application: QApplication
    window: MainWindow
    folder: Path
    pictures: Path
    taken: int = 0
    faults: list[str] = field(default_factory=list)

    def settle(self, seconds: float = 0.25) -> None:
        """Let the window work."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.application.processEvents()
            time.sleep(0.004)

    def wait(self, until: Callable[[], Any], what: str) -> None:
        """Let the window work until something holds."""
        end = time.monotonic() + LONGEST
        while not until():
            if time.monotonic() > end:
                self.look(f"never-{what}")
                raise WalkError(f"never came: {what}")
            self.settle(0.02)

    def look(self, name: str) -> None:
        """Keep a picture of what is on the screen."""
        self.settle()
        self.taken += 1
        screen = self.window.screen()
        screen.grabWindow(0).save(str(self.pictures / f"{self.taken:02d}-{name}.png"))

    def check(self, is_so: bool, what: str) -> None:
        """Take down what is not as it must be."""
        if not is_so:
            self.faults.append(what)

    def bring_into_view(self, widget: QWidget) -> None:
        """Turn the wheel, as far as scrolled parts go, until a widget is on the screen."""
        from PySide6.QtWidgets import QScrollArea

        parent = widget.parentWidget()
        while parent is not None:
            if isinstance(parent, QScrollArea):
                parent.ensureWidgetVisible(widget, 20, 20)
            parent = parent.parentWidget()
        self.settle(0.1)

    def click(self, widget: QWidget) -> None:
        """Press the left button in the middle of a widget."""
        self.bring_into_view(widget)
        inside = widget.rect().center()
        there = self.window.childAt(widget.mapTo(self.window, inside))
        if there is None or not (there is widget or widget.isAncestorOf(there)):
            self.look("cannot-be-clicked")
            raise WalkError(f"cannot be clicked: {widget.accessibleName() or widget}")
        place = widget.mapToGlobal(inside) * self.window.devicePixelRatioF()
        self.hand("mousemove", str(round(place.x())), str(round(place.y())), "click", "1")
        self.settle(0.12)

    def type(self, widget: QWidget, text: str) -> None:
        """Click into a field and type a text, whatever stood there."""
        self.click(widget)
        self.hand("key", "ctrl+a")
        self.hand("type", "--delay", "4", text)
        self.settle(0.15)

    def key(self, name: str) -> None:
        """Press a key."""
        self.hand("windowfocus", str(int(self.window.winId())))
        self.settle(0.05)
        self.hand("key", name)
        self.settle(0.1)

    def hand(self, *words: str) -> None:
        """What the X server is told of mouse and keyboard."""
        subprocess.run(["xdotool", *words], check=True, capture_output=True)

    def start(self, backend: str = "sim", length: str = "60", **more: Any) -> None:
        """A friction run of so many seconds a hold."""
        from tests.rig.window.test_running_backends import FLAGS, QUICK, prepared

        values = {**QUICK, "measure_time": float(length)}
        flags = [length if flag == "0.3" else flag for flag in FLAGS]
        session: Any = self.window.prepare._session
        self.window.start(prepared(session, backend, values, flags, **more))

    def start_order(self, protocol: str, **values: Any) -> None:
        """A simulated run of any protocol."""
        from rig.run.start import plan_order
        from rig.window.prepare.request import arguments_for
        from rig.window.work.prepared import PreparedRun

        order = self._order(protocol, **values)
        self.window.start(PreparedRun(order, plan_order(order), arguments_for(order)))

    def _order(self, protocol: str, **values: Any) -> Order:
        from model.gear_file import shipped_gear
        from model.motor import shipped_motor
        from rig.bench.backends.order import Order

        return Order(
            protocol=protocol,
            gear=shipped_gear(),
            motor=shipped_motor(),
            folder=self.folder,
            serial="SN-0815",
            operator="A. Example",
            values=values,
        )

    def start_campaign(self, *protocols: str) -> None:
        """A simulated campaign of these protocols, each as it is by itself."""
        from rig.trial.campaign.plan import load_plan
        from rig.trial.campaign.walk import walk
        from rig.window.prepare.campaign import campaign_arguments
        from rig.window.work.prepared import PreparedCampaign

        plan = self.folder / "walked.toml"
        stages = "".join(f'\n[[protocol]]\nname = "{name}"\n' for name in protocols)
        plan.write_text(f'format = "campaign-1"\nname = "walked"\ntitle = "Walked"\n{stages}')
        order = self._order(protocols[0])
        words = campaign_arguments(order, str(plan), anew=True)
        self.window.start(PreparedCampaign(walk(load_plan(plan), order), words, "Walked"))

    def hold_against_file(self, name: str) -> None:
        """The state word against what the newest sealed run says of itself."""
        from rig.runfile.read import glance

        state = self.window.run.state
        runs = sorted(self.folder.glob("*.h5"))
        found = glance(runs[-1]).metadata.outcome if runs else ""
        self.check(
            state.outcome == found, f"{name}: the banner says {state.outcome!r}, the file {found!r}"
        )
        self.check(
            self.window.run.banner.word.upper() == self.window.run.banner.word,
            f"{name}: {self.window.run.banner.word!r}",
        )

    @property
    def word(self) -> str:
        """The word that the banner shows."""
        return str(self.window.run.state.state.value)


def choose(hand: Hand, box: QComboBox, wanted: str) -> None:
    """Open a list and go down to what is wanted by the keys."""
    hand.click(box)
    hand.hand("key", "Home")
    for _ in range(box.findData(wanted)):
        hand.hand("key", "Down")
    hand.hand("key", "Return")
    hand.settle()
    if box.currentData() != wanted:
        raise WalkError(f"{wanted} was to be chosen, and {box.currentData()} was")


def in_view(hand: Hand, widget: QWidget) -> bool:
    """Whether the middle of a widget is on the screen, under nothing else."""
    there = hand.window.childAt(widget.mapTo(hand.window, widget.rect().center()))
    return there is not None and (there is widget or widget.isAncestorOf(there))


@contextlib.contextmanager
def screen_of(width: int, height: int) -> Iterator[str]:
    """An X server of its own; gives the name of its display."""
    reading, writing = os.pipe()
    server = subprocess.Popen(
        [
            "Xvfb",
            "-displayfd",
            str(writing),
            "-screen",
            "0",
            f"{width}x{height}x24",
            "-nolisten",
            "tcp",
        ],
        pass_fds=(writing,),
        stderr=subprocess.DEVNULL,
    )
    os.close(writing)
    try:
        with os.fdopen(reading) as told:
            yield f":{told.readline().strip()}"
    finally:
        server.terminate()
        server.wait()
