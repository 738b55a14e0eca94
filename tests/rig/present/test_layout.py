"""Tables on paper: no wider than their page, never too small to read; columns of numbers that share
unit and decimals.
"""

from __future__ import annotations

import pytest

from rig.analysis.wording import order_label, printed_symbol, unbroken
from rig.present.columns import column
from rig.present.content import Grid, without_empty
from rig.present.layout import INSET, LANDSCAPE, PORTRAIT, SIZES, laid_out, layout_of, width_of


@pytest.mark.parametrize("columns", [1, 2, 5, 9, 14, 20, 40])
@pytest.mark.parametrize(
    "cell", ["1.5", "a longer text that may be broken into lines", "x" * 200, ""]
)
@pytest.mark.parametrize("numeric", [False, True])
def test_a_table_is_no_wider_than_its_page_and_can_be_read(
    columns: int, cell: str, numeric: bool
) -> None:
    heads = tuple(f"heading of column {k}" for k in range(columns))
    shown: list[str] = []
    for part, layout in laid_out(Grid("t", heads, ((cell,) * columns,), (numeric,) * columns)):
        room = LANDSCAPE if layout.landscape else PORTRAIT
        assert sum(width * layout.size + INSET for width in layout.widths) <= room + 1.0
        assert layout.size >= SIZES[-1] == 6.5
        assert len(layout.widths) == len(part.columns)
        assert part.columns[0] == heads[0]
        shown += part.columns
    assert set(shown) == set(heads)


def test_a_column_is_as_wide_as_its_longest_word() -> None:
    cell = "kinematic error-of-one-output-revolution, and more of it, and still more, and so on to the end of the line"
    grid = Grid("t", ("Quantity", "Value"), ((cell, "1.25 ± 0.13 mN m"),), (False, True))
    layout = layout_of(
        Grid(grid.title, grid.columns * 3, tuple(row * 3 for row in grid.rows), grid.numeric * 3)
    )
    assert layout is not None
    assert layout.widths[0] >= width_of("error-of-one-output-revolution,")
    assert layout.widths[1] >= width_of("1.25 ± 0.13 mN m")


def test_a_short_table_is_kept_together_and_a_long_one_is_not() -> None:
    layouts = [
        layout_of(Grid("t", ("a", "b"), (("1", "2"),) * rows, (True, True))) for rows in (5, 60)
    ]
    assert [layout.fits_one_page for layout in layouts if layout] == [True, False]


def test_hashes_stand_in_one_line() -> None:
    layout = layout_of(
        Grid(
            "t",
            ("Run", "SHA-256 of the run file"),
            (("00001-friction-" + "x" * 60, "ab" * 32),),
            (False,) * 2,
            hashes=("SHA-256 of the run file",),
        )
    )
    assert layout is not None
    assert layout.widths[1] >= 0.85 * 0.602 * 64


def test_numbers_of_one_size_share_their_decimals() -> None:
    assert column("friction [N m]", [0.0524, 0.1365, 0.06067]) == (
        "friction [mN m]",
        ["52.40", "136.50", "60.67"],
        True,
    )
    assert column("time [s]", [5.0, 80.25, 97.5]) == (
        "time [s]",
        ["5.000", "80.250", "97.500"],
        True,
    )
    assert column("revolutions", [1.0, 50.0]) == ("revolutions", ["1", "50"], True)
    assert column("speed [r/min]", [1.318, 2976.0])[1] == ["1.318", "2\u202f976"]
    assert column("torque [N m]", [2.5, 0.5])[0] == "torque [N m]"


def test_words_whole_numbers_and_gaps_stay_as_they_are() -> None:
    assert column("segment", ["hold", 3]) == ("segment", ["hold", "3"], False)
    assert column("sweep", [0, 12]) == ("sweep", ["0", "12"], True)
    assert column("housing [degC]", [float("nan"), 22.0, 23.25])[:2] == (
        "housing [°C]",
        ["–", "22.00", "23.25"],
    )
    assert column("nothing", []) == ("nothing", [], False)
    assert column("zero [N m]", [0.0, 0.0])[1] == ["0", "0"]


def test_columns_that_say_nothing_are_left_out() -> None:
    grid = without_empty(
        Grid("t", ("a", "b", "c"), (("1", "", "x"), ("2", "", "")), (True, False, False), "note")
    )
    assert grid == Grid("t", ("a", "c"), (("1", "x"), ("2", "")), (True, False), "note")


def test_symbols_orders_and_units_are_printed_as_they_are_named() -> None:
    symbols = {
        "alpha_t": "α_t",
        "omega": "ω",
        "K_HDf": "K_HDf",
        "ring_factor": "ring_factor",
        "": "",
    }
    assert {symbol: printed_symbol(symbol) for symbol in symbols} == symbols
    orders = (2.0, 1 / 120, 2 + 1 / 120, 2 - 2 / 120, 4 + 4 / 120, 2.0123)
    assert [order_label(v, 120.0) for v in orders] == [
        "2",
        "1/N",
        "2+1/N",
        "2−2/N",
        "4+4/N",
        "2.0123",
    ]
    assert unbroken("motor tare [N m]") == "motor tare [N\u00a0m]"
    assert unbroken("± U (k = 2), speed [r/min]") == "± U (k\u00a0=\u00a02), speed [r/\u2060min]"
