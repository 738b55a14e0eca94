"""`rig diff` and `rig passport`: what differs between two runs, and a gear over its runs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.commands.terminal import echo, print_json

if TYPE_CHECKING:
    from rig.analysis.passport.analyse import Analysed
    from rig.library.index import IndexedRun

JsonFlag = Annotated[
    bool, typer.Option("--json", help="Print one JSON object on standard output and nothing else.")
]


def diff(
    first: Annotated[Path, typer.Argument(metavar="RUN", help="Run file.")],
    second: Annotated[Path, typer.Argument(metavar="RUN", help="The run file to hold against it.")],
    everything: Annotated[
        bool, typer.Option("--all", help="What is the same in both too.")
    ] = False,
    json: JsonFlag = False,
) -> None:
    """Say what differs between two runs: parameters, limits, calibrations, versions, conditions, gear, results.

    Results are the newest analyses beside the runs; a difference is significant where it is larger than
    U_c = sqrt(U1^2 + U2^2), at 95 %. The exit code is 0 whether they differ or not; --json says `differs`.
    """
    from rig.analysis.difference import difference

    changes = difference(first, second)
    if json:
        content = changes.as_json()
        if everything:
            content["same"] = [change.as_json() for change in changes.same]
        print_json(content)
        return
    from rig.commands.library_tables import print_difference

    print_difference(changes, everything=everything)


def passport(
    serial: Annotated[
        str, typer.Argument(metavar="SERIAL", help="Serial number of the gear, letter for letter.")
    ],
    output: Annotated[
        list[Path] | None,
        typer.Option(
            "--output", metavar="DIR", help="Folder of the run files; may be given several times."
        ),
    ] = None,
    analyse: Annotated[
        bool, typer.Option("--analyse", help="First fit the runs that have no analysis yet.")
    ] = False,
    tare: Annotated[
        Path | None,
        typer.Option(
            "--tare",
            metavar="RUN",
            help="With --analyse: motor-tare run, subtracted from friction.",
        ),
    ] = None,
    origin: Annotated[
        str,
        typer.Option(
            metavar="WORD",
            help="hardware, simulated, replay or imported; hardware alone where there is any.",
        ),
    ] = "",
    baseline: Annotated[
        int, typer.Option(min=2, metavar="RUNS", help="First runs that make the control limits.")
    ] = 10,
    json: JsonFlag = False,
) -> None:
    """Show a gear over its runs: transmission accuracy, order spectrum, friction, starting torque, with control limits.

    Drawn from the analyses beside the runs. Only runs that can be compared stand in one series: one
    origin, mounting, speed and subject (gear, or motor and gear). What is missing is named. The
    exit code is 0 also where a limit is broken.
    """
    from rig.analysis.passport.build import passport as passport_of

    where = output or [Path("runs")]
    analysed = _analyse(where, serial, tare, origin, quiet=json) if analyse else ()
    passport_of_gear = passport_of(where, serial, origin=origin, baseline=baseline)
    if json:
        content = passport_of_gear.as_json()
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

    print_passport(passport_of_gear, analysed)


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
