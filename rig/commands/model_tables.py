"""What `rig model` shows on a terminal: everything derived from a parameter set, in SI, the catalogue beside it."""

from __future__ import annotations

import math

from rich.console import Console
from rich.table import Table

from model.gear import HarmonicDrive
from model.summary import Summary
from model.units import ARCMIN, RPM
from rig.commands.terminal import console, ruled_table
from rig.commands.visible import Text
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
    _quantities(out, summary)
    _shares(out, summary)
    _catalogue(out, summary)
    _modes(out, summary)
    _friction(out, summary)
    _bearing(out, summary)


def _table(title: str, *headings: str) -> Table:
    """A plain table; a heading that begins with > is of numbers."""
    numbers = [heading[1:] for heading in headings if heading.startswith(">")]
    words = [heading.lstrip(">") for heading in headings]
    return ruled_table(*words, numbers=numbers, whole=numbers, title=title, title_style="bold")


def _text(value: float, digits: int = DIGITS) -> str:
    return number(float(value), digits)


def _quantities(out: Console, summary: Summary) -> None:
    table = _table("Derived quantities", "name", ">value", "unit", "eq.", "what it is")
    for q in summary.quantities:
        table.add_row(
            q.name, _text(q.value), "" if q.unit == "1" else q.unit, q.equation, q.description
        )
    out.print(table)


def _shares(out: Console, summary: Summary) -> None:
    table = _table("Where the compliance comes from", "part", ">share")
    for title, shares in (
        ("at the output", summary.shares),
        ("one tooth pair", summary.pair_shares),
    ):
        for name, share in shares.items():
            table.add_row(f"{title}: {name}", f"{100.0 * share:.2f} %")
    out.print(table)


def _catalogue(out: Console, summary: Summary) -> None:
    table = _table(
        "Beside the catalogue", "name", ">computed", ">catalogue", "unit", ">ratio", "provenance"
    )
    for c in summary.catalogue:
        factor, unit = (ARCMIN, "arcmin") if c.unit == "rad" else (1.0, c.unit)
        name = f"K_HDf, {c.name}" if c.name in ("K1", "K2", "K3") else c.name.replace("_", " ")
        table.add_row(
            name,
            _text(c.computed / factor, 4),
            _text(c.catalogue / factor, 4),
            unit,
            f"{c.ratio:.2f}",
            c.provenance,
        )
    out.print(table)


def _modes(out: Console, summary: Summary) -> None:
    table = _table(
        "Modes, input prescribed", ">natural frequency [rad/s]", ">[Hz]", ">damping ratio"
    )
    for mode in summary.modes:
        hertz = mode.natural_frequency / (2.0 * math.pi)
        table.add_row(_text(mode.natural_frequency), _text(hertz), _text(mode.damping_ratio, 3))
    out.print(table)
    table = _table(
        "Where orders of the kinematic error meet the first mode",
        ">order",
        ">input speed [r/min]",
        ">[rad/s]",
    )
    for r in summary.resonances:
        table.add_row(_text(r.order), _text(r.input_speed / RPM), _text(r.input_speed))
    out.print(table)


def _friction(out: Console, summary: Summary) -> None:
    headings = (">input speed [r/min]", ">torque [mN m]", ">bearing [mN m]", ">mesh [mN m]")
    table = _table("Friction torque at the input", *headings)
    for p in summary.friction:
        cells = (_text(1e3 * v, 4) for v in (p.torque, p.bearing, p.mesh))
        table.add_row(_text(p.speed / RPM, 6), *cells)
    out.print(table)


def _bearing(out: Console, summary: Summary) -> None:
    table = _table("Bearing stiffness over its radial load", ">radial load [N]", ">K_b [N/m]")
    for load, stiffness in summary.bearing_over_load:
        table.add_row(_text(load, 4), _text(stiffness, 4))
    out.print(table)
