"""No call of our own gives seven values by their place alone: the eighth reader would exchange two of them."""

from __future__ import annotations

import ast
from pathlib import Path

ROOT = Path(__file__).parents[1]
ROOMS = ("model", "drivers", "experiments", "sim_backend", "rig")
MOST = 6
LISTS = ("columns", "in_row", "with_order")
"""Functions that take a list: any number of things of one kind."""
KERNELS = "model/kernels/"
COMPILED = (
    *("friction_signals", "refine", "propagate", "advance", "respond", "error_signal"),
    *("sensitivities", "stribeck_descend", "stribeck_inner", "read_encoder"),
)
"""Kernels that are called from outside their room: compiled, they take arrays and numbers one by one."""
PACKING = ("_pack",)
"""Values of a struct, in the order of its format."""


def wide_calls(path: Path) -> list[str]:
    """Every call in a file with more values by place than are allowed."""
    name = path.relative_to(ROOT).as_posix()
    if name.startswith(KERNELS):
        return []
    allowed = {*LISTS, *COMPILED, *PACKING}
    return [
        f"{name}:{call.lineno} {ast.unparse(call.func)}"
        for call in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(call, ast.Call)
        and len(call.args) > MOST
        and not any(isinstance(one, ast.Starred) for one in call.args)
        and ast.unparse(call.func).rpartition(".")[2] not in allowed
    ]


def test_no_call_gives_seven_values_by_their_place() -> None:
    files = [path for room in ROOMS for path in sorted((ROOT / room).rglob("*.py"))]
    assert [call for path in files for call in wide_calls(path)] == []
