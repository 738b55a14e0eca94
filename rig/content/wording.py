"""Numbers in words: an estimate as people read it, rounded by its own uncertainty (GUM: two digits
of U), unit beside it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from experiments.quantity import Quantity, bare_quantity
from model.identify.estimate import NORMAL_COVERAGE_FACTOR, BudgetLine, Estimate
from model.unit_text import scale_in
from model.units import by_size, printed
from rig.content.phrase import phrase

STATISTICAL_PART = "statistical part"
"""What people are told the 95 % interval of the data alone is."""


@dataclass(frozen=True, kw_only=True)
class Shown:
    """An estimate as text: value and U share their decimals; `low` and `high` bound the
    statistical part, often narrower.
    """

    value: str
    expanded: str
    low: str
    high: str
    unit: str
    scale: float
    """SI = scale * shown number."""
    decimals: int | None

    def number(self, value: float) -> str:
        """Another value of the same quantity (SI), such as a truth, in the same unit and one decimal more."""
        if self.decimals is None:
            return number(value / self.scale, 6)
        return fixed(value / self.scale, self.decimals + 1)

    @property
    def pair(self) -> str:
        """`value ± U` for a column that has the unit beside it; a U that is not known is a question mark."""
        return f"{self.value} ± {self.expanded or '?'}"

    @property
    def with_uncertainty(self) -> str:
        """`value ± U unit`."""
        if self.expanded:
            return f"{self.value} ± {self.expanded} {self.unit}".rstrip()
        return f"{self.value} {self.unit}"


def laboratory_unit(unit: str, size: float, shown: str = "") -> tuple[float, str]:
    """Factor and unit in which a number in SI is read in a laboratory: SI = factor * shown.

    `shown` is what its quantity declares; where that is nothing, or a unit of something else (a
    channel's own unit, not that of the quantity), its size decides.
    """
    if not shown or scale_in(shown, unit) is None:
        shown = by_size(unit, size)
    if shown == unit:
        return 1.0, unit_text(unit)
    return scale_in(shown, unit) or 1.0, shown


def unit_text(unit: str) -> str:
    """A unit as it stands behind a number: a pure number has none."""
    return "" if unit == "1" else printed(unit)


def show(estimate: Estimate, quantity: Quantity) -> Shown:
    """An estimate as text in the unit that its quantity is shown in, rounded to two digits of U.

    On a circle nothing is further away than half a turn.
    """
    expanded, low, high = estimate.expanded_uncertainty, estimate.low, estimate.high
    if quantity.is_circular and estimate.unit == "rad":
        expanded = min(math.pi, expanded)
        low, high = max(low, estimate.value - math.pi), min(high, estimate.value + math.pi)
    size = max((abs(v) for v in (estimate.value, expanded) if math.isfinite(v)), default=0.0)
    factor, unit = laboratory_unit(estimate.unit, size, quantity.shown)
    value, low, high = (v / factor for v in (estimate.value, low, high))
    expanded /= factor
    size /= factor
    if size and (size >= 1e6 or size < 1e-3):
        power = 3 * math.floor(math.log10(size) / 3)
        value, low, high, expanded = (v / 10.0**power for v in (value, low, high, expanded))
        factor *= 10.0**power
        unit = f"× 10{_superscript(power)} {unit}".rstrip()
    decimals = decimals_of(expanded)
    if decimals is None:
        return Shown(
            value=number(value),
            expanded="",
            low=number(low),
            high=number(high),
            unit=unit,
            scale=factor,
            decimals=None,
        )
    inner = decimals_of(0.5 * (high - low))
    low, high = (fixed(v, max(decimals, inner or 0)) for v in (low, high))
    value, expanded = fixed(value, decimals), fixed(expanded, decimals)
    return Shown(
        value=value,
        expanded=expanded,
        low=low,
        high=high,
        unit=unit,
        scale=factor,
        decimals=decimals,
    )


def value_text(
    value: float, expanded: float | None, unit: str, quantity: Quantity | None = None
) -> str:
    """`value ± U unit` of a number in SI as it is read in a laboratory; without an uncertainty the value alone."""
    budget = (
        () if expanded is None else (BudgetLine("", "A", float(expanded) / NORMAL_COVERAGE_FACTOR),)
    )
    estimate = Estimate(name="", value=value, unit=unit, low=math.nan, high=math.nan, budget=budget)
    return show(estimate, quantity or bare_quantity("", unit)).with_uncertainty


_SHOWN_IN = {"rad/s": "r/min"}
"""Units in which a laboratory reads an SI unit whatever the size."""


def quantity_text(value: float, unit: str) -> str:
    """A number in SI with its unit as it is read in a laboratory, all its digits kept as they are typed."""
    if unit == "s" and abs(value) < 1e-3:
        return f"{value * 1e6:.9g} µs"
    factor, shown = laboratory_unit(unit, value, _SHOWN_IN.get(unit, ""))
    return f"{value / factor:.9g} {shown}".rstrip()


def decimals_of(expanded: float) -> int | None:
    """Decimals that show two digits of an uncertainty; None where there is none to go by."""
    if not math.isfinite(expanded) or expanded <= 0:
        return None
    return min(max(1 - math.floor(math.log10(expanded) + 1e-9), 0), 9)


_INFINITE = {math.inf: "∞", -math.inf: "−∞"}


def fixed(value: float, decimals: int) -> str:
    """A number with fixed decimals, a real minus sign and thin groups of thousands."""
    if math.isnan(value):
        return "–"
    if math.isinf(value):
        return _INFINITE[value]
    text = f"{value:,.{decimals}f}".replace(",", "\u202f")
    if not any(c in "123456789" for c in text):
        text = text.lstrip("-")
    return text.replace("-", "−")


def number(value: object, digits: int = 4) -> str:
    """Any number of a table or a metric in `digits` significant digits; words stay words."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return str(value)
    if isinstance(value, int):
        return fixed(value, 0)
    if not math.isfinite(value):
        return fixed(value, 0)
    if abs(value) < 1e-300:
        return "0"
    power = math.floor(math.log10(abs(value)))
    if power >= 6 or power < -3:
        return f"{_trim(fixed(value / 10.0**power, max(digits - 1, 0)))} × 10{_superscript(power)}"
    return _trim(fixed(value, max(digits - 1 - power, 0)))


def _trim(text: str) -> str:
    whole, point, decimals = text.partition(".")
    return whole + (point + decimals).rstrip("0.")


def percent(share: float) -> str:
    """A share as whole per cent; what rounds to nothing has no sign."""
    return f"{round(100.0 * share)} %"


def duration_text(seconds: float) -> str:
    """A duration as people say it."""
    if not math.isfinite(seconds):
        return "-"
    if seconds < 60.0:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes} min {rest:02d} s"


def days_text(moments: Iterable[str]) -> str:
    """The days of these times (ISO 8601), from the first to the last one."""
    days = sorted({moment[:10] for moment in moments if moment})
    return " to ".join(dict.fromkeys((*days[:1], *days[-1:]))) or "not stated"


def _superscript(power: int) -> str:
    """An exponent as raised digits."""
    return str(power).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def readable(key: str) -> str:
    """A key of an option, a condition or a fact as words; symbols of the paper (F_c, K_HDf) stay as they are."""
    if len(key) <= 6 or " " in key or any(c.isupper() for c in key):
        return key
    return key.replace("_", " ").replace("-", " ")


_ENDINGS = {"_kg_m2": "kg m2", "_um": "um", "_rpm": "r/min", "_deg": "deg", "hours": "h"}
"""Units with which the names of fields and parameters end."""


def named(key: str) -> tuple[str, str]:
    """A key of a file in words, and the unit that it ends with: "load_inertia_kg_m2" is "load inertia" in kg m2."""
    ending = next((one for one in _ENDINGS if key.endswith(one)), "")
    words = readable(key.removesuffix(ending) or key).replace("runout", "run-out")
    return words.replace("_", " ") if words.islower() else words, _ENDINGS.get(ending, "")


_GREEK = {
    "alpha": "α",
    "beta": "β",
    "gamma": "γ",
    "delta": "δ",
    "zeta": "ζ",
    "eta": "η",
    "theta": "θ",
    "lambda": "λ",
    "mu": "μ",
    "nu": "ν",
    "rho": "ρ",
    "sigma": "σ",
    "tau": "τ",
    "phi": "φ",
    "omega": "ω",
}


def printed_symbol(symbol: str) -> str:
    """A symbol with its Greek letter: alpha_t is α_t."""
    stem, line, index = symbol.partition("_")
    return f"{_GREEK.get(stem, stem)}{line}{index}"


def order_label(order: float, ratio: float) -> str:
    """An order as it is named elsewhere, by input orders and output orders: 2+1/N; one that is
    neither by its number.
    """
    whole = round(order)
    part = round((order - whole) * ratio)
    if (
        not part
        or abs(part) >= ratio / 2
        or not math.isclose(order, whole + part / ratio, abs_tol=1e-6)
    ):
        return number(order, 6)
    sign = "−" if part < 0 else "+"
    if whole == 0:
        return f"{sign.strip('+')}{abs(part)}/N"
    return f"{whole}{sign}{abs(part)}/N"


def unbroken(title: str) -> str:
    """The heading of a column with its unit and its coverage factor in one piece."""
    return re.sub(
        r"\[[^\]]*\]|\(95 %\)",
        lambda m: m[0].replace(" ", "\u00a0").replace("/", "/\u2060"),
        title,
    )


def source_text(provenance: str, source: str) -> str:
    """Provenance and source of a value, the provenance not said twice."""
    if provenance in source:
        return source
    return provenance + phrase(": {}", source)


def heading(text: str) -> str:
    """The heading of a column with its unit as it is printed: housing [degC] is housing [°C]."""
    return re.sub(r"\[([^\]]+)\]", lambda m: f"[{printed(m[1])}]", text)


def metric_text(quantity: Quantity, value: float) -> str:
    """A figure of merit with its unit, where it has one."""
    factor, unit = laboratory_unit(quantity.unit, value, quantity.shown)
    return f"{number(value / factor)} {unit}".rstrip()


def printable(text: str) -> str:
    """A text from a file without control characters, which neither XML nor HTML can hold."""
    return text.translate(_UNPRINTABLE)


_REORDERING = (*range(0x202A, 0x202F), *range(0x2066, 0x206A))
"""Characters that turn the direction of what follows: what is read is not what stands there."""
_UNPRINTABLE: dict[int, str | None] = {
    **dict.fromkeys(
        [*range(0x20), *range(0x7F, 0xA0), *range(0xD800, 0xE000), *_REORDERING, 0xFFFE, 0xFFFF]
    ),
    **dict.fromkeys(map(ord, "\t\n\r"), " "),
}
"""What becomes of characters that cannot be printed: breaks of lines and tabs are blanks, others go."""
_UNSEEN = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ufeff\ud800-\udfff]"
)


def visible(text: str) -> str:
    """A text from a file for a terminal: what would steer it, or turn the direction of the letters, as its number.

    JSON text says the same before and after.
    """
    return _UNSEEN.sub(lambda match: f"\\u{ord(match[0]):04x}", text)


def aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Rows of cells as lines of plain text, their columns under each other."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]
