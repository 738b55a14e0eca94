"""Every command that the program tells people to type is one that there is, with options that it has."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer

from experiments import catalogue
from experiments.parameters import parameter_fields
from rig.main import app

ROOT = Path(__file__).parents[3]
FILES = sorted(
    path
    for package in ("rig", "experiments", "drivers", "model", "sim_backend")
    for path in (ROOT / package).rglob("*.py")
)
_COMMAND = re.compile(
    r"(?:^|[`:\'\"(→] ?|\b(?:with|by|use|run|type|then|again|anew|make|it) )"
    r"rig ([a-z][a-z-]*)((?: [^`'\"\n)]*)?)",
    re.IGNORECASE,
)
"""A command behind a mark or a word that leads to one, and what goes on behind it; a rig is a thing elsewhere."""
_FLAG = re.compile(r"(?<![\w-])--[a-z][a-z0-9-]+")
NOT_TYPED = frozenset({"came", "could", "lives", "cannot", "description", "first", "only"})
"""Words behind a rig that is a thing, where a sentence begins with it."""


def texts_of(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """The string literals of a module but for docstrings; what is filled in stands as X."""
    docs = {
        id(node.value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    }
    inside = {
        id(part)
        for node in ast.walk(tree)
        if isinstance(node, ast.JoinedStr)
        for part in node.values
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            parts = [str(p.value) if isinstance(p, ast.Constant) else "X" for p in node.values]
            yield node.lineno, "".join(parts)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            texts = [] if id(node) in docs | inside else [node.value]
            yield from ((node.lineno, text) for text in texts)


def commands_in(text: str) -> Iterator[tuple[list[str], list[str]]]:
    """The words and the flags of each command that a text names."""
    for word, rest in _COMMAND.findall(text):
        if word in NOT_TYPED:
            continue
        # A sentence that goes on behind the command is none of it.
        said = re.split(r"[.,;:] |\.$", rest)[0]
        yield [word, *said.split()], _FLAG.findall(said)


def found(top: Any, words: list[str]) -> Any:
    """The command that the words name, as deep as they go; None where there is none."""
    command = top
    for word in words:
        inner = getattr(command, "commands", None)
        if inner is None or word.startswith("-") or word in ("X", "COMMAND"):
            break
        if word not in inner:
            return None if command is top or word.islower() else command
        command = inner[word]
    return command


def flags_of(command: Any) -> set[str]:
    """What a command takes; one that passes a protocol's flags on takes those of all of them."""
    flags = {
        name
        for parameter in command.params
        for name in (*parameter.opts, *parameter.secondary_opts)
    }
    if command.context_settings.get("ignore_unknown_options"):
        for name in catalogue.names():
            flags |= {field.flag for field in parameter_fields(catalogue.load(name).parameters)}
        flags |= {f"--{flag[2:]}" for flag in card_flags()}
    return flags | {"--help"}


def card_flags() -> set[str]:
    from rig.gears.facts import GearFacts

    return {field.flag for field in parameter_fields(GearFacts)}


def wrong(text: str, top: Any) -> Iterator[str]:
    """What is wrong with the commands in a text."""
    for words, flags in commands_in(text):
        command = found(top, words)
        if command is None:
            yield f"no command: rig {' '.join(words)}"
            continue
        for flag in flags:
            if flag not in flags_of(command) and not hasattr(command, "commands"):
                yield f"no option {flag}: rig {' '.join(words)}"


@pytest.fixture(scope="module")
def top() -> Any:
    return typer.main.get_command(app)


def test_every_command_that_is_told_is_there(top: Any) -> None:
    troubles, told = [], 0
    for path in FILES:
        for line, text in texts_of(ast.parse(path.read_text(encoding="utf-8"))):
            told += sum(1 for _ in commands_in(text))
            troubles += [f"{path.relative_to(ROOT)}:{line}: {one}" for one in wrong(text, top)]
    assert told > 100
    assert not troubles, "\n".join(troubles)


@pytest.mark.parametrize(
    ("text", "trouble"),
    [
        ("Fit it first: rig fit X.", ""),
        ("Fit it first: rig fitt X.", "no command"),
        ("Name it: rig gear set SERIAL --part X", ""),
        ("Name it: rig gear forget SERIAL", "no command"),
        ("Try `rig runs --all-of-them`.", "no option --all-of-them"),
        ("rig run friction --points 6", ""),
        ("the rig is not armed", ""),
        ("Take it off: rig gear set SERIAL --parts X", "no option --parts"),
    ],
)
def test_a_wrong_one_is_found(text: str, trouble: str, top: Any) -> None:
    found = list(wrong(text, top))
    assert bool(found) == bool(trouble)
    assert all(trouble in one for one in found)
