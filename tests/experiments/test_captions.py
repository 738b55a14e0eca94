"""Every figure of an analysis says under it what is seen, and when it is good."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import experiments

PLACES = Path(experiments.__file__).parent
LEAST_WORDS = 12
WITHOUT_JUDGEMENT = frozenset({"figure-16", "cogging", "revolution"})
"""Figures that show what is, of which nothing is better or worse."""
_JUDGES = ("ood where", "ood below", "the lower the better", "is perfect", "comes from the bench")
_JUDGES += ("below 1 is excellent", "the floor is noise", "nears a resonance")


def figures() -> Iterator[tuple[str, ast.Call]]:
    for file in sorted(PLACES.rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "Plot":
                yield f"{file.relative_to(PLACES)}:{node.lineno}", node


def words_of(node: ast.expr | None) -> str:
    """The words of a text in the source, a number in place of what is put into it."""
    if isinstance(node, ast.Constant):
        return str(node.value)
    if isinstance(node, ast.JoinedStr):
        return "".join(words_of(part) for part in node.values)
    if isinstance(node, ast.BinOp):
        return words_of(node.left) + words_of(node.right)
    return "1" if node is not None else ""


def test_every_figure_says_what_is_seen_and_when_it_is_good() -> None:
    found = dict(figures())
    assert len(found) > 20
    faults = {}
    for place, call in found.items():
        given = {one.arg: one.value for one in call.keywords}
        if isinstance(given.get("note"), (ast.Name, ast.Attribute)):
            continue  # Composed above the figure, or the sentence of what was found; the whole chain has them.
        name, told = words_of(given.get("name")), words_of(given.get("note"))
        is_judged = name in WITHOUT_JUDGEMENT or any(one in told for one in _JUDGES)
        is_sentence = told[:1].isupper() and told.endswith((".", "1"))
        if len(told.split()) < LEAST_WORDS or not is_judged or not is_sentence:
            faults[place] = told
    assert not faults
