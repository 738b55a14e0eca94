"""Tables of friction over speed: the law by the points, wrong points, presliding, any units, one direction or both."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from experiments import catalogue
from experiments.contract import Evidence
from experiments.errors import AnalysisError
from experiments.recording import ArraySource, Recording, RunMetadata
from experiments.result import Result
from model.channel import Calibration, Channel
from model.gear_file import shipped_gear
from model.units import RPM

SPEED = np.geomspace(0.05, 60.0, 22)
BOTH = np.concatenate([SPEED, -SPEED])
ROW = {"coulomb": 1.0, "viscous": 0.01}
"""Coulomb [N m] and viscous friction [N m s/rad] of every table here."""


STATED = Calibration(scale_relative_uncertainty=1e-4, offset_uncertainty=1e-3)
"""A scale and a zero that somebody looked at; what nobody states is assumed."""


def table(speed: np.ndarray, effort: np.ndarray, **others: tuple[np.ndarray, str]) -> Recording:
    """A table as an import makes it: rows without time."""
    units = {"speed": (speed, "rad/s"), "torque": (effort, "N m")} | others
    metadata = RunMetadata(run_id="table-1", experiment="friction-curve", origin="imported")
    signals = {
        name: Channel(name=name, unit=unit, is_counted=False, calibration=STATED)
        for name, (_, unit) in units.items()
    }
    arrays = {name: values for name, (values, _) in units.items()}
    rows = np.arange(len(speed), dtype=np.int64)
    return Recording(metadata, signals, (), (), ArraySource(arrays, rows))


def friction(
    speed: np.ndarray,
    static: float = 1.0,
    critical: float = 4.0,
    noise: float = 0.01,
    seed: int = 9731,
) -> np.ndarray:
    v = np.abs(speed)
    size = 1.0 + (static - 1.0) * np.exp(-v / critical) + 0.01 * v
    return np.sign(speed) * size + noise * np.random.default_rng(seed).standard_normal(len(v))


def fitted(recording: Recording, **settings: Any) -> Result:
    analyse = catalogue.load("friction-curve").analyse
    return analyse(recording, Evidence(shipped_gear(), settings=settings))


def law(result: Result) -> str:
    return str(result.options["law"]["both"])


@pytest.mark.parametrize("static", [1.5, 0.6])
def test_static_friction_may_lie_above_or_below_coulomb_friction(static: float) -> None:
    result = fitted(table(BOTH, friction(BOTH, static) + 0.05))
    assert law(result) == "stribeck"
    for name, truth in {**ROW, "static": static, "stribeck_velocity": 4.0, "offset": 0.05}.items():
        estimate = result.estimates[name]
        assert abs(estimate.value - truth) < 1.5 * estimate.expanded_uncertainty
        assert estimate.value == pytest.approx(truth, rel=0.25)
        assert estimate.identifiable == "yes"
    assert any("No Stribeck dip" in w for w in result.warnings) == (static < 1.0)


def test_points_without_any_scatter_are_no_defect_of_the_program() -> None:
    """A table of a data sheet: three digits, the same in both directions."""
    rpm = np.array([10.0, 50.0, 100.0, 500.0, 1000.0, 2000.0, 3000.0])
    speed = np.concatenate([rpm, -rpm]) * RPM
    effort = np.sign(speed) * np.tile([40.1, 40.5, 41.0, 45.0, 50.0, 60.0, 70.0], 2) * 1e-3
    result = fitted(table(speed, effort))
    assert law(result) == "coulomb-viscous"
    assert result.estimates["coulomb"].value == pytest.approx(0.040, rel=1e-9)


def test_a_straight_line_stays_one() -> None:
    result = fitted(table(BOTH, friction(BOTH)))
    assert law(result) == "coulomb-viscous"
    assert set(result.estimates) == {"coulomb", "viscous", "offset"}
    assert result.estimates["coulomb"].value == pytest.approx(1.0, abs=0.01)
    laws = next(t for t in result.tables if t.name == "laws")
    assert [row[1] for row in laws.rows] == ["coulomb", "coulomb-viscous", "stribeck"]


def test_wrong_points_are_named_and_left_out() -> None:
    effort = friction(BOTH, 1.5)
    effort[[3, 12, 30]] += 0.6 * np.sign(effort[[3, 12, 30]])
    result = fitted(table(BOTH, effort))
    assert result.metrics["wrong_points"] == 3.0
    assert result.estimates["coulomb"].value == pytest.approx(1.0, abs=0.04)
    assert result.estimates["static"].value == pytest.approx(1.5, abs=0.03)


def test_a_curve_knows_no_unit() -> None:
    """The same table of a slow joint and in other units gives the same numbers: no bound is one of rad/s."""
    plain = fitted(table(BOTH, friction(BOTH, 1.5)))
    slow = fitted(table(1e-4 * BOTH, 1e3 * friction(BOTH, 1.5)))
    for name, factor in {
        "coulomb": 1e3,
        "static": 1e3,
        "viscous": 1e7,
        "stribeck_velocity": 1e-4,
    }.items():
        assert slow.estimates[name].value == pytest.approx(
            factor * plain.estimates[name].value, rel=1e-3
        )


def test_one_direction_and_each_of_both() -> None:
    forward = fitted(table(SPEED, friction(SPEED, 1.5)))
    assert "offset" not in forward.estimates
    assert any("One direction only" in w for w in forward.warnings)
    effort = np.where(BOTH > 0.0, friction(BOTH, 1.5), 2.0 * friction(BOTH, 1.5))
    (remedy,) = (t for t in fitted(table(BOTH, effort)).warnings if "--set direction" in t)
    assert "1.01 N m forward and 1.99 N m reverse" in remedy
    alike = fitted(table(BOTH, np.where(BOTH > 0.0, effort, -np.abs(effort) / 2.0)))
    assert not [t for t in alike.warnings if "--set direction" in t]
    each = fitted(table(BOTH, effort), direction="each")
    assert each.estimates["coulomb_forward"].value == pytest.approx(1.0, abs=0.05)
    assert each.estimates["coulomb_reverse"].value == pytest.approx(2.0, abs=0.1)


def test_stated_uncertainties_weigh_and_are_not_believed_when_the_points_scatter_more() -> None:
    error = np.full(len(BOTH), 0.01)
    honest = fitted(table(BOTH, friction(BOTH), torque_uncertainty=(error, "N m")))
    proud = fitted(table(BOTH, friction(BOTH), torque_uncertainty=(error / 10.0, "N m")))
    assert honest.options["uncertainty"] == "stated"
    wide, narrow = (
        r.estimates["coulomb"].high - r.estimates["coulomb"].low for r in (proud, honest)
    )
    assert wide == pytest.approx(narrow, rel=0.15)
    assert any("scatter" in w for w in proud.warnings)


def test_a_law_by_hand() -> None:
    recording = table(BOTH, friction(BOTH, 1.5))
    result = fitted(recording, law="coulomb-viscous")
    assert set(result.estimates) == {"coulomb", "viscous", "offset"}
    assert fitted(recording, law="coulomb").estimates["coulomb"].value > 1.0


@pytest.mark.parametrize(
    ("effort", "settings", "words"),
    [
        (np.abs(friction(BOTH)), {}, "drives where friction brakes"),
        (friction(BOTH), {"law": "cubic"}, "no such law"),
        (friction(BOTH), {"direction": "up"}, "no such direction"),
        (friction(BOTH), {"least_speed": 59.0}, "too few points"),
        (friction(BOTH), {"effort": "speed_2"}, "speed_2"),
        (friction(BOTH), {"speed": "torque"}, "not a speed"),
    ],
)
def test_what_cannot_be_a_curve_is_refused(
    effort: np.ndarray, settings: dict[str, Any], words: str
) -> None:
    with pytest.raises(AnalysisError, match=words):
        fitted(table(BOTH, effort), **settings)


def test_few_points_carry_a_line_only() -> None:
    speed = np.array([1.0, 2.0, 5.0, 10.0, 20.0])
    result = fitted(table(speed, friction(speed)))
    assert law(result) in ("coulomb", "coulomb-viscous")
    with pytest.raises(AnalysisError, match="too few points for the law stribeck"):
        fitted(table(speed, friction(speed)), law="stribeck")
    # Eight points are enough for five parameters, five speeds are not.
    often = np.concatenate([speed, -speed[:3]])
    with pytest.raises(AnalysisError, match="too few points for the law stribeck"):
        fitted(table(often, friction(often)), law="stribeck")


def test_the_plot_holds_points_curve_and_residuals() -> None:
    effort = friction(BOTH, 1.5)
    effort[5] += 1.0
    (plot,) = fitted(table(BOTH, effort)).plots
    labels = [series.label for series in plot.of_panel(0)]
    assert {"forward", "reverse", "stribeck", "left out"} <= set(labels)
    assert len(plot.of_panel(1)) == 2
