"""How well a bench learns its output encoder, and what that does to the gears' numbers, on benches that nobody has seen.

    python -m tests.benchmarks.encoder_study FOLDER --benches 20 --first 83000

On each bench eight gears, each mounted once at its angle of the plan (0, 45 ... 315 degrees), by `kinematic-error`. Told,
over all benches: the error of the complex orders 1 to 4 against the gears' own deviation over sqrt(8) and in arcseconds;
how many of the orders 1 to 8 lie inside U, as they are and with a part that all gears share (0 to 3 arcsec, added to what
the runs show, turned with each gear); on how many benches nothing stated is no certificate; and the transmission accuracy
of every gear before and after, each corrected by what the others teach: U, and how often it holds the truth, also by
bench. One gear more is mounted at 0, 30 and 150 degrees: the route of one gear, by `--one-gear` alone. `--contradictions`
(by itself) exchanges an encoder, lets a mark slip, states a wrong angle, gives one gear two names. What is made is not made again.
"""  # noqa: E501

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np

from experiments.truth import truth_of, truth_rows
from model.gear_file import shipped_gear
from model.identify.encoder_contradiction import contradiction
from model.identify.encoder_curve import LearntCurve, Mounted, learnt_curve
from model.motor import shipped_motor
from model.units import ARCMIN, ARCSEC, DEGREE, REVOLUTION
from rig.analysis.fit.recorded import store
from rig.analysis.fit.run import fit_run
from rig.analysis.learnt import PREFIX
from rig.analysis.learnt_encoder import assumed_seat, learn, observed, write_learnt
from rig.bench.backends.order import Order, Setup, WorldChoice
from rig.bench.backends.simulated import parts_of
from rig.gears.card import now_text
from rig.run.start import run_order
from rig.runfile.read import close_recording
from sim_backend.drawing import bench_encoder

GEARS, ORDERS, SHARED = 8, 8, (0.0, 1.0, 2.0, 3.0)
TURNS = (0.0, 30.0, 150.0)


def made(folder: Path, bench: int, population: str) -> tuple[list[Path], list[Path]]:
    """The runs of the eight gears of a bench, and those of one gear at three angles."""
    return made_several(folder, bench, population), made_alone(folder, bench, population)


def made_several(folder: Path, bench: int, population: str) -> list[Path]:
    """The runs of the eight gears of a bench."""
    several = [(100 * bench + n, 2, 45.0 * n) for n in range(GEARS)]
    return [made_run(folder / "several", bench, *one, population) for one in several]


def made_alone(folder: Path, bench: int, population: str) -> list[Path]:
    """The runs of one gear at three angles."""
    turned = [(100 * bench + GEARS, 2 + n, turn) for n, turn in enumerate(TURNS)]
    return [made_run(folder / "alone", bench, *one, population) for one in turned]


def made_run(folder: Path, bench: int, gear: int, mount: int, turn: float, population: str) -> Path:
    """One run, made and analysed where it is not there."""
    serial = f"G-{gear}-{mount}"
    there = sorted(folder.glob(f"*-kinematic_error-{serial.replace('-', '_')}.h5"))
    if there:
        return there[0]
    order = replace(_order(folder, bench, gear, mount, turn, population), serial=serial)
    path = run_order(order, ask=lambda prompt: "simulated").path
    fit = fit_run(path)
    store(fit, now_text())
    close_recording(fit.recording)
    return path


def _order(folder: Path, bench: int, gear: int, mount: int, turn: float, population: str) -> Order:
    """What is asked for one run."""
    world: dict[str, Any] = {"gear_seed": gear, "bench_seed": bench, "population": population}
    return Order(
        protocol="kinematic-error",
        gear=shipped_gear(),
        motor=shipped_motor(),
        folder=folder,
        serial="study",
        operator="study",
        seed=bench,
        sample_rate=250.0,
        world=WorldChoice(**world, mount=mount, mount_turn=turn * DEGREE),
    )


def truth_of_encoder(bench: int, population: str) -> np.ndarray:
    """Complex orders 1 to 8 of the encoder of a bench, over its own angle from its index mark [rad]."""
    parts = parts_of(_order(Path(), bench, 0, 1, 0.0, population), Setup())
    errors = bench_encoder(parts["imperfections"], "output", parts["world"])
    found = np.zeros(ORDERS, dtype=np.complex128)
    for one in errors.series:
        if one.order in range(1, ORDERS + 1):
            wave = complex(one.cosine, one.sine) * np.exp(-1j * one.order * errors.index_angle)
            found[int(one.order) - 1] += wave
    return found


def inside(curve: LearntCurve, true: np.ndarray) -> list[bool]:
    """Which orders lie inside U."""
    return [bool(abs(one.wave - true[one.order - 1]) <= one.radius) for one in curve.orders]


def with_shared(mounted: Sequence[Mounted], size: float, seed: int) -> Iterator[Mounted]:
    """What the runs would show if all gears shared a part of so many arcseconds in every order, turned with each."""
    phase = np.random.default_rng(seed).uniform(0.0, REVOLUTION, ORDERS)
    for one in mounted:
        assert one.angle is not None
        turned = np.arange(1, ORDERS + 1) * one.angle
        yield replace(one, waves=one.waves + size * ARCSEC * np.exp(1j * (phase + turned)))


def bench_result(folder: Path, bench: int, population: str) -> dict[str, Any]:
    """Everything that one bench says."""
    several, alone = made(folder, bench, population)
    true = truth_of_encoder(bench, population)
    learnt = learn(several)
    unstated = learnt_curve([replace(one, angle=None) for one in learnt.mounted])
    shared = {}
    for size in SHARED:
        curve = learnt_curve(list(with_shared(learnt.mounted, size, bench)))
        assert not isinstance(curve, str)
        shared[str(size)] = inside(curve, true)
    gears = _gears(folder / "several", several, learnt)
    return {
        "bench": bench,
        "error": [abs(one.wave - true[one.order - 1]) / ARCSEC for one in learnt.curve.orders],
        "radius": [one.radius / ARCSEC for one in learnt.curve.orders],
        "gears": [one.gears / ARCSEC for one in learnt.curve.orders],
        "inside": inside(learnt.curve, true),
        "shared": shared,
        "unstated": unstated if isinstance(unstated, str) else unstated.basis,
        "one_gear": by_one_gear(alone, true),
        "accuracy": gears,
    }


def by_one_gear(runs: Sequence[Path], true: np.ndarray) -> dict[str, Any] | str:
    """Error, U and whether it holds, of every order by one gear; why there is none."""
    seen = (observed(run).mounted for run in runs)
    turned = learnt_curve([replace(m, gear="one") for m in seen if m is not None], assumed_seat())
    if isinstance(turned, str):
        return turned
    return {
        "error": [abs(one.wave - true[one.order - 1]) / ARCSEC for one in turned.orders],
        "radius": [one.radius / ARCSEC for one in turned.orders],
        "inside": inside(turned, true),
    }


def _gears(folder: Path, runs: Sequence[Path], learnt: Any) -> list[dict[str, float]]:
    """Transmission accuracy of every gear, forward: value, U and truth [arcmin], before and after."""
    for file in folder.glob(f"{PREFIX}-{learnt.bench}-*"):
        file.unlink()
    found = [_accuracy(run) for run in runs]
    today = date(2026, 1, 1)
    write_learnt(learnt, folder / f"{PREFIX}-{learnt.bench}-study.csv", today, None)
    for one, run in zip(found, runs, strict=True):
        after = _accuracy(run)
        one |= {f"{name}_after": value for name, value in after.items() if name != "truth"}
    return found


def _accuracy(run: Path) -> dict[str, float]:
    name = "transmission_accuracy_forward"
    fit = fit_run(run)
    rows = truth_rows(fit.result, truth_of(fit.recording.metadata.process))
    close_recording(fit.recording)
    estimate = fit.result.estimates[name]
    truth = next(row.measurand for row in rows if row.estimate.name == name)
    return {
        "value": estimate.value / ARCMIN,
        "U": estimate.expanded_uncertainty / ARCMIN,
        "truth": truth / ARCMIN,
    }


def contradicted(mounted: Sequence[Mounted], other: Sequence[Mounted]) -> dict[str, list[Mounted]]:
    """The mountings of a bench as they would be if something were wrong; `other` are those of another bench."""
    orders = np.arange(1, ORDERS + 1)
    here, there = (
        np.array([order.wave for order in known(some).orders]) for some in (mounted, other)
    )
    slipped = np.exp(1j * orders * 20.0 * DEGREE)
    third, sixth = mounted[2], mounted[5]
    assert third.angle is not None
    assert sixth.angle is not None
    own = (third.waves - here) * np.exp(1j * orders * (sixth.angle - third.angle))
    again = sixth.waves - here - own
    noise = np.where(orders == 1, abs(again), 0.02 * ARCSEC) * np.exp(1j * np.angle(again))
    return {
        "as it is": list(mounted),
        "encoder exchanged after three": [
            replace(one, waves=one.waves + (there - here if k >= 3 else 0.0))
            for k, one in enumerate(mounted)
        ],
        "index mark slipped by 20 degrees after four": [
            replace(one, waves=one.waves * (slipped if k >= 4 else 1.0))
            for k, one in enumerate(mounted)
        ],
        "an angle wrong by 10 degrees": [
            replace(one, angle=(one.angle or 0.0) + (10.0 * DEGREE if k == 3 else 0.0))
            for k, one in enumerate(mounted)
        ],
        "two gears that are one": [
            replace(one, waves=here + own + noise) if k == 5 else one
            for k, one in enumerate(mounted)
        ],
    }


def known(mounted: Sequence[Mounted]) -> LearntCurve:
    """What the mountings of a bench teach; they are enough."""
    curve = learnt_curve(mounted)
    assert isinstance(curve, LearntCurve)
    return curve


def told_of_contradictions(folder: Path, benches: Sequence[int], population: str) -> str:
    """Of every wrong: on how many benches it is refused, and how much of what is not lies inside U."""
    seen = [
        [observed(run).mounted for run in made_several(folder / str(n), n, population)]
        for n in benches
    ]
    whole = [[one for one in some if one is not None] for some in seen]
    lines: list[str] = []
    cases: dict[str, list[tuple[bool, int]]] = {}
    for place, bench in enumerate(benches):
        true = truth_of_encoder(bench, population)
        for name, some in contradicted(whole[place], whole[place - 1]).items():
            refused = contradiction(some) is not None
            cases.setdefault(name, []).append((refused, sum(inside(known(some), true))))
    for name, found in cases.items():
        refused = sum(one for one, _ in found)
        kept = [hits for one, hits in found if not one]
        lines.append(
            f"{name}: refused {refused} of {len(found)}; of the others {sum(kept)} of {ORDERS * len(kept)} inside U"
        )
    return "\n".join(lines)


def told_of_both(folder: Path, benches: Sequence[int], population: str) -> str:
    """R.m.s. error of the orders 1 to 8 by eight gears, by one gear, and by both routes in one model."""
    routes: dict[str, list[list[float]]] = {"eight gears": [], "one gear": [], "both": []}
    for bench in benches:
        several, alone = made(folder / str(bench), bench, population)
        true = truth_of_encoder(bench, population)
        seat = assumed_seat()
        gears = [one for run in several if (one := observed(run).mounted) is not None]
        # A run is found again by a serial number of its own: of the one gear they are one.
        turned = [
            replace(one, gear="alone")
            for run in alone
            if (one := observed(run).mounted) is not None
        ]
        for name, some in (("eight gears", gears), ("one gear", turned), ("both", gears + turned)):
            curve = learnt_curve(some, seat)
            assert isinstance(curve, LearntCurve)
            errors = [abs(one.wave - true[one.order - 1]) / ARCSEC for one in curve.orders]
            routes[name].append(errors)
    rms = {name: np.sqrt((np.array(errors) ** 2).mean(axis=0)) for name, errors in routes.items()}
    better = np.minimum(rms["eight gears"], rms["one gear"])
    lines = [
        f"{name}: {', '.join(f'{v:.3f}' for v in found)} arcsec" for name, found in rms.items()
    ]
    lines.append(f"both over the better: {', '.join(f'{v:.2f}' for v in rms['both'] / better)}")
    return "\n".join(lines)


def told(results: Sequence[dict[str, Any]]) -> str:
    """What all benches say."""
    error = np.array([one["error"] for one in results])
    gears = np.array([one["gears"] for one in results])
    lines = [f"{len(results)} benches, {GEARS} gears each"]
    for place in range(4):
        rms = math.sqrt(float((error[:, place] ** 2).mean()))
        own = math.sqrt(2.0 * float((gears[:, place] ** 2).mean()) / GEARS)
        lines.append(f"order {place + 1}/N: r.m.s. error {rms:.3f} arcsec, sigma/sqrt(8) {own:.3f}")
    kept = [one["inside"] for one in results]
    lines.append(f"inside U: {np.sum(kept)} of {np.size(kept)}")
    for size in SHARED:
        these = [one["shared"][str(size)] for one in results]
        lines.append(f"  gears share {size:g} arcsec: {np.sum(these)} of {np.size(these)}")
    none = sum(one["unstated"] == "encoder and what the gears share" for one in results)
    lines.append(f"no stated angles, no certificate: {none} of {len(results)}")
    lines.append(told_of_one([one["one_gear"] for one in results]))
    rows = [one for result in results for one in result["accuracy"]]
    for after in ("", "_after"):
        hits = sum(abs(r[f"value{after}"] - r["truth"]) <= r[f"U{after}"] for r in rows)
        u = np.median([r[f"U{after}"] for r in rows])
        rms = math.sqrt(float(np.mean([(r[f"value{after}"] - r["truth"]) ** 2 for r in rows])))
        lines.append(
            f"transmission accuracy {'after' if after else 'before'}: U {u:.3f} arcmin, r.m.s. error {rms:.3f}, "
            f"inside {hits} of {len(rows)}"
        )
    ratio = np.median([r["U_after"] / r["U"] for r in rows])
    shares = [
        np.mean([abs(r["value_after"] - r["truth"]) <= r["U_after"] for r in one["accuracy"]])
        for one in results
    ]
    random = np.random.default_rng(0)
    means = [float(np.mean(random.choice(shares, len(shares)))) for _ in range(2000)]
    low, high = np.percentile(means, (2.5, 97.5))
    lines.append(
        f"U after over before: median {ratio:.2f}; inside, by bench {low:.3f} to {high:.3f}"
    )
    return "\n".join(lines)


def told_of_one(results: Sequence[dict[str, Any] | str]) -> str:
    """What all benches say by one gear each."""
    alone = [one for one in results if isinstance(one, dict)]
    errors = np.array([one["error"] for one in alone])
    kept = np.array([one["inside"] for one in alone])
    rms = np.sqrt((errors**2).mean(axis=0))
    return (
        f"one gear, three angles: r.m.s. error {', '.join(f'{v:.2f}' for v in rms)} arcsec; inside U {kept.sum()} of "
        f"{kept.size}, of 1/N {kept[:, 0].sum()} of {len(kept)}, whose U is "
        f"{np.median([one['radius'][0] for one in alone]):.1f} arcsec"
    )


def main() -> None:
    """Make what is missing, and tell."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--benches", type=int, default=20)
    parser.add_argument("--first", type=int, default=83000)
    parser.add_argument("--population", default="narrow")
    parser.add_argument("--one-gear", action="store_true", help="the route of one gear alone")
    parser.add_argument("--contradictions", action="store_true", help="what is wrong, and found")
    parser.add_argument("--both", action="store_true", help="both routes together")
    asked = parser.parse_args()
    benches = range(asked.first, asked.first + asked.benches)
    if asked.contradictions:
        print(told_of_contradictions(asked.folder, benches, asked.population))
        return
    if asked.both:
        print(told_of_both(asked.folder, benches, asked.population))
        return
    if asked.one_gear:
        seen = [made_alone(asked.folder / f"bench-{n}", n, asked.population) for n in benches]
        truths = [truth_of_encoder(n, asked.population) for n in benches]
        print(told_of_one([by_one_gear(*one) for one in zip(seen, truths, strict=True)]))
        return
    results = []
    for bench in benches:
        kept = asked.folder / f"bench-{bench}.json"
        if not kept.is_file():
            folder = asked.folder / f"bench-{bench}"
            result = bench_result(folder, bench, asked.population)
            kept.write_text(json.dumps(result), encoding="utf-8")
        results.append(json.loads(kept.read_text(encoding="utf-8")))
        print(f"bench {bench}", flush=True)
    print(told(results))


if __name__ == "__main__":
    main()
