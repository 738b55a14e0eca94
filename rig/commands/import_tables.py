"""What `rig import --check` shows: columns, channels, problems, analyses, labels that may be taken over."""

from __future__ import annotations

import math

from rig.commands.terminal import console, echo, painted
from rig.content.phrase import phrase
from rig.runfile.importing.channel_map import ImportOptions
from rig.runfile.importing.looking import Look, column_grid, known, look_grid
from rig.runfile.importing.suitability import unsuited_for


def print_columns(listed: list[dict[str, object]], notes: list[str]) -> None:
    """The columns of files of which nothing is mapped yet, and what to write next."""
    console().print(painted(column_grid(listed)))
    for note in notes:
        echo(f"  {note}")
    echo("Nothing is mapped yet. Name each channel: --channel NAME=COLUMN:UNIT, or --map FILE.")


def print_look(name: str, look: Look, options: ImportOptions) -> None:
    """A look as tables."""
    if name:
        echo(f"{name}:")
    echo(
        f"{look.rows} rows, {known(look.duration_s)} s, {known(look.rate_hz)} Hz, {look.gaps} gaps"
    )
    console().print(painted(look_grid(look)))
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
    for kind, why in unsuited_for(look, options).items():
        echo(f"{kind:16} {phrase('no: {}', why) or 'yes'}")
    if look.proposals and not (options.segments or options.segments_from):
        echo("Labels that the motion suggests; take over what is right into --map:")
        for s in look.proposals:
            echo(
                f'[[segments]]\nlabel = "{s.label}"\nstart = {s.start:.6g}\nstop = {s.stop:.6g}\n'
                f"setpoint = {s.setpoint:.6g}\ndirection = {s.direction}\nrepeat = {s.repeat}"
            )
