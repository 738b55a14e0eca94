"""The pages of what the program does: protocols, commands, exit codes, limits and trips."""

from __future__ import annotations

import inspect
from collections.abc import Iterable
from typing import Any

import typer

from reference_pages.words import cell, default_text, plain


def protocols() -> Iterable[str]:
    """Every protocol and analysis with its parameters (flag, unit, range, default, meaning) and settings."""
    from experiments import catalogue
    from experiments.parameters import parameter_fields
    from experiments.setting import EVERY_KIND

    yield "# Protocols and analyses"
    yield ""
    yield "Every protocol's parameters: the same model makes the flags, the window's form and this page. Settings"
    yield "are those of its analysis; `rig fit KIND --help` shows the same."
    for entry in catalogue.ENTRIES:
        experiment = catalogue.load(entry.name)
        yield f"\n## {entry.name}\n"
        yield f"{entry.summary[0].upper()}{entry.summary[1:]}."
        if not entry.has_plan:
            yield "An analysis of any recording; it moves nothing."
        if experiment.needs:
            yield f"\nNeeds the channels {', '.join(f'`{name}`' for name in experiment.needs)}."
        fields = parameter_fields(experiment.parameters)
        if fields:
            yield "\n| flag | unit | allowed | default | what |\n|---|---|---|---|---|"
            for f in fields:
                yield f"| `{f.flag}` | {f.unit} | {cell(f.limit)} | {cell(default_text(f.default))} | {cell(f.help)} |"
        yield "\n| setting (`rig fit --set`) | takes | without it | use it where |\n|---|---|---|---|"
        for one in (*experiment.settings, *EVERY_KIND):
            takes = f"{one.takes} {one.unit}".strip()
            yield f"| `{one.name}` | {cell(takes)} | {cell(one.default)} | {cell(one.when)} |"
        aims = [q for q in experiment.quantities if q.target_text]
        if aims:
            yield "\n| quantity | U of a useful result | why |\n|---|---|---|"
            for q in aims:
                yield f"| {cell(q.family_title)} | {q.target_text} | {cell(q.target_reason)} |"


def commands() -> Iterable[str]:
    """Every command with its arguments and options."""
    from rig.main import app

    yield "# Commands"
    yield ""
    yield "`rig COMMAND --help` shows the same. `rig run PROTOCOL --help` adds the flags of a protocol."
    top = typer.main.get_command(app)
    for name, command in subcommands(top):
        yield from _command(f"rig {name}", command)


def _command(path: str, command: Any) -> Iterable[str]:
    yield f"\n## {path}\n"
    yield plain(inspect.cleandoc(command.help or ""))
    inner = subcommands(command)
    for name, sub in inner:
        yield from _command(f"{path} {name}", sub)
    if inner:
        return
    shown = [
        p for p in command.params if "--help" not in p.opts and not getattr(p, "hidden", False)
    ]
    if shown:
        yield "\n| option | default | what |\n|---|---|---|"
    for parameter in shown:
        names = " ".join(f"`{name}`" for name in (*parameter.opts, *parameter.secondary_opts))
        if parameter.param_type_name == "argument":
            names = f"`{(parameter.metavar or parameter.name).strip('[]').upper()}`"
        default = parameter.default
        if callable(default) or default is None or repr(default).startswith("Sentinel"):
            default = ""
        text = getattr(parameter, "help", "") or ""
        yield f"| {names} | {cell(default_text(default))} | {cell(plain(text))} |"


def subcommands(command: Any) -> list[tuple[str, Any]]:
    """The commands of a group, none of a command; earlier names are left out."""
    inner = getattr(command, "commands", {})
    return [(name, one) for name, one in inner.items() if not one.hidden]


def exit_codes() -> Iterable[str]:
    """What an ending means to a script."""
    from rig import exits

    yield "# Exit codes"
    yield ""
    yield (exits.__doc__ or "").partition("\n\n")[2].strip()
    yield "\n| error | code | said as |\n|---|---:|---|"
    for kind, code, sentence in exits.CODE_OF_ERROR:
        yield f"| `{kind.__name__}` | {code} | {sentence} |"


def limits() -> Iterable[str]:
    """What is limited and watched, what a trip does, what it may come from."""
    from rig.bench import limits as lim
    from rig.run import trips

    yield "# Limits and trips"
    yield "\n## Limited quantities\n"
    yield "The tightest of the three tiers (drive, rig, protocol) holds; `rig plan` shows the margin to each."
    yield "\n| quantity | unit |\n|---|---|"
    for quantity, unit in lim.UNITS.items():
        yield f"| {quantity.replace('_', ' ')} | {unit} |"
    yield "\n## Trips\n"
    yield "The first cause is latched until `rig acknowledge` takes it away by name.\n"
    yield "| cause | what is done first | said as | what to do |\n|---|---|---|---|"
    for cause, row in trips.TRIPS.items():
        yield f"| `{cause}` | {row.action.value} | {cell(row.what)} | {cell(row.remedy)} |"
