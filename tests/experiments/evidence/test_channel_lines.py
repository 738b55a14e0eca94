"""A protocol that says nothing of its channels gets the right U, and its scatter alone is never "yes"."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from experiments.contract import Evidence, Experiment, NoParameters, no_plan
from experiments.errors import AnalysisError
from experiments.evidence.conclusion import checked_analysis
from experiments.quantity import Quantity
from experiments.recording import Recording
from experiments.result import Covariance, Result
from model.gear_file import shipped_gear
from model.identify.estimate import Estimate
from tests.experiments.evidence.test_conclusion import concluded, of, recorded
from tests.experiments.evidence.test_conclusion import estimate as named
from tests.experiments.test_analyses_without_plan import foreign

SCALE = 0.03
"""What is assumed of a torque that nobody calibrated."""


def analysed(quantity: Quantity, largest: float = np.inf) -> Estimate:
    """The mean torque of a recording, 0.1 N m with a scatter of 0.1 mN m, as a protocol of one's own states it."""

    def analyse(recording: Recording, evidence: Evidence) -> Result:
        mean = float(recording.si("torque").mean())
        if mean > largest:
            raise AnalysisError("too much", where="torque")
        value = Estimate(name="mean", value=mean, unit="N m", low=mean - 1e-4, high=mean + 1e-4)
        return Result(run="r", kind="own", quantities=(quantity,), estimates={"mean": value})

    kind = Experiment(
        name="own",
        title="",
        summary="",
        parameters=NoParameters,
        plan=no_plan,
        analyse=analyse,
        needs=(),
        has_plan=False,
        quantities=(quantity,),
    )
    time = np.arange(0.0, 1.0, 1e-3)
    run = foreign(time, torque=(np.full(len(time), 0.1), "N m"))
    return checked_analysis(kind)(run, Evidence(shipped_gear())).estimates["mean"]


@pytest.mark.parametrize("rests_on", [None, {"torque": "difference"}, {"torque": "proportional"}])
def test_the_scale_of_the_channel_is_in_u_declared_or_not(rests_on: object) -> None:
    quantity = Quantity(name="mean", title="mean", unit="N m", rests_on=rests_on)  # type: ignore[arg-type]
    found = analysed(quantity)
    # Nobody stated the scale: it is there, and most of U, so that the number is no "yes".
    assert found.identifiable == "weakly"
    assert found.note.startswith("rests on an assumed torque scale")
    lines = {line.source: line.standard_uncertainty for line in found.budget}
    assert lines["torque scale"] == pytest.approx(SCALE * 0.1)
    assert lines["statistical part"] == pytest.approx(1e-4 / 1.96, rel=1e-3)
    assert found.expanded_uncertainty > 1.6 * SCALE * 0.1


def test_what_is_declared_to_rest_on_nothing_gets_no_line() -> None:
    quantity = Quantity(name="mean", title="mean", unit="N m", rests_on={"torque": "none"})
    assert analysed(quantity).budget == ()


def test_the_scatter_alone_is_weakly() -> None:
    found = analysed(Quantity(name="mean", title="mean", unit="N m"), largest=0.101)
    assert found.identifiable == "weakly"
    assert "scatter alone" in found.note


def test_what_hangs_on_a_parameter_at_its_bound_is_weakly() -> None:
    matrix = np.array([[1.0, 0.2], [0.2, 1.0]])
    both = of(named("size", 9.0, 0.1), named("aimed", 9.0, 0.1))
    for r, called in ((0.05, "yes"), (-0.3, "weakly")):
        matrix = np.array([[1.0, r], [r, 1.0]])
        covariance = Covariance(("size", "aimed"), matrix, at_bound=("aimed",))
        found = concluded(dataclasses.replace(both, covariance=covariance), (), recorded(both))
        assert found.estimates["size"].identifiable == called
        assert found.estimates["aimed"].identifiable == "weakly"
        assert ("aimed" in found.estimates["size"].note) == (called == "weakly")
