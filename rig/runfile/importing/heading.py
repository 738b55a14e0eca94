"""The header of an imported run: what the files and the person who imports them say of it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.recording import RunMetadata, TimeBase
from rig.errors import ConfigurationError
from rig.program import extension_records
from rig.runfile.header import RunHeader, iso_time
from rig.runfile.importing.adapters.arrays import ArrayTable
from rig.runfile.importing.adapters.table import Table
from rig.runfile.importing.channel_map import ImportOptions
from rig.runfile.importing.clocks import in_zone
from rig.runfile.importing.reading import Reading, Rows
from rig.runfile.importing.stated import stated_speed
from rig.runfile.seal import file_sha256

_EARLIEST_CALENDAR_S = 978_307_200.0
"""2001-01-01 in seconds since 1970: a time column beyond this is calendar time."""


def header_of(
    tables: Sequence[Table], options: ImportOptions, reading: Reading, first: Rows
) -> RunHeader:
    """The header of the run. Raises `ConfigurationError` for a start that is none, and where the
    sense of the output angle has to be said.
    """
    names = {column.name for column in reading.columns}
    if not any(one.column.name == "output_angle" for one in reading.derived):
        _ask_for_output_sense(names, options)
    start_ns, start_time = _start(reading, options, first)
    timed = not options.no_time
    rate = reading.rate or (sample_rate(first.time_ns) if timed else math.nan)
    ratio = options.known_ratio
    metadata = RunMetadata(
        run_id="",
        experiment=options.experiment,
        origin="imported",
        title=options.title or f"import of {', '.join(t.path.name for t in tables)}",
        start_time=start_time,
        operator=options.operator,
        gear=options.gear,
        gear_serial=options.gear_serial,
        gear_mounted=options.gear_mounted,
        # A negative ratio says that the joint counts against the motor, which is no matter of the gear.
        ratio=abs(ratio),
        mounting=options.known_mounting,
        output_sense=options.output_sense or 1,
        sample_rate=rate,
        time_base=_time_base(tables, options),
        conditions=options.conditions,
        process=_process(tables, options, ratio, reading.written),
    )
    return RunHeader(metadata, reading.columns, epoch_ns=start_ns)


def sample_rate(time_ns: NDArray[np.int64]) -> float:
    """Rows per second: the mean of the usual steps, which neither gaps nor the rounding of the time column move."""
    steps = np.diff(time_ns)
    if not len(steps):
        return math.nan
    usual = float(np.median(steps))
    near = steps[(steps > 0.5 * usual) & (steps < 1.5 * usual)]
    # Two steps of which one is many times the other have none near their median.
    return 1e9 / float(near.mean() if len(near) else usual)


def _ask_for_output_sense(names: set[str], options: ImportOptions) -> None:
    """Two angles of one gear mean nothing together until somebody says which way the second one counts."""
    if {"input_angle", "output_angle"} <= names and not options.output_sense:
        raise ConfigurationError(
            "nobody says whether the output angle counts with the input angle or against it",
            where="--output-sense",
            limit="+1 with it, -1 against it, when the output follows a positive input",
            remedy="Add --output-sense 1 or --output-sense -1 (in a map: [gear] output_sense); "
            "--check shows how the two move.",
        )


def _start(reading: Reading, options: ImportOptions, first: Rows) -> tuple[int, str]:
    """Calendar time [ns] of time 0 of the rows, and the start as text; 0 and "" where nobody knows."""
    start_time = options.start_time
    if start_time:
        try:
            moment = datetime.fromisoformat(start_time)
        except ValueError:
            raise ConfigurationError(
                "is no date and time",
                where="--start",
                value=start_time,
                limit="ISO 8601, as 2025-11-21T09:30:00+01:00",
            ) from None
        return int(in_zone(moment).timestamp() * 1e6) * 1000 - int(first.time_ns[0]), start_time
    if first.time_ns[0] >= _EARLIEST_CALENDAR_S * 1e9:
        return 0, iso_time(int(first.time_ns[0]))
    start_ns = reading.start_ns
    if start_ns:
        return start_ns, iso_time(start_ns + int(first.time_ns[0]))
    return 0, ""


def _time_base(tables: Sequence[Table], options: ImportOptions) -> TimeBase:
    if options.no_time:
        return "none"
    return options.time_base or ("nominal" if options.rate else "device")


def _process(
    tables: Sequence[Table], options: ImportOptions, ratio: float, written: Mapping[str, str]
) -> dict[str, Any]:
    """Where the numbers are from, and what was stated of the device."""
    return {
        "backend": "import",
        "source_file": ", ".join(table.path.name for table in tables),
        "source_sha256": ", ".join(file_sha256(table.path) for table in tables),
        "channel_map": [
            {
                "channel": s.name,
                "column": s.column,
                "file": s.file,
                "unit": s.unit,
                "unit_as_written": written.get(s.name, ""),
                "scale": s.scale,
                "offset": s.offset,
                "modulus": s.modulus,
                "side": s.side,
            }
            for s in (*options.channels, *options.reverse)
        ],
        "stated": _device_facts(options, ratio),
        **extension_records(one.brought_by for one in tables if isinstance(one, ArrayTable)),
    }


def _device_facts(options: ImportOptions, ratio: float) -> dict[str, Any]:
    """What a person said of the device; keys with false or nothing were left open."""
    stated: dict[str, Any] = {
        "output_sense": bool(options.output_sense),
        "mounting": options.mounting is not None,
        "ratio": math.isfinite(ratio),
        "lag_s": {s.name: s.lag_s for s in options.channels if s.lag_s is not None},
    }
    if (speed := stated_speed(options)) is not None:
        stated["speed_rad_s"] = speed
    for name in ("resonance_hz", "load_inertia_kg_m2"):
        value = getattr(options, name)
        if value is not None:
            stated[name] = value
    if options.proposed:
        stated["proposed"] = list(options.proposed)
        stated["accepted_by"] = options.accepted_by
    return stated
