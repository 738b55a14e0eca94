"""How well a bench learns its torque scale, and what that does to a running torque, on benches that nobody has seen.

    python -m tests.benchmarks.torque_study FOLDER --benches 100 --first 84100

On each bench `torque-scale` twice: with nothing on the bare shaft, and with a disc whose stated inertia is wrong by up to
its U of 0.2 % (normal). Told: whether U of the gain holds the truth at the temperature that it is stated at, U, the lag, the
rotor's own inertia. On every tenth bench three motor tares and a friction run of a gear besides: U of the running torque at 1000
r/min before and after, and whether it holds the truth. What is made is not made again.
"""  # noqa: E501

from __future__ import annotations

import argparse
import json
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np

from experiments.errors import AnalysisError
from experiments.truth import truth_of, truth_rows
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig.analysis.fit.recorded import store
from rig.analysis.fit.run import fit_run
from rig.analysis.learnt import SCALE_PREFIX
from rig.analysis.learnt_torque import LearntScale, learn_torque, write_scale
from rig.bench.backends.order import Order, WorldChoice
from rig.gears.card import now_text
from rig.run.start import run_order
from rig.runfile.read import close_recording, open_run

DISC, EXPANDED = 2e-4, 0.002
"""kg m2 of the disc as stated, and its relative U."""
SPEED = "running_torque_1000_rpm"
FRICTION = {"speeds_rpm": (250.0, 500.0, 1000.0, 2000.0)}


def made(
    folder: Path, bench: int, population: str, protocol: str, number: int, **values: Any
) -> Path:
    """A run of a bench, made and analysed where it is not there."""
    there = sorted(folder.glob(f"{number:05d}-*.h5"))
    if there:
        return there[0]
    order = Order(
        protocol=protocol,
        gear=shipped_gear(),
        motor=shipped_motor(),
        folder=folder,
        serial="study",
        operator="study",
        seed=bench,
        values=values,
        world=WorldChoice(gear_seed=bench, bench_seed=bench, population=population),
    )
    path = run_order(order, ask=lambda prompt: prompt.consent or "simulated").path
    _fit(path)
    return path


def _fit(path: Path) -> Any:
    fit = fit_run(path)
    store(fit, now_text())
    close_recording(fit.recording)
    return fit


def bench_result(folder: Path, bench: int, population: str) -> dict[str, Any]:
    """Everything that one bench says."""
    folder.mkdir(parents=True, exist_ok=True)
    wrong = 0.5 * EXPANDED * float(np.random.default_rng(bench).standard_normal())
    bare = made(folder, bench, population, "torque-scale", 1)
    disc = made(
        folder,
        bench,
        population,
        "torque-scale",
        2,
        inertia=DISC * (1.0 + wrong),
        inertia_uncertainty=EXPANDED * DISC,
    )
    learnt = learn_torque([bare, disc])
    recording = open_run(bare, rows=False)
    truth: Any = recording.metadata.process["truth"]
    close_recording(recording)
    warmer = learnt.temperature - truth["thermal"]["reference"]
    cold = 1.0 - truth["thermal"]["torque_constant_per_kelvin"] * warmer
    of_port = (1.0 + truth["torque_port"]["scale_error"]) / cold
    told: dict[str, Any] = {"bench": bench, **_told(learnt, 1.0 + wrong, of_port)}
    told["rotor"] = learnt.rotor_inertia / truth["motor"]["rotor_inertia"] - 1.0
    told["lag"] = learnt.lags["torque"]
    told["true_lag"] = truth["torque_port"]["lag"]
    if bench % 10 == 0:
        try:
            told |= _running_torque(folder, bench, population, learnt)
        except AnalysisError as error:
            told["refused"] = str(error)
    return told


def _told(learnt: LearntScale, wrong: float, truth: float) -> dict[str, Any]:
    """`wrong`: what turned over what would have been stated, so that the gain comes out as much too large."""
    gain = learnt.gains["torque"]
    value = gain.value * wrong
    return {
        "gain": value,
        "true": truth,
        "u": gain.expanded_uncertainty / gain.value,
        "inside": abs(value - truth) <= gain.expanded_uncertainty,
    }


def _running_torque(
    folder: Path, bench: int, population: str, learnt: LearntScale
) -> dict[str, Any]:
    """U of the running torque of a gear before the scale is learnt and after, and whether it holds the truth."""
    for old in folder.glob(f"{SCALE_PREFIX}*"):
        old.unlink()
    for number in (3, 4, 5):
        made(folder, bench, population, "motor-tare", number, **FRICTION)
    friction = made(folder, bench, population, "friction", 6, **FRICTION)
    before = _of(_fit(friction))
    write_scale(learnt, folder / f"{SCALE_PREFIX}-{bench}.toml", date(2026, 1, 1), None)
    after = _of(_fit(friction))
    return {"before": before, "after": after}


def _of(fit: Any) -> dict[str, Any]:
    estimate = fit.result.estimates[SPEED]
    rows = truth_rows(fit.result, truth_of(fit.recording.metadata.process))
    truth = next(row.measurand for row in rows if row.estimate.name == SPEED)
    return {
        "value": estimate.value,
        "u": estimate.expanded_uncertainty,
        "true": truth,
        "inside": abs(estimate.value - truth) <= estimate.expanded_uncertainty,
    }


def main() -> None:
    """Make what is not there, and tell."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--benches", type=int, default=100)
    parser.add_argument("--first", type=int, required=True)
    parser.add_argument("--population", choices=("narrow", "wide"), default="narrow")
    given = parser.parse_args()
    found: list[dict[str, Any]] = []
    for bench in range(given.first, given.first + given.benches):
        found.append(bench_result(given.folder / str(bench), bench, given.population))
        print(json.dumps(found[-1]), flush=True)
    inside = sum(one["inside"] for one in found)
    print(
        f"gain inside U: {inside} of {len(found)}; by name: {[o['bench'] for o in found if not o['inside']]}"
    )
    print(f"median U {100.0 * float(np.median([o['u'] for o in found])):.3f} %")
    late = [abs(o["lag"][0] - o["true_lag"]) <= 2.0 * o["lag"][1] for o in found]
    print(f"lag inside U: {sum(late)} of {len(late)}")
    print(
        f"rotor: r.m.s. {100.0 * float(np.sqrt(np.mean([o['rotor'] ** 2 for o in found]))):.2f} %"
    )
    both = [o for o in found if "before" in o]
    if both:
        ratios = [o["before"]["u"] / o["after"]["u"] for o in both]
        held = [o["after"]["inside"] for o in both]
        print(
            f"U of the running torque falls by {np.round(ratios, 2)}, median {float(np.median(ratios)):.2f}"
        )
        print(f"after inside U: {sum(held)} of {len(held)}")


if __name__ == "__main__":
    main()
