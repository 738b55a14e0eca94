"""Questions at a terminal: consent is a word, Enter alone is none, and nothing waits while the question stands."""

from __future__ import annotations

import io

import pytest

from experiments.steps.note import Prompt
from rig.commands.prompting import NOBODY, TerminalOperator, terminal_ask
from rig.run.stop import StopRequest

GEAR_OFF = Prompt("Take the gear off.", "gear-removed", consent="The gear is removed")
READING = Prompt("Temperature [°C]?", "temperature")


@pytest.fixture
def said() -> list[str]:
    return []


def operator(
    said: list[str], *lines: str, ends: bool = False
) -> tuple[TerminalOperator, StopRequest]:
    """Somebody who has been asked, then types these lines."""
    stop = StopRequest()
    made = TerminalOperator(stop, said.append)
    return made, stop


def type_in(made: TerminalOperator, *lines: str) -> None:
    for line in lines:
        made._lines.put(line)


def test_consent_is_the_word_and_nothing_else(said: list[str]) -> None:
    made, stop = operator(said)
    assert made.ask(GEAR_OFF) is None
    assert said == [
        "\nTake the gear off.\nThe gear is removed: type yes, then Enter, if that is so: "
    ]
    type_in(made, "\n", "y\n", "the coupling was warm\n", " YES \n")
    assert [made.ask(GEAR_OFF) for _ in range(4)] == [None, None, None, GEAR_OFF.consent]
    assert len(said) == 4, "asked again after each line that is none"
    assert stop.level == 0


def test_what_was_typed_before_the_question_is_no_answer(said: list[str]) -> None:
    made, _ = operator(said)
    type_in(made, "yes\n", "22\n")
    assert made.ask(GEAR_OFF) is None
    assert made.ask(GEAR_OFF) is None
    type_in(made, "yes\n")
    assert made.ask(GEAR_OFF) == GEAR_OFF.consent
    type_in(made, "yes\n")
    assert made.ask(GEAR_OFF) is None, "a question that is put again is another one"


def test_a_reading_is_text_and_empty_is_none(said: list[str]) -> None:
    made, _ = operator(said)
    assert made.ask(READING) is None
    type_in(made, "\n", " 22.5 \n")
    assert made.ask(READING) is None
    assert made.ask(READING) == "22.5"


def test_the_end_of_the_input_is_a_stop_and_no_consent(said: list[str]) -> None:
    made, stop = operator(said)
    made.listen(iter(["yes\n"]))
    assert made.ask(GEAR_OFF) is None
    assert made.ask(GEAR_OFF) is None
    assert stop.level == 1


def test_without_a_terminal_nobody_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("yes\n"))
    assert terminal_ask(StopRequest())(GEAR_OFF) == NOBODY
