"""`rig fleet`: thousands of runs fitted in parallel, asked as one table, simulated as a production."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rig.commands.analysis import NoTare, Settings, settings_of
from rig.commands.fleet_report import report
from rig.commands.fleet_rr import rr
from rig.commands.judgement import AcceptanceFile
from rig.commands.ordering import Said, with_order
from rig.commands.terminal import Json, console, echo, painted, print_json

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rig.fleet.fit import FleetReport
    from rig.fleet.questions import Answer

fleet = typer.Typer(
    name="fleet",
    no_args_is_help=True,
    help="Thousands of runs: fitted in parallel, asked as one table, simulated as a production.",
)
Workers = Annotated[
    int,
    typer.Option(
        "--workers", min=0, metavar="N", help="Processes of this computer; 0: this one alone."
    ),
]
Scheduler = Annotated[
    str,
    typer.Option(
        "--scheduler",
        metavar="ADDRESS",
        help="A cluster that is there already: tcp://host:port of its dask scheduler.",
    ),
]
SHOWN = 10
"""Failures that a terminal shows; the table has all."""


@fleet.callback()
def _group() -> None:
    """Thousands of runs: fitted in parallel, asked as one table, simulated as a production."""


_Names = Annotated[
    list[str],
    typer.Argument(
        metavar="DIR|GLOB|LIST...",
        help="Folders of runs, patterns, lists (.txt, a path a line) or run files.",
    ),
]

_Kind = Annotated[
    str,
    typer.Option(metavar="KIND", help="Kind of fit instead of that of each run's protocol."),
]

_Mapped = Annotated[
    str,
    typer.Option("--map", metavar="FROM=TO", help="Under which other path workers see the runs."),
]

_Output = Annotated[
    Path | None,
    typer.Option(metavar="DIR", help="Folder of the results; fleet-results in the first folder."),
]

_Stored = Annotated[
    bool,
    typer.Option("--store", help="Keep each analysis beside its run too, as `rig fit` does."),
]


@fleet.command("fit")
def fit(
    names: _Names,
    kind: _Kind = "",
    workers: Workers = 0,
    scheduler: Scheduler = "",
    mapped: _Mapped = "",
    output: _Output = None,
    no_tare: NoTare = False,
    setting: Settings = None,
    acceptance: AcceptanceFile = "",
    stored: _Stored = False,
    json: Json = False,
) -> None:
    """Fit every run that is not fitted yet, and keep the results as one table (Parquet).

    The same fit as `rig fit`, each run with its tare. What is done is not done again, what rests on something that
    changed is. A run that cannot be read or analysed is a row with its reason. Ctrl-C keeps all that is done.
    The exit code is 0 whatever the verdicts: they stand in the table; 6 where no run at all could be analysed,
    or a file is not as it was sealed.
    """
    from rig import exits
    from rig.commands.fleet_progress import telling
    from rig.fleet.engine import Workforce
    from rig.fleet.fit import FleetOrder, fit_fleet
    from rig.fleet.work import PathMap

    order = FleetOrder(
        names=names,
        kind=kind,
        settings=settings_of(setting),
        no_tare=no_tare,
        acceptance=acceptance,
        crew=Workforce(workers=workers, scheduler=scheduler),
        output=output,
        mapped=PathMap.of(mapped) if mapped else PathMap(),
        stored=stored,
    )
    with telling() as tell:
        report = fit_fleet(order, tell)
    if json:
        print_json(report.as_json())
    else:
        _print_report(report)
    none = len(report.failed) == report.runs
    raise typer.Exit(exits.code_of_check(not (none or report.changed)))


def _print_report(report: FleetReport) -> None:
    echo(
        f"{report.runs} runs: {report.fitted} fitted, {report.reused} done before, {len(report.failed)} failed"
    )
    _print_failures(report.failed)
    echo(f"results in {report.output}: rig fleet query spread --results {report.output}")


def _print_failures(failed: Sequence[tuple[str, str]]) -> None:
    for run, reason in failed[:SHOWN]:
        echo(f"  {run}: {reason}")
    if len(failed) > SHOWN:
        echo(f"  and {len(failed) - SHOWN} more")


_Protocols = Annotated[
    str, typer.Option(metavar="NAME,...", help="By which protocols each gear is measured.")
]

_PerDay = Annotated[int, typer.Option("--per-day", min=1, help="Gears a day on each bench.")]

_Crossed = Annotated[
    bool,
    typer.Option("--crossed", help="A study of the gauge: every gear goes to every bench."),
]

_Mountings = Annotated[
    int, typer.Option(min=1, help="How often each gear is mounted on its bench.")
]

_Repeats = Annotated[int, typer.Option(min=1, help="How often it is measured in each mounting.")]

_Spread = Annotated[
    bool,
    typer.Option("--spread", help="Each gear at a stated angle of its own, spread over the turn."),
]

_Short = Annotated[
    bool, typer.Option("--short", help="Short runs: fewer points, less time at each.")
]

_Setting = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="PROTOCOL.NAME=VALUE",
        help="A parameter of a protocol: friction.points=10.",
    ),
]


@fleet.command("simulate")
@with_order(
    "seed",
    "sample_rate",
    "world",
    world=("population",),
    seed="Other gears and benches for another one; 0.",
    sample_rate="SYNC rate [Hz]; 250.",
)
def simulate(
    said: Said,
    gears: Annotated[int, typer.Option(min=1, help="How many gears are made.")],
    output: Annotated[Path, typer.Option(metavar="DIR", help="Folder of the production.")],
    benches: Annotated[int, typer.Option(min=1, help="On how many benches, in turn.")] = 1,
    protocols: _Protocols = "home,friction",
    per_day: _PerDay = 20,
    crossed: _Crossed = False,
    mountings: _Mountings = 1,
    repeats: _Repeats = 1,
    spread: _Spread = False,
    short: _Short = False,
    setting: _Setting = None,
    workers: Workers = 0,
    scheduler: Scheduler = "",
    json: Json = False,
) -> None:
    """Simulate the production of a factory: gears on benches, day by day, with its truth in truth.parquet.

    The same order makes the same runs again, whoever makes them; what is there is not made again. Ctrl-C keeps the
    runs that are sealed, and the same order goes on from there.
    The runs are those of `rig run` on the simulated rig: for teaching, load tests, planning. They prove no gear.
    """
    from rig import exits
    from rig.commands.fleet_progress import telling
    from rig.extras import require
    from rig.fleet.engine import Workforce
    from rig.fleet.simulate import Production, simulate_fleet

    crew = Workforce(workers=workers, scheduler=scheduler)
    require("a fleet of runs", "fleet", *crew.packages)
    asked: dict[str, Any] = dict(said)
    if (world := asked.pop("world", None)) is not None:
        asked["population"] = world.population
    production = Production(
        folder=output,
        gears=gears,
        benches=benches,
        protocols=tuple(name.strip() for name in protocols.split(",") if name.strip()),
        per_day=per_day,
        crossed=crossed,
        mountings=mountings,
        repeats=repeats,
        spread=spread,
        short=short,
        values=_by_protocol(setting),
        **asked,
    )
    with telling() as tell:
        report = simulate_fleet(production, crew, on_progress=tell)
    if json:
        print_json(report.as_json())
    else:
        made = f"{report.made} made, {report.reused} there before, {len(report.failed)} failed"
        echo(f"{report.runs} runs: {made}")
        _print_failures(report.failed)
        echo(f"fit them: rig fleet fit {report.output} --acceptance demonstration")
    raise typer.Exit(exits.code_of_check(len(report.failed) != report.runs))


def _by_protocol(pairs: list[str] | None) -> dict[str, dict[str, Any]]:
    """PROTOCOL.NAME=VALUE pairs, by protocol."""
    values: dict[str, dict[str, Any]] = {}
    for pair in pairs or ():
        protocol, dot, rest = pair.partition(".")
        if not dot:
            raise typer.BadParameter(f"{pair!r} is not PROTOCOL.NAME=VALUE", param_hint="--set")
        values.setdefault(protocol, {}).update(settings_of([rest]))
    return values


fleet.command("report")(report)
fleet.command("rr")(rr)


@fleet.command("query")
def query(
    question: Annotated[
        str,
        typer.Argument(
            metavar="QUESTION|SQL",
            help="spread, benches, drift, capability, worst; or SQL over the table `results`.",
        ),
    ],
    results: Annotated[
        Path | None,
        typer.Option(
            "--results",
            "--runs",
            metavar="DIR",
            help="Folder of results, or of the runs with them.",
        ),
    ] = None,
    csv: Annotated[bool, typer.Option("--csv", help="Print the answer as CSV.")] = False,
    json: Json = False,
) -> None:
    """Ask the results of a fleet: a ready question by its name, or SQL (DuckDB) over the table `results`."""
    from rig.extras import require
    from rig.fleet.answer_grid import answer_grid
    from rig.fleet.questions import QUESTIONS, ask, results_folder

    require("a question", "fleet", "pyarrow", "duckdb")
    answer = ask(results_folder(results), question)
    if json:
        print_json(answer.as_json())
    elif csv:
        _print_csv(answer)
    elif ready := QUESTIONS.get(question.strip()):
        console().print(painted(answer_grid(ready, answer)))
    else:
        _print_answer(answer)


def _print_answer(answer: Answer) -> None:
    """What SQL asked for, as it is stored, every column at its whole width: a narrower terminal breaks lines."""
    from rig.content.wording import aligned

    cells = [answer.columns, *([_cell(value) for value in row] for row in answer.rows)]
    for line in aligned(cells):
        echo(line)


def _cell(value: object) -> str:
    if value is None:
        return "–"
    return f"{value:.5g}" if isinstance(value, float) else str(value)


def _print_csv(answer: Answer) -> None:
    import csv
    import io

    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(answer.columns)
    writer.writerows(answer.rows)
    echo(text.getvalue().rstrip("\n"))
