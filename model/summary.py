"""Everything that the model derives from a parameter set, under the names of the paper: what `rig model` prints.

Values are SI. Beside what is computed stands what the catalogue promises, and which part of the drive its compliance
comes from.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from model.friction import (
    bearing_friction_torque,
    bearing_lever,
    conversion_factor,
    friction_torque,
    mesh_friction_force,
    mesh_lever,
)
from model.gear import HarmonicDrive
from model.geometry import engaged_zone, radial_lever, wedge_angle, wedge_lift
from model.kinematic_error import equivalent_eccentric_error, peak_to_peak, speed_ripple
from model.linear import (
    DynamicParameters,
    Mode,
    Resonance,
    dynamic_parameters,
    modes,
    resonance_speeds,
    torsional_mode,
    undamped_frequencies,
)
from model.stiffness import (
    DriveStiffness,
    bearing_load,
    bearing_stiffness,
    drive_stiffness,
    hertz_contact,
    kraemer_damping,
)
from model.tooth import pair_compliance
from model.units import RPM

_FRICTION_SPEEDS_RPM = (1, 3, 10, 30, 60, 120, 300, 600, 1000, 1200, 1800, 2000, 2400, 3000, 3500)
"""Input speeds [r/min] at which the friction torque is listed."""

_CATALOGUE_SPEED_RPM = 2000
"""Input speed [r/min] of the catalogue's no-load running torque."""


@dataclass(frozen=True, slots=True)
class Quantity:
    """One derived number: its name in the paper, value in SI, unit, what it is, and the equation that gives it."""

    name: str
    value: float
    unit: str
    description: str
    equation: str = ""

    def as_json(self) -> dict[str, Any]:
        """The quantity as plain data; a number that is not finite becomes null."""
        return _finite(
            {
                "value": self.value,
                "unit": self.unit,
                "description": self.description,
                "equation": self.equation,
            }
        )


@dataclass(frozen=True, slots=True)
class Comparison:
    """A computed number beside what the catalogue says of the same thing, and where the catalogue's
    number comes from.
    """

    name: str
    computed: float
    catalogue: float
    unit: str
    description: str
    provenance: str

    @property
    def ratio(self) -> float:
        """Computed over catalogue."""
        return self.computed / self.catalogue


@dataclass(frozen=True, slots=True)
class FrictionPoint:
    """The friction torque at the input at one speed [rad/s], and the parts of bearing and mesh in it [N m]."""

    speed: float
    torque: float
    bearing: float
    mesh: float


@dataclass(frozen=True, kw_only=True)
class Summary:
    """What `derived_quantities` found.

    `quantities` in the order of the paper; `shares` of the compliance at the output (they add up to
    1) and `pair_shares` of the compliance of one tooth pair; `catalogue` comparisons; `modes` with
    the input prescribed; `resonances`: where each order of the kinematic error meets the first;
    `friction`: the torque over speed; `bearing_over_load`: pairs of radial load [N] and K_b [N/m].
    """

    gear: str
    options: dict[str, Any]
    quantities: tuple[Quantity, ...]
    shares: dict[str, float]
    pair_shares: dict[str, float]
    catalogue: tuple[Comparison, ...]
    modes: tuple[Mode, ...]
    resonances: tuple[Resonance, ...]
    friction: tuple[FrictionPoint, ...]
    bearing_over_load: tuple[tuple[float, float], ...]

    def __getitem__(self, name: str) -> Quantity:
        """The quantity of this name, such as "K_HDf"; raises `KeyError` for one that is not there."""
        for quantity in self.quantities:
            if quantity.name == name:
                return quantity
        raise KeyError(name)

    def as_json(self) -> dict[str, Any]:
        """The summary as plain JSON-able data in SI; numbers that are not finite become null."""
        return {
            "gear": self.gear,
            "options": self.options,
            "quantities": {q.name: q.as_json() for q in self.quantities},
            "compliance_shares": self.shares,
            "tooth_pair_compliance_shares": self.pair_shares,
            "catalogue": {
                c.name: {**dataclasses.asdict(c), "ratio": c.ratio} for c in self.catalogue
            },
            "modes": [_finite(dataclasses.asdict(mode)) for mode in self.modes],
            "resonance_speeds": [
                {**dataclasses.asdict(r), "input_speed_rpm": r.input_speed / RPM}
                for r in self.resonances
            ],
            "friction_torque": [
                {**dataclasses.asdict(point), "speed_rpm": point.speed / RPM}
                for point in self.friction
            ],
            "bearing_stiffness_over_load": [
                {"radial_load": f, "K_b": k} for f, k in self.bearing_over_load
            ],
        }


def derived_quantities(gear: HarmonicDrive) -> Summary:
    """Every quantity that the model derives from a gear, in SI.

    Raises `ParameterError` where the parameter set allows no stiffness (see `model.tooth.pair_compliance`).
    """
    stiffness, parameters = drive_stiffness(gear), dynamic_parameters(gear)
    rows = (
        *_geometry(gear),
        *_mesh_and_cup(gear, stiffness),
        *_bearing(gear, stiffness),
        *_combined(stiffness),
        *_dynamics(parameters),
        *_error(gear),
        *_friction(gear),
    )
    orders = sorted({1.0, 2.0, 4.0} | {h.order for h in gear.kinematic_error})
    loads = {50.0, 100.0, gear.bearing.radial_load}
    loads |= {
        bearing_load(gear, t)
        for t in (gear.ratings.torque_1, gear.ratings.torque_2, gear.ratings.rated_torque)
    }
    return Summary(
        gear=gear.name,
        options=dataclasses.asdict(gear.options),
        quantities=tuple(itertools.starmap(Quantity, rows)),
        shares=stiffness.shares(),
        pair_shares=pair_compliance(gear).shares(),
        catalogue=tuple(_catalogue(gear, stiffness)),
        modes=modes(parameters),
        resonances=resonance_speeds(parameters, orders),
        friction=friction_points(gear, (speed * RPM for speed in _FRICTION_SPEEDS_RPM)),
        bearing_over_load=tuple(
            (f, bearing_stiffness(gear.bearing, gear.material, f).total) for f in sorted(loads)
        ),
    )


def friction_points(gear: HarmonicDrive, speeds: Iterable[float]) -> tuple[FrictionPoint, ...]:
    """The friction torque at input speeds [rad/s] in the gear's torque balance, split into bearing and mesh."""
    points: list[FrictionPoint] = []
    for speed in speeds:
        bearing = bearing_lever(gear) * float(bearing_friction_torque(gear, speed))
        mesh = mesh_lever(gear) * float(mesh_friction_force(gear, speed))
        points.append(FrictionPoint(speed, float(friction_torque(gear, speed)), bearing, mesh))
    return tuple(points)


_Row = tuple[str, float, str, str] | tuple[str, float, str, str, str]
"""What a `Quantity` is made of."""


def _geometry(gear: HarmonicDrive) -> tuple[_Row, ...]:
    """Equations 1 and 4-5."""
    zone = engaged_zone(gear)
    return (
        ("N", gear.ratio, "1", "ratio, circular spline fixed"),
        ("m", gear.geometry.module, "m", "module (d_c - d_f)/2"),
        ("alpha_n", wedge_angle(gear), "rad", "wedge angle", "1"),
        ("lambda", wedge_lift(gear), "m/rad", "radial lift of the wedge per input angle"),
        ("x_c", zone.x, "m", "boundary of the engaged zone, along the minor axis", "4"),
        ("y_c", zone.y, "m", "boundary of the engaged zone, along the major axis", "4"),
        ("phi_c", zone.angle, "rad", "boundary of the engaged zone, from the major axis", "4"),
        ("Z_R", zone.teeth, "1", "number of engaging-into teeth", "5"),
    )


def _mesh_and_cup(gear: HarmonicDrive, stiffness: DriveStiffness) -> tuple[_Row, ...]:
    """Equations 3 and 6-13."""
    pair, cup = pair_compliance(gear), stiffness.cup
    return (
        ("delta_B", pair.tooth.bending, "m/N", "bending of one tooth per force", "6"),
        ("delta_S", pair.tooth.shear, "m/N", "shear of one tooth per force", "7"),
        ("delta_C", pair.tooth.compression, "m/N", "compression of one tooth per force", "8"),
        ("delta_F", pair.tooth.root, "m/N", "root flexibility of one tooth per force", "9"),
        ("delta_m", 2.0 * pair.tooth.total, "m/N", "both teeth of a pair per force", "10"),
        ("delta_c", pair.contact, "m/N", "contact of a pair per force", "11"),
        ("K_ms", stiffness.tooth_pair, "N/m", "stiffness of one practical tooth pair", "12"),
        ("K_m", stiffness.mesh, "N/m", "mesh stiffness along the flank normal", "3"),
        ("K_cyl", cup.cylinder, "N m/rad", "torsional stiffness of the cup's cylinder", "13"),
        ("K_bot", cup.bottom, "N m/rad", "torsional stiffness of the cup's bottom disc", "13"),
        ("K_t", cup.total, "N m/rad", "torsional stiffness of the cup", "13"),
    )


def _bearing(gear: HarmonicDrive, stiffness: DriveStiffness) -> Iterator[_Row]:
    """Equations 14-15."""
    bearing = stiffness.bearing
    for ring in ("inner", "outer"):
        ratio = hertz_contact(gear.bearing, ring).ellipse_ratio
        yield f"kappa_{ring[0]}", ratio, "1", f"ellipse ratio of the contact at the {ring} ring"
    low, high = kraemer_damping(bearing.total)
    yield from (
        ("K_n", bearing.load_deflection, "N/m^1.5", "load-deflection factor of one ball"),
        ("F_r", bearing.radial_load, "N", "radial load at which K_b is evaluated"),
        ("Q_max", bearing.peak_ball_load, "N", "load on the most loaded ball"),
        ("delta_r", bearing.deflection, "m", "radial deflection of rigid rings"),
        ("K_b", bearing.total, "N/m", "radial stiffness of the bearing", "14"),
        (
            "C_b",
            gear.bearing.damping,
            "N s/m",
            "radial damping of the bearing, as the parameter set states it",
        ),
        ("C_b_low", low, "N s/m", "lower bound of the bearing's damping by Kraemer's rule", "15"),
        ("C_b_high", high, "N s/m", "upper bound of the bearing's damping by Kraemer's rule", "15"),
    )


def _combined(stiffness: DriveStiffness) -> tuple[_Row, ...]:
    """The parts at the output, and equation 21."""
    return (
        ("K_b_output", stiffness.bearing_at_output, "N m/rad", "K_b r_g^2/tan^2(alpha_t)"),
        ("K_m_output", stiffness.mesh_at_output, "N m/rad", "K_m r_g^2 cos^2(alpha_t)"),
        (
            "K_HDf",
            stiffness.combined_output,
            "N m/rad",
            "stiffness at the output, wave generator locked",
            "21",
        ),
        (
            "K_HDw",
            stiffness.combined_input,
            "N m/rad",
            "stiffness at the input, output locked",
            "21",
        ),
    )


def _dynamics(parameters: DynamicParameters) -> Iterator[_Row]:
    """Frequencies of equation 2 and the damping ratio of the torsional resonance."""
    for index, frequency in enumerate(undamped_frequencies(parameters), start=1):
        described = f"undamped natural frequency {index}"
        yield f"omega_{index}", float(frequency), "rad/s", described, "2"
    first = torsional_mode(parameters)
    if first is not None:
        hertz = first.damped_frequency / (2.0 * math.pi)
        yield "f_1", hertz, "Hz", "torsional resonance, input prescribed", "2"
        yield "zeta_1", first.damping_ratio, "1", "damping ratio of the torsional resonance", "2"
    squared = parameters.combined_stiffness / parameters.output_inertia
    yield "K_HDf/J_o", squared, "1/s2", "stiffness over inertia"
    yield "C_t", parameters.structural_damping, "N m s/rad", "structural damping of the cup"


def _error(gear: HarmonicDrive) -> tuple[_Row, ...]:
    """Equations 16-17."""
    error = peak_to_peak(gear.kinematic_error, gear.ratio)
    eccentric = float(equivalent_eccentric_error(gear, error))
    lever = radial_lever(gear.geometry)
    ripple = speed_ripple(gear) if gear.kinematic_error else 0.0
    return (
        ("ke_pp", error, "rad", "kinematic error, peak to peak over an output revolution", "16"),
        ("e_pp", eccentric, "m", "equivalent eccentric error, peak to peak", "17"),
        ("de/dke", lever, "m/rad", "eccentric error per kinematic error", "17"),
        (
            "speed_ripple",
            ripple,
            "1",
            "largest relative ripple of the output speed, N max|dke/dtheta_i|",
        ),
    )


def _friction(gear: HarmonicDrive) -> tuple[_Row, ...]:
    """Levers of equation 20 and its conversion."""
    return (
        ("lever_fm", mesh_lever(gear), "m", "input torque per mesh friction force", "20"),
        ("lever_fb", bearing_lever(gear), "1", "input torque per bearing friction torque", "20"),
        (
            "conversion",
            conversion_factor(gear),
            "1",
            "mesh friction in the published over the energy balance",
            "20",
        ),
    )


def _catalogue(gear: HarmonicDrive, stiffness: DriveStiffness) -> Iterator[Comparison]:
    """What the catalogue promises beside what the parameter set gives."""
    accuracy = peak_to_peak(gear.kinematic_error, gear.ratio)
    starting = mesh_lever(gear) * gear.mesh_friction.static
    starting += bearing_lever(gear) * abs(float(bearing_friction_torque(gear, 1e-9)))
    running = float(friction_torque(gear, _CATALOGUE_SPEED_RPM * RPM))
    rows = (
        ("K1", stiffness.combined_output, "stiffness_1", "K_HDf against the stiffness below T1"),
        (
            "K2",
            stiffness.combined_output,
            "stiffness_2",
            "K_HDf against the stiffness between T1 and T2",
        ),
        ("K3", stiffness.combined_output, "stiffness_3", "K_HDf against the stiffness above T2"),
        (
            "transmission_accuracy",
            accuracy,
            "transmission_accuracy",
            "kinematic error, peak to peak",
        ),
        ("starting_torque", starting, "starting_torque", "friction torque at the onset of motion"),
        (
            "running_torque",
            running,
            "running_torque",
            f"friction torque at {_CATALOGUE_SPEED_RPM} r/min",
        ),
    )
    for name, computed, rating, description in rows:
        value = gear.value(f"ratings.{rating}")
        yield Comparison(
            name, computed, value.value, value.unit, description, value.origin.provenance
        )


def _finite(entry: dict[str, Any]) -> dict[str, Any]:
    """The same data with null for what is not finite: JSON knows no infinity."""
    return {
        k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in entry.items()
    }
