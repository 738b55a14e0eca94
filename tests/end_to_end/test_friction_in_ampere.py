"""A motor current instead of a torque, from a table to the fit by the command line: friction in ampere, honestly.

The recording is arithmetic of its own. Its Stribeck shape of 5 lies beyond what is searched (4).
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rig import main

RATE = 1000.0
SPEEDS = np.geomspace(2.0, 45.0, 9)
COULOMB, STATIC, VELOCITY, SHAPE, VISCOUS = 0.8, 1.3, 6.0, 5.0, 8e-3
"""A, A, rad/s, 1, A s/rad."""
GAIN = 1.004
"""What the amplifier shows per ampere; its certificate says ± 0.8 %."""
MAP = """
[channels.time]
column = "t [s]"
[channels.input_angle]
column = "q [rad]"
[channels.current]
column = "i [A]"
SAID
[gear]
serial = "S1"
ratio = 100
"""


def table() -> str:
    """Each speed both ways, twice, for some revolutions; each hold has its own 1 % of friction."""
    random = np.random.default_rng(1)
    speeds: list[np.ndarray] = []
    factors: list[np.ndarray] = []
    for speed in np.repeat([*SPEEDS, *SPEEDS], 2) * np.tile([1.0, -1.0], 2 * len(SPEEDS)):
        rows = int((0.9 + 2.4 * math.tau / abs(speed)) * RATE)
        ramp = np.linspace(0.0, speed, 60)
        speeds.append(np.concatenate([ramp, np.full(rows, speed), ramp[::-1], np.zeros(40)]))
        factors.append(np.full(len(speeds[-1]), 1.0 + 0.01 * random.standard_normal()))
    speed, factor = np.concatenate(speeds), np.concatenate(factors)
    angle = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1])) / RATE])
    dip = (STATIC - COULOMB) * np.exp(-((np.abs(speed) / VELOCITY) ** SHAPE))
    friction = np.sign(speed) * (COULOMB + dip) + VISCOUS * speed
    current = GAIN * factor * friction + 0.05 * random.standard_normal(len(speed))
    time = np.arange(len(speed)) / RATE
    rows = (f"{t:.3f},{q:.6f},{i:.5f}" for t, q, i in zip(time, angle, current, strict=True))
    return "\n".join(("t [s],q [rad],i [A]", *rows))


def rig(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    """A command that must succeed; what it printed."""
    with pytest.raises(SystemExit) as ended:
        main.run(list(words))
    shown = capsys.readouterr()
    assert not ended.value.code, f"{words}: {shown.out}{shown.err}"
    return shown.out


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("ampere") / "joint.csv"
    path.write_text(table(), encoding="utf-8")
    return path


@pytest.mark.parametrize("said", ["", "scale_uncertainty = 0.004\noffset_uncertainty = 0.0"])
def test_friction_in_ampere(
    recorded: Path,
    said: str,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("map.toml").write_text(MAP.replace("SAID", said), encoding="utf-8")
    rig(capsys, "import", "csv", str(recorded), "--map", "map.toml")
    (run,) = Path("runs").glob("*.h5")
    found: dict[str, Any] = json.loads(rig(capsys, "fit", "friction", str(run), "--json"))
    numbers = found["parameters"]
    true = {"coulomb": COULOMB, "viscous": VISCOUS}
    for name, value in true.items():
        assert abs(numbers[name]["value"] - value) < numbers[name]["expanded_uncertainty"]
    units = {"coulomb": "A", "static": "A", "viscous": "A s/rad", "stribeck_velocity": "rad/s"}
    assert {name: numbers[name]["unit"] for name in units} == units
    # The shape stopped at its bound: what hangs on it is not identified, whatever its U.
    assert numbers["shape"]["value"] == pytest.approx(4.0)
    assert numbers["shape"]["identifiability"] == "no"
    assert numbers["stribeck_velocity"]["identifiability"] == "weakly"
    for name in ("coulomb", "static", "viscous"):
        assert numbers[name]["identifiability"] == "weakly", numbers[name]
        assert "at its bound" in numbers[name]["note"] or not said
        gain = {line["source"]: line for line in numbers[name]["budget"]}["gain of the channel"]
        share = gain["standard_uncertainty"] / numbers[name]["value"]
        assert share == pytest.approx(0.004 if said else 0.03)
        assert gain.get("assumed", "") == ("" if said else "current")
    assert all(number["budget"] for number in numbers.values())
    assert "N m" not in {number["unit"] for number in numbers.values()}
