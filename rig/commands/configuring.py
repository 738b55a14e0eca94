"""`rig config`: what describes a rig (rig.toml, motor, certificates), to start from or checked."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from rig.bench.backends.order import Order
from rig.commands.discovering import discover
from rig.commands.ordering import Said, with_order
from rig.commands.terminal import Json, console, echo, print_json
from rig.content.phrase import counted

if TYPE_CHECKING:
    from experiments.finding import Finding
    from rig.bench.config.apply import ConfiguredRig

config = typer.Typer(
    name="config",
    no_args_is_help=True,
    help="Describe the rig: write a description, a motor or a certificate to start from, check the one there is.",
)

config.command("discover")(discover)

File = Annotated[Path, typer.Argument(metavar="[FILE]", help="The description of the rig.")]
_Example = Annotated[
    str,
    typer.Option(
        metavar="NAME",
        help="A worked example of some devices in place of the template, such as epos4; "
        "a name that there is not lists them.",
    ),
]

_Motor = Annotated[
    str,
    typer.Option(
        metavar="NAME",
        help="Make the parameter set of this type of motor instead, from its nameplate.",
    ),
]

_By = Annotated[
    str, typer.Option("--by", metavar="NAME", help="With --motor: who read the nameplate.")
]

_Set = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help='With --motor: a value of the plate: --set rated_torque="0.637 N m"; that one is needed.',
    ),
]


@config.command("new")
def new(
    file: File = Path("rig.toml"),
    example: _Example = "",
    motor: _Motor = "",
    by: _By = "",
    set_: _Set = None,
    json: Json = False,
) -> None:
    """Write a description with every word explained, to be filled in, and with an identity of its own for this bench.

    A file that exists is left alone. The worked examples are made from the devices' documents and were never run.
    With --motor it is the parameter set of a motor, which rig.toml names as `motor`: what its plate does not state is
    scaled and marked as assumed. On a terminal the plate's values are asked one by one; a script states them.
    """
    if motor:
        from rig.commands.motors import new_motor

        if file == Path("rig.toml"):
            raise typer.BadParameter(
                "name the file of the motor's parameter set", param_hint="FILE"
            )
        new_motor(motor, file, by, set_, json=json)
        return
    from rig.bench.config.examples import example_text
    from rig.bench.identity import new_bench_id
    from rig.errors import ConfigurationError

    template = resources.files("rig.bench.config").joinpath("template.toml")
    text = example_text(example) if example else template.read_text(encoding="utf-8")
    text = text.replace('id = ""         ', f'id = "{new_bench_id()}"', 1)
    try:
        with file.open("x", encoding="utf-8") as out:
            out.write(text)
    except FileExistsError as error:
        raise ConfigurationError(
            "exists already and is left alone", where=str(file), remedy="Name another file."
        ) from error
    except OSError as error:
        raise ConfigurationError(
            f"cannot be written: {error.strerror or error}", where=str(file)
        ) from error
    doctor = f"rig doctor --backend hardware --config {file}"
    echo(f"{file}: fill in the numbers of your rig, then `rig config check {file}` and `{doctor}`.")


@config.command("check")
def check(
    file: File = Path("rig.toml"),
    json: Json = False,
) -> None:
    """Read a description and tell everything that is wrong with it: path, value and reason. Exit
    code 2 when something is.

    FILE may be the parameter set of a motor, or the name of a shipped one: what contradicts itself in it is told.
    """
    from rig.commands.motors import check_motor, is_motor

    if is_motor(file):
        check_motor(str(file), json=json)
        return
    from rig import exits
    from rig.bench.config.apply import configured_rig
    from rig.bench.config.load import inspect_configuration, missing_files
    from rig.bench.config.schema import RigConfiguration

    result = inspect_configuration(file)
    problems: tuple[Finding, ...]
    configured, warnings = None, ()
    if isinstance(result, RigConfiguration):
        problems = missing_files(result, file.parent)
        if not problems:
            configured = configured_rig(file)
            warnings = _warnings(configured)
    else:
        problems = result
    if json:
        print_json(_as_json(file, problems, warnings, configured))
    else:
        _print(file, problems, warnings, configured)
    raise typer.Exit(exits.code_of_check(not problems, exits.USAGE))


@config.command("certificate")
@with_order("world", world=("bench_seed", "population"))
def certificate(
    said: Said,
    output: Annotated[Path, typer.Option(metavar="FILE", help="Where to write it; a new file.")],
    channel: Annotated[
        Literal["input", "output"], typer.Option(help="The motor's encoder, or that of the output.")
    ] = "output",
    json: Json = False,
) -> None:
    """Write the certificate of a simulated bench's encoder, as a laboratory would have measured it: with errors
    of its own, within the uncertainty that it states.

    `curve` in rig.toml names the file. A file that exists is left alone.
    """
    from datetime import UTC, datetime

    from rig.bench.backends.simulated import certificate_of
    from rig.bench.config.certificate_file import FORMAT, Header, certificate_text
    from rig.errors import ConfigurationError

    # A bench's encoders are its own, whichever gear is mounted.
    order = Order(protocol="", serial="", **said)
    if order.world.bench_seed is None:
        raise typer.BadParameter("name the bench: --world bench-seed=7", param_hint="--world")
    curve = certificate_of(order, channel)
    header = Header(
        format=FORMAT,
        certificate=f"simulated: {channel} encoder of bench {order.world.bench_seed}",
        date=datetime.now(UTC).date(),
        coverage_factor=curve.coverage_factor,
        zero="index mark",
        sense="counting up",
        error="shown minus true",
    )
    try:
        with output.open("x", encoding="utf-8") as file:
            file.write(certificate_text(header, curve))
    except FileExistsError as error:
        raise ConfigurationError(
            "exists already and is left alone", where=str(output), remedy="Name another file."
        ) from error
    except OSError as error:
        raise ConfigurationError(
            f"cannot be written: {error.strerror or error}", where=str(output)
        ) from error
    if json:
        print_json({"file": str(output), "channel": channel, "certificate": header.certificate})
    else:
        echo(f'{output}: name it in rig.toml, curve = "{output.name}"')


def _warnings(configured: ConfiguredRig) -> tuple[Finding, ...]:
    """What can be accepted and should be known: calibrations, missing channels, a guard that nobody reads."""
    from datetime import UTC, datetime

    from experiments.finding import Finding, Severity
    from rig.bench.hub import hub_of
    from rig.bench.identity import new_bench_id

    configuration = configured.configuration
    today = datetime.now(UTC).date()
    channels = {"motor encoder": configuration.motor_encoder.calibration}
    channels |= {c.channel: c.calibration for c in configuration.counters}
    channels |= {s.channel: s.certified for s in configuration.sources if s.certified is not None}
    inputs = [a for module in configuration.analog_modules for a in module.inputs]
    channels |= {a.channel: a.calibration for a in inputs}
    warnings = [
        (name, "no calibration certificate") for name, c in channels.items() if not c.certificate
    ]
    warnings += [
        (name, f"the calibration was due on {c.due}")
        for name, c in channels.items()
        if c.due and c.due < today
    ]
    if "torque" not in channels:
        warnings.append(
            ("no torque port", "the torque that the drive reports (0x6077) is all there is")
        )
    if "output_angle" not in channels:
        warnings.append(
            (
                "no output encoder",
                "kinematic error, torsion and standstill of the output cannot be seen",
            )
        )
    if configuration.guard is None:
        warnings.append(("no guard input", "arming cannot look whether the guard is closed"))
    bus = configuration.bus
    if not (configuration.bench.id or hub_of(bus.interface, bus.channel, bus.arguments)):
        warnings.append(
            ("no [bench] id", f'no run is allowed before it has one, such as "{new_bench_id()}"')
        )
    return tuple(Finding(what, Severity.WARNS, found) for what, found in warnings)


def _as_json(
    file: Path,
    problems: tuple[Finding, ...],
    warnings: tuple[Finding, ...],
    configured: ConfiguredRig | None,
) -> dict[str, Any]:
    answer: dict[str, Any] = {
        "file": str(file),
        "ok": not problems,
        "problems": [
            one.as_json()
            | {
                "path": one.what,
                "value": one.found,
                "reason": ". ".join(part for part in (one.follows, one.remedy) if part),
            }
            for one in problems
        ],
        "warnings": [warning.sentence for warning in warnings],
        "findings": [one.as_json() for one in (*problems, *warnings)],
    }
    if configured is not None:
        answer["configuration"] = configured.configuration.model_dump(mode="json", by_alias=True)
        answer["limits"] = dict(configured.limits)
    return answer


def _print(
    file: Path,
    problems: tuple[Finding, ...],
    warnings: tuple[Finding, ...],
    configured: ConfiguredRig | None,
) -> None:
    from rig.commands.findings import print_findings

    out = console()
    if problems or warnings:
        print_findings({str(file): (*problems, *warnings)})
    if configured is None:
        out.print(f"{file}: {counted(len(problems), 'problem', 'problems')}", soft_wrap=True)
        return
    rig = configured.configuration
    nodes = [f"drive {rig.drive.node_id}", *(f"{c.channel} {c.node_id}" for c in rig.counters)]
    nodes += [f"analogue inputs {m.node_id}" for m in rig.analog_modules]
    out.print(
        f"{file}: {rig.rig.name}, {rig.bus.interface} {rig.bus.channel} at {rig.bus.bit_rate / 1e6:g} Mbit/s, nodes: "
        f"{', '.join(nodes)}; {configured.gear.name} on {configured.motor.name}",
        soft_wrap=True,
    )
