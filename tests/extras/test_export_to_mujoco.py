"""MuJoCo reads what is exported, and turns as it says: friction, steady speed, inertia; a joint that coasts."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

from rig.exchange.check import Row
from rig.exchange.exporting import exported
from rig.exchange.joint import FormName, Side, forms_of, seen_from
from tests.rig.exchange.known import known_gear


def rows_of(side: Side, form: FormName) -> dict[str, Row]:
    done = exported(known_gear(), "mjcf", side=side, form=form, is_checked=True)
    return {row.what: row for row in done.checked}


@pytest.mark.parametrize("side", ["motor", "joint"])
def test_lugre_is_the_gear_within_what_the_form_says(side: Side) -> None:
    gear = known_gear()
    form = forms_of(seen_from(gear, side))["lugre"]
    rows = rows_of(side, "lugre")
    friction = [row for what, row in rows.items() if what.startswith("friction")]
    assert len(friction) == 8
    assert max(abs(row.error) for row in friction) < 1.02 * form.worst
    assert form.rms < 0.02
    steady = [row for what, row in rows.items() if what.startswith("steady")]
    assert len(steady) == 3
    assert max(abs(row.error) for row in steady) < 0.01
    assert abs(rows["inertia"].error) < 1e-4


def test_the_linear_form_is_what_it_says_where_dry_friction_is_whole() -> None:
    gear = known_gear()
    joint = seen_from(gear, "joint")
    law = forms_of(joint)["linear"]
    rows = rows_of("joint", "linear")
    for rpm in (100, 300, 1000, 3000):
        row = rows[f"friction at {rpm} r/min"]
        speed = rpm * 2.0 * 3.141592653589793 / 60.0 / joint.factor
        assert row.found == pytest.approx(float(law.torque(speed)), rel=1e-3)
    # MuJoCo's dry friction is a soft constraint: at the slowest speeds it takes a part of it.
    assert rows["friction at 3 r/min"].error < -0.3


def test_urdf_is_read_and_lacks_the_inertia() -> None:
    done = exported(known_gear(), "urdf", is_checked=True)
    rows = {row.what: row for row in done.checked}
    assert "inertia" not in rows
    assert abs(rows["friction at 1000 r/min"].error) < 0.1


def test_a_joint_coasts_as_the_gear_does() -> None:
    """The picture of the page: by LuGre the joint stands as soon as the gear's own equations say."""
    script = Path(__file__).parents[2] / "docs" / "make_joint_picture.py"
    curves = runpy.run_path(str(script))["coasting"]()
    standstill = {name: curve.standstill for name, curve in curves.items()}
    assert standstill["MuJoCo, LuGre"] == pytest.approx(standstill["equation 20"], rel=0.02)
    assert abs(standstill["MuJoCo, linear"] / standstill["equation 20"] - 1.0) > 0.02
