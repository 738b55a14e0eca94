"""The JSON form: by its published schema, and by code that shares nothing with ours."""

from __future__ import annotations

import copy
import json
import math
from typing import Any

import jsonschema
import numpy as np
import pytest

from model.friction import friction_torque
from model.gear_file import shipped_gear
from rig.exchange.gear_json import gear_json, json_text, schema
from rig.exchange.identified import IdentifiedGear, of_set
from tests.rig.exchange.known import known_gear


def independent_torque(gear: dict[str, Any], speed: float) -> float:
    """Equations 18 to 20 as the file words them, from its parameters alone: no lever, no function of the program."""
    p = {name: one["value"] for name, one in gear["parameters"].items()}
    n = gear["teeth_ratio"]
    product = 1e6 * p["bearing.viscosity"] * speed * 60 / (2 * math.pi)
    if gear["options"]["low_speed_branch"]:
        product = max(product, 2000.0)
    m_0 = 0.1 * p["bearing.friction_factor"] * product ** (2 / 3) * p["bearing.pitch_diameter"] ** 3
    rest = math.exp(-((speed / p["mesh_friction.stribeck_velocity"]) ** p["mesh_friction.shape"]))
    f_fm = (
        p["mesh_friction.coulomb"]
        + (p["mesh_friction.static"] - p["mesh_friction.coulomb"]) * rest
        + p["mesh_friction.viscous"] * speed
    )
    sine = math.sin(p["geometry.tooth_angle"])
    if gear["options"]["torque_balance"] == "published":
        return m_0 + p["geometry.flexspline_diameter"] * sine / (2 * n) * f_fm
    return m_0 * (1 + 1 / n) + p["geometry.neutral_radius"] / (n * sine) * f_fm


@pytest.mark.parametrize("balance", ["energy", "published"])
@pytest.mark.parametrize("branch", [True, False])
def test_other_code_reads_the_same_torque(balance: str, branch: bool) -> None:
    import dataclasses

    gear = shipped_gear()
    options = dataclasses.replace(gear.options, torque_balance=balance, low_speed_branch=branch)
    gear = dataclasses.replace(gear, options=options)
    read = json.loads(json_text(of_set(gear)))
    speeds = np.geomspace(0.3, 320.0, 40)
    there = [independent_torque(read, float(speed)) for speed in speeds]
    np.testing.assert_allclose(there, friction_torque(gear, speeds), rtol=1e-12, atol=0.0)
    for point in read["checkpoints"]:
        assert independent_torque(read, point["input_speed"]) == pytest.approx(
            point["torque"], rel=1e-12
        )


@pytest.mark.parametrize("identified", [of_set(shipped_gear()), known_gear()], ids=["set", "runs"])
def test_the_file_is_of_the_published_schema(identified: IdentifiedGear) -> None:
    checker = jsonschema.Draft202012Validator(schema())
    jsonschema.Draft202012Validator.check_schema(schema())
    content = json.loads(json_text(identified))
    checker.validate(content)
    matrix = np.array(content["covariance"]["matrix"])
    assert matrix.shape == (len(content["covariance"]["names"]),) * 2 or not matrix.size
    assert set(content["covariance"]["names"]) <= set(content["parameters"])
    for spoiled in ("format", "parameters", "covariance", "equations", "validity"):
        less = copy.deepcopy(content)
        del less[spoiled]
        assert not checker.is_valid(less)


def test_what_is_uncertain_says_so_and_nothing_else_does() -> None:
    content = gear_json(known_gear())
    stated = {
        name
        for name, one in content["parameters"].items()
        if one["standard_uncertainty"] is not None
    }
    assert stated == set(content["covariance"]["names"])
    coulomb = content["parameters"]["mesh_friction.coulomb"]
    assert coulomb["expanded_uncertainty"] == pytest.approx(2 * 0.03 * coulomb["value"])
    assert content["parameters"]["bearing.viscosity"]["expanded_uncertainty"] is None
