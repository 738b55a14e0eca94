"""A HEIDENHAIN ND 287 readout on a serial line: asked by STX, answered by one line of 17 characters.

    sign(1) number(10) blank(1) unit(1) class(1) mode(1) CR LF

For stop-and-read work and checks: 20 to 50 readings per second. The value is latched within t1
after the STX, so its time is that of the request plus t1/2, never that of the arrival. One string
names the line: a device, a pty, `socket://host:port`.
"""

from __future__ import annotations

import errno
import math
import re
from dataclasses import dataclass, replace
from typing import Final, Protocol

import serial

try:
    import termios
except ImportError:  # not a POSIX system
    termios = None

from drivers.clock import Clock
from drivers.errors import BusLostError, DecodeError, DriverError, StaleDataError

STX, ACK, NAK, ESC = b"\x02", b"\x06", b"\x15", b"\x1b"
LINE_LENGTH: Final = 17
_MS: Final = 1_000_000
_TERMIOS_ERROR: type[Exception] = OSError if termios is None else vars(termios)["error"]
LINE_ERRORS: tuple[type[Exception], ...] = (serial.SerialException, OSError, _TERMIOS_ERROR)
_LONGEST_ANSWER: Final = 256
_MOST_EMPTY_LINES: Final = 200
"""The output tail can be set to 99 empty lines."""
_NUMBER = re.compile(r"^ *(\d+(?:\.\d*)?|\.\d+)$")
_SEPARATED = re.compile(r"^ *(\d+)[.:°'\" ](\d{1,2})[.:'\" ](\d{1,2})(?:[.,\"](\d*))?$")
_PACKED = re.compile(r"^ *(\d+)\.(\d{2})(\d{2})(\d*)$")

UNITS: Final[dict[str, tuple[str, float]]] = {
    " ": ("m", 1e-3),
    '"': ("m", 25.4e-3),
    "G": ("rad", math.pi / 180.0),
    "M": ("rad", math.pi / 180.0),
    "R": ("rad", 1.0),
    "m": ("m/s", 1e-3 / 60.0),
    "i": ("m/s", 25.4e-3 / 60.0),
    "U": ("rad/s", 2.0 * math.pi / 60.0),
}
"""Unit character: SI unit and factor. Blank is mm, G degrees, M degrees-minutes-seconds, U revolutions per minute."""
_CLASSES: Final = frozenset("<=>? ")
MODES: Final = frozenset("SAGD12F ")


@dataclass(frozen=True, kw_only=True)
class Reading:
    """One measured value in SI; NaN with `is_fault` when the readout itself says that it is none (`?`).

    `quantum` is the value of its last decimal in SI; `sorting` < = >; `mode` as the readout sends it; `time_ns` the
    instant at which it was latched, by the clock's calendar.
    """

    value: float
    unit: str
    quantum: float
    sorting: str
    mode: str
    is_fault: bool
    time_ns: int = 0


def parse_line(line: bytes) -> Reading:
    """The reading in a line of 17 characters. Raises `DecodeError` for everything else."""
    if len(line) != LINE_LENGTH or not line.endswith(b"\r\n"):
        raise DecodeError(
            "not a measured-value line",
            where="ND 287",
            value=_shown(line),
            limit=f"{LINE_LENGTH} characters with CR LF",
        )
    if any(byte > 0x7E or byte < 0x20 for byte in line[:15]):
        raise DecodeError(
            "characters that are not ASCII",
            where="ND 287",
            value=_shown(line),
            remedy="Check data bits and parity (7E2 or 8N1) on both sides.",
        )
    text = line[:15].decode("ascii")
    sign, number, blank, unit, sorting, mode = (
        text[0],
        text[1:11],
        text[11],
        text[12],
        text[13],
        text[14],
    )
    if sign not in "+- " or blank != " " or sorting not in _CLASSES or mode not in MODES:
        raise DecodeError(
            "a character stands in the wrong column", where="ND 287", value=_shown(line)
        )
    if unit == "?" or sorting == "?":
        return Reading(
            value=math.nan,
            unit=UNITS.get(unit, ("", 0.0))[0],
            quantum=math.nan,
            sorting=sorting,
            mode=mode,
            is_fault=True,
        )
    if unit not in UNITS:
        raise DecodeError("unknown unit", where="ND 287", value=repr(unit), limit=" ".join(UNITS))
    si, factor = UNITS[unit]
    value, last = _sexagesimal(number, line) if unit == "M" else _decimal(number, line)
    return Reading(
        value=(-value if sign == "-" else value) * factor,
        unit=si,
        quantum=last * factor,
        sorting=sorting,
        mode=mode,
        is_fault=False,
    )


def _decimal(number: str, line: bytes) -> tuple[float, float]:
    """A number with leading blanks, and the value of its last decimal."""
    match = _NUMBER.match(number)
    if match is None:
        raise DecodeError("not a number", where="ND 287", value=_shown(line))
    digits = match[1]
    decimals = len(digits) - digits.index(".") - 1 if "." in digits else 0
    return float(digits), 10.0**-decimals


def _sexagesimal(number: str, line: bytes) -> tuple[float, float]:
    """Degrees, minutes and seconds, separated (123.45.06) or packed behind the point (123.4506),
    and the last digit's value.
    """
    match = _SEPARATED.match(number) or _PACKED.match(number)
    if match is None or int(match[2]) > 59 or int(match[3]) > 59:
        raise DecodeError("not degrees, minutes and seconds", where="ND 287", value=_shown(line))
    fraction = match[4] or ""
    seconds = int(match[3]) + (int(fraction) / 10 ** len(fraction) if fraction else 0.0)
    return int(match[1]) + int(match[2]) / 60.0 + seconds / 3600.0, 10.0 ** -len(fraction) / 3600.0


def _shown(line: bytes) -> str:
    return repr(line[:40])


class SerialPort(Protocol):
    """The part of pyserial's port that is used."""

    def write(self, b: bytes, /) -> int | None: ...

    def read(self, size: int = 1, /) -> bytes: ...

    def reset_input_buffer(self) -> None: ...

    def close(self) -> None: ...


@dataclass(frozen=True, kw_only=True)
class ReadoutConfig:
    """The serial line: URL for `serial_for_url`, rate, framing as set in the readout's INTERFACE SETTINGS, delays.

    `storage_delay_ms` is t1, within which the value is latched; `answer_ms` how long an answer may
    take; `silence_ms` how much of the line's quiet ends an answer of several lines.
    """

    url: str
    baud: int = 9600
    data_bits: int = 7
    parity: str = "E"
    stop_bits: float = 2
    xon_xoff: bool = False
    storage_delay_ms: float = 1.0
    answer_ms: float = 500.0
    silence_ms: float = 100.0


def open_port(config: ReadoutConfig, *, waits: bool = True) -> SerialPort:
    """Open the line; `waits`: a read waits 10 ms for its bytes.

    Raises `BusLostError` when it is not there, `DriverError` for settings that cannot be."""
    try:
        try:
            return _opened(config, waits)
        except LINE_ERRORS as error:
            if error.args[:1] != (errno.EINVAL,):
                raise
            # A pseudo-terminal keeps neither parity nor data bits, and refuses settings of which
            # nothing else is new, as when it is opened a second time: with other stop bits in
            # between there is something new.
            other = serial.STOPBITS_ONE
            if config.stop_bits == serial.STOPBITS_ONE:
                other = serial.STOPBITS_TWO
            _opened(replace(config, data_bits=8, parity="N", stop_bits=other), waits).close()
            return _opened(config, waits)
    except ValueError as error:
        raise DriverError(f"the serial line cannot be set so: {error}", where=config.url) from error
    except LINE_ERRORS as error:
        raise BusLostError(
            f"the serial line cannot be opened: {error}",
            where=config.url,
            remedy="Check the device's name, its permissions, and that no other program has it open.",
        ) from error


def _opened(config: ReadoutConfig, waits: bool) -> SerialPort:
    return serial.serial_for_url(
        config.url,
        baudrate=config.baud,
        bytesize=config.data_bits,
        parity=config.parity,
        stopbits=config.stop_bits,
        xonxoff=config.xon_xoff,
        timeout=0.01 if waits else 0.0,
        write_timeout=1.0,
    )


class Readout:
    """The readout on an open port. Every request empties the line first: half lines of before are not believed."""

    def __init__(self, port: SerialPort, clock: Clock, config: ReadoutConfig) -> None:
        self._port, self._clock, self._config = port, clock, config

    def read(self) -> Reading:
        """Ask for the measured value. Raises `StaleDataError` without an answer, `DecodeError` for a garbled one."""
        self._flush()
        asked = self._clock.calendar_ns()
        self._send(STX)
        line = self._line(self._deadline(self._config.answer_ms))
        reading = parse_line(line)
        latched = asked + round(self._config.storage_delay_ms * _MS / 2.0)
        return Reading(
            value=reading.value,
            unit=reading.unit,
            quantum=reading.quantum,
            sorting=reading.sorting,
            mode=reading.mode,
            is_fault=reading.is_fault,
            time_ns=latched,
        )

    def identification(self) -> list[str]:
        """What the readout calls itself (A0000): name, part number, software version."""
        return self.screen("A0000", lines=3)

    def screen(self, command: str, lines: int = 1) -> list[str]:
        """Ask for screen contents (ESC Axxxx CR): STX, text, CR LF. Raises `DriverError` when it answers NAK."""
        self._command(command)
        deadline = self._deadline(self._config.answer_ms)
        answer = [_text(self._line(deadline, starts_with=STX))]
        while len(answer) < lines:
            try:
                answer.append(_text(self._line(self._deadline(self._config.silence_ms))))
            except StaleDataError:
                break
        return answer

    def key(self, command: str) -> None:
        """Press a key or run a function (ESC Txxxx, Fxxxx or Sxxxx CR): ACK or NAK. Raises
        `DriverError` when refused.
        """
        self._command(command)
        answer = self._take(1, self._deadline(self._config.answer_ms))
        if answer == ACK:
            return
        if answer == NAK:
            raise self._refused(command)
        if not answer:
            raise self._silent()
        raise DecodeError("neither ACK nor NAK", where=self._config.url, value=_shown(answer))

    def close(self) -> None:
        """Release the line; never raises because it is already gone."""
        try:
            self._port.close()
        except LINE_ERRORS:
            return

    # --- inside

    def _command(self, command: str) -> None:
        if not re.fullmatch(r"[A-Z]\d{4}", command):
            raise DriverError(
                "not a command of the readout",
                where=self._config.url,
                value=command,
                limit="letter, 4 digits",
            )
        self._flush()
        self._send(ESC + command.encode("ascii") + b"\r")

    def _line(self, deadline_ns: int, starts_with: bytes = b"") -> bytes:
        """The next line that is not empty, with its CR LF; after `starts_with`, where it must begin so."""
        data, empty = b"", 0
        while True:
            data += self._take(1, deadline_ns) or self._raise_silent(data)
            if starts_with and data == NAK:
                raise self._refused("this output")
            if data in (b"\r\n", b"\n"):
                # The output tail of the answer before.
                data, empty = b"", empty + 1
                if empty > _MOST_EMPTY_LINES:
                    raise DecodeError(
                        "nothing but empty lines", where=self._config.url, value=empty
                    )
            elif data.endswith(b"\r\n"):
                break
            elif len(data) >= _LONGEST_ANSWER:
                raise DecodeError("a line does not end", where=self._config.url, value=_shown(data))
        if starts_with:
            if not data.startswith(starts_with):
                raise DecodeError(
                    "the answer does not begin with STX", where=self._config.url, value=_shown(data)
                )
            data = data[len(starts_with) :]
        return data

    def _take(self, count: int, deadline_ns: int) -> bytes:
        """`count` bytes, or nothing when the deadline passes."""
        while True:
            try:
                data = self._port.read(count)
            except LINE_ERRORS as error:
                raise self._gone(error) from error
            if data:
                return bytes(data)
            now = self._clock.monotonic_ns()
            if now >= deadline_ns:
                return b""
            # Real time has passed in `read`; a virtual clock moves here.
            self._clock.wait_until_ns(min(deadline_ns, now + 10 * _MS))

    def _raise_silent(self, data: bytes) -> bytes:
        if data:
            raise DecodeError(
                "half a line", where=self._config.url, value=_shown(data), limit="a line with CR LF"
            )
        raise self._silent()

    def _silent(self) -> StaleDataError:
        return StaleDataError(
            "the readout does not answer",
            where=self._config.url,
            limit=f"within {self._config.answer_ms:g} ms",
            remedy="Is it switched on, and are rate and framing those of its INTERFACE SETTINGS?",
        )

    def _refused(self, command: str) -> DriverError:
        return DriverError(f"the readout refuses {command} (NAK)", where=self._config.url)

    def _gone(self, error: Exception) -> BusLostError:
        return BusLostError(
            f"the serial line is gone: {error}",
            where=self._config.url,
            remedy="Check cable and adapter.",
        )

    def _send(self, data: bytes) -> None:
        try:
            self._port.write(data)
        except LINE_ERRORS as error:
            raise self._gone(error) from error

    def _flush(self) -> None:
        try:
            self._port.reset_input_buffer()
        except LINE_ERRORS as error:
            raise self._gone(error) from error

    def _deadline(self, duration_ms: float) -> int:
        return self._clock.monotonic_ns() + round(duration_ms * _MS)


def _text(line: bytes) -> str:
    return line.decode("latin-1").strip("\r\n\0 ")
