"""Numbers in parameter files: one line holds the value, its unit, where it comes from and its uncertainty.

    flexspline_diameter = { value = 63.5, unit = "mm", provenance = "catalogue", source = "drawing 12" }

A unit is checked against the dimension of the quantity and converted to SI; what is written is read back to the same
floating-point number. Files are TOML, read with the standard library.
"""

from __future__ import annotations

import dataclasses
import difflib
import json
import math
import tomllib
from collections.abc import Iterable, Mapping
from fractions import Fraction
from importlib import resources
from pathlib import Path
from typing import Any, Literal, TypeGuard, get_args

from model.errors import ParameterError, path_of
from model.gear import Origin, Provenance
from model.sections import Section, allowed_range, is_unknown
from model.unit_text import Unit, fitting

LARGEST_FILE = 1_000_000
"""Bytes; a parameter file is a few kilobytes, so anything longer is the wrong file."""

_READABLE: dict[str, tuple[str, ...]] = {
    "m": ("mm",),
    "rad": ("deg", "arcmin"),
    "rad/s": ("r/min",),
    "Pa": ("GPa",),
    "m2/s": ("mm2/s",),
    "N m s/rad": ("mN m/(r/min)",),
}
"""Units tried when writing."""

_PREFERRED = frozenset({"m", "rad", "Pa", "m2/s"})
"""SI units whose readable unit is taken even where its text is two characters longer."""

_ENTRY_KEYS = ("value", "unit", "provenance", "source", "standard_uncertainty")


def to_si(value: float, unit: str, si_unit: str, where: str) -> float:
    """The value in `si_unit` of a number given in `unit`; a unit of another dimension is refused."""
    if unit == si_unit or (si_unit == "1" and unit == ""):
        return value
    return _in_si(value, fitting(unit, si_unit, where))


def _in_si(value: float, unit: Unit) -> float:
    """A number of this unit in SI, rounded once where the factor is rational."""
    factor = unit.factor
    return float(Fraction(repr(value)) * factor) if isinstance(factor, Fraction) else value * factor


def number(value: object, where: str, limit: str) -> float:
    """A finite number as float; text, booleans, dates, NaN and infinities are refused."""
    try:
        if isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value):
            return float(value)
    except OverflowError:
        pass
    text = value if isinstance(value, float) else shorten(value)
    raise ParameterError("is not a finite number", where=where, value=text, limit=limit)


def shorten(value: object) -> str:
    """A value as it may appear in a one-line message."""
    try:
        text = json.dumps(value, ensure_ascii=False, default=str)
    except (ValueError, RecursionError):
        text = f"({type(value).__name__})"
    return text if len(text) <= 60 else text[:57] + "..."


def check_keys(keys: Iterable[str], allowed: Iterable[str], where: str, remedy: str = "") -> None:
    """Refuse the first key that is not allowed, naming its path and the nearest allowed one."""
    names = list(allowed)
    for key in keys:
        if key not in names:
            near = difflib.get_close_matches(str(key), names, n=1)
            hint = remedy or "Known here: " + ", ".join(names)
            if near:
                hint = f'Did you mean "{near[0]}"?'
            raise ParameterError("no such parameter", where=path_of(where, str(key)), remedy=hint)


def is_table(value: object) -> TypeGuard[Mapping[str, Any]]:
    """Whether what stood in a parameter file is a table."""
    return isinstance(value, Mapping)


def read_origin(entry: Mapping[str, Any], where: str) -> tuple[Provenance, str]:
    """Provenance and source of one entry, both checked."""
    provenance = entry.get("provenance", "assumed")
    if provenance not in get_args(Provenance):
        limit = ", ".join(get_args(Provenance))
        raise ParameterError(
            "is no known provenance",
            where=f"{where}.provenance",
            value=shorten(provenance),
            limit=limit,
        )
    source = entry.get("source", "")
    if not isinstance(source, str):
        raise ParameterError("is not text", where=f"{where}.source", value=shorten(source))
    return provenance, source


def _read_quantity(entry: object, meta: Mapping[str, Any], where: str) -> tuple[float, Origin]:
    """One quantity in SI with its origin, from `{ value = .., unit = "..", .. }`."""
    limit = allowed_range(meta)
    unit = meta["unit"]
    if not is_table(entry):
        form = "{ value = .., unit = " + json.dumps(unit) + ', provenance = "..", source = ".." }'
        raise ParameterError(
            "is not a quantity",
            where=where,
            value=shorten(entry),
            limit=limit,
            remedy=f"Write {form}.",
        )
    check_keys(entry, _ENTRY_KEYS, where)
    if "value" not in entry:
        raise ParameterError(
            "has no value", where=f"{where}.value", limit=limit, remedy="Give the number."
        )
    given = entry.get("unit", "1" if unit == "1" else None)
    if not isinstance(given, str):
        raise ParameterError(
            "has no unit",
            where=f"{where}.unit",
            value=shorten(given),
            limit=unit,
            remedy="Give the unit.",
        )
    value = to_si(number(entry["value"], where, limit), given, unit, f"{where}.unit")
    provenance, source = read_origin(entry, where)
    # Who reads the value later is told that a pound was taken for a force.
    remark = "" if given == unit or not given else fitting(given, unit).remark
    source = "; ".join(filter(None, (source, remark)))
    uncertainty = None
    if "standard_uncertainty" in entry:
        path = f"{where}.standard_uncertainty"
        uncertainty = to_si(number(entry["standard_uncertainty"], path, ">= 0"), given, unit, path)
        if uncertainty < 0.0:
            raise ParameterError("is negative", where=path, value=uncertainty, limit=">= 0")
    return value, Origin(provenance, source, uncertainty)


def read_section(
    kind: type[Section], table: object, where: str
) -> tuple[dict[str, Any], dict[str, Origin]]:
    """The arguments of a section and the origin of each, from its table; `where` is the path of the table."""
    if not is_table(table):
        raise ParameterError("is not a table of quantities", where=where, value=shorten(table))
    fields = [f for f in dataclasses.fields(kind) if "unit" in f.metadata]
    check_keys(table, [f.name for f in fields], where)
    arguments: dict[str, Any] = {}
    origins: dict[str, Origin] = {}
    for f in fields:
        path = f"{where}.{f.name}"
        if f.name not in table and is_unknown(f, None):
            continue
        if f.name not in table:
            remedy = f"Give the {f.metadata['description']} in {f.metadata['unit']}."
            raise ParameterError(
                "is missing", where=path, limit=allowed_range(f.metadata), remedy=remedy
            )
        value, origin = _read_quantity(table[f.name], f.metadata, path)
        arguments[f.name] = int(value) if f.type in ("int", int) and value == int(value) else value
        origins[f.name] = origin
    return arguments, origins


def entry_of(value: float, unit: str, origin: Origin) -> dict[str, Any]:
    """One quantity as plain JSON-able data, in SI."""
    entry: dict[str, Any] = {
        "value": value,
        "unit": unit,
        "provenance": origin.provenance,
        "source": origin.source,
    }
    if origin.standard_uncertainty is not None:
        entry["standard_uncertainty"] = origin.standard_uncertainty
    return entry


def readable(values: Iterable[float], si_unit: str) -> tuple[list[str], str]:
    """Texts, in one readable unit, that read back to exactly these SI values; and that unit.

    A readable unit (mm, deg) is taken where its text is hardly longer than that in SI.
    """
    numbers = list(values)
    best: tuple[list[str], str] = ([repr(v) for v in numbers], si_unit)
    shortest = sum(map(len, best[0])) + (2 if si_unit in _PREFERRED else 0)
    for unit in _READABLE.get(si_unit, ()):
        factor = fitting(unit, si_unit).scale
        texts = [_exact_text(v, v / factor, unit, si_unit) for v in numbers]
        exact = [text for text in texts if text is not None]
        length = sum(map(len, exact))
        if len(exact) == len(numbers) and length < shortest:
            best, shortest = (exact, unit), length
    return best


def _exact_text(value: float, converted: float, unit: str, si_unit: str) -> str | None:
    """The shortest decimal of `converted` [unit] that is `value` [si_unit] again, or None when there is none."""
    for digits in (6, 12, 15, 16, 17):
        text = repr(float(f"{converted:.{digits}g}"))
        if math.isfinite(float(text)) and to_si(float(text), unit, si_unit, unit) == value:
            return text
    return None


def text_in(value: float, unit: str, si_unit: str) -> str:
    """The shortest decimal in `unit` that reads back to this SI value; the nearest one where no decimal does."""
    converted = value if unit == si_unit else value / fitting(unit, si_unit).scale
    return _exact_text(value, converted, unit, si_unit) or repr(converted)


def quote(text: str) -> str:
    """A TOML basic string."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def entry_text(numbers: Mapping[str, float], si_unit: str, origin: Origin) -> str:
    """What stands between the braces of an entry: its numbers by name in one readable unit, and their origin."""
    uncertainty = origin.standard_uncertainty
    values = [*numbers.values()] if uncertainty is None else [*numbers.values(), uncertainty]
    texts, unit = readable(values, si_unit)
    parts = [f"{name} = {text}" for name, text in zip(numbers, texts, strict=False)]
    parts += [
        f"unit = {quote(unit)}",
        f"provenance = {quote(origin.provenance)}",
        f"source = {quote(origin.source)}",
    ]
    if uncertainty is not None:
        parts.append(f"standard_uncertainty = {texts[-1]}")
    return ", ".join(parts)


def _quantity_line(name: str, value: float, meta: Mapping[str, Any], origin: Origin) -> str:
    """The line of one quantity in a parameter file, with its symbol and description as a comment."""
    text = entry_text({"value": value}, meta["unit"], origin)
    comment = ": ".join(filter(None, (meta["symbol"], meta["description"])))
    return f"{name} = {{ {text} }}  # {comment}"


def section_lines(part: Section, origins: Mapping[str, Origin]) -> list[str]:
    """All quantity lines of a section; `origins` by field name."""
    fields = [f for f in dataclasses.fields(part) if "unit" in f.metadata]
    unknown = Origin("assumed")
    return [
        _quantity_line(f.name, getattr(part, f.name), f.metadata, origins.get(f.name, unknown))
        for f in fields
        if not is_unknown(f, getattr(part, f.name))
    ]


def read_shipped(kind: Literal["gear", "motor"], name: str) -> dict[str, Any]:
    """The content of a file that comes with the program; `ParameterError` lists those there are for an unknown name."""
    folder = resources.files("model") / f"{kind}s"
    file = f"{name}.toml"
    files = sorted(entry.name for entry in folder.iterdir() if entry.name.endswith(".toml"))
    if file not in files:
        raise ParameterError(
            f"no such shipped {kind}",
            where=kind,
            value=shorten(name),
            limit=", ".join(file.removesuffix(".toml") for file in files),
        )
    return parse_toml((folder / file).read_bytes(), file)


def read_toml(path: str | Path) -> dict[str, Any]:
    """The content of a TOML file; anything that is not readable TOML is a `ParameterError` with the file's path."""
    return parse_toml(read_raw(path), str(path))


def read_raw(path: str | Path) -> bytes:
    """The bytes of a parameter file. Raises `ParameterError` with the file's path."""
    where = str(path)
    try:
        with Path(path).open("rb") as stream:
            raw = stream.read(LARGEST_FILE + 1)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise ParameterError(
            f"cannot be read: {reason}", where=where, remedy="Check the path."
        ) from error
    if len(raw) > LARGEST_FILE:
        raise ParameterError(
            "is too long for a parameter file", where=where, limit=f"<= {LARGEST_FILE} bytes"
        )
    return raw


def parse_toml(raw: bytes, where: str) -> dict[str, Any]:
    """The content of TOML text; `where` names it in messages."""
    try:
        return tomllib.loads(raw.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        what = f"is not UTF-8 text (byte {error.start})"
        raise ParameterError(what, where=where, remedy="Save the file as UTF-8.") from error
    except tomllib.TOMLDecodeError as error:
        raise ParameterError(
            f"is not valid TOML: {error}", where=where, remedy="Correct the line."
        ) from error
    except (RecursionError, ValueError, OverflowError) as error:
        what = f"is not valid TOML: {type(error).__name__}"
        raise ParameterError(what, where=where, remedy="Is this a parameter file?") from error


def write_text(text: str, path: str | Path) -> None:
    """Write a parameter file; a folder that cannot be written is a `ParameterError`."""
    try:
        Path(path).write_text(text, encoding="utf-8", newline="\n")
    except OSError as error:
        what = f"cannot be written: {error.strerror or error}"
        raise ParameterError(
            what, where=str(path), remedy="Choose a folder that can be written."
        ) from error


def within(error: ParameterError, where: str) -> ParameterError:
    """The same refusal with the file (or run) named before the path of the value."""
    path = ": ".join(filter(None, (where, error.where)))
    return ParameterError(
        error.what, where=path, value=error.value, limit=error.limit, remedy=error.remedy
    )
