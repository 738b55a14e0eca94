"""A tare beside its own line, the card of its motor and the bench's other tares; no recording is analysed here."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from experiments.protocols.motor_tare.declaration import QUANTITIES
from experiments.recording import ArraySource, Recording, RunMetadata
from experiments.result import Result
from experiments.tares import tare_witness as witness
from experiments.tares.tare import doubts_of, tare_of, tare_table, with_doubts
from experiments.tares.tare_chart import tare_chart
from experiments.tares.tare_witness import (
    ANOTHER,
    against_card,
    against_others,
    off_its_own_line,
    reduced_chi_square,
    remarks_of,
    repeatability,
)
from model.channel import Channel
from model.identify.estimate import Estimate
from model.identify.running_torque import Tare
from model.motor import shipped_motor
from model.units import RPM

SPEED = np.geomspace(5.0, 3000.0, 9) * RPM
CARD = {"coulomb": 0.012, "viscous": 4e-6 / RPM, "source": "certificate 17"}
STATED = {**CARD, "coulomb_u": 0.0006, "viscous_u": 2e-7 / RPM}


def tare(
    factor: float = 1.0, offset: float = 0.0, *, warm: float = 20.0, noise: float = 0.0
) -> Result:
    """The tare of a motor that has `factor` times the friction of its card, and `offset` [N m] more."""
    torque = factor * (0.012 + 4e-6 / RPM * SPEED) + offset
    torque = torque + noise * np.cos(7.0 * np.arange(len(SPEED)))
    line = {"motor_coulomb": factor * 0.012 + offset, "motor_viscous": factor * 4e-6 / RPM}
    points = Tare(SPEED, torque, np.full(len(SPEED), 2e-5))
    return Result(
        run="00001-motor-tare",
        kind="motor-tare",
        quantities=QUANTITIES,
        estimates={n: Estimate(name=n, value=v, unit="", low=v, high=v) for n, v in line.items()},
        metrics={"housing_temperature": warm},
        tables=(tare_table(points),),
    )


def run(**process: object) -> Recording:
    """The run of a tare, as far as its card and its torque channel go."""
    torque = Channel(name="torque", unit="N m", scale=1e-4)
    metadata = RunMetadata(
        run_id="00001", experiment="motor-tare", origin="hardware", process=process
    )
    source = ArraySource({"torque": np.zeros(4)}, np.arange(4, dtype=np.int64))
    return Recording(metadata, {"torque": torque}, (), (), source)


@pytest.mark.parametrize(
    ("factor", "offset"), [(1.4, 0.0), (1.0, 0.010), (0.5, 0.0)], ids=["x1.4", "+10", "x0.5"]
)
def test_a_card_with_an_uncertainty_sees_what_is_away_and_the_doubt_reaches_it(
    factor: float, offset: float
) -> None:
    found = against_card(tare(factor, offset), run(motor_friction=STATED))
    assert found is not None
    assert found.is_apart
    assert not found.is_beyond_factor
    doubt = found.doubt("card", "")
    # U of the line reaches from the one to the other.
    assert (2.0 * doubt.at(SPEED[[0, -1]]) >= np.abs(found.difference)).all()


@pytest.mark.parametrize("factor", [2.2, 0.4, 0.0, -1.0])
@pytest.mark.parametrize("card", [CARD, STATED], ids=["bare", "with U"])
def test_beyond_a_factor_of_two_it_is_no_tare_of_that_motor(
    factor: float, card: dict[str, object]
) -> None:
    found = against_card(tare(factor), run(motor_friction=card))
    assert found is not None
    assert found.is_beyond_factor


@pytest.mark.parametrize("factor", [0.55, 1.0, 1.8])
def test_a_card_that_states_no_uncertainty_holds_within_a_factor_of_two(factor: float) -> None:
    found = against_card(tare(factor), run(motor_friction=CARD))
    assert found is not None
    assert math.isnan(found.normalised)
    assert not found.is_apart
    assert not found.is_beyond_factor


def test_the_card_of_a_run_without_one_is_that_of_the_motor_it_names() -> None:
    shipped = shipped_motor()
    card = witness.motor_card(run(motor=shipped.name))
    assert card is not None
    assert card.coulomb == shipped.coulomb_friction
    assert witness.motor_card(run(motor="of my own")) is None
    assert against_card(tare(), run(motor="of my own")) is None


def test_other_tares_bear_witness_without_scale_and_as_warm_as_this_one() -> None:
    others = (tare(1.003), tare(0.998))
    same = against_others(tare(), others)
    assert same is not None
    assert not same.is_apart
    away = against_others(tare(1.05), others)
    assert away is not None
    assert away.is_apart, "5 % is more than scale and zero of one channel could make"
    colder = tare(1.0 / (1.0 - 0.004 * 10.0), warm=10.0)
    brought = against_others(tare(), (colder, colder))
    assert brought is not None
    assert float(np.abs(brought.difference).max()) < 1e-4
    assert against_others(tare(), ()) is None


def test_one_wrong_tare_among_three_others_does_not_move_their_middle() -> None:
    found = against_others(tare(), (tare(1.001), tare(0.999), tare(1.9)))
    assert found is not None
    assert float(np.abs(found.difference).max()) < 0.002 * 0.024


def test_how_well_a_tare_comes_out_again_is_assumed_until_three_tell() -> None:
    alone = repeatability(tare(), (tare(1.01),))
    assert alone is not None
    assert "assumed" in alone.note
    assert alone.uncertainty[0] == pytest.approx(0.05 * 0.012, rel=0.01)
    told = repeatability(tare(), (tare(1.01), tare(0.99)))
    assert told is not None
    assert told.note == "scatter of 3 tares"
    # Student's t of two degrees of freedom over 1.96, of a scatter of 1 %.
    assert told.uncertainty[0] == pytest.approx(4.303 / 1.960 * 0.01 * 0.012, rel=0.01)


def test_points_beside_their_line_and_a_table_that_is_not_its_own_are_seen() -> None:
    points = tare_of(tare(noise=1e-3))
    assert points is not None
    ratio, beside = reduced_chi_square(points)
    assert ratio > 100.0
    assert beside == pytest.approx(7e-4, rel=0.3)
    changed = dataclasses.replace(tare(1.4), estimates=tare().estimates)
    assert off_its_own_line(changed) == pytest.approx(0.4, rel=0.01)
    assert off_its_own_line(tare(1.4)) < 1e-9


def test_a_tare_says_itself_what_is_away_and_that_it_stands_alone() -> None:
    (alone,) = remarks_of(run(motor_friction=CARD), tare(), ())
    assert ANOTHER in alone
    card, others, still = remarks_of(run(motor_friction=STATED), tare(1.4), (tare(),))
    assert "the motor's card" in card
    assert "the bench's other tares" in others
    assert "one other tare only" in still
    assert remarks_of(run(motor_friction=CARD), tare(), (tare(1.003), tare(0.998))) == ()


def test_doubts_are_carried_by_the_tare() -> None:
    doubt = repeatability(tare(), ())
    assert doubt is not None
    (back,) = doubts_of(with_doubts(tare(), [doubt]))
    assert (back.source, back.note) == (doubt.source, doubt.note)
    assert back.at(SPEED) == pytest.approx(doubt.at(SPEED))
    assert doubts_of(tare()) == ()


def test_the_benchs_tares_are_a_chart_in_the_order_of_their_runs() -> None:
    this = dataclasses.replace(tare(1.1, warm=25.0), run="00007-motor-tare")
    first = dataclasses.replace(tare(1.0, warm=20.0), run="00002-motor-tare")
    chart = tare_chart(this, (first,))
    assert chart is not None
    slow, fast = chart.series
    assert slow.x.tolist() == [1.0, 2.0]
    # 4 permille per kelvin: the colder one as warm as this one.
    assert slow.y[0] == pytest.approx(12.02 * 0.98, rel=1e-6)
    assert slow.y[1] == pytest.approx(12.02 * 1.1, rel=1e-6)
    assert fast.y[1] > slow.y[1]
    assert slow.low is not None
    assert (slow.low < slow.y).all()
    assert chart.note.endswith("1 00002-motor-tare, 2 00007-motor-tare.")
    assert tare_chart(this, ()) is None
