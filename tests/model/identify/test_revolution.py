"""Fourier series per revolution: orders chosen by the data, directions apart, and a recorded cogging map."""

from __future__ import annotations

import os
import re
from pathlib import Path

import numpy as np
import pytest

from model.errors import IdentificationError
from model.identify.orders.turning import DeadZone, runs_of
from model.identify.revolution import RevolutionFit, fit_series
from model.units import REVOLUTION
from tests.model.identify.orders.sources import in_memory

DATA = (
    Path(
        os.environ.get("HARMONIC_RIG_DATA", Path(__file__).resolve().parents[4] / "shared" / "data")
    )
    / "laas_cogging"
)


def revolution_of(
    angle: np.ndarray, value: np.ndarray, *, highest_order: int = 200, unit: str = "1"
) -> RevolutionFit:
    """The series of arrays."""
    zone = DeadZone.of([angle])
    runs = runs_of([zone.ways(angle)], zone.blink)
    source = in_memory([(way, angle[a:b], value[a:b]) for a, b, way in runs])
    return fit_series(source, highest_order=highest_order, unit=unit)


@pytest.fixture(scope="module")
def cogging():
    if not DATA.is_dir():
        pytest.skip("the cogging map is not there")
    table = np.genfromtxt(DATA / "stopped_data.txt", skip_header=1, delimiter=",")
    return revolution_of(table[:, 1], table[:, 3], unit="A")


def authors_amplitudes() -> np.ndarray:
    """Amplitude per order of the authors' table: int16 over one turn, one count being 2^-16 A."""
    text = (DATA / "cogging_tableau.txt").read_text().split("{")[1]
    table = np.array([int(v) for v in re.findall(r"-?\d+", text)], dtype=float) / 65536.0
    return 2.0 * np.abs(np.fft.rfft(table)) / len(table)


def test_the_cogging_orders_are_found_strongest_first(cogging) -> None:
    assert cogging.orders[:6].tolist() == [72, 18, 12, 144, 24, 36]


def test_the_cogging_amplitudes_agree_with_the_authors_table(cogging) -> None:
    table = authors_amplitudes()
    for order, amplitude in zip(cogging.orders[:6], cogging.amplitude[:6], strict=True):
        assert amplitude == pytest.approx(table[order], rel=0.03)


def test_the_cogging_residual_and_friction(cogging) -> None:
    assert cogging.metrics["residual_rms"] < 0.014
    assert cogging.estimates["friction"].value == pytest.approx(0.054, abs=0.0006)
    assert len(cogging.orders) < 60


def back_and_forth(
    seed: int, noise: float, friction: float = 0.05
) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    up = np.linspace(0.0, 1.05 * REVOLUTION, 3000)
    angle = np.concatenate([up, up[::-1]])
    sign = np.concatenate([np.ones(3000), -np.ones(3000)])
    value = 0.01 + friction * sign + 0.2 * np.cos(24 * angle - 1.0) + 0.03 * np.cos(7 * angle + 0.5)
    return angle + 1e-4 * random.standard_normal(
        len(angle)
    ), value + noise * random.standard_normal(len(angle))


def test_orders_amplitudes_and_friction_are_recovered() -> None:
    fit = revolution_of(*back_and_forth(1, 0.02), unit="N m", highest_order=60)
    assert fit.orders[:2].tolist() == [24, 7]
    assert fit.estimates["amplitude_24"].value == pytest.approx(0.2, abs=2e-3)
    assert fit.estimates["phase_24"].value == pytest.approx(1.0, abs=0.02)
    assert fit.estimates["phase_7"].value == pytest.approx(-0.5, abs=0.1)
    assert fit.estimates["friction"].value == pytest.approx(0.05, abs=1e-3)
    assert fit.estimates["mean"].value == pytest.approx(0.01, abs=1e-3)
    assert fit.metrics["residual_rms"] == pytest.approx(0.02, rel=0.05)


def test_noise_alone_brings_hardly_any_order() -> None:
    found = []
    for seed in range(6):
        random = np.random.default_rng(100 + seed)
        angle, _ = back_and_forth(seed, 0.0)
        found.append(
            len(revolution_of(angle, random.standard_normal(len(angle)), highest_order=80).orders)
        )
    assert np.mean(found) <= 0.5


def test_one_direction_alone_gives_no_friction() -> None:
    angle, value = back_and_forth(2, 0.01)
    fit = revolution_of(angle[:3000], value[:3000], highest_order=60)
    assert "friction" not in fit.estimates
    assert fit.estimates["mean"].identifiable == "weakly"


@pytest.mark.parametrize(
    ("angle", "value", "what"),
    [
        (np.zeros(500), np.zeros(500), "does not move"),
        (np.linspace(0.0, 3.0, 500), np.zeros(500), "no whole revolution"),
    ],
)
def test_bad_input_is_refused(angle: np.ndarray, value: np.ndarray, what: str) -> None:
    with pytest.raises(IdentificationError, match=what):
        revolution_of(angle, value)
