"""The version of an analysis is raised when its numbers change: a small recording per kind pins them to it.

When a test here fails although no number was meant to change, the change has a defect. When the
new numbers are meant, raise `version` in the kind's EXPERIMENT, say why in the changelog, and pin
them:

    PIN_NUMBERS=1 python -m pytest tests/experiments/test_versions.py

The same recordings say which lines a budget has: the page of measurands reads them from `docs/budgets.json`, which is
written anew by the same command.
"""

from __future__ import annotations

import dataclasses
import json
import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from experiments import catalogue
from experiments.contract import Evidence
from experiments.protocols.velocity_steps import declaration as velocity_steps_declaration
from experiments.protocols.velocity_steps import plan as velocity_steps_plan
from experiments.recording import Recording
from experiments.result import Result
from model.gear import HarmonicDrive
from model.identify.estimate import Estimate
from tests.experiments.conftest import SERIES
from tests.experiments.recordings.test_friction_curve import BOTH as SPEEDS
from tests.experiments.recordings.test_friction_curve import friction, table
from tests.experiments.recordings.test_hysteresis import loops, recorded
from tests.experiments.recordings.test_skew import BOTH, encoders
from tests.experiments.synthetic import Bench, record
from tests.experiments.test_analyses_without_plan import axis, foreign

PINNED = Path(__file__).with_name("pinned.json")
"""By kind: the version of its analysis, and value and U (95 %) of every estimate."""
BUDGETS = Path(__file__).parents[2] / "docs" / "budgets.json"
"""By kind and quantity: source, type and note of every line of the budget."""
SAME, SAME_U = 1e-5, 5e-3
"""Relative, of a value and of its U; other processors and libraries agree to less. An iterative fit ends within a share
of its own scatter: on one recording 0.25 % of a U was seen between the instruction sets of processors."""


@pytest.fixture
def small(
    request: pytest.FixtureRequest, bench: Bench, gear: HarmonicDrive
) -> Callable[[str], Result]:
    """The analysis of a small recording of a kind."""

    def planned(kind: str, **values: Any) -> Recording:
        protocol = catalogue.load(kind)
        parameters = protocol.parameters(**values)
        given = dataclasses.asdict(parameters)
        return record(protocol.plan(parameters, gear), bench, kind, parameters=given)

    def recording(kind: str) -> Recording:
        if kind in ("kinematic-error", "revolution", "order-spectrum"):
            return request.getfixturevalue("kinematic_error_run")
        if kind in ("friction", "motor-tare"):
            return request.getfixturevalue("friction_run" if kind == "friction" else "tare_run")
        if kind == "compensated-error":
            return request.getfixturevalue("compensated_error_run")
        if kind == "torque-scale":
            return request.getfixturevalue("torque_scale_run")
        if kind == "motion":
            time, position, force = axis()
            return foreign(time, position=(position, "m"), force=(force, "N"))
        if kind == "skew":
            return encoders(50.0, -50.0, 200.0, -200.0)
        if kind == "hysteresis":
            return recorded(*loops())
        if kind == "friction-curve":
            return table(SPEEDS, friction(SPEEDS, 1.5))
        if kind == "velocity-steps":
            steps = velocity_steps_declaration.Parameters(
                speeds_rpm=(60.0, 1800.0, 2950.0), repeats=1
            )
            whole = tuple(h for h in SERIES if h.order in (1.0, 2.0, 4.0))
            ringing = Bench(gear=gear, error=whole, elastic=True)
            return record(velocity_steps_plan.plan(steps, gear), ringing, kind)
        if kind == "warm-up":
            return planned(kind, window=2.0, at_most=60.0)
        if kind == "starting-torque":
            return planned(kind, positions=2)
        if kind == "home":
            return planned(kind, input_speed_rpm=30.0, output_speed_rpm=120.0)
        pytest.fail(f"no small recording for {kind}: add one here")

    def analysed(kind: str) -> Result:
        tare = request.getfixturevalue("tare") if catalogue.load(kind).takes_tare else None
        settings: dict[str, Any] = dict(BOTH) if kind == "skew" else {}
        if kind in ("revolution", "order-spectrum"):
            settings = {"highest_order": 48 if kind == "revolution" else 12}
        return catalogue.load(kind).analyse(
            recording(kind), Evidence(gear, tare, settings=settings)
        )

    return analysed


@pytest.mark.parametrize("kind", catalogue.kinds())
def test_the_numbers_of_an_analysis_belong_to_its_version(
    kind: str, small: Callable[[str], Result]
) -> None:
    pinned = json.loads(PINNED.read_text(encoding="utf-8")) if PINNED.exists() else {}
    version = catalogue.load(kind).version
    result = small(kind)
    estimates = result.estimates
    numbers = {name: [e.value, e.expanded_uncertainty] for name, e in estimates.items()}
    assert numbers
    for name, estimate in estimates.items():
        assert is_of_one_thing(estimate), (name, estimate.low, estimate.value, estimate.high)
        assert not (missing := uncounted(estimate)), (name, missing)
    if os.environ.get("PIN_NUMBERS") and pinned.get(kind, {}).get("version") != version:
        pinned[kind] = {"version": version, "numbers": numbers}
        PINNED.write_text(json.dumps(pinned, indent=1) + "\n", encoding="utf-8")
    assert pinned.get(kind, {}).get("version") == version, (
        f"the version of {kind} is {version}, and its numbers are not pinned to it: "
        "PIN_NUMBERS=1 python -m pytest tests/experiments/test_versions.py"
    )
    changed = [
        name for name, pin in pinned[kind]["numbers"].items() if not same(numbers, name, pin)
    ]
    changed += sorted(numbers.keys() - pinned[kind]["numbers"].keys())
    assert not changed, (
        f"the analysis of {kind} gives other numbers than its version {version} did ({', '.join(changed)}): "
        "if that is meant, raise `version` in its EXPERIMENT and pin the new numbers "
        "(see the top of this file)"
    )
    told = json.loads(BUDGETS.read_text(encoding="utf-8")) if BUDGETS.exists() else {}
    if os.environ.get("PIN_NUMBERS"):
        told[kind] = budgets_of(result)
        text = json.dumps(told, indent=1, sort_keys=True, ensure_ascii=False)
        BUDGETS.write_text(text + "\n", encoding="utf-8")
    assert told.get(kind) == budgets_of(result), (
        f"docs/budgets.json tells of other budgets than {kind} has: write it as the top of this file says"
    )


def budgets_of(result: Result) -> dict[str, list[list[str]]]:
    """Source, type and note of each line of the budgets, each once per quantity that has a definition."""
    found: dict[str, list[list[str]]] = {}
    for name, estimate in result.estimates.items():
        quantity = result.quantity(name)
        if quantity.is_key or quantity.definition:
            lines = found.setdefault(quantity.name, [])
            lines += [
                row
                for line in estimate.budget
                if (row := [line.source, line.kind, line.note]) not in lines
            ]
    return found


def is_of_one_thing(estimate: Estimate) -> bool:
    """Whether the value lies in its own interval: what was taken off the one was taken off the other."""
    return estimate.low <= estimate.value <= estimate.high


def uncounted(estimate: Estimate) -> list[str]:
    """Lines of type A whose degrees of freedom nobody counted; a bound has none to count."""
    if not estimate.budget:
        return ["no budget at all"]
    return [
        line.source
        for line in estimate.budget
        if line.kind == "A"
        and math.isinf(line.degrees_of_freedom)
        and "rectangular" not in line.note
    ]


def same(numbers: dict[str, list[float]], name: str, pin: list[float]) -> bool:
    """Whether an estimate is what it was: to `SAME` of itself or of its uncertainty, and that to `SAME_U`."""
    if name not in numbers:
        return False
    value, expanded = numbers[name]
    return value == pytest.approx(pin[0], rel=SAME, abs=SAME * abs(pin[1])) and (
        expanded == pytest.approx(pin[1], rel=SAME_U, nan_ok=True)
    )
