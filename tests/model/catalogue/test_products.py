"""Every product of the tables makes a set that loads and contradicts nothing; what no table has is marked."""

from __future__ import annotations

import re
from importlib import resources

import pytest

from model import quantities
from model.catalogue.contradictions import contradictions, not_compared
from model.catalogue.proportions import NAMEPLATE, RATINGS, gear_of_product, open_questions
from model.catalogue.table import (
    SERIES,
    Product,
    of_product,
    of_relatives,
    products,
    read_product,
    rows,
    sources,
)
from model.errors import ParameterError
from model.gear import Origin
from model.gear_file import gear_from_mapping, gear_to_toml, shipped_gear
from model.units import RPM


@pytest.mark.parametrize("product", products(), ids=str)
def test_every_product_makes_a_set_that_loads_and_contradicts_nothing(product: Product) -> None:
    gear = gear_of_product(product, {})
    text = gear_to_toml(gear)
    assert gear_from_mapping(quantities.parse_toml(text.encode(), "new"), "new") == gear
    assert contradictions(gear) == ()
    assert not_compared(gear) == ""
    assert gear.ratio == product.ratio
    assert gear.name == str(product)
    for value in gear.values():
        assert value.origin.source, value.path
        assert value.origin.provenance in ("catalogue", "computed", "assumed")


def test_the_tables_hold_every_series_and_each_row_a_source() -> None:
    assert {product.series for product in products()} == set(SERIES)
    assert len(products()) > 200
    assert {row.source for row in rows()} == set(sources())
    readme = (resources.files("model.catalogue") / "README.md").read_text(encoding="utf-8")
    for name in sources():
        assert re.search(rf"\b{name}\b", readme), name


def test_the_unit_type_decides() -> None:
    light = of_product(read_product("SHG-25-100-2UH-LW"), "rated_torque")
    unit = of_product(read_product("SHG-25-100-2UH"), "rated_torque")
    assert light is not None
    assert unit is not None
    assert (light.row.source, unit.row.source) == ("S9", "S1")
    assert of_product(read_product("CSG-14-80-2A"), "momentary_peak_torque") is None


def test_the_better_source_is_taken_and_the_other_named() -> None:
    found = of_product(read_product("SHG-14-100-2UH"), "repeated_peak_torque")
    assert found is not None
    assert (found.row.source, found.row.value) == ("S1", 36.0)
    assert [(row.source, row.value) for row in found.conflicts] == [("S8", 30.0)]
    gear = gear_of_product(read_product("SHG-14-100-2UH"), {})
    assert "CONTRADICTED by S8" in gear.origins["ratings.repeated_peak_torque"].source


def test_a_third_party_alone_is_no_source() -> None:
    product = Product("CSF", 11, 50, "2UH")
    only = [r for r in rows() if (r.series, r.size, r.ratio) == ("CSF", 11, "50")]
    assert {r.source for r in only if r.quantity == "average_torque_limit"} == {"S8"}
    assert of_product(product, "average_torque_limit") is None
    for quantity in {rule.quantity for rule in RATINGS.values()}:
        near = of_relatives(("CSF", "CSG", "CHA"), product, quantity)
        assert near is not None
        assert near.row.rank != "C"


def test_what_no_table_has_is_scaled_and_marked() -> None:
    gear = gear_of_product(read_product("XYZ-28-100-2UH"), {})
    torques = [f"ratings.{name}" for name in ("rated_torque", "repeated_peak_torque")]
    for path in torques:
        assert gear.origins[path].provenance == "assumed"
        assert "times (28/25)^2." in gear.origins[path].source
    assert gear.ratings.rated_torque == pytest.approx(67.0 * (28 / 25) ** 2.94, rel=1e-4)
    assert set(torques) < set(open_questions(gear)) <= set(NAMEPLATE)
    assert "XYZ-28-100-2UH" in not_compared(gear)
    assert contradictions(gear) == ()


def test_what_was_read_from_the_plate_stands_before_the_table() -> None:
    plate = {"ratings.maximum_input_speed": (4000.0 * RPM, Origin("catalogue", "nameplate"))}
    gear = gear_of_product(read_product("CSG-25-100-2UH"), plate)
    assert gear.ratings.maximum_input_speed == 4000.0 * RPM
    assert gear.origins["ratings.maximum_input_speed"].source == "nameplate"
    assert [c.where for c in contradictions(gear)] == ["ratings.maximum_input_speed"]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("CSF-25-120", "unit type"),
        ("gear", "SERIES-SIZE-RATIO-UNIT"),
        ("", "SERIES"),
        ("CSF-250-100-2UH", "size 8 to"),
        ("CSF-5-100-2UH", "size"),
    ],
)
def test_what_is_no_product_of_these_sizes_is_refused(text: str, says: str) -> None:
    with pytest.raises(ParameterError, match=says):
        gear_of_product(read_product(text), {})


@pytest.mark.parametrize(
    ("path", "factor", "name"),
    [
        ("geometry.circular_spline_diameter", 1.0005, "teeth against diameters"),
        ("geometry.radial_deformation", 1.5, "deformation against module"),
        ("tooth.height", 0.7, "tooth height against module"),
        ("tooth.root_width", 1.5, "tooth root against module"),
        ("tooth.width", 4.0, "tooth width against diameter"),
        ("cup.outer_diameter", 1.1, "cup against diameter"),
        ("cup.outer_diameter", 1.03, "wall against diameter"),
        ("bearing.pitch_diameter", 1.2, "bearing against cup"),
        ("bearing.balls", 2, "balls against bearing"),
        ("inertia.wave_generator", 10.0, "wave generator's inertia against size"),
        ("inertia.flexspline", 0.1, "cup's inertia against its size"),
        ("ratings.stiffness_1", 1.0 / 3437.7, "computed stiffness against K1"),
        ("ratings.rated_torque", 2.0, "rated_torque against the table of CSF"),
        ("ratings.average_torque_limit", 0.5, "rated_torque against average_torque_limit"),
        ("ratings.average_input_speed", 2.0, "average_input_speed against maximum_input_speed"),
        ("ratings.stiffness_2", 0.5, "stiffness_1 against stiffness_2"),
        ("ratings.ratcheting_torque", 0.5, "momentary_peak_torque against ratcheting_torque"),
    ],
)
def test_each_contradiction_is_found_by_name(path: str, factor: float, name: str) -> None:
    gear = shipped_gear()
    assert contradictions(gear) == ()
    wrong = gear.with_values({path: gear.value(path).value * factor})
    found = {c.name: c for c in contradictions(wrong)}
    assert name in found
    assert all((c.value, c.expected, c.remedy) for c in found.values())


def test_teeth_of_another_ratio_contradict_name_and_diameters() -> None:
    wrong = shipped_gear().with_values({"teeth.flexspline": 200, "teeth.circular_spline": 202})
    names = {c.name for c in contradictions(wrong)}
    assert {"ratio against name", "teeth against diameters"} <= names
    three = shipped_gear().with_values({"teeth.circular_spline": 243})
    assert "tooth difference" in {c.name for c in contradictions(three)}


def test_a_diameter_of_another_size_contradicts_the_name() -> None:
    gear = shipped_gear()
    changes = {
        path: gear.value(path).value * 1.08
        for path in ("geometry.flexspline_diameter", "geometry.circular_spline_diameter")
    }
    assert "diameter against name" in {c.name for c in contradictions(gear.with_values(changes))}
