"""What to run next: arithmetic of visits and calibrations by hand, and what is advised of runs in a folder."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from experiments import catalogue
from experiments.protocols.friction.influences import VIBRATION
from experiments.quantity import quantity_of
from experiments.result import Verdict
from experiments.tares.tare_witness import repeatability
from model.identify.estimate import BudgetLine, Cause, Estimate
from model.identify.friction_result import SCATTER
from rig.analysis.advised import advised
from rig.analysis.in_force import newest_analysed
from rig.analysis.judging import judge_newest
from rig.analysis.next_run import FALLING, Advice, Of, advice, wanted_by
from rig.analysis.passport.gather import runs_of
from rig.errors import ConfigurationError, RunFileError
from rig.gears.acceptance import Acceptance, Limit
from tests.experiments.test_tare_witness import tare
from tests.rig.library.stored import RUNNING, analyse, estimate, start, write

K = 1.959963984540054
VALUE = 0.08


def advised_by(wanted: float, *lines: BudgetLine, **parameters: int) -> Advice:
    """Advice for a running torque with this budget."""
    found = Estimate(
        name=RUNNING, value=VALUE, unit="N m", low=0.07, high=0.09, budget=tuple(lines)
    )
    quantity = quantity_of(catalogue.load("friction").quantities, RUNNING)
    assert quantity is not None
    return advice(found, quantity, Of("friction", "00001-friction-A1", parameters), wanted)


def scatter(u: float, source: str = "scatter between revolutions") -> BudgetLine:
    return BudgetLine(source, "A", u)


def scale(u: float) -> BudgetLine:
    return BudgetLine("torque scale", "B", u, "certificate", Cause.TORQUE_SCALE)


def test_scatter_falls_by_the_root_of_the_visits_and_nothing_else_does() -> None:
    found = advised_by(1.2e-3, scatter(1e-3), scale(0.3e-3), repeats=2)
    room = (1.2e-3 / K) ** 2 - 0.3e-3**2
    assert found.helps == "visits"
    assert found.times == math.ceil(1e-6 / room) == 4
    assert found.parameters == {"repeats": 8}
    assert found.becomes == pytest.approx(K * math.sqrt(1e-6 / 4 + 0.3e-3**2))
    assert found.becomes <= 1.2e-3
    assert (found.line, found.share) == (
        "scatter between revolutions",
        pytest.approx(1.0 / 1.09),
    )
    assert "4 times as many visits make U 1.1 mN m" in found.sentence


def test_what_lies_between_the_speeds_stays_and_vibration_near_resonances_falls() -> None:
    assert set(FALLING) == {SCATTER, VIBRATION}
    points, shaken = scatter(1e-3, SCATTER), BudgetLine(VIBRATION, "B", 0.6e-3)
    found = advised_by(1.6e-3, points, shaken, scale(0.3e-3), repeats=1)
    assert (found.helps, found.times) == ("visits", 3)
    stays = 0.14 * 1e-6 + 0.3e-3**2
    assert found.becomes == pytest.approx(K * math.sqrt(stays + (0.86e-6 + 0.36e-6) / 3))


def test_visits_that_are_not_enough_say_so() -> None:
    found = advised_by(0.5e-3, scatter(1e-3), scale(0.3e-3), repeats=1)
    assert found.parameters == {}, "no run is named that does not help"
    assert found.becomes is not None
    assert found.becomes > 0.5e-3
    assert found.sentence.endswith("which is not enough.")


def test_where_type_b_is_above_half_no_run_helps_and_the_calibration_has_its_size() -> None:
    found = advised_by(1.5e-3, scale(1e-3), scatter(0.4e-3))
    assert (found.helps, found.times, found.parameters) == ("calibration", None, {})
    needed = math.sqrt((1.5e-3 / K) ** 2 - 0.4e-3**2)
    assert found.needed == pytest.approx(needed)
    assert found.becomes == pytest.approx(1.5e-3)
    # Made again with that calibration, U is what was said.
    again = advised_by(1.0, scale(needed), scatter(0.4e-3))
    assert again.expanded_uncertainty == pytest.approx(1.5e-3)
    assert "no run helps; calibrate the torque channel" in found.sentence
    assert f"must fall to {100 * needed / 1e-3:.0f} % of what it is" in found.sentence


def test_a_calibration_that_is_not_enough_says_what_it_gives_at_best() -> None:
    found = advised_by(0.5e-3, scale(1e-3), scatter(0.4e-3))
    assert (found.helps, found.needed) == ("calibration", 0.0)
    assert found.becomes == pytest.approx(K * 0.4e-3)
    assert "at best, and is not enough" in found.sentence


def test_a_tare_that_was_not_repeated_is_repeated() -> None:
    """Two more of the bench tell its scatter: a longer one tells none."""
    doubt = repeatability(tare(), ())
    assert doubt is not None
    line = BudgetLine(doubt.source, "B", 1e-3, doubt.note, Cause.TARE)
    sentence = advised_by(1.5e-3, line, scatter(1e-4)).sentence
    assert "no run with the gear on helps; take two more motor tares of this bench" in sentence


@pytest.mark.parametrize(("u", "wanted"), [(0.08, 0.045), (0.2, 0.095)])
def test_what_decides_a_lower_limit_tells_the_number_from_zero_too(u: float, wanted: float) -> None:
    """0.1 ± 0.08 lies above 0.005 and may be zero all the same; of 0.1 ± 0.2 the distance is wanted."""
    line = BudgetLine("residual", "A", u / K)
    found = Estimate(name=RUNNING, value=0.1, unit="N m", low=0.0, high=0.2, budget=(line,))
    quantity = quantity_of(catalogue.load("friction").quantities, RUNNING)
    assert quantity is not None
    marginal = Verdict(
        quantity=quantity,
        estimate=found,
        limit=0.005,
        limit_source="a drawing",
        limit_standing="customer",
        outcome="MARGINAL",
        is_upper=False,
    )
    assert wanted_by(marginal) == pytest.approx(wanted)


def test_what_belongs_to_the_method_is_lowered_by_nothing() -> None:
    found = advised_by(1e-3, BudgetLine("choice of the law", "B", 1e-3), scatter(1e-4))
    assert (found.helps, found.becomes) == ("nothing", None)
    assert "no run helps, and no calibration" in found.sentence


def test_scatter_from_run_to_run_needs_other_days() -> None:
    found = advised_by(1.2e-3, BudgetLine("from run to run", "B", 1e-3), scatter(1e-4))
    assert (found.helps, found.times) == ("other days", 3)
    assert "3 runs on other days, and their mean, make U 1.1 mN m" in found.sentence


def test_what_nobody_stated_is_to_be_stated() -> None:
    line = BudgetLine(
        "torque scale", "B", 1e-3, "assumed: within 5 %. Give it: rig.toml", assumed="torque scale"
    )
    found = advised_by(1.5e-3, line, scatter(1e-4))
    assert "state what is assumed (rig.toml)" in found.sentence


def test_what_is_small_enough_needs_nothing() -> None:
    found = advised_by(3e-3, scale(1e-3))
    assert found.helps == "nothing needed"
    assert found.sentence.endswith("Nothing is needed.")


def accepting(upper: float) -> Acceptance:
    limit = Limit(
        quantity=f"friction.{RUNNING}",
        unit="N m",
        source="page 1",
        standing="customer",
        upper=upper,
        confirmed_by="A. Example",
        confirmed_on="2026-01-01",
    )
    return Acceptance(name="x", source="y", use="any", limits=(limit,), path="x.toml")


def test_a_marginal_limit_is_decided_by_the_distance_to_it(tmp_path: Path) -> None:
    run = write(tmp_path, 1, start_time=start(1), parameters={"repeats": 1})
    analyse(run, estimate(RUNNING, VALUE, own=1e-3))
    found = advised("A1", tmp_path, (), accepting(0.081))
    assert found.verdict.verdict == "MARGINAL"
    (one,) = found.advice
    assert one.wanted == pytest.approx(1e-3)
    assert (one.helps, one.parameters) == ("visits", {"repeats": 4})
    by_run = advised("00001-friction-A1", tmp_path, (), accepting(0.081))
    assert by_run.advice == found.advice
    assert advised("A1", tmp_path, (), accepting(0.2)).advice == ()
    # The same sentence stands at the line of the verdict, wherever that is read.
    assert found.verdict.next_steps == (one.sentence,)


def test_a_limit_that_nothing_is_held_against_is_open(tmp_path: Path) -> None:
    run = write(tmp_path, 1, "starting-torque", start_time=start(1))
    analyse(run, estimate("starting_torque", 0.05), kind="starting-torque")
    found = advised("A1", tmp_path, (), accepting(0.2))
    ((sentence, protocol),) = found.open
    assert (protocol, found.advice) == ("friction", ())
    assert "no friction run of this gear is analysed" in sentence


def test_targets_are_read_by_name_share_and_unit(tmp_path: Path) -> None:
    run = write(tmp_path, 1, start_time=start(1))
    analyse(run, estimate(RUNNING, VALUE, own=1e-3))
    wanted = [
        advised("A1", tmp_path, (text,)).advice[0].wanted
        for text in (
            "running_torque_1000=2%",
            f"friction.{RUNNING}=1.6 mN m",
            f"{RUNNING}=1.6",
            f"{RUNNING}=0.0016 N m",
        )
    ]
    assert wanted == pytest.approx([1.6e-3] * 4)
    for text in ("x", "-1%", "2 arcmin", "0%", "nan", "inf", "1e400%"):
        text = f"{RUNNING}={text}"
        with pytest.raises(ConfigurationError, match="no uncertainty that can be wanted"):
            advised("A1", tmp_path, (text,))
    for text in ("speed=2%", RUNNING, "=3%"):
        with pytest.raises(ConfigurationError, match="names no number that was found"):
            advised("A1", tmp_path, (text,))


def test_a_number_that_is_not_identifiable_has_nothing_to_lower(tmp_path: Path) -> None:
    run = write(tmp_path, 1, start_time=start(1))
    analyse(run, estimate(RUNNING, VALUE, identifiable="no", note="one speed"))
    with pytest.raises(ConfigurationError, match=r"not identifiable.*one speed"):
        advised("A1", tmp_path, (f"{RUNNING}=2%",))


def test_a_list_of_runs_works_out_no_advice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = write(tmp_path, 1, start_time=start(1))
    analyse(run, estimate(RUNNING, VALUE, own=1e-3))
    found = advised("A1", tmp_path, (), accepting(0.081))
    monkeypatch.setattr("rig.analysis.next_run.advice", None)
    again = judge_newest(newest_analysed(runs_of(tmp_path, "A1")), accepting(0.081))
    assert again.verdict == found.verdict.verdict == "MARGINAL"
    assert again.because == found.verdict.because


def test_what_is_neither_gear_nor_run_and_what_was_never_analysed(tmp_path: Path) -> None:
    with pytest.raises(RunFileError, match="names no run"):
        advised("A1", tmp_path)
    write(tmp_path, 1, start_time=start(1))
    with pytest.raises(RunFileError, match="no analysis"):
        advised("1", tmp_path)
