"""The recipes work as they stand: the package that the pages print is laid into an empty folder and used there."""

from __future__ import annotations

import dataclasses
import importlib
import importlib.util
import json
import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from experiments import catalogue
from experiments.contract import Evidence
from experiments.recording import Segment
from model.gear_file import shipped_gear
from rig import main
from rig.testing.protocol import check_protocol
from rig.testing.source import check_source
from tests import outside_package
from tests.experiments.test_analyses_without_plan import foreign, stating
from tests.outside_package import found_in, installed_into

HOWTO = Path(__file__).parents[2] / "docs" / "howto"
PAGES = ("add-a-protocol", "add-a-fit", "add-a-driver", "import-a-recording")
_MODULE = re.compile(r"^```python\n# (lab_noise/\S+\.py)\n(.*?)^```", re.DOTALL | re.MULTILINE)
_TABLE = re.compile(r"^```toml\n(.*?)^```", re.DOTALL | re.MULTILINE)


def page(name: str) -> str:
    return (HOWTO / f"{name}.md").read_text(encoding="utf-8")


def printed() -> dict[str, str]:
    """The files of the package that the pages print."""
    return {path: code for name in PAGES for path, code in _MODULE.findall(page(name))}


def test_the_pages_print_the_package_whole() -> None:
    folder = outside_package.HERE
    there = {
        str(path.relative_to(folder)): path.read_text(encoding="utf-8")
        for path in folder.glob("lab_noise/*.py")
        if path.name != "__init__.py"
    }
    assert printed() == there
    project = (folder / "pyproject.toml").read_text(encoding="utf-8")
    assert project in _TABLE.findall(page("add-a-protocol"))
    points = tomllib.loads(project)["project"]["entry-points"]
    for name in PAGES[1:]:
        said = next(t for t in _TABLE.findall(page(name)) if "entry-points" in t)
        for group, named in tomllib.loads(said)["project"]["entry-points"].items():
            assert points[group] == named, name


def printed_module(name: str, folder: Path) -> ModuleType:
    """The one module that a page prints of this program, imported under its own name as if it lay where it belongs."""
    ((path, code),) = re.findall(
        r"^```python\n# (\S+\.py)\n(.*?)^```", page(name), re.DOTALL | re.MULTILINE
    )
    file = folder / Path(path).name
    file.write_text(code, encoding="utf-8")
    spec = importlib.util.spec_from_file_location(path.removesuffix(".py").replace("/", "."), file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(autouse=True)
def followed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Path]:
    """What the pages ask for, done in an empty folder; undone afterwards."""
    before = set(sys.modules)
    monkeypatch.chdir(tmp_path)
    site = installed_into(tmp_path / "site")
    for path, code in printed().items():
        (site / path).write_text(code, encoding="utf-8")
    with found_in(site):
        yield site
    for name in set(sys.modules) - before:
        if name.startswith("experiments."):
            del sys.modules[name]


def test_what_the_pages_print_keeps_the_contracts() -> None:
    check_protocol(catalogue.load("torque-noise"))
    check_protocol(catalogue.load("torque-drift"))
    thermometer = importlib.import_module("lab_noise.thermometer")
    check_source(lambda clock: thermometer.Thermometer(clock, _Quiet))


class _Quiet:
    """A line on which nothing comes."""

    def read(self, size: int) -> bytes:
        return b""

    def close(self) -> None: ...


def rig(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    """A command that must succeed; what it printed."""
    with pytest.raises(SystemExit) as ended:
        main.run(list(words))
    shown = capsys.readouterr()
    assert not ended.value.code, f"{words}: {shown.out}{shown.err}"
    return shown.out


def test_the_printed_protocol_is_planned_run_and_reported(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert "--duration" in rig(capsys, "plan", "torque-noise", "--help")
    assert json.loads(rig(capsys, "plan", "torque-noise", "--json"))
    rig(capsys, "run", "torque-noise", "--gear", "SN-1", "--operator", "A. Example")
    (run,) = Path("runs").glob("*.h5")
    found = json.loads(rig(capsys, "fit", str(run), "--json"))["parameters"]["noise"]
    assert found["unit"] == "N m"
    assert 0.0 < found["low"] < found["value"] < found["high"] < 0.01
    scale = [b for b in found["budget"] if b["source"] == "torque scale"]
    assert scale[0]["standard_uncertainty"] > 0.01 * found["value"]
    assert found["expanded_uncertainty"] > 2.0 * (found["high"] - found["value"])
    rig(capsys, "report", str(run), "--output", "noise.html")
    text = Path("noise.html").read_text(encoding="utf-8")
    assert "noise of the torque port" in text.lower()
    assert "mN" in text


def test_the_scale_of_the_port_is_in_u_though_the_recipe_says_nothing_of_it(
    followed: Path,
) -> None:
    """The mean where the recipe has the noise: ten pieces agree to 0.03 mN m, and the port shows 1.8 mN m too much."""
    module = importlib.import_module("lab_noise.noise")
    code = (followed / "lab_noise" / "noise.py").read_text(encoding="utf-8")
    mean = code.replace(".std(axis=1, ddof=1)", ".mean(axis=1)")
    assert mean != code
    exec(compile(mean, "noise.py", "exec"), module.__dict__)
    true, scale = 0.064665, 1.8e-3 / 0.064665 / 2.0
    random = np.random.default_rng(1)
    shown = (1.0 + 2.0 * scale) * true + 5e-4 * random.standard_normal(5000)
    run = foreign(np.arange(5000) * 1e-3, torque=(shown, "N m"))
    run = stating(run, "torque", scale_relative_uncertainty=scale, offset_uncertainty=0.0)
    hold = Segment(index=0, label="hold", start=0, stop=5000, setpoint=0.0, direction=0, repeat=0)
    run = dataclasses.replace(run, segments=(hold,))
    found = catalogue.load("torque-noise").analyse(run, Evidence(shipped_gear())).estimates["noise"]
    assert found.budget[0].standard_uncertainty < 3e-5
    assert [line.source for line in found.budget[1:]] == ["torque scale"]
    assert abs(found.value - true) < found.expanded_uncertainty < 2.0e-3


def test_the_printed_fit_takes_any_recording(capsys: pytest.CaptureFixture[str]) -> None:
    rig(capsys, "run", "torque-noise", "--gear", "SN-1", "--operator", "A. Example")
    (run,) = Path("runs").glob("*.h5")
    found = json.loads(rig(capsys, "fit", "torque-drift", str(run), "--json"))["parameters"][
        "drift"
    ]
    assert found["low"] < found["value"] < found["high"]
    assert abs(found["value"]) < 1e-3


def test_the_printed_step_turns_what_it_forecasts(tmp_path: Path) -> None:
    from experiments.steps.kind import Situation

    module = printed_module("add-a-step", tmp_path)
    step = module.SmoothRamp(speed=30.0, acceleration=50.0)
    at = Situation(
        index=0,
        what=step.words(),
        setpoint=-10.0,
        period=0.001,
        inertia=1e-4,
        ratio=120.0,
        starting_torque=0.1,
    )
    forecast = step.forecast(at)
    profile = module.HalfCosine(-10.0, 30.0, round(forecast.nominal / at.period))
    targets = profile.targets(0, profile.cycles)
    rates = np.diff(targets, prepend=-10.0) / at.period
    assert forecast.net == pytest.approx(at.period * targets.sum())
    assert forecast.turned > abs(forecast.net)
    assert targets[-1] == 30.0
    assert 0.99 * 50.0 < rates.max() <= 50.0 * (1.0 + 1e-9)
    whole = [profile.targets(k, 7) for k in range(0, profile.cycles, 7)]
    assert np.array_equal(np.concatenate(whole)[: profile.cycles], targets)
