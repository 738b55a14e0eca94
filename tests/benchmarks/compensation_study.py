"""What a compensation table leaves, as seen and in truth, on gears and benches that nobody has seen.

    python -m tests.benchmarks.compensation_study FOLDER --benches 20 --first 86000 [--population wide] [--wrong]

On each bench one gear by kinematic-error at 58 r/min; those below 12 arcsec r.m.s. are named and left out. With its
table a compensated-error run on a drive that is led by positions, octave by octave from 58 to 928 r/min, at 250 Hz.
Told: seen and true remainder at the slowest speed over their predictions, the proof, what was taken out in truth, the
bracket of the speed from which the table harms, and where that lies in truth (a run at speeds a third of an octave
apart); of wide ones up to 232 r/min. Of narrow gears once more after eight other gears have taught the bench its
output encoder. `--wrong`: the same gears with tables that are wrong in one way each, at 116 r/min, and what the proof
says of them. The true output angle is the plant's. What is made is not made again.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np

from experiments.angle.phase_reference import phase_reference
from experiments.protocols.compensated_error.turns import (
    Turn,
    basis_of,
    fitted,
    sent_to,
    waves_of,
)
from experiments.recording import Recording
from model.compensation import CompensationTable, DirectionTable
from model.compensation_file import compensation_text
from model.kernels import loop_layout as at
from model.units import ARCSEC, DEGREE, RPM
from rig.analysis.compensation import table_from
from rig.analysis.fit.run import fit_run
from rig.analysis.learnt import PREFIX
from rig.analysis.learnt_encoder import learn, write_learnt
from rig.bench.backends.order import Order
from rig.run.start import run_order
from rig.runfile.read import close_recording, open_run
from sim_backend.plant import Plant
from tests.benchmarks.encoder_study import _order, made_several

LEAST = 12.0
"""arcsec r.m.s. of a gear that is worth it, of the narrow ones."""
OCTAVES = (58.0, 116.0, 232.0, 464.0, 928.0)
FINE = tuple(328.0 * 2.0 ** (k / 3.0) for k in range(6))
SLOW, SHORT = (58.0, 116.0, 232.0), (58.0, 928.0, 1312.0)
FASTER = (116.0, 928.0, 1312.0)
_GEAR = 9


class Truth:
    """The true angles of a plant, row by row: input and output [rad]."""

    def __init__(self) -> None:
        self.rows: list[np.ndarray] = []
        self.count = self.kept = 0

    def angles(self) -> np.ndarray:
        """(n, 2)."""
        return np.concatenate(self.rows)


@contextmanager
def recorded_truth() -> Iterator[Truth]:
    """Everything that any plant does meanwhile; what a guard takes back is taken back."""
    truth = Truth()
    advance, snapshot, restore = Plant.advance, Plant.snapshot, Plant.restore

    def advancing(self: Plant, mode: int, targets: Any) -> Any:
        rows = advance(self, mode, targets)
        truth.rows.append(rows[:, [at.ROW_INPUT_ANGLE, at.ROW_OUTPUT_ANGLE]].copy())
        return rows

    def keeping(self: Plant) -> Any:
        truth.kept = len(truth.rows)
        return snapshot(self)

    def going_back(self: Plant, kept: Any) -> None:
        del truth.rows[truth.kept :]
        restore(self, kept)

    Plant.advance, Plant.snapshot, Plant.restore = advancing, keeping, going_back  # type: ignore[method-assign]
    try:
        yield truth
    finally:
        Plant.advance, Plant.snapshot, Plant.restore = advance, snapshot, restore  # type: ignore[method-assign]


def order_of(folder: Path, bench: int, population: str, gear: int = _GEAR, mount: int = 2) -> Order:
    """One gear of a bench, mounted."""
    order = _order(folder, bench, 100 * bench + gear, mount, 70.0 * (mount - 2), population)
    return replace(order, serial=f"G-{bench}-{gear}")


def kinematic_run(folder: Path, bench: int, population: str, gear: int = _GEAR) -> Path:
    """The kinematic-error run from which a table is made."""
    there = sorted(folder.glob(f"*-kinematic_error-G_{bench}_{gear}.h5"))
    if there:
        return there[0]
    order = replace(order_of(folder, bench, population, gear), values={"speed_rpm": OCTAVES[0]})
    return run_order(order, ask=lambda prompt: "simulated").path


def compensated(
    order: Order, table: CompensationTable, speeds: tuple[float, ...], name: str
) -> dict[str, Any]:
    """What a run along a table shows and what it was in truth; kept beside the runs."""
    kept = order.folder / f"{name}.json"
    if kept.is_file():
        return json.loads(kept.read_text())
    values = {"table": compensation_text(table), "speeds_rpm": speeds, "zero_time": 0.5}
    order = replace(order, protocol="compensated-error", values=values, backend="wire-csp")
    with recorded_truth() as truth:
        report = run_order(order, ask=lambda prompt: "simulated")
    if report.outcome != "COMPLETED":
        return {"outcome": report.outcome}
    fit = fit_run(report.path)
    result = fit.result
    close_recording(fit.recording)
    found = {
        "outcome": report.outcome,
        "verdict": result.options["proof"],
        "ratio": [result.estimates["proof_ratio"].value, *interval(result)],
        "encoder": math.sqrt(
            result.metrics["predicted_true"] ** 2 - result.metrics["predicted_seen"] ** 2
        )
        / ARCSEC,
        "helps": result.metrics.get("helps_up_to", 0.0) / RPM,
        "harms": result.metrics.get("harms_from", math.inf) / RPM,
        "seen": [list(row) for row in result.tables[0].rows],
        "true": true_of(report.path, table, truth.angles()),
    }
    kept.write_text(json.dumps(found))
    report.path.unlink()
    return found


def interval(result: Any) -> tuple[float, float]:
    """The interval of the proof's ratio."""
    ratio = result.estimates["proof_ratio"]
    return ratio.low, ratio.high


def true_of(run: Path, table: CompensationTable, truth: np.ndarray) -> list[list[float]]:
    """Speed [r/min], true r.m.s. without the table and with it [arcsec]."""
    recording = open_run(run)
    turns = list(true_turns(recording, table, truth))
    close_recording(recording)
    rows = []
    for speed in sorted({abs(turn.speed) for turn in turns}):
        pair = [
            math.sqrt(
                np.mean(
                    [
                        0.5 * float(np.sum(np.abs(waves_of(t.output)) ** 2))
                        for t in turns
                        if abs(t.speed) == speed and t.is_compensated is with_table
                    ]
                )
            )
            for with_table in (False, True)
        ]
        rows.append([speed / RPM, pair[0] / ARCSEC, pair[1] / ARCSEC])
    return rows


def true_turns(recording: Recording, table: CompensationTable, truth: np.ndarray) -> Iterator[Turn]:
    """The traverses by the plant's own output angle."""
    zero = phase_reference(recording, table.index_gap).input_angle
    first = first_row(recording, truth[:, 0])
    basis = basis_of(table)
    for segment in recording.labelled("traverse", "compensated"):
        rows = slice(segment.start, segment.stop)
        motor = recording.si("input_angle", rows) - zero
        speed = recording.si("target_speed", rows)
        sent = sent_to(speed, 1.0 / recording.metadata.sample_rate, motor)
        output = truth[segment.start + first : segment.stop + first, 1]
        yield fitted(segment, table, basis, sent, output, motor)


def first_row(recording: Recording, true_input: np.ndarray) -> int:
    """Which row of the plant is the first of the run: where both inputs turn alike."""
    rows = slice(0, recording.rows, 7)
    seen = recording.si("input_angle", slice(0, recording.rows))[rows]
    beside = len(true_input) - recording.rows
    apart = []
    for first in range(max(beside, 0) + 1):
        off = seen - true_input[first : first + recording.rows][rows]
        apart.append(float(np.ptp(off)))
    best = int(np.argmin(apart))
    assert apart[best] < 0.02, f"the plant turned otherwise than the run: {apart[best]} rad"
    return best


def wrong_tables(
    table: CompensationTable, other: CompensationTable
) -> Iterator[tuple[str, CompensationTable]]:
    """Tables that are wrong in one way each."""
    yield "sign", altered(table, lambda order, wave: -wave)
    yield (
        "phase by 10 degrees",
        altered(table, lambda order, wave: wave * np.exp(10j * DEGREE * order)),
    )
    yield "another gear's", replace(other, gear=table.gear, index_gap=table.index_gap)
    yield "direction", altered(table, lambda order, wave: wave.conjugate())
    yield (
        "index mark by 30 degrees",
        altered(table, lambda order, wave: wave * np.exp(30j * DEGREE * order)),
    )
    yield "ratio 100", of_other_ratio(table, 100.0)


def altered(table: CompensationTable, change: Any) -> CompensationTable:
    """The same with every complex order a - i b changed."""

    def way(one: DirectionTable, orders: np.ndarray) -> DirectionTable:
        waves = [
            change(order, complex(a, -b))
            for order, a, b in zip(orders, one.cosine, one.sine, strict=True)
        ]
        return replace(
            one,
            cosine=tuple(float(w.real) for w in waves),
            sine=tuple(float(-w.imag) for w in waves),
        )

    return replace(
        table,
        forward=way(table.forward, table.of(1.0).orders),
        reverse=way(table.reverse, table.of(-1.0).orders),
    )


def of_other_ratio(table: CompensationTable, ratio: float) -> CompensationTable:
    """As if it had been made for another ratio: orders k/N at another N, the input's correction by another N."""

    def way(one: DirectionTable, orders: np.ndarray) -> DirectionTable:
        whole = np.rint(orders)
        moved = whole + (orders - whole) * table.ratio / ratio
        share = ratio / table.ratio
        return replace(
            one,
            labels=tuple(f"{order:.9g}" for order in moved),
            cosine=tuple(share * a for a in one.cosine),
            sine=tuple(share * b for b in one.sine),
        )

    return replace(
        table,
        forward=way(table.forward, table.of(1.0).orders),
        reverse=way(table.reverse, table.of(-1.0).orders),
    )


def size_of(table: CompensationTable) -> float:
    """R.m.s. of what it takes out, mean square of both directions [arcsec]."""
    return math.sqrt(0.5 * (table.of(1.0).rms ** 2 + table.of(-1.0).rms ** 2)) / ARCSEC


def bench_result(folder: Path, bench: int, population: str) -> dict[str, Any]:
    """Everything that one bench shows; "too small" where the gear is not worth it."""
    here = folder / population / str(bench)
    here.mkdir(parents=True, exist_ok=True)
    run = kinematic_run(here, bench, population)
    learnt = [*here.glob(f"{PREFIX}-*")]
    for file in learnt:
        file.unlink()
    table = table_from([run])
    if population == "narrow" and size_of(table) < LEAST:
        return {"bench": bench, "too_small": size_of(table)}
    order = order_of(here, bench, population)
    found: dict[str, Any] = {"bench": bench, "size": size_of(table)}
    speeds = OCTAVES if population == "narrow" else SLOW
    found["one_bench"] = compensated(order, table, speeds, "one-bench")
    if population == "narrow":
        found["fine"] = compensated(order, table, FINE, "fine")
        several = made_several(here / "others", bench, population)
        write_learnt(learn(several), here / f"{PREFIX}-{bench}-study.csv", date(2026, 1, 1), None)
        found["learnt"] = compensated(order, table_from([run]), SHORT, "learnt")
    return found


def wrong_result(folder: Path, bench: int) -> dict[str, Any]:
    """What the proof says of wrong tables, and of one that is right for another mounting."""
    here = folder / "wrong" / str(bench)
    here.mkdir(parents=True, exist_ok=True)
    table = table_from([kinematic_run(here, bench, "narrow")])
    if size_of(table) < LEAST:
        return {"bench": bench, "too_small": size_of(table)}
    other = table_from([kinematic_run(here, bench, "narrow", gear=_GEAR + 1)])
    order = order_of(here, bench, "narrow")
    found: dict[str, Any] = {"bench": bench}
    for name, wrong in wrong_tables(table, other):
        found[name] = compensated(order, wrong, FASTER, name.replace(" ", "-").replace("'", ""))
    mounted_anew = order_of(here, bench, "narrow", mount=3)
    found["mounting"] = compensated(mounted_anew, table, FASTER, "mounting")
    return found


def told(results: list[dict[str, Any]]) -> str:
    """Counts and the benches that miss, by number."""
    good = [one for one in results if "too_small" not in one]
    lines = [
        f"{len(good)} gears; too small: {[one['bench'] for one in results if 'too_small' in one]}"
    ]
    for part in ("one_bench", "learnt"):
        some = [(one["bench"], one[part]) for one in good if part in one]
        if not some:
            continue
        seen = {bench: run["seen"][0][4] for bench, run in some}
        true = {
            bench: run["true"][0][2] / math.hypot(run["seen"][0][3], run["encoder"])
            for bench, run in some
        }
        removed = {bench: 1.0 - run["true"][0][2] / run["true"][0][1] for bench, run in some}
        least = 0.6 if part == "one_bench" else 0.8
        lines += [
            f"{part}:",
            counted("  seen over predicted within 0.8 to 1.25", seen, lambda r: 0.8 <= r <= 1.25),
            counted("  true over predicted within 0.8 to 1.25", true, lambda r: 0.8 <= r <= 1.25),
            counted(
                f"  taken out in truth >= {100 * least:.0f} %", removed, lambda r, a=least: r >= a
            ),
            f"  verdicts {[run['verdict'] for _, run in some]}",
            f"  before {spread([run['true'][0][1] for _, run in some])}, "
            f"after {spread([run['true'][0][2] for _, run in some])} arcsec in truth",
        ]
    bracketed = {one["bench"]: harm(one) for one in good if "fine" in one}
    lines.append(counted("harm bracketed", bracketed, lambda row: row[0] <= row[2] <= row[1]))
    return "\n".join(lines)


def harm(one: dict[str, Any]) -> tuple[float, float, float]:
    """Bracket as told [r/min], and where with and without are one in truth, between fine speeds."""
    helps, harms = one["one_bench"]["helps"], one["one_bench"]["harms"]
    last = before = 0.0
    for speed, without, beside in one["fine"]["true"]:
        excess = math.log(beside / without)
        if excess >= 0.0:
            return (
                helps,
                harms,
                last + (speed - last) * before / (before - excess) if before else speed,
            )
        last, before = speed, excess
    return helps, harms, math.inf if harms == math.inf else last


def counted(what: str, values: dict[int, Any], good: Any) -> str:
    """How many of them are good, and which are not."""
    misses = {bench: value for bench, value in values.items() if not good(value)}
    return f"{what}: {len(values) - len(misses)} of {len(values)}; others {misses}; all {list(values.values())}"


def spread(values: list[float]) -> str:
    """Least, median, largest."""
    return f"{min(values):.2f}, {float(np.median(values)):.2f}, {max(values):.2f}"


def told_of_wrong(results: list[dict[str, Any]]) -> str:
    """Of every wrong: how many tables the proof refuses, and what it says of the others."""
    good = [one for one in results if "too_small" not in one]
    names = [name for name in good[0] if name != "bench"]
    lines = []
    for name in names:
        verdicts = {one["bench"]: one[name].get("verdict", one[name]["outcome"]) for one in good}
        ratios = [one[name]["ratio"][0] for one in good if "ratio" in one[name]]
        refused = sum(verdict == "FAIL" for verdict in verdicts.values())
        others = {bench: v for bench, v in verdicts.items() if v != "FAIL"}
        lines.append(
            f"{name}: refused {refused} of {len(good)}; others {others}; ratios {spread(ratios)}"
        )
    return "\n".join(lines)


def main() -> None:
    """Run what is asked for and say what came of it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--benches", type=int, default=20)
    parser.add_argument("--first", type=int, required=True)
    parser.add_argument("--population", default="narrow", choices=("narrow", "wide"))
    parser.add_argument("--wrong", action="store_true")
    asked = parser.parse_args()
    results: list[dict[str, Any]] = []
    bench = asked.first
    while sum("too_small" not in one for one in results) < asked.benches:
        one = (
            wrong_result(asked.folder, bench)
            if asked.wrong
            else bench_result(asked.folder, bench, asked.population)
        )
        results.append(one)
        print(json.dumps(one), flush=True)
        bench += 1
    print((told_of_wrong if asked.wrong else told)(results))


if __name__ == "__main__":
    main()
