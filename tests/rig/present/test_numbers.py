"""The tables of a gear's numbers: only of a gear that somebody named, and that was on the bench."""

from types import SimpleNamespace
from typing import Any

import pytest

from model.gear_file import shipped_gear
from rig.present.numbers import number_grids


def fit_of(*, known: bool, mounted: bool) -> Any:
    """A fit without a number, of the shipped gear."""
    metadata = SimpleNamespace(gear=shipped_gear(), gear_mounted=mounted)
    return SimpleNamespace(
        gear=shipped_gear(),
        gear_known=known,
        recording=SimpleNamespace(metadata=metadata),
        result=SimpleNamespace(estimates={}, experiment="friction", kind="friction"),
    )


@pytest.mark.parametrize(("known", "mounted"), [(False, True), (True, False), (False, False)])
def test_a_gear_that_nobody_named_or_that_was_taken_off_has_no_numbers(
    known: bool, mounted: bool
) -> None:
    assert number_grids([fit_of(known=known, mounted=mounted)]) == ()


def test_a_gear_that_was_named_and_mounted_has_three_tables() -> None:
    away = fit_of(known=False, mounted=True)
    assert len(number_grids([away, fit_of(known=True, mounted=True)])) == 3
