"""`rig sim`: the simulated rig as a process of its own, for any CANopen tool; faults on it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from rig.bench.backends.order import MOUNTINGS, WORLD_WORDS, Order, Setup
from rig.commands.configuring import certificate
from rig.commands.drilling import drill
from rig.commands.earlier_names import moved
from rig.commands.ordering import Said, with_order
from rig.commands.terminal import echo

if TYPE_CHECKING:
    from rig.bench.backends.serving import Served

sim = typer.Typer(
    name="sim",
    no_args_is_help=True,
    help="The simulated rig: as a process of its own, for other programs; and every fault on it.",
)
sim.command("drill")(drill)
sim.command(
    "certificate",
    hidden=True,
    cls=moved("rig config certificate --world bench-seed=B --output FILE"),
)(certificate)


_Port = Annotated[
    int,
    typer.Option(min=0, max=65535, help="TCP port of the socketcand hub; 0 takes a free one."),
]

_Channel = Annotated[str, typer.Option(metavar="NAME", help="Name of the bus that clients open.")]

_Readout = Annotated[
    Literal["pty", "socket", "none"],
    typer.Option(help="Where the ND 287's serial line is: a pseudo-terminal, a socket."),
]

_Time = Annotated[
    Literal["wall", "sync"],
    typer.Option(
        help="wall: the motor turns on while no SYNC comes; sync: it waits, and counts do not depend on speed."
    ),
]

_SampleRate = Annotated[
    float,
    typer.Option(
        "--sample-rate",
        metavar="HZ",
        min=50.0,
        max=20000.0,
        help="SYNC rate that it expects [Hz].",
    ),
]

_Lifetime = Annotated[
    float | None,
    typer.Option(metavar="SECONDS", min=0.0, help="End after so long; without it, on Ctrl-C."),
]

_Faults = Annotated[
    list[str] | None,
    typer.Option(
        "--fault",
        metavar="NAME@SYNC",
        help="Let a fault of `rig sim drill` happen at that SYNC; may be repeated.",
    ),
]

_Expose = Annotated[
    bool, typer.Option("--expose", help="Allow an address that other computers can reach.")
]

_Eds = Annotated[
    Path | None, typer.Option(metavar="DIR", help="Write the devices' EDS files here.")
]

_ConfigOut = Annotated[
    Path | None,
    typer.Option("--config-out", metavar="FILE", help="Write the rig.toml that reaches this rig."),
]

_Json = Annotated[
    bool, typer.Option("--json", help="Tell where it is as one JSON object on one line.")
]


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
    port: _Port = 29536,
    channel: _Channel = "can0",
    readout: _Readout = "pty",
    time: _Time = "wall",
    without_gear: Annotated[bool, typer.Option("--no-gear", help="The bare motor.")] = False,
    sample_rate: _SampleRate = 250.0,
    lifetime: _Lifetime = None,
    faults: _Faults = None,
    expose: _Expose = False,
    eds: _Eds = None,
    config_out: _ConfigOut = None,
    json: _Json = False,
) -> None:
    """Serve drive, counter, analogue inputs and readout behind a socketcand hub, in real time.

    Any CANopen tool that speaks socketcand can join, this program's own drivers included (`--backend hardware` with the
    description that --config-out writes). Ctrl-C or a termination request ends it.
    """
    from model.gear_file import load_gear
    from rig.bench.backends.serving import serve_rig

    asked = {**said, "gear": load_gear(said["gear"])} if "gear" in said else said
    order = Order(protocol="serve", sample_rate=sample_rate, **asked)
    _refuse_unknown_mounting(order.mounting)

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


def _refuse_unknown_mounting(mounting: str) -> None:
    from rig.errors import ConfigurationError

    if mounting not in MOUNTINGS:
        raise ConfigurationError(
            "no such mounting",
            where="--mounting",
            value=repr(mounting),
            limit=", ".join(MOUNTINGS),
        )


def _faults(texts: list[str]) -> list[Any]:
    """The faults that `NAME@SYNC` name. Raises `ConfigurationError` for one that there is not."""
    if not texts:
        return []
    from rig.errors import ConfigurationError
    from rig.trial.drill.catalogue import every_drill

    on_the_wire = {
        drill.name: drill.fault
        for drill in every_drill().values()
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
