"""What the model derives from a parameter set, in rows: in SI, the catalogue beside it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

from model.summary import Summary
from model.units import RPM
from rig.content.grid import Grid, columns, number_columns
from rig.content.wording import laboratory_unit, number

DIGITS = 5
_STIFFNESSES = {name: f"K_HDf, {name}" for name in ("K1", "K2", "K3")}
"""Names of the catalogue for the stiffness of the paper in three ranges of torque."""


def summary_grids(summary: Summary) -> Iterator[Grid]:
    """All tables of a summary."""
    heads = columns("name", ("value", "number"), ("unit", "unit"), "eq.", "what it is")
    rows = [
        (
            q.name,
            number(q.value, DIGITS),
            "" if q.unit == "1" else q.unit,
            q.equation,
            q.description,
        )
        for q in summary.quantities
    ]
    yield Grid("Derived quantities", heads, rows)
    shares = {
        **{f"at the output: {name}": share for name, share in summary.shares.items()},
        **{f"one tooth pair: {name}": share for name, share in summary.pair_shares.items()},
    }
    parts = [(name, f"{100.0 * share:.2f} %") for name, share in shares.items()]
    yield Grid("Where the compliance comes from", columns("part", ("share", "number")), parts)
    yield _catalogue_grid(summary)
    yield _number_grid(
        "Modes, input prescribed",
        ("natural frequency [rad/s]", "[Hz]", "damping ratio"),
        (
            (one.natural_frequency, one.natural_frequency / (2.0 * math.pi), one.damping_ratio)
            for one in summary.modes
        ),
    )
    yield _number_grid(
        "Where orders of the kinematic error meet the first mode",
        ("order", "input speed [r/min]", "[rad/s]"),
        ((one.order, one.input_speed / RPM, one.input_speed) for one in summary.resonances),
    )
    yield _number_grid(
        "Friction torque at the input",
        ("input speed [r/min]", "torque [mN m]", "bearing [mN m]", "mesh [mN m]"),
        (
            (one.speed / RPM, *(1e3 * torque for torque in (one.torque, one.bearing, one.mesh)))
            for one in summary.friction
        ),
    )
    headings = ("radial load [N]", "K_b [N/m]")
    yield _number_grid(
        "Bearing stiffness over its radial load", headings, summary.bearing_over_load
    )


def _catalogue_grid(summary: Summary) -> Grid:
    rows = []
    for one in summary.catalogue:
        factor, unit = laboratory_unit(one.unit, one.computed, "arcmin")
        numbers = (number(value / factor) for value in (one.computed, one.catalogue))
        name = _STIFFNESSES.get(one.name, one.name.replace("_", " "))
        rows.append((name, *numbers, unit, f"{one.ratio:.2f}", one.provenance))
    heads = columns(
        "name",
        ("computed", "number"),
        ("catalogue", "number"),
        ("unit", "unit"),
        ("ratio", "number"),
        "provenance",
    )
    return Grid("Beside the catalogue", heads, rows)


def _number_grid(title: str, headings: Iterable[str], rows: Iterable[Iterable[float]]) -> Grid:
    cells = [tuple(number(float(value), DIGITS) for value in row) for row in rows]
    return Grid(title, number_columns(*headings), cells)
