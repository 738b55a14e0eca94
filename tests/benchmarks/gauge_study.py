"""What a learnt encoder does to a gauge: twenty studies of repeatability and reproducibility that nobody has seen.

    python -m tests.benchmarks.gauge_study FOLDER --studies 20 --first 85000

One study: three benches, each taught by eight gears of its own at spread angles (`encoder_study`), then eight other gears, each
mounted once on each bench and measured twice. %GRR of the transmission accuracy as the runs show it, with what each bench
learnt, and with an encoder that is known perfectly (its true orders 1 to 8). What is made is not made again.
"""  # noqa: E501

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np

from model.angle_certificate import curve_of
from rig.analysis.fit.run import fit_run
from rig.analysis.learnt import PREFIX
from rig.analysis.learnt_encoder import Learnt, learn, write_learnt
from rig.bench.config.certificate_file import CertificateFile, certificate_from, certificate_text
from rig.fleet.gauge.components import Values
from rig.fleet.gauge.study import gauges_of
from rig.runfile.read import close_recording
from rig.runfile.sealed import write_sealed
from tests.benchmarks.encoder_study import GEARS, made_run, truth_of_encoder

BENCHES, REPEATS, NAME = 3, 2, "transmission_accuracy_forward"
WAYS = ("shown", "learnt", "known")


def study(folder: Path, first: int) -> dict[str, Any]:
    """One study: %GRR by way."""
    values: dict[str, list[float]] = {way: [] for way in WAYS}
    gears: list[str] = []
    benches: list[str] = []
    for bench in range(first, first + BENCHES):
        taught = [
            made_run(folder / f"{bench}" / "taught", bench, 100 * bench + n, 2, 45.0 * n, "narrow")
            for n in range(GEARS)
        ]
        place = folder / f"{bench}" / "measured"
        runs = measured(place, bench, first)
        learnt = learn(taught)
        for way in WAYS:
            put(place, way, learnt, bench)
            values[way] += [value_of(run) for run in runs]
        gears += [f"gear {n // REPEATS}" for n in range(GEARS * REPEATS)]
        benches += [str(bench)] * (GEARS * REPEATS)
    told: dict[str, Any] = {"study": first}
    for way in WAYS:
        mountings = [f"{gear} on {bench}" for gear, bench in zip(gears, benches, strict=True)]
        gauge, _ = gauges_of(
            Values(gear=gears, bench=benches, mounting=mountings, value=values[way])
        )
        told[way] = gauge.percent_of_study
    return told


def measured(folder: Path, bench: int, first: int) -> list[Path]:
    """Eight other gears on a bench, each mounted once at an angle that nobody chose and measured twice."""
    runs: list[Path] = []
    for gear in range(GEARS):
        for repeat in range(REPEATS):
            place = folder / f"repeat-{repeat}"
            turn = float(np.random.default_rng((bench, gear)).uniform(0.0, 360.0))
            runs.append(
                made_run(place, bench, 1000 * first + gear, 10 + bench - first, turn, "narrow")
            )
    return runs


def put(folder: Path, way: str, learnt: Learnt, bench: int) -> None:
    """Lay what this way takes of the encoder beside the runs."""
    for old in folder.glob(f"{PREFIX}*"):
        old.unlink()
    path = folder / f"{PREFIX}-{bench}.csv"
    if way == "learnt":
        write_learnt(learnt, path, date(2026, 1, 1), None)
    if way == "known":
        text = learnt.certificate(date(2026, 1, 1), None)
        file: CertificateFile = certificate_from("known", text.encode())
        waves = truth_of_encoder(bench, "narrow")
        curve = curve_of(np.column_stack([waves.real, waves.imag]), 1e-9)
        header = replace_header(file)
        write_sealed(path, certificate_text(header, curve).encode())


def replace_header(file: CertificateFile) -> Any:
    """The same header, of no gear."""
    return file.header.model_copy(update={"without": {}})


def value_of(run: Path) -> float:
    """The transmission accuracy of a run."""
    fit = fit_run(run)
    close_recording(fit.recording)
    return fit.result.estimates[NAME].value


def told_of(found: Sequence[dict[str, Any]]) -> str:
    """What all studies say."""
    median = {way: float(np.median([one[way] for one in found])) for way in WAYS}
    apart = float(np.median([one["learnt"] - one["known"] for one in found]))
    return (
        f"{len(found)} studies: median %GRR {median}; learnt less known, median {apart:.2f} points"
    )


def main() -> None:
    """Make what is not there, and tell."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--studies", type=int, default=20)
    parser.add_argument("--first", type=int, required=True)
    given = parser.parse_args()
    found: list[dict[str, Any]] = []
    for number in range(given.studies):
        first = given.first + BENCHES * number
        found.append(study(given.folder / str(first), first))
        print(json.dumps(found[-1]), flush=True)
    print(told_of(found))


if __name__ == "__main__":
    main()
