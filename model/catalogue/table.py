"""Makers' tables of gears: one row per value, keyed by series, size, ratio and unit type, with its source.

`gears.csv` holds the rows, `README.md` beside it the sources and how far each is to be trusted: A the
maker's own page, B a transcription that was cross-checked, D derived by a stated rule, C a third
party that nobody else confirms. Values of rank C stand beside others as a check and are never used
alone. Ratios of a row may be a class (">=80", "all"); an empty unit type is any.
"""

from __future__ import annotations

import csv
import functools
import re
from collections.abc import Iterable
from dataclasses import dataclass
from importlib import resources

from model.errors import ParameterError
from model.quantities import to_si
from model.unit_text import read

_RANKS = ("A", "B", "D", "C")
"""Ranks of trust, the best first: maker's page, transcription, derived by a rule, third party."""
SAME = 0.02
"""Two sources of one value agree within this share; tables are printed in two or three digits."""

SERIES = ("CSF", "CSG", "SHG", "HFUS", "HFUC")
"""Series whose rated torques are in the table."""
_UNIT_TYPES = ("2UH", "2UH-LW", "2A")
"""Unit with housing, its light version, component set."""
_PRODUCT = re.compile(r"([A-Z][A-Z0-9]*)-(\d{1,3})-(\d{2,3})(?:-([0-9A-Z][0-9A-Z-]*))?")


@dataclass(frozen=True)
class Source:
    """A document of the table: how far it is to be trusted, what it is, where it was found."""

    rank: str
    document: str
    found: str


@dataclass(frozen=True)
class Product:
    """A gear as its plate names it: "SHG-32-100-2UH"."""

    series: str
    size: int
    ratio: int
    unit_type: str

    def __str__(self) -> str:
        return f"{self.series}-{self.size}-{self.ratio}-{self.unit_type}"


@dataclass(frozen=True)
class Row:
    """One value of a table, in SI, with its conditions and the id of its source."""

    series: str
    size: int
    ratio: str
    unit_type: str
    quantity: str
    value: float
    conditions: str
    source: str

    @property
    def rank(self) -> str:
        """How far the source is to be trusted."""
        return sources()[self.source].rank

    @property
    def words(self) -> str:
        """Where the value stands: part, document, conditions."""
        part = "-".join(filter(None, (self.series, str(self.size), self.unit_type)))
        ratio = "" if self.ratio == "all" else f", ratio {self.ratio}"
        source = sources()[self.source]
        stands = f"{part}{ratio}: {source.document} [{self.source}, {source.rank}]"
        return "; ".join(filter(None, (stands, self.conditions)))

    def holds_for(self, ratio: int) -> bool:
        """Whether the row's ratio, or class of ratios, is this one."""
        if self.ratio == "all":
            return True
        sign, bound = re.fullmatch(r"(>=|>|)(\d+)", self.ratio).groups()  # type: ignore[union-attr]
        return {">=": ratio >= int(bound), ">": ratio > int(bound), "": ratio == int(bound)}[sign]


@dataclass(frozen=True)
class Found:
    """What the table says of one quantity of one product: the row that is used, and those that contradict it."""

    row: Row
    conflicts: tuple[Row, ...] = ()


def read_product(text: str) -> Product:
    """The product of a part number. Raises `ParameterError` for one that has no series, size, ratio and unit type."""
    match = _PRODUCT.fullmatch(text.strip().upper())
    if match is None or not match[4]:
        known = f"; unit types: {', '.join(_UNIT_TYPES)}" if match else ""
        raise ParameterError(
            "names no series, size, ratio and unit type",
            where="product",
            value=repr(text),
            limit=f"SERIES-SIZE-RATIO-UNIT, such as SHG-32-100-2UH{known}",
            remedy="Read it from the nameplate; what a maker promises differs between unit types.",
        )
    unit = next((u for u in reversed(_UNIT_TYPES) if match[4].startswith(u)), match[4])
    return Product(match[1], int(match[2]), int(match[3]), unit)


@functools.cache
def sources() -> dict[str, Source]:
    """The documents of the table by their id."""
    return {r["id"]: Source(r["rank"], r["document"], r["found"]) for r in _content("sources.csv")}


def _content(name: str) -> Iterable[dict[str, str]]:
    text = (resources.files("model.catalogue") / name).read_text(encoding="utf-8")
    return csv.DictReader(text.splitlines())


@functools.cache
def rows() -> tuple[Row, ...]:
    """Every row of the table, in SI."""
    return tuple(
        Row(
            series=r["series"],
            size=int(r["size"]),
            ratio=r["ratio"],
            unit_type=r["unit_type"],
            quantity=r["quantity"],
            value=to_si(float(r["value"]), r["unit"], read(r["unit"]).si, r["quantity"]),
            conditions=r["conditions"],
            source=r["source"],
        )
        for r in _content("gears.csv")
    )


@functools.cache
def products() -> tuple[Product, ...]:
    """Every product whose rated torque a source of rank A, B or D states."""
    found = {
        Product(row.series, row.size, int(row.ratio), unit): None
        for row in rows()
        if row.quantity == "rated_torque" and row.rank != "C" and row.series in SERIES
        for unit in ([row.unit_type] if row.unit_type else ["2UH", "2A"])
    }
    return tuple(found)


def of_product(product: Product, quantity: str) -> Found | None:
    """What the table says of this quantity of this product; None where nothing but rank C does."""
    fitting = [
        row
        for row in _by_quantity(quantity)
        if (row.series, row.size) == (product.series, product.size)
        and row.holds_for(product.ratio)
        and row.unit_type in ("", product.unit_type)
    ]
    return _best(fitting)


def of_relatives(series: Iterable[str], product: Product, quantity: str) -> Found | None:
    """The best that the table says of the nearest relative: of these series in their order, same size before other
    sizes, the product's ratio before the next smaller one (whose torques are smaller)."""
    order = tuple(series)
    usable = [
        row
        for row in _by_quantity(quantity)
        if row.rank != "C" and row.series in order and row.unit_type != "2UH-LW"
    ]
    if not usable:
        return None

    def distance(row: Row) -> tuple[float, ...]:
        far = abs(row.size - product.size)
        away = 0.0 if row.holds_for(product.ratio) else _away(row, product.ratio)
        return (far, away, order.index(row.series), _RANKS.index(row.rank))

    nearest = min(usable, key=distance)
    return Found(nearest)


def _away(row: Row, ratio: int) -> float:
    """How far a row's ratio is from the one that is wanted; larger ones are a last resort, their torques are larger."""
    bound = int(row.ratio.lstrip(">="))
    return float(ratio - bound) if bound < ratio else 1000.0 + bound - ratio


@functools.cache
def _by_quantity(quantity: str) -> tuple[Row, ...]:
    return tuple(row for row in rows() if row.quantity == quantity)


def _best(fitting: list[Row]) -> Found | None:
    """The row of the best rank, and those that say something else."""
    ranked = sorted(fitting, key=lambda row: (_RANKS.index(row.rank), row.unit_type == ""))
    if not ranked or ranked[0].rank == "C":
        return None
    used = ranked[0]
    others = [row for row in ranked[1:] if abs(row.value - used.value) > SAME * used.value]
    return Found(used, tuple(others))
