"""Small run files with hand-made analyses beside them: a gear's history without a rig and without a fit."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from experiments import catalogue
from experiments.result import Result
from model.identify.estimate import BudgetLine, Cause, Estimate
from rig.analysis.result_data import quantities_for
from rig.analysis.store import Analysis, Basis, append_analysis
from rig.runfile.layout import Column
from rig.runfile.seal import recorded_sha256
from rig.runfile.write import RunWriter
from tests.rig.runfile.making import CHANNELS, block, header

RUNNING = "running_torque_1000_rpm"
TORQUE = Column.of(CHANNELS[2])
"""The only channel of these runs: more would only take longer to read."""
BACKENDS = {"imported": "import", "hardware": "hardware", "replay": "replay:run.h5"}


def write(
    folder: Path,
    number: int,
    protocol: str = "friction",
    *,
    serial: str = "A1",
    outcome: str = "COMPLETED",
    rows: int = 20,
    part: bool = False,
    changes: Mapping[str, Any] | None = None,
    **metadata: Any,
) -> Path:
    """A sealed run (a dead one with `part`); `changes` of the header, the rest of its metadata."""
    run_id = f"{number:05d}-{protocol}-{serial}"
    made = header(run_id)
    told = {"experiment": protocol, "gear_serial": serial, **metadata}
    given = {"columns": (TORQUE,), **(changes or {})}
    if told.get("origin") in BACKENDS:
        told["process"] = {
            **told.get("process", made.metadata.process),
            "backend": BACKENDS[told["origin"]],
        }
        given |= {"truth": None}
    made = dataclasses.replace(made, metadata=dataclasses.replace(made.metadata, **told), **given)
    writer = RunWriter(folder / f"{run_id}.h5", made, chunk_rows=64)
    # The counts of no two runs are the same, and neither are their files.
    whole = block(1000 * number, rows)
    writer.append(dataclasses.replace(whole, counts=whole.counts[:, 2:3]))
    if part:
        writer.flush()
        writer.abandon()
        return writer.part
    return writer.seal(outcome, "2025-11-21T04:41:00.000+00:00")


def estimate(
    name: str, value: float, unit: str = "N m", own: float = 1e-4, scale: float = 0.0, **more: Any
) -> Estimate:
    """An estimate with `own` standard uncertainty of type A and a relative one of the torque scale."""
    budget = [BudgetLine("points nearby", "A", own)]
    if scale:
        by_scale = scale * abs(value)
        budget.append(BudgetLine("torque scale", "B", by_scale, "certificate", Cause.TORQUE_SCALE))
    return Estimate(
        name=name,
        value=value,
        unit=unit,
        low=value - 2 * own,
        high=value + 2 * own,
        budget=tuple(budget),
        **more,
    )


def analyse(
    run: Path,
    *estimates: Estimate,
    kind: str = "friction",
    options: Mapping[str, Any] | None = None,
    metrics: Mapping[str, float] | None = None,
    sha256: str = "",
    tare: Mapping[str, str] | None = None,
) -> Analysis:
    """Lay a result beside a run."""
    told = {"torque_is_of": "gear", "channel": "torque"} if options is None else options
    run_id = run.name.removesuffix(".h5")
    named = {e.name: e for e in estimates}
    result = Result(
        run=run_id,
        kind=kind,
        quantities=quantities_for(kind, named, metrics or {}),
        estimates=named,
        metrics=metrics or {},
        options=told,
    )
    basis = Basis(
        sha256 or recorded_sha256(run),
        "2025-11-21T05:00:00+00:00",
        tare=tare or {},
        analysis_version=catalogue.load(kind).version,
    )
    return append_analysis(run, result, basis)


def start(day: int) -> str:
    """The start of a run on a day of January 2026 or after it."""
    month, day = divmod(day - 1, 28)
    return f"2026-{month + 1:02d}-{day + 1:02d}T09:00:00.000+00:00"
