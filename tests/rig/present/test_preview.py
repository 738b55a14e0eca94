"""Previews of plans: the same plan as the dry run, sensitivities by hand, a simulated gear inside
its predicted band.
"""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest

from experiments import catalogue
from experiments.protocols.friction.temperature import ASSUMED
from experiments.recording import Recording
from experiments.steps.vocabulary import (
    HoldRevolutions,
    HoldTime,
    Prompt,
    Ramp,
    SegmentLabel,
    ServoOff,
    SpeedStep,
    TorqueRamp,
)
from model.friction import friction_torque
from model.gear import HarmonicDrive, Origin
from model.gear_file import shipped_gear
from model.linear import dynamic_parameters, torsional_mode
from model.motor import shipped_motor
from model.units import REVOLUTION
from rig.bench import limits as lim
from rig.bench.backends.order import Order
from rig.bench.limits import load_of
from rig.main import run as main
from rig.present.preview.figures import figures_of
from rig.present.preview.output import OutputModel
from rig.present.preview.plan import PlanPreview, preview_plan, torque_model
from rig.present.preview.torque import COVERAGE, DOUBT, WARMTH, TorqueModel
from rig.run.dry_run import PlannedRun, plan_run
from rig.run.start import plan_order, run_order
from rig.runfile.read import close_recording, open_run
from tests.rig.fake_rig import NoChoice, experiment_of, planned_of

GEAR, MOTOR = shipped_gear(), shipped_motor()


def planned(name: str, **values: Any) -> PlannedRun:
    experiment = catalogue.load(name)
    return plan_run(experiment, experiment.parameters(**values), GEAR, MOTOR)


def known(gear: HarmonicDrive, relative: float) -> HarmonicDrive:
    """The gear with every number known to this relative standard uncertainty."""
    origins = {v.path: Origin("identified", "test", relative * abs(v.value)) for v in gear.values()}
    return dataclasses.replace(gear, origins=MappingProxyType({**gear.origins, **origins}))


@pytest.mark.parametrize("name", catalogue.names())
def test_the_timeline_is_the_dry_run(name: str) -> None:
    plan = planned(name)
    preview = preview_plan(plan)
    course = preview.timeline
    assert course.duration == pytest.approx(plan.nominal, abs=1e-6)
    np.testing.assert_allclose(course.start[1:], course.stop[:-1], atol=1e-9)
    assert np.abs(preview.speed).max() <= max(step.speed for step in plan.steps) + 1e-9
    turned = np.sum(np.abs(0.5 * (preview.speed[1:] + preview.speed[:-1]) * np.diff(preview.time)))
    # A speed step that the drive's ramp shapes turns a little less than one that is there at once.
    assert turned / REVOLUTION == pytest.approx(plan.input_revolutions, rel=0.01)
    assert np.isfinite(preview.torque.value).all()
    assert (preview.torque.uncertainty >= 0.0).all()
    assert {margin.quantity for margin in preview.margins} == {
        margin.quantity for margin in plan.margins
    }
    assert len(preview.timeline.polyline()[0]) <= 2 * len(course.start)


def test_pieces_prompts_and_torque_ramps_stand_where_they_belong() -> None:
    plan = planned_of(
        ServoOff(1.0),
        Prompt("Is the gear off?"),
        Ramp(20.0, 100.0),
        HoldTime(2.0),
        Ramp(-20.0, 100.0),
        Ramp(0.0, 100.0),
        TorqueRamp(-0.02, 0.4, 0.05),
        ServoOff(1.0),
    )
    preview = preview_plan(plan)
    mark = preview.marks[0]
    assert (mark.kind, mark.text) == ("prompt", "Is the gear off?")
    assert mark.time == pytest.approx(1.0)
    time, speed = preview.timeline.polyline()
    assert np.interp([1.06, 2.0, 3.5], time, speed) == pytest.approx([1.0, 20.0, -5.0])
    ramp_time, torque = preview.timeline.torque_line()
    assert len(ramp_time) == 3
    assert torque[1] == pytest.approx(-float(preview.starting.value), rel=0.02)


def test_running_torque_is_equation_20_and_the_motor() -> None:
    model = TorqueModel(GEAR, MOTOR, load_of(GEAR, MOTOR, "circular-spline-fixed"))
    speed = np.array([0.1, 6.0, 50.0, 300.0])
    own = MOTOR.coulomb_friction + MOTOR.viscous_friction * speed
    np.testing.assert_allclose(model.running(speed).value, friction_torque(GEAR, speed) + own)
    np.testing.assert_allclose(model.running(-speed).value, model.running(speed).value)
    inertia = MOTOR.rotor_inertia + GEAR.inertia.wave_generator + GEAR.inertia.output / 120.0**2
    found = model.torque(-50.0, 800.0, -1.0)
    assert found.value == pytest.approx(inertia * 800.0 - float(model.running(50.0).value))
    standing = model.torque(0.0, 0.0, 0.0)
    assert standing.value == 0.0
    assert standing.high == pytest.approx(float(model.starting().high))


def test_the_uncertainty_is_the_root_sum_square_of_finite_differences() -> None:
    model = TorqueModel(GEAR, MOTOR, load_of(GEAR, MOTOR, "circular-spline-fixed"))
    speed, alpha = np.array([0.5, 6.0, 40.0, 250.0]), 300.0

    def total(gear: HarmonicDrive, motor: Any) -> np.ndarray:
        return (
            TorqueModel(gear, motor, load_of(gear, motor, "circular-spline-fixed"))
            .torque(speed, alpha, 1.0)
            .value
        )

    variance = (ASSUMED["viscous"].value * WARMTH * friction_torque(GEAR, speed)) ** 2
    paths = [
        *(
            f"mesh_friction.{name}"
            for name in ("coulomb", "static", "stribeck_velocity", "shape", "viscous")
        ),
        "bearing.friction_factor",
        "bearing.viscosity",
        "inertia.wave_generator",
        "inertia.output",
    ]
    for path in paths:
        value = GEAR.value(path)
        step = 1e-5 * value.value
        slope = (
            total(GEAR.with_values({path: value.value + step}), MOTOR) - total(GEAR, MOTOR)
        ) / step
        variance = variance + (slope * DOUBT[value.origin.provenance] * value.value) ** 2
    for name in ("coulomb_friction", "viscous_friction", "rotor_inertia"):
        value = getattr(MOTOR, name)
        moved = dataclasses.replace(MOTOR, **{name: 1.00001 * value})
        slope = (total(GEAR, moved) - total(GEAR, MOTOR)) / (1e-5 * value)
        variance = variance + (slope * DOUBT[MOTOR.origins[name].provenance] * value) ** 2
    np.testing.assert_allclose(
        model.torque(speed, alpha, 1.0).uncertainty, COVERAGE * np.sqrt(variance), rtol=1e-3
    )


def test_a_stated_uncertainty_replaces_the_doubt_of_the_provenance() -> None:
    load = load_of(GEAR, MOTOR, "circular-spline-fixed")
    wide, narrow = (
        TorqueModel(gear, MOTOR, load).running(100.0) for gear in (GEAR, known(GEAR, 0.001))
    )
    assert narrow.value == pytest.approx(float(wide.value))
    assert narrow.uncertainty < 0.5 * wide.uncertainty
    # Warmth and the motor remain, however well the gear is known.
    assert narrow.uncertainty > 0.1 * narrow.value


def test_the_output_follows_quasi_statically_and_rings_at_its_mode() -> None:
    output = OutputModel(GEAR, "circular-spline-fixed")
    mode = torsional_mode(dynamic_parameters(GEAR))
    assert mode is not None
    assert output.response(1e-3) == pytest.approx(1.0, abs=1e-6)
    at_mode = output.response(mode.natural_frequency)
    assert at_mode == pytest.approx(0.5 / mode.damping_ratio, rel=0.1)
    slow, _ = output.ripple(1.0)
    assert slow == pytest.approx(sum(h.order * h.amplitude for h in GEAR.kinematic_error), rel=1e-4)
    _, torque = output.ripple(mode.natural_frequency / 2.0)
    amplitude = next(h.amplitude for h in GEAR.kinematic_error if h.order == 2.0)
    assert (
        torque
        > GEAR.inertia.output * mode.natural_frequency**2 * amplitude * 0.4 / mode.damping_ratio
    )
    error = output.kinematic_error()
    assert error.value[0] == pytest.approx(error.value[-1])


def measured(recording: Recording) -> list[tuple[float, int, np.ndarray]]:
    """Set-point, direction and torque [N m] over the torque zero of every hold and bracket."""
    zeros = [s for s in recording.segments if s.label.startswith("torque-zero")]
    zero = np.mean([recording.si("torque", slice(s.start, s.stop)).mean() for s in zeros])
    return [
        (s.setpoint, s.direction, recording.si("torque", slice(s.start, s.stop)) - zero)
        for s in recording.segments
        if s.label in ("hold", "bracket", "step")
    ]


def simulated(
    folder: Path, protocol: str, gear: HarmonicDrive, **values: Any
) -> tuple[PlannedRun, Any]:
    request = Order(
        protocol=protocol,
        gear=gear,
        motor=MOTOR,
        folder=folder,
        values={"zero_time": 0.5, **values},
        serial="SN-1",
        seed=3,
    )
    plan = plan_order(request)
    recording = open_run(run_order(request, plan).path)
    try:
        return plan, measured(recording)
    finally:
        close_recording(recording)


FRICTION = {
    "speeds_rpm": (60.0, 200.0, 800.0, 2500.0),
    "up_and_down": False,
    "measure_time": 0.3,
    "settle_time": 0.2,
    "bracket_every": 10,
}


def test_a_simulated_gear_turns_within_its_predicted_band_and_a_stiffer_one_does_not(
    tmp_path: Path,
) -> None:
    plan, holds = simulated(tmp_path, "friction", GEAR, **FRICTION)
    model = torque_model(dataclasses.replace(plan, gear=known(GEAR, 0.05)))
    inside, samples = 0, 0
    for setpoint, direction, torque in holds:
        band = model.torque(setpoint, 0.0, direction)
        assert float(band.low) < torque.mean() < float(band.high)
        inside += int(np.sum((torque > band.low) & (torque < band.high)))
        samples += len(torque)
        # The band says something: it is not the whole range.
        assert float(band.uncertainty) < 0.3 * abs(float(band.value))
    assert inside > 0.9 * samples
    # A gear with almost twice the friction that the model was told is seen at every speed.
    rough = GEAR.with_values({"mesh_friction.coulomb": 130.0, "mesh_friction.static": 180.0})
    _, holds = simulated(tmp_path, "friction", rough, **{**FRICTION, "speeds_rpm": (100.0, 1500.0)})
    for setpoint, direction, torque in holds:
        band = model.torque(setpoint, 0.0, direction)
        assert abs(torque.mean()) > abs(float(band.value)) + float(band.uncertainty)


def test_the_peak_of_a_simulated_step_is_within_its_prediction(tmp_path: Path) -> None:
    plan, steps = simulated(tmp_path, "velocity-steps", GEAR, speeds_rpm=(600.0, 1800.0), repeats=1)
    peaks = [peak for peak in preview_plan(plan).peaks if "(step" in peak.where]
    assert len(peaks) == len(steps) == 4
    for peak, (_, _, torque) in zip(peaks, steps, strict=True):
        assert abs(np.abs(torque).max() - peak.torque) < peak.torque_uncertainty


def test_the_share_of_the_output_rings_between_nothing_and_twice_itself() -> None:
    model = TorqueModel(GEAR, MOTOR, load_of(GEAR, MOTOR, "circular-spline-fixed"))
    share = GEAR.inertia.output / 120.0**2
    np.testing.assert_allclose(model.ringing([0.0, 800.0, -800.0]), [0.0, 800 * share, 800 * share])
    assert torque_model(planned("motor-tare")).ringing(800.0) == 0.0
    preview = preview_plan(planned_of(Ramp(100.0, 800.0), HoldTime(1.0)))
    rigid = model.torque(100.0, np.array([800.0, 0.0]), 1.0).uncertainty
    ramp, hold = (preview.torque.uncertainty[preview.step == step][-1] for step in (0, 1))
    assert (ramp, hold) == pytest.approx((np.hypot(rigid[0], 800 * share), rigid[1]))


def touching() -> PlanPreview:
    """A step at the drive's ramp: 0.8 of the torque limit by construction, more with the
    uncertainty of assumed numbers.
    """
    load = GEAR.with_values(
        {"inertia.wave_generator": GEAR.inertia.wave_generator}, Origin("recalled", "from memory")
    ).with_values({"inertia.output": 0.1}, Origin("assumed", "a guess", 0.15))
    label = SegmentLabel("step", 100.0, 1)
    steps = (HoldTime(0.2), SpeedStep(100.0, 1.0, segment=label), HoldRevolutions(2.0, 9.0))
    return preview_plan(plan_run(experiment_of(steps), NoChoice(), load, MOTOR))


def test_a_prediction_that_touches_a_limit_names_step_value_and_limit() -> None:
    preview = touching()
    margin = next(m for m in preview.margins if m.quantity == lim.MOTOR_TORQUE)
    assert margin.margin > 0.0 > margin.least_margin
    assert margin.touches
    warning = next(w for w in preview.warnings if w.quantity == lim.MOTOR_TORQUE)
    assert warning.step == 1
    for word in ("step 2", "N m", "±", f"{margin.limit.value:.4g}", "margin"):
        assert word in warning.text
    calm = preview_plan(planned("kinematic-error"))
    assert not calm.warnings


def test_a_torque_ramp_that_may_not_move_the_gear_says_so() -> None:
    weak = preview_plan(planned_of(TorqueRamp(0.02, 0.06, 0.05), HoldTime(0.5)))
    assert any("may not begin to turn in step 1" in warning.text for warning in weak.warnings)
    assert not preview_plan(planned("starting-torque")).warnings


def test_the_work_of_a_preview_is_bounded_by_the_number_of_steps() -> None:
    plan = planned("friction", points=90)
    preview = preview_plan(plan)
    assert len(preview.time) < 12 * len(plan.plan)
    assert len(preview.peaks) <= len(plan.plan)
    # However long the plan, what is drawn is bounded, and no peak is lost.
    drawn = figures_of(preview)["torque"].series[0]
    assert drawn.high is not None
    assert len(drawn.x) <= 8 * 1500
    assert drawn.high.max() == preview.torque.high.max()


def test_figures_carry_units_and_the_limit_where_it_is_near() -> None:
    figures = figures_of(preview_plan(planned("velocity-steps")))
    assert set(figures) == {"speed", "torque", "output", "kinematic-error", "friction"}
    for plot in figures.values():
        assert "[" in plot.x_label
        assert "[" in plot.y_label
        assert all(len(series.x) == len(series.y) for series in plot.series)
    assert any("limit" in series.label for series in figures["torque"].series)
    bare = figures_of(preview_plan(planned("motor-tare")))
    assert set(bare) == {"speed", "torque", "friction"}
    assert any("prompts: 1" in series.label for series in bare["speed"].series)
    assert "outside the picture" in bare["torque"].title


def test_the_command_prints_json_and_figures(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as end:
        main(["plan", "home", "--json", "--figures", str(tmp_path)])
    assert not end.value.code
    told = json.loads(capsys.readouterr().out)
    assert len(told["figures"]) == 5
    assert all(Path(path).stat().st_size > 5000 for path in told["figures"])
    assert told["prediction"]["starting_torque"]["value"] > 0.0
    assert told["samples"] > 0
    with pytest.raises(SystemExit) as end:
        main(["plan", "home", "--gear", "SN-1", "--runs", str(tmp_path)])
    assert not end.value.code
    assert "SN-1 has no card: what is planned rests on" in capsys.readouterr().err
