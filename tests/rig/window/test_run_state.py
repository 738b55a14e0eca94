"""The word of a run over every sequence of six things that can be told or pressed: never a word that is not so."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import pytest

from experiments.recording import Event
from rig.run.parts import Progress
from rig.run.state import CHANGES, OVER, RunState, State

LENGTH = 6
SAFE, UNSAFE = {"make_safe": {"safe": True}}, {"make_safe": {"safe": False}}


def event(code: str, source: str = "session", level: str = "error") -> Event:
    return Event(0, level, code, source, code)


def progress(what: str) -> Progress:
    return Progress(step=1, steps=3, what=what, elapsed=1.0, left=2.0, speed=3.0, events=0)


THINGS: Mapping[str, Callable[[RunState], RunState]] = {
    "begun": lambda s: s if s.active else s.armed(),
    "turning": lambda s: s.went_on(progress("hold")),
    "making safe": lambda s: s.went_on(progress("making safe")),
    "question": lambda s: s.asked("?"),
    "answer": lambda s: s.answered(),
    "STOP": lambda s: s.pressed("STOP"),
    "ABORT": lambda s: s.pressed("ABORT"),
    "told to stop": lambda s: s.after(event("STOP", level="warning")),
    "trip": lambda s: s.after(event("over_speed")),
    "stands": lambda s: s.after(event("made-safe", "make-safe", "info")),
    "does not stand": lambda s: s.after(event("make-safe-failed", "make-safe")),
    "report COMPLETED": lambda s: s.reported({"outcome": "COMPLETED", **SAFE}),
    "report ABORTED": lambda s: s.reported({"outcome": "ABORTED", **SAFE}),
    "report TRIPPED": lambda s: s.reported({"outcome": "TRIPPED", **SAFE}),
    "report unsafe": lambda s: s.reported({"outcome": "ERROR", **UNSAFE}),
    "stage begun": lambda s: s.stage_begun(),
    "stage done": lambda s: s.stage_ended({"outcome": "COMPLETED", **SAFE}, "next"),
    "stage stopped": lambda s: s.stage_ended({"outcome": "ABORTED", **SAFE}, "next"),
    "campaign done": lambda s: s.campaign_reported({"complete": True, "verdict": "PASS"}),
    "campaign stopped": lambda s: s.campaign_reported({"complete": False, "outcome": "ABORTED"}),
    "gone, reported": lambda s: s.gone(True, "") if s.told else s,
    "gone": lambda s: s if s.told else s.gone(False, "", killed=True),
    "refused": lambda s: s if s.told else s.gone(False, "no such motor"),
}
"""What can be told or pressed. A process that has told its report is gone with it; one that has not is gone without."""
PRESSED = ("STOP", "ABORT", "answer")


def reached(length: int) -> Iterator[tuple[RunState, str, RunState]]:
    """Every state that a sequence of this length reaches, with what came and what became of it; each step once."""
    known = {RunState()}
    edge = {RunState()}
    for _ in range(length):
        after: set[RunState] = set()
        for state in edge:
            for name, tell in THINGS.items():
                # What is told of a run is told by a process that is there.
                if name != "begun" and not state.active and name not in PRESSED:
                    continue
                became = tell(state)
                yield state, name, became
                after.add(became)
        edge = after - known
        known |= after


STEPS = tuple(reached(LENGTH))


def test_every_state_is_reached() -> None:
    assert {became.state for _, _, became in STEPS} == set(State)
    assert len(STEPS) > 1000


def test_no_word_follows_upon_one_that_it_must_not_follow() -> None:
    for state, name, became in STEPS:
        allowed = {state.state} | CHANGES[state.state]
        assert became.state in allowed, f"{state} {name} {became}"


def test_after_the_report_nothing_that_is_pressed_or_told_changes_what_is_shown() -> None:
    for state, name, became in STEPS:
        if state.told and state.active and name not in ("gone, reported", "begun"):
            assert became == state or name.startswith(("report", "campaign")), f"{state} {name}"
            assert (became.state, became.safe) == (state.state, state.safe), f"{state} {name}"


def test_a_run_of_a_campaign_that_is_done_is_never_called_finished() -> None:
    """It is being analysed, whatever it was doing last; after a STOP no other one begins."""
    doing = {State.ARMED, State.RUNNING, State.WAITING, State.STOPPING, State.ANALYSING}
    for state, name, became in STEPS:
        if name == "stage done" and state.state in doing and not state.told:
            wanted = State.STOPPING if state.stop_asked else State.ANALYSING
            assert became.state is wanted, f"{state} {became}"


@pytest.mark.parametrize("before", [("turning",), ("turning", "making safe"), ("making safe",)])
def test_a_run_of_a_campaign_that_was_completed_is_analysed(before: tuple[str, ...]) -> None:
    state = RunState()
    for name in ("begun", *before, "stands", "stage done"):
        state = THINGS[name](state)
    assert (state.state, state.outcome) == (State.ANALYSING, "")


def test_a_process_that_is_gone_leaves_a_word_that_says_so() -> None:
    for state, name, became in STEPS:
        if became.ended:
            assert became.state in OVER, f"{state} {name} {became}"


def test_what_is_pressed_without_a_run_changes_nothing() -> None:
    for state, name, became in STEPS:
        if name in PRESSED and not state.active:
            assert became == state


def test_a_trip_and_an_unsafe_end_are_not_talked_away() -> None:
    for state, name, became in STEPS:
        if state.safe is False and name not in ("begun", "stands", "stage begun"):
            assert became.state in (State.TRIPPED, State.LOST), f"{state} {name} {became}"
        if state.state is State.TRIPPED and state.active:
            assert became.state is not State.RUNNING, f"{state} {name} {became}"
            assert became.state is not State.STOPPING, f"{state} {name} {became}"


def test_red_is_what_can_be_stopped() -> None:
    for _, _, became in STEPS:
        assert became.may_turn is (became.active and not became.told)


@pytest.mark.parametrize("presses", [("STOP",), ("STOP", "ABORT"), ("STOP", "ABORT", "ABORT")])
@pytest.mark.parametrize("late", range(4))
def test_esc_twice_and_three_times_ends_in_the_word_of_the_report(
    presses: tuple[str, ...], late: int
) -> None:
    """However many of the presses come after the report."""
    told = ["begun", "turning", *presses[:late], "told to stop", "stands", "report ABORTED"]
    state = RunState()
    for name in (*told, *presses[late:], "gone, reported"):
        state = THINGS[name](state)
    assert (state.state, state.outcome, state.ended) == (State.FINISHED, "ABORTED", True)


def test_a_stop_between_two_runs_of_a_campaign_ends_as_one() -> None:
    state = RunState()
    for name in ("begun", "turning", "stage done", "STOP", "campaign stopped", "gone, reported"):
        state = THINGS[name](state)
    assert (state.state, state.outcome) == (State.FINISHED, "ABORTED")
