"""Each act is refused by the check that it is meant for, or what comes of it is widened and not wrong."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from experiments import catalogue
from experiments.errors import AnalysisError
from experiments.evidence.holds import Recorded
from experiments.evidence.table import TABLE, checks_of
from experiments.finding import Severity
from experiments.result import Result
from tests.adversarial import acts, acts_of_size
from tests.adversarial.acts import Honest
from tests.adversarial.conftest import judged

Act = Callable[[Honest], Honest]

REFUSED: tuple[tuple[str, Act, str], ...] = (
    ("friction", acts.clipped_and_flagged, "saturation"),
    ("friction", acts.clipped, "plateau"),
    ("friction", acts.clipped_on_one_side, "plateau"),
    ("friction", acts.reversed_torque, "sign of the torque"),
    ("friction", acts.rectified, "sign of the torque"),
    ("friction", acts.frozen, "continuity"),
    ("friction", acts.frozen_for_a_while, "continuity"),
    ("friction", acts.input_jumping, "continuity"),
    ("friction", acts.half_in_reverse, "torque port against drive"),
    ("friction", acts.louder_from_the_middle, "torque port against drive"),
    ("friction", acts.wide_dead_band_in_both, "dead band"),
    ("friction", acts.dead_band_in_both, "dead band"),
    ("friction", acts.coarse_in_both, "steps of the port"),
    ("friction", acts_of_size.gain_in_both(0.75), "torque against inertia"),
    ("friction", acts.clipped_in_both, "plateau"),
    ("friction", acts.millinewtons, "reach of the motor"),
    ("friction", acts.doubled, "torque port against drive"),
    ("friction", acts.halved, "torque port against drive"),
    ("friction", acts.drifting_zero, "torque zero"),
    ("friction", acts.fading, "reference speed"),
    ("friction", acts.input_four_times, "speed against set-point"),
    ("friction", acts.input_half, "speed against set-point"),
    ("friction", acts.slow_time, "time axis"),
    ("friction", acts.fast_time, "time axis"),
    ("friction", acts.slow_time_and_rate, "speed against set-point"),
    ("friction", acts.slow_clock, "time axis"),
    ("friction", acts.rows_missing, "gaps"),
    ("friction", acts.pause, "gaps"),
    ("friction", acts.time_going_back, "gaps"),
    ("friction", acts.tare_of_another_motor, "origin of the tare"),
    ("friction", acts.tare_of_another_bench, "origin of the tare"),
    ("friction", acts.tare_of_another_calibration, "origin of the tare"),
    ("friction", acts.tare_much_warmer, "temperature of the tare"),
    ("friction", acts.tare_six_times, "size of the tare"),
    ("friction", acts.tare_negative, "size of the tare"),
    ("friction", acts.tare_not_its_own, "shape of the tare"),
    ("friction", acts.tare_with_a_stray_point, "shape of the tare"),
    ("friction", acts.tare_more_than_double, "card of the motor"),
    ("friction", acts.tare_of_zeros, "card of the motor"),
    ("friction", lambda h: acts.tare_alone(acts.tare_of_zeros(h)), "card of the motor"),
    ("motor-tare", acts.reversed_torque, "sign of the torque"),
    ("motor-tare", acts.millinewtons, "reach of the motor"),
    ("motor-tare", acts.dead_band_in_both, "dead band"),
    ("motor-tare", acts.wide_dead_band_in_both, "plateau"),
    ("kinematic-error", acts.ratio_119, "encoders against ratio"),
    ("kinematic-error", acts.output_losing_counts, "encoders against ratio"),
    ("kinematic-error", acts.input_four_times, "speed against set-point"),
    ("velocity-steps", acts.ratio_119, "encoders against ratio"),
    ("velocity-steps", acts.ratio_121, "encoders against ratio"),
    ("velocity-steps", acts.output_reversed, "encoders against ratio"),
    ("velocity-steps", acts.output_four_times, "encoders against ratio"),
    ("velocity-steps", acts.output_standing, "continuity"),
    ("velocity-steps", acts.input_jumping, "continuity"),
    ("kinematic-error", acts.output_standing, "continuity"),
    ("velocity-steps", acts.output_late, "skew of the encoders"),
    ("velocity-steps", acts.at_200_hz, "sampling of the resonance"),
    ("velocity-steps", acts.at_125_hz, "sampling of the resonance"),
    ("velocity-steps", acts.slow_time, "time axis"),
    ("velocity-steps", acts_of_size.slow_axis(1.005), "time axis"),
    ("kinematic-error", acts_of_size.coarse("output_angle", 4), "steps of the output"),
    ("starting-torque", acts_of_size.gain_in_both(0.8), "torque against inertia"),
    ("velocity-steps", acts.reversed_torque, "sign of the torque"),
    ("starting-torque", acts.input_four_times, "encoders against ratio"),
    ("starting-torque", acts.output_reversed, "encoders against ratio"),
    ("starting-torque", acts.reversed_torque, "sign of the torque"),
    ("starting-torque", acts.clipped_low, "plateau"),
    ("starting-torque", acts.millinewtons, "reach of the motor"),
    ("starting-torque", acts.wide_dead_band_in_both, "dead band"),
    ("starting-torque", acts.dead_band_in_both, "dead band"),
    ("starting-torque", acts.coarse_in_both, "steps of the port"),
)
"""Kind, act, and the check that refuses."""

WIDENED: tuple[tuple[str, Act, str, str], ...] = (
    ("friction", acts_of_size.gain_in_both(1.3), "torque against inertia", "coulomb"),
    ("friction", acts.tare_of_last_month, "age of the tare", "coulomb"),
    ("friction", acts.tare_warmer, "temperature of the tare", "coulomb"),
    ("friction", acts.tare_ten_more, "other tares of the bench", "coulomb"),
    ("friction", acts.tare_of_a_cold_motor, "other tares of the bench", "coulomb"),
    ("friction", acts.tare_halved, "other tares of the bench", "coulomb"),
    ("friction", acts.tare_alone, "other tares of the bench", "coulomb"),
)
"""Kind, act, the check that widens, and a quantity that becomes wider."""


@pytest.fixture(scope="module")
def result(honest: Callable[[str], Honest]) -> Callable[[str], Result]:
    """What an honest run comes to."""
    done: dict[str, Result] = {}

    def of(kind: str) -> Result:
        if kind not in done:
            run = honest(kind)
            done[kind] = catalogue.load(kind).analyse(run.recording, run.evidence)
        return done[kind]

    return of


@pytest.mark.parametrize("kind", ["friction", "motor-tare", "kinematic-error", "starting-torque"])
def test_an_honest_run_passes_every_check(
    kind: str, honest: Callable[[str], Honest], result: Callable[[str], Result]
) -> None:
    checks = result(kind).checks
    assert checks
    allowed = (Severity.PASSED, Severity.NOT_LOOKED_AT)
    assert {c.what: c.severity for c in checks if c.severity not in allowed} == {}
    # Without a check that a verdict needs, there would be none.
    assert [c.what for c in checks if c.is_evidence and c.severity is not Severity.PASSED] == []
    if kind != "motor-tare":
        assert judged(result(kind), honest(kind).recording).verdict == "FAIL"


@pytest.mark.parametrize(
    ("kind", "act", "check"), [pytest.param(k, a, c, id=f"{k}-{a.__name__}") for k, a, c in REFUSED]
)
def test_a_broken_recording_is_refused(
    kind: str, act: Act, check: str, honest: Callable[[str], Honest]
) -> None:
    broken = act(honest(kind))
    with pytest.raises(AnalysisError, match=rf"{check}: ") as refused:
        catalogue.load(kind).analyse(broken.recording, broken.evidence)
    assert refused.value.value
    assert refused.value.limit
    assert refused.value.remedy


@pytest.mark.parametrize(
    ("kind", "act", "check", "quantity"),
    [pytest.param(*row, id=f"{row[0]}-{row[1].__name__}") for row in WIDENED],
)
def test_what_is_widened_is_wider_and_not_wrong(
    kind: str,
    act: Act,
    check: str,
    quantity: str,
    honest: Callable[[str], Honest],
    result: Callable[[str], Result],
) -> None:
    broken, before = act(honest(kind)), result(kind)
    after = catalogue.load(kind).analyse(broken.recording, broken.evidence)
    (widened,) = [c for c in after.checks if c.severity is Severity.NOTES]
    assert widened.what == check
    assert widened.follows in after.warnings
    assert (
        after.estimates[quantity].expanded_uncertainty
        > 1.02 * before.estimates[quantity].expanded_uncertainty
    )
    assert judged(after, broken.recording).verdict != "PASS"
    for name, estimate in after.estimates.items():
        if estimate.identifiable == "yes":
            apart = abs(estimate.value - before.estimates[name].value)
            assert apart <= estimate.expanded_uncertainty, name


def test_port_and_drive_of_one_sensor_are_called_one_instrument(
    honest: Callable[[str], Honest], result: Callable[[str], Result]
) -> None:
    def said(of: Result) -> tuple[str, str]:
        (check,) = [c for c in of.checks if c.what == "torque port against drive"]
        (line,) = [b for b in of.estimates["coulomb"].budget if b.source == "torque scale"]
        assert check.severity is Severity.PASSED
        return check.follows, line.note

    words, note = said(result("friction"))
    assert words.startswith("One instrument (both by motor current")
    assert "the same instrument" in note
    other = acts.with_a_torque_cell(honest("friction"))
    words, note = said(catalogue.load("friction").analyse(other.recording, other.evidence))
    assert words.startswith("Two instruments: the port by torque cell 7")
    assert "the same instrument" not in note
    unsaid = acts.with_a_torque_cell(honest("friction"), "")
    words, _ = said(catalogue.load("friction").analyse(unsaid.recording, unsaid.evidence))
    assert "nobody says by which sensor" in words


def test_below_one_kilohertz_ramps_say_nothing_of_the_scale_of_the_torque(
    honest: Callable[[str], Honest],
) -> None:
    """Sampled at a quarter of it, ramps of good torques show a quarter too little."""

    def found(run: Honest) -> Severity:
        recorded = Recorded(run.recording, catalogue.load("friction"), run.evidence)
        (check,) = [c for c in checks_of(recorded).checks if c.what == "torque against inertia"]
        return check.severity

    assert found(honest("friction")) is Severity.PASSED
    assert found(acts.decimated(honest("friction"), 4)) is Severity.NOT_LOOKED_AT


def test_stray_rows_of_an_encoder_do_not_end_a_ramp(
    honest: Callable[[str], Honest], result: Callable[[str], Result]
) -> None:
    stray = acts.stray_rows_of_the_input(honest("starting-torque"))
    after = catalogue.load("starting-torque").analyse(stray.recording, stray.evidence)
    for name, estimate in result("starting-torque").estimates.items():
        assert after.estimates[name].value == pytest.approx(estimate.value, rel=2e-3), name


def test_steps_that_the_drives_ramps_shaped_are_said(honest: Callable[[str], Honest]) -> None:
    shaped = acts.by_the_drives_ramps(honest("velocity-steps"))
    recorded = Recorded(shaped.recording, catalogue.load("velocity-steps"), shaped.evidence)
    (check,) = [c for c in checks_of(recorded).checks if c.what == "shape of the steps"]
    assert check.severity is Severity.NOTES
    assert "its own ramps shaped the steps" in check.follows
    assert not check.is_evidence


def test_a_run_that_was_stopped_is_not_judged(
    honest: Callable[[str], Honest], result: Callable[[str], Result]
) -> None:
    """What it did not reach may have been the worst of it: a gear that would fail is not passed, and not failed."""
    stopped = acts.stopped(honest("friction"))
    after = catalogue.load("friction").analyse(stopped.recording, stopped.evidence)
    assert judged(result("friction"), honest("friction").recording).verdict == "FAIL"
    found = judged(after, stopped.recording)
    assert found.verdict == "NOT JUDGED"
    assert all("ended as" in why for why in found.because)
    (check,) = [c for c in after.checks if c.what == "end of the run"]
    assert (check.severity, check.is_evidence) == ("not looked at", True)


def test_the_documentation_lists_the_checks_in_their_order() -> None:
    page = (Path(__file__).parents[2] / "docs/explanation/evidence.md").read_text(encoding="utf-8")
    table = page.partition("## The table")[2].partition("## ")[0]
    listed = re.findall(r"^\| ([a-z-][a-z -]+) \|", table, re.MULTILINE)[1:]
    assert listed == [row.name for row in TABLE]


def test_every_check_has_a_recording_that_it_refuses_or_widens() -> None:
    tried = {check for _, _, check in REFUSED} | {check for _, _, check, _ in WIDENED}
    assert {row.name for row in TABLE} - tried == {
        "count lattice",
        "end of the run",
        "shape of the steps",
    }
