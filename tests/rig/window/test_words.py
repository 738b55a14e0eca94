"""Numbers and names of the window in the words and units of a laboratory: outcome, difference, library."""

from __future__ import annotations

import pytest

from experiments.result import Result
from rig.analysis.difference import Change, change_grid
from rig.analysis.result_data import result_from_mapping
from rig.window.review.table_model import gear_words
from rig.window.run.outcome_view import remarks, result_lines, verdict_line
from tests.rig.window.reviewing import indexed


def answer(**changes: object) -> Result:
    """A stored result of a friction run."""
    estimate = {
        "value": 0.0734795,
        "unit": "N m",
        "low": 0.0733,
        "high": 0.0736,
        "expanded_uncertainty": 0.0021,
        "budget": [{"source": "scale", "kind": "B", "standard_uncertainty": 0.00105}],
    }
    found = {
        "run": "00003-friction-A1",
        "kind": "friction",
        "parameters": {"running_torque_500_rpm": estimate, "coulomb": {**estimate, "unit": "N"}},
    }
    return result_from_mapping({**found, **changes})


def said(**changes: object) -> list[str]:
    """What is said beside the numbers of such a run."""
    return remarks(answer(**changes))


def test_the_end_of_a_run_names_results_in_words_and_whose_torque_it_is() -> None:
    first, second = result_lines(answer())
    assert first == "running torque 500 r/min 73.5 ± 2.1 mN m"
    assert second.startswith("Coulomb friction ")
    assert said() == []
    (whose,) = said(options={"torque_is_of": "motor + gear"})
    assert "no tare was subtracted. Review fits it" in whose
    (whose,) = said(kind="starting-torque", options={"torque_is_of": "motor + gear"})
    assert "Review" not in whose


def test_the_end_of_a_run_says_what_its_gear_is_worth_and_why() -> None:
    told = verdict_line("NOT JUDGED", ["no file", "no tare"])
    assert told == "Verdict: NOT JUDGED (no file; no tare)"
    assert verdict_line("PASS", []) == "Verdict: PASS"


@pytest.mark.parametrize(
    ("change", "row"),
    [
        (
            Change(
                group="parameters",
                name="highest_rpm",
                first="3000",
                second="1500",
                title="highest",
                unit="r/min",
            ),
            ("parameters", "highest", "3000 r/min", "1500 r/min", "", "", ""),
        ),
        (
            Change(group="parameters", name="repeats", first="", second="2"),
            ("parameters", "repeats", "–", "2", "", "", ""),
        ),
        (
            Change(
                group="conditions",
                name="output_radial_runout_um",
                first="12",
                second="9",
                title="output radial run-out",
                unit="µm",
            ),
            ("conditions", "output radial run-out", "12 µm", "9 µm", "", "", ""),
        ),
        (
            Change(
                group="results",
                name="friction: offset",
                first="38 ± 88 µN m",
                second="-",
                difference=2.47e-5,
                uncertainty=1.2e-4,
                unit="N m",
                significant=False,
                note="",
                title="offset",
                shown="0.02 ± 0.12 mN m",
            ),
            ("results", "offset", "38 ± 88 µN m", "-", "0.02 ± 0.12 mN m", "within U", ""),
        ),
    ],
)
def test_a_difference_is_told_in_the_units_of_a_laboratory(
    change: Change, row: tuple[str, ...]
) -> None:
    assert change_grid([change]).rows == [row]


def test_a_bare_motor_has_no_gear() -> None:
    assert gear_words(indexed(1, protocol="motor-tare", gear_serial="unknown")) == "no gear"
    assert gear_words(indexed(1, gear_serial="unknown")) == "unknown"
    assert gear_words(indexed(1, gear_serial="A1")) == "A1"
    assert gear_words(indexed(1, gear_serial="")) == "–"
