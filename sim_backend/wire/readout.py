"""A simulated position readout with the serial protocol of a HEIDENHAIN ND 287.

STX asks for the measured value, ENQ for the error message, `ESC Axxxx CR` for screen contents, `ESC
Txxxx CR` for a key. The measured-value line has 17 characters: sign, ten for the number, blank,
unit, class, mode, CR, LF.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

STX, ENQ, ACK, NAK, ESC, XOFF, XON = 0x02, 0x05, 0x06, 0x15, 0x1B, 0x13, 0x11
_LONGEST_COMMAND = 8

UNITS: dict[str, str] = {"deg": "G", "dms": "M", "rad": "R"}
"""The unit character of each angle display."""


@dataclass
class Readout:
    """The device behind the line: `receive` takes bytes and returns the bytes that come back.

    `angle` returns the measured angle [rad]. `unit` is "deg", "dms" or "rad"; `decimals` the digits after the point;
    `has_fault` makes it answer with the fault unit "?", as with a broken encoder cable.
    """

    angle: Callable[[], float]
    unit: str = "deg"
    decimals: int = 5
    blank_lines: int = 0
    has_fault: bool = False
    error_text: str = ""

    def __post_init__(self) -> None:
        self._pending = b""
        self._is_stopped = False
        self._held = b""

    def receive(self, data: bytes) -> bytes:
        """The answer to some bytes; a command may come in pieces."""
        answer = b""
        for byte in data:
            answer += self._take(byte)
        if self._is_stopped:
            self._held += answer
            return b""
        held, self._held = self._held, b""
        return held + answer

    def measured_value_line(self) -> bytes:
        """The 17 characters with CR LF, and the blank lines after it."""
        tail = b"\r\n" * self.blank_lines
        if self.has_fault:
            return b" " * 12 + b"??A\r\n" + tail
        sign, text = self._shown()
        return f"{sign}{text:>10} {UNITS[self.unit]}=A\r\n".encode("ascii") + tail

    def _shown(self) -> tuple[str, str]:
        """Sign and number in the display: an angle within one revolution either way, as the range "+-360" has it."""
        angle = math.fmod(self.angle(), 2.0 * math.pi)
        value = abs(angle)
        if self.unit == "rad":
            text = f"{value:.{self.decimals}f}"
        elif self.unit == "deg":
            text = f"{math.degrees(value):.{self.decimals}f}"
        else:
            seconds = round(math.degrees(value) * 3600.0)
            text = f"{seconds // 3600}.{seconds // 60 % 60:02d}.{seconds % 60:02d}"
        return ("-" if angle < 0.0 and text.strip("0.") else "+"), text

    def _take(self, byte: int) -> bytes:
        if self._pending:
            return self._command(byte)
        if byte == STX:
            return self.measured_value_line()
        if byte == ENQ:
            return self.error_text.encode("ascii", "replace") + b"\r\n"
        if byte in (XOFF, XON):
            self._is_stopped = byte == XOFF
            return b""
        if byte == ESC:
            self._pending = bytes([ESC])
        return b""

    def _command(self, byte: int) -> bytes:
        if byte != 0x0D:
            self._pending += bytes([byte])
            if len(self._pending) > _LONGEST_COMMAND:
                self._pending = b""
                return bytes([NAK])
            return b""
        command, self._pending = self._pending[1:].decode("ascii", "replace"), b""
        return self._obey(command)

    def _obey(self, command: str) -> bytes:
        """Screen contents behind an STX, ACK for keys and functions, NAK for what it does not know."""
        sign, text = self._shown()
        screens = {
            "A0000": "ND-287    \r\n646118-01 \r\nV1-01     ",
            "A0100": f"{sign}{text:>10}"[-13:],
            "A0200": f"{sign}{text.replace('.', ''):0>9}",
            "A0900": "0000000000",
        }
        if command in screens:
            return bytes([STX]) + screens[command].encode("ascii") + b"\r\n"
        is_command = (
            len(command) == 5
            and command[0] in "TFS"
            and command[1:].isascii()
            and command[1:].isdigit()
        )
        return bytes([ACK if is_command else NAK])
