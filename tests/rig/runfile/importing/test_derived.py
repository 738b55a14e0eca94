"""What no column holds: the angle by a stated speed, for orders alone; the output angle by the transmission error."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from experiments.errors import AnalysisError
from model.identify.estimate import Estimate
from model.units import ARCSEC, REVOLUTION
from rig.analysis.fit.run import fit_run
from rig.errors import ConfigurationError
from rig.runfile.importing.accepting import accepted, good_for, map_text
from rig.runfile.importing.channel_map import ImportOptions, read_channel_map
from rig.runfile.importing.channel_source import parse_channel
from rig.runfile.importing.convert import import_tables
from rig.runfile.importing.opening import open_tables
from rig.runfile.importing.proposal import propose

RATIO = 100.0
SPEED = "60 r/min"
TABLE = (
    "time [s],motor position [deg],output position [deg],transmission error [arcsec],torque [N m]"
)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twenty turns of the input at 60 r/min: orders 2 and 4 of the torque, order 2 of the transmission error."""
    rng = np.random.default_rng(8)
    t = np.arange(20_000) * 1e-3
    angle = REVOLUTION * t
    error = 20.0 * ARCSEC * np.cos(2.0 * angle) + 0.2 * ARCSEC * rng.standard_normal(len(t))
    torque = 0.05 + 4e-3 * np.cos(2.0 * angle + 0.3) + 1.5e-3 * np.cos(4.0 * angle)
    torque += 1e-3 * rng.standard_normal(len(t))
    columns = [t, angle, angle / RATIO + error, error / ARCSEC, torque]
    columns[1:3] = [np.rad2deg(one) for one in columns[1:3]]
    path = tmp_path_factory.mktemp("log") / "log.csv"
    np.savetxt(
        path, np.column_stack(columns), delimiter=",", header=TABLE, comments="", fmt="%.12g"
    )
    return path


def imported(log: Path, folder: Path, *channels: str, **said: object) -> Path:
    options = ImportOptions(
        channels=tuple(parse_channel(text) for text in ("time=1", *channels)),
        **said,  # type: ignore[arg-type]
    )
    return import_tables(open_tables("csv", [log]), options, lambda: folder / "00001-x.h5").path


def holds(estimate: Estimate, truth: float) -> bool:
    return estimate.low <= truth <= estimate.high


def test_a_stated_speed_gives_the_orders_of_a_log_without_an_angle(
    log: Path, tmp_path: Path
) -> None:
    run = imported(log, tmp_path, "torque=5", speed=SPEED)
    result = fit_run(run, "order-spectrum").result
    assert holds(result.estimates["amplitude_2"], 4e-3)
    assert holds(result.estimates["amplitude_4"], 1.5e-3)
    assert {one.identifiable for one in result.estimates.values()} == {"weakly"}
    assert any("stated speed" in warning for warning in result.warnings)
    with pytest.raises(AnalysisError, match="needs a channel"):
        fit_run(run, "motion")


def test_a_speed_in_rad_s_is_the_same_as_a_number(log: Path, tmp_path: Path) -> None:
    orders = [
        fit_run(imported(log, tmp_path / str(at), "torque=5", speed=speed), "order-spectrum").result
        for at, speed in enumerate((SPEED, REVOLUTION))
        if (tmp_path / str(at)).mkdir() is None
    ]
    first, second = (one.estimates["amplitude_2"].value for one in orders)
    assert first == pytest.approx(second, rel=1e-12)


@pytest.mark.parametrize(
    ("speed", "channels", "why"),
    [
        ("60 N m", ("torque=5",), "is no speed that turns"),
        ("60", ("torque=5",), "nobody says its unit"),
        ("0 r/min", ("torque=5",), "is no speed that turns"),
        (SPEED, ("torque=5", "input_angle=2"), "was not recorded; value there is input_angle"),
    ],
)
def test_a_speed_that_cannot_stand_for_the_angle_is_refused(
    log: Path, tmp_path: Path, speed: str, channels: tuple[str, ...], why: str
) -> None:
    with pytest.raises(ConfigurationError, match=why):
        imported(log, tmp_path, *channels, speed=speed)
    assert not list(tmp_path.iterdir())


def test_the_transmission_error_makes_the_output_angle(log: Path, tmp_path: Path) -> None:
    for name in ("made", "measured"):
        (tmp_path / name).mkdir()
    made = imported(log, tmp_path / "made", "input_angle=2", "transmission_error=4", ratio=RATIO)
    both = imported(
        log, tmp_path / "measured", "input_angle=2", "output_angle=3", ratio=RATIO, output_sense=1
    )
    one, other = (
        fit_run(run, "order-spectrum").result.estimates["amplitude_2"] for run in (made, both)
    )
    assert holds(one, 20.0 * ARCSEC)
    assert one.value == pytest.approx(other.value, rel=1e-6)
    assert one.identifiable == "yes"


@pytest.mark.parametrize(
    ("channels", "ratio", "what"),
    [(("input_angle=2",), math.nan, "no ratio"), (("torque=5",), RATIO, "no input_angle")],
)
def test_the_transmission_error_needs_input_angle_and_ratio(
    log: Path, tmp_path: Path, channels: tuple[str, ...], ratio: float, what: str
) -> None:
    with pytest.raises(ConfigurationError, match=what):
        imported(log, tmp_path, *channels, "transmission_error=4", ratio=ratio)


def test_what_was_said_stands_in_the_map_and_in_what_it_is_good_for(
    log: Path, tmp_path: Path
) -> None:
    options = ImportOptions(
        channels=(parse_channel("time=1"), parse_channel("torque=5")), speed=SPEED
    )
    assert good_for("csv", [log], options) == ["order-spectrum", "skew"]
    file = tmp_path / "map.toml"
    file.write_text(map_text(options), encoding="utf-8")
    (again,) = read_channel_map(file)
    assert again.options({}).speed == SPEED


def test_its_heading_is_known_and_without_a_ratio_it_is_left_out(log: Path) -> None:
    proposal = propose(open_tables("csv", [log]))
    alone = replace(
        proposal,
        columns=tuple(one for one in proposal.columns if one.channel != "output_angle"),
        ratio=math.nan,
    )
    left = accepted(ImportOptions(channels=()), alone)
    assert "transmission_error" not in {one.name for one in left.channels}
    assert any("needs the input angle, and --ratio" in text for text in left.proposed)
    options = accepted(ImportOptions(channels=(), ratio=RATIO), proposal)
    assert {"transmission_error", "output_angle", "input_angle"} <= {
        c.name for c in options.channels
    }
