"""What can be known of one mounted gear: the facts of its card.

Their annotations are the only definition of flags, form and table. A fact that nobody told is left away: it is unknown,
it has no default.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date
from typing import Annotated, Any

from annotated_types import Ge, Gt, Le

from experiments.errors import PlanError
from experiments.parameters import Help, Unit, make_parameters, parameter_fields

_RunOut = Annotated[
    float | None, Ge(0.0), Le(1000.0), Unit("um"), Help("total indicator reading, as mounted")
]


@dataclass(frozen=True, kw_only=True)
class GearFacts:
    """What can be known of one mounted gear. Empty text and None are what nobody told."""

    serial: Annotated[str, Help("serial number, as it is engraved on the gear")]
    part: Annotated[str, Help("parameter set of the gear: csf-25-120, or a TOML file")] = ""
    acceptance: Annotated[
        str, Help("what the gear must show: a shipped acceptance file, or a TOML file")
    ] = ""
    mounting: Annotated[
        str, Help("which member is fixed: circular spline (ratio N) or flexspline (ratio N + 1)")
    ] = ""
    lubricant: Annotated[str, Help("grease or oil, as named on its tin")] = ""
    hours: Annotated[
        float | None, Ge(0.0), Le(1e6), Unit("h"), Help("hours that the gear has run")
    ] = None
    hours_counted: Annotated[
        str, Help("how they were counted: hour meter, log book, estimate, new gear")
    ] = ""
    load_inertia_kg_m2: Annotated[
        float | None,
        Gt(0.0),
        Le(1e3),
        Unit("kg m2"),
        Help("inertia of the output axis with its load"),
    ] = None
    load_inertia_uncertainty_kg_m2: Annotated[
        float | None, Ge(0.0), Le(1e3), Unit("kg m2"), Help("its standard uncertainty")
    ] = None
    output_radial_runout_um: _RunOut = None
    output_axial_runout_um: _RunOut = None
    input_radial_runout_um: _RunOut = None
    input_axial_runout_um: _RunOut = None
    mounted_on: Annotated[str, Help("day since which it is mounted as it is, YYYY-MM-DD")] = ""
    mounted_at_deg: Annotated[
        float | None,
        Ge(-360.0),
        Le(360.0),
        Unit("deg"),
        Help("angle at which it stands on the output flange, as the output encoder counts up"),
    ] = None
    mounting_notes: Annotated[
        str, Help("shims, screws and torques, coupling, whatever is unusual")
    ] = ""


UNITS: Mapping[str, str] = {
    f.name: f.unit if f.unit != "1" else "" for f in parameter_fields(GearFacts)
}
"""The unit of every fact, "" for words."""
CHOICES: Mapping[str, tuple[str, ...]] = {"mounting": ("circular-spline-fixed", "flexspline-fixed")}
"""Fields that take one of a few words."""


def stated_facts(facts: GearFacts) -> dict[str, Any]:
    """The facts that somebody told, in their order."""
    values = {f.name: getattr(facts, f.name) for f in dataclasses.fields(facts)}
    return {name: value for name, value in values.items() if value is not None and value != ""}


def make_facts(values: Mapping[str, Any]) -> GearFacts:
    """Facts from text or numbers. Raises `PlanError` naming the field, its value and what is allowed."""
    stripped = {
        name: value.strip() if isinstance(value, str) else value for name, value in values.items()
    }
    facts = make_parameters(GearFacts, stripped, "gear")
    if not facts.serial.strip():
        raise PlanError(
            "a gear card needs a serial number",
            where="gear.serial",
            remedy="Read it from the gear.",
        )
    for name, words in CHOICES.items():
        word = getattr(facts, name)
        if word and word not in words:
            raise PlanError(
                "is none of the words there are",
                where=f"gear.{name}",
                value=repr(word),
                limit=", ".join(words),
            )
    if facts.mounted_on:
        try:
            date.fromisoformat(facts.mounted_on)
        except ValueError:
            raise PlanError(
                "is no date",
                where="gear.mounted_on",
                value=repr(facts.mounted_on),
                limit="YYYY-MM-DD",
            ) from None
    if facts.load_inertia_uncertainty_kg_m2 is not None and facts.load_inertia_kg_m2 is None:
        raise PlanError(
            "an uncertainty without its value",
            where="gear.load_inertia_uncertainty_kg_m2",
            value=f"{facts.load_inertia_uncertainty_kg_m2:g} kg m2",
            remedy="Give load_inertia_kg_m2 as well.",
        )
    return facts
