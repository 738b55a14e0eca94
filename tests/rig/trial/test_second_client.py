"""canopen's SDO client on the drivers' pumped bus: bytes, deadlines, bounds, and that it agrees with our own."""

from __future__ import annotations

import logging
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.bus.cia301 import U16, U32, ObjectRef
from drivers.bus.device import RemoteDevice
from drivers.bus.network import PumpedBus
from drivers.bus.sdo import SdoAbortError, SdoClient, SdoProtocolError, SdoTimeoutError
from drivers.clock import VirtualClock
from drivers.errors import DriverError
from rig.trial.doctor.bus import scan
from rig.trial.doctor.second_client import PumpedClient, SecondClient, read_again
from tests.drivers.foreign_drive import ForeignDrive
from tests.drivers.foreign_slave import Traits, Wire
from tests.drivers.scripted_bus import ScriptedBus
from tests.drivers.test_any_bytes import Babbler
from tests.rig.trial.doctor_rigs import failed, look, on_the_wire

STATUS = "602 40 41 60 00 00 00 00 00"
SEGMENT, SEGMENT_1 = "602 60 00 00 00 00 00 00 00", "602 70 00 00 00 00 00 00 00"


def client(
    *script: tuple[str, list[str]], **limits: int
) -> tuple[SecondClient, ScriptedBus, VirtualClock]:
    raw, clock = ScriptedBus(list(script)), VirtualClock()
    return SecondClient(PumpedBus(raw, clock), 2, **limits), raw, clock


@pytest.mark.parametrize(
    ("script", "data"),
    [
        ([(STATUS, ["582 4B 41 60 00 37 02 00 00"])], "37 02"),
        ([(STATUS, ["582 43 41 60 00 37 02 00 00"])], "37 02 00 00"),
        ([(STATUS, ["582 42 41 60 00 37 02 A5 A5"])], "37 02 A5 A5"),
        (
            [
                (STATUS, ["582 41 41 60 00 09 00 00 00"]),
                (SEGMENT, ["582 00 31 32 33 34 35 36 37"]),
                (SEGMENT_1, ["582 1B 38 39 00 00 00 00 00"]),
            ],
            "31 32 33 34 35 36 37 38 39",
        ),
        # An answer to another object, then one of an older segment: dropped, and waited on.
        (
            [(STATUS, ["582 4B 40 60 00 0F 00 00 00", "582 11 00 00 00 00 00 00 00",
                       "582 4B 41 60 00 37 02 00 00"])],
            "37 02",
        ),
        # The answer to the beginning once more, in the middle of the segments.
        (
            [
                (STATUS, ["582 41 41 60 00 02 00 00 00", "582 41 41 60 00 02 00 00 00"]),
                (SEGMENT, ["582 0B 31 32 00 00 00 00 00"]),
            ],
            "31 32",
        ),
    ],
)  # fmt: skip
def test_what_is_read_in_bytes(script: list[tuple[str, list[str]]], data: str) -> None:
    second, raw, _ = client(*script)
    assert second.upload(0x6041, 0) == bytes.fromhex(data)
    raw.assert_finished()


def test_a_refusal_is_a_refusal_in_words() -> None:
    second, raw, _ = client((STATUS, ["582 80 41 60 00 00 00 02 06"]))
    with pytest.raises(SdoAbortError) as refused:
        second.upload(0x6041, 0)
    assert refused.value.is_missing
    assert "node 2, 0x6041:0" in str(refused.value)
    raw.assert_finished()


def test_a_silent_node_is_given_up_at_the_deadline_of_the_clock() -> None:
    abort = "602 80 41 60 00 00 00 04 05"
    second, raw, clock = client((STATUS, []), (abort, []), deadline_ns=700_000_000)
    with pytest.raises(SdoTimeoutError):
        second.upload(0x6041, 0)
    assert clock.monotonic_ns() == 700_000_000
    raw.assert_finished()


def test_the_deadline_is_that_of_the_whole_transfer() -> None:
    """A node that answers each segment just in time would never be given up by a time-out per answer."""
    clock = VirtualClock()
    wire = Wire(clock)
    ForeignDrive(wire, Traits(segmented=True, answer_ms=299.0))
    second = SecondClient(PumpedBus(wire, clock, pump=wire.pump), 1)
    with pytest.raises(SdoTimeoutError):
        second.upload(0x1008, 0)
    assert clock.monotonic_ns() == 1_000_000_000


def test_a_late_answer_is_dropped() -> None:
    abort = "602 80 41 60 00 00 00 04 05"
    other = "602 40 64 60 00 00 00 00 00"
    second, raw, _ = client(
        (STATUS, []),
        (abort, ["582 4B 41 60 00 37 02 00 00"]),
        (other, ["582 43 64 60 00 01 00 00 00"]),
    )
    with pytest.raises(SdoTimeoutError):
        second.upload(0x6041, 0)
    assert second.upload(0x6064, 0) == b"\x01\0\0\0"
    raw.assert_finished()


def test_an_upload_without_end_is_bounded() -> None:
    class Endless(ScriptedBus):
        def send(self, msg) -> None:
            super().send(msg)
            if msg.data[0] == 0x40:
                self.feed(0x582, b"\x40" + bytes(msg.data)[1:4] + bytes(4))
            elif msg.data[0] != 0x80:
                self.feed(0x582, bytes([msg.data[0] & 0x10]) + b"endless")

    raw = Endless()
    second = SecondClient(PumpedBus(raw, VirtualClock()), 2, longest=700)
    with pytest.raises(SdoProtocolError, match="more than 700 bytes"):
        second.upload(0x6041, 0)
    assert len(raw.sent) == 103
    assert raw.sent[-1][1][:1] == b"\x80"


@pytest.mark.parametrize(
    "segment",
    [
        "582 0F 00 00 00 00 00 00 00",  # the last one, and the text is shorter than announced
        "582 0E 00 00 00 00 00 00 00",  # an empty one that is not the last: the library takes it for the end
    ],
)
def test_a_text_that_is_cut_is_not_believed(segment: str) -> None:
    second, _, _ = client((STATUS, ["582 41 41 60 00 09 00 00 00"]), (SEGMENT, [segment]))
    with pytest.raises(SdoProtocolError):
        second.upload(0x6041, 0)


@given(
    st.lists(st.tuples(st.binary(min_size=8, max_size=8), st.booleans()), min_size=1, max_size=8)
)
@settings(max_examples=300)
def test_both_clients_read_the_same_or_both_refuse(answers: list[tuple[bytes, bool]]) -> None:
    def by(make: type[SdoClient]) -> object:
        try:
            return make(PumpedBus(Babbler(answers), VirtualClock()), 2).upload(0x6041, 0)
        except DriverError:
            return None

    assert by(SecondClient) == by(SdoClient)


def test_the_devices_own_client_has_its_line_back() -> None:
    clock = VirtualClock()
    wire = Wire(clock)
    ForeignDrive(wire)
    device = RemoteDevice(PumpedBus(wire, clock, pump=wire.pump), 1)
    own, entry = device.sdo, ObjectRef(0x1017, 0, U16)
    with read_again(device):
        assert isinstance(device.sdo, SecondClient)
        assert device.read(ObjectRef(0x1000, 0, U32)) == 0x20192
    assert device.sdo is own
    device.write(entry, 100)
    assert device.read(entry) == 100


def test_a_scan_by_two_clients() -> None:
    clock = VirtualClock()
    wire = Wire(clock)
    ForeignDrive(wire)
    bus = PumpedBus(wire, clock, pump=wire.pump)
    assert scan(bus, patience_ns=10_000_000) == {1: 402}


def test_the_librarys_log_stays_off_the_terminal(capfd: pytest.CaptureFixture[str]) -> None:
    client()
    logging.getLogger("canopen.sdo.client").error("nobody asked for this")
    assert capfd.readouterr().err == ""


def test_nobody_pays_for_the_library_who_does_not_use_it() -> None:
    code = (
        "import sys; sys.argv = ['rig', '--help']\nfrom rig.main import run\n"
        "try: run()\nexcept SystemExit: pass\nassert 'canopen' not in sys.modules"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, check=False)
    assert ended.returncode == 0, ended.stderr


def test_the_doctor_reads_by_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read, upload = set[tuple[int, int, int]](), PumpedClient.upload

    def noted(client: PumpedClient, index: int, subindex: int) -> bytes:
        read.add((client.rx_cobid - 0x600, index, subindex))
        return upload(client, index, subindex)

    monkeypatch.setattr(PumpedClient, "upload", noted)
    found = look(tmp_path, on_the_wire)
    assert found.is_fine, failed(found)
    # Who every node is; of the drive its state, its option codes and its watch over the computer.
    assert {(node, 0x1018, sub) for node in (1, 2, 3) for sub in (1, 2, 3, 4)} <= read
    assert {(1, 0x6041, 0), (1, 0x6007, 0), (1, 0x605A, 0), (1, 0x1016, 1)} <= read
