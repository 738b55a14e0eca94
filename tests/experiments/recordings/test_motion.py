"""Motion on recordings that are not clean: standstill, gaps, lag, noise, load, another speed channel."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from experiments.assumed import ONE_WAY
from experiments.contract import Evidence
from experiments.errors import AnalysisError
from experiments.planning.speeds import first_resonances
from experiments.recording import Recording
from experiments.recordings.motion import analysis as motion
from experiments.result import Result
from model.gear import HarmonicDrive
from model.units import REVOLUTION
from tests.experiments.test_analyses_without_plan import foreign

INERTIA, VISCOUS, COULOMB, OFFSET = 0.3, 2.0, 1.0, 0.05


@dataclass(frozen=True)
class Moved:
    """A joint that moves from place to place and stands in between, where stiction holds any torque."""

    time: np.ndarray
    position: np.ndarray
    speed: np.ndarray
    torque: np.ndarray

    def recording(self, **channels: tuple[np.ndarray, str]) -> Recording:
        usual = {"position": (self.position, "rad"), "torque": (self.torque, "N m")}
        return foreign(self.time, **(usual | channels))


def moved(
    seed: int = 9721,
    *,
    rate: float = 500.0,
    seconds: float = 40.0,
    dwell: float = 0.5,
    noise: float = 2e-5,
    gravity: float = 0.0,
    dip: float = 0.0,
    ways: tuple[int, ...] = (-1, 1),
) -> Moved:
    random = np.random.default_rng(seed)
    time = np.arange(int(seconds * rate)) / rate
    position, speed, acceleration, held = np.zeros((4, len(time)))
    standing = np.ones(len(time), dtype=bool)
    at, place = 0.0, 0.0
    while at < seconds:
        length, size = random.uniform(0.5, 1.5), random.uniform(0.3, 1.5) * random.choice(ways)
        rows = (time >= at) & (time < at + length)
        x = (time[rows] - at) / length
        position[rows] = place + size * (10 * x**3 - 15 * x**4 + 6 * x**5)
        speed[rows] = size / length * (30 * x**2 - 60 * x**3 + 30 * x**4)
        acceleration[rows] = size / length**2 * (60 * x - 180 * x**2 + 120 * x**3)
        standing[rows] = False
        place, at = place + size, at + length
        rest = length * dwell / (1.0 - dwell)
        rows = (time >= at) & (time < at + rest)
        position[rows], held[rows] = place, random.uniform(-0.9, 0.9)
        at += rest
    friction = (COULOMB + dip * np.exp(-((speed / 0.15) ** 2))) * np.sign(speed)
    friction = np.where(standing, held, friction)
    torque = INERTIA * acceleration + VISCOUS * speed + friction + OFFSET
    torque += gravity * np.sin(position) + 0.02 * random.standard_normal(len(time))
    return Moved(time, position + noise * random.standard_normal(len(time)), speed, torque)


def fitted(recording: Recording, gear: HarmonicDrive, **settings: object) -> Result:
    return motion.analyse(recording, Evidence(gear, settings=dict(settings)))


def value(result: Result, name: str) -> float:
    return result.estimates[name].value


def test_standstill_is_no_sliding_friction(gear: HarmonicDrive) -> None:
    """With the standing samples, whose torque is anything, Coulomb friction would come out far too small."""
    run = moved(dwell=0.6).recording()
    result = fitted(run, gear)
    assert value(result, "coulomb") == pytest.approx(COULOMB, rel=0.005)
    assert value(result, "viscous") == pytest.approx(VISCOUS, rel=0.005)
    assert result.metrics["standstill_share"] == pytest.approx(0.65, abs=0.1)
    assert any("standstill" in warning for warning in result.warnings)
    kept = fitted(run, gear, least_speed=0.0)
    assert value(kept, "coulomb") < 0.97 * COULOMB
    assert kept.metrics["standstill_share"] == 0.0


def test_noise_of_the_position_does_not_shrink_the_inertia(gear: HarmonicDrive) -> None:
    run = moved(noise=2e-3, dwell=0.1).recording()
    result = fitted(run, gear, cutoff_hz=20.0)
    estimate = result.estimates["inertia"]
    assert abs(estimate.value - INERTIA) < estimate.expanded_uncertainty
    assert estimate.value == pytest.approx(INERTIA, rel=0.03)
    assert "even and odd samples" in str(result.options["instrument"])


def test_gaps_are_cut_and_not_bridged(gear: HarmonicDrive) -> None:
    whole = moved(dwell=0.1)
    kept = np.ones(len(whole.time), dtype=bool)
    for start in (3000, 7000, 12000):
        kept[start : start + 900] = False
    parts = (array[kept] for array in (whole.time, whole.position, whole.speed, whole.torque))
    result = fitted(Moved(*parts).recording(), gear)
    assert value(result, "inertia") == pytest.approx(INERTIA, rel=0.01)
    assert value(result, "coulomb") == pytest.approx(COULOMB, rel=0.01)
    assert any("3 gaps of up to 1.8 s" in warning for warning in result.warnings)


def test_a_late_torque_is_brought_forward(gear: HarmonicDrive) -> None:
    run = moved(dwell=0.1)
    late = replace(run, torque=np.interp(run.time - 0.03, run.time, run.torque))
    result = fitted(late.recording(), gear)
    assert result.metrics["effort_lag"] == pytest.approx(0.03, abs=0.002)
    assert value(result, "inertia") == pytest.approx(INERTIA, rel=0.02)
    stated = fitted(late.recording(), gear, lag_s=0.03)
    assert value(stated, "inertia") == pytest.approx(INERTIA, rel=0.02)
    assert value(fitted(late.recording(), gear, lag_s=0.0), "inertia") < 0.95 * INERTIA


def test_a_lag_that_only_one_half_shows_moves_nothing_and_is_bounded(gear: HarmonicDrive) -> None:
    """The fast half outweighs the slow one, which is not late: brought forward, that one would be early."""
    fast = moved(seconds=20.0, dwell=0.1)
    acceleration, speed = np.gradient(fast.speed, fast.time) / 4.0, fast.speed / 4.0
    slow = INERTIA * acceleration + VISCOUS * speed + COULOMB * np.sign(speed) + OFFSET
    noise = 0.02 * np.random.default_rng(9722).standard_normal(len(slow))
    late = np.interp(fast.time - 0.06, fast.time, fast.torque)
    both = Moved(
        np.concatenate([fast.time, 20.0 + fast.time]),
        np.concatenate([fast.position, fast.position[-1] + fast.position / 4.0]),
        np.concatenate([fast.speed, speed]),
        np.concatenate([late, slow + noise]),
    )
    result = fitted(both.recording(), gear)
    assert result.metrics["effort_lag"] == 0.0
    (words,) = (text for text in result.warnings if "The first half shows" in text)
    assert "nothing was brought forward" in words
    inertia = result.estimates["inertia"]
    assert abs(inertia.value - INERTIA) < inertia.expanded_uncertainty


def test_a_twitch_backwards_that_half_the_bandwidth_does_not_show(gear: HarmonicDrive) -> None:
    """With one filter the motion goes both ways and has an offset, with the other it has none to compare with."""
    run = moved(dwell=0.1, ways=(1,), noise=2e-6)
    twitch = 0.01 * np.exp(-(((run.time - 20.0) / 0.01) ** 2))
    result = fitted(replace(run, position=run.position + twitch).recording(), gear)
    assert "offset" in result.estimates


def test_a_load_over_position_has_a_basis(gear: HarmonicDrive) -> None:
    run = moved(gravity=4.0).recording()
    without = fitted(run, gear)
    assert without.metrics["relative_error_percent"] > 50.0
    assert {e.identifiable for e in without.estimates.values()} == {"no"}
    (remedy,) = (text for text in without.warnings if "--set load=" in text)
    assert "as the weight of a lever does" in remedy
    assert remedy.endswith("--set load=gravity.")
    result = fitted(run, gear, load="gravity")
    assert not [text for text in result.warnings if "--set load=" in text]
    assert not [t for t in fitted(moved().recording(), gear).warnings if "--set load=" in t]
    assert value(result, "load_sin_1") == pytest.approx(4.0, rel=0.01)
    assert value(result, "coulomb") == pytest.approx(COULOMB, rel=0.01)
    assert result.estimates["load_sin_1"].unit == "N m"
    assert value(fitted(run, gear, load="harmonics:2"), "load_sin_2") == pytest.approx(
        0.0, abs=0.02
    )


def test_a_measured_speed_guides_the_fit_and_its_lag_is_told(gear: HarmonicDrive) -> None:
    run = moved(dwell=0.2, noise=2e-4)
    late = np.interp(run.time - 0.024, run.time, run.speed)
    result = fitted(run.recording(speed=(late, "rad/s")), gear)
    assert value(result, "speed_lag") == pytest.approx(0.024, abs=0.002)
    assert "measured speed" in str(result.options["instrument"])
    assert value(result, "inertia") == pytest.approx(INERTIA, rel=0.01)
    with pytest.raises(AnalysisError, match="not the derivative of the position"):
        fitted(run.recording(speed=(9.55 * late, "rad/s")), gear)
    with pytest.raises(AnalysisError, match="does not go with the position"):
        fitted(run.recording(speed=(late, "m/s")), gear)


def encoder_noise(rows: int, size: float) -> np.ndarray:
    """Noise [rad] that neighbouring samples share, as behind an encoder's own filter."""
    width = 9
    white = np.random.default_rng(9792).standard_normal(rows + width - 1)
    return size * np.convolve(white, np.full(width, width**-0.5), "valid")


@pytest.mark.parametrize("size", [5e-4, 2e-3])
def test_a_set_point_keeps_the_noise_of_the_encoder_out_of_the_inertia(
    gear: HarmonicDrive, size: float
) -> None:
    """Neither least squares nor the position's own halves are rid of noise that neighbouring samples share."""
    run = moved(9791, noise=0.0, dwell=0.1)
    position = run.position + encoder_noise(len(run.time), size)
    ahead = np.interp(run.time + 0.01, run.time, run.position)
    recording = run.recording(position=(position, "rad"), target_position=(ahead, "rad"))
    settings: dict[str, object] = {"cutoff_hz": 20.0}
    guided = fitted(recording, gear, **settings)
    assert "set-point" in str(guided.options["instrument"])
    estimate = guided.estimates["inertia"]
    assert estimate.value == pytest.approx(INERTIA, rel=0.005)
    assert abs(estimate.value - INERTIA) < estimate.expanded_uncertainty
    alone = fitted(recording, gear, instrument="none", **settings)
    assert value(alone, "inertia") < 0.97 * INERTIA


@pytest.mark.parametrize("size", [5e-4, 8e-3])
def test_noise_that_samples_share_is_told_from_motion_without_a_set_point(
    gear: HarmonicDrive, size: float
) -> None:
    """By its white floor alone the cut-off would be far too high, and the inertia a sixth of the true one; much noise
    hides it from the instruments as well, and the inertia would be a three-hundredth.
    """
    run = moved(9791, noise=0.0, dwell=0.1)
    position = run.position + encoder_noise(len(run.time), size)
    result = fitted(run.recording(position=(position, "rad")), gear)
    estimate = result.estimates["inertia"]
    assert abs(estimate.value - INERTIA) < estimate.expanded_uncertainty < 0.25 * INERTIA
    assert estimate.identifiable == "yes"
    assert "noise that samples share" in {line.source for line in estimate.budget}
    assert any("cut-off was lowered" in warning for warning in result.warnings)


def test_noise_that_no_cut_off_keeps_out_leaves_nothing_identified(gear: HarmonicDrive) -> None:
    run = moved(9791, noise=0.0, dwell=0.1)
    position = run.position + encoder_noise(len(run.time), 5e-4)
    by_hand = fitted(run.recording(position=(position, "rad")), gear, cutoff_hz=60.0)
    estimate = by_hand.estimates["inertia"]
    assert estimate.value < 0.5 * INERTIA
    assert estimate.identifiable == "weakly"
    assert "neighbouring samples share" in estimate.note


def test_a_gear_that_is_known_moves_as_one_body_below_its_first_mode(gear: HarmonicDrive) -> None:
    """Above it the input moves alone: its inertia would pass for that of the whole."""
    heavy = replace(gear, inertia=replace(gear.inertia, output=900.0 * gear.inertia.output))
    plain = moved(dwell=0.1).recording()
    mounted = replace(plain, metadata=replace(plain.metadata, gear=heavy, gear_mounted=True))
    mode = first_resonances(heavy)[0] / REVOLUTION
    assert fitted(plain, gear).metrics["cutoff"] > mode
    assert fitted(mounted, gear).metrics["cutoff"] == pytest.approx(mode / 3.0)
    assert fitted(mounted, gear, cutoff_hz=9.0).metrics["cutoff"] == 9.0
    bare = replace(mounted, metadata=replace(mounted.metadata, gear_mounted=False))
    assert fitted(bare, gear).metrics["cutoff"] == fitted(plain, gear).metrics["cutoff"]


def test_a_lag_of_a_good_part_of_the_fastest_period_is_found(gear: HarmonicDrive) -> None:
    time = np.arange(4000) / 1000.0
    phase = 2.0 * np.pi * np.array([[1.3], [9.7]]) * time
    wave, size = 2.0 * np.pi * np.array([[1.3], [9.7]]), np.array([[1.0], [0.02]])
    position, speed = (size * np.sin(phase)).sum(axis=0), (size * wave * np.cos(phase)).sum(axis=0)
    torque = INERTIA * (-size * wave**2 * np.sin(phase)).sum(axis=0) + VISCOUS * speed
    torque += COULOMB * np.sign(speed) + 0.02 * np.random.default_rng(9722).standard_normal(4000)
    late = np.interp(time - 0.02, time, torque)
    result = fitted(foreign(time, position=(position, "rad"), torque=(late, "N m")), gear)
    assert result.metrics["effort_lag"] == pytest.approx(0.02, abs=5e-4)
    assert value(result, "inertia") == pytest.approx(INERTIA, rel=0.02)


def test_a_set_point_of_another_motion_does_not_guide(gear: HarmonicDrive) -> None:
    run, other = moved(9791, dwell=0.1), moved(9793, dwell=0.1)
    strange = run.recording(target_position=(other.position, "rad"))
    result = fitted(strange, gear)
    assert "even and odd samples" in str(result.options["instrument"])
    assert any("too loosely" in warning for warning in result.warnings)


def test_a_speed_alone_is_enough(gear: HarmonicDrive) -> None:
    run = moved(dwell=0.3)
    noisy = run.speed + 1e-3 * np.random.default_rng(9722).standard_normal(len(run.speed))
    recording = foreign(run.time, speed=(noisy, "rad/s"), torque=(run.torque, "N m"))
    result = fitted(recording, gear)
    assert value(result, "inertia") == pytest.approx(INERTIA, rel=0.01)
    assert value(result, "coulomb") == pytest.approx(COULOMB, rel=0.01)
    with pytest.raises(AnalysisError, match="needs a position"):
        fitted(recording, gear, load="gravity")


def test_the_stribeck_rung_is_taken_where_the_data_show_a_dip(gear: HarmonicDrive) -> None:
    plain = fitted(moved(dwell=0.2).recording(), gear)
    assert plain.options["variant"] == "symmetric"
    table = next(t for t in plain.tables if t.name == "rungs")
    assert {"symmetric", "asymmetric"} <= {str(row[0]) for row in table.rows}
    dipped = fitted(moved(dwell=0.2, dip=0.6).recording(), gear)
    assert dipped.options["variant"] == "stribeck"
    assert value(dipped, "coulomb") == pytest.approx(COULOMB, rel=0.02)
    assert value(dipped, "static") == pytest.approx(COULOMB + 0.6, rel=0.05)
    assert value(dipped, "stribeck_velocity") == pytest.approx(0.15, rel=0.1)


@pytest.mark.parametrize("way", [1, -1])
def test_strokes_in_one_direction_are_fitted_with_the_offset_in_the_friction(
    gear: HarmonicDrive, way: int
) -> None:
    truth = {"inertia": INERTIA, "viscous": VISCOUS, "coulomb": COULOMB}
    for seed in (3, 4, 5):
        result = fitted(moved(seed, ways=(way,), noise=0.0).recording(), gear)
        assert set(result.estimates) == set(truth)
        for name, number in truth.items():
            away = abs(value(result, name) - number)
            assert away <= result.estimates[name].expanded_uncertainty
        assert value(result, "coulomb") == pytest.approx(COULOMB + way * OFFSET, abs=0.02)
        lines = {line.source: line for line in result.estimates["coulomb"].budget}
        assert lines["offset, in it"].assumed == ONE_WAY.kind
        assert not any("offset" in one.source for one in result.estimates["viscous"].budget)
        assert any("goes one way" in warning for warning in result.warnings)


def test_a_sign_that_is_wrong_is_no_result(gear: HarmonicDrive) -> None:
    run = moved(dwell=0.2)
    turned = fitted(replace(run, torque=-run.torque).recording(), gear)
    for name in ("inertia", "viscous", "coulomb"):
        assert turned.estimates[name].identifiable == "no"
    assert turned.estimates["offset"].identifiable != "yes"
    assert any("not physical" in warning for warning in turned.warnings)


def test_the_sign_is_named_where_it_decides_and_nothing_else(gear: HarmonicDrive) -> None:
    turned = moved()
    turned = replace(turned, torque=-turned.torque)
    said = [w for w in fitted(turned.recording(), gear).warnings if "not physical" in w]
    assert len(said) >= 3
    assert all("check the sign" in w for w in said)
    heavy = moved(gravity=40.0)
    said = [w for w in fitted(heavy.recording(), gear).warnings if "not physical" in w]
    assert said
    assert all("a load over position" in w and "sign" not in w for w in said)


def test_the_filter_is_a_line_of_every_budget(gear: HarmonicDrive) -> None:
    result = fitted(moved(dwell=0.2).recording(), gear)
    for name in ("inertia", "viscous", "coulomb", "offset"):
        sources = {line.source for line in result.estimates[name].budget}
        assert {"filter", "lag of the effort"} <= sources
    table = next(t for t in result.tables if t.name == "cutoffs")
    low, middle, high = (float(row[0]) for row in table.rows)
    assert (low, high) == pytest.approx((0.5 * middle, 2.0 * middle))
    inertias = [float(row[1]) for row in table.rows]
    line = next(b for b in result.estimates["inertia"].budget if b.source == "filter")
    change = abs(inertias[2] - inertias[0]) / (2.0 * np.sqrt(3.0))
    assert line.standard_uncertainty == pytest.approx(change)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"load": "weight"}, "no such load"),
        ({"load": "harmonics:0"}, "no such load"),
        ({"least_speed": 100.0}, "too little motion"),
        ({"least_speed": "slow"}, "not a number"),
        ({"cutoff_hz": 400.0}, "cutoff"),
        ({"position": "torque"}, "not a position"),
    ],
)
def test_settings_that_cannot_be_are_refused(
    gear: HarmonicDrive, settings: dict[str, object], words: str
) -> None:
    with pytest.raises(AnalysisError, match=words):
        fitted(moved(seconds=10.0).recording(), gear, **settings)


def test_an_output_whose_sense_nobody_stated_is_taken_as_recorded(gear: HarmonicDrive) -> None:
    run = moved(dwell=0.2)
    recording = foreign(run.time, output_angle=(run.position, "rad"), torque=(run.torque, "N m"))
    result = fitted(recording, gear)
    assert value(result, "inertia") == pytest.approx(INERTIA, rel=0.01)
    assert any("Nobody stated how output_angle counts" in w for w in result.warnings)
    stated = replace(
        recording,
        metadata=replace(recording.metadata, process={"stated": {"output_sense": True}}),
    )
    assert value(fitted(stated, gear), "inertia") < 0.0


def test_a_lag_that_the_import_states_is_taken_off(gear: HarmonicDrive) -> None:
    run = moved(dwell=0.1)
    late = replace(run, torque=np.interp(run.time - 0.03, run.time, run.torque)).recording()
    process = {"stated": {"lag_s": {"torque": 0.03}}}
    result = fitted(replace(late, metadata=replace(late.metadata, process=process)), gear)
    assert result.options["lag_is"] == "stated"
    assert result.metrics["effort_lag"] == 0.03
    assert value(result, "inertia") == pytest.approx(INERTIA, rel=0.02)


@pytest.mark.parametrize(
    ("load", "orders"),
    [("none", ()), ("gravity", (1,)), ("harmonics:1", (1,)), ("harmonics:3", (1, 2, 3))],
)
def test_a_load_is_of_the_orders_that_it_names(load: str, orders: tuple[int, ...]) -> None:
    assert motion._load_orders({"load": load}) == orders
