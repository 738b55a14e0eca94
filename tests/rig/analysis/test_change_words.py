"""What the facts of a run are called, and in which unit they are read: one answer for terminal and window."""

from __future__ import annotations

from pathlib import Path

import pytest

from model.units import RPM
from rig.analysis.change_words import acquisition_unit, read_in, words_of
from rig.analysis.difference import difference
from tests.rig.library.stored import write


@pytest.mark.parametrize(
    ("group", "name", "expected"),
    [
        ("parameters", "speed_rpm", ("speed", "r/min")),
        ("parameters", "lowest_rpm", ("lowest", "r/min")),
        ("parameters", "acceleration", ("acceleration", "rad/s²")),
        ("conditions", "load_inertia_kg_m2", ("load inertia", "kg m²")),
        ("conditions", "output_radial_runout_um", ("output radial run-out", "µm")),
        ("acquisition", "index_marks.input_angle.marks", ("index marks, input angle, marks", "")),
    ],
)
def test_a_fact_has_its_title_and_its_unit(
    group: str, name: str, expected: tuple[str, str]
) -> None:
    assert words_of(group, name, "kinematic-error", "friction") == expected


@pytest.mark.parametrize(
    ("unit", "value", "expected"),
    [
        ("rad/s", 100.0 * RPM, (100.0, "r/min")),
        ("N m", 2.7e-3, (2.7, "mN m")),
        ("s", 2.1e-5, (21.0, "µs")),
        ("s", 12.5, (12.5, "s")),
        ("degC", 21.5, (21.5, "°C")),
    ],
)
def test_a_number_is_read_in_the_unit_of_a_laboratory(
    unit: str, value: float, expected: tuple[float, str]
) -> None:
    number, shown = read_in(unit, value)
    assert number == pytest.approx(expected[0])
    assert shown == expected[1]


def test_figures_of_the_acquisition_know_their_units() -> None:
    assert acquisition_unit("thermal_state.end.motor") == "degC"
    assert acquisition_unit("cycles") == ""


def test_both_protocols_give_units_to_their_own_parameters(tmp_path: Path) -> None:
    slow = write(tmp_path, 1, "kinematic-error", parameters={"speed_rpm": 30.3})
    swept = write(tmp_path, 2, "friction", parameters={"lowest_rpm": 1.0})
    told = {change.name: change for change in difference(slow, swept).of("parameters")}
    assert told["speed_rpm"].in_words(told["speed_rpm"].first) == "30.3 r/min"
    assert told["lowest_rpm"].in_words(told["lowest_rpm"].second) == "1 r/min"
    assert told["lowest_rpm"].in_words(told["lowest_rpm"].first) == "–"
