"""The example scripts of the documentation run as they stand, with short settings, and leave the paper's figures."""

from __future__ import annotations

import ast
import runpy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import rig

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
SCRIPTS = sorted(EXAMPLES.glob("*.py"))
LONGEST = 30

QUICK = {"measure_time": 0.2, "settle_time": 0.15, "lowest_rpm": 8.0}


def study(name: str) -> Callable[..., rig.Result]:
    return runpy.run_path(str(EXAMPLES / f"{name}.py"))["study"]


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_a_script_is_short_and_uses_the_public_interface_alone(script: Path) -> None:
    text = script.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= LONGEST
    imported = {
        alias.name if isinstance(node, ast.Import) else str(node.module)
        for node in ast.walk(ast.parse(text))
        if isinstance(node, (ast.Import, ast.ImportFrom))
        for alias in node.names
    }
    assert imported <= {"harmonic_rig", "pathlib", "typing"}


@pytest.mark.parametrize(
    ("name", "settings", "figures", "value"),
    [
        (
            "constant_speed_friction",
            {"points": 6, "seed": 9921, **QUICK},
            {"figure-9.png", "figure-17.png"},
            "coulomb",
        ),
        (
            "low_velocity_kinematic_error",
            {"speed_rpm": 241.7, "seed": 9922},
            {"figure-12.png", "figure-13.png"},
            "amplitude_2",
        ),
        (
            "velocity_steps",
            {"speeds_rpm": (1800.0,), "repeats": 1, "seed": 9923},
            {"figure-19-1800-rpm.png"},
            "frequency",
        ),
    ],
)
def test_a_script_executes_fits_compares_and_draws(
    name: str,
    settings: dict[str, Any],
    figures: set[str],
    value: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    result = study(name)(tmp_path, **settings)
    assert {path.name for path in tmp_path.glob("*.png")} == figures
    assert 0.0 < result[value].uncertainty < result[value].value
    told = capsys.readouterr().out
    assert "against CSF-25-120-2UH" in told
    assert result.run_id in told
