"""The simulated rig for other processes: behind a socketcand hub, its readout on a pseudo-terminal or a socket."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from model.gear_file import gear_to_toml, shipped_gear
from rig.bench.backends.order import Order, Setup
from rig.bench.backends.simulated import nameplates, parts_of
from rig.bench.hub import hub_id
from rig.content.phrase import phrase
from rig.errors import ConfigurationError
from sim_backend.faults import Fault
from sim_backend.wire.bench import ANALOG_INPUT_NODE, COUNTER_NODE, DRIVE_NODE, WireBench
from sim_backend.wire.eds import electronic_data_sheet
from sim_backend.wire.serve import Addresses, ReadoutLine, TimeSource, make_bench, serve

_LOOPBACK = frozenset({"127.0.0.1", "::1", "localhost"})
_NODES = {"drive": DRIVE_NODE, "counter": COUNTER_NODE, "analog_input": ANALOG_INPUT_NODE}
"""The node-IDs of the simulated devices."""
SHIPPED = "csf-25-120"
"""The gear that the program brings along."""


@dataclass(frozen=True)
class Served:
    """What is offered to other processes, as one JSON object tells it."""

    host: str
    port: int
    channel: str
    readout: str
    nodes: dict[str, int]
    title: str

    def as_json(self) -> str:
        """One line."""
        return json.dumps(asdict(self))


def serve_rig(
    order: Order,
    setup: Setup,
    *,
    host: str = "127.0.0.1",
    port: int = 29536,
    channel: str = "can0",
    readout: ReadoutLine | None = "pty",
    time: TimeSource = "wall",
    lifetime: float | None = None,
    faults: Sequence[Fault] = (),
    expose: bool = False,
    sheets: Path | None = None,
    configuration: Path | None = None,
    announce: Callable[[Served], None] = lambda served: None,
) -> None:
    """Serve the simulated rig of an order until the process is interrupted, or for `lifetime` [s].

    The gear, the motor and the noise are those of `--backend wire` with the same order. `faults`
    happen at the SYNC that they name. `sheets` is a folder for the devices' EDS files,
    `configuration` a file for the description that reaches this rig. Raises `ConfigurationError`
    for an address that is not this computer's own, unless `expose` allows it, and `DriverError` for
    a port that is taken.
    """
    _refuse_other_computers(host, expose)
    bench = make_bench(**parts_of(order, setup), time=time, faults=faults)
    if sheets is not None:
        _write_sheets(bench, sheets)

    def served_at(addresses: Addresses) -> None:
        place = (addresses.host, addresses.port, addresses.channel, addresses.readout)
        served = Served(*place, _NODES, bench.title)
        if configuration is not None:
            gear = _gear_beside(configuration, order)
            _write(configuration, description_of(served, order, gear))
        announce(served)

    serve(
        bench,
        host=host,
        port=port,
        channel=channel,
        readout=readout,
        announce=served_at,
        lifetime=lifetime,
    )


def _refuse_other_computers(host: str, expose: bool) -> None:
    if host not in _LOOPBACK and not expose:
        raise ConfigurationError(
            "would let other computers command the simulated rig",
            where="--host",
            value=host,
            limit=", ".join(sorted(_LOOPBACK)),
            remedy="Add --expose if that is wanted: the hub asks nobody who they are.",
        )


def _write_sheets(bench: WireBench, folder: Path) -> tuple[Path, ...]:
    """The EDS of every device, made from what it really has."""
    written = []
    for name, slave in (
        ("drive", bench.drive),
        ("counter", bench.counter),
        ("analog-input", bench.analog_input),
    ):
        path = folder / f"simulated-{name}.eds"
        _write(
            path,
            electronic_data_sheet(
                slave.dictionary, product=f"simulated {name}", vendor="nobody", vendor_number=0
            ),
        )
        written.append(path)
    return tuple(written)


def _gear_beside(configuration: Path, order: Order) -> str:
    """What a configuration calls the card of the served gear: one that is not shipped gets a file of its own."""
    card, _ = nameplates(order)
    if card == shipped_gear():
        return SHIPPED
    path = configuration.with_name(f"{configuration.stem}-gear.toml")
    _write(path, gear_to_toml(card))
    return path.name


def description_of(served: Served, order: Order, gear: str = SHIPPED) -> str:
    """A `rig.toml` that reaches the served rig; `gear` is the card, as such a file names it."""
    template = (
        resources.files("rig.bench.config").joinpath("served.toml").read_text(encoding="utf-8")
    )
    readout = phrase('\n[readout]\nurl = "{}"\nbaud_rate = 115200\n', served.readout)
    values: dict[str, Any] = {
        "host": served.host,
        "port": served.port,
        "channel": served.channel,
        # A hub is the bench at its address: served there again, it is the same one.
        "bench": hub_id(served.host, served.port, served.channel),
        "gear": gear,
        "rate": f"{order.sample_rate:g}",
        "drive": DRIVE_NODE,
        "counter": COUNTER_NODE,
        "module": ANALOG_INPUT_NODE,
        "readout": readout,
    }
    for name, value in values.items():
        template = template.replace(f"<{name}>", str(value))
    return template


def _write(path: Path, text: str) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        # A reader that waits for the file finds all of it or nothing.
        beside = path.with_name(path.name + ".part")
        beside.write_text(text, encoding="utf-8")
        beside.replace(path)
    except OSError as error:
        raise ConfigurationError(
            f"cannot be written: {error.strerror or error}", where=str(path)
        ) from error
