"""From a proposal to an import: its table, the wording of its questions, and the options with what was accepted."""

from __future__ import annotations

import getpass
import math
import shlex
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from model.toml_text import toml_value
from rig.content.grid import Grid, columns
from rig.content.phrase import counted, phrase, shortened
from rig.errors import ConfigurationError
from rig.runfile.importing.channel_map import ImportOptions
from rig.runfile.importing.channel_source import ChannelSource
from rig.runfile.importing.looking import look_at
from rig.runfile.importing.map_keys import (
    CHANNEL_KEYS,
    CONDITIONS,
    GEAR_KEYS,
    RECORDING_KEYS,
    Key,
)
from rig.runfile.importing.opening import open_tables
from rig.runfile.importing.proposed import Proposal, Question
from rig.runfile.importing.suitability import unsuited_for
from rig.runfile.importing.units import TIME_CHANNEL, TRANSMISSION_ERROR

_TABLE_KIND = "friction-curve"
_LEFT_OUT = f"{TRANSMISSION_ERROR} is left out: it needs the input angle, and --ratio"

_USUAL = {one.name: one.default for one in fields(ImportOptions)}
FLAGS = {"serial": "--gear", "mounted": "--no-gear", "load_inertia_kg_m2": "--load-inertia"}
"""Keys of a map whose flag has another name."""


def proposal_grid(proposal: Proposal, *, all_columns: bool = False) -> Grid:
    """The columns that are used, what they are, and why; the others are named, or stand behind them."""
    shown = proposal.used_first if all_columns else proposal.used
    rows = [
        (
            one.heading,
            one.channel or "left out",
            one.unit or phrase("?", one.channel),
            "; ".join(one.evidence),
        )
        for one in shown
    ]
    others = [one.heading for one in proposal.columns if one not in shown]
    many = others and counted(len(others), "other column is", "other columns are")
    title = f"Proposed{phrase(' ({} left out: {})', many, shortened(', '.join(others), 200))}"
    return Grid(title, columns("column", "channel", "unit", "why"), rows)


def without_time(proposal: Proposal) -> Proposal:
    """The same where somebody said a rate, or that there is no time: no column is one, and none is asked for."""
    columns = tuple(one.freed_of(TIME_CHANNEL) for one in proposal.columns)
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
        return f"{question.text}{phrase(', such as {}', usual)} (Enter leaves it out): "
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
        said = one.option
        if one.scale is not None:
            said += f":{one.unit}:{_written(one.scale)}"
        elif one.unit:
            said += f":{one.unit}"
        words += ["-c", said]
        stated = (
            ("--modulus", one.modulus or None, ""),
            ("--lag", one.lag_s, "s"),
            ("--accuracy", one.accuracy, one.accuracy_unit),
        )
        for flag, value, unit in stated:
            if value is not None:
                words += [flag, f"{one.name}={_written(value)}{unit}"]
    for key, value in _stated_options(options, (*RECORDING_KEYS, *GEAR_KEYS)):
        flag = FLAGS.get(key, f"--{key.replace('_', '-')}")
        words.append(flag)
        if not isinstance(value, bool):
            words.append(_written(value))
    for name, value in options.conditions.items():
        words += ["--condition", f"{name}={_written(value)}"]
    if options.gear_file is not None:
        words += ["--parameters", str(options.gear_file)]
    return shlex.join(words)


def map_text(options: ImportOptions) -> str:
    """The same as a channel map (TOML); a parameter set of the gear stays a file of its own."""
    lines = []
    for one in options.channels:
        lines.append(f"[channels.{one.name}]")
        entry = [(key.name, getattr(one, key.name)) for key in CHANNEL_KEYS]
        lines += _entries((key, value) for key, value in entry if value not in ("", None, 0.0))
    for table, said in (
        ("recording", _stated_options(options, RECORDING_KEYS)),
        ("gear", _stated_options(options, GEAR_KEYS)),
        (CONDITIONS, options.conditions.items()),
    ):
        entries = _entries(said)
        if entries[:-1]:
            lines += [f"[{table}]", *entries]
    return "\n".join(lines)


def _stated_options(options: ImportOptions, keys: Sequence[Key]) -> Iterator[tuple[str, Any]]:
    """What was said beside the channels, by its key in a map: what is not as it is without."""
    for key in keys:
        value = getattr(options, key.field)
        if value not in (_USUAL[key.field], None) and not (
            isinstance(value, float) and math.isnan(value)
        ):
            yield key.name, value


def _entries(said: Iterable[tuple[str, Any]]) -> list[str]:
    return [*(f"{key} = {toml_value(value)}" for key, value in said), ""]


def _written(value: object) -> str:
    """A value as a flag takes it: a number short where that says all of it."""
    if not isinstance(value, float):
        return str(value)
    return f"{value:g}" if float(f"{value:g}") == value else repr(value)


def good_for(kind: str, files: Sequence[Path], options: ImportOptions) -> list[str]:
    """The kinds of fit that the recording can bear, as far as its channels tell."""
    reasons = unsuited_for(look_at(open_tables(kind, files, options), options), options)
    return [name for name, why in reasons.items() if not why]
