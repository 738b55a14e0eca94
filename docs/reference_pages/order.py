"""The page of what a run is asked for: every field of an order with its option, keyword, unit and default."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import MISSING, fields
from typing import Any

from reference_pages.words import cell, default_text


def order() -> Iterable[str]:
    """Every field that a person says, and every word of a simulated world."""
    from rig.bench.backends.order import WORDS, WORLD_WORDS, Order, WorldChoice, key_of

    yield "# What a run is asked for"
    yield ""
    yield (
        "One list makes the options of `rig run`, `rig plan`, `rig campaign`, `rig doctor` and `rig sim serve`, the "
        "keywords of `rig.execute`, what a window tells its run, and this page. What is left open comes from the rig's "
        "configuration, from the card of the gear, and from the defaults."
    )
    yield "\n| option | field and keyword | unit | default | what |\n|---|---|---|---|---|"
    usual = _usual(Order)
    for name, words in WORDS.items():
        option = f"`{words.option}`" if words.option else ""
        yield f"| {option} | `{name}` | {words.unit} | {usual[name]} | {cell(words.help)} |"
    yield "\n## Words of a simulated world\n"
    yield (
        "`--world gear-seed=5,day=2`, and from Python `world={'gear_seed': 5, 'day': 2}`. The flags of version 0.2.0 "
        "(`--gear-seed 5 --day 2`) are read for one version more."
    )
    yield "\n| word | belongs to | default | what |\n|---|---|---|---|"
    usual = _usual(WorldChoice)
    for name, words in WORLD_WORDS.items():
        yield f"| `{key_of(name)}` | {words.group} | {usual[name]} | {cell(words.help)} |"
    yield "\n## What is no part of it\n"
    yield (
        "Confirmation, acknowledgement, answers to prompts and the guard: they are said for one run, by somebody who "
        "has looked, and go with no order that is stored or repeated. `--confirm`, and from Python `confirm` and "
        "`ask`, are beside the order."
    )


def _usual(kind: Any) -> dict[str, str]:
    """The defaults as they would be typed."""
    return {
        f.name: "" if f.default is MISSING else cell(default_text(f.default)) for f in fields(kind)
    }
