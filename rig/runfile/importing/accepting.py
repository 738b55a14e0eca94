"""From a proposal to an import: its table, the wording of its questions, and the options with what was accepted."""

from __future__ import annotations

import getpass
import math
import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from model.toml_text import toml_value
from rig.content.grid import Grid, columns
from rig.errors import ConfigurationError
from rig.runfile.importing.channel_map import ImportOptions
from rig.runfile.importing.channel_source import ChannelSource
from rig.runfile.importing.looking import look_at
from rig.runfile.importing.opening import open_tables
from rig.runfile.importing.proposed import Proposal, Question
from rig.runfile.importing.reach import reach_of
from rig.runfile.importing.units import TIME_CHANNEL, TRANSMISSION_ERROR

_TABLE_KIND = "friction-curve"
_LEFT_OUT = f"{TRANSMISSION_ERROR} is left out: it needs the input angle, and --ratio"


def proposal_grid(proposal: Proposal, *, all_columns: bool = False) -> Grid:
    """The columns that are used, what they are, and why; the others are counted, or stand behind them."""
    shown = proposal.used_first if all_columns else proposal.used
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


def without_time(proposal: Proposal) -> Proposal:
    """The same where somebody said a rate, or that there is no time: no column is one, and none is asked for."""
    columns = tuple(
        replace(one, channel="") if one.channel == TIME_CHANNEL else one for one in proposal.columns
    )
    about = ("rate", TIME_CHANNEL)
    rest = (one for one in proposal.questions if one.why not in about and one.about not in about)
    return replace(proposal, columns=columns, questions=tuple(rest))


def wording(question: Question) -> str:
    """The question as it is asked at a terminal, with what Enter stands for."""
    usual = ", ".join(question.usual)
    if question.why == "which":
        return f"{question.text} (Enter: {question.about}, which moves most): "
    if question.why == "channel":
        return f"{question.text}: {usual} (Enter: {question.usual[0]}): "
    if question.why == "unit":
        return f"{question.text}{f', such as {usual}' if usual else ''} (Enter leaves it out): "
    return f"{question.text}: "


def refuse_open(proposal: Proposal) -> None:
    """Raise `ConfigurationError` with all that stays open: a script is asked nothing."""
    if proposal.questions:
        raise still_open(proposal, "what stays open is not guessed")


def is_useless(proposal: Proposal) -> bool:
    """Whether no column was recognised, but for a time."""
    return all(one.channel in ("", TIME_CHANNEL) for one in proposal.columns)


def refuse_useless(proposal: Proposal, files: Sequence[Path]) -> None:
    """Raise `ConfigurationError` where no column was recognised."""
    if not is_useless(proposal):
        return
    headings = ", ".join(one.heading for one in proposal.columns[:12])
    raise ConfigurationError(
        "no column is recognised",
        where=", ".join(map(str, files)),
        value=headings,
        remedy='Say what they are: -c position=COLUMN:rad -c torque=COLUMN:"N m"; '
        "--check lists the columns.",
    )


def still_open(proposal: Proposal, why: str) -> ConfigurationError:
    """The refusal that names all that stays open."""
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
    names = {one.name for one in said}
    ratio = options.ratio if math.isfinite(options.ratio) else proposal.ratio
    taken = [one for one in proposal.sources if one.name not in names]
    left: tuple[str, ...] = ()
    has_input = any(one.name == "input_angle" for one in (*taken, *said))
    if not (has_input and (math.isfinite(ratio) or options.gear is not None)):
        # Nothing follows from it then: what was proposed must not hinder the rest.
        left = tuple(_LEFT_OUT for one in taken if one.name == TRANSMISSION_ERROR)
        taken = [one for one in taken if one.name != TRANSMISSION_ERROR]
    return replace(
        options,
        channels=(*taken, *said),
        rate=options.rate or proposal.rate or None,
        ratio=ratio,
        output_sense=options.output_sense or proposal.output_sense,
        no_time=options.no_time or proposal.is_table,
        experiment=options.experiment or (_TABLE_KIND if proposal.is_table else ""),
        proposed=(*proposal.sentences, *left),
        accepted_by=options.operator or _who(),
    )


def _who() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return "nobody by name"


def command_of(kind: str, files: Sequence[Path], options: ImportOptions) -> str:
    """The one command that does the same without a question."""
    words = ["rig", "import", kind, *map(str, files)]
    for one in options.channels:
        scale = "" if one.scale is None else f":{one.scale:g}"
        words += ["-c", f"{one.option}{f':{one.unit}' if one.unit or scale else ''}{scale}"]
    if options.rate:
        words += ["--rate", f"{options.rate:g}"]
    if options.speed:
        words += ["--speed", str(options.speed)]
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
    recording += [f"speed = {toml_value(options.speed)}"] if options.speed else []
    recording += ["no_time = true"] if options.no_time else []
    recording += [f"protocol = {toml_value(options.experiment)}"] if options.experiment else []
    gear = [f"ratio = {options.ratio!r}"] if math.isfinite(options.ratio) else []
    gear += [f"output_sense = {options.output_sense}"] if options.output_sense else []
    for name, found in (("recording", recording), ("gear", gear)):
        lines += [f"[{name}]", *found, ""] if found else []
    return "\n".join(lines)


def good_for(kind: str, files: Sequence[Path], options: ImportOptions) -> list[str]:
    """The kinds of fit that the recording can bear, as far as its channels tell."""
    reach = reach_of(look_at(open_tables(kind, files, options), options), options)
    return [name for name, why in reach.items() if not why]
