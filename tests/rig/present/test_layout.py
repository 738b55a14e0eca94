"""Tables on paper: no wider than their page, never too small to read; columns of numbers that share
unit and decimals.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from functools import cache, partial
from typing import Any

import typst

from rig.content.grid import Grid, Kind, capital, columns
from rig.content.page import Page, Section
from rig.content.wording import order_label, printed_symbol, unbroken
from rig.present.paper import document_of
from rig.present.report import report_page
from tests.rig import handmade

INSET, PORTRAIT, LANDSCAPE = 7.0, 174.0 / 25.4 * 72.0, 261.0 / 25.4 * 72.0
"""Space beside the text of a column, and the width of the text on A4 upright and crosswise [pt]."""
KINDS: tuple[Kind, ...] = ("text", "number")
LONG_WORD = "error-of-one-revolution,"


@cache
def plain_page() -> Page:
    """A report without figures and without an annex of its own."""
    result = replace(handmade.friction_result(), plots=())
    fits = [handmade.fit(result=result)]
    created, verdict = "2026-11-21 08:00:00+00:00", handmade.verdict(fits)
    return replace(report_page(fits, created=created, verdict=verdict), annexes=())


def layouts(grids: Sequence[Grid]) -> list[dict[str, Any]]:
    """How typst laid out the tables of an annex: columns, size [pt], widths [em], crosswise or not, in one piece."""
    annex = Section(title="Annex", anchor="annex", grids=tuple(grids))
    document = document_of(replace(plain_page(), annexes=(annex,)))
    found = document.set_by_typst(partial(typst.query, selector="<table-layout>", field="value"))
    return [one for one in json.loads(found) if one["title"].startswith("T:")]


def test_a_table_is_no_wider_than_its_page_and_can_be_read() -> None:
    cells = ("1.5", "a longer text that may be broken into lines", "x" * 200, "")
    wanted = {
        f"T:{count}/{place}/{kind}": Grid(
            f"T:{count}/{place}/{kind}",
            columns(*((f"heading of column {k}", kind) for k in range(count))),
            ((cell,) * count,),
        )
        for count in (1, 2, 5, 14, 40)
        for place, cell in enumerate(cells)
        for kind in KINDS
    }
    shown: dict[str, list[str]] = {title: [] for title in wanted}
    for one in layouts(tuple(wanted.values())):
        room = LANDSCAPE if one["landscape"] else PORTRAIT
        assert sum(width * one["size"] + INSET for width in one["widths"]) <= room + 1.0
        assert one["size"] >= 6.5
        assert len(one["widths"]) == len(one["columns"])
        title = one["title"].split(",")[0]
        assert one["columns"][0] == capital(wanted[title].headings[0])
        shown[title] += one["columns"]
    assert {title: set(heads) for title, heads in shown.items()} == {
        title: set(map(capital, grid.headings)) for title, grid in wanted.items()
    }


def test_a_column_is_as_wide_as_its_longest_word_and_its_numbers() -> None:
    number, words = "1.25 ± 0.13 mN m", "and more of it, and still more, " * 9
    alone = Grid(
        "T:alone", columns(("word", "number"), ("value", "number")), ((LONG_WORD, number),)
    )
    crowded = Grid(
        "T:crowded",
        columns("word", ("value", "number"), *("text",) * 4),
        ((f"{LONG_WORD} and what is said of it here and everywhere", number, *(words,) * 4),),
    )
    whole, broken = sorted(layouts((alone, crowded)), key=lambda one: one["title"])
    assert broken["widths"][0] >= whole["widths"][0]
    assert broken["widths"][1] >= whole["widths"][1]
    # By the letters themselves: sixteen of them are no narrower than six em, and no wider than ten.
    assert 6.0 < whole["widths"][1] < 10.0


def test_a_short_table_is_kept_together_and_a_long_one_is_not() -> None:
    grids = [Grid(f"T:{rows}", columns("a", "b"), (("1", "2"),) * rows) for rows in (5, 60)]
    found = {one["title"]: one["kept"] for one in layouts(grids)}
    assert found == {"T:5": True, "T:60": False}


def test_hashes_stand_in_one_line() -> None:
    rows = (("00001-friction-" + "x" * 60, "ab" * 32),)
    heads = columns("run", ("SHA-256 of the run file", "hash"))
    (found,) = layouts([Grid("T:files", heads, rows)])
    assert found["widths"][1] >= 0.85 * 0.602 * 64


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
    assert unbroken("± U (95 %), speed [r/min]") == "± U (95\u00a0%), speed [r/\u2060min]"
