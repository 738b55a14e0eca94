"""The gear in numbers, in the place of the paper's Tables 1 to 3: what its card says, what the model computes of that,
and what the runs identified, side by side.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from experiments.quantity import Quantity, bare_quantity
from model.identify.estimate import Estimate
from rig.analysis.fit.recorded import Fit
from rig.content.grid import Grid, columns
from rig.content.wording import laboratory_unit, number, order_label, printed_symbol, show

if TYPE_CHECKING:
    from model.gear import HarmonicDrive, Value
    from model.summary import Quantity as DerivedQuantity

NOTHING = "–"
COLUMNS = columns(
    ("quantity", "quantity"),
    ("symbol", "symbol"),
    ("card", "number"),
    "provenance",
    ("computed", "number"),
    ("identified ± U (95 %)", "number"),
)
NOTE = (
    "The paper's Tables 1 to 3 stand here by their subjects; its numbers are not known to this program. Computed: "
    "from the card by the paper's equations. Identified: by the newest run of its kind."
)


@dataclass(frozen=True)
class Row:
    """One quantity: path in the parameter set, name among the derived quantities, kind and name of the estimate."""

    title: str
    symbol: str
    path: str = ""
    derived: str = ""
    found: tuple[str, str] = ("", "")
    shown: str = ""


_GEOMETRY = (
    Row("teeth of the flexspline", "Z_f", "teeth.flexspline"),
    Row("teeth of the circular spline", "Z_c", "teeth.circular_spline"),
    Row("reference diameter, flexspline", "d_f", "geometry.flexspline_diameter"),
    Row("reference diameter, circular spline", "d_c", "geometry.circular_spline_diameter"),
    Row("radial deformation", "omega", "geometry.radial_deformation"),
    Row("tooth angle", "alpha_t", "geometry.tooth_angle", shown="°"),
    Row("radius of the neutral layer", "r_g", "geometry.neutral_radius"),
    Row("wedge angle", "alpha_n", derived="alpha_n", shown="°"),
    Row("engaging teeth", "Z_R", derived="Z_R"),
    Row("mesh stiffness", "K_m", derived="K_m"),
    Row("torsional stiffness of the cup", "K_t", derived="K_t"),
    Row("radial stiffness of the bearing", "K_b", derived="K_b"),
    Row(
        "stiffness at the output",
        "K_HDf",
        derived="K_HDf",
        found=("velocity-steps", "output_stiffness"),
    ),
    Row(
        "stiffness over inertia",
        "",
        derived="K_HDf/J_o",
        found=("velocity-steps", "stiffness_over_inertia"),
    ),
    Row("torsional resonance", "f_1", derived="f_1", found=("velocity-steps", "frequency")),
    Row("its damping ratio", "zeta_1", derived="zeta_1", found=("velocity-steps", "damping_ratio")),
    Row(
        "inertia of the output axis",
        "J_o",
        "inertia.output",
        found=("velocity-steps", "output_inertia"),
    ),
)
"""After Table 1: geometry, and the stiffnesses and the mode that follow from it."""
FRICTION = (
    Row("Coulomb friction", "F_c", "mesh_friction.coulomb", found=("friction", "coulomb")),
    Row("static friction", "F_s", "mesh_friction.static", found=("friction", "static")),
    Row(
        "Stribeck velocity",
        "v_s",
        "mesh_friction.stribeck_velocity",
        found=("friction", "stribeck_velocity"),
    ),
    Row("shape coefficient", "sigma", "mesh_friction.shape", found=("friction", "shape")),
    Row("viscous coefficient", "c_v", "mesh_friction.viscous", found=("friction", "viscous")),
    Row("factor of the bearing's friction", "f_0", "bearing.friction_factor"),
    Row("viscosity of the lubricant", "nu_0", "bearing.viscosity"),
    Row("pitch diameter of the bearing", "d_m", "bearing.pitch_diameter"),
)
"""After Table 3: the parameters of the friction laws."""


def number_grids(fits: Sequence[Fit]) -> tuple[Grid, ...]:
    """The three tables of a gear; none where nobody said what gear it is."""
    known = [fit for fit in fits if fit.gear_known and fit.recording.metadata.gear_mounted]
    if not known:
        return ()
    card = known[0].recording.metadata.gear or known[0].gear
    return (
        _grid("Geometry, stiffness and mode", card, _GEOMETRY, fits),
        _orders(card, fits),
        _grid("Friction", card, FRICTION, fits, NOTE),
    )


def _grid(
    title: str, card: HarmonicDrive, rows: Sequence[Row], fits: Sequence[Fit], note: str = ""
) -> Grid:
    from model.summary import derived_quantities

    values = {value.path: value for value in card.values()}
    derived = {one.name: one for one in derived_quantities(card).quantities}
    lines = []
    for row in rows:
        stated, computed = values.get(row.path), derived.get(row.derived)
        estimate, quantity = _estimate_of(row.found, fits)
        lines.append(
            (
                row.title,
                printed_symbol(row.symbol),
                _cell(stated, row.shown),
                stated.origin.provenance if stated else "",
                _cell(computed, row.shown),
                _identified(estimate, quantity),
            )
        )
    return Grid(title, COLUMNS, lines, note).without_empty()


def _orders(card: HarmonicDrive, fits: Sequence[Fit]) -> Grid:
    """After Table 2: the harmonics of the kinematic error; those that the card states or a run tells above noise."""
    stated = {order_label(h.order, card.ratio): h for h in card.kinematic_error}
    lines = []
    for label in dict.fromkeys((*stated, *_told_orders(fits))):
        amplitude, provenance = NOTHING, ""
        if harmonic := stated.get(label):
            amplitude = _text(harmonic.amplitude, "rad", "arcsec")
            provenance = _provenance(card, harmonic.order)
        estimate, quantity = _estimate_of(("kinematic-error", f"amplitude_{label}"), fits)
        lines.append(
            (
                f"kinematic error, amplitude of order {label}",
                "",
                amplitude,
                provenance,
                NOTHING,
                _identified(estimate, quantity),
            )
        )
    return Grid("Kinematic error", COLUMNS, lines).without_empty()


def _provenance(card: HarmonicDrive, order: float) -> str:
    from model.gear_file import harmonic_path

    origin = card.origins.get(harmonic_path(order))
    return origin.provenance if origin else ""


def _told_orders(fits: Sequence[Fit]) -> Iterator[str]:
    for fit in fits:
        if fit.result.kind == "kinematic-error":
            for name, estimate in fit.result.estimates.items():
                if name.startswith("amplitude_") and estimate.identifiable == "yes":
                    yield name.removeprefix("amplitude_")


def _estimate_of(
    found: tuple[str, str], fits: Sequence[Fit]
) -> tuple[Estimate | None, Quantity | None]:
    kind, name = found
    for fit in fits:
        if fit.result.kind == kind and name in fit.result.estimates:
            return fit.result.estimates[name], fit.result.quantity(name)
    return None, None


def _identified(estimate: Estimate | None, quantity: Quantity | None) -> str:
    if estimate is None or not math.isfinite(estimate.value):
        return NOTHING
    if estimate.identifiable == "no":
        return "not identifiable"
    words = show(estimate, quantity or bare_quantity(estimate.name, estimate.unit)).with_uncertainty
    return f"{words} (weakly)" if estimate.identifiable == "weakly" else words


def _cell(one: Value | DerivedQuantity | None, shown: str) -> str:
    """A number that the card states or the model computes."""
    return _text(one.value, one.unit, shown) if one else NOTHING


def _text(value: float, unit: str, shown: str = "") -> str:
    factor, words = laboratory_unit(unit, value, shown)
    return f"{number(value / factor)} {words}".rstrip()
