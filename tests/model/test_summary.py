"""The summary of derived quantities."""

from __future__ import annotations

import dataclasses
import json

import pytest

from model.friction import friction_torque
from model.gear_file import shipped_gear
from model.summary import derived_quantities
from model.units import RPM

GEAR = shipped_gear()
SUMMARY = derived_quantities(GEAR)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("Z_R", 22.24),
        ("K_cyl", 3.249e5),
        ("K_bot", 6.693e4),
        ("K_t", 5.55e4),
        ("K_b", 1.0767e8),
        ("alpha_n", 0.01443275),
        ("K_HDf", 4.657e4),
        ("K_HDw", 3.234),
        ("omega_1", 682.4),
        ("C_b", 4.3e4),
        ("conversion", 3.906),
    ],
)
def test_quantities_by_their_names_in_the_paper(name: str, value: float) -> None:
    assert SUMMARY[name].value == pytest.approx(value, rel=1e-3)
    assert SUMMARY[name].unit
    assert SUMMARY[name].description


def test_shares_and_friction_add_up() -> None:
    assert sum(SUMMARY.shares.values()) == pytest.approx(1.0)
    assert sum(SUMMARY.pair_shares.values()) == pytest.approx(1.0)
    for point in SUMMARY.friction:
        assert point.bearing + point.mesh == pytest.approx(point.torque, rel=1e-12)
        assert point.torque == float(friction_torque(GEAR, point.speed))


def test_resonances_and_catalogue() -> None:
    by_order = {r.order: r.input_speed / RPM for r in SUMMARY.resonances}
    assert by_order[2.0] == pytest.approx(3272.0, rel=1e-3)
    assert by_order[4.0] == pytest.approx(0.5 * by_order[2.0])
    names = {c.name: c for c in SUMMARY.catalogue}
    assert names["K1"].catalogue == 3.1e4
    assert names["K2"].ratio == pytest.approx(SUMMARY["K_HDf"].value / 5.0e4)
    assert names["transmission_accuracy"].provenance == "catalogue"


def test_json_is_plain_and_complete() -> None:
    text = json.dumps(SUMMARY.as_json(), allow_nan=False)
    found = json.loads(text)
    for name in ("Z_R", "K_ms", "K_m", "K_cyl", "K_bot", "K_t", "K_b", "K_HDf", "K_HDw", "alpha_n"):
        assert found["quantities"][name]["value"] == SUMMARY[name].value
    assert len(found["modes"]) == len(SUMMARY.modes)
    assert found["friction_torque"][0]["speed_rpm"] == pytest.approx(1.0)


def test_undamped_and_errorless_gears_are_summarised_too() -> None:
    still = dataclasses.replace(GEAR.with_values({"bearing.damping": 0.0}), kinematic_error=())
    found = derived_quantities(still).as_json()
    json.dumps(found, allow_nan=False)
    assert all(mode["time_constant"] is None for mode in found["modes"])
    assert found["quantities"]["ke_pp"]["value"] == 0.0
    with pytest.raises(KeyError):
        SUMMARY["K_nothing"]
