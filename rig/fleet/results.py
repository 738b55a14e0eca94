"""What a row of the fleet's results is: its columns, their types and meanings, in one table.

One row is one quantity of one run. A run that could not be read or analysed is one row whose `quantity` is empty and
whose `failure` says why. Numbers are in SI units; what is not known is null. The file format is Parquet, so that
pandas, polars, DuckDB, R and Arrow read it without this program.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    import pyarrow

SCHEMA_VERSION = 3
"""Goes up when a column changes its meaning, its type or its name, or where rows without a new column would mislead.

2: both sides of a limit (`lower_limit`, `upper_limit`) beside the one that decides. 3: `mounted`, without which every
run of a gear on a bench would be taken for one mounting.
"""
SCHEMA_KEY = "harmonic-rig-fleet-schema"
"""The key of the version in the metadata of every Parquet file."""

_ColumnType = Literal["text", "number", "count", "truth", "day", "time"]
Row = dict[str, Any]


@dataclass(frozen=True)
class Column:
    """One column: its name, its type, and what stands in it."""

    name: str
    type: _ColumnType
    meaning: str


COLUMNS: tuple[Column, ...] = (
    # The run.
    Column("run_file", "text", "path of the run file as the program that ordered the fits sees it"),
    Column("run", "text", "the run's own name, <number>-<protocol>-<serial>"),
    Column("gear", "text", "serial number of the gear"),
    Column("part", "text", "part: the name of the gear's parameter set"),
    Column("bench", "text", "identity of the bench on which the run was made"),
    Column("mounting", "text", "circular-spline-fixed or flexspline-fixed"),
    Column(
        "mounted",
        "text",
        "which mounting of the gear: since when, or its number in a simulated world",
    ),
    Column("started", "time", "when the run started, UTC"),
    Column("day", "day", "the date on which the run started, by the clock of its bench"),
    Column("operator", "text", "who ran it"),
    Column("origin", "text", "hardware, simulated, replay or imported"),
    Column("outcome", "text", "how the run ended: COMPLETED, ABORTED, TRIPPED, ERROR, INTERRUPTED"),
    Column("protocol", "text", "the protocol by which the run was made"),
    Column(
        "kind", "text", "the kind of analysis; that of the protocol unless another was asked for"
    ),
    # The number.
    Column("quantity", "text", "name of the quantity within its kind; empty where a run failed"),
    Column("family", "text", "name that the kind declares: torque_{speed} of torque_60rpm_forward"),
    Column("title", "text", "what people call the quantity"),
    Column(
        "is_metric", "truth", "a figure of the analysis without an uncertainty (residual, skill)"
    ),
    Column("value", "number", "the value, in `unit`"),
    Column("unit", "text", "SI unit"),
    Column("standard_uncertainty", "number", "u, combined (types A and B), in `unit`"),
    Column("expanded_uncertainty", "number", "U = k u at 95 %, in `unit`"),
    Column("coverage_factor", "number", "k, from Student's t"),
    Column(
        "degrees_of_freedom",
        "number",
        "effective, by Welch and Satterthwaite; infinite where without end",
    ),
    Column("low", "number", "low end of the 95 % interval of the data alone (type A)"),
    Column("high", "number", "high end of the 95 % interval of the data alone (type A)"),
    Column("identifiable", "text", "yes, weakly or no: whether the data decided it"),
    Column("note", "text", "why it is not `yes`"),
    # The judgement.
    Column(
        "limit_value",
        "number",
        "the limit of the acceptance file, in `unit`; of two the one that decides",
    ),
    Column("limit_is", "text", "upper or lower"),
    Column(
        "lower_limit", "number", "smallest allowed value, in `unit`; null where that side is free"
    ),
    Column(
        "upper_limit", "number", "largest allowed value, in `unit`; null where that side is free"
    ),
    Column("limit_source", "text", "the document and whose limit it is"),
    Column(
        "verdict",
        "text",
        "PASS, MARGINAL, FAIL or NOT JUDGED; empty where no limit is on the quantity",
    ),
    Column("reason", "text", "why it is NOT JUDGED"),
    Column("run_verdict", "text", "the verdict on all that this run measures"),
    Column("run_reason", "text", "why that is not PASS"),
    Column("acceptance", "text", "the acceptance file; empty where none is named"),
    # A run that could not be read or analysed.
    Column("failure", "text", "why there is no result; empty where there is one"),
    Column("failure_kind", "text", "the kind of error: RunFileError, AnalysisError, ..."),
    # Conditions and provenance.
    Column("temperature", "number", "mean temperature of the housing in the run [degC]"),
    Column("ambient_temperature", "number", "mean temperature of the room in the run [degC]"),
    Column("conditions", "text", "what the run file says of its conditions, as JSON"),
    Column("warnings", "count", "how many warnings the analysis gave"),
    Column("tare", "text", "the run whose tare was subtracted; empty without one"),
    Column("tare_because", "text", "why this tare, or why none"),
    Column("settings", "text", "settings of the analysis, as JSON"),
    Column("run_sha256", "text", "SHA-256 of the run file"),
    Column("tare_sha256", "text", "SHA-256 of the tare's run file"),
    Column("gear_set_sha256", "text", "SHA-256 of the gear's parameter set that was used"),
    Column("gear_set_source", "text", "where that set is from: card, run, by hand, shipped"),
    Column("analysis_version", "count", "version of the kind of analysis"),
    Column("program_version", "text", "version of the program"),
    Column("key", "text", "hash of all that the rows of this run rest on; another key, other rows"),
    Column(
        "surroundings", "text", "hash of what lay around the run and could have decided on its tare"
    ),
)
"""The table, in the order of its columns."""

NAMES: tuple[str, ...] = tuple(column.name for column in COLUMNS)


def arrow_schema() -> pyarrow.Schema:
    """The columns as Arrow has them, with the version of the schema in its metadata and every meaning in its field."""
    import pyarrow as pa

    types = {
        "text": pa.string(),
        "number": pa.float64(),
        "count": pa.int64(),
        "truth": pa.bool_(),
        "day": pa.date32(),
        "time": pa.timestamp("us", tz="UTC"),
    }
    fields = [
        pa.field(column.name, types[column.type], metadata={"meaning": column.meaning})
        for column in COLUMNS
    ]
    return pa.schema(fields, metadata={SCHEMA_KEY: str(SCHEMA_VERSION)})
