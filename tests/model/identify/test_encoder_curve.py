"""An encoder's curve out of gears at stated angles: recovered, covered by U, refused or told as a mean."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import pytest

from model.angle_certificate import CERTIFIED_ORDERS
from model.identify.encoder_curve import (
    LearntCurve,
    Mounted,
    is_parted,
    learnt_curve,
    left_out,
)
from model.units import ARCSEC, DEGREE, REVOLUTION

ORDERS = np.array(CERTIFIED_ORDERS)
EIGHT = tuple(n * REVOLUTION / 8 for n in range(8))
THREE = (0.0, 30.0 * DEGREE, 150.0 * DEGREE)


class World:
    """An encoder, what all gears share, and gears and mountings that differ, in arcsec."""

    def __init__(self, seed: int, shared: float = 0.0, gears: float = 1.0, seat: float = 0.2):
        self._random = np.random.default_rng(seed)
        self.encoder = 3.0 * self._drawn()
        self.shared = shared * np.exp(1j * self._random.uniform(0.0, REVOLUTION, len(ORDERS)))
        self._gears, self._seat = gears, seat

    def _drawn(self) -> np.ndarray:
        return self._random.normal(size=(len(ORDERS), 2)) @ np.array([1.0, 1.0j])

    def mounted(self, angles: Sequence[Sequence[float]]) -> Iterator[Mounted]:
        """Every gear at each of its angles."""
        for gear, several in enumerate(angles):
            own = self.shared + self._gears * self._drawn()
            for angle in several:
                waves = (
                    self.encoder + own * np.exp(1j * ORDERS * angle) + self._seat * self._drawn()
                )
                yield Mounted(gear=f"G{gear}", angle=angle, waves=ARCSEC * waves)


def curve_of(mounted: Sequence[Mounted]) -> LearntCurve:
    found = learnt_curve(mounted)
    assert not isinstance(found, str), found
    return found


def covered(angles: Sequence[Sequence[float]], **world: float) -> float:
    """How often the orders that are parted lie inside U."""
    inside: list[bool] = []
    for seed in range(25):
        made = World(seed, **world)
        for one in curve_of(list(made.mounted(angles))).orders:
            if one.way == "parted":
                apart = abs(one.wave - ARCSEC * made.encoder[one.order - 1])
                inside.append(apart <= one.radius)
    return sum(inside) / len(inside)


@pytest.mark.parametrize("shared", [0.0, 3.0])
def test_several_gears_part_the_encoder_from_what_they_share(shared: float) -> None:
    assert 0.91 <= covered([[angle] for angle in EIGHT], shared=shared) <= 0.98


def test_one_gear_at_three_angles_parts_the_encoder_from_itself() -> None:
    assert 0.91 <= covered([THREE], seat=0.05) <= 0.98
    made = World(1, seat=0.0)
    for one in curve_of(list(made.mounted([THREE]))).orders:
        assert one.wave == pytest.approx(ARCSEC * made.encoder[one.order - 1], abs=1e-3 * ARCSEC)


def test_the_seat_of_few_mountings_is_assumed_where_their_scatter_is_smaller() -> None:
    mounted = list(World(2, seat=0.05).mounted([THREE]))
    own, assumed = curve_of(mounted), learnt_curve(mounted, seat=1.0 * ARCSEC)
    assert not isinstance(assumed, str)
    first = assumed.orders[0]
    # Of three values at 0, 30 and 150 degrees the encoder has 1/3 (1 - |(1 + i)/3|^2)^-1 of the variance.
    assert first.standard_uncertainty == pytest.approx(ARCSEC * math.sqrt(1 / 3 / (1 - 2 / 9)))
    assert first.radius == pytest.approx(2.448 * first.standard_uncertainty, rel=1e-3)
    assert assumed.orders[1:] == own.orders[1:]
    scattered = list(World(2, seat=50.0).mounted([THREE]))
    assert learnt_curve(scattered, seat=1.0 * ARCSEC) == curve_of(scattered)
    six = list(World(2, seat=0.05).mounted([(*THREE, 1.0, 2.0, 3.0)]))
    assert learnt_curve(six, seat=1.0 * ARCSEC) == curve_of(six)


def test_both_together_are_better_than_either() -> None:
    angles = [[angle + turn for turn in THREE] for angle in EIGHT]
    assert 0.90 <= covered(angles, shared=1.0) <= 0.99
    errors: dict[str, list[float]] = {"several": [], "both": []}
    for seed in range(4):
        for name, plan in (("several", [[a] for a in EIGHT]), ("both", angles)):
            made = World(seed, shared=1.0)
            orders = curve_of(list(made.mounted(plan))).orders[:7]
            errors[name] += [abs(o.wave / ARCSEC - made.encoder[o.order - 1]) for o in orders]
    assert np.mean(np.square(errors["both"])) < 0.5 * np.mean(np.square(errors["several"]))


def test_an_order_that_no_run_shows_is_known_no_better_than_it_could_be_seen() -> None:
    plan = [list(THREE), *([angle] for angle in EIGHT)]
    hidden = [
        replace(
            one,
            waves=np.where(np.arange(1, 9) == 5, 0.0, one.waves),
            unseen=tuple(0.06 * ARCSEC if k == 5 else 0.0 for k in range(1, 9)),
        )
        for one in World(4).mounted(plan)
    ]
    fifth = curve_of(hidden).orders[4]
    assert fifth.wave == 0.0
    assert fifth.standard_uncertainty == pytest.approx(0.03 * ARCSEC)


def test_an_order_that_the_angles_turn_into_itself_is_told_as_a_mean_with_what_gears_share() -> (
    None
):
    for angles, singular in (
        (EIGHT, [8]),
        ((0.0, math.pi), [2, 4, 6, 8]),
        ((0.0, REVOLUTION / 3, 2 * REVOLUTION / 3), [3, 6]),
        (THREE, []),
    ):
        mounted = [Mounted(gear="A", angle=a, waves=np.zeros(8, dtype=complex)) for a in angles]
        assert [k for k in CERTIFIED_ORDERS if not is_parted(k, mounted)] == singular
    inside = []
    for seed in range(40):
        made = World(seed, shared=3.0, gears=0.1)
        eighth = curve_of(list(made.mounted([[a] for a in EIGHT]))).orders[7]
        assert eighth.way == "mean"
        inside.append(abs(eighth.wave / ARCSEC - made.encoder[7]) <= eighth.radius / ARCSEC)
    assert sum(inside) == 40


def test_without_stated_angles_it_is_no_certificate() -> None:
    mounted = [replace(one, angle=None) for one in World(3).mounted([[a] for a in EIGHT])]
    found = curve_of(mounted)
    assert not found.is_parted
    assert found.basis == "encoder and what the gears share"
    stated = curve_of(list(World(3).mounted([[a] for a in EIGHT])))
    assert (stated.is_parted, stated.basis) == (True, "population mean")
    assert stated.expanded_uncertainty < found.expanded_uncertainty
    assert curve_of(list(World(3).mounted([THREE]))).basis == "circle closure"


@pytest.mark.parametrize(
    ("angles", "why"),
    [
        ([[0.0, 1.0]], "one gear at 2 stated angles"),
        ([[0.0, math.pi, 0.0]], "singular"),
        ([[0.0], [1.0]], "2 gears; at least 5"),
    ],
)
def test_too_little_is_refused_in_words(angles: list[list[float]], why: str) -> None:
    found = learnt_curve(list(World(4).mounted(angles)))
    assert isinstance(found, str)
    assert why in found


def test_a_gear_that_taught_gets_what_the_others_teach() -> None:
    mounted = list(World(5).mounted([[a] for a in EIGHT]))
    others = left_out(mounted, "G0")
    assert not isinstance(others, str)
    assert "G0" not in others.gears
    moved = [replace(mounted[0], waves=mounted[0].waves + 50.0 * ARCSEC), *mounted[1:]]
    same = left_out(moved, "G0")
    assert not isinstance(same, str)
    assert [one.wave for one in same.orders] == [one.wave for one in others.orders]
    assert isinstance(left_out(list(World(5).mounted([THREE])), "G0"), str)


def test_what_did_not_stand_out_of_the_noise_stays_in_u() -> None:
    mounted = list(World(6).mounted([[a] for a in EIGHT]))
    unseen = (0.0,) * 5 + (0.4 * ARCSEC,) + (0.0,) * 2
    hidden = [replace(one, unseen=unseen) for one in mounted]
    before, after = curve_of(mounted).orders[5], curve_of(hidden).orders[5]
    assert after.standard_uncertainty == pytest.approx(
        math.hypot(before.standard_uncertainty, 0.2 * ARCSEC)
    )


def test_the_certificate_has_the_orders_and_their_doubt() -> None:
    found = curve_of(list(World(7).mounted([[a] for a in EIGHT])))
    certificate = found.certificate()
    assert certificate.waves[:, 0] + 1j * certificate.waves[:, 1] == pytest.approx(
        np.array([one.wave for one in found.orders]), abs=1e-12
    )
    assert 2.0 * certificate.standard_uncertainty == pytest.approx(found.expanded_uncertainty)
