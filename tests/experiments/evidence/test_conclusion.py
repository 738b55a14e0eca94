"""What a result may claim: which numbers are called identified, and which verdicts stand."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from experiments.contract import Evidence, Experiment, NoParameters, no_plan
from experiments.evidence.conclusion import checked_analysis, concluded
from experiments.evidence.holds import Recorded
from experiments.quantity import Quantity
from experiments.recording import Recording
from experiments.result import Check, Covariance, Result, judge_upper
from model.gear_file import shipped_gear
from model.identify.estimate import BudgetLine, Cause, Estimate
from tests.experiments.test_analyses_without_plan import foreign

QUANTITIES = (
    Quantity(name="size", title="size", unit="N m"),
    Quantity(name="aimed", title="aimed", unit="N m", target_uncertainty=0.3),
    Quantity(name="place", title="place", unit="rad", is_signed=True),
    Quantity(name="amplitude_{order}", title="order {order}", unit="rad", target_uncertainty=1.0),
)
OK = Check(name="gaps", outcome="ok")
MISSING = Check(name="torque zero", outcome="not checked", words="no zero")
BESIDE = Check(name="count lattice", outcome="not checked", is_evidence=False)
WIDER = Check(name="age of the tare", outcome="widened", words="The tare is old.")


def estimate(name: str, value: float, u: float, identifiable: str = "yes") -> Estimate:
    """An estimate with U = u."""
    return Estimate(
        name=name,
        value=value,
        unit="N m",
        low=value - u,
        high=value + u,
        identifiable=identifiable,  # type: ignore[arg-type]
    )


def experiment(result: Result) -> Experiment:
    return Experiment(
        name="test",
        title="",
        summary="",
        parameters=NoParameters,
        plan=no_plan,
        analyse=lambda recording, evidence: result,
        needs=(),
        has_plan=False,
        quantities=QUANTITIES,
    )


def recorded(result: Result) -> Recorded:
    time = np.arange(0.0, 10.0, 1e-3)
    recording = foreign(time, input_angle=(300.0 * time, "rad"))
    return Recorded(recording, experiment(result), Evidence(shipped_gear()))


def of(*estimates: Estimate, **more: object) -> Result:
    return Result(
        run="r",
        kind="test",
        quantities=QUANTITIES,
        estimates={e.name: e for e in estimates},
        **more,  # type: ignore[arg-type]
    )


@pytest.mark.parametrize(
    ("name", "value", "u", "called", "note"),
    [
        ("size", 1.0, 0.1, "yes", ""),
        ("size", 1.0, 0.6, "weakly", "U is 60 % of the value"),
        ("size", 1.0, 1.5, "weakly", "not distinguishable from zero, below 2.5 N m"),
        ("size", 1.0, math.nan, "no", "no value"),
        ("aimed", 1.0, 0.29, "yes", ""),
        ("aimed", 1.0, 0.31, "weakly", "U is above 0.3"),
        # An answer: whatever it is, it is small.
        ("aimed", 0.1, 0.2, "yes", "not distinguishable from zero, below 0.3 N m"),
        ("place", 0.0, 0.2, "yes", ""),
        ("amplitude_2", 1.0, 0.2, "yes", ""),
        # An order that may be nothing is no order, however small it is.
        ("amplitude_2", 0.1, 0.2, "weakly", "not distinguishable from zero"),
    ],
)
def test_a_number_is_called_identified_where_its_uncertainty_says_so(
    name: str, value: float, u: float, called: str, note: str
) -> None:
    result = of(estimate(name, value, u))
    found = concluded(result, (), recorded(result)).estimates[name]
    assert (found.identifiable, found.value) == (called, value)
    assert note in found.note if note else not found.note


@pytest.mark.parametrize("word", ["weakly", "no"])
def test_what_an_analysis_does_not_call_identified_is_never_raised(word: str) -> None:
    result = of(estimate("size", 1.0, 0.01, word))
    assert concluded(result, (), recorded(result)).estimates["size"].identifiable == word


def test_a_verdict_without_its_evidence_is_not_judged() -> None:
    size = estimate("size", 1.0, 0.1)
    result = of(size, verdicts=(judge_upper("size", "", size, 2.0, "catalogue", ""),))
    assert concluded(result, (OK, BESIDE), recorded(result)).verdict == "PASS"
    found = concluded(result, (OK, MISSING, BESIDE), recorded(result))
    assert (found.verdict, found.because) == ("NOT JUDGED", "not checked: torque zero")
    answer = found.as_json()
    assert (answer["verdict"], answer["because"]) == (found.verdict, found.because)
    assert answer["verdicts"][0]["because"] == found.because
    assert [check["outcome"] for check in answer["checks"]] == ["ok", "not checked", "not checked"]
    assert set(answer["checks"][1]) == {"name", "outcome", "found", "allowed", "words"}


@pytest.mark.parametrize(
    ("limit", "provenance", "value", "because"),
    [
        (2.0, "recalled", 1.0, "no verified limit"),
        (math.nan, "catalogue", 1.0, "no verified limit"),
        (2.0, "catalogue", math.nan, "no value"),
    ],
)
def test_a_verdict_says_what_is_missing(
    limit: float, provenance: str, value: float, because: str
) -> None:
    verdict = judge_upper("size", "", estimate("size", value, 0.1), limit, provenance, "")  # type: ignore[arg-type]
    assert verdict.outcome == "NOT JUDGED"
    assert because in verdict.because


def test_a_number_that_the_data_do_not_determine_is_not_judged() -> None:
    vague = dataclasses.replace(estimate("size", 0.1, 0.1, "no"), note="at its bound")
    verdict = judge_upper("size", "", vague, 1.0, "catalogue", "")
    assert (verdict.outcome, "at its bound" in verdict.because) == ("NOT JUDGED", True)
    # Small against the limit is what counts, not small against itself.
    wide = estimate("size", 0.1, 0.1)
    assert judge_upper("size", "", wide, 1.0, "catalogue", "").outcome == "PASS"


def test_the_worst_verdict_stands_and_a_missing_one_is_no_pass() -> None:
    size = estimate("size", 1.0, 0.1)
    good, bad = (judge_upper("size", "", size, limit, "catalogue", "") for limit in (2.0, 0.5))
    unknown = judge_upper("size", "", size, 2.0, "recalled", "")
    assert of(size).verdict == "NOT JUDGED"
    assert of(size).because
    assert of(size, verdicts=(good,)).verdict == "PASS"
    assert of(size, verdicts=(good, unknown)).verdict == "NOT JUDGED"
    assert of(size, verdicts=(good, unknown, bad)).verdict == "FAIL"


def test_what_widens_is_said() -> None:
    result = of(estimate("size", 1.0, 0.1), warnings=("before",))
    assert concluded(result, (WIDER, OK), recorded(result)).warnings == ("before", WIDER.words)


def test_the_covariance_keeps_what_is_shared_apart() -> None:
    matrix = np.diag([0.04, 0.01])
    scale = BudgetLine("torque scale", "B", 0.3, "", Cause.TORQUE_SCALE)
    own = BudgetLine("scatter", "A", 0.2)
    size = dataclasses.replace(estimate("size", 9.0, 0.1), budget=(own, scale))
    aimed = dataclasses.replace(estimate("aimed", 9.0, 0.1), budget=(scale,))
    result = of(size, aimed, covariance=Covariance(("size", "aimed"), matrix))
    covariance = concluded(result, (), recorded(result)).covariance
    assert covariance is not None
    assert (covariance.matrix == matrix).all()
    assert covariance.shared[Cause.TORQUE_SCALE].tolist() == [0.3, 0.3]
    assert covariance.whole() == pytest.approx(np.array([[0.13, 0.09], [0.09, 0.10]]))
    assert covariance.as_json()["shared"] == {"torque scale": [0.3, 0.3]}


def test_the_analysis_sees_what_was_checked_and_not_the_settings_of_the_checks() -> None:
    seen: list[Evidence] = []
    result = of(estimate("size", 1.0, 0.1))

    def analyse(recording: Recording, evidence: Evidence) -> Result:
        seen.append(evidence)
        return result

    kind = dataclasses.replace(experiment(result), analyse=analyse)
    evidence = Evidence(shipped_gear(), settings={"tare_age_limit": 3.0, "channel": "torque"})
    found = checked_analysis(kind)(recorded(result).recording, evidence)
    assert seen[0].settings == {"channel": "torque"}
    assert seen[0].checks == found.checks
    assert {check.name for check in found.checks} >= {"gaps", "time axis"}
