"""Inertia and friction from any motion: a simulated axis, and the EMPS benchmark against its published values."""

from __future__ import annotations

import math
import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import scipy.io

from model.errors import IdentificationError
from model.identify import motion
from model.identify.motion_columns import Basis, MotionFilter
from model.identify.motion_ladder import Ladder, gathered
from model.identify.motion_lag import LagEstimate
from model.identify.motion_result import MotionFit, reported
from model.identify.motion_source import ArrayMotion

DATA = (
    Path(
        os.environ.get("HARMONIC_RIG_DATA", Path(__file__).resolve().parents[4] / "shared" / "data")
    )
    / "emps"
)
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason="the EMPS recordings are not there")


def emps(name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    found = scipy.io.loadmat(DATA / name)
    return (
        np.ravel(found["t"]),
        np.ravel(found["qm"]),
        float(found["gtau"][0, 0]) * np.ravel(found["vir"]),
    )


def fitted(
    time: np.ndarray,
    position: np.ndarray,
    force: np.ndarray,
    *,
    variant: str = "symmetric",
    recipe: MotionFilter | None = None,
    rotary: bool = False,
) -> MotionFit:
    """One axis by a recipe that is given, not chosen by its data."""
    recipe = recipe or MotionFilter()
    source = ArrayMotion.of(time, force, position=position)
    recipe.check(source.period)
    return reported(Ladder(source, recipe, Basis(), False, ()).chosen(variant), rotary)


def relative_error(
    fit: MotionFit, time: np.ndarray, position: np.ndarray, force: np.ndarray
) -> float:
    """|F - X b|/|F| of a recording that was not fitted."""
    moments = gathered(ArrayMotion.of(time, force, position=position), fit.recipe, fit.basis)
    shown = dict(zip(moments.names, moments.shown.T, strict=True))
    predicted = np.stack([shown[name] for name in fit.regressors], axis=1) @ fit.coefficients
    return float(np.linalg.norm(shown["effort"] - predicted) / np.linalg.norm(shown["effort"]))


@needs_data
def test_emps_symmetric_and_cross_validation() -> None:
    fit = fitted(*emps("DATA_EMPS.mat"))
    found = {name: e.value for name, e in fit.estimates.items()}
    assert found["inertia"] == pytest.approx(95.1089, rel=0.002)
    assert found["viscous"] == pytest.approx(203.5034, rel=0.01)
    assert found["coulomb"] == pytest.approx(20.3935, rel=0.01)
    assert found["offset"] == pytest.approx(-3.1648, abs=0.05)
    assert 3.8 < fit.metrics["relative_error_percent"] < 4.2
    assert fit.metrics["condition"] == pytest.approx(25.99, rel=0.01)
    assert relative_error(fit, *emps("DATA_EMPS_PULSES.mat")) < 0.06


@needs_data
def test_emps_asymmetric() -> None:
    fit = fitted(*emps("DATA_EMPS.mat"), variant="asymmetric")
    found = {name: e.value for name, e in fit.estimates.items()}
    assert found["inertia"] == pytest.approx(95.1540, rel=0.002)
    assert found["viscous_forward"] == pytest.approx(166.7061, rel=0.01)
    assert found["coulomb_forward"] == pytest.approx(20.1440, rel=0.01)
    assert found["viscous_reverse"] == pytest.approx(240.4236, rel=0.01)
    assert found["coulomb_reverse"] == pytest.approx(20.6277, rel=0.01)
    assert fit.metrics["relative_error_percent"] < 3.2


def axis(seed: int, noise: float = 0.02) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A rotary axis with J 2e-3, viscous 0.05, Coulomb 0.4, offset -0.1 in a rich periodic motion."""
    random = np.random.default_rng(seed)
    time = np.arange(8000) * 1e-3
    position, velocity, acceleration = (np.zeros_like(time) for _ in range(3))
    for frequency, size in ((0.4, 3.0), (1.3, 0.8), (3.1, 0.3)):
        w, shift = 2.0 * np.pi * frequency, random.uniform(0.0, 6.0)
        position += size * np.sin(w * time + shift)
        velocity += size * w * np.cos(w * time + shift)
        acceleration -= size * w**2 * np.sin(w * time + shift)
    force = 2e-3 * acceleration + 0.05 * velocity + 0.4 * np.sign(velocity) - 0.1
    return time, position, force + noise * random.standard_normal(len(time))


def test_the_truth_of_a_simulated_axis_is_covered() -> None:
    truth = {"inertia": 2e-3, "viscous": 0.05, "coulomb": 0.4, "offset": -0.1}
    inside = []
    for seed in range(25):
        fit = fitted(*axis(seed), rotary=True)
        inside += [fit.estimates[n].low <= v <= fit.estimates[n].high for n, v in truth.items()]
        assert fit.estimates["inertia"].unit == "kg m2"
    assert np.mean(inside) > 0.88


def test_bad_motion_is_refused() -> None:
    time, position, force = axis(0)
    with pytest.raises(IdentificationError, match="cannot separate"):
        fitted(time, 2.0 * time, force)
    one_way = position - position.min() + 40.0 * time
    with pytest.raises(IdentificationError, match="asymmetric"):
        fitted(time, one_way, force, variant="asymmetric")
    with pytest.raises(IdentificationError, match="cutoff"):
        fitted(time, position, force, recipe=MotionFilter(cutoff_hz=600.0))


@pytest.mark.parametrize(("lag", "beyond"), [(0.05, 0.03), (0.001, 0.002)])
def test_what_is_seen_of_a_lag_beyond_its_doubt_counts_whole(
    monkeypatch: pytest.MonkeyPatch, lag: float, beyond: float
) -> None:
    """0.05 ± 0.02 s lies 0.03 s beyond what could be chance; of 0.001 s no more than two periods are believed."""
    monkeypatch.setattr(motion, "lag_sensitivity", lambda moments, names: np.array([1.0]))
    fitted: Any = SimpleNamespace(
        transform=(("inertia",), np.eye(1)),
        moments=None,
        fit=SimpleNamespace(names=("inertia",)),
        basis=SimpleNamespace(lag=0.0),
    )
    _, doubt = motion._lag_effect(fitted, LagEstimate(lag, 0.01), 1e-3)
    assert doubt == pytest.approx([beyond / math.sqrt(3.0)])
