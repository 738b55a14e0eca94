"""A protocol in whose motion every callback is called, and callbacks that raise there: by the API, as the window's
child and on the command line.
"""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

import rig
from experiments import catalogue
from experiments.catalogue import Entry
from experiments.contract import Evidence, Experiment
from experiments.recording import Event, Recording
from experiments.result import Result
from experiments.steps.note import Mark, Prompt
from experiments.steps.vocabulary import HoldTime, Ramp, Step
from model.gear import HarmonicDrive
from rig import main
from rig.run.ordering import order_of
from rig.run.remote import RemoteOperator
from rig.run.start import run_order

SPEED = 30.0
"""rad/s at which everything is raised."""
IN_MOTION = "in-motion"
"""The code of the event at that speed."""
CALLBACKS = ("on_progress", "on_event", "ask")
ERRORS = (ValueError, SystemExit, KeyboardInterrupt)


@dataclass(frozen=True, kw_only=True)
class Parameters:
    """There is nothing to choose."""


def plan(parameters: Parameters, gear: HarmonicDrive) -> Iterator[Step]:
    """Turn, say so, ask, turn on, stand."""
    yield Ramp(SPEED, 300.0)
    yield HoldTime(0.05)
    yield Mark(IN_MOTION, "it turns")
    yield Prompt("Does it turn?", "turns")
    yield HoldTime(0.2)
    yield Ramp(0.0, 300.0)


def analyse(recording: Recording, evidence: Evidence) -> Result:
    """Nothing is judged."""
    return Result(run=recording.metadata.run_id, kind="raising", estimates={})


EXPERIMENT = Experiment(
    name="raising",
    title="callbacks that raise",
    summary="",
    parameters=Parameters,
    plan=plan,
    analyse=analyse,
)


def in_the_catalogue(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the protocol be found by its name."""
    entry = Entry("raising", __name__, "callbacks that raise")
    monkeypatch.setattr(catalogue, "ENTRIES", (*catalogue.ENTRIES, entry))


@dataclass
class Raiser:
    """The callbacks of one run, of which one raises while the rig turns; `calls` of it after that."""

    which: str
    error: type[BaseException]
    answer: str | None = "yes"
    raised: bool = False
    calls_after: int = 0
    after: Callable[[], None] = lambda: None

    def _raise(self, which: str) -> None:
        if which != self.which:
            return
        if self.raised:
            self.calls_after += 1
        self.raised = True
        self.after()
        raise self.error("a defect")

    def on_progress(self, progress: Any) -> None:
        """Raise while it turns; progress tells a mean of 50 cycles, which lags at a slow SYNC."""
        if self.raised or progress.speed > 0.5 * SPEED:
            self._raise("on_progress")

    def on_event(self, event: Event) -> None:
        """Raise at the event that is told at speed."""
        if self.raised or event.code == IN_MOTION:
            self._raise("on_event")

    def ask(self, prompt: Prompt) -> str | None:
        """Raise at the question, which is put at speed."""
        self._raise("ask")
        return self.answer


@dataclass(frozen=True)
class Carrier:
    """A rig on which it is tried: how it is named to the API, and on the command line."""

    asked: Mapping[str, Any]
    words: tuple[str, ...] = ()
    folder: Path = field(default_factory=Path)


def by_api(carrier: Carrier, raiser: Raiser, monkeypatch: pytest.MonkeyPatch) -> None:
    """`rig.execute`, whose only callback is `ask`."""
    rig.execute("raising", folder=carrier.folder, ask=raiser.ask, **carrier.asked)


def by_order(carrier: Carrier, raiser: Raiser, monkeypatch: pytest.MonkeyPatch) -> None:
    """What every caller comes to."""
    said = {"folder": carrier.folder, **carrier.asked}
    confirmation = said.pop("confirm", "")
    run_order(
        order_of("raising", {}, said),
        confirmation=confirmation,
        ask=raiser.ask,
        on_progress=raiser.on_progress,
        on_event=raiser.on_event,
    )


def by_window(carrier: Carrier, raiser: Raiser, monkeypatch: pytest.MonkeyPatch) -> None:
    """`rig run --json` as the window starts it."""
    for name in CALLBACKS:
        monkeypatch.setattr(RemoteOperator, name, staticmethod(getattr(raiser, name)))
    reader, writer = os.pipe()
    with os.fdopen(reader) as lines:
        monkeypatch.setattr(sys, "stdin", lines)
        try:
            _run(carrier, "--events", "--stdin-control")
        finally:
            os.close(writer)


def by_command(carrier: Carrier, raiser: Raiser, monkeypatch: pytest.MonkeyPatch) -> None:
    """`rig run` at a terminal."""

    @contextmanager
    def line(*_: Any) -> Iterator[Any]:
        yield raiser.on_progress, raiser.on_event

    monkeypatch.setattr("rig.commands.progress.progress_line", line)
    monkeypatch.setattr("rig.commands.prompting.terminal_ask", lambda stop: raiser.ask)
    _run(carrier)


def _run(carrier: Carrier, *flags: str) -> None:
    """`rig run`; an error that is no exit becomes one by `rig.main`, with its sentence."""
    words = ["run", "raising", "--output", str(carrier.folder), *carrier.words, *flags]
    said = io.StringIO()
    with redirect_stdout(io.StringIO()), redirect_stderr(said):
        try:
            main.run(words)
        except SystemExit as end:
            if end.code:
                raise EndedError(said.getvalue()) from end


class EndedError(Exception):
    """The command ended with an exit code that is none of success; what it said."""


WAYS = {"request": by_order, "api": by_api, "window": by_window, "command": by_command}
"""Every way to a run."""
CASES = [
    (way, which, error)
    for way in WAYS
    for which in CALLBACKS
    for error in ERRORS
    # The API asks, and tells nothing.
    if way != "api" or which == "ask"
]
"""Way, callback, error."""


def judge(
    carrier: Carrier,
    way: str,
    which: str,
    error: type[BaseException],
    monkeypatch: pytest.MonkeyPatch,
) -> Raiser:
    """Run, and hold what the run left against the rule."""
    in_the_catalogue(monkeypatch)
    raiser = Raiser(which, error)
    if which != "ask" and error is ValueError:
        WAYS[way](carrier, raiser, monkeypatch)
        outcome, codes, text = what_was_left(carrier.folder)
        assert outcome == "COMPLETED", text
        assert f"{which} raised ValueError: a defect; it was not called any more" in text
        assert codes.count("callback") == 1
    else:
        expected = (EndedError if way in ("window", "command") else error,)
        with pytest.raises(expected) as raised:
            WAYS[way](carrier, raiser, monkeypatch)
        told = " ".join([str(raised.value), *getattr(raised.value, "__notes__", ())])
        assert "standstill was verified" in told
        outcome, codes, text = what_was_left(carrier.folder)
        assert outcome == "ABORTED", text
        assert f"STOP by {which} raised {error.__name__}" in text
        assert {"STOP", "callback", "made-safe"} < set(codes)
        assert not {"ABORT", "exception"} & set(codes)
        assert "controlled stop: standstill verified" in text
    assert raiser.raised
    assert raiser.calls_after == 0
    return raiser


def what_was_left(folder: Path) -> tuple[str, list[str], str]:
    """Outcome, codes and texts of the events of the one run file in a folder, which is sealed."""
    (path,) = folder.glob("*.h5")
    run = rig.load(path)
    events = run.recording.events
    found = run.outcome, [event.code for event in events], "\n".join(e.text for e in events)
    return found
