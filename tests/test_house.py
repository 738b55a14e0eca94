"""The house does not grow over what it is: what is added takes something away."""

from __future__ import annotations

import pytest

from tests.house import MOST_CONDITIONALS, MOST_NODES, House, count, places_of


@pytest.fixture(scope="module")
def house() -> House:
    return count()


def test_there_are_no_more_nodes(house: House) -> None:
    assert house.total <= MOST_NODES


def test_conditional_expressions_stay_few(house: House) -> None:
    assert house.conditionals_per_function <= MOST_CONDITIONALS


@pytest.mark.parametrize("title", places_of(House()))
def test_no_more_places_are_wrong(house: House, title: str) -> None:
    places, most = places_of(house)[title]
    assert len(places) <= most, places
