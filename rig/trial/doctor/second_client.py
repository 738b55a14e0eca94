"""The doctor's second opinion: canopen's SDO client over the bus that the drivers pump.

What the drivers found while they brought the rig up is read again by a client that is not theirs. No
notifier and no thread: the library's client asks, the pumped bus answers, in the clock of the rig.
Added here: a deadline for every transfer, a bound of its length, and that late answers are dropped.
"""

from __future__ import annotations

import logging
import struct
from collections.abc import Iterator
from contextlib import contextmanager

from drivers.bus.cia301 import SDO_REQUEST_BASE, SDO_RESPONSE_BASE, object_text
from drivers.bus.device import RemoteDevice
from drivers.bus.network import PumpedBus
from drivers.bus.sdo import SdoAbortError, SdoClient, SdoProtocolError, SdoTimeoutError
from drivers.python_can import without_log_files

with without_log_files():
    from canopen import ObjectDictionary, SdoAbortedError, SdoCommunicationError
    from canopen.sdo.client import ReadableStream
    from canopen.sdo.client import SdoClient as LibraryClient

TIMED_OUT, TOO_LONG = 0x05040000, 0x05040005
UPLOAD, ABORTED, NO_MORE_SEGMENTS = 0x40, 0x80, 0x01
_QUIET = logging.NullHandler()
"""Keeps the library's log off the terminal where nobody asked for it."""


class PumpedClient(LibraryClient):
    """canopen's SDO client of one node, on a bus without thread: `deadline_ns` of a transfer, `longest` bytes of it."""

    def __init__(self, bus: PumpedBus, node_id: int, deadline_ns: int, longest: int) -> None:
        super().__init__(
            SDO_REQUEST_BASE + node_id, SDO_RESPONSE_BASE + node_id, ObjectDictionary()
        )
        self.network = self  # type: ignore[assignment]  # all that it uses of one is `send_message`
        self._bus, self._deadline_ns, self._longest = bus, deadline_ns, longest
        self._until_ns, self._asked, self._request, self._last = 0, (0, 0), 0, bytes(8)
        logging.getLogger("canopen").addHandler(_QUIET)

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        """What the library sends goes over the pumped bus."""
        self._request = data[0]
        self._bus.send(can_id, bytes(data))

    def read_response(self) -> bytes:
        """The next answer that belongs to what was asked for. Raises the library's errors."""
        while self._bus.wait_for(
            lambda: not self.responses.empty(), self._until_ns - self._bus.clock.monotonic_ns()
        ):
            answer: bytes = self.responses.get_nowait()
            if len(answer) != 8:
                raise SdoCommunicationError(f"an answer of {len(answer)} bytes instead of 8")
            if not self._is_late(answer):
                self._last = answer
                if answer[0] == ABORTED:
                    raise SdoAbortedError(int.from_bytes(answer[4:8], "little"))
                return answer
        raise TimeoutError

    def upload(self, index: int, subindex: int) -> bytes:
        """Read an entry, all of it. Raises the library's errors, and `TimeoutError` after the deadline."""
        self._until_ns = self._bus.clock.monotonic_ns() + self._deadline_ns
        self._asked, data = (index, subindex), b""
        try:
            stream = ReadableStream(self, index, subindex)
            while piece := stream.read(7):
                data += piece
                if len(data) > self._longest:
                    self.abort(TOO_LONG)
                    raise SdoCommunicationError(f"more than {self._longest} bytes")
        except TimeoutError:
            self.abort(TIMED_OUT)
            raise
        is_cut = self._last[0] >> 5 == 0 and not self._last[0] & NO_MORE_SEGMENTS
        if is_cut or (stream.size is not None and stream.size != len(data)):
            raise SdoCommunicationError(f"{len(data)} bytes came, {stream.size} were announced")
        return data

    def abort(self, abort_code: int = TIMED_OUT) -> None:
        """Give a transfer up, naming the object: the library leaves it out."""
        self._bus.send(self.rx_cobid, struct.pack("<BHBL", ABORTED, *self._asked, abort_code))

    def _is_late(self, answer: bytes) -> bool:
        """Whether it answers an earlier request. A segment names no object, and neither do some servers' aborts."""
        if answer[0] != ABORTED and (self._request == UPLOAD) == (answer[0] >> 5 == 0):
            return True
        named = struct.unpack_from("<HB", answer, 1)
        is_nameless = answer[0] >> 5 == 0 or (answer[0] == ABORTED and named == (0, 0))
        return not is_nameless and named != self._asked


class SecondClient(SdoClient):
    """Reads as the drivers' own client does, with its errors, by canopen's client; hears what both hear."""

    def __init__(
        self, bus: PumpedBus, node_id: int, deadline_ns: int = 1_000_000_000, longest: int = 1 << 20
    ) -> None:
        super().__init__(bus, node_id, deadline_ns)
        self._client = PumpedClient(bus, node_id, deadline_ns, longest)
        self._deadline_ns = deadline_ns
        bus.subscribe(SDO_RESPONSE_BASE + node_id, self._hand_on)

    def upload(self, index: int, subindex: int) -> bytes:
        """Read an entry. Raises `SdoAbortError`, `SdoTimeoutError` or `SdoProtocolError`."""
        where = f"node {self.node_id}, {object_text(index, subindex)}"
        try:
            return self._client.upload(index, subindex)
        except SdoAbortedError as error:
            raise SdoAbortError(where, error.code) from error
        except TimeoutError as error:
            raise SdoTimeoutError(
                "no SDO answer",
                where=where,
                limit=f"within {self._deadline_ns / 1e6:g} ms",
                remedy="Is the node powered, on this bus and this bit rate, and not stopped?",
            ) from error
        except SdoCommunicationError as error:
            raise SdoProtocolError(f"canopen's client: {error}", where=where) from error

    def _hand_on(self, data: bytes, stamp_ns: int) -> None:
        self._client.on_response(SDO_RESPONSE_BASE + self.node_id, data, stamp_ns)
        self._on_answer(data, stamp_ns)


@contextmanager
def read_again(device: RemoteDevice) -> Iterator[None]:
    """Within it the device is read by canopen's client; afterwards by its own again."""
    own, cob_id = device.sdo, SDO_RESPONSE_BASE + device.node_id
    handler = device.bus.handler_of(cob_id)
    device.sdo = SecondClient(device.bus, device.node_id)
    try:
        yield
    finally:
        device.sdo = own
        if handler is not None:
            device.bus.subscribe(cob_id, handler)
