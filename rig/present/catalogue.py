"""The catalogue beside the measurement: each promised quantity by its definition, with the
conditions on either side.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rig.analysis.wording import display_unit, number, readable, show, source_text
from rig.present.content import Grid
from rig.present.provenance import tare_of

if TYPE_CHECKING:
    from model.gear import HarmonicDrive, Value
    from model.identify.estimate import Estimate
    from rig.analysis.fit import Fit


@dataclass(frozen=True)
class Promise:
    """A quantity that catalogues state and this rig can measure.

    `rating` its name in the parameter set, `kind` the fit that measures it, `estimates` the
    beginning of the names of its results; `conditions` are those under which catalogues customarily
    state it.
    """

    rating: str
    kind: str
    estimates: str
    definition: str
    conditions: str


PROMISES = (
    Promise(
        "transmission_accuracy",
        "kinematic-error",
        "transmission_accuracy",
        "largest positive plus largest negative deviation of the output from the ideal over "
        "one complete output revolution, "
        "one direction",
        "nothing on the output, low speed",
    ),
    Promise(
        "running_torque",
        "friction",
        "running_torque",
        "torque that keeps the input turning at a constant speed, nothing on the output",
        "nothing on the output, at a stated speed and temperature (20 °C), the maker's grease "
        "in its standard quantity, "
        "ratio 100 (others are corrected for)",
    ),
    Promise(
        "starting_torque",
        "starting-torque",
        "starting_torque",
        "quasi-static torque at which the input begins to turn, nothing on the output",
        "nothing on the output, housing at 20 °C, the unit's own grease",
    ),
)
"""What of a catalogue this rig can measure."""

OUT_OF_REACH = (
    (
        "hysteresis_loss",
        "hysteresis loss: torsion left at the output after loading both ways, input locked",
    ),
    ("stiffness_1", "static torsional stiffness K1: torque over torsion at the output up to T1"),
    ("stiffness_2", "static torsional stiffness K2: the same from T1 to T2"),
    ("stiffness_3", "static torsional stiffness K3: the same above T2"),
)
"""What it cannot, and why it stands in the table all the same: nobody shall look for it in vain."""

COLUMNS = (
    "Quantity by its definition",
    "Measured ± U (k = 2)",
    "Catalogue",
    "Conditions and source of the catalogue's value",
    "Conditions here",
    "Verdict",
)
NUMERIC = (False, True, True, False, False, False)
TITLE = "Beside the catalogue"
NOTE = (
    "The conditions of the catalogue are the customary ones; those of the unit's own "
    "catalogue decide, and stand behind its "
    "source where they are known."
)

Row = tuple[str, ...]


def catalogue_grid(
    fits: Sequence[Fit], conditions: Sequence[Sequence[tuple[str, str]]]
) -> Grid | None:
    """The table beside the catalogue, from the fits and the conditions of each; None where there is
    nothing to compare.
    """
    rows = catalogue_rows(fits, conditions)
    return Grid(TITLE, COLUMNS, rows, NUMERIC, NOTE) if rows else None


def catalogue_rows(
    fits: Sequence[Fit], conditions: Sequence[Sequence[tuple[str, str]]]
) -> tuple[Row, ...]:
    """A row per measured quantity that the catalogue of its gear states; what this rig cannot
    measure closes the table.
    """
    rows: list[Row] = []
    gears: list[HarmonicDrive] = []
    for fit, prevailing in zip(fits, conditions, strict=True):
        if not fit.gear_known:
            continue
        measured = tuple(_measured(fit, dict(prevailing)))
        rows += measured
        if measured and all(fit.gear.ratings != gear.ratings for gear in gears):
            gears.append(fit.gear)
    for gear in gears:
        rows += _unmeasured(gear)
    return tuple(rows)


def _measured(fit: Fit, conditions: Mapping[str, str]) -> Iterator[Row]:
    outcomes = {v.estimate.name: v.outcome for v in fit.result.verdicts}
    for promise in PROMISES:
        if promise.kind != fit.result.kind:
            continue
        stated = fit.gear.value(f"ratings.{promise.rating}")
        definition = f": {promise.definition}"
        source = (
            f"{promise.conditions}; {source_text(stated.origin.provenance, stated.origin.source)}"
        )
        for name, estimate in fit.result.estimates.items():
            if name.startswith(promise.estimates):
                shown = show(estimate)
                yield (
                    readable(name) + definition,
                    shown.with_uncertainty,
                    f"{number(stated.value / shown.scale)} {shown.unit}".rstrip(),
                    source,
                    _here(fit, estimate, conditions),
                    outcomes.get(name, "not judged"),
                )
                definition, source = "", "as above"


def _here(fit: Fit, estimate: Estimate, conditions: Mapping[str, str]) -> str:
    """What prevailed when this quantity was measured."""
    subject = fit.result.options.get("torque_is_of", "")
    positions = conditions.get("Wave-generator positions", "")
    parts = [
        "" if "rpm" in estimate.name else conditions.get("Input speeds", ""),
        f"wave-generator positions {positions}" if positions else "",
        f"housing {conditions['Housing temperature']}"
        if "Housing temperature" in conditions
        else "",
        f"lubricant {conditions['Lubricant']}"
        if "Lubricant" in conditions
        else "lubricant not noted",
        f"torque of {subject}" if subject else "",
        "no tare" if subject and tare_of(fit) == "none" and fit.result.kind == "friction" else "",
    ]
    return ", ".join(part for part in parts if part)


def _unmeasured(gear: HarmonicDrive) -> Iterator[Row]:
    """What the catalogue states and this rig cannot measure; a source that several share is said once."""
    said = ""
    for name, words in OUT_OF_REACH:
        stated: Value = gear.value(f"ratings.{name}")
        factor, unit = display_unit(
            "accuracy" if stated.unit == "rad" else name, stated.unit, stated.value
        )
        text = f"{number(stated.value / factor)} {unit}".rstrip()
        source = source_text(stated.origin.provenance, stated.origin.source)
        yield (
            words,
            "–",
            text,
            source if source != said else "as above",
            "cannot be measured on this rig",
            "–",
        )
        said = source
