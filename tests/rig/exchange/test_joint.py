"""The laws that a target can hold: how far off they are, at which side, and that they never push."""

from __future__ import annotations

import math
from xml.etree import ElementTree

import numpy as np
import pytest

from model.friction import friction_torque
from model.units import RPM
from rig.exchange.exporting import exported
from rig.exchange.joint import Side, forms_of, seen_from, torque_at
from tests.rig.exchange.known import known_gear


@pytest.mark.parametrize("side", ["motor", "joint"])
def test_a_law_is_as_far_off_as_it_says(side: Side) -> None:
    gear = known_gear()
    joint = seen_from(gear, side)
    forms = forms_of(joint)
    for form in forms.values():
        at = np.geomspace(3.0, 3000.0, 977) * RPM / joint.factor
        error = form.torque(at) / torque_at(gear, side, at) - 1.0
        assert math.sqrt(np.mean(error**2)) == pytest.approx(form.rms, rel=0.02)
        assert np.abs(error).max() == pytest.approx(form.worst, rel=0.02)
        np.testing.assert_array_equal(form.torque(-at), -form.torque(at))
        far = np.geomspace(1e-3, 2.0 * joint.largest_speed, 500)
        assert form.torque(far).min() > 0.0
    assert forms["lugre"].rms < 0.02
    assert forms["lugre"].rms < forms["polynomial"].rms <= forms["linear"].rms


def test_the_joint_has_the_motors_power() -> None:
    gear = known_gear()
    speed = 100.0
    at_input = float(friction_torque(gear.gear, speed))
    at_output = float(torque_at(gear, "joint", speed / 120.0))
    assert at_output * speed / 120.0 == pytest.approx(at_input * speed, rel=1e-14)
    motor, joint = seen_from(gear, "motor"), seen_from(gear, "joint")
    assert joint.inertia == pytest.approx(120.0**2 * motor.inertia, rel=1e-14)
    assert motor.inertia == pytest.approx(
        gear.gear.inertia.wave_generator + gear.gear.inertia.flexspline / 120.0**2, rel=1e-14
    )


def test_urdf_is_by_the_conventions_of_ros() -> None:
    gear = known_gear()
    done = exported(gear, "urdf")
    root = ElementTree.fromstring(done.text)
    assert root.tag == "robot"
    dynamics = root.find("joint/dynamics")
    assert dynamics is not None
    linear = forms_of(seen_from(gear, "joint"))["linear"]
    assert float(dynamics.attrib["friction"]) == linear.coulomb
    assert float(dynamics.attrib["damping"]) == linear.damping[0]
    reduction = root.find("transmission/actuator/mechanicalReduction")
    assert reduction is not None
    assert float(reduction.text or "") == 120.0
    assert any("armature" in one for one in done.notes.cannot)
    assert root.find("joint/limit") is not None


def test_mjcf_of_every_form_is_whole_xml_with_its_numbers() -> None:
    gear = known_gear()
    joint = seen_from(gear, "motor")
    for name, form in forms_of(joint).items():
        hinge = ElementTree.fromstring(exported(gear, "mjcf", side="motor", form=name).text).find(
            "worldbody/body/joint"
        )
        assert hinge is not None
        assert float(hinge.attrib["armature"]) == joint.inertia
        damping = tuple(map(float, hinge.attrib["damping"].split()))
        assert damping == (form.damping[:1] if name == "linear" else form.damping)
        assert ("frictionloss" in hinge.attrib) is (name != "lugre")
