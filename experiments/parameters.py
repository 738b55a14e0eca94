"""The parameter model of a protocol: a frozen dataclass whose `Annotated` fields are the only
definition of its numbers.

CLI flags, the window's form, file attributes and the table of the documentation are all made from it. Constraints come
from annotated_types (`Ge`, `Gt`, `Le`, `Lt`), the unit and the explanation from `Unit` and `Help`:

    speed_rpm: Annotated[float, Gt(0.0), Le(120.0), Unit("r/min"), Help("input speed")] = 30.3
"""

from __future__ import annotations

import dataclasses
import functools
import math
import types
import typing
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from annotated_types import Ge, Gt, Le, Lt

from experiments.errors import PlanError
from model.errors import path_of


@dataclass(frozen=True, slots=True)
class Unit:
    """The unit of a parameter, as shown beside its number."""

    symbol: str


@dataclass(frozen=True, slots=True)
class Help:
    """What a parameter is, in a few words."""

    text: str


@dataclass(frozen=True, slots=True)
class FileContent:
    """A text parameter that is the content of a file: where a path is said, the file is read first."""

    format: str
    """What the file holds: TOML."""


@dataclass(frozen=True, kw_only=True)
class ParameterField:
    """One parameter as flags, forms and tables need it. `kind` is float, int, bool, str or tuple (of floats).

    `optional` is one that may be unknown: declared `float | None`, None where nothing is known. `content` is the format
    of the file whose content it is, "" for every other.
    """

    name: str
    kind: type
    default: Any
    unit: str
    help: str
    limit: str
    checks: tuple[Any, ...]
    optional: bool = False
    content: str = ""

    @property
    def flag(self) -> str:
        """The command-line flag."""
        return "--" + self.name.replace("_", "-")


_COMPARE: Mapping[type[Any], tuple[Callable[[Any, Any], bool], Callable[[Any], str]]] = {
    Ge: (lambda v, c: v >= c.ge, lambda c: f">= {c.ge:g}"),
    Gt: (lambda v, c: v > c.gt, lambda c: f"> {c.gt:g}"),
    Le: (lambda v, c: v <= c.le, lambda c: f"<= {c.le:g}"),
    Lt: (lambda v, c: v < c.lt, lambda c: f"< {c.lt:g}"),
}


@functools.cache
def parameter_fields(model: type[Any]) -> tuple[ParameterField, ...]:
    """The fields of a parameter model in the order they are declared."""
    hints = typing.get_type_hints(model, include_extras=True)
    parameters: list[ParameterField] = []
    for f in dataclasses.fields(model):
        hint = hints[f.name]
        notes, base = (), hint
        if hasattr(hint, "__metadata__"):
            notes, base = hint.__metadata__, hint.__origin__
        if isinstance(base, types.GenericAlias):
            base = typing.get_origin(base)
        arms = typing.get_args(base) if isinstance(base, types.UnionType) else ()
        base = next((arm for arm in arms if arm is not type(None)), base)
        checks = tuple(n for n in notes if type(n) in _COMPARE)
        unit = next((n.symbol for n in notes if isinstance(n, Unit)), "")
        text = next((n.text for n in notes if isinstance(n, Help)), "")
        content = next((n.format for n in notes if isinstance(n, FileContent)), "")
        limit = " and ".join(_COMPARE[type(c)][1](c) for c in checks)
        default = f.default if f.default is not dataclasses.MISSING else None
        kind = typing.cast(type, base)
        parameters.append(
            ParameterField(
                name=f.name,
                kind=kind,
                default=default,
                unit=unit,
                help=text,
                limit=limit,
                checks=checks,
                optional=type(None) in arms,
                content=content,
            )
        )
    return tuple(parameters)


def make_parameters(model: type[Any], values: Mapping[str, Any], where: str = "") -> Any:
    """A parameter model from text or numbers: unknown keys, wrong types and values out of range are refused by name."""
    fields = {f.name: f for f in parameter_fields(model)}
    for name in values:
        if name not in fields:
            names = ", ".join(fields)
            raise PlanError(
                "no such parameter",
                where=path_of(where, name),
                remedy=f"Known: {names}.",
            )
    converted = {name: _convert(fields[name], value, where) for name, value in values.items()}
    parameters = model(**converted)
    check_parameters(parameters, where)
    return parameters


def check_parameters(parameters: object, where: str = "") -> None:
    """Raise `PlanError` for the first value outside its declared range."""
    for f in parameter_fields(type(parameters)):
        value: tuple[float, ...] | float | str | None = getattr(parameters, f.name)
        if value is None and f.optional:
            continue
        for number in value if isinstance(value, tuple) else (value,):
            _check(f, number, where)


def _convert(f: ParameterField, value: Any, where: str) -> Any:
    path = path_of(where, f.name)
    if f.optional and (value is None or value == ""):
        return None
    try:
        if f.kind is tuple:
            parts = value.replace(",", " ").split() if isinstance(value, str) else value
            return tuple(float(p) for p in parts)
        if f.kind is bool:
            if isinstance(value, bool):
                return value
            return {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}[
                str(value).lower()
            ]
        if f.kind is int and isinstance(value, float) and not value.is_integer():
            raise ValueError
        return f.kind(value)
    except (ValueError, KeyError, TypeError, OverflowError):
        wanted = {
            int: "a whole number",
            float: "a number",
            bool: "true or false",
            tuple: "numbers",
        }.get(f.kind, "text")
        raise PlanError(
            "is of the wrong kind", where=path, value=repr(value), limit=wanted
        ) from None


def _check(f: ParameterField, value: Any, where: str) -> None:
    path = path_of(where, f.name)
    unit = f" {f.unit}" if f.unit else ""
    if isinstance(value, float) and not math.isfinite(value):
        limit = f"{f.limit}{unit}" if f.limit else "finite"
        raise PlanError("is not a finite number", where=path, value=value, limit=limit)
    for c in f.checks:
        if not _COMPARE[type(c)][0](value, c):
            raise PlanError(
                "is out of range", where=path, value=f"{value}{unit}", limit=f"{f.limit}{unit}"
            )
