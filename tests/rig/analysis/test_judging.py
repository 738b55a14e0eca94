"""The verdict on a gear: the worst over what its acceptance file lists, whatever else was found."""

import math
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from experiments import catalogue
from experiments.assumed import TORQUE_SCALE
from experiments.evidence.conclusion import judged
from experiments.finding import Finding, Severity
from experiments.result import Result, Verdict
from model.identify.estimate import Estimate
from rig.analysis.fit.recorded import Fit
from rig.analysis.in_force import in_force
from rig.analysis.judging import (
    NO_GEAR,
    StoredResult,
    held_against,
    judge,
    judge_run,
    judge_runs,
    judge_stored,
    stored_result,
    whose_limit,
)
from rig.analysis.result_data import quantities_for
from rig.analysis.store import Basis, append_analysis
from rig.gears.acceptance import Acceptance, Limit, Part
from tests.rig import handmade

NAMES = {
    "kinematic-error": ("transmission_accuracy", "rad"),
    "starting-torque": ("starting_torque", "N m"),
    "friction": ("running_torque_1000_rpm", "N m"),
    "warm-up": ("running_torque", "N m"),
}
CLEAR = Finding("gaps", Severity.PASSED)
LACKING = Finding("torque zero", Severity.NOT_LOOKED_AT)
BESIDE = Finding("count lattice", Severity.NOT_LOOKED_AT, is_evidence=False)


def estimate(name: str, value: float, u: float, called: str = "yes") -> Estimate:
    return Estimate(
        name=name,
        value=value,
        unit=next(unit for known, unit in NAMES.values() if known == name),
        low=value - u,
        high=value + u,
        identifiable=called,  # type: ignore[arg-type]
        stated_coverage_factor=2.0,
    )


def found(
    kind: str,
    value: float = 1.0,
    u: float = 0.1,
    *,
    called: str = "yes",
    checks: tuple[Finding, ...] = (CLEAR, BESIDE),
    subject: str = "gear",
    origin: str = "hardware",
    outcome: str = "COMPLETED",
) -> StoredResult:
    name, _ = NAMES[kind]
    estimates = {name: estimate(name, value, u, called)}
    result = Result(
        run=f"1-{kind}",
        kind=kind,
        quantities=quantities_for(kind, estimates, ()),
        estimates=estimates,
        checks=checks,
        options={"torque_is_of": subject},
    )
    return StoredResult(result, origin, outcome, "SN-1")


def limit(kind: str, upper: float | None = 2.0, **changes: object) -> Limit:
    name, unit = NAMES[kind]
    made = Limit(
        quantity=f"{kind}.{name}",
        unit=unit,
        source="specification 7",
        standing="customer",
        upper=upper,
        confirmed_by="A. Example",
        confirmed_on="2026-11-01",
    )
    return replace(made, **changes)  # type: ignore[arg-type]


def asked(*limits: Limit, use: str = "any") -> Acceptance:
    return Acceptance(name="spec", source="s", use=use, limits=limits, path="spec.toml")  # type: ignore[arg-type]


ANY = st.sampled_from(sorted(NAMES))
RUNS = st.builds(
    found,
    ANY,
    st.floats(0.1, 10.0) | st.just(math.nan),
    st.floats(0.001, 1.0),
    called=st.sampled_from(["yes", "weakly", "no"]),
    checks=st.sampled_from([(CLEAR,), (CLEAR, LACKING), (BESIDE,)]),
    subject=st.sampled_from(["gear", "motor + gear"]),
    origin=st.sampled_from(["hardware", "simulated", "imported"]),
    outcome=st.sampled_from(["COMPLETED", "", "ABORTED"]),
)
LIMITS = st.builds(
    limit,
    ANY,
    st.floats(0.1, 10.0),
    lower=st.none() | st.floats(0.01, 0.1),
    confirmed_by=st.sampled_from(["A. Example", ""]),
    subject=st.sampled_from(["gear", "motor + gear"]),
)


def expected(line: Verdict, one: StoredResult | None, acceptance: Acceptance) -> str:
    """What a line must come to, worked out anew."""
    e = line.estimate
    (of,) = [x for x in acceptance.limits if x.kind == line.kind]
    nothing = (
        one is None
        or not of.confirmed_by
        or one.outcome == "ABORTED"
        or LACKING in one.result.checks
        or (line.kind != "kinematic-error" and one.result.options["torque_is_of"] != of.subject)
        or e.identifiable == "no"
        or math.isnan(e.value)
    )
    if nothing:
        return "NOT JUDGED"
    over = (e.value - line.limit) * (1 if line.is_upper else -1)
    u = e.expanded_uncertainty
    return "PASS" if over + u <= 0 else "FAIL" if over - u > 0 else "MARGINAL"


@settings(max_examples=150)
@given(
    runs=st.lists(RUNS, max_size=4, unique_by=lambda one: one.result.kind),
    limits=st.lists(LIMITS, max_size=4, unique_by=lambda one: one.kind),
)
def test_the_verdict_is_the_worst_over_the_list_and_nothing_else(
    runs: list[StoredResult], limits: list[Limit]
) -> None:
    acceptance = asked(*limits)
    verdict = judge(runs, acceptance)
    by_kind = {one.result.kind: one for one in runs}
    outcomes = [line.outcome for line in verdict.lines]
    assert outcomes == [expected(v, by_kind.get(v.kind), acceptance) for v in verdict.lines]
    assert {line.kind for line in verdict.lines} == {one.kind for one in limits}
    order = ("FAIL", "NOT JUDGED", "MARGINAL", "PASS")
    assert verdict.verdict == (min(outcomes, key=order.index) if outcomes else "NOT JUDGED")
    assert bool(verdict.because) == (verdict.verdict != "PASS")
    # What is not listed never counts.
    listed = {one.kind for one in limits}
    assert judge([r for r in runs if r.result.kind in listed], acceptance) == verdict
    told = verdict.as_json()
    assert (told["verdict"], told["because"]) == (verdict.verdict, list(verdict.because))
    for one in runs:
        alone = judge_run(one, acceptance)
        assert judge_runs([one], acceptance) == alone
        assert alone.lines == verdict.of(one.result)


def test_a_stale_analysis_judges_nothing_and_names_what_renews_it() -> None:
    acceptance = asked(limit("friction"))
    one = replace(found("friction"), stale=("its tare changed",), renewed_by="rig fit RUN")
    verdict = judge_run(one, acceptance)
    words = "the analysis is stale: its tare changed. Renew it: rig fit RUN"
    assert verdict.verdict == "NOT JUDGED"
    assert words in verdict.because[0]
    (line,) = verdict.lines
    assert line.estimate.value == one.result.estimates["running_torque_1000_rpm"].value
    for told in (
        verdict,
        judge([one], acceptance),
        judge_run(one, None),
        judge_run(one, asked(limit("kinematic-error"))),
    ):
        assert told.as_json()["stale"] == [f"run 1-friction, friction: {words}"]


def test_an_analysis_that_nobody_reads_judges_nothing() -> None:
    one = replace(found("friction"), not_in_force="analysis 1 is in force, not analysis 2")
    verdict = judge_run(one, asked(limit("friction")))
    assert verdict.verdict == "NOT JUDGED"
    assert "analysis 1 is in force" in verdict.because[0]


@pytest.mark.parametrize(
    ("changes", "because"),
    [
        ({"checks": (CLEAR, LACKING)}, "not checked: torque zero"),
        ({"subject": "motor + gear"}, "no tare was subtracted"),
        ({"outcome": "TRIPPED"}, "the run ended as TRIPPED"),
        ({"value": math.nan}, "no value"),
        ({"called": "no"}, "do not determine"),
    ],
)
def test_what_lacks_something_is_not_judged_and_says_what(
    changes: dict[str, object], because: str
) -> None:
    acceptance = asked(limit("friction"))
    assert judge_run(found("friction"), acceptance).verdict == "PASS"
    verdict = judge_run(found("friction", **changes), acceptance)  # type: ignore[arg-type]
    assert verdict.verdict == "NOT JUDGED"
    assert because in verdict.because[0]


def test_a_torque_that_must_be_above_zero_and_reaches_it_is_not_judged() -> None:
    quantities = catalogue.load("starting-torque").quantities
    quantity = next(q for q in quantities if q.name == "starting_torque")

    def outcome(u: float) -> str:
        ran = found("starting-torque", 1.0, u)
        number = judged(quantity, ran.result.estimates["starting_torque"])
        result = replace(ran.result, estimates={"starting_torque": number})
        return judge([replace(ran, result=result)], asked(limit("starting-torque", 3.0))).verdict

    assert (outcome(0.1), outcome(1.5)) == ("PASS", "NOT JUDGED")


@pytest.mark.parametrize("kind", ["friction", "starting-torque", "warm-up"])
def test_a_torque_is_judged_by_a_limit_on_the_same_subject_alone(kind: str) -> None:
    def verdict(measured: str, limited: str) -> str:
        asked_of = asked(limit(kind, subject=limited))
        judged = judge_run(found(kind, subject=measured), asked_of)
        words = "that of the gear alone" if measured == "gear" else "that of motor + gear"
        assert judged.verdict == "PASS" or words in judged.because[0]
        return judged.verdict

    subjects = ("gear", "motor + gear")
    assert [[verdict(a, b) for a in subjects] for b in subjects] == [
        ["PASS", "NOT JUDGED"],
        ["NOT JUDGED", "PASS"],
    ]


def test_what_is_no_torque_has_no_subject() -> None:
    one = found("kinematic-error", subject="motor + gear")
    assert judge_run(one, asked(limit("kinematic-error"))).verdict == "PASS"


def test_nothing_listed_and_nothing_named_is_not_judged() -> None:
    one = found("friction")
    assert judge([one], None).because == (
        "no acceptance file is named for this gear: rig gear set SN-1 --by NAME --acceptance FILE",
    )
    elsewhere = replace(one, serial="SN 1", path=Path("own runs/00001.h5"))
    (because,) = judge([elsewhere], None).because
    assert because.endswith("rig gear set 'SN 1' --by NAME --acceptance FILE --runs 'own runs'")
    assert judge([one], asked()).verdict == "NOT JUDGED"
    other = judge_run(one, asked(limit("kinematic-error")))
    assert other.because == ("no limit of spec applies to what this run measures",)
    missing = judge([one], asked(limit("friction"), limit("kinematic-error")))
    assert missing.verdict == "NOT JUDGED"
    assert "no kinematic-error run of this gear is analysed" in missing.because[0]


@pytest.mark.parametrize("serial", ["", "unknown"])
def test_a_recording_without_a_gear_is_not_sent_to_a_gear_that_is_none(serial: str) -> None:
    nobody = replace(found("friction"), serial=serial)
    assert judge([nobody], None).because == (NO_GEAR,)


def test_a_demonstration_judges_simulated_runs_alone() -> None:
    acceptance = asked(
        limit("friction", standing="demonstration", confirmed_by="", confirmed_on=""),
        use="simulated",
    )
    verdicts = {o: judge_run(found("friction", origin=o), acceptance).verdict for o in ORIGINS}
    assert verdicts == {"simulated": "PASS"} | dict.fromkeys(ORIGINS[1:], "NOT JUDGED")


ORIGINS = ("simulated", "hardware", "imported", "replay")


def test_a_limit_on_both_directions_is_held_against_each() -> None:
    ways = {
        f"transmission_accuracy_{way}": replace(
            estimate("transmission_accuracy", value, 0.1), name=f"transmission_accuracy_{way}"
        )
        for way, value in (("forward", 1.0), ("reverse", 3.0))
    }
    result = Result(
        run="R",
        kind="kinematic-error",
        quantities=quantities_for("kinematic-error", ways, ()),
        estimates=ways,
    )
    verdict = judge_run(StoredResult(result, "hardware", ""), asked(limit("kinematic-error")))
    assert [line.outcome for line in verdict.lines] == ["PASS", "FAIL"]


def test_a_reason_tells_value_limit_and_whose_limit_it_is() -> None:
    verdict = judge_run(found("friction", 3.0), asked(limit("friction")))
    (line,) = verdict.lines
    value, allowed = held_against(line)
    assert whose_limit(line) == "customer: specification 7"
    for part in (value, allowed, "FAIL", "customer: specification 7", "1-friction"):
        assert part in verdict.because[0]


def test_a_verdict_says_that_it_rests_on_what_was_assumed() -> None:
    one = found("friction", 3.0, called="weakly")
    for assumed in ("torque scale", ""):
        line = replace(TORQUE_SCALE.line("scale", 0.05), assumed=assumed)
        (name,) = one.result.estimates
        told = replace(one.result.estimates[name], budget=(line,))
        result = replace(one.result, estimates={name: told})
        verdict = judge_run(replace(one, result=result), asked(limit("friction")))
        assert verdict.verdict == "FAIL"
        assert ("rests on an assumed torque scale" in verdict.because[0]) is bool(assumed)


def test_a_fit_and_its_stored_analysis_have_one_verdict(tmp_path: Path) -> None:
    fit: Fit = handmade.fit()
    run = tmp_path / "00001-friction.h5"
    acceptance = handmade.acceptance()

    def named(folder: Path, serial: str) -> Acceptance:
        return acceptance

    because = judge_stored(
        run, "friction", "simulated", "COMPLETED", "SN", part=Part(), accepted=named
    ).verdict.because
    assert because == (f"the run is not analysed: rig fit {run}",)
    version = catalogue.load("friction").version
    basis = Basis("ab" * 32, "2026-11-01T00:00:00+00:00", analysis_version=version)
    append_analysis(run, fit.result, basis)
    listed = judge_stored(
        run, "friction", fit.origin, fit.outcome, fit.serial, part=Part(), accepted=named
    ).verdict
    read = stored_result(in_force(run, "friction"), fit.origin, fit.outcome, fit.serial)
    verdicts = [judge_run(fit, acceptance), judge_run(read, acceptance), listed]
    assert {v.verdict for v in verdicts} == {"PASS"}
    assert len({v.because for v in verdicts}) == 1
    assert len({tuple(held_against(line) for line in v.lines) for v in verdicts}) == 1
    aborted = judge_stored(
        run, "friction", "simulated", "ABORTED", "SN", part=Part(), accepted=named
    ).verdict
    assert aborted.because == ("the run ended as ABORTED",)


def test_limits_of_another_part_judge_nothing_and_say_why() -> None:
    for_another = replace(asked(limit("friction", 0.5)), parts=("SHG-32-100",))
    one = replace(found("friction"), part=Part("CSF-25-120", 120.0))
    assert judge_run(one, replace(for_another, parts=("CSF-25-120",))).verdict == "FAIL"
    verdict = judge_run(one, for_another)
    assert verdict.verdict == "NOT JUDGED"
    assert "is for SHG-32-100, not for CSF-25-120" in verdict.because[0]
    assert judge([one], for_another).verdict == "NOT JUDGED"


def test_a_file_that_names_no_part_says_so_with_its_verdict() -> None:
    judged = judge_run(found("friction"), asked(limit("friction", 3.0)))
    assert (judged.verdict, judged.remark) == ("PASS", "spec names no part that it is for")
    assert judged.as_json()["remark"] == judged.remark
