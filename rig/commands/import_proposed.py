"""`rig import FILE` and nothing else: the columns are proposed, what stays open is asked, nothing is guessed."""

from __future__ import annotations

import getpass
import math
import shlex
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from model.toml_text import toml_value
from rig.commands.terminal import console, echo, painted
from rig.content.grid import Grid, columns
from rig.errors import ConfigurationError
from rig.runfile.importing.answers import answered
from rig.runfile.importing.channel_source import ChannelSource, parse_channel
from rig.runfile.importing.proposed import Proposal, Question
from rig.runfile.importing.units import TIME_CHANNEL

if TYPE_CHECKING:
    from rig.runfile.importing.channel_map import ImportOptions

MOST_QUESTIONS = 5
_TABLE_KIND = "friction-curve"
Ask = Callable[[str], str]
_LAST = "Enter imports it so; NAME=COLUMN:UNIT says another channel first, such as position=4:rad; Ctrl-C leaves it."


def proposal_grid(proposal: Proposal, *, all_columns: bool = False) -> Grid:
    """The columns that are used, what they are, and why; the others are counted."""
    shown = proposal.columns if all_columns else proposal.used
    rows = [
        (
            one.heading,
            one.channel or "left out",
            one.unit or ("?" if one.channel else ""),
            "; ".join(one.evidence),
        )
        for one in shown
    ]
    others = len(proposal.columns) - len(shown)
    title = "Proposed" + (f" ({others} other columns are left out)" if others else "")
    return Grid(title, columns("column", "channel", "unit", "why"), rows)


def told(proposal: Proposal) -> dict[str, Any]:
    """The proposal as one object."""
    return {
        "columns": [asdict(one) for one in proposal.columns],
        "questions": [asdict(one) for one in proposal.questions],
        "ratio": proposal.ratio if math.isfinite(proposal.ratio) else None,
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
        if asked > 3 * MOST_QUESTIONS or len(proposal.questions) > MOST_QUESTIONS:
            raise _open(proposal, "more is open than can be asked one by one")
        answer = ask(_wording(question)).strip() or _by_evidence(question)
        try:
            proposal = answered(proposal, question, answer)
        except ConfigurationError as error:
            echo(str(error), errors=True)
    return proposal


def without_time(proposal: Proposal) -> Proposal:
    """The same where somebody said a rate, or that there is no time: no column is one, and none is asked for."""
    columns = tuple(
        replace(one, channel="") if one.channel == TIME_CHANNEL else one for one in proposal.columns
    )
    about = ("rate", TIME_CHANNEL)
    rest = (one for one in proposal.questions if one.why not in about and one.about not in about)
    return replace(proposal, columns=columns, questions=tuple(rest))


def said_beside(ask: Ask) -> tuple[ChannelSource, ...]:
    """Channels that somebody names beside what was proposed, one a line, until Enter imports it."""
    said: list[ChannelSource] = []
    while line := ask(_LAST).strip():
        try:
            said.append(parse_channel(line))
        except ConfigurationError as error:
            echo(str(error), errors=True)
    return tuple(said)


def _wording(question: Question) -> str:
    usual = ", ".join(question.usual)
    if question.why == "which":
        return f"{question.text} (Enter: {question.about}, which moves most): "
    if question.why == "channel":
        return f"{question.text}: {usual} (Enter: {question.usual[0]}): "
    if question.why == "unit":
        return f"{question.text}{f', such as {usual}' if usual else ''} (Enter leaves it out): "
    return f"{question.text}: "


def _by_evidence(question: Question) -> str:
    """What Enter stands for."""
    if question.why == "which":
        return question.about
    return question.usual[0] if question.why == "channel" else ""


def refuse_open(proposal: Proposal) -> None:
    """Raise `ConfigurationError` with all that stays open: a script is asked nothing."""
    if proposal.questions:
        raise _open(proposal, "what stays open is not guessed")


def refuse_useless(proposal: Proposal, files: Sequence[Path]) -> None:
    """Raise `ConfigurationError` where no column was recognised."""
    if any(one.channel not in ("", "time") for one in proposal.columns):
        return
    headings = ", ".join(one.heading for one in proposal.columns[:12])
    raise ConfigurationError(
        "no column is recognised",
        where=", ".join(map(str, files)),
        value=headings,
        remedy='Say what they are: -c position=COLUMN:rad -c torque=COLUMN:"N m"; '
        "--check lists the columns.",
    )


def _open(proposal: Proposal, why: str) -> ConfigurationError:
    listed = "; ".join(one.text for one in proposal.questions)
    return ConfigurationError(
        why,
        where="rig import",
        value=listed,
        remedy="Say it: -c NAME=COLUMN:UNIT for a channel, --rate for a rate; or answer at a terminal.",
    )


def accepted(
    options: ImportOptions, proposal: Proposal, said: Sequence[ChannelSource] = ()
) -> ImportOptions:
    """The options of the import with all that was proposed and accepted, and by whom; what was said goes before it."""
    ratio, names = options.ratio, {one.name for one in said}
    return replace(
        options,
        channels=(*(one for one in proposal.sources if one.name not in names), *said),
        rate=options.rate or proposal.rate or None,
        ratio=ratio if math.isfinite(ratio) else proposal.ratio,
        output_sense=options.output_sense or proposal.output_sense,
        no_time=options.no_time or proposal.is_table,
        experiment=options.experiment or (_TABLE_KIND if proposal.is_table else ""),
        proposed=proposal.sentences,
        accepted_by=options.operator or _who(),
    )


def _who() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return "nobody by name"


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
    console().print(painted(proposal_grid(proposal)))
    for sentence in proposal.sentences[len(proposal.used) :]:
        echo(f"  {sentence}")


def command_of(kind: str, files: Sequence[Path], options: ImportOptions) -> str:
    """The one command that does the same without a question."""
    words = ["rig", "import", kind, *map(str, files)]
    for one in options.channels:
        scale = "" if one.scale is None else f":{one.scale:g}"
        words += ["-c", f"{one.option}{f':{one.unit}' if one.unit or scale else ''}{scale}"]
    if options.rate:
        words += ["--rate", f"{options.rate:g}"]
    if math.isfinite(options.ratio):
        words += ["--ratio", f"{options.ratio:g}"]
    if options.output_sense:
        words += ["--output-sense", str(options.output_sense)]
    if options.experiment:
        words += ["--protocol", options.experiment]
    if options.gear_serial:
        words += ["--gear", options.gear_serial]
    return shlex.join(words)


def map_text(options: ImportOptions) -> str:
    """The same as a channel map (TOML)."""
    lines = []
    for one in options.channels:
        lines.append(f"[channels.{one.name}]\ncolumn = {toml_value(one.column)}")
        lines += [f"unit = {toml_value(one.unit)}"] if one.unit else []
        lines += [f"file = {toml_value(one.file)}"] if one.file else []
        lines += [f"scale = {one.scale!r}"] if one.scale is not None else []
        lines.append("")
    recording = [f"rate = {options.rate!r}"] if options.rate else []
    recording += ["no_time = true"] if options.no_time else []
    recording += [f"protocol = {toml_value(options.experiment)}"] if options.experiment else []
    gear = [f"ratio = {options.ratio!r}"] if math.isfinite(options.ratio) else []
    gear += [f"output_sense = {options.output_sense}"] if options.output_sense else []
    for name, found in (("recording", recording), ("gear", gear)):
        lines += [f"[{name}]", *found, ""] if found else []
    return "\n".join(lines)
