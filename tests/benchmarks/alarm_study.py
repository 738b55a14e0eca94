"""How often an alarm is false, and how soon a change is found: by drawn series, and through the whole chain.

    python -m tests.benchmarks.alarm_study drawn --seed 33000
    python -m tests.benchmarks.alarm_study sizes --seed 33601
    python -m tests.benchmarks.alarm_study chain --first-seed 33100 --gears 20
    python -m tests.benchmarks.alarm_study chain --first-seed 33200 --gears 20 --hours 100 --runs 21
    python -m tests.benchmarks.alarm_study chain --first-seed 33500 --gears 20 --runs 20 --protocols velocity-steps
    python -m tests.benchmarks.alarm_study chain --first-seed 33540 --hours 100 --runs 21 \\
        --protocols velocity-steps

`drawn`: 2000 series each of a gear that does not change, whose days are independent or resemble the day before, by
both tables of thresholds; then a step of two standard deviations, right after the baseline and ten runs later, and the
same with a bench and a mounting that change. `sizes`: how often the interval of an alarm's size holds the true step,
whose beginning the data chose, with thresholds for days that are alike.

`chain`: gears of the simulated world, each measured on a day of its own, run by run, every run recorded, fitted and
read by the passport; with --hours each run that many hours older than the one before. Two of the three watched
quantities by default, of a short friction run and a kinematic error; velocity steps, of two speeds here, take as long
as both. A worn gear's limit is what its order 2 truly is at run 21.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rig.analysis.alarm.noted import NotedRun
from rig.analysis.alarm.promise import Promise, Watching
from rig.analysis.alarm.scores import scores_of
from rig.analysis.alarm.sums import sums_of
from rig.analysis.alarm.threshold import Days, alike_days, threshold_of
from rig.analysis.alarm.watching import WatchedSeries, watch
from rig.analysis.passport.content import Alarm

SERIES, OVER = 2000, 20
CREATED = "2026-01-01T00:00:00+00:00"
PROTOCOLS: Mapping[str, Mapping[str, Any]] = {
    "kinematic-error": {},
    "friction": {"speeds_rpm": (300.0, 600.0, 1000.0, 1600.0, 2400.0), "up_and_down": False},
    "velocity-steps": {"speeds_rpm": (600.0, 1200.0), "repeats": 1},
}
"""Short forms of the protocols that have a watched quantity."""
LIMIT_RUN = 21
"""The run at which a worn gear's order 2 truly meets its limit."""
DAYS: tuple[Days, ...] = ("independent", "alike")


def crossings(
    baseline: int,
    correlation: float,
    threshold: float,
    generator: np.random.Generator,
    *,
    step: float = 0.0,
    late: int = 0,
    is_moved: bool = False,
) -> np.ndarray:
    """The run after the change at which each series crosses; infinite where it does not."""
    runs = baseline + OVER
    values = alike_days(SERIES, runs, correlation, generator)
    values[:, baseline + late :] += step
    warmth = generator.normal(size=(SERIES, runs))
    parts = [np.ones_like(warmth), warmth]
    begins: tuple[int, ...] = ()
    if is_moved:
        begins = (baseline // 2,)
        parts.append(np.broadcast_to(np.arange(runs) >= begins[0], warmth.shape).astype(float))
        parts.append((generator.random(size=(1, runs)) < 0.5) * np.ones_like(warmth))
    sums = sums_of(scores_of(values, np.stack(parts, axis=2)).normal, baseline, begins)
    over = np.maximum(sums.upper, sums.lower)[:, baseline + late :] > threshold
    return np.where(over.any(axis=1), np.argmax(over, axis=1) + 1.0, np.inf)


def drawn(seed: int) -> None:
    """Print what drawn series show."""
    generator = np.random.default_rng(seed)
    for days in DAYS:
        for baseline in (10, 20):
            for count in (1, 2, 3):
                threshold = threshold_of(Promise(baseline=baseline), count, days)
                told = [f"table {days}, baseline {baseline}, {count} quantities:"]
                for correlation in (0.0, 0.2, 0.3):
                    told.append(
                        f"r {correlation}: {_flagged(baseline, correlation, threshold, count, generator)}"
                    )
                moved = _flagged(baseline, 0.0, threshold, count, generator, is_moved=True)
                told.append(f"moved: {moved}")
                for late in (0, 10):
                    found = crossings(baseline, 0.0, threshold, generator, step=2.0, late=late)
                    share, middle = 100.0 * np.isfinite(found).mean(), np.median(found)
                    told.append(f"step {late} runs later: {share:.1f} %, median {middle:g}")
                print("; ".join(told), flush=True)


def sizes(seed: int) -> None:
    """Print how often the interval of a size holds the step, of series of which an alarm was told."""
    generator = np.random.default_rng(seed)
    for correlation in (0.0, 0.3):
        for step in (2.0, 4.0):
            for late in (0, 10):
                changes = [
                    found.change
                    for values in alike_days(SERIES // 4, 10 + OVER, correlation, generator)
                    if (found := _watched(values, 10 + late, step, generator)).change is not None
                ]
                held = [c.size.low <= step <= c.size.high for c in changes]
                near = [abs(c.since - 10 - late) <= 1 for c in changes]
                excess = np.mean([c.size.value for c in changes]) - step
                print(
                    f"r {correlation}, step {step:g}, {late} runs later: {len(changes)} of {SERIES // 4} told, size "
                    f"holds {100.0 * np.mean(held):.1f} %, since within one run {100.0 * np.mean(near):.0f} %, "
                    f"mean excess {excess:+.2f}",
                    flush=True,
                )


def _watched(
    values: np.ndarray, since: int, step: float, generator: np.random.Generator
) -> WatchedSeries:
    """A series with a step, at runs of different warmth."""
    stepped = values + step * (np.arange(len(values)) >= since)
    warmth = 20.0 + generator.normal(size=len(values))
    runs = [NotedRun(temperature=float(one)) for one in warmth]
    return watch(stepped.tolist(), runs, Promise(), 1, "alike")


def _flagged(
    baseline: int,
    correlation: float,
    threshold: float,
    count: int,
    generator: np.random.Generator,
    *,
    is_moved: bool = False,
) -> str:
    """Share of gears of so many independent quantities of which one crosses."""
    each = [
        np.isfinite(crossings(baseline, correlation, threshold, generator, is_moved=is_moved))
        for _ in range(count)
    ]
    return f"{100.0 * np.any(each, axis=0).mean():.1f} %"


def chain(first: int, gears: int, hours: float, runs: int, protocols: Sequence[str]) -> None:
    """Print what becomes of gears that are measured day by day."""
    flagged, in_time = [], []
    for seed in range(first, first + gears):
        alarms = _life(seed, hours, runs, protocols)
        words = "; ".join(
            f"{one.quantity} {one.direction} since {one.since[:5]}, told at {one.run[:5]}, "
            f"{one.size_in_scatters:+.1f} scatters, {one.per_run[0]:+.3f} a run"
            for one in alarms
        )
        print(f"gear {seed}: {words or 'no change seen'}", flush=True)
        if alarms:
            flagged.append(seed)
        if any(_place(one, len(protocols)) <= LIMIT_RUN for one in alarms):
            in_time.append(seed)
    print(f"{len(flagged)} of {gears} flagged: {flagged}; by run {LIMIT_RUN}: {len(in_time)}")


def _place(alarm: Alarm, protocols: int) -> int:
    """Which run of its series told an alarm: the protocols take turns."""
    return (int(alarm.run[:5]) - 1) // protocols + 1


def _life(seed: int, hours: float, runs: int, protocols: Sequence[str]) -> tuple[Alarm, ...]:
    """The alarms of one gear after all its runs."""
    from rig.analysis.fit.digest import digest
    from rig.analysis.passport.build import passport
    from rig.api.executing import execute

    serial = f"G{seed}"
    with tempfile.TemporaryDirectory() as folder:
        for run in range(1, runs + 1):
            world = {
                "gear_seed": seed,
                "bench_seed": seed + 10_000,
                "day": run,
                "hours": hours * (run - 1),
            }
            for protocol in protocols:
                made = execute(
                    protocol,
                    serial=serial,
                    folder=folder,
                    seed=seed,
                    world=world,
                    **PROTOCOLS[protocol],
                )
                digest(Path(str(made.path)), CREATED)
        return passport(folder, serial, watching=Watching()).alarms


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("drawn", "sizes", "chain"))
    parser.add_argument("--seed", type=int, default=33000)
    parser.add_argument("--first-seed", type=int, default=33100)
    parser.add_argument("--gears", type=int, default=20)
    parser.add_argument("--hours", type=float, default=0.0)
    parser.add_argument("--runs", type=int, default=30)
    parser.add_argument("--protocols", default="kinematic-error,friction")
    said = parser.parse_args()
    if said.what == "drawn":
        drawn(said.seed)
    elif said.what == "sizes":
        sizes(said.seed)
    else:
        chain(said.first_seed, said.gears, said.hours, said.runs, said.protocols.split(","))


if __name__ == "__main__":
    main()
