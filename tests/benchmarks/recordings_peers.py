"""The analyses of recordings beside what a laboratory would write with numpy, scipy and statsmodels.

    python -m tests.benchmarks.recordings_peers --first-seed 9721 --recordings 12 --json

The same recordings for everybody: published ones (the excerpts in tests/data; with the whole
collection beside the project the EMPS as well) and synthetic ones of the two studies, whose truth
is known. Peers of a motion: a Butterworth filter both ways, `numpy.gradient` and least squares, over
all rows or over those above 2 % of the top speed, and Huber's M-estimate of statsmodels where it is
installed. Of a friction table: a Stribeck curve by `scipy.optimize.curve_fit`, with a robust loss
too. Of orders: a plain transform over an even grid of angle.

Prints per group and method how many numbers it gave, the median and the 90 % quantile of their
errors against the published figure or the truth with the bench's own torque scale, and the processor
time per recording. Ours is counted where it says "yes", and a peer on everything it gives; "on these" is a
peer's error where ours says "yes". `--json` prints every number as a line before the table.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
import warnings
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np
import scipy

from experiments import catalogue
from experiments.contract import Evidence
from experiments.errors import AnalysisError
from experiments.recording import Recording
from model.gear_file import shipped_gear
from tests.benchmarks import orders_study, recordings_cases
from tests.experiments.recordings.test_friction_curve import table
from tests.experiments.recordings.test_recorded_elsewhere import DATA, HERE, columns
from tests.experiments.test_analyses_without_plan import foreign

MOVING = 0.02
"""Of the top speed, below which a laboratory leaves rows out."""
SYNTHETIC_CUTOFF = 10.0
"""Hz, of the peers' filter on synthetic joints: above all their motion."""
Found = dict[str, float]
Line = dict[str, Any]
T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class Shared:
    """A recording for everybody: what is true of it by quantity, and the cut-off [Hz] of the peers."""

    group: str
    name: str
    kind: str
    recording: Recording
    truth: Found
    settings: dict[str, Any] = field(default_factory=dict)
    cutoff: float = SYNTHETIC_CUTOFF
    effort: str = "torque"


def published() -> Iterable[Shared]:
    """Recordings with published figures."""
    angle, torque = columns(HERE / "staubli_tx40" / "joint_1.csv")
    yield Shared(
        group="motion, published",
        name="staubli joint 1",
        kind="motion",
        recording=foreign(
            1e-3 * np.arange(len(angle)),
            position=(angle / 32.0, "rad"),
            torque=(32.0 * torque, "N m"),
        ),
        truth={"viscous": 8.0278, "coulomb": 7.2318},
        cutoff=25.0,
    )
    clock, place, current = columns(HERE / "tiago_arm" / "arm_1.csv")
    yield Shared(
        group="motion, published",
        name="tiago arm 1",
        kind="motion",
        recording=foreign(clock, position=(place, "rad"), current=(current, "A")),
        truth={"coulomb": 0.144, "viscous": 2.2},
        cutoff=5.0,
        effort="current",
    )
    if (DATA / "emps").is_dir():
        emps = scipy.io.loadmat(DATA / "emps" / "DATA_EMPS.mat")
        force = emps["gtau"].item() * emps["vir"].ravel()
        yield Shared(
            group="motion, published",
            name="emps",
            kind="motion",
            recording=foreign(
                emps["t"].ravel(), position=(emps["qm"].ravel(), "m"), force=(force, "N")
            ),
            truth={"inertia": 95.1089, "viscous": 203.5034, "coulomb": 20.3935},
            cutoff=100.0,
            effort="force",
        )
    _, speed, normal, force = columns(HERE / "stribeck_pairs" / "test_data_1.csv")
    yield Shared(
        group="friction table, published",
        name="stribeck pairs",
        kind="friction-curve",
        recording=table(speed, force / normal),
        truth={"coulomb": 0.15, "static": 0.25, "stribeck_velocity": 0.25},
    )


def synthetic(seed: int) -> Shared:
    """The recording of a seed of the study of joints and tables."""
    random = np.random.default_rng(seed)
    is_table = seed % 4 == 0
    case = recordings_cases.friction_table(random) if is_table else recordings_cases.joint(random)
    names = ("inertia", "viscous", "coulomb", "static", "stribeck_velocity")
    return Shared(
        group="friction table, synthetic" if is_table else "motion, synthetic",
        name=f"seed {seed}",
        kind=case.kind,
        recording=case.recording,
        truth={
            name: case.seen.get(name, value) for name, value in case.truth.items() if name in names
        },
        settings=case.settings,
    )


def ours(case: Shared) -> tuple[Found, Found]:
    """What the project says, everything and what it calls identified; nothing where it refuses."""
    analyse = catalogue.load(case.kind).analyse
    try:
        result = analyse(case.recording, Evidence(shipped_gear(), settings=case.settings))
    except AnalysisError:
        return {}, {}
    said = {name: e.value for name, e in result.estimates.items()}
    yes = {name for name, e in result.estimates.items() if e.identifiable == "yes"}
    return said, {name: value for name, value in said.items() if name in yes}


def _design(case: Shared, moving: float) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Filtered regressors (n, p), effort (n,) and their names, rows slower than `moving` left out."""
    clock = case.recording.time()
    even = np.linspace(clock[0], clock[-1], len(clock))
    period = even[1] - even[0]
    edge = min(2.0 * case.cutoff * period, 0.8)
    coefficients = scipy.signal.butter(4, edge)
    place, effort = (
        scipy.signal.filtfilt(*coefficients, np.interp(even, clock, case.recording.si(name)))
        for name in ("position", case.effort)
    )
    speed = np.gradient(place, period)
    regressors = {
        "inertia": np.gradient(speed, period),
        "viscous": speed,
        "coulomb": np.sign(speed),
        "offset": np.ones_like(speed),
    }
    if case.settings.get("load") == "gravity":
        regressors |= {"sine": np.sin(place), "cosine": np.cos(place)}
    rows = np.abs(speed) >= moving * np.quantile(np.abs(speed), 0.99)
    return np.stack(list(regressors.values()), axis=1)[rows], effort[rows], list(regressors)


def least_squares(case: Shared, moving: float) -> Found:
    """Ordinary least squares."""
    design, effort, names = _design(case, moving)
    return dict(zip(names, np.linalg.lstsq(design, effort, rcond=None)[0].tolist(), strict=True))


def huber(case: Shared) -> Found:
    """Huber's M-estimate of statsmodels over the rows that move."""
    import statsmodels.api as sm  # type: ignore[import-not-found]

    design, effort, names = _design(case, MOVING)
    found = sm.RLM(effort, design, M=sm.robust.norms.HuberT()).fit()
    return dict(zip(names, found.params.tolist(), strict=True))


def stribeck(case: Shared, loss: str) -> Found:
    """A Stribeck curve through all points of a table that are not at rest."""
    speed, effort = (case.recording.si(name) for name in ("speed", "torque"))
    speed, effort = speed[speed != 0.0], effort[speed != 0.0]
    top, size = float(np.abs(speed).max()), float(np.median(np.abs(effort)))

    def curve(
        v: np.ndarray, fc: float, fs: float, vs: float, shape: float, fv: float, f0: float
    ) -> np.ndarray:
        v = np.abs(v)
        bend = (fs - fc) * np.exp(-((v / abs(vs)) ** shape))
        return np.sign(speed) * (fc + bend + fv * v) + f0

    start = (size, 1.5 * size, 0.1 * top, 1.0, 0.1 * size / top, 0.0)
    robust = {} if loss == "linear" else {"loss": loss, "f_scale": 0.02 * size}
    try:
        found, _ = scipy.optimize.curve_fit(
            curve,
            speed,
            effort,
            start,
            method="trf",
            max_nfev=5000,
            x_scale=np.abs(start) + 1e-3 * size,
            **robust,
        )
    except (RuntimeError, ValueError):
        return {}
    names = ("coulomb", "static", "stribeck_velocity", "shape", "viscous", "offset")
    return dict(zip(names, found.tolist(), strict=True))


def peers_of(kind: str) -> dict[str, Callable[[Shared], Found]]:
    """The peers by name; statsmodels only where it is installed."""
    if kind == "friction-curve":
        return {
            "curve_fit": lambda case: stribeck(case, "linear"),
            "curve_fit, soft_l1": lambda case: stribeck(case, "soft_l1"),
        }
    peers: dict[str, Callable[[Shared], Found]] = {
        "lstsq, all rows": lambda case: least_squares(case, 0.0),
        "lstsq, moving rows": lambda case: least_squares(case, MOVING),
    }
    try:
        import statsmodels.api  # type: ignore[import-not-found]  # noqa: F401
    except ImportError:
        return peers
    return peers | {"statsmodels RLM": huber}


def timed(work: Callable[[], T]) -> tuple[T, float]:
    """What work gives, and its processor time [s]."""
    start = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = work()
    return found, time.process_time() - start


def compared(case: Shared) -> list[Line]:
    """A line per quantity and method."""
    (_, yes), seconds = timed(lambda: ours(case))
    found = {"ours": (yes, seconds)}
    for name, peer in peers_of(case.kind).items():
        found[name] = timed(lambda peer=peer: peer(case))
    return [
        {
            "group": case.group,
            "recording": case.name,
            "quantity": quantity,
            "method": method,
            "truth": truth,
            "value": values.get(quantity),
            "answered_by_ours": quantity in yes,
            "seconds": spent,
        }
        for quantity, truth in case.truth.items()
        for method, (values, spent) in found.items()
    ]


def order_lines(seed: int) -> list[Line]:
    """Amplitudes of one recording of the study of orders, ours and a plain transform's."""
    lines = orders_study.run_seed(seed)
    whole = next(line for line in lines if line["what"] == "recording")
    if whole["outcome"] == "refused":
        return []
    truths = orders_study.made(seed)
    made: list[Line] = []
    for line in (line for line in lines if line["what"] == "order"):
        yes = line["answered"] == "yes"
        given = {
            "ours": (line["value"] / truths.scale if yes else None, whole["seconds"]),
            "plain transform": (
                line["peer"] if math.isfinite(line["peer"]) else None,
                whole["peer_seconds"],
            ),
        }
        made += [
            {
                "group": "orders, synthetic",
                "recording": f"seed {seed}",
                "quantity": f"order {line['order']:.4g}",
                "method": method,
                "truth": line["truth"],
                "value": value,
                "answered_by_ours": yes,
                "seconds": spent,
            }
            for method, (value, spent) in given.items()
        ]
    return made


def summary(lines: list[Line]) -> str:
    """Numbers given, errors and time per group and method."""
    text = [
        f"{'group':27s}{'method':22s}{'given':>8s}{'median %':>10s}{'90 % below %':>14s}"
        f"{'on these: median, 90 % below %':>33s}{'s':>9s}"
    ]
    for group, method in dict.fromkeys((line["group"], line["method"]) for line in lines):
        own = [line for line in lines if (line["group"], line["method"]) == (group, method)]
        given = [line for line in own if line["value"] is not None]
        spent = {line["recording"]: line["seconds"] for line in own}
        common = [line for line in given if line["answered_by_ours"]]
        first, second = (
            np.quantile(error, [0.5, 0.9]) if len(error := _errors(part)) else (math.nan, math.nan)
            for part in (given, common)
        )
        text.append(
            f"{group:27s}{method:22s}{len(given):4d}/{len(own):<3d}{first[0]:10.2f}{first[1]:14.2f}"
            f"{second[0]:22.2f}{second[1]:11.2f}{np.mean(list(spent.values())):9.3f}"
        )
    return "\n".join(text)


def _errors(lines: list[Line]) -> np.ndarray:
    """Magnitudes of the errors in per cent."""
    return np.array([100.0 * abs(line["value"] / line["truth"] - 1.0) for line in lines])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--first-seed", type=int, default=9721)
    parser.add_argument("--recordings", type=int, default=12, help="synthetic ones of each study")
    parser.add_argument("--json", action="store_true", help="every number as a line of JSON")
    chosen = parser.parse_args()
    seeds = range(chosen.first_seed, chosen.first_seed + chosen.recordings)
    cases = [*published(), *(synthetic(seed) for seed in seeds)]
    for case in (cases[0], next(c for c in cases if c.kind == "friction-curve")):
        compared(case)  # Whatever is compiled or imported at first use is nobody's time.
    lines = [line for case in cases for line in compared(case)]
    orders_study.run_seed(chosen.first_seed)
    for seed in seeds:
        lines += order_lines(seed)
    if chosen.json:
        for line in lines:
            print(json.dumps(line))
    print(summary(lines), file=sys.stderr)


if __name__ == "__main__":
    main()
