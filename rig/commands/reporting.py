"""`rig report` and `rig demo`: the page that a laboratory sends out, and the whole chain in one command."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def report(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="Run files of one gear, in any order.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE", help="The page to write.")] = Path(
        "report.html"
    ),
    tare: Annotated[
        Path | None,
        typer.Option("--tare", metavar="RUN", help="Motor-tare run; one among RUN... is used without asking."),
    ] = None,
    parameters: Annotated[
        Path | None, typer.Option("--parameters", metavar="FILE", help="Parameter set (TOML) instead of the run's own.")
    ] = None,
) -> None:
    """Write one self-contained page: verdict, figures, parameters with intervals and budgets, conditions, provenance."""
    from rig.report.build import report_on_files

    made = report_on_files(runs, output, tare=tare, parameters=parameters)
    for line in made.lines:
        typer.echo(line)


def demo(
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="DIR", help="Folder for runs, report and parameter set.")
    ] = Path("rig-demo"),
    seed: Annotated[int, typer.Option(min=0, help="Seed of the simulated gear and its imperfections.")] = 0,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object on standard output.")] = False,
) -> None:
    """Turn a simulated gear through the paper's experiments, fit them, compare with the truth, and write the report.

    Ctrl-C is a STOP (controlled ramp, what was recorded is kept), a second one an ABORT (quick stop).
    """
    from datetime import datetime

    from rig.commands.demo_tables import print_demonstration, progress
    from rig.demo import demonstrate
    from rig.demo_work import DemoOrder
    from rig.exits import ABORTED, explain

    order = DemoOrder(output, seed, datetime.now().astimezone().isoformat(timespec="seconds"))
    try:
        with progress(quiet=json) as show:
            made = demonstrate(order, show=show)
    except KeyboardInterrupt as stopped:
        # Caught here because the command-line library would make an exit code of its own out of it.
        code, sentence = explain(stopped) or (ABORTED, "")
        typer.echo(sentence, err=True)
        raise typer.Exit(code) from None
    if json:
        from rig.results import json_text

        typer.echo(json_text(made.as_json()))
    else:
        print_demonstration(made)
