"""What a lot is judged by, read from the results: of every gear the newest analysed run of each kind, nothing else.

The same choice as `rig.analysis.in_force.newest_analysed` makes for one gear: lot, passport and certificate speak of
the same runs.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, Protocol, get_type_hints

from experiments import catalogue
from experiments.quantity import Quantity
from rig.analysis.alarm.laboratory import watching_in_force
from rig.errors import ConfigurationError
from rig.fleet.questions import connected
from rig.library.listed import COUNTED_OUTCOMES


class _QuantityRow(Protocol):
    """A row that says which quantity it is of."""

    @property
    def kind(self) -> str:
        """The kind of analysis."""
        ...

    @property
    def quantity(self) -> str:
        """Its name within the kind."""
        ...

    @property
    def title(self) -> str:
        """What people called it when the row was written."""
        ...

    @property
    def unit(self) -> str:
        """SI unit."""
        ...


class LotRow(NamedTuple):
    """One quantity of the newest run of a gear; what is not known is None. `started` in s since 1970, UTC."""

    gear: str
    part: str
    bench: str
    operator: str
    started: float | None
    kind: str
    quantity: str
    family: str
    title: str
    value: float | None
    unit: str
    expanded_uncertainty: float | None
    identifiable: str
    limit_value: float | None
    limit_is: str
    lower_limit: float | None
    upper_limit: float | None
    limit_source: str
    verdict: str
    reason: str
    acceptance: str
    run: str
    run_file: str

    @property
    def is_measured(self) -> bool:
        """Whether there is a number that the data determined."""
        return self.value is not None and self.identifiable != "no"

    @property
    def is_judged(self) -> bool:
        """Whether it was held against a limit that counts."""
        return self.verdict not in ("", "NOT JUDGED") and self.value is not None


@dataclass(frozen=True, kw_only=True)
class LotData:
    """Rows of the gears of one origin; what else there is in the results, in numbers.

    `failures`: gear, run and reason of every run that could not be analysed; `unfinished`: gear, run
    and outcome of runs that were broken off. `histories`: the run files of each gear of which a kind has
    runs enough for an alarm. `other_origins`: gears by other origins, left out.
    """

    folder: Path
    origin: str
    gears: tuple[str, ...]
    rows: tuple[LotRow, ...]
    runs: int
    nameless_runs: int
    failures: tuple[tuple[str, str, str], ...]
    unfinished: tuple[tuple[str, str, str], ...]
    other_origins: tuple[tuple[str, int], ...]
    histories: Mapping[str, tuple[str, ...]] = field(default_factory=dict)


_OF_PART = "(part = ? OR ? = '')"
_NAMED = "gear IS NOT NULL AND gear NOT IN ('', 'unknown')"
"""Rows of a part, or of any where none is asked for; rows whose gear is known."""
_COUNTED = f"SELECT origin, count(DISTINCT gear) FROM results WHERE {_OF_PART} GROUP BY origin ORDER BY origin"
"""How many gears there are of each origin."""
_HISTORY = f"""
SELECT DISTINCT gear, run_file FROM here SEMI JOIN (
    SELECT gear FROM here WHERE {_NAMED} AND failure = '' GROUP BY gear, kind HAVING count(DISTINCT run_file) > ?
) USING (gear) WHERE failure = '' ORDER BY ALL
"""
"""Every run file of the gears of which some kind has more whole runs than a baseline."""


def _no_gear(folder: Path, wanted: Iterable[str], origins: Iterable[str]) -> ConfigurationError:
    return ConfigurationError(
        "hold no gear of this lot",
        where=str(folder),
        value=" ".join(filter(None, wanted)) or None,
        limit=", ".join(filter(None, origins)),
        remedy='Look with `rig fleet query "SELECT DISTINCT gear, origin, part FROM results"`.',
    )


def read_lot(folder: Path, *, origin: str = "", part: str = "") -> LotData:
    """The lot in a folder of results: of one origin (hardware alone where there is any) and, if asked, one part.

    Raises `ConfigurationError` where there is no gear of it.
    """
    with connected(folder) as connection:

        def rows_of(sql: str, *values: Any) -> list[tuple[Any, ...]]:
            return connection.execute(sql, list(values)).fetchall()

        counted = rows_of(_COUNTED, part, part)
        gears_by_origin = {str(word or ""): int(count) for word, count in counted}
        chosen = origin or origin_of(gears_by_origin)
        connection.execute(
            f"CREATE TABLE here AS SELECT * FROM results WHERE coalesce(origin, '') = ? AND {_OF_PART}"
            f" AND kind IN (SELECT unnest(?))",
            [chosen, part, part, list(_kinds_of_gears())],
        )
        gears = rows_of(f"SELECT DISTINCT gear FROM here WHERE {_NAMED} ORDER BY gear")
        if not gears:
            raise _no_gear(folder, (chosen, part), gears_by_origin)
        runs = rows_of(f"SELECT count(DISTINCT run_file) FROM here WHERE {_NAMED}")[0][0]
        nameless = rows_of(f"SELECT count(DISTINCT run_file) FROM here WHERE NOT ({_NAMED})")[0][0]
        failures = rows_of(
            f"SELECT DISTINCT gear, coalesce(run, run_file), failure FROM here"
            f" WHERE {_NAMED} AND failure <> '' ORDER BY ALL"
        )
        unfinished = rows_of(
            f"SELECT DISTINCT gear, run, outcome FROM here WHERE {_NAMED} AND failure = ''"
            f" AND outcome NOT IN (SELECT unnest(?)) ORDER BY ALL",
            list(COUNTED_OUTCOMES),
        )
        histories: dict[str, list[str]] = defaultdict(list)
        for gear, file in rows_of(_HISTORY, watching_in_force().promise.baseline):
            histories[gear].append(file)
        rows = rows_of(_newest_sql(), list(COUNTED_OUTCOMES), *key_families())
    return LotData(
        folder=folder,
        origin=chosen,
        gears=tuple(gear for (gear,) in gears),
        rows=tuple(LotRow(*row) for row in rows),
        runs=runs,
        nameless_runs=nameless,
        failures=tuple((g, r, f) for g, r, f in failures),
        unfinished=tuple((g, r, o) for g, r, o in unfinished),
        other_origins=tuple((o, n) for o, n in gears_by_origin.items() if o != chosen),
        histories={gear: tuple(files) for gear, files in histories.items()},
    )


def sql_columns(row: type) -> str:
    """The columns of a row in SQL, by their names and types; a text that is not there is an empty one."""
    names = [
        f"coalesce({name}, '')" if kind is str else name
        for name, kind in get_type_hints(row).items()
    ]
    return ", ".join(names)


def _newest_sql() -> str:
    """The rows of the newest whole run of every gear and kind that a lot looks at: judged ones, and key quantities."""
    # Seconds: for a time with its zone DuckDB needs one more package.
    columns = sql_columns(LotRow).replace("started", "epoch(started)")
    return f"""
WITH newest AS (
    SELECT gear, kind, arg_max(run_file, (coalesce(started, TIMESTAMPTZ '1970-01-01'), run_file)) AS run_file
    FROM here WHERE {_NAMED} AND failure = '' AND outcome IN (SELECT unnest(?)) GROUP BY gear, kind
), key_families AS (SELECT unnest(?) AS kind, unnest(?) AS family)
SELECT {columns} FROM here SEMI JOIN newest USING (gear, kind, run_file)
WHERE NOT is_metric AND quantity <> ''
  AND (verdict <> '' OR (kind, family) IN (SELECT (kind, family) FROM key_families))
ORDER BY kind, quantity, gear
"""


def _kinds_of_gears() -> tuple[str, ...]:
    """The kinds of analysis that are of a gear: not those of a bare motor, and none without a protocol."""
    return tuple(one.name for one in catalogue.every() if one.has_plan and one.gear_mounted)


def key_families() -> tuple[list[str], list[str]]:
    """Kind and name of every quantity that a reader looks for first."""
    pairs = [
        (kind, quantity.name)
        for kind in _kinds_of_gears()
        for quantity in catalogue.load(kind).quantities
        if quantity.is_key
    ]
    return [kind for kind, _ in pairs], [family for _, family in pairs]


def declared_quantity(row: _QuantityRow) -> Quantity:
    """What its protocol declares of the quantity of a row; what stands in the row of one that it no longer declares."""
    found = catalogue.declared_quantity(row.kind, row.quantity)
    return found or Quantity(name=row.quantity, title=row.title or row.quantity, unit=row.unit)


def origin_of(gears_by_origin: dict[str, int]) -> str:
    """Hardware alone where there is any; otherwise the origin of most gears."""
    if "hardware" in gears_by_origin or not gears_by_origin:
        return "hardware"
    return max(gears_by_origin, key=lambda word: gears_by_origin[word])
