"""The command `rig`: a table of commands. Everything heavy is imported when a command runs, not when help is shown."""

from __future__ import annotations

import os
import sys
import tempfile
import traceback
from importlib import metadata
from typing import Annotated

import typer

from rig import exits
from rig.commands import (
    analysis,
    configuring,
    doctoring,
    drilling,
    files,
    gears,
    library,
    modelling,
    motors,
    planning,
    reporting,
    running,
    simulating,
    window,
)
from rig.commands.terminal import outliving_the_terminal

app = typer.Typer(
    name="rig",
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Run a harmonic-drive test rig, record it, fit a physical model to it, and say how good model and gear are. "
    "With no hardware at all it runs on a simulated rig: try [bold]rig demo[/bold].",
    epilog="Exit codes: 0 done or PASS, 1 FAIL, 2 usage, 3 MARGINAL, 4 ABORTED, 5 TRIPPED, 6 ERROR, 7 BUSY.",
)

PANELS = {
    "At the rig": (
        planning.plan,
        doctoring.doctor,
        running.run,
        window.live,
        reporting.demo,
        configuring.config,
        gears.gear,
        motors.motor,
        simulating.sim,
    ),
    "Fit and compare": (analysis.fit, analysis.compare, reporting.report, modelling.model),
    "Safety": (drilling.drill, drilling.acknowledge),
    "Run files": (
        files.runs,
        library.passport,
        library.diff,
        files.show,
        files.import_,
        files.export,
        files.recover,
        files.verify,
    ),
}
"""The commands in the order and under the headings of `rig --help`."""

for _panel, _commands in PANELS.items():
    for _command in _commands:
        if isinstance(_command, typer.Typer):
            app.add_typer(_command, rich_help_panel=_panel)
            continue
        _name = _command.__name__.rstrip("_")
        _settings = getattr(_command, "context_settings", None)
        app.command(_name, rich_help_panel=_panel, context_settings=_settings)(_command)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"harmonic-rig {metadata.version('harmonic-rig')}")
        raise typer.Exit


@app.callback()
def common(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Show the version and exit."
        ),
    ] = False,
) -> None:
    """Options before any command."""


def run(arguments: list[str] | None = None) -> None:
    """Entry point: every ending becomes an exit code, every error one screen."""
    try:
        app(args=arguments, standalone_mode=True)
    except BrokenPipeError:
        # Whoever read our output has gone; there is nobody left to tell.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise SystemExit(exits.DONE) from None
    except (Exception, KeyboardInterrupt) as error:  # noqa: BLE001  the last line before the user
        with outliving_the_terminal():
            code = _tell(error)
        raise SystemExit(code) from None


def _tell(error: BaseException) -> int:
    """Print the one-screen message for an error and return its exit code."""
    if os.environ.get("HARMONIC_RIG_DEBUG"):
        traceback.print_exception(error)
    known = exits.explain(error)
    from rig.analysis.wording import visible

    if known is not None:
        code, sentence = known
        sys.stderr.write(f"{visible(sentence)}\n")
        return code
    with tempfile.NamedTemporaryFile(
        "w", prefix="harmonic-rig-", suffix=".log", delete=False
    ) as log:
        traceback.print_exception(error, file=log)
    sys.stderr.write(
        f"The program met something it was not built for: {type(error).__name__}: {visible(str(error))}\n"
        f"This is a defect; the details for its report are in {log.name}\n"
    )
    return exits.ERROR
