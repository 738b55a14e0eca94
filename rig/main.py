"""The command `rig`: a table of commands. Everything heavy is imported when a command runs, not when help is shown."""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, cast

import typer
from typer.core import TyperGroup

from rig import exits
from rig.commands import (
    advising,
    analysis,
    campaigning,
    certifying,
    commissioning,
    compensating,
    configuring,
    doctoring,
    drilling,
    exporting,
    files,
    fleeting,
    gears,
    helping,
    importing,
    learning,
    library,
    modelling,
    motors,
    planning,
    refusing,
    reporting,
    running,
    simulating,
    validating,
    verifying,
    window,
)
from rig.commands.earlier_names import Command, moved
from rig.commands.terminal import outliving_the_terminal

_JSON_FLAGS = frozenset({"--json", "--events"})
"""Flags of a caller that is a program and reads standard output."""
_CTRL_C = 130
"""What the command-line library makes of a Ctrl-C that no run has heard."""
PANELS = {
    "At the rig": (
        planning.plan,
        doctoring.doctor,
        running.run,
        campaigning.campaign,
        window.live,
        reporting.demo,
        configuring.config,
        commissioning.commission,
        learning.bench,
        gears.gear,
        simulating.sim,
    ),
    "Fit and compare": (
        analysis.fit,
        validating.validate,
        advising.next_,
        certifying.certificate,
        reporting.report,
        modelling.model,
        exporting.export_model,
        compensating.compensate,
        fleeting.fleet,
    ),
    "Safety": (drilling.acknowledge,),
    "Run files": (
        files.runs,
        library.diff,
        files.show,
        importing.import_,
        files.export,
        files.recover,
        verifying.verify,
    ),
}
"""The commands in the order and under the headings of `rig help`."""
DAY = (
    reporting.demo,
    window.live,
    configuring.config,
    doctoring.doctor,
    gears.gear,
    planning.plan,
    running.run,
    campaigning.campaign,
    analysis.fit,
    reporting.report,
    certifying.certificate,
    importing.import_,
)
"""What is typed on an ordinary day, as `rig` alone and `rig --help` list it."""
EARLIER = {
    analysis.compare: "rig validate RUN --against FILE",
    library.passport: "rig report --gear SERIAL --passport",
    drilling.drill: "rig sim drill",
}
"""What was typed before, and what is typed now; answered for one version, and not in the help."""


def _name_of(part: Any) -> str:
    """What is typed for a command or a group of commands."""
    if isinstance(part, typer.Typer):
        return str(part.info.name)
    return part.__name__.rstrip("_").replace("_", "-")


def _words_of(part: Any) -> str:
    """The help of a command or a group of commands, without building it."""
    return str(part.info.help or "") if isinstance(part, typer.Typer) else part.__doc__


class _Commands(Mapping[str, Any]):
    """The commands by name, each built when it is asked for: to read the options of all takes longer than many run."""

    def __init__(self) -> None:
        self._parts = {
            _name_of(part): (part, panel) for panel, parts in PANELS.items() for part in parts
        }
        self._parts |= {
            _name_of(part): (part, "") for part in (*EARLIER, motors.motor, helping.help_)
        }
        self._built: dict[str, Any] = {}

    def __getitem__(self, name: str) -> Any:
        if name not in self._built:
            self._built[name] = _built(name, *self._parts[name])
        return self._built[name]

    def __contains__(self, name: object) -> bool:
        return name in self._parts

    def __iter__(self) -> Iterator[str]:
        return iter(self._parts)

    def __len__(self) -> int:
        return len(self._parts)


def _built(name: str, part: Any, panel: str) -> Any:
    """A command or a group of commands, as the library makes it of a function's parameters."""
    alone = typer.Typer(add_completion=False, rich_markup_mode="rich")
    if isinstance(part, typer.Typer):
        for inner in part.registered_commands:
            if not issubclass(inner.cls or object, Command):
                inner.cls = Command
        alone.add_typer(part, rich_help_panel=panel)
        return cast(TyperGroup, typer.main.get_command(alone)).commands[name]
    settings = getattr(part, "context_settings", None)
    now = EARLIER.get(part)
    alone.command(
        name,
        cls=Command if now is None else moved(now),
        hidden=now is not None or part is helping.help_,
        rich_help_panel=panel,
        context_settings=settings,
    )(part)
    return typer.main.get_command(alone)


class _Table(TyperGroup):
    """The command `rig`, whose commands are built when they are asked for."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.commands = _Commands()  # pyright: ignore[reportAttributeAccessIssue]  nothing is added later

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """The first page: the commands of a day."""
        day = {_name_of(part): _words_of(part) for part in DAY}
        usage = f"Usage: {ctx.command_path} COMMAND [OPTIONS]"
        formatter.write(helping.first_page(self, usage, day))


app = typer.Typer(
    name="rig",
    cls=_Table,
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Run a harmonic-drive test rig, record it, fit a physical model to it, and say how good model and gear are. "
    "With no hardware at all it runs on a simulated rig: try [bold]rig demo[/bold].",
    epilog="Exit codes: 0 done, PASS or NOT JUDGED, 1 FAIL, 2 usage, 3 MARGINAL, 4 ABORTED, 5 TRIPPED, "
    "6 ERROR, 7 NOT JUDGED under --require-verdict, 8 BUSY.",
)


def _print_version(wanted: bool) -> None:
    if wanted:
        from rig.program import version as program_version

        typer.echo(f"harmonic-rig {program_version()}")
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
    """Entry point: every ending becomes an exit code, every error one screen, and one JSON object if asked for."""
    words = sys.argv[1:] if arguments is None else arguments
    as_json = not _JSON_FLAGS.isdisjoint(words)
    try:
        # The library's own endings have exit codes of their own for Ctrl-C and a reader that has gone.
        code = app(args=arguments, prog_name="rig", standalone_mode=False)
        if code == _CTRL_C:
            raise KeyboardInterrupt
        raise SystemExit(code or exits.DONE)
    except SystemExit as end:
        for note in _notes(end):
            sys.stderr.write(f"{note}\n")
        if not isinstance(end.__context__, BrokenPipeError):
            raise
        # Whoever read our output has gone (`| head`); there is nobody left to tell.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise SystemExit(exits.DONE) from None
    except (Exception, KeyboardInterrupt) as error:  # noqa: BLE001  the last line before the user
        with outliving_the_terminal():
            code = _tell(error, as_json=as_json)
        raise SystemExit(code) from None
    finally:
        _tell_left_out()


def _tell_left_out() -> None:
    """What other packages bring and what could not be used of it, for whoever has looked at any of it."""
    extensions = sys.modules.get("experiments.extensions")
    for one, why in extensions.left_out() if extensions is not None else ():
        sys.stderr.write(f"warning: {one.title} is left out: it {why}.\n")


def _tell(error: BaseException, *, as_json: bool = False) -> int:
    """Print the one-screen message for an error, as JSON the object of it too, and return its exit code."""
    if os.environ.get("HARMONIC_RIG_DEBUG"):
        traceback.print_exception(error)
    refusing.reword(error)
    known = _refusal(error) or exits.explain(error)
    from rig.content.wording import visible

    notes = [visible(note) for note in _notes(error)]
    if as_json:
        _tell_as_json(error, "\n".join([known[1] if known is not None else str(error), *notes]))
    elif hasattr(error, "format_message"):
        refusing.show(error)
        return exits.USAGE
    if known is not None:
        code, sentence = known
        sys.stderr.write("\n".join([visible(sentence), *notes]) + "\n")
        return code
    sys.stderr.write(
        f"{visible(exits.defect_in_words(error))}\n" + "".join(f"{note}\n" for note in notes)
    )
    return exits.ERROR


def _notes(error: BaseException) -> list[str]:
    """What was noted beside an error: how the run ended in which it was raised. Ctrl-C comes as the library's own."""
    cause = error.__cause__
    return [
        *getattr(error, "__notes__", ()),
        *(_notes(cause) if isinstance(cause, KeyboardInterrupt) else ()),
    ]


def _refusal(error: BaseException) -> tuple[int, str] | None:
    """Exit code and sentence of what the command-line library refuses; None for any other error."""
    if isinstance(error, (typer.Abort, KeyboardInterrupt)):
        # A run hears Ctrl-C itself: what comes to here was pressed before it began, or after it ended.
        standing = "" if _notes(error) else "; no rig was moving"
        return exits.ABORTED, f"Stopped by the operator{standing}."
    words = getattr(error, "format_message", None)
    return None if words is None else (exits.USAGE, str(words()))


def _tell_as_json(error: BaseException, sentence: str) -> None:
    """The error as one line of JSON on standard output: a whole object by itself, and the last line of a stream."""
    import json

    from rig.content.wording import visible

    sys.stdout.write(visible(json.dumps(exits.error_object(error, sentence))) + "\n")
    sys.stdout.flush()
