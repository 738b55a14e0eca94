"""A simulated production: gears, measured on benches, day by day, by the same engine that runs one; with its truth.

    DIR/bench-01/day-001/00001-motor_tare-bench_01.h5      the tare of the day, where a protocol takes one
                         00002-home-G_00001.h5 ...         every gear of the day, protocol by protocol
    DIR/truth.parquet                                      what each rig was made of, a row per run and number

One day of one bench is one piece of work and has its name once it is whole. What is made is not made again: a day that
was cut off goes on behind its last run. Gears go to the benches in turn; in a study of the gauge each goes to each of
them, is mounted anew there, and measured several times on different days. Everything follows from the seed and the
calendar of the order: the same order makes the same runs, whoever makes them and in which order.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, date, datetime, timedelta
from datetime import time as clock_time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from experiments import catalogue
from model.errors import WordedError
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from model.units import REVOLUTION
from rig.analysis.tare import takes_tare, tare_kind
from rig.bench.backends.order import Order, WorldChoice
from rig.errors import ConfigurationError
from rig.fleet.day_journal import DayJournal, DayRun, runs_made
from rig.fleet.engine import BatchTask, Workforce, at_work
from rig.fleet.neighbours import digest
from rig.fleet.progress import Progress
from rig.fleet.questions import TRUTH_NAME
from rig.fleet.truth import gather_truth, keep_truth
from rig.program import version as program_version
from rig.run.latch import TripLatch
from rig.run.start import run_order

if TYPE_CHECKING:
    from rig.run.parts import RunReport

OPERATOR = "rig fleet simulate"
_MAKING = ".making"
"""Where a day is made before it has its name."""
_FIRST_HOUR = clock_time(8, 0, tzinfo=UTC)
_BETWEEN_RUNS = 60.0
"""s from the end of one run to the start of the next."""
_SEEDS_PER_ORDER = 1_000_000
"""Gears and benches of one seed: those of the next have other numbers."""


@dataclass(frozen=True, kw_only=True)
class Production:
    """What is asked for: so many gears on so many benches, by these protocols, `per_day` gears a day on each bench.

    `values` are parameters by protocol, beside those of its protocol's short form where it is `short`. `crossed`: every
    gear goes to every bench, in `mountings` of its own, in each of which it is measured `repeats` times. `spread`: each
    gear stands at a stated angle of its own, spread over the turn.
    """

    folder: Path
    gears: int
    benches: int = 1
    protocols: tuple[str, ...] = ("home", "friction")
    population: str = "narrow"
    seed: int = 0
    per_day: int = 20
    crossed: bool = False
    mountings: int = 1
    repeats: int = 1
    spread: bool = False
    first_day: date = date(2026, 1, 5)
    sample_rate: float = 250.0
    short: bool = False
    values: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("gears", "benches", "per_day", "mountings", "repeats"):
            value = getattr(self, name)
            if not 1 <= value < _SEEDS_PER_ORDER:
                raise ConfigurationError(
                    "is no production",
                    where=f"--{name.replace('_', '-')}",
                    value=value,
                    limit=f"1 to {_SEEDS_PER_ORDER - 1}",
                )
        for protocol in (*self.protocols, *self.values):
            if not catalogue.entry(protocol).has_plan:
                raise ConfigurationError(
                    "makes no run", where="--protocols", value=protocol, limit="a protocol"
                )

    def parameters(self, protocol: str) -> dict[str, Any]:
        """The values with which a protocol is run."""
        short = catalogue.load(protocol).short if self.short else {}
        return {**short, **self.values.get(protocol, {})}


class _Mounted(NamedTuple):
    """A gear as it is mounted when it is measured."""

    gear: int
    mount: int = 1


@dataclass(frozen=True)
class _BenchDay:
    """One day of one bench: which gears it measures, in which of their mountings."""

    bench: int
    day: int
    gears: tuple[_Mounted, ...]
    kind: str = "day"

    @property
    def name(self) -> str:
        """Its folder, as seen from that of the production."""
        return f"bench-{self.bench:02d}/day-{self.day:03d}"


@dataclass(frozen=True, kw_only=True)
class Made:
    """What came of some days: runs that were brought to their end, and those that were not, each with its reason.

    `kept` runs were brought to theirs before, when the day was cut off.
    """

    runs: int = 0
    kept: int = 0
    failed: tuple[tuple[str, str], ...] = ()
    seconds: float = 0.0


@dataclass(frozen=True, kw_only=True)
class _ProductionReport:
    """What a production made; `reused` runs were there already."""

    output: Path
    runs: int
    made: int
    reused: int
    failed: tuple[tuple[str, str], ...]

    def as_json(self) -> dict[str, Any]:
        """The object that `rig fleet simulate --json` prints."""
        return {
            "runs": self.runs,
            "made": self.made,
            "reused": self.reused,
            "failed": [{"run": run, "reason": reason} for run, reason in self.failed],
            "output": str(self.output),
            "truth": str(self.output / TRUTH_NAME),
        }


def days_of(production: Production) -> list[_BenchDay]:
    """The days of all benches: gear 1 to bench 1, gear 2 to bench 2, and so on in turn; crossed, all to each."""
    days = []
    for bench in range(1, production.benches + 1):
        measured = list(_measured_on(production, bench))
        for day, first in enumerate(range(0, len(measured), production.per_day), 1):
            days.append(_BenchDay(bench, day, tuple(measured[first : first + production.per_day])))
    return sorted(days, key=lambda one: (one.day, one.bench))


def _measured_on(production: Production, bench: int) -> Iterator[_Mounted]:
    """What a bench measures, in its order: all gears in their first mounting, again as often, then in the next."""
    gears = range(bench, production.gears + 1, production.benches)
    if production.crossed:
        gears = range(1, production.gears + 1)
    for mount in range(1, production.mountings + 1):
        for _ in range(production.repeats):
            yield from (_Mounted(gear, mount) for gear in gears)


def simulate_fleet(
    production: Production,
    crew: Workforce = Workforce(),
    *,
    on_progress: Callable[[Progress], None] = lambda progress: None,
    now: Callable[[], float] = time.monotonic,
) -> _ProductionReport:
    """Make the days that are not made yet, and gather their truth. The workers must see the same folder.

    Raises `ConfigurationError` for a production that cannot be, `RigError` where nothing can be written.
    """
    began = now()
    days = days_of(production)
    there = [day for day in days if (production.folder / day.name).is_dir()]
    wanted = [day for day in days if day not in set(there)]
    each = {day: len(list(_runs_of(production, day))) for day in days}
    reused = sum(each[day] for day in there)
    made, failed = 0, []

    def tell() -> None:
        done = reused + made + len(failed)
        on_progress(
            Progress(
                runs=sum(each.values()),
                done=done,
                reused=reused,
                failed=len(failed),
                seconds=now() - began,
            )
        )

    production.folder.mkdir(parents=True, exist_ok=True)
    tell()
    errand = BatchTask(partial(make_days, production), _lost)
    with at_work(crew) as hands:
        for _, outcome in hands.outcomes(errand, wanted):
            made += outcome.runs
            reused += outcome.kept
            failed += outcome.failed
            tell()
    if all((production.folder / day.name).is_dir() for day in days):
        shutil.rmtree(production.folder / _MAKING, ignore_errors=True)
    gather_truth(production.folder, [production.folder / day.name for day in days])
    return _ProductionReport(
        output=production.folder,
        runs=sum(each.values()),
        made=made,
        reused=reused,
        failed=tuple(sorted(failed)),
    )


def make_days(production: Production, days: Sequence[_BenchDay]) -> Made:
    """Some days of benches, one after the other."""
    began = time.perf_counter()
    made = [_make_day(production, day) for day in days]
    return Made(
        runs=sum(one.runs for one in made),
        kept=sum(one.kept for one in made),
        failed=tuple(failure for one in made for failure in one.failed),
        seconds=time.perf_counter() - began,
    )


def _lost(day: _BenchDay, reason: str) -> Made:
    return Made(failed=((day.name, reason),))


def _runs_of(production: Production, day: _BenchDay) -> Iterator[tuple[str, str, _Mounted]]:
    """Protocol, serial number and gear of every run of a day, in its order."""
    if tare_kind() not in production.protocols and any(map(takes_tare, production.protocols)):
        yield tare_kind(), f"bench-{day.bench:02d}", _Mounted(0)
    for one in day.gears:
        for protocol in production.protocols:
            yield protocol, f"G-{one.gear:05d}", one


def _make_day(production: Production, day: _BenchDay) -> Made:
    """One day, from where it was cut off if it was."""
    from filelock import FileLock

    making, final = production.folder / _MAKING / day.name, production.folder / day.name
    making.parent.mkdir(parents=True, exist_ok=True)
    # A worker of a client that is gone may still be at it.
    with FileLock(f"{making}.lock"):
        if final.is_dir():
            return _day_result(day, before=runs_made(final), runs=())
        journal = DayJournal(making, _order_of(production, day))
        before = journal.resume()
        runs = list(before)
        moment = datetime.combine(production.first_day, _FIRST_HOUR) + timedelta(days=day.day - 1)
        for place, turned in enumerate(_runs_of(production, day)):
            if place >= len(before):
                order = _request(production, day, making=making, moment=moment, turned=turned)
                runs.append(_make_run(order, moment))
                journal.add(runs[-1])
            moment += timedelta(seconds=runs[place].seconds)
        keep_truth(making, day.name)
        final.parent.mkdir(parents=True, exist_ok=True)
        making.rename(final)
    return _day_result(day, before=before, runs=runs[len(before) :])


def _day_result(day: _BenchDay, *, before: Sequence[DayRun], runs: Sequence[DayRun]) -> Made:
    """What came of a day, of which some runs were made before."""
    failed = [(f"{day.name}/{run.name}", run.reason) for run in (*before, *runs) if run.reason]
    kept, made = (sum(not run.reason for run in part) for part in (before, runs))
    return Made(runs=made, kept=kept, failed=tuple(failed))


def _order_of(production: Production, day: _BenchDay) -> str:
    """A hash of all that decides on the runs of a day."""
    asked = [
        *(production.population, production.seed, production.sample_rate),
        production.first_day.isoformat(),
        [(name, production.parameters(name)) for name in production.protocols],
        production.parameters(tare_kind()),
        *(day.bench, day.day, day.gears),
        [_turn_of(production, one) for one in day.gears],
        program_version(),
    ]
    return digest(asked)


def _make_run(order: Order, moment: datetime) -> DayRun:
    """One run, which begins at a moment of the bench's calendar; a trip is acknowledged after it."""
    name = f"{order.serial} {order.protocol}"
    try:
        report = run_order(order, ask=lambda prompt: "simulated")
    except WordedError as error:
        return DayRun(name=name, reason=str(error))
    seconds = report.rows / order.sample_rate + _BETWEEN_RUNS
    reason = "" if report.outcome == "COMPLETED" else f"{report.outcome}: {report.message}"
    if reason:
        _acknowledge(report, order.folder, moment + timedelta(seconds=seconds))
    return DayRun(name=name, file=report.path.name, seconds=seconds, reason=reason)


def _acknowledge(report: RunReport, folder: Path, moment: datetime) -> None:
    """A bench of a simulated production goes on after a trip, by the name of who simulates it."""
    if report.trip is not None:
        TripLatch(folder).acknowledge(OPERATOR, moment.isoformat(), "simulated production")


def _turn_of(production: Production, one: _Mounted) -> float | None:
    """The stated angle of a gear [rad]; None where nobody states one, and for a bare motor."""
    if not production.spread or not one.gear:
        return None
    return REVOLUTION * (one.gear - 1) / production.gears


def _request(
    production: Production,
    day: _BenchDay,
    *,
    making: Path,
    moment: datetime,
    turned: tuple[str, str, _Mounted],
) -> Order:
    protocol, serial, one = turned
    first = production.seed * _SEEDS_PER_ORDER
    world: dict[str, Any] = {
        "gear_seed": first + one.gear,
        "bench_seed": first + day.bench,
        "mount": one.mount,
        "mount_turn": _turn_of(production, one),
        "day": day.day,
        "population": production.population,
    }
    return Order(
        protocol=protocol,
        gear=shipped_gear(),
        motor=shipped_motor(),
        folder=making,
        values=production.parameters(protocol),
        serial=serial,
        operator=OPERATOR,
        seed=first + day.bench,
        world=WorldChoice(**world),
        sample_rate=production.sample_rate,
        calendar_ns=round(moment.timestamp()) * 1_000_000_000,
    )
