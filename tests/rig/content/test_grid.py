"""Tables in words: columns of numbers share unit and decimals, words have a tone, headings begin as they must."""

from __future__ import annotations

import pytest

from experiments.result import Table
from rig.content.data import data_column, data_grid
from rig.content.grid import Column, Fact, Grid, capital, columns, tone_of


def test_numbers_of_one_size_share_their_decimals() -> None:
    assert data_column("friction [N m]", [0.0524, 0.1365, 0.06067]) == (
        Column("friction [mN m]", "number"),
        ["52.40", "136.50", "60.67"],
    )
    assert data_column("time [s]", [5.0, 80.25, 97.5])[1] == ["5.000", "80.250", "97.500"]
    assert data_column("revolutions", [1.0, 50.0])[1] == ["1", "50"]
    assert data_column("speed [r/min]", [1.318, 2976.0])[1] == ["1.318", "2\u202f976"]
    assert data_column("torque [N m]", [2.5, 0.5])[0].heading == "torque [N m]"


def test_words_whole_numbers_and_gaps_stay_as_they_are() -> None:
    assert data_column("segment", ["hold", 3]) == (Column("segment"), ["hold", "3"])
    assert data_column("sweep", [0, 12]) == (Column("sweep", "number"), ["0", "12"])
    assert data_column("housing [degC]", [float("nan"), 22.0, 23.25]) == (
        Column("housing [°C]", "number"),
        ["–", "22.00", "23.25"],
    )
    assert data_column("nothing", []) == (Column("nothing"), [])
    assert data_column("zero [N m]", [0.0, 0.0])[1] == ["0", "0"]


def test_a_table_of_an_analysis_keeps_its_rows_and_its_remark() -> None:
    table = Table("t", "title", ("step", "time [s]"), (("up", 1.5), ("down", 2.5)), "note")
    heads = columns("step", ("time [s]", "number"))
    assert data_grid(table) == Grid("title", heads, (("up", "1.500"), ("down", "2.500")), "note")


def test_columns_are_left_out_by_name_and_where_they_say_nothing() -> None:
    grid = Grid("t", columns(("a", "number"), "b", "c"), (("1", "", "x"), ("2", "", "")), "note")
    short = Grid("t", columns(("a", "number"), "c"), (("1", "x"), ("2", "")), "note")
    assert grid.without_empty() == short
    assert grid.without("b", "absent") == short
    assert short.texts("c") == ["x", ""]
    empty = Grid("t", columns("a"), (("",),))
    assert empty.without_empty() == empty


@pytest.mark.parametrize(
    ("text", "tone"),
    [
        ("FAIL", "bad"),
        ("FAIL (≤ 90 mN m, page 12)", "bad"),
        ("no, 1.3 U", "bad"),
        ("learning", "muted"),
        ("NOT JUDGED", "muted"),
        ("nowhere", None),
        ("no motor tare", None),
        ("catalogue 100 mN m (page 12)", None),
        ("", None),
    ],
)
def test_a_word_of_a_verdict_has_a_tone_and_other_text_has_none(
    text: str, tone: str | None
) -> None:
    assert tone_of(text) == tone


def test_a_heading_begins_with_a_capital_and_a_symbol_stays_what_it_is() -> None:
    headings = {
        "quantity": "Quantity",
        "value ± U (95 %)": "Value ± U (95 %)",
        "k of U": "k of U",
        "ν": "ν",
        "s [mN m]": "s [mN m]",
        "r/min": "r/min",
        "SHA-256": "SHA-256",
        "|Δ| / U": "|Δ| / U",
        "": "",
    }
    assert {heading: capital(heading) for heading in headings} == headings


def test_a_fact_is_read_with_its_unit_and_nothing_with_none() -> None:
    assert Fact("speed", "3000", "r/min").text == "3000 r/min"
    assert Fact("grease", "SK-1A").text == "SK-1A"
    assert Fact("humidity", "", "%").text == ""
