"""What the simulator knows of itself is found again, with every imperfection on. The many-seed study is a benchmark."""

from __future__ import annotations

from pathlib import Path

import pytest

from experiments.truth import truth_of, truth_rows
from model.gear_file import shipped_gear
from model.identify.kinematic_error import KinematicErrorAccumulator, score_kinematic_error
from model.motor import shipped_motor
from rig.analysis.fit.recorded import Fit
from rig.bench.backends.order import Order
from rig.run.start import run_order
from tests.rig.fitting import fit_files

SEEDS = (11, 12)
MISSED: dict[int, list[str]] = {}
"""Quantities of friction whose U misses the truth, by seed. One in twenty may."""


def fitted(
    protocol: str, seed: int, folder: Path, tare: Path | None = None, **values: object
) -> Fit:
    request = Order(
        protocol=protocol,
        gear=shipped_gear(),
        motor=shipped_motor(),
        folder=folder,
        values=values,
        serial=f"S{seed}",
        seed=seed,
    )
    path = run_order(request).path
    (fit,) = fit_files([path], tare=tare)
    return fit


@pytest.mark.parametrize("seed", SEEDS)
def test_kinematic_error(seed: int, tmp_path: Path) -> None:
    fit = fitted("kinematic-error", seed, tmp_path, speed_rpm=61.8)
    rows = [
        r
        for r in truth_rows(fit.result, truth_of(fit.recording.metadata.process))
        if r.estimate.name.startswith(("amplitude", "phase"))
    ]
    assert len(rows) >= 20
    assert sum(r.within for r in rows) >= 0.9 * len(rows)


@pytest.mark.parametrize("seed", SEEDS)
def test_friction_with_tare(seed: int, tmp_path: Path) -> None:
    tare = fitted("motor-tare", seed, tmp_path, points=10)
    fit = fitted("friction", seed, tmp_path, tare.path, points=14)
    rows = truth_rows(fit.result, truth_of(fit.recording.metadata.process))
    assert {r.estimate.name for r in rows} >= {
        "coulomb",
        "static",
        "stribeck_velocity",
        "shape",
        "viscous",
    }
    assert [r.estimate.name for r in rows if not r.within] == MISSED.get(seed, [])


HALF = (60.0, 600.0, 1500.0, 3000.0)
"""Speeds [r/min]: twice at these takes a fifth of the time of a fit to twice at all eight."""


@pytest.mark.parametrize(
    ("seed", "plan"), [(11, {"repeats": 1}), (12, {"repeats": 2, "speeds_rpm": HALF})]
)
def test_stiffness_over_inertia_within_one_percent(
    seed: int, plan: dict[str, object], tmp_path: Path
) -> None:
    """An order of gear 12 passes its mode: once at each of the eight speeds tells it within 1.4 %, "weakly"."""
    fit = fitted("velocity-steps", seed, tmp_path, **plan)
    (row,) = [
        r
        for r in truth_rows(fit.result, truth_of(fit.recording.metadata.process))
        if r.estimate.name == "stiffness_over_inertia"
    ]
    assert row.estimate.value == pytest.approx(row.seen, rel=0.01)
    assert row.within
    # The spring's law is in doubt in what is its stiffness, and not in an inertia whose acceleration was seen.
    law = {line.source for line in row.estimate.budget if line.kind == "B"}
    inertia, stiffness = (
        {line.source for line in fit.result.estimates[name].budget}
        for name in ("output_inertia", "output_stiffness")
    )
    assert law <= stiffness
    assert law & inertia == {"choice of the rung"}
    assert {"torque scale", "warmth of the motor"} <= inertia & stiffness


def test_a_fitted_curve_explains_a_run_that_it_was_not_fitted_to(tmp_path: Path) -> None:
    fits = []
    for protocol_seed in (21, 22):
        request = Order(
            protocol="kinematic-error",
            gear=shipped_gear(),
            motor=shipped_motor(),
            folder=tmp_path,
            values={"speed_rpm": 61.8 if protocol_seed == 21 else 59.1},
            serial="S3",
            seed=21,
        )
        (fit,) = fit_files([run_order(request).path])
        recording = fit.recording
        # The counters start anywhere: both curves are counted from the index marks.
        mark = truth_of(recording.metadata.process)["kinematic_error"]["reference_angle"]
        accumulator = KinematicErrorAccumulator(recording.metadata.ratio)
        for segment in recording.labelled("traverse"):
            if segment.direction > 0:
                for part in recording.blocks(segment):
                    angle = recording.si("input_angle", part) - mark
                    accumulator.add(angle, recording.output_angle(part))
        fits.append(accumulator.fit())
    assert score_kinematic_error(fits[0], fits[1]).mse < 1.0
