"""The page of the results of a fleet: every column of the table, from its schema; the ready questions."""

from __future__ import annotations

from rig.fleet.questions import QUESTIONS
from rig.fleet.results import COLUMNS, SCHEMA_KEY, SCHEMA_VERSION

TYPES = {
    "text": "string",
    "number": "double",
    "count": "int64",
    "truth": "bool",
    "day": "date32",
    "time": "timestamp, us, UTC",
}


def fleet_results() -> list[str]:
    """The page."""
    lines = [
        "# Results of a fleet",
        "",
        "One row is one quantity of one run. `rig fleet fit` keeps them as Parquet, in files `part-<number>.parquet`",
        "of one folder. For one run and one kind the rows in the highest-numbered file count: while a job runs, and",
        "after one that was killed, rows that were renewed may stand in an older file too. At its end each run",
        "stands there once. Numbers are in SI units, temperatures in degC; what is not known is null.",
        "",
        f"Version of the schema: {SCHEMA_VERSION}, in every file's metadata under `{SCHEMA_KEY}`. It goes up when",
        "a column changes its name, its type or its meaning.",
        "",
        "| column | type | meaning |",
        "|---|---|---|",
    ]
    lines += [f"| `{c.name}` | {TYPES[c.type]} | {c.meaning} |" for c in COLUMNS]
    lines += ["", "## Ready questions", "", "| `rig fleet query` | asks |", "|---|---|"]
    lines += [f"| `{q.name}` | {q.asks} |" for q in QUESTIONS.values()]
    return lines
