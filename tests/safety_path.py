"""The safety path: its two lists, how many statements they have, and which of their lines each fault drill proves.

The lists stand in one place, the contracts *stopping* and *turning* of `pyproject.toml`. A line is proved by a drill
when it is carried out in the run with the fault and not in the same run with the fault taken out.

    python -m tests.safety_path docs/reference/safety-path.md

makes every drill twice, traced, and writes the page (some minutes); with `--lists` only the lists are made anew.
"""

from __future__ import annotations

import argparse
import ast
import sys
import tomllib
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

from rig.trial.drill.catalogue import Drill
from rig.trial.drill.staging import Placed
from rig.trial.drill.suite import Stage, carrier_of, stage
from rig.trial.drill.suite import chosen as chosen_drills

ROOT = Path(__file__).parents[1]
LISTS = {"stopping": ("stopping",), "turning": ("turning", "turning-seam")}
"""The contracts of each list: the seam is named by more than what stands behind it."""
MOST_STOPPING = 700
"""Statements that a reviewer of the stopping list has to read, at most."""
FREE = frozenset({"rig.errors", "drivers.errors"})
"""What the stopping list may import beside the lists: how a thing is said to be wrong."""
OURS = ("rig", "model", "drivers", "experiments", "sim_backend")


def modules(name: str) -> tuple[str, ...]:
    """The modules of a list, as its contract names them."""
    with (ROOT / "pyproject.toml").open("rb") as stream:
        contracts = tomllib.load(stream)["tool"]["importlinter"]["contracts"]
    by_id = {each["id"]: each for each in contracts}
    return tuple(m for each in LISTS[name] for m in by_id[each]["protected_modules"])


def source(module: str) -> Path:
    """The file of a module."""
    return ROOT / Path(*module.split(".")).with_suffix(".py")


def statements(module: str) -> int:
    """Statements of a module; texts that stand alone (docstrings) and `from __future__` are none."""
    tree = ast.parse(source(module).read_text(encoding="utf-8"))
    return sum(isinstance(node, ast.stmt) and not _is_silent(node) for node in ast.walk(tree))


def _is_silent(node: ast.stmt) -> bool:
    if isinstance(node, ast.ImportFrom) and node.module == "__future__":
        return True
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


def imports(module: str) -> set[str]:
    """The modules of ours that a module imports, wherever in it, but for its types alone."""
    tree = ast.parse(source(module).read_text(encoding="utf-8"))
    typing_only = {
        id(inner)
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
        for inner in ast.walk(node)
    }
    found: set[str] = set()
    for node in ast.walk(tree):
        if id(node) in typing_only:
            continue
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= set(_imported(node))
    return {name for name in found if name.split(".")[0] in OURS}


def _imported(node: ast.ImportFrom) -> Iterator[str]:
    """`from package import module` names the module, `from module import name` the module."""
    for alias in node.names:
        inner = f"{node.module}.{alias.name}"
        yield inner if source(inner).exists() else str(node.module)


@dataclass
class LinesRun:
    """The lines of some files that are carried out while it traces."""

    files: Mapping[str, str]
    """Modules by the name of their file."""
    lines: dict[str, set[int]] = field(default_factory=lambda: defaultdict(set))
    _known: dict[CodeType, bool] = field(default_factory=dict[CodeType, bool])

    @contextmanager
    def traced(self) -> Iterator[None]:
        """Note every line that is carried out within."""
        before = sys.gettrace()
        sys.settrace(self._called)
        try:
            yield
        finally:
            sys.settrace(before)

    def _called(self, frame: FrameType, event: str, _: Any) -> Any:
        code = frame.f_code
        if code not in self._known:
            self._known[code] = code.co_filename in self.files
        return self._moved if self._known[code] else None

    def _moved(self, frame: FrameType, event: str, _: Any) -> Any:
        if event == "line":
            self.lines[frame.f_code.co_filename].add(frame.f_lineno)
        return self._moved


def proved(drill: Drill, stage: Stage) -> dict[str, set[int]]:
    """Lines of both lists, by module, that a drill carries out with its fault and not without."""
    carrier = carrier_of(drill)
    row = max(0, stage.reference(carrier).rows[drill.moment])
    files = {str(source(module)): module for name in LISTS for module in modules(name)}
    with_fault, without = LinesRun(files), LinesRun(files)
    for run, happening in ((without, drill.taken_out()), (with_fault, drill)):
        with run.traced():
            stage.run(drill.name, carrier, (Placed(happening, row),), compares=drill.is_harmless)
    extra = {files[f]: lines - without.lines[f] for f, lines in sorted(with_fault.lines.items())}
    return {module: lines for module, lines in extra.items() if lines}


def functions(module: str) -> list[tuple[str, int, int]]:
    """Name, first and last line of each function of a module, methods by the name of their class."""
    return list(_functions(ast.parse(source(module).read_text(encoding="utf-8")), ""))


def _functions(node: ast.AST, path: str) -> Iterator[tuple[str, int, int]]:
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.ClassDef):
            yield from _functions(child, f"{child.name}.")
        elif isinstance(child, ast.FunctionDef):
            yield f"{path}{child.name}", child.lineno, child.end_lineno or child.lineno


def worded(module: str, lines: set[int]) -> str:
    """Lines of a module by function: `Supervisor.review 84-86 90`."""
    parts: list[str] = []
    for name, first, last in functions(module):
        inner = sorted(line for line in lines if first <= line <= last)
        if inner:
            parts.append(f"`{name}` {' '.join(_ranges(inner))}")
    return ", ".join(parts)


def _ranges(lines: Sequence[int]) -> Iterator[str]:
    first = last = lines[0]
    for line in [*lines[1:], -1]:
        if line == last + 1:
            last = line
            continue
        yield str(first) if first == last else f"{first}-{last}"
        first = last = line


INTRODUCTION = """# The safety path

What stops the motor, and what turns it: two lists of modules. They are the contracts *stopping* and *turning* of
`pyproject.toml`; `tests/test_safety_path.py` holds them. The stopping list has at most {most} statements and imports
nothing of ours but what stands in the two lists, and errors. Whoever reviews the program for a bench reads the first
list whole, and the second with the drills beside it.

Made by `python -m tests.safety_path docs/reference/safety-path.md`.
"""
DRILLS = """
## What each drill proves

For each row of [the drills](../drills.md) the lines of both lists that are carried out in the run with the fault and
not in the same run with the fault taken out, by function. Where nothing stands, the fault goes through lines that a
sound run takes as well; what the drill proves then is what they answer.

| fault | module | lines |
|---|---|---|
"""


def lists_table() -> Iterator[str]:
    """Both lists as tables, a line each."""
    for name in LISTS:
        listed = modules(name)
        counted = {module: statements(module) for module in listed}
        yield f"\n## {name.capitalize()}: {sum(counted.values())} statements\n"
        yield "| module | statements | what it is |\n|---|---:|---|"
        for module in listed:
            tree = ast.parse(source(module).read_text(encoding="utf-8"))
            first = (ast.get_docstring(tree) or "").split("\n\n")[0].replace("\n", " ")
            yield f"| `{module}` | {counted[module]} | {first.replace('|', '/')} |"


def drill_rows(drills: Sequence[Drill]) -> Iterator[str]:
    """The rows of the drills' table, a line each; says how far it is."""
    with stage(seed=0) as staged:
        for number, drill in enumerate(drills, 1):
            print(f"[{number}/{len(drills)}] {drill.name}", file=sys.stderr)
            name = drill.name
            for module, lines in proved(drill, staged).items():
                yield f"| {name} | `{module}` | {worded(module, lines)} |"
                name = ""
            if name:
                yield f"| {name} | | |"


def main(arguments: Sequence[str] | None = None) -> None:
    """Write the page."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else "")
    parser.add_argument("page", type=Path)
    parser.add_argument("--drill", action="append", help="only these rows")
    parser.add_argument(
        "--lists", action="store_true", help="keep the rows of the drills as they are"
    )
    chosen = parser.parse_args(arguments)
    if chosen.lists:
        rows = chosen.page.read_text(encoding="utf-8").split(DRILLS)[1].rstrip()
    else:
        rows = "\n".join(drill_rows(chosen_drills(chosen.drill or ())))
    page = [INTRODUCTION.format(most=MOST_STOPPING), *lists_table()]
    text = "\n".join(page) + "\n" + DRILLS + rows + "\n"
    chosen.page.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
