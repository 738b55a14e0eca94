"""The simulated readout, character by character, and read by the real driver."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.clock import VirtualClock
from drivers.errors import BusLostError, DecodeError, StaleDataError
from drivers.readout.nd287 import Readout as ReadoutDriver
from drivers.readout.nd287 import ReadoutConfig, parse_line
from sim_backend.wire.faults import (
    ReadoutEncoderFault,
    ReadoutGarbage,
    ReadoutHalfLine,
    ReadoutSilent,
)
from sim_backend.wire.readout import Readout
from tests.sim_backend.wire.rigs import turn, wire_rig

DEGREE = math.pi / 180.0
LINES = (
    (Readout(lambda: -5.23 * DEGREE, decimals=2), b"-      5.23 G=A\r\n"),
    (Readout(lambda: 123.45678 * DEGREE), b"+ 123.45678 G=A\r\n"),
    (Readout(lambda: -1e-9), b"+   0.00000 G=A\r\n"),
    (Readout(lambda: 360.0 * 7 * DEGREE + 1.0 * DEGREE, decimals=3), b"+     1.000 G=A\r\n"),
    (Readout(lambda: 1.5, unit="rad", decimals=4), b"+    1.5000 R=A\r\n"),
    (Readout(lambda: (12 + 34 / 60 + 56 / 3600) * DEGREE, unit="dms"), b"+  12.34.56 M=A\r\n"),
    (Readout(lambda: 0.0, has_fault=True), b"            ??A\r\n"),
    (Readout(lambda: 0.0, decimals=1, blank_lines=2), b"+       0.0 G=A\r\n\r\n\r\n"),
)


@pytest.mark.parametrize(("device", "line"), LINES)
def test_the_measured_value_line(device: Readout, line: bytes) -> None:
    assert device.receive(b"\x02") == line
    assert len(line.rstrip(b"\r\n")) == 15


@pytest.mark.parametrize(
    ("request_", "answer"),
    [
        (b"\x1bA0000\r", b"\x02ND-287    \r\n646118-01 \r\nV1-01     \r\n"),
        (b"\x1bA0100\r", b"\x02+  10.50000\r\n"),
        (b"\x1bA0200\r", b"\x02+001050000\r\n"),
        (b"\x1bT0100\r", b"\x06"),
        (b"\x1bF0000\r", b"\x06"),
        (b"\x1bS0000\r", b"\x06"),
        (b"\x1bX0000\r", b"\x15"),
        (b"\x1bA9999\r", b"\x15"),
        (b"\x1bT12\r", b"\x15"),
        (b"\x1bT00000000000", b"\x15"),
        (b"\x05", b"\r\n"),
        (b"hello\r\n", b""),
    ],
)
def test_commands(request_: bytes, answer: bytes) -> None:
    device = Readout(lambda: 10.5 * DEGREE)
    assert device.receive(request_) == answer


def test_commands_in_pieces_and_held_answers() -> None:
    device = Readout(lambda: 0.0)
    assert device.receive(b"\x1bT0") == b""
    assert device.receive(b"000\r") == b"\x06"
    assert device.receive(b"\x13\x02") == b""
    assert device.receive(b"\x11").endswith(b"\r\n")


@given(st.binary(max_size=60), st.floats(-1e4, 1e4), st.sampled_from(["deg", "dms", "rad"]))
def test_any_bytes_are_survived_and_every_line_is_read_back(
    noise: bytes, angle: float, unit: str
) -> None:
    device = Readout(lambda: angle, unit=unit)
    device.receive(noise)
    device.receive(b"\r\x11")
    reading = parse_line(device.receive(b"\x02"))
    assert not reading.is_fault
    assert abs(reading.value - math.fmod(angle, 2 * math.pi)) <= reading.quantum * 0.51


def test_the_driver_reads_the_output_encoder_over_the_line() -> None:
    with wire_rig() as made:
        block = turn(made.port, 600.0, 200)
        driver = ReadoutDriver(made.bench.serial(), made.clock, ReadoutConfig(url="simulated"))
        index = [c.name for c in made.port.channels].index("output_angle")
        expected = math.fmod(
            made.port.channels[index].scale * int(block.counts[-1, index]), 2 * math.pi
        )
        assert driver.read().value == pytest.approx(expected, abs=1e-5 * DEGREE)
        assert driver.identification()[0] == "ND-287"


@pytest.mark.parametrize(
    ("fault", "error"),
    [
        (ReadoutGarbage(0), DecodeError),
        (ReadoutHalfLine(0), DecodeError),
        (ReadoutSilent(0), StaleDataError),
    ],
)
def test_faults_of_the_line_are_seen_by_the_driver(fault, error: type[Exception]) -> None:
    with wire_rig(faults=(fault,), is_open=False) as made:
        driver = ReadoutDriver(made.bench.serial(), VirtualClock(), ReadoutConfig(url="simulated"))
        with pytest.raises(error):
            driver.read()


def test_an_encoder_fault_and_a_closed_line() -> None:
    with wire_rig(faults=(ReadoutEncoderFault(0),), is_open=False) as made:
        line = made.bench.serial()
        driver = ReadoutDriver(line, VirtualClock(), ReadoutConfig(url="simulated"))
        assert driver.read().is_fault
        line.close()
        with pytest.raises(BusLostError):
            line.write(b"\x02")
