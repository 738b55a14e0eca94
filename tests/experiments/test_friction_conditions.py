"""What else than speed friction depends on: the place on the output, and warmth."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from experiments.contract import Evidence
from experiments.protocols.friction import analysis as friction
from experiments.protocols.friction import influences
from experiments.protocols.friction.estimates import at_20_degrees, coefficients_of
from experiments.protocols.friction.influences import FittedCurve
from experiments.protocols.friction.points import measure_friction, reproducibility
from experiments.protocols.friction.temperature import THERMOMETRY, VISCOUS, temperature_law
from experiments.recording import ArraySource, Recording
from experiments.result import Result
from model.gear import HarmonicDrive
from model.identify.common_errors import CommonError, Spread
from model.identify.friction import fit_friction
from tests.model.identify.rigs import SPEEDS, sweep


@pytest.mark.parametrize("order", [1, 7])
def test_friction_that_varies_over_the_output_is_brought_to_its_mean(
    order: int, friction_run: Recording, gear: HarmonicDrive, tare: Result
) -> None:
    source = friction_run.source
    assert isinstance(source, ArraySource)
    place = friction_run.output_angle()
    shown = friction_run.si("torque") - 0.01
    depth = 0.02 * 0.04 * np.cos(order * place) * np.sign(shown)
    varied = np.round((shown + depth + 0.01) / friction_run.signals["torque"].scale).astype(int)
    run = dataclasses.replace(
        friction_run, source=dataclasses.replace(source, arrays={**source.arrays, "torque": varied})
    )
    result = friction.analyse(run, Evidence(gear, tare))
    before = reproducibility(measure_friction(run, Evidence(gear, tare)).bracket)
    assert result.metrics["reproducibility"] < 0.5 * before
    assert result.metrics[f"friction_over_output_order_{order}"] == pytest.approx(0.02, rel=0.3)
    assert "place on the output" in result.options["points_brought_to"]
    assert result.estimates["coulomb"].value == pytest.approx(gear.mesh_friction.coulomb, rel=0.02)
    # What was measured stands beside what it was brought to, and how far that is.
    drawn = result.plots[0]
    raw, corrected = (
        next(s for s in drawn.series if s.label == label) for label in ("as measured", "corrected")
    )
    assert len(raw.x) == len(corrected.x)
    moved = float(np.abs(raw.y - corrected.y).max())
    assert moved > 0.1
    assert f"moved points by up to {moved:.2g} mN m" in drawn.note


def test_waves_over_the_output_vary_together_as_much_as_was_seen_of_fewer(
    friction_run: Recording, gear: HarmonicDrive, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The repetitions size some of the orders; the fit gives that size to all of them."""
    seen, found = 0.004, list[Spread]()
    spread_of = influences.spread_of

    def noted(*given: Any) -> Spread:
        found.append(spread_of(*given))
        return found[-1]

    monkeypatch.setattr(influences, "spread_beyond", lambda *given: (0.001, seen))
    monkeypatch.setattr(friction, "spread_of", noted)
    friction.analyse(friction_run, Evidence(gear))
    sized = min(found[-1].freedom // 3, len(influences.PLACE_ORDERS))
    assert 0 < sized < len(influences.PLACE_ORDERS)
    together = len(influences.PLACE_ORDERS) * found[-1].place ** 2
    assert together == pytest.approx(sized * seen**2)


def test_a_thermometer_that_is_off_moves_what_is_brought_to_20_degrees_alone() -> None:
    law = temperature_law({}, 30.0, 0.2)
    assert law.dry_factor({THERMOMETRY: 1.0}) == pytest.approx(1.0 - 0.005 * 10.2)
    assert law.viscous_factor({THERMOMETRY: -1.0}) == pytest.approx(math.exp(-0.0225 * 9.8))
    assert temperature_law({}, math.nan, 0.2).viscous_factor({THERMOMETRY: 1.0}) == 1.0


def test_the_budget_holds_the_thermometer_where_a_number_is_brought(gear: HarmonicDrive) -> None:
    holds = sweep(gear, 1, SPEEDS)
    off = CommonError(source=THERMOMETRY, effect=np.zeros(len(holds)))
    fit = fit_friction(holds, gear, common=[off], profile=False)
    curve = FittedCurve(
        gear=gear,
        balance=fit.torque_balance,
        values=fit.stribeck.values,
        law=temperature_law({}, 30.0, 0.2),
    )
    used = coefficients_of(fit, curve, span=1.0)
    (brought,) = [
        e for e in at_20_degrees(fit, curve, used).values() if e.name.startswith("coulomb")
    ]
    lines = {line.source: line.standard_uncertainty for line in brought.budget}
    assert lines[THERMOMETRY] == pytest.approx(0.2 * 0.005 / 0.95 * brought.value, rel=0.01)
    assert THERMOMETRY not in {line.source for line in fit.estimates["coulomb"].budget}


def test_the_law_of_temperature_brings_to_20_degrees() -> None:
    assumed = temperature_law({}, 30.0)
    assert assumed.dry_factor({}) == pytest.approx(0.95)
    assert assumed.viscous_factor({}) == pytest.approx(math.exp(-0.225))
    given = {"viscous_per_kelvin": (-0.03, 0.004), "per_kelvin_source": "runs 12 to 19"}
    law = temperature_law(given, 30.0)
    assert law.viscous_factor({VISCOUS: 1.0}) == pytest.approx(math.exp(-0.28))
    assert law.viscous.source == "runs 12 to 19"
    assert not temperature_law({}, math.nan).is_known
