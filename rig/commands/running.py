"""`rig plan` and `rig run`: a protocol walked without a rig, and executed on one.

Flags of a protocol are made from its parameter model when it is named, so that the models stay their only definition.
"""

from __future__ import annotations

import difflib
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

if TYPE_CHECKING:
    from rich.console import Console

    from experiments.parameters import ParameterField
    from experiments.steps import Prompt
    from model.gear import HarmonicDrive
    from rig.run.dry_run import PlannedRun
    from rig.run.order import RunReport
    from rig.run.start import RunRequest
    from rig.run.stop import StopRequest

Command = TypeVar("Command", bound=Callable[..., None])


def with_protocol_flags(command: Command) -> Command:
    """Let a command take flags that are known only when its protocol is; its --help shows them."""
    command.__dict__["context_settings"] = {
        "allow_extra_args": True,
        "ignore_unknown_options": True,
        "help_option_names": [],
    }
    return command


Help = Annotated[bool, typer.Option("--help", "-h", help="Show this, and with a PROTOCOL its own flags, and exit.")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object on standard output and nothing else.")]
Parameters = Annotated[
    Path | None, typer.Option("--parameters", metavar="FILE", help="Parameter set of the gear (TOML).")
]
MountedHow = Annotated[
    str, typer.Option("--mounting", help="circular-spline-fixed (ratio N) or flexspline-fixed (ratio N + 1).")
]
SampleRate = Annotated[
    float, typer.Option("--sample-rate", metavar="HZ", min=50.0, max=20000.0, help="SYNC rate [Hz].")
]


@with_protocol_flags
def plan(
    context: typer.Context,
    parameters: Parameters = None,
    mounting: MountedHow = "circular-spline-fixed",
    sample_rate: SampleRate = 1000.0,
    json: Json = False,
    show_help: Help = False,
) -> None:
    """Walk a protocol without a rig: duration, revolutions, samples, file size, peak speed and torque, margin to each limit.

    Usage: rig plan PROTOCOL [flags of the protocol]. A plan that would break a limit is refused with the step, the value
    and the limit (exit code 2).
    """
    if show_help:
        _print_help(context)
        raise typer.Exit
    from rig.run.start import RunRequest, plan_request

    protocol, values = read_protocol(context.args)
    gear, motor = _gear(parameters), _motor()
    request = RunRequest(
        protocol,
        gear,
        motor,
        Path(),
        values,
        mounting=mounting,  # type: ignore[arg-type]
        sample_rate=sample_rate,
    )
    planned = plan_request(request)
    if json:
        from rig.results import json_text

        typer.echo(json_text(planned.as_json()))
        return
    _print_plan(planned)


@with_protocol_flags
def run(
    context: typer.Context,
    backend: Annotated[str, typer.Option(help="Which rig: sim, wire (drivers and simulated devices) or replay:RUN.h5.")] = "sim",
    gear_serial: Annotated[
        str, typer.Option("--gear", metavar="SERIAL", help="Serial number of the gear.")
    ] = "unknown",
    operator: Annotated[str, typer.Option(metavar="NAME", help="Who runs it.")] = "",
    output: Annotated[Path, typer.Option(metavar="DIR", help="Folder of the run files.")] = Path("runs"),
    seed: Annotated[int, typer.Option(min=0, help="Seed of a simulated rig: another gear, another noise.")] = 0,
    parameters: Parameters = None,
    mounting: MountedHow = "circular-spline-fixed",
    sample_rate: SampleRate = 1000.0,
    block: Annotated[int, typer.Option(min=1, max=100_000, help="Cycles per exchange; changes no count.")] = 2000,
    json: Json = False,
    events: Annotated[
        bool, typer.Option("--events", help="Tell events and progress as JSON lines on standard output, the report last.")
    ] = False,
    stdin_control: Annotated[
        bool, typer.Option("--stdin-control", help="Take STOP, ABORT and notes as lines on standard input; its end is a STOP.")
    ] = False,
    show_help: Help = False,
) -> None:
    """Execute a protocol on a rig and keep it as one run file.

    Usage: rig run PROTOCOL [flags of the protocol]. Ctrl-C is a STOP (controlled ramp, the file is sealed as ABORTED), a
    second one an ABORT (quick stop). Whatever happens, the rig is made safe and that is checked.
    """
    if show_help:
        _print_help(context)
        raise typer.Exit
    from rig.run.start import RunRequest, plan_request

    protocol, values = read_protocol(context.args)
    request = RunRequest(
        protocol, _gear(parameters), _motor(), output, values, backend, mounting,  # type: ignore[arg-type]
        gear_serial, operator, seed, sample_rate, block,
    )  # fmt: skip
    planned = plan_request(request)
    from rig.exits import code_of_outcome

    if events or stdin_control:
        report = _run_for_a_program(request, planned, events, stdin_control)
    else:
        report = _run_with_signals(request, planned, quiet=json)
    if events:
        pass
    elif json:
        from rig.results import json_text

        typer.echo(json_text(report.as_json()))
    else:
        _print_report(report)
    raise typer.Exit(code_of_outcome(report.outcome))


def read_protocol(arguments: Sequence[str]) -> tuple[str, dict[str, Any]]:
    """PROTOCOL and the values of its flags, as text, from what the command line left over."""
    from experiments import catalogue

    if not arguments or arguments[0].startswith("-"):
        found = f"{arguments[0]!r} stands where the protocol belongs. " if arguments else ""
        raise typer.BadParameter(
            f"{found}Name the protocol first: {', '.join(catalogue.names())}.", param_hint="PROTOCOL"
        )
    protocol = arguments[0]
    if protocol not in catalogue.names():
        raise typer.BadParameter(
            f"no such protocol: {protocol!r}. {_nearest(protocol, catalogue.names())}", param_hint="PROTOCOL"
        )
    from experiments.parameters import parameter_fields

    fields = parameter_fields(catalogue.load(protocol).parameters)
    return protocol, read_flags(protocol, fields, arguments[1:])


def read_flags(protocol: str, fields: Sequence[ParameterField], arguments: Sequence[str]) -> dict[str, Any]:
    """Values by parameter name from `--flag value`, `--flag=value`, `--flag a b c` (lists), `--flag` and `--no-flag`."""
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
                f"{what} of {protocol}: {flag!r}. {_nearest(flag, tuple(by_flag))}", param_hint="flags of the protocol"
            )
        if field.name in values:
            raise typer.BadParameter(f"{flag} is given twice", param_hint="flags of the protocol")
        given = [inline] if equals else _values_after(rest, field)
        if not given and field.kind is not bool:
            raise typer.BadParameter(f"{flag} needs a value [{field.unit or field.kind.__name__}]", param_hint=flag)
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


def _nearest(found: str, known: Sequence[str]) -> str:
    near = difflib.get_close_matches(found, known, n=2, cutoff=0.5)
    return f"Did you mean {' or '.join(near)}?" if near else f"There are: {', '.join(known)}."


def _gear(path: Path | None) -> HarmonicDrive:
    from model.gear_file import load_gear, shipped_gear

    return shipped_gear() if path is None else load_gear(path)


def _motor() -> Any:
    from model.motor import shipped_motor

    return shipped_motor()


def _run_with_signals(request: RunRequest, planned: PlannedRun, quiet: bool) -> RunReport:
    from rig.run.progress import progress_line
    from rig.run.start import run_request
    from rig.run.stop import StopRequest

    stop = StopRequest()
    title = f"{request.protocol} {request.gear_serial}"
    with _signals(stop), progress_line(title, planned.nominal, quiet) as (on_progress, on_event):
        return run_request(request, planned, stop=stop, ask=_ask, on_progress=on_progress, on_event=on_event)


def _run_for_a_program(request: RunRequest, planned: PlannedRun, events: bool, stdin_control: bool) -> RunReport:
    """A run whose operator is another program: words on standard input, lines of JSON on standard output."""
    from drivers.clock import WallClock
    from rig.run.remote import RemoteOperator, lines_of
    from rig.run.start import run_request
    from rig.run.stop import StopRequest

    def write(line: str) -> None:
        if events:
            sys.stdout.write(line + "\n")
            sys.stdout.flush()

    stop = StopRequest()
    remote = RemoteOperator(stop, write, WallClock())
    if stdin_control:
        remote.listen_in_background(lines_of(sys.stdin.fileno()))
    with _signals(stop):
        report = run_request(
            request, planned, stop=stop, ask=remote.ask if stdin_control else _ask, on_progress=remote.on_progress,
            on_event=remote.on_event,
        )  # fmt: skip
    remote.report(report)
    return report


@contextmanager
def _signals(stop: StopRequest) -> Iterator[None]:
    """Ctrl-C presses STOP, then ABORT; a termination request is a STOP. The handlers before are put back."""
    import signal

    def press(number: int, frame: object) -> None:
        stop.press()
        word = "STOP" if stop.level == 1 else "ABORT"
        sys.stderr.write(
            f"\n{word}: {'controlled ramp; Ctrl-C again is a quick stop' if stop.level == 1 else 'quick stop'}\n"
        )

    before = {number: signal.signal(number, press) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _ask(prompt: Prompt) -> str:
    """Put a prompt to whoever sits at the terminal; without one the run goes on and says so."""
    if not sys.stdin.isatty():
        return "(nobody at the terminal: not answered)"
    sys.stderr.write(f"\n{prompt.text} ")
    sys.stderr.flush()
    return sys.stdin.readline().strip()


def _print_help(context: typer.Context) -> None:
    from rich.console import Console
    from rich.table import Table

    from experiments import catalogue

    text = context.get_help()
    if text:
        typer.echo(text)
    console = Console(highlight=False)
    named = next((word for word in context.args if word in catalogue.names()), "")
    if not named:
        table = Table("protocol", "what it measures", title="Protocols", title_justify="left", box=None)
        for name in catalogue.names():
            table.add_row(name, catalogue.entry(name).summary)
        console.print(table)
        console.print(f"\n'{context.command_path} PROTOCOL --help' shows the flags of one.")
        return
    from experiments.parameters import parameter_fields

    experiment = catalogue.load(named)
    table = Table(
        "flag", "unit", "allowed", "default", "what", title=f"{named}: {experiment.title}", title_justify="left"
    )
    for field in parameter_fields(experiment.parameters):
        table.add_row(field.flag, field.unit, field.limit, _default(field), field.help)
    console.print(table)


def _default(field: ParameterField) -> str:
    value = field.default
    if isinstance(value, tuple):
        return " ".join(f"{number:g}" for number in value) or "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _print_plan(planned: PlannedRun) -> None:
    from rich.console import Console
    from rich.table import Table

    from model.units import RPM
    from rig.run.progress import in_words

    console = Console(highlight=False)
    turns = planned.input_revolutions
    peak = max((abs(step.speed) for step in planned.steps), default=0.0) / RPM
    title = f"{planned.experiment.name}: {planned.experiment.title}"
    facts = Table(show_header=False, box=None, title=title, title_justify="left")
    facts.add_row("gear", f"{planned.gear.name}, {planned.mounting}, ratio {planned.load.ratio:g}")
    facts.add_row("steps", f"{len(planned.plan)}")
    facts.add_row("duration", f"{in_words(planned.nominal)} nominal, {in_words(planned.longest)} at most")
    out = f", {turns / planned.load.ratio:.2f} of the output" if planned.experiment.gear_mounted else ""
    facts.add_row("revolutions", f"{turns:.1f} of the input{out}")
    facts.add_row(
        "samples", f"{planned.samples} at {planned.sample_rate:g} Hz, about {planned.file_size() / 1e6:.1f} MB"
    )
    facts.add_row("peak speed", f"{peak:.4g} r/min")
    console.print(facts)
    table = Table("limit on", "planned", "allowed", "margin", "where", "origin", title="Margins", title_justify="left")
    for margin in planned.margins:
        factor, unit = (RPM, "r/min") if margin.limit.unit == "rad/s" else (1.0, margin.limit.unit)
        origin = f"{margin.limit.tier}: {margin.limit.origin}"
        if margin.limit.provenance in ("recalled", "assumed"):
            origin += f" ({margin.limit.provenance})"
        table.add_row(
            margin.quantity.replace("_", " "), f"{margin.value / factor:.4g} {unit}", f"{margin.limit.value / factor:.4g} {unit}",
            f"{100.0 * margin.margin:.0f} %", margin.where, origin,
        )  # fmt: skip
    console.print(table)


def _print_alarm(console: Console, problem: str) -> None:
    """A failed make-safe: the loudest thing on the screen, with the terminal's bell."""
    from rich.panel import Panel

    text = f"STANDSTILL WAS NOT VERIFIED\n\nPRESS THE EMERGENCY STOP. DO NOT TOUCH THE RIG.\n\n{problem}"
    console.print(Panel(text, style="bold white on red", padding=(2, 6), expand=True), markup=False)
    console.bell()


def _print_margins(console: Console, report: RunReport) -> None:
    """How near the run came to each limit, the nearest first."""
    from rich.table import Table

    table = Table("limit on", "peak", "limit", "margin", title="Margins of this run", title_justify="left", box=None)
    for name, found in sorted(report.margins.items(), key=lambda item: item[1]["margin"]):
        style = "red" if found["margin"] < 0.0 else "yellow" if found["margin"] < 0.1 else None
        share = f"{100.0 * found['margin']:.0f} %"
        table.add_row(name.replace("_", " "), f"{found['peak']:.4g}", f"{found['limit']:.4g}", share, style=style)
    console.print(table)


def _print_report(report: RunReport) -> None:
    from rich.console import Console

    console = Console(highlight=False)
    styles = {"PASS": "green", "MARGINAL": "yellow", "ABORTED": "yellow"}
    console.print(f"{report.outcome}  {report.run_id}", style=styles.get(report.outcome, "red"), markup=False)
    console.print(f"{report.path}", markup=False, soft_wrap=True)
    if report.make_safe is not None and not report.safe:
        _print_alarm(console, report.make_safe.problem)
    elif report.make_safe is not None:
        seen = ", ".join(report.make_safe.verified_by)
        console.print(f"made safe ({report.make_safe.action.value}), standstill verified by {seen}", soft_wrap=True)
    if report.message:
        console.print(report.message, markup=False, soft_wrap=True)
    if report.margins:
        _print_margins(console, report)
    if report.trip is not None:
        console.print(f"The trip is latched: rig acknowledge --operator NAME --output {report.path.parent}", soft_wrap=True)
    for warning in dict.fromkeys(w for w in report.warnings if w != report.message):
        console.print(f"warning: {warning}", style="yellow", markup=False, soft_wrap=True)
