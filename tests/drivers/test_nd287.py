"""The ND 287's lines and commands, byte for byte, and any bytes at all."""

from __future__ import annotations

import math
import os
from collections import deque

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.clock import VirtualClock, WallClock
from drivers.errors import BusLostError, DecodeError, DriverError, StaleDataError
from drivers.readout.nd287 import Readout, ReadoutConfig, open_port, parse_line


class ScriptedPort:
    """A serial line with a script: what must be written, and the bytes that answer it."""

    def __init__(self, *script: tuple[bytes, bytes]) -> None:
        self.script = deque(script)
        self.buffer = b""

    def write(self, b: bytes) -> int:
        expected, answer = self.script.popleft()
        assert bytes(b) == expected
        self.buffer += answer
        return len(b)

    def read(self, size: int = 1) -> bytes:
        data, self.buffer = self.buffer[:size], self.buffer[size:]
        return data

    def reset_input_buffer(self) -> None:
        self.buffer = b""

    def close(self) -> None:
        return


def readout(*script: tuple[bytes, bytes]) -> tuple[ScriptedPort, VirtualClock, Readout]:
    port, clock = ScriptedPort(*script), VirtualClock(1_000)
    return port, clock, Readout(port, clock, ReadoutConfig(url="scripted"))


def test_the_manuals_example() -> None:
    reading = parse_line(b"-      5.23  =A\r\n")
    assert reading.value == pytest.approx(-5.23e-3, abs=1e-12)
    assert (reading.unit, reading.sorting, reading.mode, reading.is_fault) == ("m", "=", "A", False)
    assert reading.quantum == pytest.approx(1e-5)


@pytest.mark.parametrize(
    ("line", "value", "unit"),
    [
        (b"+  359.9995 G  \r\n", math.radians(359.9995), "rad"),
        (b"   12.30.45 M=1\r\n", math.radians(12 + 30 / 60 + 45 / 3600), "rad"),
        (b"-   12.3045 M  \r\n", -math.radians(12 + 30 / 60 + 45 / 3600), "rad"),
        (b"+  1.234567 R  \r\n", 1.234567, "rad"),
        (b'+     1.000 "  \r\n', 0.0254, "m"),
        (b"+      60.0 U<S\r\n", 2 * math.pi, "rad/s"),
        (b"-      60.0 m  \r\n", -1e-3, "m/s"),
    ],
)
def test_units(line: bytes, value: float, unit: str) -> None:
    reading = parse_line(line)
    assert reading.value == pytest.approx(value, rel=1e-12)
    assert reading.unit == unit


def test_a_fault_is_marked_and_has_no_value() -> None:
    for line in (b"+      0.00 ?  \r\n", b"+      0.00 G? \r\n", b"            ?  \r\n"):
        reading = parse_line(line)
        assert reading.is_fault
        assert math.isnan(reading.value)


@pytest.mark.parametrize(
    "line",
    [
        b"",
        b"\r\n",
        b"+      5.23  =A",
        b"+     5.23  =A\r\n",
        b"+     5.2.3  =A\r\n",
        b"+      5.23 X=A\r\n",
        b"*      5.23  =A\r\n",
        b"+      5.23  =Q\r\n",
        b"+      5 23  =A\r\n",
        b"+\xb5     5.23  =A\r\n",
        b"   12.61.45 M=1\r\n",
        b"+            G  \r\n",
    ],
)
def test_garbled_lines_are_refused(line: bytes) -> None:
    with pytest.raises(DecodeError):
        parse_line(line)


@given(
    st.one_of(
        st.binary(max_size=24), st.binary(min_size=15, max_size=15).map(lambda b: b + b"\r\n")
    )
)
def test_any_bytes_are_a_reading_or_a_decode_error(line: bytes) -> None:
    try:
        reading = parse_line(line)
    except DecodeError:
        return
    assert math.isfinite(reading.value) != reading.is_fault


@given(st.integers(-(10**8), 10**8))
def test_every_value_that_fits_comes_back(ten_thousandths: int) -> None:
    number = f"{abs(ten_thousandths) / 1e4:.4f}".rjust(10)
    line = f"{'-' if ten_thousandths < 0 else '+'}{number} G  \r\n".encode()
    assert round(math.degrees(parse_line(line).value) * 1e4) == ten_thousandths


def test_a_reading_is_dated_half_the_storage_delay_after_the_request() -> None:
    port, _, device = readout((b"\x02", b"\r\n\r\n+  180.0000 G  \r\n"))
    port.buffer = b"half a lin"  # of before: not believed
    reading = device.read()
    assert reading.value == pytest.approx(math.pi)
    assert reading.time_ns == 1_000 + 500_000


def test_silence_half_lines_and_garbage() -> None:
    _, clock, device = readout((b"\x02", b""))
    with pytest.raises(StaleDataError, match="does not answer"):
        device.read()
    assert clock.monotonic_ns() == 500_000_000
    _, _, device = readout((b"\x02", b"+  180.00"))
    with pytest.raises(DecodeError, match="half a line"):
        device.read()
    _, _, device = readout((b"\x02", b"x" * 1000))
    with pytest.raises(DecodeError, match="does not end"):
        device.read()
    _, _, device = readout((b"\x02", b"\r\n" * 99 + b"+  180.0000 G  \r\n"))
    assert device.read().value == pytest.approx(math.pi)
    # A line that says CR LF for ever was listened to for ever.
    port, _, device = readout((b"\x02", b""))
    port.read = lambda size=1: b"\n"  # type: ignore[method-assign]
    with pytest.raises(DecodeError, match="nothing but empty lines"):
        device.read()


def test_commands() -> None:
    _, _, device = readout(
        (b"\x1bA0000\r", b"\x02ND-287    \r\n646118-01 \r\nV1-01     \r\n"),
        (b"\x1bF0000\r", b"\x06"),
        (b"\x1bT0105\r", b"\x15"),
        (b"\x1bA0100\r", b"\x15"),
        (b"\x1bS0001\r", b"?"),
        (b"\x1bS0002\r", b""),
    )
    assert device.identification() == ["ND-287", "646118-01", "V1-01"]
    device.key("F0000")
    with pytest.raises(DriverError, match="NAK"):
        device.key("T0105")
    with pytest.raises(DriverError, match="NAK"):
        device.screen("A0100")
    with pytest.raises(DecodeError, match="neither ACK nor NAK"):
        device.key("S0001")
    with pytest.raises(StaleDataError):
        device.key("S0002")
    with pytest.raises(DriverError, match="not a command"):
        device.key("S1")


@given(st.binary(max_size=60))
def test_any_answer_is_a_reading_or_a_driver_error(answer: bytes) -> None:
    for ask in (
        Readout.read,
        Readout.identification,
        lambda r: r.key("T0000"),
    ):
        port, _, device = readout()
        port.write = lambda b, p=port: setattr(p, "buffer", p.buffer + answer) or len(b)  # type: ignore[method-assign]
        try:
            ask(device)
        except DriverError:
            continue


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs a pseudo terminal")
def test_over_a_pseudo_terminal_without_modem_lines() -> None:
    import tty

    master, slave = os.openpty()
    tty.setraw(master)
    tty.setraw(slave)
    port = open_port(ReadoutConfig(url=os.ttyname(slave), baud=115200))
    try:
        device = Readout(port, WallClock(), ReadoutConfig(url="pty"))
        original = port.write

        def write_and_answer(data: bytes) -> int | None:
            written = original(data)
            assert os.read(master, 16) == b"\x02"
            os.write(master, b"+  359.9995 G  \r\n")
            return written

        port.write = write_and_answer  # type: ignore[method-assign]
        assert device.read().value == pytest.approx(math.radians(359.9995))
    finally:
        device.close()
        os.close(slave)
        os.close(master)


def test_a_line_that_is_not_there() -> None:
    with pytest.raises(BusLostError, match="cannot be opened"):
        open_port(ReadoutConfig(url="/dev/no-such-line"))
    with pytest.raises(DriverError, match="cannot be set"):
        open_port(ReadoutConfig(url="loop://", parity="Q"))
