"""`rig run`: a protocol executed on a rig.

Flags of a protocol are made from its parameter model when it is named, so that the models stay their only definition.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from rig.commands.judgement import RequireVerdict
from rig.commands.ordering import NoCard, Said, with_order
from rig.commands.terminal import Json, echo, outliving_the_terminal, print_json, tell_if_deaf
from rig.errors import nearest

if TYPE_CHECKING:
    from experiments.parameters import ParameterField
    from rig.bench.backends.order import Order
    from rig.commands.ending import Ending
    from rig.run.dry_run import PlannedRun
    from rig.run.parts import RunReport


Command = TypeVar("Command", bound=Callable[..., None])


def with_protocol_flags(command: Command) -> Command:
    """Let a command take flags that are known only when its protocol is; its --help shows them."""
    command.__dict__["context_settings"] = {
        "allow_extra_args": True,
        "ignore_unknown_options": True,
        "help_option_names": [],
    }
    return command


ORDERED = (
    "backend",
    "serial",
    "operator",
    "folder",
    "seed",
    "world",
    "gear",
    "mounting",
    "sample_rate",
    "config",
    "block_cycles",
    "acceptance",
    "status",
)
"""The fields of an order that `rig run` takes, in the order of its help."""
Help = Annotated[
    bool,
    typer.Option("--help", "-h", help="Show this, and with a PROTOCOL its own flags, and exit."),
]
Events = Annotated[
    bool,
    typer.Option(
        "--events",
        help="Tell events and progress as JSON lines on standard output, the report last.",
    ),
]
StdinControl = Annotated[
    bool,
    typer.Option(
        "--stdin-control",
        help="Take STOP, ABORT and notes as lines on standard input; its end is a STOP.",
    ),
]


_Repeat = Annotated[
    str | None,
    typer.Option(
        metavar="RUN",
        rich_help_panel="Simulated world",
        help="Make a simulated run again, count by count: its number or its file says the protocol and all else.",
    ),
]

_Confirm = Annotated[
    str,
    typer.Option(
        metavar="SERIAL",
        help="Arms a run on hardware: the gear's serial number, letter for letter, once more.",
    ),
]

_Uncommissioned = Annotated[
    str,
    typer.Option(
        metavar="SENTENCE",
        help="Turns hardware further than `rig commission` has looked at; the refusal says the sentence.",
    ),
]

_Everything = Annotated[
    bool,
    typer.Option("--all", help="All that was found and every margin, not only what matters."),
]


@with_protocol_flags
@outliving_the_terminal()
@with_order(*ORDERED)
def run(
    context: typer.Context,
    said: Said,
    repeat: _Repeat = None,
    confirm: _Confirm = "",
    uncommissioned: _Uncommissioned = "",
    require_verdict: RequireVerdict = False,
    everything: _Everything = False,
    no_card: NoCard = False,
    json: Json = False,
    events: Events = False,
    stdin_control: StdinControl = False,
    show_help: Help = False,
) -> None:
    """Execute a protocol on a rig and keep it as one run file.

    Usage: rig run PROTOCOL \\[flags of the protocol]. Ctrl-C, a closed terminal and a termination
    request are a STOP (controlled ramp, the file is sealed as ABORTED), a second Ctrl-C an ABORT
    (quick stop). Whatever happens, the rig is made safe
    and that is checked. A rig of hardware has to be armed: operator and gear named, the guard
    closed, the serial number typed once more.
    """
    from rig.bench.identity import option_of
    from rig.commands.run_tables import print_help, print_report

    if show_help:
        print_help(context)
        raise typer.Exit
    from rig.commands.ordering import confirmed, order_of
    from rig.run.start import plan_order

    protocol, values = read_protocol(context.args) if repeat is None else ("", {})
    order = order_of(protocol, values, said, no_card=no_card)
    if repeat is not None:
        order = _repeated(context, repeat, order)
    planned = plan_order(order)
    confirmation = confirmed(order, planned, confirm, not (json or events or stdin_control))
    tell_if_deaf()
    from rig.commands.ending import ending_of
    from rig.exits import ERROR, code_of_run

    ended = partial(ending_of, order=order)
    if events or stdin_control:
        report, ending = _run_for_a_program(
            order,
            planned,
            (confirmation, uncommissioned),
            ended=ended,
            tells=events,
            listens=stdin_control,
        )
    else:
        report = _run_with_signals(order, planned, (confirmation, uncommissioned), quiet=json)
        ending = ended(report)
    if json and not events:
        print_json({**report.as_json(), **ending.as_json()})
    elif not events:
        bench = option_of(order.backend, order.folder, order.config)
        print_report(report, bench, ending, everything=everything)
    if ending.crash or ending.refusal:
        raise typer.Exit(ERROR)
    raise typer.Exit(code_of_run(report.outcome, ending.verdict.verdict, required=require_verdict))


_REPEATABLE = (
    "folder",
    "operator",
    "config",
    "block_cycles",
    "acceptance",
    "status",
    "require_verdict",
    "everything",
    "json",
    "events",
    "stdin_control",
    "repeat",
)
"""Flags that a repeated run takes; everything else is said by its file."""


def _repeated(context: typer.Context, run: str, order: Order) -> Order:
    """The order that makes a run again. Raises `BadParameter` for flags that the run's file answers."""
    from rig.library.folder import run_named
    from rig.run.repeat import repetition

    given = [
        flag.opts[0]
        for flag in context.command.params
        if flag.name is not None
        and flag.name not in _REPEATABLE
        and (source := context.get_parameter_source(flag.name)) is not None
        and source.name == "COMMANDLINE"
    ]
    if given or context.args:
        raise typer.BadParameter(
            f"{' '.join([*given, *context.args])}: the run that is repeated says this. Leave it away.",
            param_hint="--repeat",
        )
    repeated, warning = repetition(run_named(order.folder, run), order)
    if warning:
        echo(f"warning: {warning}", errors=True)
    return repeated


def read_protocol(arguments: Sequence[str]) -> tuple[str, dict[str, Any]]:
    """PROTOCOL and the values of its flags, as text, from what the command line left over."""
    from experiments import catalogue

    if not arguments or arguments[0].startswith("-"):
        instead = f"{arguments[0]!r} stands where the protocol belongs. " if arguments else ""
        raise typer.BadParameter(
            f"{instead}Name the protocol first: {', '.join(catalogue.names())}.",
            param_hint="PROTOCOL",
        )
    protocol = arguments[0]
    if protocol not in catalogue.names():
        raise typer.BadParameter(
            f"no such protocol: {protocol!r}. {nearest(protocol, catalogue.names())}",
            param_hint="PROTOCOL",
        )
    from experiments.parameters import parameter_fields

    fields = parameter_fields(catalogue.load(protocol).parameters)
    return protocol, read_flags(protocol, fields, arguments[1:])


def read_flags(
    protocol: str, fields: Sequence[ParameterField], arguments: Sequence[str]
) -> dict[str, Any]:
    """Values by parameter name from `--flag value`, `--flag=value`, `--flag a b c` (lists),
    `--flag` and `--no-flag`.
    """
    by_flag = {f.flag: f for f in fields}
    values: dict[str, Any] = {}
    rest = list(arguments)
    while rest:
        flag, equals, inline = rest.pop(0).partition("=")
        field = by_flag.get(flag)
        denied = by_flag.get("--" + flag[5:]) if flag.startswith("--no-") and not equals else None
        if field is None and denied is not None and denied.kind is bool:
            values[denied.name] = False
            continue
        if field is None:
            what = "no such flag" if flag.startswith("-") else "a value without a flag"
            raise typer.BadParameter(
                f"{what} of {protocol}: {flag!r}. {nearest(flag, tuple(by_flag))}",
                param_hint=f"the flags of {protocol}",
            )
        if field.name in values:
            raise typer.BadParameter(f"{flag} is given twice", param_hint=flag)
        given = [inline] if equals else _values_after(rest, field)
        if not given and field.kind is not bool:
            raise typer.BadParameter(
                f"{flag} needs a value [{field.unit or field.kind.__name__}]", param_hint=flag
            )
        values[field.name] = " ".join(given) if given else True
    return values


def _values_after(rest: list[str], field: ParameterField) -> list[str]:
    """Take the values of a flag off the front: one, or all up to the next flag for a list; none for a bare switch."""
    taken: list[str] = []
    switch = field.kind is bool
    while rest and not rest[0].startswith("--") and (field.kind is tuple or not taken):
        if switch and rest[0].lower() not in ("true", "false", "yes", "no", "1", "0"):
            break
        taken.append(rest.pop(0))
    return taken


def _run_with_signals(
    order: Order, planned: PlannedRun, typed: tuple[str, str], *, quiet: bool
) -> RunReport:
    from rig.commands.progress import progress_line
    from rig.commands.prompting import terminal_ask
    from rig.run.start import run_order
    from rig.run.stop import StopRequest, pressed_by_signals

    stop = StopRequest()
    title = f"{order.protocol} {order.serial}"
    with (
        pressed_by_signals(stop),
        progress_line(title, planned.nominal, quiet) as (on_progress, on_event),
    ):
        return run_order(
            order,
            planned,
            confirmation=typed[0],
            uncommissioned=typed[1],
            stop=stop,
            ask=terminal_ask(stop),
            on_progress=on_progress,
            on_event=on_event,
        )


def _run_for_a_program(
    order: Order,
    planned: PlannedRun,
    typed: tuple[str, str],
    *,
    ended: Callable[[RunReport], Ending],
    tells: bool,
    listens: bool,
) -> tuple[RunReport, Ending]:
    """A run whose operator is another program: words on standard input, lines of JSON on standard output."""
    from drivers.clock import WallClock
    from rig.analysis.store import json_ready
    from rig.commands.prompting import program_ask
    from rig.run.remote import RemoteOperator, lines_of
    from rig.run.start import run_order
    from rig.run.stop import StopRequest, pressed_by_signals

    def write(line: str) -> None:
        if tells:
            sys.stdout.write(line + "\n")
            sys.stdout.flush()

    stop = StopRequest()
    remote = RemoteOperator(stop, write, WallClock())
    if listens:
        remote.listen_in_background(lines_of(sys.stdin.fileno()))
    with pressed_by_signals(stop):
        report = run_order(
            order,
            planned,
            confirmation=typed[0],
            uncommissioned=typed[1],
            stop=stop,
            ask=program_ask(remote, stop, listens=listens),
            on_progress=remote.on_progress,
            on_event=remote.on_event,
        )
    ending = ended(report)
    remote.report(json_ready({**report.as_json(), **ending.as_json()}))
    return report, ending
