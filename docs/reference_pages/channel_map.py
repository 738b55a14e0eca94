"""The page of the channel map: tables and keys, channels, units, labels."""

from __future__ import annotations

import inspect
from collections.abc import Iterable

from reference_pages.words import cell, plain


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
    words = [*units.UNITS, units.COUNT, *units.TEXT_TIMES]
    yield ", ".join(f"`{word}`" for word in words)
    yield "\n## Kinds of files\n"
    yield "| kind | what |\n|---|---|"
    for kind, what in opening.FORMATS.items():
        yield f"| `{kind}` | {cell(what)} |"
    yield "\n## Labels of segments\n"
    yield "| label | what |\n|---|---|"
    for label, what in map_keys.LABELS.items():
        yield f"| `{label}` | {cell(what)} |"
