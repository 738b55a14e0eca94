"""`rig sim`: the simulated rig as a process of its own, for any CANopen tool; certificates of its encoders."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from rig.bench.backends.order import MOUNTINGS, WORLD_WORDS, Order, Setup
from rig.commands.ordering import Said, with_order
from rig.commands.terminal import echo

if TYPE_CHECKING:
    from rig.bench.backends.serving import Served

sim = typer.Typer(
    name="sim",
    no_args_is_help=True,
    help="The simulated rig as a process of its own, for other programs.",
)


@sim.callback()
def _group() -> None:
    """The simulated rig as a process of its own, for other programs."""


@sim.command("serve")
@with_order(
    "serial",
    "seed",
    "world",
    "mounting",
    "gear",
    world=tuple(name for name in WORLD_WORDS if name != "start_state"),
)
def serve(
    said: Said,
    host: Annotated[str, typer.Option(metavar="ADDRESS", help="Where to listen.")] = "127.0.0.1",
    port: Annotated[
        int,
        typer.Option(min=0, max=65535, help="TCP port of the socketcand hub; 0 takes a free one."),
    ] = 29536,
    channel: Annotated[
        str, typer.Option(metavar="NAME", help="Name of the bus that clients open.")
    ] = "can0",
    readout: Annotated[
        Literal["pty", "socket", "none"],
        typer.Option(help="Where the ND 287's serial line is: a pseudo-terminal, a socket."),
    ] = "pty",
    time: Annotated[
        Literal["wall", "sync"],
        typer.Option(
            help="wall: the motor turns on while no SYNC comes; sync: it waits, and counts do not depend on speed."
        ),
    ] = "wall",
    without_gear: Annotated[bool, typer.Option("--no-gear", help="The bare motor.")] = False,
    sample_rate: Annotated[
        float,
        typer.Option(
            "--sample-rate",
            metavar="HZ",
            min=50.0,
            max=20000.0,
            help="SYNC rate that it expects [Hz].",
        ),
    ] = 250.0,
    lifetime: Annotated[
        float | None,
        typer.Option(metavar="SECONDS", min=0.0, help="End after so long; without it, on Ctrl-C."),
    ] = None,
    faults: Annotated[
        list[str] | None,
        typer.Option(
            "--fault",
            metavar="NAME@SYNC",
            help="Let a fault of `rig drill` happen at that SYNC; may be repeated.",
        ),
    ] = None,
    expose: Annotated[
        bool, typer.Option("--expose", help="Allow an address that other computers can reach.")
    ] = False,
    eds: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write the devices' EDS files here.")
    ] = None,
    config_out: Annotated[
        Path | None,
        typer.Option(
            "--config-out", metavar="FILE", help="Write the rig.toml that reaches this rig."
        ),
    ] = None,
    json: Annotated[
        bool, typer.Option("--json", help="Tell where it is as one JSON object on one line.")
    ] = False,
) -> None:
    """Serve drive, counter, analogue inputs and readout behind a socketcand hub, in real time.

    Any CANopen tool that speaks socketcand can join, this program's own drivers included (`--backend hardware` with the
    description that --config-out writes). Ctrl-C or a termination request ends it.
    """
    from model.gear_file import load_gear
    from rig.bench.backends.serving import serve_rig
    from rig.errors import ConfigurationError

    asked = {**said, "gear": load_gear(said["gear"])} if "gear" in said else said
    order = Order(protocol="serve", sample_rate=sample_rate, **asked)
    if order.mounting not in MOUNTINGS:
        raise ConfigurationError(
            "no such mounting",
            where="--mounting",
            value=repr(order.mounting),
            limit=", ".join(MOUNTINGS),
        )

    def announce(served: Served) -> None:
        echo(served.as_json() if json else _sentence(served, config_out))

    serve_rig(
        order,
        Setup(gear_mounted=not without_gear),
        host=host,
        port=port,
        channel=channel,
        readout=None if readout == "none" else readout,
        time=time,
        lifetime=lifetime,
        faults=_faults(faults or []),
        expose=expose,
        sheets=eds,
        configuration=config_out,
        announce=announce,
    )


@sim.command("certificate")
@with_order("world", world=("bench_seed", "population"))
def certificate(
    said: Said,
    output: Annotated[Path, typer.Option(metavar="FILE", help="Where to write it; a new file.")],
    channel: Annotated[
        Literal["input", "output"], typer.Option(help="The motor's encoder, or that of the output.")
    ] = "output",
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
    echo(f'{output}: name it in rig.toml, curve = "{output.name}"')


def _faults(texts: list[str]) -> list[Any]:
    """The faults that `NAME@SYNC` name. Raises `ConfigurationError` for one that there is not."""
    if not texts:
        return []
    from rig.errors import ConfigurationError
    from rig.trial.drill.catalogue import DRILLS

    on_the_wire = {
        drill.name: drill.fault
        for drill in DRILLS.values()
        if drill.fault is not None and "wire" in drill.carriers
    }
    faults = []
    for text in texts:
        name, _, cycle = text.rpartition("@")
        if name not in on_the_wire or not cycle.isdecimal():
            raise ConfigurationError(
                "no such fault on the wire",
                where="--fault",
                value=repr(text),
                limit=", ".join(on_the_wire),
                remedy="Give the name, an @ and the number of the SYNC.",
            )
        faults.append(on_the_wire[name](int(cycle)))
    return faults


def _sentence(served: Served, configuration: Path | None) -> str:
    nodes = ", ".join(
        f"{name.replace('_', ' ')} {node_id}" for name, node_id in served.nodes.items()
    )
    lines = [
        f"{served.title}: nodes {nodes}",
        f'can.Bus(interface="socketcand", host="{served.host}", port={served.port}, '
        f'channel="{served.channel}", tcp_tune=True)',
    ]
    if served.readout:
        lines.append(f'serial.serial_for_url("{served.readout}")')
    if configuration is not None:
        lines.append(f"rig run PROTOCOL --backend hardware --config {configuration}")
    return "\n".join([*lines, "Ctrl-C ends it."])
