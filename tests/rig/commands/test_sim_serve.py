"""The simulated rig as a process of its own: another CANopen stack joins, the readout answers, it
ends when it is told to.
"""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import canopen
import pytest
import serial

from drivers.bus.network import BusConfig, RawBus, open_raw_bus
from drivers.python_can import can
from drivers.readout.nd287 import LINE_LENGTH, STX, parse_line
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig import main
from rig.bench.backends.order import Order
from rig.bench.backends.serving import Served, description_of
from rig.bench.config.apply import configured_rig
from rig.bench.config.load import load_configuration
from sim_backend.population import drawn
from sim_backend.world import World
from tests.drivers.eds_files import load_eds
from tests.rig.commands.printed import every_table_has_room

WIDE = World(gear_seed=5, bench_seed=0, population="wide")
FAULT_AT = 5
"""SYNC at which the served drive sends an emergency message."""
ROOT = Path(__file__).parents[3]
PATIENCE = 600.0
"""s that an answer may take beside other programs; one that comes is not waited for."""


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Any]]:
    folder = tmp_path_factory.mktemp("served")
    options = [
        "--port",
        "0",
        "--readout",
        "socket",
        "--json",
        "--eds",
        str(folder / "eds"),
        "--lifetime",
        "7200",
    ]
    options += ["--fault", f"EMCY@{FAULT_AT}"]
    command = [
        sys.executable,
        "-m",
        "rig",
        "sim",
        "serve",
        *options,
        "--config-out",
        str(folder / "rig.toml"),
    ]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, cwd=ROOT) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        told = json.loads(process.stdout.readline())
        yield {**told, "folder": folder}
        # Somebody is still connected, and somebody else to the readout's line.
        readout = int(told["readout"].rpartition(":")[2])
        with (
            socket.create_connection((told["host"], told["port"])),
            socket.create_connection((told["host"], readout)),
        ):
            process.send_signal(signal.SIGTERM)
            assert process.wait(600.0) == 0
        assert process.stderr.read() == ""


def test_another_stack_joins_and_reads_the_identity(served: dict[str, Any]) -> None:
    bus = can.Bus(
        interface="socketcand",
        host=served["host"],
        port=served["port"],
        channel=served["channel"],
        tcp_tune=True,
    )
    network = canopen.Network()
    network.bus = bus
    network.notifier = can.Notifier(bus, network.listeners, 0.1)
    try:
        for name, node_id in served["nodes"].items():
            sheet = served["folder"] / "eds" / f"simulated-{name.replace('_', '-')}.eds"
            node: Any = network.add_node(canopen.RemoteNode(node_id, str(sheet)))
            profile = {"drive": 402, "counter": 406, "analog_input": 401}[name]
            assert node.sdo[0x1000].raw & 0xFFFF == profile
            assert node.sdo[0x1009].raw == "simulated"
    finally:
        network.notifier.stop()
        bus.shutdown()


def first_emergency(bus: RawBus) -> can.Message:
    for _ in range(500):
        message = bus.recv(PATIENCE)
        assert message is not None
        if message.arbitration_id == 0x081 and not message.is_extended_id:
            return message
    raise AssertionError("no emergency message among 500 frames")


def test_a_fault_happens_at_its_sync_and_everybody_hears_it(served: dict[str, Any]) -> None:
    where = {"host": served["host"], "port": served["port"]}
    bus = open_raw_bus(BusConfig("socketcand", served["channel"], arguments=where))
    try:
        bus.send(can.Message(arbitration_id=0x000, data=[1, 0], is_extended_id=False))
        for _ in range(FAULT_AT + 2):
            bus.send(can.Message(arbitration_id=0x080, is_extended_id=False))
        assert bytes(first_emergency(bus).data[:2]) == b"\x10\x43"
    finally:
        bus.shutdown()


def test_the_sheets_are_read_without_a_defect(served: dict[str, Any]) -> None:
    sheets = sorted((served["folder"] / "eds").glob("*.eds"))
    assert len(sheets) == 3
    for sheet in sheets:
        assert not load_eds(sheet).defects


def test_the_readout_answers_a_value(served: dict[str, Any]) -> None:
    with serial.serial_for_url(served["readout"], timeout=PATIENCE) as port:
        port.write(STX)
        assert parse_line(port.read(LINE_LENGTH)).unit == "rad"


def test_the_description_that_it_writes_is_a_configuration(served: dict[str, Any]) -> None:
    found = load_configuration(served["folder"] / "rig.toml")
    assert found.bus.arguments["port"] == served["port"]
    assert found.readout is not None
    assert found.guard is not None


def test_a_description_without_a_readout_is_one_too(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    served = Served("127.0.0.1", 1, "can0", "", {}, "")
    path.write_text(
        description_of(served, Order(protocol="", sample_rate=250.0)),
        encoding="utf-8",
    )
    assert load_configuration(path).rig.sample_rate_hz == 250.0


def test_a_gear_that_is_not_shipped_gets_a_card_beside_the_description(tmp_path: Path) -> None:
    path = tmp_path / "wide.toml"
    words = ["--population", "wide", "--gear-seed", "5", "--readout", "none", "--lifetime", "0.1"]
    with pytest.raises(SystemExit) as ended:
        main.run(["sim", "serve", "--port", "0", "--config-out", str(path), *words])
    assert ended.value.code in (0, None)
    card = configured_rig(path).gear
    assert card.name.startswith("CSF-25-")
    assert card == drawn(shipped_gear(), shipped_motor(), WIDE).card
    assert card != shipped_gear()


@pytest.mark.parametrize(
    "words",
    [
        ["--host", "0.0.0.0"],
        ["--world", "mount=0"],
        ["--world", "population=huge"],
        ["--mounting", "upside-down"],
        ["--port", "70000"],
        ["--fault", "EMCY"],
        ["--fault", "disk full@10"],
        ["--fault", "EMCY@soon"],
    ],
)
def test_what_cannot_be_served_is_refused(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as refused:
        main.run(["sim", "serve", "--lifetime", "0", *words])
    assert refused.value.code == 2
    assert words[0] in capsys.readouterr().err


def test_a_port_that_is_taken_is_said(
    served: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as refused:
        main.run(["sim", "serve", "--port", str(served["port"]), "--lifetime", "0"])
    assert refused.value.code == 6
    assert str(served["port"]) in capsys.readouterr().err


def test_a_stranger_finds_the_devices_and_a_description_that_reaches_them(
    served: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "found.toml"
    words = [
        "config",
        "discover",
        "--interface",
        "socketcand",
        "--channel",
        served["channel"],
        "--json",
    ]
    words += [
        "--argument",
        f"host={served['host']}",
        "--argument",
        f"port={served['port']}",
        "--write",
        str(path),
    ]
    with pytest.raises(SystemExit) as ended:
        main.run(words)
    told = json.loads(capsys.readouterr().out)
    assert ended.value.code == 0
    assert {node["node_id"] for node in told["nodes"]} == set(served["nodes"].values())
    assert told["written"] == str(path)
    assert len(told["questions"]) == path.read_text(encoding="utf-8").count('"SAY: ')
    with pytest.raises(SystemExit) as again:
        main.run(words)
    assert again.value.code == 2, "a file that exists is left alone"
    shown = [word for word in words[: words.index("--write")] if word != "--json"]
    with every_table_has_room(), pytest.raises(SystemExit) as looked:
        main.run(shown)
    assert looked.value.code == 0
