"""The size of the house, counted from its own files: what a newcomer would have to read.

    python -m tests.house             # the rooms, and what stands over a bar
    python -m tests.house --names     # beside it, the public names that nobody uses
    python -m tests.house --json

*Nodes* are the nodes of the syntax tree without docstrings, in the five packages, and ten for each line of .toml, .html, .typ and
.css that ships in them: what moves from code into data counts where it lands. Complexity is McCabe's: one for a function and one for
each branch, loop, handler, condition of a comprehension, boolean operator and case. Functions inside a function count as part of it.
"""  # noqa: E501

from __future__ import annotations

import argparse
import ast
import json
import re
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
FLOORS = ("rig", "model", "drivers", "experiments", "sim_backend")
DATA = (".toml", ".html", ".typ", ".css")
"""Endings of files that hold what could be code."""
WAS_CODE: tuple[str, ...] = ()
"""Further files that hold what was Python once, below the root."""
PER_LINE = 10
"""Nodes that a line of data counts."""
LONG, VERY_LONG = 50, 80
"""Lines of a function."""
LONG_FILE = 500
"""Lines of a file."""
COMPLEX = 20
MOST_NODES = 1_015_120
"""A ceiling: what is added takes something away. It may only sink."""
MOST_CONDITIONALS = 0.28
KERNELS = "model/kernels/"
"""Compiled: one function there is one loop, and counts for no bar of complexity."""

Function = ast.FunctionDef | ast.AsyncFunctionDef
BRANCHES = (ast.If, ast.IfExp, ast.For, ast.AsyncFor, ast.While, ast.ExceptHandler, ast.match_case)


@dataclass
class House:
    """What was counted; each list names its places."""

    nodes: dict[str, int] = field(default_factory=dict)
    """By room: the floor, and within `rig` its room."""
    functions: int = 0
    long_functions: list[str] = field(default_factory=list)
    very_long_functions: list[str] = field(default_factory=list)
    long_files: list[str] = field(default_factory=list)
    complex_functions: list[str] = field(default_factory=list)
    conditional_expressions: int = 0
    nested_conditionals: list[str] = field(default_factory=list)
    tall_conditionals: list[str] = field(default_factory=list)
    """Conditional expressions over more than two lines."""
    only_standard_types: list[str] = field(default_factory=list)
    """Files that ask pyright for less than strict, where strict is the rule."""
    unused_names: list[str] = field(default_factory=list)
    """Public names of modules that no other module, test, contract or page uses."""

    @property
    def total(self) -> int:
        """Nodes of all rooms."""
        return sum(self.nodes.values())

    @property
    def conditionals_per_function(self) -> float:
        return self.conditional_expressions / max(self.functions, 1)


def room_of(path: Path) -> str:
    """The floor of a file; in `rig` its room."""
    parts = path.parts
    return "/".join(parts[:2]) if parts[0] == "rig" and len(parts) > 2 else parts[0]


def without_docstrings(tree: ast.AST) -> Iterator[ast.AST]:
    """Every node but docstrings: strings that stand as a statement of their own."""
    for node in ast.walk(tree):
        for name, value in ast.iter_fields(node):
            if name == "body" and isinstance(value, list):
                node.body = [one for one in value if not _is_text(one)]  # pyright: ignore[reportAttributeAccessIssue]
    return ast.walk(tree)


def _is_text(node: ast.AST) -> bool:
    alone = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    return alone and isinstance(node.value.value, str)


def complexity(function: Function) -> int:
    """McCabe's number of a function, with what is defined in it."""
    total = 1
    for node in ast.walk(function):
        if isinstance(node, BRANCHES):
            total += 1
        elif isinstance(node, ast.BoolOp):
            total += len(node.values) - 1
        elif isinstance(node, ast.comprehension):
            total += 1 + len(node.ifs)
    return total


def outermost_functions(tree: ast.AST) -> Iterator[Function]:
    """Functions and methods, not those within a function."""
    for child in ast.iter_child_nodes(tree):
        if isinstance(child, (ast.FunctionDef, ast.AsyncFunctionDef)):
            yield child
        else:
            yield from outermost_functions(child)


def public_names(tree: ast.Module) -> Iterator[str]:
    """What a module and its classes define without an underscore: functions, classes, methods, constants, fields."""
    for node in tree.body:
        yield from _defined(node)
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            for inner in node.body:
                yield from _defined(inner)


def _defined(node: ast.stmt) -> Iterator[str]:
    if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
        yield node.name
    elif isinstance(node, (ast.Assign, ast.AnnAssign)):
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        yield from (one.id for one in targets if isinstance(one, ast.Name))


def count(root: Path = ROOT) -> House:
    """The house below `root`."""
    house = House()
    named: dict[str, list[str]] = {}
    for path in sorted(one for floor in FLOORS for one in (root / floor).rglob("*.py")):
        _count_module(house, path, path.relative_to(root), named)
    data = (
        one for floor in FLOORS for one in sorted((root / floor).rglob("*")) if one.suffix in DATA
    )
    for path in (*data, *(root / name for name in WAS_CODE)):
        _add(house, room_of(path.relative_to(root)), PER_LINE * len(path.read_text().splitlines()))
    house.unused_names = _unused(root, named)
    return house


def _add(house: House, room: str, nodes: int) -> None:
    house.nodes[room] = house.nodes.get(room, 0) + nodes


def _count_module(house: House, path: Path, name: Path, named: dict[str, list[str]]) -> None:
    text = path.read_text()
    lines = text.count("\n")
    if lines > LONG_FILE:
        house.long_files.append(f"{name}: {lines}")
    if re.match(r"# pyright: (standard|basic)", text) and name.parts[0] in (
        "model",
        "drivers",
        "experiments",
    ):
        house.only_standard_types.append(str(name))
    tree = ast.parse(text)
    named[str(name)] = [one for one in public_names(tree) if not one.startswith("_")]
    for function in outermost_functions(tree):
        _count_function(house, function, str(name))
    nodes = list(without_docstrings(tree))
    _add(house, room_of(name), len(nodes))
    for node in nodes:
        if isinstance(node, ast.IfExp):
            house.conditional_expressions += 1
            _note_conditional(house, node, f"{name}:{node.lineno}")


def _count_function(house: House, function: Function, name: str) -> None:
    house.functions += sum(
        isinstance(one, (ast.FunctionDef, ast.AsyncFunctionDef)) for one in ast.walk(function)
    )
    lines = (function.end_lineno or function.lineno) - function.lineno + 1
    place = f"{name}:{function.lineno} {function.name}"
    if lines > LONG:
        house.long_functions.append(f"{place}: {lines}")
    if lines > VERY_LONG:
        house.very_long_functions.append(f"{place}: {lines}")
    branches = complexity(function)
    if branches > COMPLEX and not name.startswith(KERNELS):
        house.complex_functions.append(f"{place}: {branches}")


def _note_conditional(house: House, node: ast.IfExp, place: str) -> None:
    if any(isinstance(one, ast.IfExp) for one in ast.walk(node) if one is not node):
        house.nested_conditionals.append(place)
    if (node.end_lineno or node.lineno) - node.lineno > 1:
        house.tall_conditionals.append(place)


def _unused(root: Path, named: dict[str, list[str]]) -> list[str]:
    """Names that stand in no other module, test, file of data or page, nor in pyproject.toml; a word is a use."""
    words: dict[str, Counter[str]] = {}
    for path in [
        *root.rglob("*.py"),
        *(path for ending in DATA for path in root.rglob(f"*{ending}")),
        *(root / "docs").rglob("*.md"),
        root / "pyproject.toml",
        root / "README.md",
    ]:
        if not {".venv", "build", ".git", "generated"} & set(path.relative_to(root).parts):
            words[str(path.relative_to(root))] = Counter(
                re.findall(r"\w+", path.read_text(errors="replace"))
            )
    where: Counter[str] = Counter(word for counted in words.values() for word in counted)
    return [
        f"{module}: {name}"
        for module, names in named.items()
        for name in dict.fromkeys(names)
        if where[name] - (name in words[module]) <= 0
    ]


def report(house: House, names: bool = False) -> str:
    """What is counted, as lines."""
    lines = [
        f"{nodes:8d}  {room}"
        for room, nodes in sorted(house.nodes.items(), key=lambda one: -one[1])
    ]
    lines.append(f"{house.total:8d}  nodes in all (at most {MOST_NODES})")
    lines.append(
        f"{house.conditionals_per_function:8.2f}  conditional expressions per function, of {house.functions} "
        f"(at most {MOST_CONDITIONALS})"
    )
    for title, (places, most) in places_of(house).items():
        lines.append(f"{len(places):8d}  {title} (at most {most})")
        if names or places is not house.unused_names:
            lines.extend(f"            {place}" for place in places)
    return "\n".join(lines)


def places_of(house: House) -> dict[str, tuple[list[str], int]]:
    """The places that were counted by what is wrong with them, and how many of them there may be."""
    return {
        f"functions above {VERY_LONG} lines": (house.very_long_functions, 0),
        f"functions above {LONG} lines": (house.long_functions, 20),
        f"files above {LONG_FILE} lines": (house.long_files, 0),
        f"functions above complexity {COMPLEX}, kernels apart": (house.complex_functions, 0),
        "nested conditional expressions": (house.nested_conditionals, 0),
        "conditional expressions over more than two lines": (house.tall_conditionals, 0),
        "files with less than strict types": (house.only_standard_types, 0),
        "public names that nothing else uses": (house.unused_names, 200),
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints the count; exit code 0."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "--names", action="store_true", help="name the public names that nobody uses"
    )
    parser.add_argument("--json", action="store_true", help="everything as one JSON object")
    parser.add_argument("--root", type=Path, default=ROOT, help="another checkout")
    chosen = parser.parse_args(arguments)
    house = count(chosen.root)
    print(json.dumps(asdict(house), indent=1) if chosen.json else report(house, chosen.names))
    return 0


if __name__ == "__main__":
    sys.exit(main())
