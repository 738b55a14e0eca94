"""The catalogue beside the measurement: each promised quantity by its definition, with the
conditions on either side.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from rig.analysis.tare import takes_tare
from rig.content.grid import Fact, Grid, columns
from rig.content.phrase import phrase
from rig.content.wording import laboratory_unit, number, show, source_text
from rig.present.provenance import tare_of

if TYPE_CHECKING:
    from experiments.quantity import Quantity
    from model.gear import HarmonicDrive, Value
    from rig.analysis.fit.recorded import Fit


_OUT_OF_REACH = (
    ("hysteresis_loss", "hysteresis loss", "arcmin"),
    ("stiffness_1", "static torsional stiffness K1", ""),
    ("stiffness_2", "K2", ""),
    ("stiffness_3", "K3", ""),
)
"""Ratings that this rig cannot measure, in words, and the unit shown. Why they are named all the same: nobody shall
look for them in vain.
"""

COLUMNS = columns(
    ("quantity by its definition", "quantity"),
    ("measured ± U (95 %)", "number"),
    ("catalogue", "number"),
    "conditions and source of the catalogue's value",
    "conditions here",
)
_TITLE = "Beside the catalogue"
NOTE = (
    "The conditions of the catalogue are the customary ones; those of the unit's own "
    "catalogue decide, and stand behind its "
    "source where they are known. The table shows; it judges nothing."
)

Row = tuple[str, ...]


def catalogue_grid(fits: Sequence[Fit], conditions: Sequence[Sequence[Fact]]) -> Grid | None:
    """The table beside the catalogue, from the fits and the conditions of each; None where there is
    nothing to compare.
    """
    rows: list[Row] = []
    gears: list[HarmonicDrive] = []
    for fit, prevailing in zip(fits, conditions, strict=True):
        if not fit.gear_known:
            continue
        measured = tuple(_measured(fit, {one.title: one.text for one in prevailing}))
        rows += measured
        if measured and all(fit.gear.ratings != gear.ratings for gear in gears):
            gears.append(fit.gear)
    return Grid(_TITLE, COLUMNS, tuple(rows), _note(gears)) if rows else None


def _measured(fit: Fit, conditions: Mapping[str, str]) -> Iterator[Row]:
    """A row per result whose quantity has a counterpart in the catalogue; what several share is said once."""
    before = None
    for name, estimate in fit.result.estimates.items():
        quantity = fit.result.quantity(name)
        counterpart = quantity.catalogue
        if counterpart is None:
            continue
        stated = fit.gear.value(f"ratings.{counterpart.rating}")
        definition, source = "", "as above"
        if counterpart != before:
            definition = f": {counterpart.definition}"
            origin = source_text(stated.origin.provenance, stated.origin.source)
            source = f"{counterpart.conditions}; {origin}"
        before = counterpart
        shown = show(estimate, quantity)
        yield (
            quantity.titled(name) + definition,
            shown.with_uncertainty,
            f"{number(stated.value / shown.scale)} {shown.unit}".rstrip(),
            source,
            _here(fit, quantity, conditions),
        )


def _here(fit: Fit, quantity: Quantity, conditions: Mapping[str, str]) -> str:
    """What prevailed when this quantity was measured."""
    subject = fit.result.options.get("torque_is_of", "")
    positions = conditions.get("wave-generator positions", "")
    housing = conditions.get("housing temperature", "")
    lacks_tare = takes_tare(fit.result.kind) and tare_of(fit) == "none"
    parts = [
        "" if quantity.placeholder == "speed" else conditions.get("input speeds", ""),
        phrase("wave-generator positions {}", positions),
        phrase("housing {}", housing),
        f"lubricant {conditions.get('lubricant', 'not noted')}",
        phrase("torque of {}", subject),
        "no tare" if subject and lacks_tare else "",
    ]
    return ", ".join(part for part in parts if part)


def _note(gears: Sequence[HarmonicDrive]) -> str:
    """What the table is, and what the catalogue states and this rig cannot measure."""
    besides = [f"Not measurable on this rig, but stated: {_unmeasured(one)}." for one in gears]
    return " ".join((NOTE, *besides))


def _unmeasured(gear: HarmonicDrive) -> str:
    """What the catalogue states besides, with its values."""
    told = []
    for name, words, shown in _OUT_OF_REACH:
        stated: Value = gear.value(f"ratings.{name}")
        factor, unit = laboratory_unit(stated.unit, stated.value, shown)
        told.append(f"{words} ({number(stated.value / factor)} {unit.strip()})")
    return ", ".join(told)
