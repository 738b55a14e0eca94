"""The file of an encoder's certificate: a header in TOML behind "#", then the points as comma-separated values.

    # format = "harmonic-rig-certificate-1"
    # certificate = "D-K-15134 2026-03"
    # date = 2026-03-01
    # due = 2028-03-01
    # coverage_factor = 2.0
    # zero = "index mark"
    # sense = "counting up"
    # error = "shown minus true"
    angle [deg],error [arcsec],expanded uncertainty [arcsec]
    0,0.31,0.4

Units stand in the names of the columns; signs and senses are asked for, never guessed.
"""

from __future__ import annotations

import datetime
import math
import tomllib
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Final, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from model.angle_certificate import CERTIFIED_ORDERS, AngleCertificate, curve_of
from model.errors import ParameterError
from model.toml_text import toml_value
from model.unit_text import scale_in, understood
from model.units import ARCSEC, DEGREE, REVOLUTION

FORMAT: Final = "harmonic-rig-certificate-1"
LARGEST_FILE = 10_000_000
"""Bytes; a certificate has some dozens of points."""
COLUMNS = ("angle", "error", "expanded uncertainty")


class Header(BaseModel):
    """What a certificate says beside its points. `sense`: whether its angle grows as the encoder counts up or down."""

    model_config = ConfigDict(extra="forbid", frozen=True, str_strip_whitespace=True)

    format: Literal["harmonic-rig-certificate-1"]
    certificate: str = Field(min_length=1)
    date: datetime.date
    due: datetime.date | None = None
    serial_number: str = ""
    coverage_factor: Annotated[float, Field(ge=1.0, le=4.0, allow_inf_nan=False)]
    zero: Literal["index mark"]
    sense: Literal["counting up", "counting down"]
    error: Literal["shown minus true", "true minus shown"]
    learnt: Literal["", "circle closure", "population mean"] = ""
    """How it was learnt from gears; "" of a laboratory's."""
    bench: str = ""
    """The bench whose encoder it is, where it was learnt there."""
    runs: tuple[str, ...] = ()
    """Runs from which it was learnt, each with its SHA-256."""
    without: dict[str, tuple[float, ...]] = Field(default_factory=dict)
    """For a gear that taught it, what the others teach: U (k = 2), then cosine and sine of orders 1 to 8 [arcsec]."""

    def curve_without(self, gear: str) -> AngleCertificate | None:
        """The curve for a run of a gear that taught it: by the others; None where they do not tell it."""
        told = self.without.get(gear, ())
        if len(told) != 1 + 2 * len(CERTIFIED_ORDERS):
            return None
        numbers = np.array(told) * ARCSEC
        return curve_of(numbers[1:].reshape(-1, 2), float(numbers[0]))


@dataclass(frozen=True)
class CertificateFile:
    """A certificate as its file has it: the header, and the curve in the sense in which the encoder counts up."""

    path: str
    header: Header
    curve: AngleCertificate
    content: bytes = field(default=b"", repr=False, compare=False)
    """The bytes that were read."""


def read_certificate(folder: Path, name: str) -> CertificateFile:
    """The certificate of a file. Raises `ValueError` that names file, line, column and value."""
    path = folder / name
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise ValueError(f"{path} cannot be read: {error.strerror or error}") from error
    return replace(certificate_from(str(path), raw), path=name)


def certificate_from(path: str, raw: bytes) -> CertificateFile:
    """The certificate of the bytes of a file. Raises `ValueError` that names file, line, column and value."""
    if len(raw) > LARGEST_FILE:
        raise ValueError(f"{path} has {len(raw)} bytes; a certificate has at most {LARGEST_FILE}")
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is not text in UTF-8 at byte {error.start}") from error
    try:
        return CertificateFile(path, *_read(text), content=raw)
    except ParameterError as error:
        raise ValueError(f"{path}: {error}") from error
    except ValueError as error:
        raise ValueError(f"{path}, {error}") from error


def certificate_text(header: Header, curve: AngleCertificate) -> str:
    """The file of a certificate whose curve counts up and is shown minus true."""
    values = header.model_dump(exclude_none=True)
    values |= {"sense": "counting up", "error": "shown minus true"}
    without = values.pop("without")
    lines = [
        f"# {name} = {toml_value(value)}" for name, value in values.items() if value not in ("", ())
    ]
    if without:
        lines.append("# [without]")
    lines += [f"# {toml_value(gear)} = {toml_value(numbers)}" for gear, numbers in without.items()]
    lines.append(f"{COLUMNS[0]} [deg],{COLUMNS[1]} [arcsec],{COLUMNS[2]} [arcsec]")
    for angle, error, u in zip(
        curve.angles, curve.errors, curve.expanded_uncertainties, strict=True
    ):
        lines.append(f"{angle / DEGREE:.12g},{error / ARCSEC:.9g},{u / ARCSEC:.9g}")
    return "\n".join(lines) + "\n"


def _read(text: str) -> tuple[Header, AngleCertificate]:
    lines = text.splitlines()
    count = next((i for i, line in enumerate(lines) if not line.startswith("#")), len(lines))
    header = _header("\n".join(line[1:].strip() for line in lines[:count]))
    table = [
        (number, line.split(","))
        for number, line in enumerate(lines[count:], start=count + 1)
        if line.strip()
    ]
    if len(table) < 2:
        raise ValueError(f"line {count + 1}: there is no table of points behind the header")
    factors = _factors(*table[0])
    points = [_point(number, row, factors) for number, row in table[1:]]
    return header, _curve(header, points)


def _header(text: str) -> Header:
    try:
        return Header.model_validate(tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f'header: the lines behind "#" are not TOML: {error}') from error
    except ValidationError as error:
        found = [
            f"{'.'.join(map(str, one['loc']))}"
            + ("" if one["type"] == "missing" else f" = {one['input']!r}")
            + f": {one['msg'][:1].lower()}{one['msg'][1:]}"
            for one in error.errors()
        ]
        raise ValueError(f"header: {'; '.join(found)}") from error


def _factors(number: int, row: list[str]) -> list[float]:
    """What the columns are to be multiplied by to be in rad."""
    if len(row) != len(COLUMNS):
        raise ValueError(
            f"line {number}: {len(row)} columns; expected {', '.join(f'{c} [unit]' for c in COLUMNS)}"
        )
    factors = []
    for cell, name in zip(row, COLUMNS, strict=True):
        word, _, unit = cell.strip().partition(" [")
        unit = unit.removesuffix("]")
        factor = scale_in(unit, "rad")
        if word != name or factor is None:
            raise ValueError(
                f"line {number}: {cell.strip()!r} is not {name} [unit] with a unit of "
                + ", ".join(understood(("rad",)))
            )
        factors.append(factor)
    return factors


def _point(number: int, row: list[str], factors: list[float]) -> tuple[float, float, float]:
    if len(row) != len(COLUMNS):
        raise ValueError(f"line {number}: {len(row)} values; expected {len(COLUMNS)}")
    values = []
    for cell, name, factor in zip(row, COLUMNS, factors, strict=True):
        try:
            value = float(cell) * factor
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise ValueError(f"line {number}, {name}: {cell.strip()!r} is not a number")
        values.append(value)
    return values[0], values[1], values[2]


_SIGNS = {"shown minus true": 1.0, "true minus shown": -1.0}


def _curve(header: Header, points: list[tuple[float, float, float]]) -> AngleCertificate:
    """The points in the sense in which the encoder counts up, shown minus true."""
    sign = _SIGNS[header.error]
    if header.sense == "counting down":
        # What is shown too much in one sense is shown too little in the other. 0 and a whole turn are one place.
        sign = -sign
        points = [(REVOLUTION - angle, error, u) for angle, error, u in reversed(points)]
    angles, errors, uncertainties = zip(*points, strict=True)
    return AngleCertificate(
        angles=angles,
        errors=tuple(sign * error for error in errors),
        expanded_uncertainties=uncertainties,
        coverage_factor=header.coverage_factor,
    )
