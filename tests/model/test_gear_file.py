"""Parameter files: exact round trip, readable refusals, no traceback for any text."""

from __future__ import annotations

import dataclasses
import json
import math
import tomllib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from model import quantities
from model.catalogue.contradictions import contradictions
from model.errors import ModelError, ParameterError
from model.gear import Harmonic, HarmonicDrive, ModelOptions, Origin
from model.gear_file import (
    gear_from_mapping,
    gear_to_mapping,
    gear_to_toml,
    harmonic_path,
    load_gear,
    save_gear,
    shipped_gear,
)
from model.units import ARCMIN, RPM

GEAR = shipped_gear()
TEXT = gear_to_toml(GEAR)


def read(text: str) -> HarmonicDrive:
    return gear_from_mapping(quantities.parse_toml(text.encode(), "gear.toml"), "gear.toml")


def changed(before: str, after: str) -> str:
    assert TEXT.count(before) == 1, before
    return TEXT.replace(before, after)


def test_shipped_gear_has_the_published_ratio_and_a_source_beside_every_number() -> None:
    assert GEAR.ratio == 120.0
    assert GEAR.mounted_ratio("flexspline-fixed") == 121.0
    for value in GEAR.values():
        assert value.origin.source, value.path
    for harmonic in GEAR.kinematic_error:
        assert GEAR.origins[harmonic_path(harmonic.order)].source


def test_shipped_gear_holds_si() -> None:
    assert GEAR.geometry.flexspline_diameter == 0.0635
    assert GEAR.geometry.tooth_angle == pytest.approx(math.radians(30.0), rel=1e-15)
    assert GEAR.bearing.viscosity == 40e-6
    assert GEAR.ratings.maximum_input_speed == pytest.approx(5600.0 * RPM, rel=1e-15)
    assert GEAR.kinematic_error[1].cosine == pytest.approx(0.30 * ARCMIN, rel=1e-15)
    assert isinstance(GEAR.teeth.flexspline, int)


def test_text_and_mapping_read_back_to_the_same_gear(tmp_path: Path) -> None:
    path = tmp_path / "gear.toml"
    save_gear(GEAR, path)
    assert load_gear(path) == GEAR
    assert (
        gear_from_mapping(json.loads(json.dumps(gear_to_mapping(GEAR), allow_nan=False)), "run")
        == GEAR
    )


@settings(max_examples=60)
@given(
    torsion=st.floats(0.01, 0.05),
    angle=st.floats(math.radians(15), math.radians(35)),
    friction=st.floats(1e-3, 1e3),
    uncertainty=st.one_of(st.none(), st.floats(0.0, 10.0)),
    order=st.floats(1e-3, 300.0),
    cosine=st.floats(-1e-3, 1e-3),
    source=st.text(st.characters(blacklist_categories=["Cs"]), max_size=30),
)
def test_any_gear_reads_back_exactly(
    torsion: float,
    angle: float,
    friction: float,
    uncertainty: float | None,
    order: float,
    cosine: float,
    source: str,
) -> None:
    origin = Origin("identified", source, uncertainty)
    gear = GEAR.with_values(
        {
            "cup.length": torsion,
            "geometry.tooth_angle": angle,
            "mesh_friction.coulomb": friction,
            "mesh_friction.static": friction,
        },
        origin,
    )
    origins = {**gear.origins, harmonic_path(order): Origin("identified", source, None)}
    gear = dataclasses.replace(
        gear, kinematic_error=(Harmonic(order, cosine, 0.0),), origins=origins
    )
    back = read(gear_to_toml(gear))
    assert back.origins[harmonic_path(order)] == origins[harmonic_path(order)]
    assert dataclasses.replace(back, origins={}) == dataclasses.replace(gear, origins={})
    assert back.origins["cup.length"] == origin


def test_options_read_back() -> None:
    options = ModelOptions("published", False, "energy", "yang-sun", True, "both-halves")
    assert read(gear_to_toml(dataclasses.replace(GEAR, options=options))).options == options


def test_units_are_converted() -> None:
    text = changed(
        'neutral_radius = { value = 31.0, unit = "mm"',
        'neutral_radius = { value = 31000, unit = "um"',
    )
    assert read(text) == GEAR


@pytest.mark.parametrize(
    ("before", "after", "path", "says"),
    [
        ("value = 0.3175", "value = 0.26", "geometry.radial_deformation", "> 0.000264583 m"),
        ("value = 63.5,", "value = nan,", "geometry.flexspline_diameter", "value nan"),
        ("value = 63.5,", 'value = "wide",', "geometry.flexspline_diameter", '"wide"'),
        ("value = 63.5,", "value = true,", "geometry.flexspline_diameter", "true"),
        ("value = 63.5,", "value = 1e400,", "geometry.flexspline_diameter", "not a finite number"),
        ("value = 240,", f"value = 1{'0' * 400},", "teeth.flexspline", "not a finite number"),
        ("value = 240,", "value = 240.5,", "teeth.flexspline", "whole number"),
        ("value = 23,", "value = 22.5,", "bearing.balls", "whole number"),
        ("value = 4.7625,", "value = -1,", "bearing.ball_diameter", "> 0"),
        (
            'value = 63.5, unit = "mm"',
            'value = 63.5, unit = "N"',
            "geometry.flexspline_diameter.unit",
            '"N"',
        ),
        (
            'value = 63.5, unit = "mm", ',
            "value = 63.5, ",
            "geometry.flexspline_diameter.unit",
            "has no unit",
        ),
        ("{ value = 63.5, ", "{ ", "geometry.flexspline_diameter.value", "has no value"),
        ("[inertia]", "[inertias]", "inertias", 'Did you mean "inertia"'),
        ("balls = {", "bals = {", "bearing.bals", 'Did you mean "balls"'),
        ("slices = {", "# slices = {", "tooth.slices", "is missing"),
        ('bending = "published"', 'bending = "other"', "options.bending", '"energy"'),
        (
            "low_speed_branch = true",
            "low_speed_branch = 1",
            "options.low_speed_branch",
            "true, false",
        ),
        ("value = 0.62,", "value = 0.2,", "tooth.root_width", "no thickness left"),
        ("value = 31.0,", "value = 3.1,", "geometry.neutral_radius", "does not fit"),
        ("order = 2.0", "order = 1.0", "kinematic_error.orders[1].order", "given twice"),
        ("order = 2.0", "order = -2.0", "kinematic_error.orders[1].order", "> 0"),
        ("cosine = 0.3,", "cosine = 300.0,", "kinematic_error.orders[1].cosine", "1 degree"),
        ('format = "harmonic-drive-1"', 'format = "servo-motor-1"', "format", "harmonic-drive-1"),
        ('name = "CSF-25-120-2UH"', 'name = ""', "name", "part number"),
        ("[cup]", "[cup", "gear.toml", "not valid TOML"),
    ],
)
def test_a_wrong_value_is_refused_with_path_value_and_limit(
    before: str, after: str, path: str, says: str
) -> None:
    with pytest.raises(ParameterError) as caught:
        read(changed(before, after))
    message = str(caught.value)
    assert message.startswith(f"gear.toml: {path}" if path != "gear.toml" else path)
    assert says in message
    assert len(message) < 700


def test_a_quantity_must_carry_its_unit() -> None:
    mapping = gear_to_mapping(GEAR)
    mapping["cup"]["length"] = 20.0
    with pytest.raises(ParameterError, match=r"x: cup.length: is not a quantity"):
        gear_from_mapping(mapping, "x")


def test_unreadable_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="cannot be read"):
        load_gear(tmp_path / "missing.toml")
    with pytest.raises(ParameterError, match="cannot be read"):
        load_gear(tmp_path)
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"\x89HDF\r\n\x1a\n\xff\xfe")
    with pytest.raises(ParameterError, match="UTF-8"):
        load_gear(binary)
    long = tmp_path / "long.toml"
    long.write_bytes(b"#" * (quantities.LARGEST_FILE + 1))
    with pytest.raises(ParameterError, match="too long"):
        load_gear(long)
    deep = tmp_path / "deep.toml"
    deep.write_text("a = " + "[" * 20000)
    with pytest.raises(ParameterError, match="not valid TOML"):
        load_gear(deep)
    with pytest.raises(ParameterError, match="cannot be written"):
        save_gear(GEAR, tmp_path / "no" / "gear.toml")
    with pytest.raises(ParameterError, match="csf-25-120"):
        shipped_gear("csf-26")


@settings(max_examples=150)
@given(st.binary(max_size=200))
def test_any_bytes_give_a_gear_or_a_refusal(raw: bytes) -> None:
    with pytest.raises(ModelError):
        gear_from_mapping(quantities.parse_toml(raw, "x"), "x")


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3)
    ),
    max_leaves=8,
)


@settings(max_examples=150)
@given(
    section=st.sampled_from(
        ["teeth", "bearing", "cup", "options", "kinematic_error", "ratings", "name", "format"]
    ),
    found=JSON,
    inside=st.booleans(),
)
def test_any_content_gives_a_gear_or_a_refusal(section: str, found: object, inside: bool) -> None:
    mapping = tomllib.loads(TEXT)
    if inside and isinstance(mapping[section], dict):
        key = next(iter(mapping[section]))
        mapping[section][key] = found
    else:
        mapping[section] = found
    try:
        outcome: object = gear_from_mapping(mapping, "x")
    except ParameterError as error:
        outcome = str(error)
    assert isinstance(outcome, HarmonicDrive) or (
        isinstance(outcome, str) and outcome.startswith("x: ")
    )


def test_a_count_that_was_computed_stays_a_whole_number() -> None:
    gear = shipped_gear().with_values({"tooth.slices": 40.0})
    assert type(gear.tooth.slices) is int
    assert contradictions(gear) == contradictions(shipped_gear().with_values({"tooth.slices": 40}))
    with pytest.raises(ParameterError, match="whole number"):
        gear.with_values({"tooth.slices": 40.5})
