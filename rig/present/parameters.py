"""The parameter sets that analyses leaned on, with the source of every number."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from rig.content.grid import Grid, columns
from rig.content.wording import laboratory_unit, number, order_label, printed_symbol, unit_text

if TYPE_CHECKING:
    from model.gear import Harmonic, HarmonicDrive, Value
    from rig.analysis.fit.recorded import Fit


def _parameter_grid(gear: HarmonicDrive) -> Grid:
    """The whole parameter set with the source of every number, in the units in which a parameter file reads best."""
    heads = columns(
        "parameter",
        ("symbol", "symbol"),
        ("value", "number"),
        ("u", "number"),
        ("unit", "unit"),
        "provenance",
        "source",
    )
    rows = [*map(_value_row, gear.values()), *(_order_row(gear, h) for h in gear.kinematic_error)]
    return Grid(f"Parameter set {gear.name}", heads, rows)


def _value_row(v: Value) -> tuple[str, ...]:
    from model.quantities import readable as in_readable_unit

    (text,), unit = in_readable_unit((v.value,), v.unit)
    is_count = v.value == int(v.value) and unit == "1"
    u = v.origin.standard_uncertainty
    return (
        v.description,
        printed_symbol(v.symbol),
        number(v.value, 0) if is_count else number(float(text), 6),
        number(u * float(text) / v.value, 2) if u is not None and v.value else "",
        unit_text(unit),
        v.origin.provenance,
        v.origin.source,
    )


def _order_row(gear: HarmonicDrive, harmonic: Harmonic) -> tuple[str, ...]:
    from model.gear_file import harmonic_path

    factor, unit = laboratory_unit("rad", harmonic.amplitude)
    origin = gear.origins.get(harmonic_path(harmonic.order))
    u, provenance, source = None, "", ""
    if origin is not None:
        u, provenance, source = origin.standard_uncertainty, origin.provenance, origin.source
    return (
        f"kinematic error, order {order_label(harmonic.order, gear.ratio)}: amplitude",
        "",
        number(harmonic.amplitude / factor),
        number(u / factor, 2) if u else "",
        unit,
        provenance,
        source,
    )


def parameter_grids(fits: Sequence[Fit]) -> tuple[Grid, ...]:
    """The parameter sets that the analyses leaned on: the first one whole, of the others what differs from it."""
    parameter_sets: list[tuple[HarmonicDrive, list[str]]] = []
    for fit in fits:
        if not fit.leans_on_gear:
            continue
        same = next((kinds for gear, kinds in parameter_sets if gear == fit.gear), None)
        if same is None:
            parameter_sets.append((fit.gear, [fit.result.kind]))
        else:
            same.append(fit.result.kind)
    grids: list[Grid] = []
    whole: Grid | None = None
    for gear, kinds in parameter_sets:
        grid = _parameter_grid(gear)
        whole = whole or grid
        if len(parameter_sets) > 1:
            title = f"{grid.title}, used for {', '.join(dict.fromkeys(kinds))}"
        else:
            title = grid.title
        if grid is not whole:
            first = set(whole.rows)
            rows = tuple(row for row in grid.rows if row not in first)
            grid = replace(grid, rows=rows, note="Only what differs from the set above.")
        grids.append(replace(grid, title=title).without_empty())
    return tuple(grids)
