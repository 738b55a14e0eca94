"""The page of the channel map: tables and keys, channels, units, labels."""

from __future__ import annotations

import inspect
from collections.abc import Iterable

from reference_pages.words import cell, plain


def units_understood() -> Iterable[str]:
    """What is understood as a unit, in a heading, a map, a parameter file and `rig.toml`."""
    from model.unit_text import understood
    from model.units import REFUSED, WORDS

    yield "The units that are most common: " + ", ".join(f"`{unit}`" for unit in understood()) + "."
    yield (
        "\nProducts (`N m`, `N.m`, `N*m`, `in-lb`, `Nm`), powers (`s2`, `s^2`, `s**2`, `s²`, `s^-2`) and quotients "
        "(`/`, `per`, brackets: `mN m/(r/min)`) of these words are understood too, and a power of ten before a word "
        "(`0.1 deg`, `V/1000 rpm`):"
    )
    yield "\n| word | SI | prefixes | also written |\n|---|---|---|---|"
    for word in WORDS:
        spellings = " ".join(f"`{each}`" for each in word.spellings.split())
        yield f"| `{word.symbol}` | {word.si} | {' '.join(word.prefixes)} | {spellings} |"
    yield (
        "\nWords of more than one letter may be in capitals; with a prefix the case decides. A current and a "
        "voltage are r.m.s. A mass beside a length (`lb in`, `oz in`, `kg cm`) where a torque is asked for is read "
        "as the force that it weighs, and the import, the source of the value or the terminal says so. "
        "`1/min` is r/min. Refused, for they mean two things: "
        + ", ".join(f"`{word}`" for word in REFUSED)
        + "; `g` alone; `N m/rad/s`, which needs brackets."
    )


def channel_map() -> Iterable[str]:
    """Every table and key of a channel map, the units, the channels with a name, the labels of segments."""
    from rig.runfile.importing import map_keys, opening, units

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
    yield from units_understood()
    yield "\nTimes may also be " + " or ".join(f"`{word}`" for word in units.TEXT_TIMES) + "."
    yield "\n## Kinds of files\n"
    yield "| kind | what |\n|---|---|"
    for kind, what in opening.FORMATS.items():
        yield f"| `{kind}` | {cell(what)} |"
    yield "\n## Labels of segments\n"
    yield "| label | what |\n|---|---|"
    for label, what in map_keys.LABELS.items():
        yield f"| `{label}` | {cell(what)} |"
