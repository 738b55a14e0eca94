"""The linear part of equation 2: its parameters, matrices, modes, and where the orders of the error meet a resonance.

(2)  K_b (x1 - x2 + e) + C_b (x1' - x2' + e') = (J_g/r_g^2) x2'' + K_m (x2 s - y1 c) s + F_fm c ,   x1 = theta_i r_g tan(alpha_n)
     K_m (x2 s - y1 c) c = (J_g/r_g^2) y1'' + (K_t/r_g^2)(y1 - y2) + (C_t/r_g^2)(y1' - y2') + F_fb + F_fm s
     (K_t/r_g^2)(y1 - y2) + (C_t/r_g^2)(y1' - y2') = (J_o/r_g^2) y2'' + T_L/r_g ,   theta_o = y2/r_g

with s = sin(alpha_t), c = cos(alpha_t), coordinates q = (x2, y1, y2). With theta_i prescribed, e,
F_fm and F_fb depend on the input alone, so M q'' + C q' + K q = f(t) is linear with a known
right-hand side. C_t is the optional structural damping (0 in the published model). T_L is an
external torque that opposes the output.
"""  # noqa: E501

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from model.arrays import FloatArray, quotient
from model.errors import ParameterError
from model.gear import HarmonicDrive
from model.stiffness import drive_stiffness


@dataclass(frozen=True, slots=True, kw_only=True)
class DynamicParameters:
    """What equation 2 needs of a gear, as plain SI numbers, so that an identification can vary each of them.

    `ratio` N; `tooth_angle` alpha_t [rad]; `neutral_radius` r_g [m]; `bearing_stiffness` K_b [N/m];
    `bearing_damping` C_b [N s/m]; `mesh_stiffness` K_m [N/m]; `cup_stiffness` K_t [N m/rad];
    `structural_damping` C_t [N m s/rad]; `flexspline_inertia` J_g and `output_inertia` J_o [kg m2].
    """

    ratio: float
    tooth_angle: float
    neutral_radius: float
    bearing_stiffness: float
    bearing_damping: float
    mesh_stiffness: float
    cup_stiffness: float
    structural_damping: float
    flexspline_inertia: float
    output_inertia: float

    def __post_init__(self) -> None:
        for f in dataclasses.fields(self):
            value = getattr(self, f.name)
            may_vanish = f.name in ("bearing_damping", "structural_damping")
            if not math.isfinite(value) or value < 0.0 or (value == 0.0 and not may_vanish):
                limit = "finite and >= 0" if may_vanish else "finite and > 0"
                raise ParameterError(
                    "cannot be simulated", where=f"dynamics.{f.name}", value=value, limit=limit
                )
        if self.tooth_angle >= 0.5 * math.pi:
            raise ParameterError(
                "cannot be simulated",
                where="dynamics.tooth_angle",
                value=self.tooth_angle,
                limit="< pi/2 rad",
            )

    def replaced(self, **changes: float) -> DynamicParameters:
        """A copy with some of the numbers changed, by their names here."""
        return dataclasses.replace(self, **changes)

    @property
    def radial_lever(self) -> float:
        """r_g/tan(alpha_t), wedge displacement per output angle [m/rad]."""
        return self.neutral_radius / math.tan(self.tooth_angle)

    @property
    def combined_stiffness(self) -> float:
        """K_HDf, stiffness at the output with the wave generator locked (equation 21) [N m/rad]."""
        bearing = self.bearing_stiffness * self.radial_lever**2
        mesh = self.mesh_stiffness * (self.neutral_radius * math.cos(self.tooth_angle)) ** 2
        return 1.0 / (1.0 / self.cup_stiffness + 1.0 / bearing + 1.0 / mesh)


def dynamic_parameters(gear: HarmonicDrive, **changes: float) -> DynamicParameters:
    """The numbers of equation 2 from the geometry of a gear; `changes` replaces some of them by name."""
    stiffness = drive_stiffness(gear)
    parameters = DynamicParameters(
        ratio=gear.ratio,
        tooth_angle=gear.geometry.tooth_angle,
        neutral_radius=gear.geometry.neutral_radius,
        bearing_stiffness=stiffness.bearing.total,
        bearing_damping=gear.bearing.damping,
        mesh_stiffness=stiffness.mesh,
        cup_stiffness=stiffness.cup.total,
        structural_damping=gear.damping.structural,
        flexspline_inertia=gear.inertia.flexspline,
        output_inertia=gear.inertia.output,
    )
    return parameters.replaced(**changes) if changes else parameters


def mass_matrix(p: DynamicParameters) -> FloatArray:
    """M = diag(m_g, m_g, m_o), masses referred to r_g [kg]."""
    flexspline = p.flexspline_inertia / p.neutral_radius**2
    return np.diag([flexspline, flexspline, p.output_inertia / p.neutral_radius**2])


def damping_matrix(p: DynamicParameters) -> FloatArray:
    """C of equation 2 with the structural damping between y1 and y2 [N s/m]."""
    return ParameterTable.of([p]).damping()[0]


def stiffness_matrix(p: DynamicParameters) -> FloatArray:
    """K of equation 2 [N/m]."""
    return ParameterTable.of([p]).stiffness()[0]


def input_matrix(p: DynamicParameters) -> FloatArray:
    """f = B u: forces on (x2, y1, y2) per input of `INPUTS`, shape (3, 5)."""
    return ParameterTable.of([p]).inputs()[0]


INPUTS = (
    "ideal output angle",
    "ideal output speed",
    "mesh friction",
    "bearing friction torque",
    "load torque",
)
"""What drives equation 2: psi = theta_i/N + ke [rad], psi' [rad/s], F_fm [N], M_0 [N m], T_L [N m]."""


@dataclass(frozen=True)
class ParameterTable:
    """Parameter sets as columns, one row per set, so that all their matrices are made at once (first axis S)."""

    columns: dict[str, FloatArray]

    @staticmethod
    def of(sets: Sequence[DynamicParameters]) -> ParameterTable:
        """The table of these sets."""
        return ParameterTable(
            {
                name: np.array([getattr(p, name) for p in sets])
                for name in DynamicParameters.__slots__
            }
        )

    def __getitem__(self, name: str) -> FloatArray:
        """One number of all sets, by its name in `DynamicParameters`."""
        return self.columns[name]

    def __len__(self) -> int:
        return len(self["ratio"])

    @property
    def radial_lever(self) -> FloatArray:
        """r_g/tan(alpha_t) [m/rad]."""
        return self["neutral_radius"] / np.tan(self["tooth_angle"])

    def stiffness(self) -> FloatArray:
        """K of equation 2, shape (S, 3, 3) [N/m]."""
        s, c = np.sin(self["tooth_angle"]), np.cos(self["tooth_angle"])
        mesh, cup = self["mesh_stiffness"], self["cup_stiffness"] / self["neutral_radius"] ** 2
        matrix = np.zeros((len(self), 3, 3))
        matrix[:, 0, 0] = self["bearing_stiffness"] + mesh * s * s
        matrix[:, 0, 1] = matrix[:, 1, 0] = -mesh * s * c
        matrix[:, 1, 1] = mesh * c * c + cup
        matrix[:, 1, 2] = matrix[:, 2, 1] = -cup
        matrix[:, 2, 2] = cup
        return matrix

    def damping(self) -> FloatArray:
        """C of equation 2 with C_t, shape (S, 3, 3) [N s/m]."""
        cup = self["structural_damping"] / self["neutral_radius"] ** 2
        matrix = np.zeros((len(self), 3, 3))
        matrix[:, 0, 0] = self["bearing_damping"]
        matrix[:, 1, 1] = matrix[:, 2, 2] = cup
        matrix[:, 1, 2] = matrix[:, 2, 1] = -cup
        return matrix

    def inputs(self) -> FloatArray:
        """Forces on (x2, y1, y2) per input of `INPUTS`, shape (S, 3, 5).

        K_b (x1 + e) = K_b (r_g/tan alpha_t)(theta_i/N + ke), by equations 1 and 17.
        """
        matrix = np.zeros((len(self), 3, len(INPUTS)))
        matrix[:, 0, 0] = self["bearing_stiffness"] * self.radial_lever
        matrix[:, 0, 1] = self["bearing_damping"] * self.radial_lever
        matrix[:, 0, 2] = -np.cos(self["tooth_angle"])
        matrix[:, 1, 2] = -np.sin(self["tooth_angle"])
        matrix[:, 1, 3] = matrix[:, 2, 4] = -1.0 / self["neutral_radius"]
        return matrix


def energy_forms(
    sets: Sequence[DynamicParameters],
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """A, B and the maps back to q and q' of x' = A x + B u, in the state whose squared length is twice the energy.

    x = (R M^(1/2) q, M^(1/2) q') with R^2 = M^(-1/2) K M^(-1/2); then A = [[0, R], [-R, -C']] is
    skew apart from the damping, so its eigenvectors are well conditioned wherever the modes are
    distinct. Shapes per set (first axis) (6, 6), (6, 5), (3, 6), (3, 6).
    """
    count, table = len(sets), ParameterTable.of(sets)
    masses = np.stack(
        [table["flexspline_inertia"], table["flexspline_inertia"], table["output_inertia"]], axis=1
    )
    scale = table["neutral_radius"][:, None] / np.sqrt(masses)
    both = scale[:, :, None] * scale[:, None, :]
    squared, vectors = np.linalg.eigh(table.stiffness() * both)
    frequencies, back = np.sqrt(squared)[:, None, :], np.swapaxes(vectors, 1, 2)
    system, drive = np.zeros((count, 6, 6)), np.zeros((count, 6, len(INPUTS)))
    root = (vectors * frequencies) @ back
    system[:, :3, 3:], system[:, 3:, :3] = root, -root
    system[:, 3:, 3:] = -table.damping() * both
    drive[:, 3:] = scale[:, :, None] * table.inputs()
    position, velocity = np.zeros((count, 3, 6)), np.zeros((count, 3, 6))
    position[:, :, :3] = scale[:, :, None] * ((vectors / frequencies) @ back)
    velocity[:, [0, 1, 2], [3, 4, 5]] = scale
    return system, drive, position, velocity


@dataclass(frozen=True, slots=True)
class Mode:
    """One mode of equation 2 with the input angle prescribed.

    `natural_frequency` |pole| [rad/s], `damping_ratio` (1 for a real, aperiodic pole), `damped_frequency` [rad/s],
    `time_constant` of its decay [s] (infinite without damping).
    """

    natural_frequency: float
    damping_ratio: float
    damped_frequency: float
    time_constant: float


def modes(p: DynamicParameters) -> tuple[Mode, ...]:
    """The modes in ascending frequency: complex pairs once, real poles each (see `torsional_mode`)."""
    eigenmodes: list[Mode] = []
    system: FloatArray = energy_forms([p])[0][0]
    for pole in np.linalg.eigvals(system):
        if pole.imag < 0.0:
            continue
        size = abs(pole)
        decay = -pole.real if -pole.real > 1e-13 * size else 0.0
        ratio = 1.0 if pole.imag == 0.0 else decay / size
        eigenmodes.append(
            Mode(
                float(size),
                float(ratio),
                float(pole.imag),
                float(quotient(1.0, decay, math.inf)),
            )
        )
    return tuple(sorted(eigenmodes, key=lambda mode: mode.natural_frequency))


def torsional_mode(p: DynamicParameters) -> Mode | None:
    """The torsional resonance: the lowest mode that oscillates; None where everything is overdamped.

    A heavily damped bearing gives real poles below it, so it need not be the first of `modes`.
    """
    return next((mode for mode in modes(p) if mode.damped_frequency > 0.0), None)


def undamped_frequencies(p: DynamicParameters) -> FloatArray:
    """The three natural frequencies of equation 2 without damping, ascending [rad/s]."""
    scale = 1.0 / np.sqrt(np.diag(mass_matrix(p)))
    return np.sqrt(np.linalg.eigvalsh(stiffness_matrix(p) * np.outer(scale, scale)))


@dataclass(frozen=True, slots=True)
class Resonance:
    """An order of the kinematic error and the input speed [rad/s] at which it excites the torsional resonance."""

    order: float
    input_speed: float


def resonance_speeds(p: DynamicParameters, orders: Iterable[float]) -> tuple[Resonance, ...]:
    """Where n theta_i' equals the damped frequency of the first oscillating mode, for each order n > 0."""
    first = torsional_mode(p)
    if first is None or first.damped_frequency == 0.0:
        return ()
    return tuple(
        Resonance(float(order), first.damped_frequency / float(order))
        for order in orders
        if order > 0.0
    )


def common_ratio(sets: Sequence[DynamicParameters]) -> float:
    """The one ratio of a batch; raises `ParameterError` where the sets differ, because the inputs depend on it."""
    if not sets:
        raise ParameterError("holds no parameter set", where="batch", limit="at least one")
    if any(p.ratio != sets[0].ratio for p in sets):
        raise ParameterError(
            "mixes ratios", where="batch", limit=f"ratio {sets[0].ratio:g} in every set"
        )
    return sets[0].ratio
