"""Parts of sentences: what has nothing to say is not there."""

from pathlib import Path

import pytest

from rig.content.phrase import counted, phrase, quoted, shortened, yes_or_no


@pytest.mark.parametrize("nothing", ["", None, 0, 0.0, ()])
def test_a_phrase_without_its_part_is_not_there(nothing: object) -> None:
    assert phrase(", gear {}", nothing) == ""
    assert phrase("{1}: {0}", nothing, "said all the same") == ""


def test_a_phrase_takes_its_parts_as_they_are_told() -> None:
    assert phrase(", gear {}", "SN-1") == ", gear SN-1"
    assert phrase("{1}: {0:.1f}", 2.25, "left") == "left: 2.2"
    assert phrase("[{}]", "{0}") == "[{0}]"


def test_a_word_with_a_blank_stands_in_quotes() -> None:
    assert [quoted("SN-7"), quoted("SN 7"), quoted(Path("my runs"))] == [
        "SN-7",
        "'SN 7'",
        "'my runs'",
    ]


def test_a_number_has_the_word_for_one_and_for_several() -> None:
    words = [counted(number, "run", "runs") for number in (0, 1, 2)]
    assert words == ["0 runs", "1 run", "2 runs"]


@pytest.mark.parametrize(("most", "seen"), [(9, "breakaway"), (8, "breakaw…"), (1, "…")])
def test_a_text_that_was_cut_shows_it(most: int, seen: str) -> None:
    assert shortened("breakaway", most) == seen
    assert len(seen) <= most


def test_a_column_says_yes_or_no() -> None:
    assert [yes_or_no(True), yes_or_no(False)] == ["yes", "no"]
