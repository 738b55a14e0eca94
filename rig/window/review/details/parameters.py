"""Parameter sets beside a run: one is held against it, one is written with what it identifies."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import QObject, Signal

from model.gear import HarmonicDrive
from model.gear_file import load_gear
from rig.content.phrase import counted
from rig.window.review.fit import FitOrder, option
from rig.window.review.results import FitBar
from rig.window.work.background import BackgroundCommand, in_words


class ParameterDesk(QObject):
    """Does one of both in a process of its own, and says in the fit bar how it stands. `gear`: the run's own set."""

    compared = Signal(object, object)
    """Carries what `rig validate --against` told, and the path of the set."""

    def __init__(
        self, bar: FitBar, gear: Callable[[], HarmonicDrive | None], parent: QObject
    ) -> None:
        super().__init__(parent)
        self._bar = bar
        self._gear = gear
        self._command: BackgroundCommand | None = None

    @property
    def is_running(self) -> bool:
        """Whether one of both is at work."""
        return self._command is not None

    def cancel(self) -> None:
        """Give up what is at work."""
        if self._command is not None:
            self._command.cancel()
            self._command = None

    def compare(self, order: FitOrder) -> None:
        """Hold a parameter set against the run, in a process of its own."""
        assert order.parameters is not None
        arguments = ["validate", str(order.run), "--against", str(order.parameters), "--json"]
        arguments += [*option("--kind", order.kind), *option("--tare", order.tare)]
        parameters = order.parameters
        self._bar.set_busy(True, f"Comparing with {parameters.name} …")
        self._command = BackgroundCommand(
            arguments, self, lambda _, out, aside: self._take_comparison(parameters, out, aside)
        )
        self._command.start()

    def save(self, order: FitOrder, target: Path) -> None:
        """Write what a run identifies into a parameter set, in a process of its own; the set can be chosen at once."""
        words = [word for word in order.arguments if word not in ("--plots",)]
        self._bar.set_busy(True, f"Writing {target.name} …")
        self._command = BackgroundCommand(
            [*words, "--parameters-out", str(target)],
            self,
            lambda code, _, aside: self._take_saved(target, code, aside),
        )
        self._command.start()

    def _take_saved(self, target: Path, code: int, complaint: str) -> None:
        self._command = None
        self._bar.set_busy(False)
        if code in (2, 6) or not target.exists():
            self._bar.say(in_words(complaint), "bad")
            return
        gear = self._gear()
        own = {} if gear is None else {value.path: value.value for value in gear.values()}
        fresh = sum(own.get(value.path) != value.value for value in load_gear(target).values())
        if fresh:
            values = counted(fresh, "identified value", "identified values")
            self._bar.say(
                f"Parameter set: {target}, with {values}. Another run can be compared with it.",
                "good",
            )
        else:
            why = ""
            if self._bar.tare.isVisible():
                why = " (friction of motor and gear together stays out: choose a tare)"
            self._bar.say(
                f"Parameter set: {target}. Nothing that was identified here belongs into it{why}.",
                "warning",
            )

    def _take_comparison(self, parameters: Path, out: str, complaint: str) -> None:
        self._command = None
        self._bar.set_busy(False)
        try:
            content = json.loads(out)
        except ValueError:
            self._bar.say(in_words(complaint), "bad")
            return
        self._bar.say("")
        self.compared.emit(content, parameters)
