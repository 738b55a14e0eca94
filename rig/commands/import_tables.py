"""What `rig import --check` shows: columns, channels, problems, analyses, labels that may be taken over."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

from rig.commands.terminal import console, echo, painted
from rig.content.grid import Grid, columns
from rig.runfile.importing.channel_map import ImportOptions
from rig.runfile.importing.looking import Look
from rig.runfile.importing.reach import reach_of


def look_as_json(look: Look, options: ImportOptions) -> dict[str, Any]:
    """A look as one object; numbers that are not known are null."""
    return {
        "rows": look.rows,
        "duration_s": look.duration_s,
        "rate_hz": look.rate_hz,
        "gaps": look.gaps,
        "channels": [dataclasses.asdict(channel) for channel in look.channels],
        "output_per_input": look.output_per_input,
        "problems": look.problems,
        "notes": look.notes,
        "good_for": {kind: {"ok": not why, "why": why} for kind, why in _reach(look, options)},
        "segments": [dataclasses.asdict(segment) for segment in look.proposals],
    }


def _reach(look: Look, options: ImportOptions) -> list[tuple[str, str]]:
    return list(reach_of(look, options).items()) if look.channels else []


def columns_as_json(listed: list[dict[str, object]], notes: list[str]) -> dict[str, Any]:
    """The columns of files of which nothing is mapped yet."""
    return {"columns": listed, "notes": notes}


def print_columns(listed: list[dict[str, object]], notes: list[str]) -> None:
    """The columns of files of which nothing is mapped yet, and what to write next."""
    rows = [
        (
            str(column["number"]),
            str(column["heading"]),
            str(column["unit"] or "?"),
            _number(column["low"]),
            _number(column["high"]),
            f"column {column['time']}" if column["time"] else "-",
        )
        for column in listed
    ]
    heads = columns(
        "column",
        "heading",
        ("unit", "unit"),
        ("first rows from", "number"),
        ("to", "number"),
        "its time",
    )
    console().print(painted(Grid("", heads, rows)))
    for note in notes:
        echo(f"  {note}")
    echo("Nothing is mapped yet. Name each channel: --channel NAME=COLUMN:UNIT, or --map FILE.")


def print_look(name: str, look: Look, options: ImportOptions) -> None:
    """A look as tables."""
    if name:
        echo(f"{name}:")
    echo(
        f"{look.rows} rows, {_number(look.duration_s)} s, {_number(look.rate_hz)} Hz, {look.gaps} gaps"
    )
    rows = [
        (
            c.name,
            c.column,
            c.unit,
            _number(c.factor, 4),
            _number(c.low, 4),
            _number(c.high, 4),
            _number(c.step, 3),
            str(c.wraps or "-"),
            "-" if math.isnan(c.standstill) else f"{100.0 * c.standstill:.0f} %",
        )
        for c in look.channels
    ]
    heads = columns(
        "channel",
        "column",
        ("unit", "unit"),
        ("factor", "number"),
        ("from", "number"),
        ("to", "number"),
        ("step", "number"),
        ("wraps", "number"),
        ("still", "number"),
    )
    console().print(painted(Grid("", heads, rows)))
    for c in look.channels:
        if math.isfinite(c.lag_s):
            echo(f"{c.name} is {c.lag_s:.4g} s behind the derivative of {c.lag_against}")
    if math.isfinite(look.output_per_input):
        way = "with" if look.output_per_input > 0.0 else "against"
        ratio = 1.0 / abs(look.output_per_input) if look.output_per_input else math.inf
        echo(f"the output angle moves {way} the input angle, 1 in {ratio:.6g}")
    for problem in look.problems:
        echo(f"PROBLEM: {problem}")
    for note in look.notes:
        echo(f"  {note}")
    for kind, why in _reach(look, options):
        echo(f"{kind:16} {'yes' if not why else f'no: {why}'}")
    if look.proposals and not (options.segments or options.segments_from):
        echo("Labels that the motion suggests; take over what is right into --map:")
        for s in look.proposals:
            echo(
                f'[[segments]]\nlabel = "{s.label}"\nstart = {s.start:.6g}\nstop = {s.stop:.6g}\n'
                f"setpoint = {s.setpoint:.6g}\ndirection = {s.direction}\nrepeat = {s.repeat}"
            )


def _number(value: object, digits: int = 6) -> str:
    return (
        f"{value:.{digits}g}" if isinstance(value, (int, float)) and math.isfinite(value) else "-"
    )
