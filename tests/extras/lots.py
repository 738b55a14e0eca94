"""Results of a made-up lot: sixty gears on two benches, four limits; some fail, are unlike or are not analysed."""

from __future__ import annotations

import math
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from rig.fleet.dataset import DataSet
from rig.fleet.rows import EMPTY
from rig.fleet.table import table_bytes
from rig.gears.acceptance import shipped_acceptance

ACCEPTANCE = "demonstration"
BEGIN = datetime(2026, 3, 2, 8, tzinfo=UTC)
MIDDLE = 0.8
"""The mean of every quantity over its limit."""
SPREAD = 0.05
DOUBT = 0.01
"""Standard deviation between gears, and the standard uncertainty, over the limit."""
FAILING, MARGINAL, UNLIKE, NOT_ANALYSED, BROKEN = 7, 13, 21, 33, 41


def shares(gears: int = 60, seed: int = 5) -> np.ndarray:
    """Values over their limits, (gears, limits): what the results are made of."""
    limits = len(shipped_acceptance(ACCEPTANCE).limits)
    found = np.random.default_rng(seed).normal(MIDDLE, SPREAD, (gears, limits)).clip(0.66, 0.94)
    if gears > BROKEN:
        found[FAILING, 0], found[MARGINAL, 2], found[UNLIKE, 3] = 1.2, 1.005, 0.3
    return found


def write_lot(folder: Path, gears: int = 60, **changes: Any) -> Path:
    """The results in `folder`; `changes` of columns of every row."""
    rows = []
    for gear, of_gear in enumerate(shares(gears)):
        for limit, share in zip(shipped_acceptance(ACCEPTANCE).limits, of_gear, strict=True):
            if gear == NOT_ANALYSED and limit.kind == "friction":
                continue
            rows.append(_row(gear, limit, float(share)) | changes)
        if gear == BROKEN:
            failed = {
                "quantity": "",
                "failure": "the file is damaged",
                "failure_kind": "RunFileError",
            }
            rows.append(_run(gear, "home") | failed | changes)
    with DataSet(folder).writing() as data:
        data.append(table_bytes(rows))
    return folder


def _run(gear: int, kind: str) -> dict[str, Any]:
    run = f"{gear:05d}-{kind}-G{gear:03d}"
    started = BEGIN + timedelta(days=gear // 4, minutes=10 * (gear % 4))
    return EMPTY | {
        "run_file": f"/runs/{run}.h5",
        "run": run,
        "gear": f"G{gear:03d}",
        "part": "CSF-25-120-2UH",
        "bench": "AB"[gear % 2],
        "started": started,
        "day": started.date(),
        "operator": "Ada",
        "origin": "simulated",
        "outcome": "COMPLETED",
        "protocol": kind,
        "kind": kind,
        "acceptance": ACCEPTANCE,
        "failure": "",
        "failure_kind": "",
        "warnings": 0,
        "key": run,
        "analysis_version": 1,
    }


def _row(gear: int, limit: Any, share: float) -> dict[str, Any]:
    bound = limit.upper
    doubt = DOUBT * bound
    room = (1.0 - share) / (2.0 * DOUBT)
    verdict = "PASS" if room >= 1.0 else "FAIL" if room <= -1.0 else "MARGINAL"
    return _run(gear, limit.kind) | {
        "quantity": limit.name,
        "family": limit.declared().name,
        "title": limit.name,
        "is_metric": False,
        "value": share * bound,
        "unit": limit.declared().unit,
        "standard_uncertainty": doubt,
        "expanded_uncertainty": 2.0 * doubt,
        "coverage_factor": 2.0,
        "degrees_of_freedom": math.inf,
        "low": share * bound - doubt,
        "high": share * bound + doubt,
        "identifiable": "yes",
        "note": "",
        "limit_value": bound,
        "limit_is": "upper",
        "upper_limit": bound,
        "limit_source": limit.source,
        "verdict": verdict,
        "reason": "",
        "run_verdict": verdict,
        "run_reason": "",
    }
