"""`rig fleet`: thousands of runs fitted in parallel, asked as one table, simulated as a production."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.commands.analysis import Json, NoTare, Settings, settings_of
from rig.commands.judgement import AcceptanceFile
from rig.commands.terminal import echo, print_json

if TYPE_CHECKING:
    from rig.fleet.fit import FleetReport
    from rig.fleet.questions import Answer

fleet = typer.Typer(
    name="fleet",
    no_args_is_help=True,
    help="Thousands of runs: fitted in parallel, asked as one table, simulated as a production.",
)
SHOWN = 10
"""Failures that a terminal shows; the table has all."""


@fleet.callback()
def _group() -> None:
    """Thousands of runs: fitted in parallel, asked as one table, simulated as a production."""


@fleet.command("fit")
def fit(
    names: Annotated[
        list[str],
        typer.Argument(
            metavar="DIR|GLOB|LIST...",
            help="Folders of runs, patterns, lists (.txt, a path a line) or run files.",
        ),
    ],
    kind: Annotated[
        str,
        typer.Option(metavar="KIND", help="Kind of fit instead of that of each run's protocol."),
    ] = "",
    workers: Annotated[
        int,
        typer.Option(min=0, metavar="N", help="Processes of this computer; 0: this one alone."),
    ] = 0,
    scheduler: Annotated[
        str,
        typer.Option(
            metavar="ADDRESS",
            help="A cluster that is there already: tcp://host:port of its dask scheduler.",
        ),
    ] = "",
    mapped: Annotated[
        str,
        typer.Option(
            "--map", metavar="FROM=TO", help="Under which other path workers see the runs."
        ),
    ] = "",
    output: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Folder of the results; fleet-results in the first folder."
        ),
    ] = None,
    no_tare: NoTare = False,
    setting: Settings = None,
    acceptance: AcceptanceFile = "",
    stored: Annotated[
        bool,
        typer.Option("--store", help="Keep each analysis beside its run too, as `rig fit` does."),
    ] = False,
    json: Json = False,
) -> None:
    """Fit every run that is not fitted yet, and keep the results as one table (Parquet).

    The same fit as `rig fit`, each run with its tare. What is done is not done again, what rests on something that
    changed is. A run that cannot be read or analysed is a row with its reason. Ctrl-C keeps all that is done.
    The exit code is 0 whatever the verdicts: they stand in the table; 6 where no run at all could be analysed.
    """
    from rig import exits
    from rig.commands.fleet_progress import telling
    from rig.fleet.fit import FleetOrder, fit_fleet
    from rig.fleet.work import PathMap

    if workers and scheduler:
        raise typer.BadParameter(
            "processes of this computer, or a cluster, not both",
            param_hint="--workers, --scheduler",
        )
    order = FleetOrder(
        names=names,
        kind=kind,
        settings=settings_of(setting),
        no_tare=no_tare,
        acceptance=acceptance,
        workers=workers,
        scheduler=scheduler,
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
    raise typer.Exit(exits.ERROR if none else exits.DONE)


def _print_report(report: FleetReport) -> None:
    echo(
        f"{report.runs} runs: {report.fitted} fitted, {report.reused} done before, {len(report.failed)} failed"
    )
    for run, reason in report.failed[:SHOWN]:
        echo(f"  {run}: {reason}")
    if len(report.failed) > SHOWN:
        echo(f"  and {len(report.failed) - SHOWN} more: their rows say why")
    echo(f"results in {report.output}: rig fleet query spread --results {report.output}")


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
            "--results", metavar="DIR", help="Folder of results, or of the runs with them."
        ),
    ] = None,
    csv: Annotated[bool, typer.Option("--csv", help="Print the answer as CSV.")] = False,
    json: Json = False,
) -> None:
    """Ask the results of a fleet: a ready question by its name, or SQL (DuckDB) over the table `results`."""
    from rig.fleet.fit import require_packages
    from rig.fleet.questions import ask, results_folder

    require_packages("pyarrow", "duckdb")
    answer = ask(results_folder(results), question)
    if json:
        print_json(answer.as_json())
    elif csv:
        _print_csv(answer)
    else:
        _print_answer(answer)


def _print_answer(answer: Answer) -> None:
    """Every column at its whole width: a terminal that is narrower breaks lines, and a pager need not."""
    cells = [answer.columns, *([_cell(value) for value in row] for row in answer.rows)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    for line in cells:
        echo("  ".join(map(str.ljust, line, widths)).rstrip())


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
