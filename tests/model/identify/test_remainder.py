"""The proof of a table: right ones pass as often as they should, wrong ones are refused, and harm is bracketed."""

from __future__ import annotations

import numpy as np
import pytest

from model.errors import IdentificationError
from model.identify.remainder import OrdersLeft, bracket, remainder_of
from model.units import ARCSEC

ORDERS = 20


def left(random: np.random.Generator, wrong: float = 0.0, motor: float = 1.0) -> OrdersLeft:
    """What a table leaves whose every order is uncertain by 0.3 arcsec, one of them the largest; `wrong` [arcsec] is in
    it besides.
    """
    known = np.zeros(ORDERS, dtype=np.complex128)
    known[:3] = np.array([2.0, 1.0, 0.5j]) * motor * ARCSEC
    table = np.full(ORDERS, (0.3 * ARCSEC) ** 2)
    table[1] *= 9.0
    counts = np.full(ORDERS, (0.1 * ARCSEC) ** 2)
    sizes = np.sqrt(0.5 * (table + counts))
    chance = sizes * (random.standard_normal(ORDERS) + 1j * random.standard_normal(ORDERS))
    there = known + chance
    there[4] += wrong * ARCSEC
    return OrdersLeft(
        remainder=there,
        variance=counts,
        freedom=40.0,
        motor=known,
        table=table,
        table_freedom=40.0,
        bench=np.zeros(ORDERS),
        rest=0.0,
    )


@pytest.mark.parametrize("motor", [0.0, 1.0, 5.0], ids=["no tracking", "some", "mostly tracking"])
def test_a_right_table_passes_nineteen_times_of_twenty(motor: float) -> None:
    random = np.random.default_rng(11)
    found = [remainder_of([left(random, motor=motor) for _ in range(2)]) for _ in range(2000)]
    passed = sum(one.verdict == "PASS" for one in found) / len(found)
    assert 0.93 <= passed <= 0.97
    assert sum(one.verdict == "FAIL" for one in found) < 0.005 * len(found)
    assert np.mean([one.ratio for one in found]) == pytest.approx(1.0, abs=0.03)
    scatter = float(np.std([one.ratio for one in found]))
    assert scatter == pytest.approx(float(np.mean([one.chance for one in found])), rel=0.15)


def test_a_wrong_one_is_refused_and_one_between_is_neither() -> None:
    random = np.random.default_rng(5)
    wrong = [remainder_of([left(random, wrong=5.0) for _ in range(2)]) for _ in range(200)]
    assert all(one.verdict == "FAIL" for one in wrong)
    assert all(one.low > 1.3 for one in wrong)
    between = [remainder_of([left(random, wrong=2.0) for _ in range(2)]) for _ in range(200)]
    assert sum(one.verdict == "MARGINAL" for one in between) > 100
    # What the motor itself did wrong is known, and excuses nothing else.
    assert remainder_of([left(random, wrong=5.0, motor=0.5)]).verdict == "FAIL"


def test_what_the_motor_did_not_follow_is_no_fault_of_the_table() -> None:
    random = np.random.default_rng(6)
    lazy = [remainder_of([left(random, motor=20.0)]) for _ in range(100)]
    assert min(one.seen for one in lazy) > 20.0 * ARCSEC
    assert sum(one.verdict == "PASS" for one in lazy) > 85


def test_without_a_traverse_there_is_no_remainder() -> None:
    with pytest.raises(IdentificationError, match="no traverse"):
        remainder_of([])


@pytest.mark.parametrize(
    ("beside", "expected"),
    [
        ([1.0, 2.0, 4.0, 8.0, 16.0], (240.0, 480.0)),
        ([1.0, 2.0, 4.0, 5.0, 6.0], (960.0, None)),
        ([11.0, 2.0, 2.0, 2.0, 2.0], (None, 60.0)),
        ([1.0, 12.0, 2.0, 2.0, 2.0], (60.0, 120.0)),
    ],
)
def test_harm_begins_at_the_first_speed_that_is_worse(
    beside: list[float], expected: tuple[float | None, float | None]
) -> None:
    speeds, without = [60.0, 120.0, 240.0, 480.0, 960.0], [10.0, 10.0, 10.0, 7.0, 10.0]
    assert bracket(speeds, without, beside) == expected
    order = [3, 1, 4, 0, 2]
    mixed = [[row[k] for k in order] for row in (speeds, without, beside)]
    assert bracket(mixed[0], mixed[1], mixed[2]) == expected
