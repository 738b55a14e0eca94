"""Mutants of a module's syntax tree: every place where something may be changed, and a draw from all of them.

Changed are comparisons, + - * / & |, `and`, `or`, `not`, signs, numbers, truth values, conditions, what is returned,
and whether a statement is there at all. Left alone are text (strings, documentation, what is logged or printed),
annotations, decorators, imports and what only a type checker reads.
"""

from __future__ import annotations

import ast
import copy
import difflib
import hashlib
import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

COMPARED: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
SWAPPED: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
}
TEXTUAL = ("log", "logging", "logger", "warnings", "print", "echo")
"""Calls that only say something."""


@dataclass(frozen=True)
class Mutant:
    """A change of a module: lines are counted from 1, `start` and `stop` are offsets into its text."""

    module: str
    line: int
    last_line: int
    kind: str
    start: int
    stop: int
    text: str

    def applied(self, source: str) -> str:
        """The module's text with the change in it."""
        return source[: self.start] + self.text + source[self.stop :]

    def diff(self, source: str) -> str:
        """The lines that differ."""
        pair = (source.splitlines(), self.applied(source).splitlines())
        lines = list(difflib.unified_diff(*pair, n=0, lineterm=""))[3:]
        return "\n".join(lines)

    def key(self, source: str) -> str:
        """Which mutant it is, of this text."""
        whole = f"{self.module}:{self.start}:{self.stop}:{self.text}:{source}"
        return hashlib.sha256(whole.encode()).hexdigest()[:16]


class Places(ast.NodeVisitor):
    """Goes through a tree and notes what may be changed in it."""

    def __init__(self, module: str, source: str) -> None:
        self.module, self.source = module, source
        self.found: list[Mutant] = []
        lines = source.splitlines(keepends=True)
        self._lines = [line.encode() for line in lines]
        self._begins = [0]
        for line in lines:
            self._begins.append(self._begins[-1] + len(line))

    def _offset(self, line: int, column: int) -> int:
        """Columns of the tree are counted in bytes."""
        return self._begins[line - 1] + len(self._lines[line - 1][:column].decode())

    def _note(self, node: ast.expr | ast.stmt, kind: str, text: str) -> None:
        last, column = node.end_lineno or node.lineno, node.end_col_offset or 0
        start, stop = self._offset(node.lineno, node.col_offset), self._offset(last, column)
        self.found.append(Mutant(self.module, node.lineno, last, kind, start, stop, text))

    def _note_node(self, node: ast.expr, kind: str, **changed: object) -> None:
        other = copy.deepcopy(node)
        for name, value in changed.items():
            setattr(other, name, value)
        self._note(node, kind, f"({ast.unparse(other)})")

    # What is left alone -----------------------------------------------------------------------------------------------

    def visit_JoinedStr(self, node: ast.JoinedStr) -> None:
        """Text."""

    def visit_Import(self, node: ast.Import) -> None:
        """What a module needs."""

    def visit_ImportFrom(self, node: ast.ImportFrom) -> None:
        """The same."""

    def visit_arg(self, node: ast.arg) -> None:
        """Annotations of arguments."""

    def visit_Call(self, node: ast.Call) -> None:
        if not _is_textual(node):
            self.generic_visit(node)

    def visit_FunctionDef(self, node: ast.FunctionDef | ast.AsyncFunctionDef) -> None:
        for default in (*node.args.defaults, *filter(None, node.args.kw_defaults)):
            self.visit(default)
        self._body(node.body)

    visit_AsyncFunctionDef = visit_FunctionDef

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        self._body(node.body)

    def _body(self, body: Sequence[ast.stmt]) -> None:
        for statement in body:
            self.visit(statement)

    # What is changed --------------------------------------------------------------------------------------------------

    def visit_Compare(self, node: ast.Compare) -> None:
        for at, operator in enumerate(node.ops):
            for other in COMPARED[type(operator)]:
                self._note_node(
                    node, "comparison", ops=[*node.ops[:at], other(), *node.ops[at + 1 :]]
                )
        self.generic_visit(node)

    def visit_BinOp(self, node: ast.BinOp) -> None:
        other = SWAPPED.get(type(node.op))
        if other is not None and not _is_text(node):
            self._note_node(node, "operator", op=other())
        self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        self._note_node(node, "and, or", op=ast.Or() if isinstance(node.op, ast.And) else ast.And())
        self.generic_visit(node)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:
        if isinstance(node.op, ast.Not):
            self._note(node, "not", f"bool({ast.unparse(node.operand)})")
        elif isinstance(node.op, ast.USub):
            self._note(node, "sign", f"({ast.unparse(node.operand)})")
        self.generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> None:
        value = node.value
        if isinstance(value, bool):
            self._note(node, "truth value", str(not value))
        elif isinstance(value, (int, float)):
            self._note(node, "number", f"({value!r} + 1)")
            if value:
                self._note(node, "number", "0" if isinstance(value, int) else "0.0")

    def visit_If(self, node: ast.If) -> None:
        if ast.unparse(node.test) == "TYPE_CHECKING":
            return
        self._negate(node.test)
        self.generic_visit(node)

    def visit_IfExp(self, node: ast.IfExp) -> None:
        self._negate(node.test)
        self.generic_visit(node)

    def visit_While(self, node: ast.While) -> None:
        self._negate(node.test)
        self.generic_visit(node)

    def _negate(self, test: ast.expr) -> None:
        # A comparison and a `not` have mutants of their own that say the same.
        if not isinstance(test, (ast.Compare, ast.UnaryOp, ast.Constant)):
            self._note(test, "condition", f"(not ({ast.unparse(test)}))")

    def visit_Return(self, node: ast.Return) -> None:
        if node.value is None:
            return
        if not (isinstance(node.value, ast.Constant) and node.value.value is None):
            self._note(node.value, "returned", "None")
        self.visit(node.value)

    def visit_Expr(self, node: ast.Expr) -> None:
        if isinstance(node.value, ast.Constant) or _is_textual(node.value):
            return
        self._note(node, "statement left out", "pass")
        self.visit(node.value)

    def visit_Assign(self, node: ast.Assign) -> None:
        if any(isinstance(target, ast.Name) and target.id == "__all__" for target in node.targets):
            return
        # A name that is not bound fails everywhere: only what changes something that is there.
        if all(isinstance(target, (ast.Attribute, ast.Subscript)) for target in node.targets):
            self._note(node, "statement left out", "pass")
        self.visit(node.value)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self.visit(node.value)

    def visit_AugAssign(self, node: ast.AugAssign) -> None:
        self._note(node, "statement left out", "pass")
        other = SWAPPED.get(type(node.op))
        if other is not None and not _is_text(node.value):
            changed = copy.deepcopy(node)
            changed.op = other()
            self._note(node, "operator", ast.unparse(changed))
        self.visit(node.value)

    def visit_Raise(self, node: ast.Raise) -> None:
        self._note(node, "statement left out", "pass")

    def visit_Delete(self, node: ast.Delete) -> None:
        self._note(node, "statement left out", "pass")


def _is_textual(node: ast.AST) -> bool:
    """Whether it is a call that only says something."""
    if not isinstance(node, ast.Call):
        return False
    names = ast.unparse(node.func).split(".")
    return any(name.strip("_") in TEXTUAL for name in names)


def _is_text(node: ast.expr) -> bool:
    return any(
        isinstance(part, ast.JoinedStr)
        or (isinstance(part, ast.Constant) and isinstance(part.value, (str, bytes)))
        for part in ast.walk(node)
    )


def places(module: str, source: str) -> list[Mutant]:
    """Every mutant of this text, each of them once and none that cannot be compiled."""
    visitor = Places(module, source)
    visitor.visit(ast.parse(source))
    found = {(m.start, m.stop, m.text): m for m in visitor.found}
    return [mutant for mutant in found.values() if _compiles(mutant.applied(source))]


def _compiles(source: str) -> bool:
    try:
        compile(source, "mutant", "exec", dont_inherit=True)
    except (SyntaxError, ValueError):
        return False
    return True


def drawn(root: Path, modules: Sequence[str], count: int, seed: int) -> Iterator[Mutant]:
    """So many of all mutants of these modules (paths below `root`), each as likely as any other."""
    every = [
        mutant
        for module in modules
        for mutant in places(module, (root / module).read_text(encoding="utf-8"))
    ]
    yield from random.Random(seed).sample(every, min(count, len(every)))


def modules_of(root: Path, listed: Sequence[str]) -> list[str]:
    """The modules of a list (paths, dotted names, or packages: all that is in them; # begins a comment), as paths."""
    found: list[str] = []
    for line in listed:
        word = line.partition("#")[0].strip()
        if not word:
            continue
        path = Path(word if word.endswith(".py") or "/" in word else word.replace(".", "/"))
        whole = root / path
        if whole.is_dir():
            found += [each.relative_to(root).as_posix() for each in sorted(whole.rglob("*.py"))]
        elif (module := path.with_suffix(".py")) and (root / module).is_file():
            found.append(module.as_posix())
        else:
            raise FileNotFoundError(f"no module {word} below {root}")
    return list(dict.fromkeys(found))
