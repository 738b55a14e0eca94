"""What a result may claim: which numbers are called identified, and which verdicts stand."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from experiments import catalogue
from experiments.contract import Evidence, Experiment, NoParameters, no_plan
from experiments.evidence.conclusion import checked_analysis, concluded, judged
from experiments.evidence.holds import Recorded
from experiments.finding import Finding, Severity
from experiments.quantity import Quantity
from experiments.recording import Recording
from experiments.result import (
    Covariance,
    Result,
    checks_from_mapping,
    checks_to_mapping,
    lacks_number,
    outcome_against,
)
from model.gear_file import shipped_gear
from model.identify.estimate import BudgetLine, Cause, Estimate
from model.identify.polar import polar
from tests.experiments.test_analyses_without_plan import foreign

QUANTITIES = (
    Quantity(name="size", title="size", unit="N m"),
    Quantity(name="aimed", title="aimed", unit="N m", target_uncertainty=0.3),
    Quantity(name="place", title="place", unit="rad", is_signed=True),
    Quantity(name="aimed_place", title="place", unit="N m", is_signed=True, target_uncertainty=0.3),
    Quantity(name="amplitude_{order}", title="order {order}", unit="N m", target_uncertainty=1.0),
    Quantity(name="phase", title="phase", unit="rad", is_circular=True),
)
OK = Finding("gaps", Severity.PASSED)
MISSING = Finding("torque zero", Severity.NOT_LOOKED_AT, "no zero")
BESIDE = Finding("count lattice", Severity.NOT_LOOKED_AT, is_evidence=False)
WIDER = Finding("age of the tare", Severity.NOTES, follows="The tare is old.")


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
        ("aimed", 0.1, 0.2, "yes", "not distinguishable from zero, below 300 mN m"),
        # Zero is a value like any other of a place, and still nobody knows on which side of it the place lies.
        ("place", 0.0, 0.2, "weakly", "not distinguishable from zero, below 200 mN m"),
        ("place", 0.3, 0.2, "weakly", "U is 67 % of the value"),
        ("place", 3.0, 0.2, "yes", ""),
        ("aimed_place", 0.0, 0.2, "yes", "not distinguishable from zero, below 200 mN m"),
        ("aimed_place", 0.0, 0.4, "weakly", "not distinguishable from zero, below 400 mN m"),
        ("amplitude_2", 1.0, 0.2, "yes", ""),
        ("amplitude_2", 0.1, 0.2, "yes", "not distinguishable from zero, below 300 mN m"),
        # On a circle zero is a place like any other.
        ("phase", 0.0, 0.2, "yes", ""),
    ],
)
def test_a_number_is_called_identified_where_its_uncertainty_says_so(
    name: str, value: float, u: float, called: str, note: str
) -> None:
    result = of(estimate(name, value, u))
    found = concluded(result, (), recorded(result)).estimates[name]
    assert (found.identifiable, found.value) == (called, value)
    assert note in found.note if note else not found.note


def test_what_the_fit_called_small_is_as_small_as_its_whole_uncertainty_says() -> None:
    """Lines that came after the fit (a curve of the encoder, a delay) are in the size below which it lies."""
    early = "not distinguishable from zero, below 100 mN m"
    one = dataclasses.replace(estimate("amplitude_2", 0.1, 2.0), identifiable="weakly", note=early)
    result = of(one)
    found = concluded(result, (), recorded(result)).estimates["amplitude_2"]
    assert found.identifiable == "weakly"
    assert found.note == "not distinguishable from zero, below 2.1 N m"


@pytest.mark.parametrize("kind", catalogue.kinds())
def test_an_interval_that_holds_zero_is_called_so_of_every_declared_quantity(kind: str) -> None:
    declared = catalogue.load(kind).quantities
    for quantity in (q for q in declared if not (q.is_circular or q.is_above_zero)):
        found = judged(quantity, dataclasses.replace(estimate("x", 0.1, 0.2), unit=quantity.unit))
        target = quantity.target_uncertainty
        assert "not distinguishable from zero" in found.note, quantity.name
        expected = "yes" if target is not None and target >= 0.2 else "weakly"
        assert found.identifiable == expected, quantity.name


def test_a_target_in_another_unit_is_none() -> None:
    in_ampere = dataclasses.replace(estimate("aimed", 1.0, 0.29), unit="A")
    assert judged(QUANTITIES[1], in_ampere).identifiable == "yes"
    assert judged(QUANTITIES[1], dataclasses.replace(in_ampere, value=0.1)).identifiable == "weakly"
    wide = dataclasses.replace(estimate("aimed", 10.0, 0.4), unit="A")
    assert judged(QUANTITIES[1], wide).identifiable == "yes"


@pytest.mark.parametrize("word", ["weakly", "no"])
def test_what_an_analysis_does_not_call_identified_is_never_raised(word: str) -> None:
    result = of(estimate("size", 1.0, 0.01, word))
    assert concluded(result, (), recorded(result)).estimates["size"].identifiable == word


def test_a_stored_check_says_whether_a_verdict_needs_it() -> None:
    size = estimate("size", 1.0, 0.1)
    found = concluded(of(size), (OK, MISSING, BESIDE), recorded(of(size))).as_json()
    assert [check["outcome"] for check in found["checks"]] == ["ok", "not checked", "not checked"]
    assert [check["is_evidence"] for check in found["checks"]] == [True, True, False]
    assert {"verdict", "verdicts", "because", "outcome"}.isdisjoint(found)


def test_a_number_that_the_data_do_not_determine_is_held_against_nothing() -> None:
    vague = dataclasses.replace(estimate("size", 0.1, 0.1, "no"), note="at its bound")
    assert outcome_against(vague, 1.0) == "NOT JUDGED"
    assert "at its bound" in lacks_number(vague)
    assert "no value" in lacks_number(estimate("size", math.nan, 0.1))
    # Small against the limit is what counts, not small against itself.
    wide = estimate("size", 0.1, 0.1)
    assert (outcome_against(wide, 1.0), lacks_number(wide)) == ("PASS", "")
    assert outcome_against(wide, math.nan) == "NOT JUDGED"


def test_the_length_of_a_vector_that_may_be_noise_keeps_no_lower_limit() -> None:
    noise = polar("4", np.array([2.3e-6, 0.0]), 1e-12 * np.eye(2), 1e4, "rad").amplitude
    assert noise.value - noise.expanded_uncertainty > 1e-7
    assert outcome_against(noise, 1e-7, is_upper=False) == "MARGINAL"
    assert outcome_against(noise, 0.0, is_upper=False) == "PASS"
    assert outcome_against(noise, 1e-5) == "PASS"
    # Its interval leaves zero before noise is ruled out: the same page says that it may be zero.
    doubtful = polar("4", np.array([3.5e-6, 0.0]), 1e-12 * np.eye(2), 1e4, "rad").amplitude
    assert doubtful.low > 1e-7
    assert outcome_against(doubtful, 1e-7, is_upper=False) == "MARGINAL"
    clear = polar("4", np.array([9e-6, 0.0]), 1e-12 * np.eye(2), 1e4, "rad").amplitude
    assert outcome_against(clear, 1e-7, is_upper=False) == "PASS"


def test_what_widens_is_said() -> None:
    result = of(estimate("size", 1.0, 0.1), warnings=("before",))
    assert concluded(result, (WIDER, OK), recorded(result)).warnings == ("before", WIDER.follows)


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
    assert {check.what for check in found.checks} >= {"gaps", "time axis"}


def test_a_check_is_stored_in_the_words_of_0_1_0_and_read_back() -> None:
    wider = Finding(
        "age of the tare", Severity.NOTES, "9 days", allowed="7 days", follows="The tare is old."
    )
    checks = (OK, MISSING, BESIDE, wider)
    stored = checks_to_mapping(checks)
    assert stored[1:2] + stored[3:] == [
        {
            "name": "torque zero",
            "outcome": "not checked",
            "found": "",
            "allowed": "",
            "words": "no zero",
            "is_evidence": True,
        },
        {
            "name": "age of the tare",
            "outcome": "widened",
            "found": "9 days",
            "allowed": "7 days",
            "words": "The tare is old.",
            "is_evidence": True,
        },
    ]
    assert checks_from_mapping(stored) == checks
    with pytest.raises(ValueError, match="outcome 'splendid'"):
        checks_from_mapping([{"name": "gaps", "outcome": "splendid"}])


def test_a_note_speaks_in_the_unit_of_its_row() -> None:
    torque = Quantity(name="t", title="", unit="N m", shown="mN m", target_uncertainty=0.01)
    small = Estimate(name="t", value=0.001, unit="N m", low=-0.0611, high=0.0631)
    assert "below 63." in judged(torque, small).note
    assert judged(torque, small).note.endswith("mN m")
    plain = dataclasses.replace(torque, shown="")
    assert judged(plain, small).note.endswith("mN m")
