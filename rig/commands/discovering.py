"""`rig config discover`: from an unknown bus to a description, by listening and asking alone."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rig.commands.terminal import Json, console, echo, painted, print_json
from rig.content.phrase import phrase

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rig.content.grid import Grid
    from rig.trial.doctor.discover.proposal import Bus, FoundNode, Proposal


_Interface = Annotated[
    str,
    typer.Option(help="As python-can names it: socketcan, pcan, kvaser, slcan, socketcand, ..."),
]

_BitRate = Annotated[
    int,
    typer.Option(
        min=0,
        metavar="BIT/S",
        help="Bit rate of the bus; 0: found by listening, where the interface can listen without disturbing "
        "(slcan, kvaser). socketcan and socketcand have their own: 1000000 is written where none is given.",
    ),
]

_Argument = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME=VALUE",
        help="Handed to python-can, such as host=127.0.0.1 and port=29536.",
    ),
]

_Write = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE", help="Write the description here; a file that exists is left alone."
    ),
]


def discover(
    interface: _Interface = "socketcan",
    channel: Annotated[str, typer.Option(help="The channel of the interface.")] = "can0",
    bit_rate: _BitRate = 0,
    argument: _Argument = None,
    write: _Write = None,
    json: Json = False,
) -> None:
    """Find out who is on a bus and propose a description of the rig; what only a person knows is marked in it.

    Nothing is changed: no NMT command, no SYNC, no write, uploads alone. It is refused where another master, a SYNC or
    a drive with power is heard, and while another process has the bench. Exit code 0 when nodes were found, 6 when
    none answers.
    """
    from rig import exits
    from rig.bench.identity import new_bench_id
    from rig.trial.doctor.discover.ask import ask_bus
    from rig.trial.doctor.discover.description import description
    from rig.trial.doctor.discover.proposal import propose

    arguments = dict(map(_argument, argument or []))
    if write is not None:
        _refuse_existing(write)
    bus, nodes = ask_bus(interface, channel, arguments, bit_rate, _progress(silent=json))
    proposal = propose(nodes, bus, new_bench_id())
    if write is not None and nodes:
        with write.open("x", encoding="utf-8") as out:
            out.write(description(proposal))
    if json:
        print_json(_as_json(nodes, proposal, bus, write if nodes else None))
    else:
        _print(nodes, proposal, bus, write)
    raise typer.Exit(exits.code_of_check(bool(nodes)))


def _argument(text: str) -> tuple[str, str | int]:
    from rig.errors import ConfigurationError

    name, equals, value = text.partition("=")
    if not (name and equals):
        raise ConfigurationError(
            "is no argument", where="--argument", value=repr(text), limit="NAME=VALUE"
        )
    return name, int(value) if value.isdigit() else value


def _refuse_existing(path: Path) -> None:
    from rig.errors import ConfigurationError

    if path.exists():
        raise ConfigurationError(
            "exists already and is left alone", where=str(path), remedy="Name another file."
        )


def _progress(*, silent: bool) -> Any:
    """Tells stages on standard error, each once, and the node-IDs in quarters with the time left."""
    import time

    begun: dict[str, float] = {}

    def tell(what: str, done: int, of: int) -> None:
        first = what not in begun
        since = begun.setdefault(what, time.monotonic())
        if silent or not (first or done % max(of // 4, 1) == 0):
            return
        spent = time.monotonic() - since
        left = f", {spent / done * (of - done):.1f} s left" if done and spent else ""
        echo(f"{what}: {done} of {of}{left}", errors=True)

    return tell


def _as_json(
    nodes: Sequence[FoundNode], proposal: Proposal, bus: Bus, written: Path | None
) -> dict[str, Any]:
    from dataclasses import asdict

    from rig.trial.doctor.discover.proposal import role_of

    return {
        "bus": asdict(bus) | {"arguments": dict(bus.arguments)},
        "nodes": [
            {**asdict(node), "role": role_of(node), "refused": list(node.refused)} for node in nodes
        ],
        "sample_rate_hz": proposal.rate,
        "refused": list(proposal.refused),
        "questions": [{"word": word, "asks": asks} for word, asks in proposal.questions],
        "written": written or "",
    }


def _print(nodes: Sequence[FoundNode], proposal: Proposal, bus: Bus, write: Path | None) -> None:
    from rig.content.grid import Grid, columns
    from rig.trial.doctor.discover.proposal import role_of

    out = console()
    if not nodes:
        out.print(
            f"Nobody answers on {bus.interface} {bus.channel} at {bus.bit_rate} bit/s: is the bit rate that of the "
            "devices, the bus terminated at both ends, and the supply on?",
            soft_wrap=True,
        )
        return
    rows = [
        (
            str(node.node_id),
            node.identity.name,
            f"0x{node.identity.vendor_id:X}",
            f"0x{node.identity.product_code:X}",
            role_of(node),
            "; ".join(node.refused),
        )
        for node in nodes
    ]
    heads = columns("node", "name", "vendor", "product", "role", "refused")
    out.print(painted(Grid("Nodes that answer", heads, rows)))
    out.print(painted(_rates(len(nodes))))
    for word, asks in proposal.questions:
        out.print(f"to be said: {word}: {asks}", soft_wrap=True, markup=False)
    done = "Nothing is written: --write rig.toml does."
    if write:
        done = (
            f"{write} is written; fill in what begins with SAY:, then `rig config check {write}`."
        )
    out.print(done, soft_wrap=True)


def _rates(nodes: int) -> Grid:
    """Which SYNC rate a bus carries: nodes by bit rate."""
    from rig.content.grid import Grid, number_columns
    from rig.trial.doctor.discover.ask import RATES_SHOWN, rates_of

    rows = []
    for count in sorted({1, 2, 3, 4, nodes}):
        found = rates_of(count)
        rows.append((str(count), *(phrase("{:g}", rate) or "none" for rate in found.values())))
    heads = number_columns("nodes", *(f"{rate // 1000} kbit/s" for rate in RATES_SHOWN))
    return Grid("SYNC rate that the bus carries [Hz]", heads, rows)
