"""Motion, Fourier series per revolution and order spectrum: on recordings of this rig and of others."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path

import numpy as np
import pytest
import scipy

from experiments.contract import Evidence
from experiments.errors import AnalysisError
from experiments.recording import ArraySource, Recording, RunMetadata
from experiments.recordings.motion import analysis as motion
from experiments.recordings.order_spectrum import analysis as order_spectrum
from experiments.recordings.revolution import analysis as revolution
from model.channel import Calibration, Channel
from model.gear import HarmonicDrive
from model.units import ARCSEC

DATA = Path(os.environ.get("HARMONIC_RIG_DATA", Path(__file__).parents[3] / "shared" / "data"))


def foreign(time: np.ndarray, **channels: tuple[np.ndarray, str]) -> Recording:
    """An imported recording: no segments, no zero, channels as floats in SI."""
    metadata = RunMetadata(
        run_id="foreign-1", experiment="", origin="imported", time_base="device", ratio=float("nan")
    )
    signals = {
        name: Channel(name=name, unit=unit, is_counted=False)
        for name, (_, unit) in channels.items()
    }
    stamps = np.round((time - time[0]) * 1e9).astype(np.int64)
    return Recording(
        metadata, signals, (), (), ArraySource({n: v for n, (v, _) in channels.items()}, stamps)
    )


def stating(recording: Recording, name: str, **stated: float) -> Recording:
    """The recording with what its map says of a channel's calibration."""
    channel = recording.signals[name]
    known = dataclasses.replace(channel, calibration=Calibration(**stated))
    return dataclasses.replace(recording, signals={**recording.signals, name: known})


def axis(seconds: float = 20.0, seed: int = 3) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, position and force of an axis with 12 kg, 40 N s/m, 9 N and 1.5 N of offset."""
    time = np.arange(0.0, seconds, 1e-3)
    position = 0.1 * np.sin(2.0 * time) + 0.03 * np.sin(7.0 * time + 1.0)
    velocity = 0.2 * np.cos(2.0 * time) + 0.21 * np.cos(7.0 * time + 1.0)
    acceleration = -0.4 * np.sin(2.0 * time) - 1.47 * np.sin(7.0 * time + 1.0)
    noise = 0.5 * np.random.default_rng(seed).standard_normal(len(time))
    return (
        time,
        position,
        12.0 * acceleration + 40.0 * velocity + 9.0 * np.sign(velocity) + 1.5 + noise,
    )


def test_inertia_and_friction_of_a_linear_axis(gear: HarmonicDrive) -> None:
    time, position, force = axis()
    run = foreign(time, position=(position, "m"), force=(force, "N"))
    result = motion.analyse(run, Evidence(gear))
    for name, truth, unit in (
        ("inertia", 12.0, "kg"),
        ("viscous", 40.0, "N s/m"),
        ("coulomb", 9.0, "N"),
        ("offset", 1.5, "N"),
    ):
        estimate = result.estimates[name]
        assert estimate.unit == unit
        assert estimate.value == pytest.approx(truth, rel=0.01, abs=0.1)


def test_units_follow_the_channels(gear: HarmonicDrive) -> None:
    time, position, force = axis()
    result = motion.analyse(
        foreign(time, position=(position, "rad"), current=(force, "A")), Evidence(gear)
    )
    assert result.estimates["inertia"].unit == "A s2/rad"
    assert result.estimates["viscous"].unit == "A s/rad"


def test_uneven_stamps_are_used_as_they_are(gear: HarmonicDrive) -> None:
    """Jitter of the sampling is in the stamps: on a nominal axis it would be noise of the velocity."""
    time, _, _ = axis()
    shaken = time + 2e-4 * np.random.default_rng(4).uniform(-1.0, 1.0, len(time))
    phase = 2.0 * shaken, 7.0 * shaken + 1.0
    position = 0.1 * np.sin(phase[0]) + 0.03 * np.sin(phase[1])
    velocity = 0.2 * np.cos(phase[0]) + 0.21 * np.cos(phase[1])
    acceleration = -0.4 * np.sin(phase[0]) - 1.47 * np.sin(phase[1])
    force = 12.0 * acceleration + 40.0 * velocity + 9.0 * np.sign(velocity) + 1.5
    result = motion.analyse(
        foreign(shaken, position=(position, "m"), force=(force, "N")), Evidence(gear)
    )
    assert any("even axis" in w for w in result.warnings)
    assert result.estimates["inertia"].value == pytest.approx(12.0, rel=0.01)


@pytest.mark.parametrize("time_base", ["none", "nominal"])
def test_motion_without_a_true_time_base_is_refused(gear: HarmonicDrive, time_base: str) -> None:
    time, position, force = axis(5.0)
    run = foreign(time, position=(position, "m"), force=(force, "N"))
    metadata = dataclasses.replace(run.metadata, time_base=time_base)  # type: ignore[arg-type]
    with pytest.raises(AnalysisError, match="true time"):
        motion.analyse(dataclasses.replace(run, metadata=metadata), Evidence(gear))


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"variant": "cubic"}, "variant"),
        ({"effort": "pressure"}, "pressure"),
        ({"start": 4.0, "stop": 3.0}, "empty"),
        ({"speed": 1.0}, "no such setting"),
    ],
)
def test_impossible_settings_of_motion_are_refused(
    gear: HarmonicDrive, settings: dict[str, object], words: str
) -> None:
    time, position, force = axis(5.0)
    run = foreign(time, position=(position, "m"), force=(force, "N"))
    with pytest.raises(AnalysisError, match=words):
        motion.analyse(run, Evidence(gear, settings=settings))


def test_a_series_per_revolution_keeps_the_directions_apart(gear: HarmonicDrive) -> None:
    random = np.random.default_rng(5)
    angle = np.concatenate([np.linspace(0.0, 12.6, 6000), np.linspace(12.6, 0.0, 6000)])
    way = np.repeat([1.0, -1.0], 6000)
    current = 0.05 * way + 0.02 + 0.3 * np.cos(18 * angle - 0.4) + 0.1 * np.sin(6 * angle)
    current = current + 0.01 * random.standard_normal(len(angle))
    run = foreign(np.arange(len(angle)) * 1e-3, input_angle=(angle, "rad"), current=(current, "A"))
    result = revolution.analyse(run, Evidence(gear))
    assert {"amplitude_18", "amplitude_6"} <= set(result.estimates)
    assert result.estimates["amplitude_18"].value == pytest.approx(0.3, abs=1e-3)
    assert result.estimates["phase_18"].value == pytest.approx(0.4, abs=5e-3)
    assert result.estimates["friction"].value == pytest.approx(0.05, abs=1e-3)
    assert result.estimates["friction"].unit == "A"


def test_a_series_per_revolution_of_a_long_run(
    kinematic_error_run: Recording, gear: HarmonicDrive
) -> None:
    settings = {"highest_order": 48}
    result = revolution.analyse(kinematic_error_run, Evidence(gear, settings=settings))
    assert result.estimates["amplitude_24"].value == pytest.approx(2e-3, rel=0.02)
    assert result.estimates["amplitude_2"].value == pytest.approx(1e-3, rel=0.05)


def test_a_revolution_needs_an_angle(gear: HarmonicDrive) -> None:
    time, position, force = axis(5.0)
    with pytest.raises(AnalysisError, match="rad"):
        revolution.analyse(
            foreign(time, position=(position, "m"), force=(force, "N")), Evidence(gear)
        )


def test_the_order_spectrum_shows_the_strongest_orders(
    kinematic_error_run: Recording, gear: HarmonicDrive
) -> None:
    error = order_spectrum.analyse(kinematic_error_run, Evidence(gear))
    assert error.options["channel"] == order_spectrum.KINEMATIC_ERROR
    strongest = next(iter(error.estimates))
    assert strongest == "amplitude_2"
    assert error.estimates[strongest].value == pytest.approx(16.16 * ARCSEC, rel=0.02)
    torque = order_spectrum.analyse(
        kinematic_error_run, Evidence(gear, settings={"channel": "torque"})
    )
    assert {"amplitude_24", "amplitude_2"} <= set(torque.estimates)
    over_output = order_spectrum.analyse(
        kinematic_error_run,
        Evidence(gear, settings={"angle": "output_angle", "highest_order": 260.0}),
    )
    assert "amplitude_240" in over_output.estimates


def test_a_stated_ratio_leaves_no_slope_beside_the_orders_and_an_unstated_one_does(
    gear: HarmonicDrive,
) -> None:
    """Of a gear of 119 that nobody states, over one turn and a bit: the slope is the ratio's, and costs order 1 U."""
    time = np.arange(0.0, 6.0, 1e-3)
    angle = 2.0 * np.pi * 1.05 * time / 6.0
    noise = 2.0 * ARCSEC * np.random.default_rng(4).standard_normal(len(time))
    output = angle / 119.0 + 20.0 * ARCSEC * np.sin(angle) + noise
    run = foreign(time, input_angle=(angle, "rad"), output_angle=(output, "rad"))
    stated = dataclasses.replace(
        run, metadata=dataclasses.replace(run.metadata, ratio=119.0, output_sense=1)
    )
    unstated = dataclasses.replace(run, metadata=dataclasses.replace(run.metadata, output_sense=1))
    one, other = (
        order_spectrum.analyse(r, Evidence(gear)).estimates["amplitude_1"]
        for r in (stated, unstated)
    )
    for found in (one, other):
        assert found.low <= 20.0 * ARCSEC <= found.high
    assert other.high - other.low > 1.3 * (one.high - one.low)
    settings = {"channel": "output_angle", "highest_order": 16}
    series = revolution.analyse(stated, Evidence(gear, settings=settings)).estimates
    assert series["amplitude_1"].value == pytest.approx(20.0 * ARCSEC, rel=0.02)
    assert "amplitude_2" not in series


def test_an_order_spectrum_needs_a_whole_revolution(gear: HarmonicDrive) -> None:
    time = np.arange(0.0, 2.0, 1e-3)
    run = foreign(time, input_angle=(time, "rad"), torque=(np.sin(time), "N m"))
    with pytest.raises(AnalysisError, match="whole revolution"):
        order_spectrum.analyse(run, Evidence(gear))


@pytest.mark.skipif(not (DATA / "emps").is_dir(), reason="the EMPS recordings are not here")
def test_emps_as_a_recording(gear: HarmonicDrive) -> None:
    """Published: 95.109 kg, 203.5 N s/m, 20.39 N, -3.165 N; relative error 4.08 %, on the second file 5.98 %."""
    runs = []
    for name in ("DATA_EMPS.mat", "DATA_EMPS_PULSES.mat"):
        content = scipy.io.loadmat(str(DATA / "emps" / name))
        force = 35.15065188 * content["vir"].ravel()
        runs.append(
            foreign(content["t"].ravel(), position=(content["qm"].ravel(), "m"), force=(force, "N"))
        )
    result = motion.analyse(runs[0], Evidence(gear))
    assert result.estimates["inertia"].value == pytest.approx(95.1089, rel=0.002)
    assert result.estimates["viscous"].value == pytest.approx(203.5034, rel=0.01)
    assert result.estimates["coulomb"].value == pytest.approx(20.3935, rel=0.01)
    assert result.estimates["offset"].value == pytest.approx(-3.1648, abs=0.05)
    assert 3.8 <= result.metrics["relative_error_percent"] <= 4.2


@pytest.mark.skipif(
    not (DATA / "laas_cogging").is_dir(), reason="the cogging recording is not here"
)
def test_laas_cogging_as_a_recording(gear: HarmonicDrive) -> None:
    """A motor moved from place to place both ways: the strongest orders are 72, 18, 12, 144, 24, 36."""
    table = np.genfromtxt(
        DATA / "laas_cogging" / "stopped_data.txt", delimiter=",", skip_header=1, usecols=(0, 1, 3)
    )
    angle, current = table[:, 1], table[:, 2]
    run = foreign(np.arange(len(angle)) * 1e-3, input_angle=(angle, "rad"), current=(current, "A"))
    result = revolution.analyse(run, Evidence(gear))
    strongest = [
        int(name.removeprefix("amplitude_"))
        for name in result.estimates
        if name.startswith("amplitude_")
    ][:6]
    assert set(strongest) == {72, 18, 12, 144, 24, 36}
    assert abs(result.estimates["friction"].value) == pytest.approx(0.054, abs=0.003)
    assert result.metrics["residual_rms"] < 0.014
