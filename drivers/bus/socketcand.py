"""python-can's socketcand client with what it lacks: a hub that is not there, silent or gone is said at once.

The client of python-can tries for ten seconds to reach a hub, waits for its answers without end,
does not get onto a bus that is already busy, and takes the end of the connection for silence. A hub
that dies in motion is a lost bus.
"""

from __future__ import annotations

import logging
import select
import socket
from typing import Any, Final

from drivers.python_can import can, without_log_files

with without_log_files():
    from can.interfaces import socketcand

_Client: type[can.BusABC] = vars(socketcand)["SocketCanDaemonBus"]
"""The client of python-can, which says nothing of its types."""
_GREETING: Final = b"< hi >"
_ANSWER_TIMEOUT: Final = 3.0
"""Seconds that a hub has to greet, and to open the channel."""
_LONGEST_MESSAGE: Final = 256
_SEND_TIMEOUT: Final = 0.5
"""Seconds that a frame may wait for a hub that takes nothing any more."""


class SocketcandBus(_Client):
    """A client of a socketcand hub. Raises `can.CanError` or `OSError` when it cannot connect, and
    when the hub is gone.
    """

    def __init__(
        self, channel: str, host: str = "127.0.0.1", port: int = 29536, **options: Any
    ) -> None:
        # It logs each loss with a traceback and warns of every frame that TCP has cut in two; what matters is raised.
        logging.getLogger("can.interfaces.socketcand").setLevel(logging.CRITICAL)
        _require_greeting(host, int(port))
        try:
            super().__init__(channel, host=host, port=int(port), **options)
        except (can.CanError, OSError):
            self._line.close()
            self._is_shutdown = True
            raise
        self._line.settimeout(_SEND_TIMEOUT)

    @property
    def _line(self) -> socket.socket:
        # The parent's private name is the only way to its socket.
        return self.__dict__["_SocketCanDaemonBus__socket"]

    def _expect_msg(self, msg: str) -> None:
        # The parent takes what follows at once, the first frames of a busy bus, for a wrong answer.
        self._line.settimeout(_ANSWER_TIMEOUT)
        heard = read_message(self._line)
        if heard != msg.encode("ascii"):
            raise can.CanError(f"expected {msg!r}, the hub says {heard!r}")

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        try:
            message, is_filtered = super()._recv_internal(timeout)
        except can.CanError as error:
            # Its text carries a whole traceback, whose head stands in the first line.
            words = str(error).partition("Traceback")[0].strip()
            raise can.CanOperationError(words or "the hub's line has failed") from error
        if message is None and self._has_ended():
            raise can.CanOperationError("the hub has closed the connection")
        return message, is_filtered

    def _has_ended(self) -> bool:
        ready, _, _ = select.select([self._line], [], [], 0.0)
        return bool(ready) and not self._line.recv(1, socket.MSG_PEEK)


def _require_greeting(host: str, port: int) -> None:
    """Connect once and hear the hub's greeting. Raises `OSError` saying what is there instead."""
    with socket.create_connection((host, port), _ANSWER_TIMEOUT) as line:
        heard = read_message(line)
    if heard != _GREETING:
        raise OSError(f"what answers at {host}:{port} is no socketcand hub: it says {heard[:20]!r}")


def read_message(line: socket.socket) -> bytes:
    """What a hub says up to the next closing bracket, and not a byte further; less where it ends before."""
    heard = b""
    while len(heard) < _LONGEST_MESSAGE and not heard.endswith(b">"):
        try:
            byte = line.recv(1)
        except ConnectionResetError:
            # A hub that hangs up before it has read everything: the same end, told less politely.
            break
        if not byte:
            break
        heard += byte
    return heard
