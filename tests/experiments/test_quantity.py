"""What each protocol promises: how small U must be for a number of its to be of use, and why."""

from __future__ import annotations

import math

import pytest

from experiments import catalogue
from experiments.quantity import Quantity

PROTOCOLS = tuple(entry.name for entry in catalogue.ENTRIES if entry.has_plan)


@pytest.mark.parametrize("name", PROTOCOLS)
def test_every_key_quantity_declares_a_target_with_its_reason(name: str) -> None:
    quantities = catalogue.load(name).quantities
    without = [q.name for q in quantities if q.is_key and not (q.target_text and q.target_reason)]
    assert without == []
    assert any(q.target_text for q in quantities)


def test_a_target_is_a_number_or_a_share_of_the_value() -> None:
    absolute = Quantity(
        name="a",
        title="a",
        unit="rad",
        shown="arcsec",
        target_uncertainty=math.radians(6.0 / 3600.0),
    )
    share = Quantity(name="b", title="b", unit="1/s2", target_share=0.1)
    none = Quantity(name="c", title="c", unit="1")
    assert absolute.target_for(-1.0, "rad") == absolute.target_uncertainty
    assert absolute.target_for(-1.0, "m") is None
    assert share.target_for(-4e5, "1/s2") == pytest.approx(4e4)
    assert none.target_for(1.0, "1") is None
    assert (absolute.target_text, share.target_text, none.target_text) == (
        "<= 6 arcsec",
        "<= 10 % of the value",
        "",
    )


def test_the_title_of_a_family_has_no_gap_where_its_word_was() -> None:
    quantity = Quantity(name="a_{way}", title="MSE {way}, left out", unit="1")
    assert quantity.family_title == "MSE, left out"


def test_a_target_of_another_unit_is_a_share_or_none() -> None:
    viscous = Quantity(
        name="viscous", title="", unit="N s/rad", target_uncertainty=0.05, target_elsewhere=0.3
    )
    assert viscous.target_for(0.2, "N s/rad") == 0.05
    assert viscous.target_for(2.0, "A s/rad") == pytest.approx(0.6)
    alone = Quantity(name="viscous", title="", unit="N s/rad", target_uncertainty=0.05)
    assert alone.target_for(2.0, "A s/rad") is None
