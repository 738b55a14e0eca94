"""Questions to the results of a fleet: SQL by DuckDB, and five that are asked so often that they have a name.

`results` is the table of `rig.fleet.results`; `truth`, where there is one, what simulated gears were made of. The ready
questions look at estimates with a value that the data determined, of runs that were brought to their end.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rig.errors import ConfigurationError
from rig.fleet.dataset import FOLDER_NAME, DataSet

if TYPE_CHECKING:
    from collections.abc import Iterator

    import duckdb

TRUTH_NAME = "truth.parquet"
"""Beside the results of simulated runs: what they were made of."""

_MEASURED = """
    SELECT * FROM results
    WHERE NOT is_metric AND value IS NOT NULL AND isfinite(value) AND identifiable <> 'no'
      AND outcome IN ('COMPLETED', '')
"""


@dataclass(frozen=True)
class Question:
    """A question with a name: what it asks, and its SQL."""

    name: str
    asks: str
    sql: str


QUESTIONS: Mapping[str, Question] = {
    question.name: question
    for question in (
        Question(
            "spread",
            "how much gears differ in each quantity, beside the uncertainty of one measurement",
            f"""
WITH gears AS (
    SELECT kind, quantity, unit, gear, avg(value) AS value,
           avg(expanded_uncertainty) AS expanded_uncertainty, count(*) AS runs
    FROM ({_MEASURED}) GROUP BY kind, quantity, unit, gear
)
SELECT kind, quantity, unit, count(*) AS gears, sum(runs) AS runs, avg(value) AS mean,
       stddev_samp(value) AS standard_deviation, min(value) AS lowest, median(value) AS median,
       max(value) AS highest, avg(expanded_uncertainty) AS expanded_uncertainty,
       standard_deviation / nullif(avg(expanded_uncertainty) / 2, 0) AS deviation_over_u
FROM gears GROUP BY kind, quantity, unit ORDER BY kind, quantity, unit
""",
        ),
        Question(
            "benches",
            "whether benches differ: the mean of each, its distance from that of the others, over its standard error",
            f"""
WITH gears AS (
    SELECT kind, quantity, unit, bench, gear, avg(value) AS value
    FROM ({_MEASURED}) GROUP BY kind, quantity, unit, bench, gear
), benches AS (
    SELECT kind, quantity, unit, bench, count(*) AS gears, avg(value) AS mean,
           var_samp(value) AS variance, sum(value) AS total
    FROM gears GROUP BY kind, quantity, unit, bench
), others AS (
    SELECT one.*,
           sum(other.total) / sum(other.gears) AS mean_of_others,
           sum(other.variance * (other.gears - 1)) / nullif(sum(other.gears - 1), 0) AS variance_of_others,
           sum(other.gears) AS gears_of_others
    FROM benches one JOIN benches other
      ON one.kind = other.kind AND one.quantity = other.quantity AND one.unit = other.unit
     AND one.bench <> other.bench
    GROUP BY ALL
)
SELECT kind, quantity, unit, bench, gears, mean, mean - mean_of_others AS difference,
       sqrt(variance / gears + variance_of_others / gears_of_others) AS standard_error,
       difference / nullif(standard_error, 0) AS difference_over_error
FROM others ORDER BY abs(difference_over_error) DESC NULLS LAST, kind, quantity, bench
""",
        ),
        Question(
            "drift",
            "whether a quantity drifts on a bench: slope per day, its standard error, and their ratio",
            f"""
WITH timed AS (
    SELECT kind, quantity, unit, bench, value, epoch(started) / 86400.0 AS days
    FROM ({_MEASURED}) WHERE started IS NOT NULL
)
SELECT kind, quantity, unit, bench, count(*) AS runs, max(days) - min(days) AS days_observed,
       regr_slope(value, days) AS slope_per_day,
       sqrt(greatest(regr_syy(value, days) - regr_slope(value, days) * regr_sxy(value, days), 0)
            / nullif(count(*) - 2, 0) / nullif(regr_sxx(value, days), 0)) AS standard_error,
       slope_per_day / nullif(standard_error, 0) AS slope_over_error
FROM timed GROUP BY kind, quantity, unit, bench HAVING count(*) > 2 AND days_observed > 0
ORDER BY abs(slope_over_error) DESC NULLS LAST, kind, quantity, bench
""",
        ),
        Question(
            "capability",
            "how far each limit is from the production: Cp, Cpk, and how many gears pass",
            """
WITH judged AS (
    SELECT *, coalesce(isfinite(value), false) AND identifiable <> 'no'
              AND outcome IN ('COMPLETED', '') AS is_measured
    FROM results WHERE verdict <> '' AND limit_value IS NOT NULL
)
SELECT kind, quantity, unit, lower_limit, upper_limit, count(*) AS results, count(DISTINCT gear) AS gears,
       avg(value) FILTER (is_measured) AS mean,
       stddev_samp(value) FILTER (is_measured) AS standard_deviation,
       (upper_limit - lower_limit) / nullif(6 * standard_deviation, 0) AS cp,
       least(upper_limit - mean, mean - lower_limit) / nullif(3 * standard_deviation, 0) AS cpk,
       count(*) FILTER (verdict = 'PASS') AS passed,
       count(*) FILTER (verdict = 'MARGINAL') AS marginal,
       count(*) FILTER (verdict = 'FAIL') AS failed,
       count(*) FILTER (verdict = 'NOT JUDGED') AS not_judged
FROM judged GROUP BY kind, quantity, unit, lower_limit, upper_limit ORDER BY cpk NULLS LAST, kind, quantity
""",
        ),
        Question(
            "worst",
            "the results that are nearest to their limit, or furthest beyond it, in units of U",
            f"""
SELECT gear, kind, quantity, value, expanded_uncertainty, unit, limit_value, limit_is, verdict,
       CASE limit_is WHEN 'upper' THEN limit_value - value ELSE value - limit_value END
           / nullif(expanded_uncertainty, 0) AS margin_over_expanded_uncertainty,
       bench, day, run_file
FROM ({_MEASURED}) WHERE verdict <> '' AND limit_value IS NOT NULL
ORDER BY margin_over_expanded_uncertainty NULLS LAST, gear, kind, quantity LIMIT 50
""",
        ),
    )
}


@dataclass(frozen=True)
class Answer:
    """The rows that a question gave, with the names of their columns."""

    columns: tuple[str, ...]
    rows: list[tuple[Any, ...]]

    def as_json(self) -> dict[str, Any]:
        """The object that `rig fleet query --json` prints."""
        return {"columns": list(self.columns), "rows": [list(row) for row in self.rows]}


def results_folder(named: Path | None) -> Path:
    """The folder of results that is meant: itself, or the one in a folder of runs; the present folder's without a name.

    Raises `ConfigurationError` where there are no results.
    """
    start = named or Path()
    for folder in (start, start / FOLDER_NAME, start / "runs" / FOLDER_NAME):
        if DataSet(folder).parts():
            return folder
    raise ConfigurationError(
        "holds no results of a fleet",
        where="--results",
        value=str(start),
        limit=f"a folder {FOLDER_NAME}, or one that has it",
        remedy="Make them: rig fleet fit DIR.",
    )


def ask(folder: Path, text: str) -> Answer:
    """The answer to a question by its name, or to SQL over `results`.

    Raises `ConfigurationError` for what is neither.
    """
    import duckdb

    ready = QUESTIONS.get(text.strip())
    with connected(folder) as connection:
        try:
            found = connection.execute(ready.sql if ready else text)
            columns = tuple(column[0] for column in found.description or ())
            return Answer(columns, found.fetchall())
        except duckdb.Error as error:
            raise ConfigurationError(
                "is no question that can be answered",
                where="SQL",
                value=str(error).splitlines()[0],
                limit=f"SQL over the table results, or one of {', '.join(QUESTIONS)}",
                remedy='Look at the columns: rig fleet query "DESCRIBE results".',
            ) from None


@contextmanager
def connected(folder: Path) -> Iterator[duckdb.DuckDBPyConnection]:
    """DuckDB with the tables `results` and, where there is one, `truth`; closed at the end."""
    import duckdb

    data = DataSet(folder)
    pattern = _quoted(str(folder / "part-*.parquet"))
    renewed = data.has_renewed_rows()
    newest = "filename = max(filename) OVER (PARTITION BY run_file, kind)"
    if renewed:
        view = f"SELECT * EXCLUDE (filename) FROM read_parquet({pattern}, filename = true) QUALIFY {newest}"
    else:
        view = f"SELECT * FROM read_parquet({pattern})"
    connection = duckdb.connect()
    try:
        connection.execute(f"CREATE VIEW results AS {view}")
        truth = folder.parent / TRUTH_NAME
        if truth.is_file():
            connection.execute(
                f"CREATE VIEW truth AS SELECT * FROM read_parquet({_quoted(str(truth))})"
            )
        yield connection
    finally:
        connection.close()


def _quoted(text: str) -> str:
    return "'" + text.replace("'", "''") + "'"
