"""`rig diff`: what differs between two runs; and a gear over its runs (`rig report --passport`)."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.bench.config.ranges import ALARM_RANGES
from rig.commands.naming import RUNS, RunsFolder, runs_meant
from rig.commands.sealing import Unsealed
from rig.commands.terminal import Json, echo, print_json

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rig.analysis.alarm.promise import Watching
    from rig.analysis.judging import GearVerdict
    from rig.analysis.passport.analyse import Analysed
    from rig.analysis.passport.content import Passport
    from rig.library.index import IndexedRun

JsonFlag = Json


def diff(
    first: Annotated[
        Path, typer.Argument(metavar="RUN", help="Run file, or its number in --runs.")
    ],
    second: Annotated[Path, typer.Argument(metavar="RUN", help="What is held against it.")],
    everything: Annotated[
        bool, typer.Option("--all", help="What is the same in both too.")
    ] = False,
    runs_folder: RunsFolder = RUNS,
    unsealed: Unsealed = False,
    json: JsonFlag = False,
) -> None:
    """Say what differs between two runs: parameters, limits, calibrations, versions, conditions, gear, results.

    Outcome and verdict of both come first. Results are the analyses in force beside the runs; a difference
    is significant where it is larger than U_c = sqrt(U1^2 + U2^2), at 95 %. The exit code is 0 whether
    they differ or not; --json says `differs`.
    """
    from rig.analysis.difference import difference
    from rig.analysis.judging import verdict_as_json

    first, second = runs_meant(runs_folder, (first, second))
    changes = difference(first, second)
    verdicts = [_verdict_of_file(path) for path in (first, second)]
    if json:
        content = changes.as_json()
        content["verdicts"] = [
            {"outcome": outcome, **verdict_as_json(verdict)} for outcome, verdict in verdicts
        ]
        if everything:
            content["same"] = [change.as_json() for change in changes.same]
        print_json(content)
        return
    from rig.commands.library_tables import print_difference

    print_difference(changes, verdicts, everything=everything)


def _verdict_of_file(path: Path) -> tuple[str, GearVerdict | None]:
    """Outcome and verdict of a run file."""
    from rig.analysis.judging import judge_file
    from rig.runfile.read import glance

    metadata = glance(path).metadata
    return metadata.outcome, judge_file(path, metadata)


Folders = Annotated[
    list[Path] | None,
    typer.Option(
        "--runs", metavar="DIR", help="Folder of the run files; may be given several times."
    ),
]
Analyse = Annotated[
    bool,
    typer.Option(
        "--analyse", help="With --passport: first fit the runs that have no analysis yet."
    ),
]
OriginWord = Annotated[
    str,
    typer.Option(
        metavar="WORD",
        help="With --passport: hardware, simulated, replay or imported; hardware alone where there is any.",
    ),
]
FalseAlarms = Annotated[
    float | None,
    typer.Option(
        "--false-alarms",
        min=ALARM_RANGES["false_alarms"][0],
        max=ALARM_RANGES["false_alarms"][1],
        metavar="SHARE",
        help="With --passport: of gears that do not change, so many may be told to have changed; 0.05, or [alarms] "
        "of rig.toml.",
    ),
]
Over = Annotated[
    int | None,
    typer.Option(
        "--over",
        min=ALARM_RANGES["over"][0],
        max=ALARM_RANGES["over"][1],
        metavar="RUNS",
        help="With --passport: within so many runs after the baseline; 20.",
    ),
]
Baseline = Annotated[
    int | None,
    typer.Option(
        "--baseline",
        min=ALARM_RANGES["baseline"][0],
        max=ALARM_RANGES["baseline"][1],
        metavar="RUNS",
        help="With --passport: first runs, which teach what is usual; 10.",
    ),
]


def passport(
    serial: Annotated[
        str, typer.Argument(metavar="SERIAL", help="Serial number of the gear, letter for letter.")
    ],
    output: Folders = None,
    analyse: Analyse = False,
    tare: Annotated[
        Path | None,
        typer.Option(
            "--tare",
            metavar="RUN",
            help="With --analyse: motor-tare run, subtracted from friction.",
        ),
    ] = None,
    origin: OriginWord = "",
    baseline: Baseline = None,
    unsealed: Unsealed = False,
    json: JsonFlag = False,
) -> None:
    """Show a gear over its runs: accuracy, order spectrum, friction, starting torque, and what has changed."""
    from rig.analysis.alarm.laboratory import watching_in_force

    watching = watching_in_force(baseline=baseline)
    show_passport(serial, output, tare, origin, analyse=analyse, watching=watching, json=json)


def show_passport(
    serial: str,
    output: list[Path] | None,
    tare: Path | None,
    origin: str,
    *,
    analyse: bool,
    watching: Watching,
    json: bool,
) -> None:
    """Print a gear over its runs.

    Drawn from the analyses beside the runs. Only runs that can be compared stand in one series: one
    origin, mounting, speed and subject (gear, or motor and gear). What is missing is named. The
    exit code is 0 also where it has changed.
    """
    from rig.analysis.judging import verdict_as_json
    from rig.analysis.passport.build import passport as passport_of

    where = output or [Path("runs")]
    analysed = _analyse(where, serial, tare, origin, quiet=json) if analyse else ()
    passport_of_gear = passport_of(where, serial, origin=origin, watching=watching)
    verdicts, judged = _verdicts_of(passport_of_gear, where)
    if json:
        content = {**passport_of_gear.as_json(), **judged.as_json()}
        content["runs"] = [
            {**run.as_json(), **verdict_as_json(verdicts.get(run.path))}
            for run in passport_of_gear.runs
        ]
        content["analysed"] = [
            {
                "run": one.run.run_id,
                "file": str(one.run.path),
                "stored": one.stored,
                "problem": one.problem,
            }
            for one in analysed
        ]
        print_json(content)
        return
    from rig.commands.library_tables import print_passport

    print_passport(passport_of_gear, judged, analysed)


def _verdicts_of(
    passport: Passport, where: Sequence[Path]
) -> tuple[dict[Path, GearVerdict], GearVerdict]:
    """The verdict on each run of a passport, and that on the gear by the newest of every kind.

    What the gear must show say these places.
    """
    from rig.analysis.in_force import newest_analysed
    from rig.analysis.judging import judge_listed, judge_newest
    from rig.gears.acceptance import acceptance_of_places

    acceptance = acceptance_of_places(where, passport.serial)
    judged = judge_listed(passport.runs)
    verdicts = {path: one.verdict for path, one in judged.items()}
    return verdicts, judge_newest(newest_analysed(passport.runs), acceptance)


def _analyse(
    where: list[Path], serial: str, tare: Path | None, origin: str, *, quiet: bool
) -> tuple[Analysed, ...]:
    from datetime import datetime

    from rig.analysis.passport.analyse import analyse_runs

    def tell(run: IndexedRun) -> None:
        if not quiet:
            echo(f"fitting {run.run_id} ...", errors=True)

    now = datetime.now().astimezone().isoformat(timespec="seconds")
    return analyse_runs(where, serial, now, tare=tare, origin=origin, tell=tell)
