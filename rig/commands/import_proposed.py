"""`rig import FILE` and nothing else: the columns are proposed, what stays open is asked, nothing is guessed."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

from rig.commands.terminal import console, echo, painted
from rig.errors import ConfigurationError
from rig.runfile.importing import accepting
from rig.runfile.importing.answers import answered
from rig.runfile.importing.channel_source import ChannelSource, parse_channel
from rig.runfile.importing.proposed import Proposal

_MOST_QUESTIONS = 5
Ask = Callable[[str], str]
_LAST = "Enter imports it so; NAME=COLUMN:UNIT says another channel first, such as position=4:rad; Ctrl-C leaves it."


def proposal_object(proposal: Proposal) -> dict[str, Any]:
    """The proposal as one object."""
    return {
        "columns": [asdict(one) for one in proposal.columns],
        "questions": [asdict(one) for one in proposal.questions],
        "ratio": proposal.ratio,
        "output_sense": proposal.output_sense or None,
        "is_table": proposal.is_table,
    }


def settled(proposal: Proposal, ask: Ask) -> Proposal:
    """The proposal with its questions answered; Enter takes the one that has evidence, and leaves out what has no unit.

    A wrong answer is told and asked for again. Raises `ConfigurationError` for more than five questions.
    """
    asked = 0
    while proposal.questions:
        question = proposal.questions[0]
        asked += 1
        if asked > 3 * _MOST_QUESTIONS or len(proposal.questions) > _MOST_QUESTIONS:
            raise accepting.still_open(proposal, "more is open than can be asked one by one")
        answer = ask(accepting.wording(question)).strip() or question.by_evidence
        try:
            proposal = answered(proposal, question, answer)
        except ConfigurationError as error:
            echo(str(error), errors=True)
    return proposal


def said_beside(ask: Ask) -> tuple[ChannelSource, ...]:
    """Channels that somebody names beside what was proposed, one a line, until Enter imports it."""
    said: list[ChannelSource] = []
    while line := ask(_LAST).strip():
        try:
            said.append(parse_channel(line))
        except ConfigurationError as error:
            echo(str(error), errors=True)
    return tuple(said)


def asks() -> bool:
    """Whether somebody sits at the terminal."""
    return sys.stdin.isatty()


def ask_at_the_terminal(text: str) -> str:
    """One line of whoever sits there; the end of the input is Ctrl-C."""
    echo(text, errors=True)
    try:
        return input("> ")
    except EOFError:
        raise KeyboardInterrupt from None


def show(proposal: Proposal) -> None:
    """The table, and what the numbers tell of the gear."""
    console().print(painted(accepting.proposal_grid(proposal)))
    for sentence in proposal.sentences[len(proposal.used) :]:
        echo(f"  {sentence}")
