"""An identified gear as JSON that code without ours can read: equations by number, parameters, covariance, validity.

The schema is `gear-model-1.schema.json` beside this file (JSON Schema 2020-12). Everything is SI. `checkpoints` are
speeds and torques by this program's own equation 20: whoever reads the file can hold his reading against them.
"""

from __future__ import annotations

import json
import math
from importlib import resources
from typing import Any

import numpy as np

from model.friction import bearing_lever, friction_torque, mesh_lever
from model.linear import dynamic_parameters, torsional_mode
from model.stiffness import drive_stiffness
from rig.exchange.identified import IdentifiedGear, Parameter
from rig.exchange.joint import seen_from
from rig.program import this_program

FORMAT = "harmonic-gear-1"
"""The value of `format`; another one is another schema."""
EQUATIONS = (
    (
        "18",
        "M_0 = 0.1 f_0 P^(2/3) d_m^3",
        "friction torque of the wave-generator bearing [N m]; P = max(1e6 nu_0 w 60/(2 pi), 2000) where "
        "low_speed_branch is true, without the max where it is false; w is the magnitude of the input speed [rad/s]",
    ),
    (
        "19",
        "F_fm = F_c + (F_s - F_c) exp(-(w/v_s)^sigma) + c_v w",
        "friction along the tooth flank [N]",
    ),
    (
        "20",
        "T_f = bearing_lever M_0 + mesh_lever F_fm",
        "no-load running torque at the input [N m], with the sign of the speed. energy: bearing_lever = 1 + 1/N, "
        "mesh_lever = r_g/(N sin(alpha_t)); published: bearing_lever = 1, mesh_lever = d_f sin(alpha_t)/(2 N); "
        "N = Z_f/(Z_c - Z_f) = teeth_ratio",
    ),
    (
        "16",
        "ke = sum a cos(n theta_i) + b sin(n theta_i)",
        "kinematic error at the output [rad] over the input angle theta_i [rad], per order n of cosine a and sine b",
    ),
    (
        "joint",
        "T = N T_f(N w_o), J = N^2 J_wg + J_g",
        "the same at the output: torque [N m] over the output's speed w_o [rad/s], inertia of the gear alone [kg m2], "
        "without J_g where the flexspline is fixed; N = ratio, as mounted",
    ),
)
"""Number in Zou et al. 2015 ("joint" is ours), the equation, and what its words mean."""
_CHECKPOINTS = 21


def gear_json(identified: IdentifiedGear) -> dict[str, Any]:
    """The gear as plain data of the published schema."""
    gear = identified.gear
    return {
        "format": FORMAT,
        "name": gear.name,
        "serial": identified.serial,
        "mark": identified.mark,
        "program": this_program().as_json(),
        "units": "SI",
        "mounting": identified.mounting,
        "ratio": identified.ratio,
        "teeth_ratio": gear.ratio,
        "options": {
            "torque_balance": gear.options.torque_balance,
            "low_speed_branch": gear.options.low_speed_branch,
        },
        "equations": [
            {"number": number, "equation": equation, "meaning": meaning}
            for number, equation, meaning in EQUATIONS
        ],
        "parameters": {one.name: _parameter(one) for one in identified.parameters},
        "covariance": {
            "names": list(identified.uncertain),
            "matrix": identified.covariance.tolist(),
        },
        "validity": {
            "input_speed": list(identified.speeds) or None,
            "housing_temperature": list(identified.temperatures) or None,
        },
        "derived": _derived(identified),
        "checkpoints": _checkpoints(identified),
        "runs": [
            {"run": one.run, "kind": one.kind, "sha256": one.sha256, "analysis": one.analysis}
            for one in identified.runs
        ],
        "remarks": list(identified.remarks),
    }


def _parameter(one: Parameter) -> dict[str, Any]:
    standard = expanded = factor = None
    if one.is_uncertain:
        standard, expanded = one.standard_uncertainty, one.expanded_uncertainty
        factor = expanded / standard
    return {
        "symbol": one.symbol,
        "value": one.value,
        "unit": one.unit,
        "standard_uncertainty": standard,
        "expanded_uncertainty": expanded,
        "coverage_factor": factor,
        "provenance": one.provenance,
        "source": one.source,
        "description": one.description,
    }


def _derived(identified: IdentifiedGear) -> dict[str, Any]:
    """What other tools ask for and the equations above do not give at once."""
    gear = identified.gear
    dynamics = dynamic_parameters(gear)
    mode = torsional_mode(dynamics)
    return {
        "bearing_lever": {"value": bearing_lever(gear), "unit": "1"},
        "mesh_lever": {"value": mesh_lever(gear), "unit": "m"},
        "inertia_at_motor": {"value": seen_from(identified, "motor").inertia, "unit": "kg m2"},
        "inertia_at_joint": {"value": seen_from(identified, "joint").inertia, "unit": "kg m2"},
        "torsional_stiffness": {
            "value": drive_stiffness(gear).combined_output,
            "unit": "N m/rad",
        },
        "mode_damping_ratio": {
            "value": mode and mode.damping_ratio,
            "unit": "1",
        },
    }


def _checkpoints(identified: IdentifiedGear) -> list[dict[str, float]]:
    speeds = np.geomspace(*identified.compared_over, _CHECKPOINTS)
    torques = friction_torque(identified.gear, speeds)
    return [
        {"input_speed": float(speed), "torque": float(torque)}
        for speed, torque in zip(speeds, torques, strict=True)
    ]


def json_text(identified: IdentifiedGear) -> str:
    """The file's text; every number reads back to the same double."""
    return json.dumps(gear_json(identified), indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def schema() -> dict[str, Any]:
    """The published schema."""
    place = resources.files("rig.exchange").joinpath("gear-model-1.schema.json")
    return json.loads(place.read_text(encoding="utf-8"))


def torque_of(content: dict[str, Any], speed: float) -> float:
    """Friction torque [N m] at an input speed [rad/s] by the file's own numbers and equations, and by nothing else."""
    value = {name: one["value"] for name, one in content["parameters"].items()}
    w = abs(speed)
    product = 1e6 * value["bearing.viscosity"] * w * 60.0 / (2.0 * math.pi)
    if content["options"]["low_speed_branch"]:
        product = max(product, 2000.0)
    bearing = (
        0.1
        * value["bearing.friction_factor"]
        * product ** (2.0 / 3.0)
        * value["bearing.pitch_diameter"] ** 3
    )
    coulomb, static = value["mesh_friction.coulomb"], value["mesh_friction.static"]
    decay = math.exp(
        -((w / value["mesh_friction.stribeck_velocity"]) ** value["mesh_friction.shape"])
    )
    mesh = coulomb + (static - coulomb) * decay + value["mesh_friction.viscous"] * w
    derived = content["derived"]
    torque = derived["bearing_lever"]["value"] * bearing + derived["mesh_lever"]["value"] * mesh
    return math.copysign(torque, speed) if speed else 0.0
