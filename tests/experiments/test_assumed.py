"""What nobody says is assumed, marked so, and never makes a number sure."""

from __future__ import annotations

import dataclasses
import math
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from experiments import catalogue
from experiments.assumed import (
    CURRENT,
    MOTOR_ENCODER,
    OUTPUT_ENCODER,
    TABLE,
    TORQUE_SCALE,
    TORQUE_ZERO,
    assumed_kinds,
    replacing,
    rests_on,
)
from experiments.budget import scale_line, timed, zero_uncertainty
from experiments.contract import Evidence
from experiments.evidence.conclusion import judged
from experiments.load import carrying, load_of
from experiments.protocols.kinematic_error import analysis as kinematic_error
from experiments.protocols.kinematic_error.traverses import spring_of, stated_mode
from experiments.quantity import Quantity
from experiments.recording import Recording
from experiments.tares.motor_heat import motor_heat
from experiments.torque.zero import torque_zero
from model.channel import Calibration
from model.gear import HarmonicDrive, Origin
from model.identify.estimate import BudgetLine, Cause, Estimate
from model.identify.torsion import StatedMode, Torsion, UnstatedMode
from model.motor import shipped_motor
from model.units import ARCSEC
from rig.bench.backends.hardware import can_rig_config
from rig.bench.config.load import load_configuration
from tests.experiments.test_analyses_without_plan import foreign, stating

TEMPLATE = resources.files("rig.bench.config").joinpath("template.toml")
TIME = np.arange(0.0, 1.0, 1e-2)
LENGTH = Quantity(name="length", title="length", unit="m", target_uncertainty=0.5)


def one(*lines: BudgetLine) -> Estimate:
    return Estimate(name="length", value=10.0, unit="m", low=9.9, high=10.1, budget=lines)


def test_every_row_says_how_large_why_and_what_replaces_it() -> None:
    assert len({row.kind for row in TABLE}) == len(TABLE)
    for row in TABLE:
        assert row.standard_uncertainty > 0.0
        assert all((row.what, row.bounds, row.source, row.reason, row.replaced_by)), row.kind


def test_a_number_that_rests_on_an_assumed_line_is_weakly() -> None:
    known = BudgetLine("scatter", "A", 0.05)
    small, large = (TORQUE_SCALE.line("scale", size) for size in (0.04, 0.06))
    assert judged(LENGTH, one(known, small)).identifiable == "yes"
    told = judged(LENGTH, one(known, large))
    assert told.identifiable == "weakly"
    assert told.note == rests_on(told) == "rests on an assumed torque scale"
    stated = dataclasses.replace(large, assumed="")
    assert judged(LENGTH, one(known, stated)).identifiable == "yes"


def test_a_scale_of_zero_is_believed_and_one_that_is_not_said_is_not_zero() -> None:
    unsaid = foreign(TIME, torque=(TIME, "N m"), current=(TIME, "A"))
    assert scale_line(unsaid, 2.0).assumed == TORQUE_SCALE.kind
    assert scale_line(unsaid, 2.0).standard_uncertainty == pytest.approx(0.06)
    assert scale_line(unsaid, 2.0, "current").assumed == CURRENT.kind
    line = scale_line(stating(unsaid, "torque", scale_relative_uncertainty=0.0), 2.0)
    assert (line.standard_uncertainty, line.assumed) == (0.0, "")


def test_a_zero_that_nobody_read_is_a_share_of_the_largest_torque() -> None:
    unsaid = foreign(TIME, torque=(5.0 * TIME / TIME[-1], "N m"))
    size, row = zero_uncertainty(unsaid)
    assert row is TORQUE_ZERO
    assert size == pytest.approx(0.02 / np.sqrt(3.0) * 5.0)
    assert torque_zero(unsaid).budget().assumed == TORQUE_ZERO.kind
    assert zero_uncertainty(stating(unsaid, "torque", offset_uncertainty=0.0)) == (0.0, None)


@pytest.mark.parametrize(
    ("unit", "power"),
    [
        ("N m s/rad", 1),
        ("rad/s", -1),
        ("rad/s2", -2),
        ("Hz", -1),
        ("s", 1),
        ("kg m2", 2),
        ("rad", 0),
    ],
)
def test_a_rate_that_somebody_said_is_a_line_of_what_goes_with_time(unit: str, power: int) -> None:
    run = foreign(TIME, torque=(TIME, "N m"))
    nominal = dataclasses.replace(
        run, metadata=dataclasses.replace(run.metadata, time_base="nominal")
    )
    stated = dataclasses.replace(one(BudgetLine("scatter", "A", 1e-3)), unit=unit)
    assert timed(stated, run) == stated
    found = [line for line in timed(stated, nominal).budget if line.assumed == "time base"]
    assert [line.standard_uncertainty for line in found] == pytest.approx(
        [abs(power) * 10.0 * 0.005 / np.sqrt(3.0)] if power else []
    )


def test_the_temperature_of_a_motor_that_nobody_recorded_is_assumed() -> None:
    unsaid = foreign(TIME, torque=(TIME, "N m"))
    assert motor_heat(unsaid, float("nan")).line(1.0).assumed == "temperature"


def without(recording: Recording, **stated: float | None) -> Recording:
    """The recording with the accuracies of its encoders as given."""
    signals = {
        name: dataclasses.replace(recording.signals[name], calibration=Calibration(accuracy=value))
        for name, value in stated.items()
    }
    return dataclasses.replace(recording, signals={**recording.signals, **signals})


def test_orders_of_the_output_are_never_sure_without_a_stated_encoder(
    kinematic_error_run: Recording, gear: HarmonicDrive
) -> None:
    def analysed(**stated: float | None) -> dict[str, Estimate]:
        run = without(kinematic_error_run, **stated)
        return dict(kinematic_error.analyse(run, Evidence(gear)).estimates)

    unsaid = analysed(input_angle=None, output_angle=None)
    said = analysed(input_angle=0.0, output_angle=0.0)
    orders = [f"amplitude_{k}/N" for k in range(1, 9) if f"amplitude_{k}/N" in unsaid]
    assert not [n for n in orders if unsaid[n].identifiable == "yes"]
    assert [n for n in orders if said[n].identifiable == "yes"]
    name = "transmission_accuracy_forward"
    assert assumed_kinds(unsaid[name])[0] == OUTPUT_ENCODER.kind
    assert MOTOR_ENCODER.kind in assumed_kinds(unsaid[name])
    assert rests_on(unsaid[name])
    assert unsaid[name].expanded_uncertainty > 10.0 * said[name].expanded_uncertainty
    # Nothing is taken off a value for an encoder that nobody stated.
    assert unsaid[name].value == pytest.approx(said[name].value, rel=5e-3)


def test_the_load_of_another_gear_tells_no_resonance(gear: HarmonicDrive) -> None:
    unstated = spring_of(gear, 120.0)
    assert isinstance(unstated, UnstatedMode)
    assert unstated.line.assumed == "output inertia"
    inertia = {"inertia.output": gear.inertia.output}
    stated = gear.with_values(inertia, Origin("measured", "gear card of 7"))
    assert isinstance(spring_of(stated, 120.0), Torsion)
    assert isinstance(spring_of(gear, 120.0, is_simulated=True), Torsion)
    half = unstated.response(np.array([unstated.first_mode * 0.2]))[0]
    assert half == pytest.approx(1.0 / (1.0 - 0.5 * 0.04))


def test_a_resonance_that_the_import_states_is_used(kinematic_error_run: Recording) -> None:
    metadata = dataclasses.replace(
        kinematic_error_run.metadata, process={"stated": {"resonance_hz": 50.0}}
    )
    mode = stated_mode(dataclasses.replace(kinematic_error_run, metadata=metadata))
    assert isinstance(mode, StatedMode)
    assert mode.first_mode == pytest.approx(100.0 * np.pi)
    assert stated_mode(kinematic_error_run) is None


def test_an_inertia_that_the_import_states_is_used_and_the_assumed_line_goes(
    kinematic_error_run: Recording, gear: HarmonicDrive
) -> None:
    def imported(stated: dict[str, float], named: HarmonicDrive | None) -> Recording:
        metadata = dataclasses.replace(
            kinematic_error_run.metadata,
            process={"stated": stated},
            origin="imported",
            gear=named,
        )
        return dataclasses.replace(kinematic_error_run, metadata=metadata)

    def kinds(recording: Recording) -> set[str]:
        result = catalogue.load("kinematic-error").analyse(recording, Evidence(gear))
        return {line.assumed for e in result.estimates.values() for line in e.budget}

    said = imported({"load_inertia_kg_m2": 0.3}, gear)
    assert "output inertia" in kinds(imported({}, gear))
    assert "output inertia" not in kinds(said)
    assert carrying(said, gear).inertia.output == 0.3
    assert (load_of(said, gear).inertia, load_of(said, gear).is_stated) == (0.3, True)
    # Of a gear that nobody named, the stiffness is not known: its inertia alone makes no mode.
    unnamed = imported({"load_inertia_kg_m2": 0.3}, None)
    assert "output inertia" in kinds(unnamed)
    assert load_of(unnamed, gear).inertia == 0.3


def test_an_accuracy_class_is_divided_once_on_its_way_into_the_budget(
    tmp_path: Path, kinematic_error_run: Recording, gear: HarmonicDrive
) -> None:
    """A class of ± a is a rectangle: u = a/sqrt(3), and rig.toml states a."""
    path = tmp_path / "rig.toml"
    path.write_text(TEMPLATE.read_text(encoding="utf-8"), encoding="utf-8")
    described = load_configuration(path)
    counter = can_rig_config(described, shipped_motor(), tmp_path, 2_000_000).counters[0]
    half_width = 5.0 * ARCSEC
    assert counter.calibration.accuracy == pytest.approx(half_width, rel=0.02)
    signals = dict(kinematic_error_run.signals)
    signals["output_angle"] = dataclasses.replace(
        signals["output_angle"], calibration=counter.calibration
    )
    result = catalogue.load("kinematic-error").analyse(
        dataclasses.replace(kinematic_error_run, signals=signals), Evidence(gear)
    )
    lines = result.estimates["transmission_accuracy_forward"].budget
    (line,) = [line for line in lines if line.cause is Cause.OUTPUT_ENCODER]
    assert line.standard_uncertainty == pytest.approx(half_width / math.sqrt(3.0), rel=0.02)
    assert not line.assumed


def test_what_states_it_is_named_by_kind() -> None:
    one = Estimate(name="torque", value=1.0, unit="N m", low=0.9, high=1.1).with_budget(
        [TORQUE_SCALE.line("scale", 0.04), BudgetLine("noise", "A", 0.001)]
    )
    known = Estimate(name="angle", value=1.0, unit="rad", low=0.9, high=1.1).with_budget(
        [BudgetLine("noise", "A", 0.01)]
    )
    assert replacing([one, known, one]) == {TORQUE_SCALE.kind: TORQUE_SCALE.replaced_by}
    assert replacing([known]) == {}
