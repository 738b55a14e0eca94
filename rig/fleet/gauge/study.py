"""A study of the gauge from the results of a fleet or from somebody's table: values by gear, bench and mounting.

Every whole run counts as a repeat of its gear, bench and mounting. Of a quantity that is known to differ between
mountings because the output sits eccentrically (the transmission accuracy) the same without order 1/N stands beside it.
"""

from __future__ import annotations

import csv
import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from experiments.quantity import Quantity
from model.catalogue.table import read_product
from model.errors import ModelError, ParameterError
from model.gear import Harmonic
from model.kinematic_error import order_of_label, peak_to_peak
from rig.content.wording import laboratory_unit
from rig.errors import ConfigurationError
from rig.fleet.gauge.anova import by_anova, shape_of
from rig.fleet.gauge.components import GAUGE, Gauge, GaugeError, Values
from rig.fleet.gauge.reml import by_reml
from rig.fleet.lot_rows import declared_quantity, key_families, origin_of, sql_columns
from rig.fleet.questions import connected
from rig.library.listed import COUNTED_OUTCOMES

_KINEMATIC, _ACCURACY, _ECCENTRIC = "kinematic-error", "transmission_accuracy", "1/N"
WITHOUT_ECCENTRICITY = "transmission_accuracy_without_1/N"
_COLUMNS = {"gear": ("gear", "part"), "bench": ("bench", "operator", "appraiser")}
"""What the columns of a table may be called."""


class Measured(NamedTuple):
    """One number of one run; the names are those of the fleet's results."""

    kind: str
    quantity: str
    family: str
    title: str
    unit: str
    gear: str
    part: str
    bench: str
    mounted: str
    run_file: str
    value: float
    lower_limit: float | None
    upper_limit: float | None


@dataclass(frozen=True, kw_only=True)
class Study:
    """What one quantity tells of the gauge.

    `unpooled` is the same with the interaction kept where it was pooled; `left_out` says which gears or benches do
    not count. `lower` and `upper` are the limits on it, SI, None where that side is free.
    """

    kind: str
    name: str
    quantity: Quantity
    values: Values
    gauge: Gauge
    unpooled: Gauge | None = None
    lower: float | None = None
    upper: float | None = None

    @property
    def title(self) -> str:
        """What people call the quantity."""
        return self.quantity.titled(self.name)

    @property
    def mean(self) -> float:
        """Mean of all values."""
        return math.fsum(self.values.value) / len(self.values.value)

    @property
    def shape(self) -> str:
        """How many gears, benches, mountings and repeats there are, in words."""
        shape = shape_of(self.values)
        gears, benches = self.values.counted
        if shape is None:
            return f"{gears} gears, {benches} benches, {len(self.values.value)} values, with gaps"
        several = ((shape[2], "mountings"), (shape[3], "repeats"))
        more = [f" x {count} {what}" for count, what in several if count > 1]
        return f"{gears} gears x {benches} benches{''.join(more)}"

    @property
    def shown_in(self) -> tuple[float, str]:
        """Factor and unit in which it is read: SI = factor * shown."""
        return laboratory_unit(self.quantity.unit, abs(self.mean), self.quantity.shown)

    @property
    def percent_of_tolerance(self) -> float:
        """GRR in percent of the tolerance; NaN where no limit is on the quantity."""
        return self.gauge.percent_of_tolerance(self.lower, self.upper, self.mean)


@dataclass(frozen=True, kw_only=True)
class Studies:
    """The studies of a folder of results, what could not be studied, and why."""

    source: Path
    origin: str
    studies: tuple[Study, ...]
    lacking: tuple[tuple[str, str], ...]
    """Quantity and reason."""


def studies_of(
    folder: Path, *, origin: str = "", part: str = "", wanted: Sequence[str] = ()
) -> Studies:
    """The studies that the results in a folder allow, of key and limited quantities, or of those `wanted` (KIND.NAME).

    Raises `ConfigurationError` where there is none.
    """
    chosen, rows = _read(folder, origin, part, bool(wanted))
    rows = [*rows, *_without_eccentricity(rows)]
    keys = set(zip(*key_families(), strict=True))
    by_quantity: dict[tuple[str, str], list[Measured]] = defaultdict(list)
    for row in rows:
        by_quantity[row.kind, row.quantity].append(row)
    named = [
        (key, several)
        for key, several in sorted(by_quantity.items())
        if _is_wanted(several[0], key, keys, wanted)
    ]
    if wanted and (unknown := set(wanted) - {f"{kind}.{name}" for (kind, name), _ in named}):
        raise ConfigurationError(
            "was not measured",
            where="--quantity",
            value=", ".join(sorted(unknown)),
            limit=", ".join(sorted(f"{kind}.{name}" for kind, name in by_quantity)[:8]),
            remedy='Look with rig fleet query "SELECT DISTINCT kind, quantity FROM results".',
        )
    studies, lacking = [], []
    for (kind, name), several in named:
        quantity = _quantity(several[0])
        if quantity.is_circular:
            continue
        try:
            studies.append(_study(kind, name, quantity, several))
        except GaugeError as error:
            lacking.append((quantity.titled(name), str(error)))
    if not studies:
        raise ConfigurationError(
            "hold no study of the gauge",
            where=str(folder),
            value=f"{len(rows)} numbers of origin {chosen or 'not stated'}",
            limit="at least two gears, each on two benches, mounted or measured twice",
            remedy="Plan one: rig fleet rr --plan. Each gear goes to each bench, in the same way.",
        )
    return Studies(source=folder, origin=chosen, studies=tuple(studies), lacking=tuple(lacking))


def study_of_table(path: Path) -> Studies:
    """The study of a CSV with the columns gear (or part), bench (or operator), value, and mounting where there is one.

    Raises `ConfigurationError` for a table that is none.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = list(csv.DictReader(file))
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError("cannot be read", where=str(path), value=str(error)) from None
    heads = list(rows[0]) if rows else []
    columns = {
        name: next((head for head in heads if head.strip().lower() in words), "")
        for name, words in {**_COLUMNS, "value": ("value",), "mounting": ("mounting",)}.items()
    }
    missing = [name for name in ("gear", "bench", "value") if not columns[name]]
    if missing:
        raise ConfigurationError(
            "has no such column",
            where=str(path),
            value=", ".join(missing),
            limit="gear (or part), bench (or operator), value, mounting where there are several",
            remedy="Name them in its first line.",
        )
    values = Values(
        gear=[row[columns["gear"]] for row in rows],
        bench=[row[columns["bench"]] for row in rows],
        mounting=[row.get(columns["mounting"]) or "" for row in rows],
        value=[_number(row[columns["value"]], path, line) for line, row in enumerate(rows, 2)],
    )
    try:
        gauge, unpooled = gauges_of(values)
    except GaugeError as error:
        raise ConfigurationError(
            "is no study of a gauge", where=str(path), value=str(error)
        ) from None
    quantity = Quantity(name="value", title="value", unit="1")
    one = Study(
        kind="table",
        name="value",
        quantity=quantity,
        values=values,
        gauge=gauge,
        unpooled=unpooled,
    )
    return Studies(source=path, origin="imported", studies=(one,), lacking=())


def _number(text: str | None, path: Path, line: int) -> float:
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ConfigurationError(
            "is no number", where=f"{path}, line {line}", value=repr(text), limit="a finite number"
        )
    return value


def gauges_of(values: Values) -> tuple[Gauge, Gauge | None]:
    """The gauge by the way that the study allows, and the one without pooling where something was pooled."""
    if shape_of(values) is None:
        return by_reml(values), None
    gauge = by_anova(values)
    return gauge, by_anova(values, may_pool=False) if gauge.pooled else None


def _study(kind: str, name: str, quantity: Quantity, rows: Sequence[Measured]) -> Study:
    values = Values(
        gear=[row.gear for row in rows],
        bench=[row.bench for row in rows],
        mounting=[row.mounted for row in rows],
        value=[row.value for row in rows],
    )
    gauge, unpooled = gauges_of(values)
    return Study(
        kind=kind,
        name=name,
        quantity=quantity,
        values=values,
        gauge=gauge,
        unpooled=unpooled,
        lower=_common_limit(row.lower_limit for row in rows),
        upper=_common_limit(row.upper_limit for row in rows),
    )


def _common_limit(limits: Iterable[float | None]) -> float | None:
    """The limit of all runs; limits that differ between runs are no tolerance of the study."""
    several = set(limits)
    return several.pop() if len(several) == 1 else None


def _is_wanted(
    row: Measured, key: tuple[str, str], keys: set[tuple[str, str]], wanted: Sequence[str]
) -> bool:
    if wanted:
        return ".".join(key) in wanted
    if row.lower_limit is not None or row.upper_limit is not None:
        return True
    members = declared_quantity(row).key_members
    is_key = not members or declared_quantity(row).member(row.quantity) in members
    return (is_key and (row.kind, row.family) in keys) or row.family == WITHOUT_ECCENTRICITY


def _quantity(row: Measured) -> Quantity:
    if row.family == WITHOUT_ECCENTRICITY:
        return Quantity(
            name=row.quantity,
            title="transmission accuracy without order 1/N",
            unit=row.unit,
            shown="arcmin",
            definition="peak to peak, over one output revolution, of all orders that the analysis names but 1/N, "
            "which the mounting adds to",
        )
    return declared_quantity(row)


def _read(folder: Path, origin: str, part: str, every: bool) -> tuple[str, list[Measured]]:
    """The origin that counts, and the numbers of its whole runs that the data determined."""
    where = "(part = ? OR ? = '')"
    columns = sql_columns(Measured)
    with connected(folder) as connection:
        counted = connection.execute(
            f"SELECT coalesce(origin, ''), count(DISTINCT gear) FROM results WHERE {where} GROUP BY ALL",
            [part, part],
        ).fetchall()
        chosen = origin or origin_of({str(word): int(count) for word, count in counted})
        rows = connection.execute(
            f"SELECT {columns} FROM results WHERE coalesce(origin, '') = ? AND {where}"
            " AND NOT is_metric AND value IS NOT NULL AND isfinite(value) AND failure = ''"
            " AND gear NOT IN ('', 'unknown') AND outcome IN (SELECT unnest(?))"
            " ORDER BY kind, quantity, gear, bench, mounted, run_file",
            [chosen, part, part, list(COUNTED_OUTCOMES)],
        ).fetchall()
    return chosen, [Measured(*row) for row in rows]


def _without_eccentricity(rows: Sequence[Measured]) -> Iterator[Measured]:
    """Of every kinematic error the peak to peak of its orders but 1/N, where the ratio of the part is known."""
    runs: dict[str, dict[str, Measured]] = defaultdict(dict)
    for row in rows:
        if row.kind == _KINEMATIC:
            runs[row.run_file][row.quantity] = row
    for found in runs.values():
        first = next(iter(found.values()))
        try:
            ratio = float(read_product(first.part).ratio)
        except ParameterError:
            continue
        series = list(_series(found, ratio))
        if series:
            yield first._replace(
                quantity=WITHOUT_ECCENTRICITY,
                family=WITHOUT_ECCENTRICITY,
                unit="rad",
                value=peak_to_peak(series, ratio),
                lower_limit=None,
                upper_limit=None,
            )


def _series(found: dict[str, Measured], ratio: float) -> Iterator[Harmonic]:
    """The orders that a run names, but 1/N, as a series: value = A cos(n theta - phase)."""
    for name, row in found.items():
        label = name.removeprefix("amplitude_")
        phase = found.get(f"phase_{label}")
        if label in (name, _ECCENTRIC) or phase is None:
            continue
        try:
            order = order_of_label(label, ratio)
        except ModelError:
            continue
        yield Harmonic(order, row.value * math.cos(phase.value), row.value * math.sin(phase.value))


def words_of(study: Study) -> tuple[str, ...]:
    """What a study says, a sentence each: how close two gears may be, what the largest part is, what is doubtful."""
    from rig.content.wording import number

    factor, unit = study.shown_in
    gauge = study.gauge

    def told(value: float) -> str:
        return f"{number(value / factor, 2)} {unit}".rstrip()

    _, benches = study.values.counted
    sentences = []
    if benches > 1:
        sentences.append(
            f"Between two benches it does not tell gears closer than {told(gauge.apart())} apart; on one bench, "
            f"mounted anew, not closer than {told(gauge.apart(one_bench=True))}."
        )
    else:
        sentences.append(
            f"On this bench it does not tell gears closer than {told(gauge.apart(one_bench=True))} apart; what other "
            "benches add is not known."
        )
    parts = {term: gauge.deviation(term) for term in GAUGE if gauge.variances.get(term)}
    if parts:
        largest = max(parts, key=lambda term: parts[term])
        share = 100.0 * (parts[largest] / gauge.deviation(*GAUGE)) ** 2
        sentences.append(f"{share:.0f} % of its variance is of {TERM_WORDS[largest]}.")
    if 1 < benches < _FEW_BENCHES:
        low, high = gauge.interval_of_deviation("bench")
        sentences.append(
            f"{benches} benches say little of benches: their spread lies between {told(low)} and {told(high)}."
        )
    return tuple(sentences)


_FEW_BENCHES = 5
"""Benches below which their spread is not known to a factor of three."""
TERM_WORDS = {
    "gear": "gears",
    "bench": "benches",
    "interaction": "gear and bench together, with what a bench's mounting adds",
    "mounting": "mounting",
    "repeat": "repeats",
}
