"""Hand-made recordings, results and fits: what reports, stores and commands need, without a rig."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from experiments.protocols.friction.quantities import QUANTITIES as FRICTION
from experiments.quantity import quantity_of
from experiments.recording import ArraySource, Origin, Recording, RunMetadata, Segment
from experiments.result import Plot, Result, Series, Table
from model.channel import Channel
from model.gear_file import shipped_gear
from model.identify.estimate import BudgetLine, Cause, Estimate
from model.units import ARCMIN, RPM
from rig.analysis.fit.recorded import Fit
from rig.analysis.judging import GearVerdict, judge, not_judged
from rig.analysis.result_data import quantities_for
from rig.gears.acceptance import Acceptance, Limit, Use, acceptance_text


def estimate(name: str, value: float, unit: str, u: float, **more: Any) -> Estimate:
    """An estimate with an interval of two standard deviations and a budget of two lines."""
    budget = (
        BudgetLine("repeats", "A", u),
        BudgetLine("torque scale", "B", 0.5 * u, "certificate", Cause.TORQUE_SCALE),
    )
    return Estimate(
        name=name,
        value=value,
        unit=unit,
        low=value - 2 * u,
        high=value + 2 * u,
        budget=budget,
        **more,
    )


def recording(
    origin: Origin = "simulated", *, experiment: str = "friction", **more: Any
) -> Recording:
    """A recording of ten cycles with housing temperature."""
    rows = 10
    metadata = RunMetadata(
        run_id="R-000042",
        experiment=experiment,
        origin=origin,
        outcome="COMPLETED",
        start_time="2024-03-01T10:00:00+01:00",
        end_time="2024-03-01T10:05:00+01:00",
        operator="A. Example",
        gear=shipped_gear(),
        gear_serial="SN-0815",
        ratio=120.0,
        sample_rate=1000.0,
        time_base="virtual",
        parameters={"lowest_rpm": 1.0},
        conditions={"lubricant": "Harmonic Grease SK-1A"},
        process={"backend": "sim", "seed": 4},
        sha256="ab" * 32,
        is_sealed=True,
    )
    arrays = {
        "input_angle": np.arange(rows) * 100,
        "housing_temperature": np.linspace(240, 262, rows),
    }
    signals = {
        "input_angle": Channel(name="input_angle", unit="rad", scale=1e-3, is_counted=False),
        "housing_temperature": Channel(
            name="housing_temperature", unit="degC", scale=0.1, is_counted=False
        ),
    }
    segments = (
        Segment(index=0, label="hold", start=0, stop=5, setpoint=60 * RPM, direction=1),
        Segment(index=1, label="hold", start=5, stop=10, setpoint=-3000 * RPM, direction=-1),
    )
    source = ArraySource(arrays, np.arange(rows, dtype=np.int64) * 1_000_000)
    return Recording(replace(metadata, **more), signals, segments, (), source)


def friction_plot() -> Plot:
    """Measured points with error bars and a fitted curve, both directions."""
    speed = np.geomspace(1.0, 3000.0, 34)
    torque = 0.05 + 0.02 * np.exp(-speed / 60) + 2e-5 * speed
    series = []
    for group, (word, sign) in enumerate((("forward", 1.0), ("reverse", -1.0))):
        y = sign * torque
        series.append(
            Series(
                label=f"measured, {word}",
                x=speed,
                y=y,
                style="points",
                low=y - 0.003,
                high=y + 0.003,
                group=group,
            )
        )
        series.append(Series(label=f"fit, {word}", x=speed, y=y * 1.01, style="line", group=group))
    return Plot(
        name="friction",
        title="Friction torque at the input over speed",
        x_label="Input speed [r/min]",
        y_label="Torque [N m]",
        series=tuple(series),
        x_scale="log",
        figure="9, 17",
    )


def acceptance(
    limit: float = 0.15, confirmed_by: str = "A. Example", use: Use = "any"
) -> Acceptance:
    """What the gear of `friction_result` must show: one limit on its running torque."""
    running = Limit(
        quantity="friction.running_torque",
        unit="N m",
        source="specification 12",
        standing="customer",
        upper=limit,
        confirmed_by=confirmed_by,
        confirmed_on="2026-11-01" if confirmed_by else "",
    )
    return Acceptance(
        name="specification",
        source="specification 12",
        use=use,
        limits=(running,),
        path="spec.toml",
    )


def verdict(
    fits: Sequence[Fit], limit: float = 0.15, confirmed_by: str = "A. Example"
) -> GearVerdict:
    """What `judge` says of these fits by that limit; it is on friction alone."""
    if not any(one.result.kind == "friction" for one in fits):
        return not_judged("no limit is named")
    return judge(fits, acceptance(limit, confirmed_by))


def friction_result(torque: float = 0.0873) -> Result:
    """A friction result with a warning, a table and the paper's figure 17."""
    running = estimate("running_torque", torque, "N m", 0.0011)
    estimates = {
        "F_c": estimate("F_c", 70.31, "N", 0.9),
        "F_s": estimate(
            "F_s", 95.2, "N", 3.1, identifiable="weakly", note="slowest speed above a tenth of v_s"
        ),
        "v_s": estimate("v_s", 6.13, "rad/s", 0.5),
        "c_v": estimate("c_v", 0.1512, "N s/rad", 0.004),
        "shape": estimate("shape", 1.0, "1", 2.0, identifiable="no", note="does not move"),
        "running_torque": running,
    }
    table = Table(
        "points",
        "Torque per speed",
        ("Speed [r/min]", "Torque [N m]", "Sweep"),
        ((60, 0.0712, "up"),),
    )
    declared = quantities_for("friction", estimates, ("mse", "relative_error"))
    family = quantity_of(FRICTION, "running_torque_2000_rpm")
    assert family is not None
    at_one_speed = replace(
        family, name="running_torque", title="running torque", watched_members=()
    )
    return Result(
        run="R-000042",
        kind="friction",
        quantities=(at_one_speed, *declared),
        estimates=estimates,
        metrics={"mse": 0.431, "relative_error": 0.012},
        warnings=("The bracket drifted by 1.2 % over the sweep.",),
        plots=(friction_plot(),),
        tables=(table,),
        options={"torque_balance": "energy", "mounting": "circular-spline-fixed"},
    )


def kinematic_result() -> Result:
    """A kinematic-error result with many orders."""
    estimates = {
        "transmission_accuracy_forward": estimate(
            "transmission_accuracy_forward", 0.84 * ARCMIN, "rad", 2e-6
        )
    }
    for order in range(1, 11):
        estimates[f"amplitude_{order}"] = estimate(f"amplitude_{order}", 1e-4 / order, "rad", 1e-6)
    angle = np.linspace(0, 2 * np.pi, 400)
    curve = 0.3 * np.cos(2 * angle)
    plots = (
        Plot(
            name="curve",
            title="Kinematic error",
            x_label="Input angle [rad]",
            y_label="Kinematic error [arcmin]",
            series=(
                Series(label="measured", x=angle, y=curve),
                Series(label="fit", x=angle, y=curve * 0.99, group=1),
            ),
            figure="12",
        ),
        Plot(
            name="orders",
            title="Orders",
            x_label="Order [cycles per input revolution]",
            y_label="Amplitude [arcmin]",
            series=(
                Series(
                    label="forward", x=np.arange(1.0, 11), y=1 / np.arange(1.0, 11), style="bars"
                ),
            ),
            y_scale="log",
            figure="13",
        ),
    )
    return Result(
        run="R-000041",
        kind="kinematic-error",
        quantities=quantities_for("kinematic-error", estimates, ("mse",)),
        estimates=estimates,
        metrics={"mse": 0.71},
        plots=plots,
    )


def fit(origin: Origin = "simulated", result: Result | None = None, **more: Any) -> Fit:
    """A fit of a hand-made recording."""
    result = result or friction_result()
    made = recording(origin, experiment=result.kind, **{"run_id": result.run, **more})
    gear = made.metadata.gear
    assert gear is not None
    return Fit(recording=made, gear=gear, result=result)


def save_acceptance(acceptance: Acceptance, path: str | Path) -> None:
    """Write an acceptance file that reads back to the same limits."""
    Path(path).write_text(acceptance_text(acceptance), encoding="utf-8")
