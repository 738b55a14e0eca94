"""The pages of the files that a person writes: rig.toml, gear, motor, acceptance, campaign."""

from __future__ import annotations

import dataclasses
import inspect
import typing
from collections.abc import Iterable
from typing import Any

from pydantic import BaseModel

from reference_pages.words import arms, cell, default_text, kind_text, plain


def configuration() -> Iterable[str]:
    """Every word of rig.toml with its kind, default and meaning."""
    from rig.bench.config.schema import RigConfiguration

    yield "# Words of rig.toml"
    yield ""
    yield (
        "`rig config new` writes a file with every word explained; this page lists them "
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
        "`rig config new --motor` makes one, `rig config check` looks it over, `motor` in `rig.toml` names it."
    )
    yield from _origins()
    yield from _section("motor", motor.ServoMotor)


def _origins() -> Iterable[str]:
    from model.gear import Provenance

    yield (
        "\n*provenance* is one of " + ", ".join(typing.get_args(Provenance)) + "; *source* is text."
    )
    yield "Units besides SI are those of [the channel map](channel-map.md#units), each where it measures the same."


def _section(name: str, kind: Any) -> Iterable[str]:
    from model.sections import allowed_range, is_unknown

    yield f"\n## {name}\n"
    yield plain((kind.__doc__ or "").partition("\n")[0])
    yield "\n| word | symbol | SI unit | allowed | what |\n|---|---|---|---|---|"
    for f in dataclasses.fields(kind):
        if "unit" in f.metadata:
            meta = f.metadata
            what = meta["description"] + ("; may be left away" if is_unknown(f, None) else "")
            limit = cell(allowed_range(meta))
            yield f"| `{f.name}` | {meta['symbol']} | {meta['unit']} | {limit} | {cell(what)} |"


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
    yield "| `parts`, `ratios` | lists of names and of numbers: the gears that it is for, all without either |"
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


def campaign_file() -> Iterable[str]:
    """Every key of a campaign's plan, and under `values` the parameters of every protocol."""
    from experiments import catalogue
    from experiments.parameters import parameter_fields
    from rig.trial.campaign import plan

    yield "# The campaign file"
    yield ""
    yield plain(inspect.cleandoc(plan.__doc__ or "").partition("\n")[0])
    yield f"These ship: {', '.join(f'`{name}`' for name in plan.shipped_names())}. An unknown key is refused by name."
    yield "[How a gear is taken through one](../../howto/take-a-gear-through-a-campaign.md)."
    for heading, keys in (("top level", plan.TOP), ("protocol[]", plan.STAGE)):
        yield f"\n## {heading}\n"
        yield "| key | kind | allowed | default | what |\n|---|---|---|---|---|"
        for key in keys:
            row = (key.kind, key.allowed, key.default, key.what)
            yield f"| `{key.name}` | " + " | ".join(cell(text) for text in row) + " |"
    yield "\n## protocol[].values\n"
    yield "By protocol; what is left away keeps the default of the protocol."
    for name in catalogue.names():
        fields = parameter_fields(catalogue.load(name).parameters)
        yield f"\n### {name}\n"
        if not fields:
            yield "Takes no parameters."
            continue
        yield "| key | unit | allowed | default | what |\n|---|---|---|---|---|"
        for f in fields:
            texts = (f.unit, f.limit, default_text(f.default), f.help)
            yield f"| `{f.name}` | " + " | ".join(cell(text) for text in texts) + " |"
