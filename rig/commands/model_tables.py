"""What `rig model` shows on a terminal: everything derived from a parameter set, in SI, the catalogue beside it."""

from __future__ import annotations

import math
from collections.abc import Iterator

from model.gear import HarmonicDrive
from model.summary import Summary
from model.units import ARCMIN, RPM
from rig.commands.terminal import console, painted
from rig.commands.visible import Text
from rig.content.grid import Column, Grid, columns
from rig.content.wording import number

DIGITS = 5


def print_summary(gear: HarmonicDrive, summary: Summary) -> None:
    """All tables of a summary."""
    out = console()
    out.print(Text(f"{gear.name}: what the model derives from its parameters, in SI", style="bold"))
    options = ", ".join(
        f"{name.replace('_', ' ')} {value}" for name, value in summary.options.items()
    )
    out.print(Text(f"options: {options}", style="dim"))
    for grid in summary_grids(summary):
        out.print(painted(grid, title=grid.title, title_style="bold"))


def summary_grids(summary: Summary) -> Iterator[Grid]:
    """What a parameter set derives, table by table."""
    yield from (_quantities(summary), _shares(summary), _catalogue(summary))
    modes = [
        (
            _text(m.natural_frequency),
            _text(m.natural_frequency / (2.0 * math.pi)),
            _text(m.damping_ratio, 3),
        )
        for m in summary.modes
    ]
    heads = _numbers("natural frequency [rad/s]", "[Hz]", "damping ratio")
    yield Grid("Modes, input prescribed", heads, modes)
    met = [
        (_text(r.order), _text(r.input_speed / RPM), _text(r.input_speed))
        for r in summary.resonances
    ]
    heads = _numbers("order", "input speed [r/min]", "[rad/s]")
    yield Grid("Where orders of the kinematic error meet the first mode", heads, met)
    friction = [
        (_text(p.speed / RPM, 6), *(_text(1e3 * v, 4) for v in (p.torque, p.bearing, p.mesh)))
        for p in summary.friction
    ]
    heads = _numbers("input speed [r/min]", "torque [mN m]", "bearing [mN m]", "mesh [mN m]")
    yield Grid("Friction torque at the input", heads, friction)
    bearing = [
        (_text(load, 4), _text(stiffness, 4)) for load, stiffness in summary.bearing_over_load
    ]
    heads = _numbers("radial load [N]", "K_b [N/m]")
    yield Grid("Bearing stiffness over its radial load", heads, bearing)


def _numbers(*headings: str) -> tuple[Column, ...]:
    return tuple(Column(heading, "number") for heading in headings)


def _text(value: float, digits: int = DIGITS) -> str:
    return number(float(value), digits)


def _quantities(summary: Summary) -> Grid:
    rows = [
        (q.name, _text(q.value), "" if q.unit == "1" else q.unit, q.equation, q.description)
        for q in summary.quantities
    ]
    heads = columns("name", ("value", "number"), ("unit", "unit"), "eq.", "what it is")
    return Grid("Derived quantities", heads, rows)


def _shares(summary: Summary) -> Grid:
    parts = (("at the output", summary.shares), ("one tooth pair", summary.pair_shares))
    rows = [
        (f"{title}: {name}", f"{100.0 * share:.2f} %")
        for title, shares in parts
        for name, share in shares.items()
    ]
    return Grid("Where the compliance comes from", columns("part", ("share", "number")), rows)


def _catalogue(summary: Summary) -> Grid:
    rows = []
    for c in summary.catalogue:
        factor, unit = (ARCMIN, "arcmin") if c.unit == "rad" else (1.0, c.unit)
        name = f"K_HDf, {c.name}" if c.name in ("K1", "K2", "K3") else c.name.replace("_", " ")
        computed, stated = _text(c.computed / factor, 4), _text(c.catalogue / factor, 4)
        rows.append((name, computed, stated, unit, f"{c.ratio:.2f}", c.provenance))
    heads = columns(
        "name",
        ("computed", "number"),
        ("catalogue", "number"),
        ("unit", "unit"),
        ("ratio", "number"),
        "provenance",
    )
    return Grid("Beside the catalogue", heads, rows)
