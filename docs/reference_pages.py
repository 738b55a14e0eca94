"""The reference pages that are made from the program: protocols, measurands, commands, files, exit codes, limits.

Nothing here is written twice: protocols come from their parameter models, commands from the command
line's own tables, words of the configuration from its schema.
"""

from __future__ import annotations

import dataclasses
import inspect
import re
import sys
import types
import typing
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import typer
from pydantic import BaseModel


def write(folder: Path) -> None:
    """Write every page, and leave alone what has not changed."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, lines in PAGES.items():
        text = "\n".join(lines()) + "\n"
        path = folder / f"{name}.md"
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def protocols() -> Iterable[str]:
    """Every protocol and analysis with its parameters: flag, unit, allowed range, default, meaning."""
    from experiments import catalogue
    from experiments.parameters import parameter_fields

    yield "# Protocols and analyses"
    yield ""
    yield "Every protocol's parameters: the same model makes the flags, the window's form and this page."
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
    shown = [p for p in command.params if "--help" not in p.opts]
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
    """The commands of a group, none of a command."""
    return list(getattr(command, "commands", {}).items())


def configuration() -> Iterable[str]:
    """Every word of rig.toml with its kind, default and meaning."""
    from rig.bench.config.schema import RigConfiguration

    yield "# Words of rig.toml"
    yield ""
    yield (
        "`rig config init` writes a file with every word explained; this page lists them "
        "with their kinds and defaults."
    )
    for path, model in _tables("", RigConfiguration):
        yield f"\n## {path or 'top level'}\n"
        yield plain(inspect.cleandoc(model.__doc__ or ""))
        yield "\n| word | kind | default |\n|---|---|---|"
        for name, field in model.model_fields.items():
            default = "required" if field.is_required() else default_text(field.default)
            yield f"| `{field.alias or name}` | {cell(kind_text(field.annotation))} | {cell(default)} |"


def _tables(path: str, model: type[BaseModel]) -> Iterable[tuple[str, type[BaseModel]]]:
    yield path, model
    for name, field in model.model_fields.items():
        for kind in arms(field.annotation):
            if isinstance(kind, type) and issubclass(kind, BaseModel):
                word = f"{path}.{field.alias or name}" if path else field.alias or name
                is_list = typing.get_origin(field.annotation) is tuple
                yield from _tables(f"{word}[]" if is_list else word, kind)


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


def gear_file() -> Iterable[str]:
    """Every word of a gear's parameter file."""
    from model import gear_file as file
    from model.gear import ModelOptions

    yield "# The gear file"
    yield ""
    yield (
        f'TOML with `format = "{file.FORMAT}"`, `name` (the part number), the tables below, the list '
        "`kinematic_error.orders` and the table `options`. `rig gear new` makes one, `rig gear check` looks it over. "
        "Every number is a line of `{ value, unit, provenance, source, standard_uncertainty }`; the last three may be "
        "left away."
    )
    yield from _origins()
    for name, kind in file.SECTIONS.items():
        yield from _section(name, kind)
    yield "\n## kinematic_error.orders\n"
    yield "Each `{ order, cosine, sine, unit, provenance, source, standard_uncertainty }`: cycles per input revolution,"
    yield "and amplitudes of at most one degree."
    yield "\n## options\n"
    yield "\n".join(inspect.cleandoc(ModelOptions.__doc__ or "").splitlines()[:1])
    yield "\n| word | kind |\n|---|---|"
    for name, hint in typing.get_type_hints(ModelOptions).items():
        yield f"| `{name}` | {cell(kind_text(hint))} |"


def motor_file() -> Iterable[str]:
    """Every word of a motor's parameter file."""
    from model import motor

    yield "# The motor file"
    yield ""
    yield (
        f'TOML with `format = "{motor.FORMAT}"`, `name` and the table `motor`, lines as in the gear file. '
        "`rig motor new` makes one, `rig motor check` looks it over, `motor` in `rig.toml` names it."
    )
    yield from _origins()
    yield from _section("motor", motor.ServoMotor)


def _origins() -> Iterable[str]:
    from model.gear import Provenance
    from model.quantities import UNITS

    yield (
        "\n*provenance* is one of " + ", ".join(typing.get_args(Provenance)) + "; *source* is text."
    )
    yield "Units besides SI: " + ", ".join(f"`{unit}`" for unit in UNITS) + "."


def _section(name: str, kind: Any) -> Iterable[str]:
    from model.gear import allowed_range, is_unknown

    yield f"\n## {name}\n"
    yield plain((kind.__doc__ or "").partition("\n")[0])
    yield "\n| word | symbol | SI unit | allowed | what |\n|---|---|---|---|---|"
    for f in dataclasses.fields(kind):
        if "unit" in f.metadata:
            meta = f.metadata
            what = meta["description"] + ("; may be left away" if is_unknown(f, None) else "")
            limit = cell(allowed_range(meta))
            yield f"| `{f.name}` | {meta['symbol']} | {meta['unit']} | {limit} | {cell(what)} |"


def channel_map() -> Iterable[str]:
    """Every table and key of a channel map, the units, the channels with a name, the labels of segments."""
    from rig.runfile.importing import map_keys, units

    yield "# The channel map"
    yield ""
    yield plain(inspect.cleandoc(map_keys.__doc__ or ""))
    titles = {"channels": "channels.NAME", "reverse": "reverse.NAME", "segments": "segments[]"}
    for table, keys in map_keys.TABLES.items():
        yield f"\n## {titles.get(table, table)}\n"
        if table == "reverse":
            yield "The reverse half of a table that has both directions in one row; keys as in `channels.NAME`."
            continue
        yield "| key | kind | what | needed |\n|---|---|---|---|"
        for key in keys:
            yield f"| `{key.name}` | {key.kind} | {cell(key.what)} | {'yes' if key.is_needed else ''} |"
    yield "\n`[conditions]` takes any name with a text or a number; `[segments_from.labels]` a label for each word.\n"
    yield "## Channels with a name\n"
    yield "| channel | SI unit |\n|---|---|"
    for name, allowed in units.DIMENSIONS.items():
        yield f"| `{name}` | {' or '.join(allowed)} |"
    yield "\nAny other name may have any unit. `NAME_uncertainty` is the standard uncertainty of `NAME`, in its unit.\n"
    yield "## Units\n"
    words = [*units.UNITS, units.COUNT, *units.TEXT_TIMES]
    yield ", ".join(f"`{word}`" for word in words)
    yield "\n## Labels of segments\n"
    yield "| label | what |\n|---|---|"
    for label, what in map_keys.LABELS.items():
        yield f"| `{label}` | {cell(what)} |"


def acceptance_file() -> Iterable[str]:
    """Every word of an acceptance file, and the quantities that can be limited."""
    from experiments import catalogue
    from rig.gears import acceptance

    yield "# The acceptance file"
    yield ""
    yield plain(inspect.cleandoc(acceptance.__doc__ or ""))
    yield f'\n## top level\n\n`format = "{acceptance.FORMAT}"`, and'
    yield "\n| word | kind |\n|---|---|"
    yield "| `name` | text: what the file is called |"
    yield "| `source` | text: the document it was taken from |"
    yield f"| `use` | {kind_text(acceptance.Use)}: which runs it may judge |"
    yield "\n## limits[]\n"
    yield plain(inspect.cleandoc(acceptance.Limit.__doc__ or ""))
    yield "\n| word | kind | needed |\n|---|---|---|"
    hints = typing.get_type_hints(acceptance.Limit)
    for f in dataclasses.fields(acceptance.Limit):
        needed = "yes" if f.default is dataclasses.MISSING else ""
        yield f"| `{f.name}` | {cell(kind_text(hints[f.name]))} | {needed} |"
    yield "\n## What can be limited\n"
    yield "`PROTOCOL.QUANTITY`; these are looked for first, and any other that a protocol finds can be limited too."
    yield "\n| quantity | SI unit | what |\n|---|---|---|"
    for entry in catalogue.ENTRIES:
        if entry.has_plan:
            for q in catalogue.load(entry.name).quantities:
                if q.is_key:
                    yield f"| `{entry.name}.{q.name}` | {q.unit} | {cell(q.title)} |"


def measurands() -> Iterable[str]:
    """Each measurand as its protocol declares it."""
    from experiments import catalogue
    from experiments.parameters import parameter_fields

    yield "# Measurands"
    yield ""
    yield (
        "What exactly is meant by each quantity that a protocol finds, as the protocol declares it. "
        "A word in braces stands for a member of a family: `{way}` is forward or reverse, `{speed}` r/min at "
        "the input, `{order}` cycles per input revolution. The lines of one result's budget stand in its report."
    )
    for entry in catalogue.ENTRIES:
        experiment = catalogue.load(entry.name)
        shown = [q for q in experiment.quantities if q.is_key or q.definition]
        if not entry.has_plan or not shown:
            continue
        yield f"\n## {entry.name}\n"
        yield f"{entry.summary[0].upper()}{entry.summary[1:]}."
        plan = [
            f"{f.name.replace('_', ' ')} {default_text(f.default)} {f.unit}".strip()
            for f in parameter_fields(experiment.parameters)
            if default_text(f.default)
        ]
        yield f"\nConditions unless the plan says otherwise: {cell('; '.join(plan))}."
        for q in dict.fromkeys(shown):
            yield f"\n### {cell(q.headed(q.name))}\n"
            yield from _measurand(entry.name, q)


def _measurand(kind: str, q: Any) -> Iterable[str]:
    ways = {"way": "each direction of turning for itself"}
    rows = [
        ("name", f"`{kind}.{q.name}`"),
        ("unit", q.unit + (f", shown in {q.shown}" if q.shown else "")),
        ("definition", cell(q.definition)),
        ("direction", ways.get(q.placeholder, "") or ("with its sign" if q.is_signed else "")),
        ("comparable at equal", cell(", ".join(q.conditions))),
        ("U of a useful result", cell(" ".join((q.target_text, q.target_reason)).strip())),
    ]
    if q.catalogue is not None:
        rows += [
            ("reference: definition of catalogues", cell(q.catalogue.definition)),
            ("reference: conditions of catalogues", cell(q.catalogue.conditions)),
            ("reference: rating", f"`ratings.{q.catalogue.rating}`"),
        ]
    yield "| | |\n|---|---|"
    for name, text in rows:
        if text:
            yield f"| {name} | {text} |"


def arms(annotation: Any) -> Iterable[Any]:
    """The kinds that an annotation is made of."""
    if typing.get_origin(annotation) in (tuple, typing.Union, types.UnionType, typing.Annotated):
        for part in typing.get_args(annotation):
            yield from arms(part)
    else:
        yield annotation


def kind_text(annotation: Any) -> str:
    """An annotation as people say it."""
    if typing.get_origin(annotation) is typing.Literal:
        return " or ".join(repr(value) for value in typing.get_args(annotation))
    if typing.get_origin(annotation) is dict:
        return "table"
    words = {
        int: "whole number",
        float: "number",
        str: "text",
        bool: "true or false",
        type(None): "",
        Ellipsis: "",
    }
    found = []
    for kind in arms(annotation):
        if typing.get_origin(kind) is not None:
            found.append(kind_text(kind))
        elif isinstance(kind, type) and issubclass(kind, BaseModel):
            found.append("table")
        else:
            found.append(words.get(kind, getattr(kind, "__name__", str(kind))))
    text = " or ".join(dict.fromkeys(word for word in found if word))
    return f"list of {text}" if typing.get_origin(annotation) is tuple else text


def default_text(value: Any) -> str:
    """A default as it would be typed."""
    if value is None or value == "" or isinstance(value, BaseModel):
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, tuple | list):
        return " ".join(f"{v:g}" if isinstance(v, float) else str(v) for v in value)
    return f"{value:g}" if isinstance(value, float) else str(value)


def cell(text: str) -> str:
    """Text that does not break a table: angle brackets and bars are escaped."""
    return re.sub(r"([|<>])", r"\\\1", text.replace("\n", " "))


def plain(text: str) -> str:
    """Help text without the markup of the terminal; words in capitals within brackets stay text."""
    text = re.sub(r"\[/?(bold|italic|dim)\]", "", text)
    return re.sub(r"\[([^\]]*)\](?!\()", r"\\[\1\\]", text).strip()


PAGES = {
    "protocols": protocols,
    "commands": commands,
    "configuration": configuration,
    "exit-codes": exit_codes,
    "limits": limits,
    "gear-file": gear_file,
    "motor-file": motor_file,
    "acceptance-file": acceptance_file,
    "measurands": measurands,
    "channel-map": channel_map,
}
"""Every page that is made, by its name."""

if __name__ == "__main__":
    write(Path(sys.argv[1]))
