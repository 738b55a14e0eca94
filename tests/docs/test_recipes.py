"""The recipes work as they stand: the modules that the pages print are planned, run, fitted and reported."""

from __future__ import annotations

import ast
import dataclasses
import importlib.util
import json
import re
import sys
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
from tests.experiments.test_analyses_without_plan import foreign, stating

HOWTO = Path(__file__).parents[2] / "docs" / "howto"
_MODULE = re.compile(r"^```python\n# (\S+\.py)\n(.*?)^```", re.DOTALL | re.MULTILINE)

pytest.importorskip("experiments.quantity")
pytest.importorskip("experiments.steps.vocabulary")


def printed_module(page: str, folder: Path) -> ModuleType:
    """The one module that a page prints, imported under its own name as if it lay where the page puts it."""
    ((path, code),) = _MODULE.findall((HOWTO / f"{page}.md").read_text(encoding="utf-8"))
    file = folder / Path(path).name
    file.write_text(code, encoding="utf-8")
    name = path.removesuffix(".py").replace("/", ".")
    spec = importlib.util.spec_from_file_location(name, file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def printed_entry(page: str) -> catalogue.Entry:
    """The line of the catalogue that a page prints."""
    text = (HOWTO / f"{page}.md").read_text(encoding="utf-8")
    found = re.search(r"^( *)(Entry\(\n.*?^\1\))$", text, re.DOTALL | re.MULTILINE)
    assert found, page
    call = ast.parse(found[2].strip(), mode="eval").body
    assert isinstance(call, ast.Call)
    words = [ast.literal_eval(argument) for argument in call.args]
    named = {str(k.arg): ast.literal_eval(k.value) for k in call.keywords}
    return catalogue.Entry(*words, **named)


@pytest.fixture(autouse=True)
def _followed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[None]:
    """What the pages ask for, done: modules and entries; undone afterwards."""
    before = set(sys.modules)
    monkeypatch.chdir(tmp_path)
    entries = []
    for page in ("add-a-protocol", "add-a-fit"):
        printed_module(page, tmp_path)
        entries.append(printed_entry(page))
    monkeypatch.setattr(catalogue, "ENTRIES", (*catalogue.ENTRIES, *entries))
    yield
    for name in set(sys.modules) - before:
        if name.startswith("experiments."):
            del sys.modules[name]


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
    page = Path("noise.html").read_text(encoding="utf-8")
    assert "noise of the torque port" in page.lower()
    assert "mN" in page


def test_the_scale_of_the_port_is_in_u_though_the_recipe_says_nothing_of_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The mean where the recipe has the noise: ten pieces agree to 0.03 mN m, and the port shows 1.8 mN m too much."""
    module = sys.modules["experiments.protocols.torque_noise"]
    code = (tmp_path / "torque_noise.py").read_text(encoding="utf-8")
    mean = code.replace(".std(axis=1, ddof=1)", ".mean(axis=1)")
    assert mean != code
    exec(compile(mean, "torque_noise.py", "exec"), module.__dict__)
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

    page = printed_module("add-a-step", tmp_path)
    step = page.SmoothRamp(speed=30.0, acceleration=50.0)
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
    profile = page.HalfCosine(-10.0, 30.0, round(forecast.nominal / at.period))
    targets = profile.targets(0, profile.cycles)
    rates = np.diff(targets, prepend=-10.0) / at.period
    assert forecast.net == pytest.approx(at.period * targets.sum())
    assert forecast.turned > abs(forecast.net)
    assert targets[-1] == 30.0
    assert 0.99 * 50.0 < rates.max() <= 50.0 * (1.0 + 1e-9)
    whole = [profile.targets(k, 7) for k in range(0, profile.cycles, 7)]
    assert np.array_equal(np.concatenate(whole)[: profile.cycles], targets)
