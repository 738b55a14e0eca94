"""An SDO client (CiA 301, 7.2.4) for a bus that its owner pumps: expedited and segmented transfer, aborts in words.

No thread and no queue. A transfer is written once, as a generator of frames; it goes on in one of two ways. Somebody
waits for it: the bus is pumped until the answer is there or the clock says that it is too late. Or it is posted:
`PostedTransfer.turn` sends what is due and returns at once, and answers are taken as frames arrive. A node's channel
has one owner at a time: waiting withdraws what was posted. Answers that belong to another object or an earlier request
are dropped, not believed.
"""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Generator
from typing import Protocol

from drivers.bus.cia301 import (
    ABORT_MISSING,
    SDO_REQUEST_BASE,
    SDO_RESPONSE_BASE,
    DataType,
    ObjectRef,
    abort_text,
    object_text,
)
from drivers.errors import DriverError

_MOST_ANSWERS = 8
"""Answers to something else that are dropped before a request is given up."""
_TOGGLE_ERROR, _TIMED_OUT, _BAD_COMMAND, _LENGTH = 0x05030000, 0x05040000, 0x05040001, 0x06070010


class SdoAbortError(DriverError):
    """A device refused an SDO transfer; `code` is CiA 301's abort code."""

    def __init__(self, where: str, code: int) -> None:
        self.code = code
        super().__init__(
            f"the device refuses: {abort_text(code)}", where=where, value=f"0x{code:08X}"
        )

    @property
    def is_missing(self) -> bool:
        """Whether the device says that it has no such entry."""
        return self.code in ABORT_MISSING


class SdoTimeoutError(DriverError):
    """A device did not answer an SDO request in time."""


class SdoProtocolError(DriverError):
    """A device answered an SDO request with bytes that the standard does not allow."""


class SdoBus(Protocol):
    """What the client needs of a bus."""

    def send(self, cob_id: int, data: bytes) -> None: ...

    def subscribe(self, cob_id: int, handler: FrameHandler) -> None: ...

    def wait_for(self, is_there: Condition, timeout_ns: int) -> bool: ...


class FrameHandler(Protocol):
    """Called with the bytes and the time stamp [ns] of every frame of a COB-ID."""

    def __call__(self, data: bytes, stamp_ns: int, /) -> None: ...


class Condition(Protocol):
    """Asked after every frame."""

    def __call__(self) -> bool: ...


_Transfer = Generator[bytes, bytes | None, bytes]
"""A transfer as it goes on: it gives the frame to send (empty: wait for another answer), takes the answer (None: none
came in time), and returns what was read. Raises `SdoAbortError`, `SdoTimeoutError` or `SdoProtocolError`.
"""


class PostedTransfer:
    """A transfer that nobody waits for. Once `is_over`, `data` is what was read, or `error` says why it was not."""

    def __init__(self, bus: SdoBus, node_id: int, transfer: _Transfer, timeout_ns: int) -> None:
        self._bus, self._node_id, self._transfer = bus, node_id, transfer
        self._timeout_ns, self._sent_ns = timeout_ns, 0
        self._frame = next(transfer)
        self.is_over = False
        self.data = b""
        self.error: DriverError | None = None

    def turn(self, now_ns: int) -> None:
        """Send the frame that is due, or give up an answer that is late. `now_ns` of the bus's clock."""
        if self._frame:
            frame, self._frame, self._sent_ns = self._frame, b"", now_ns
            self._bus.send(SDO_REQUEST_BASE + self._node_id, frame)
        elif now_ns - self._sent_ns > self._timeout_ns:
            self.take(None)

    def take(self, answer: bytes | None) -> None:
        """An answer has arrived; None: none did in time."""
        if self.is_over or self._frame:
            return
        try:
            self._frame = self._transfer.send(answer)
        except StopIteration as over:
            self.is_over, self.data = True, over.value
        except DriverError as error:
            self.is_over, self.error = True, error

    def withdraw(self) -> None:
        """Forget it; an answer that still comes belongs to nobody."""
        self.is_over = True


class SdoClient:
    """The default SDO channel of one node. Transfers are bounded by `timeout_ns` per answer and `longest` bytes."""

    def __init__(
        self, bus: SdoBus, node_id: int, timeout_ns: int = 300_000_000, longest: int = 1 << 20
    ) -> None:
        self._bus, self.node_id, self._timeout_ns, self._longest = bus, node_id, timeout_ns, longest
        self._answers: deque[bytes] = deque(maxlen=16)
        self._is_waiting = False
        self._posted: PostedTransfer | None = None
        bus.subscribe(SDO_RESPONSE_BASE + node_id, self._on_answer)

    def upload(self, index: int, subindex: int) -> bytes:
        """Read an entry. Raises `SdoAbortError`, `SdoTimeoutError` or `SdoProtocolError`."""
        return self._wait_for(self._upload(index, subindex))

    def download(self, index: int, subindex: int, data: bytes) -> None:
        """Write an entry. Raises `SdoAbortError`, `SdoTimeoutError` or `SdoProtocolError`."""
        self._wait_for(self._download(index, subindex, data))

    def post_upload(self, index: int, subindex: int) -> PostedTransfer:
        """Begin to read an entry without waiting; what was posted before is withdrawn."""
        return self._post(self._upload(index, subindex))

    def post_download(self, index: int, subindex: int, data: bytes) -> PostedTransfer:
        """Begin to write an entry without waiting; what was posted before is withdrawn."""
        return self._post(self._download(index, subindex, data))

    def withdraw(self) -> None:
        """Forget what was posted."""
        if self._posted is not None:
            self._posted.withdraw()
            self._posted = None

    def _post(self, transfer: _Transfer) -> PostedTransfer:
        self.withdraw()
        self._posted = PostedTransfer(self._bus, self.node_id, transfer, self._timeout_ns)
        return self._posted

    def _wait_for(self, transfer: _Transfer) -> bytes:
        """Send what the transfer gives and pump the bus until it is over."""
        self.withdraw()
        self._is_waiting = True
        try:
            frame = next(transfer)
            while True:
                if frame:
                    self._answers.clear()
                    self._bus.send(SDO_REQUEST_BASE + self.node_id, frame)
                arrived = self._bus.wait_for(lambda: bool(self._answers), self._timeout_ns)
                frame = transfer.send(self._answers.popleft() if arrived else None)
        except StopIteration as over:
            return over.value
        finally:
            self._is_waiting = False

    def _upload(self, index: int, subindex: int) -> _Transfer:
        head = struct.pack("<HB", index, subindex)
        answer = yield from self._request(b"\x40" + head + bytes(4), index, subindex, expects=2)
        command = answer[0]
        if command & 0x02:
            return answer[4 : 8 - (command >> 2 & 3)] if command & 0x01 else answer[4:8]
        size = int.from_bytes(answer[4:8], "little") if command & 0x01 else None
        if size is not None and size > self._longest:
            self._abort(index, subindex, 0x05040005)
            raise SdoProtocolError(
                "the object is longer than anything expected",
                where=self._where(index, subindex),
                value=size,
                limit=f"<= {self._longest} bytes",
            )
        return (yield from self._upload_segments(index, subindex, size))

    def _download(self, index: int, subindex: int, data: bytes) -> _Transfer:
        head = struct.pack("<HB", index, subindex)
        if 0 < len(data) <= 4:
            frame = bytes([0x23 | (4 - len(data)) << 2]) + head + data.ljust(4, b"\0")
            return (yield from self._request(frame, index, subindex, expects=3))
        frame = b"\x21" + head + len(data).to_bytes(4, "little")
        answer = yield from self._request(frame, index, subindex, expects=3)
        toggle = 0
        pieces = [data[i : i + 7] for i in range(0, len(data), 7)] or [b""]
        for number, piece in enumerate(pieces):
            is_last = number == len(pieces) - 1
            command = toggle << 4 | (7 - len(piece)) << 1 | is_last
            frame = bytes([command]) + piece.ljust(7, b"\0")
            answer = yield from self._request(frame, index, subindex, expects=1, is_segment=True)
            self._check_toggle(answer[0], toggle, index, subindex)
            toggle ^= 1
        return answer

    def read(self, entry: ObjectRef) -> int | float:
        """Read an entry as the number that its data type says."""
        return entry.data_type.decode(self.upload(entry.index, entry.subindex))

    def read_as(self, index: int, subindex: int, data_type: DataType) -> int | float:
        """Read an entry as a number of the given type."""
        return data_type.decode(self.upload(index, subindex))

    def read_text(self, index: int, subindex: int = 0) -> str:
        """Read an entry as text; bytes that are not text are replaced, padding is cut."""
        return self.upload(index, subindex).split(b"\0")[0].decode("latin-1").strip()

    def write(self, entry: ObjectRef, value: float) -> None:
        """Write a number as the entry's data type."""
        self.download(entry.index, entry.subindex, entry.data_type.encode(value))

    def _upload_segments(self, index: int, subindex: int, size: int | None) -> _Transfer:
        data = bytearray()
        toggle = 0
        while True:
            frame = bytes([0x60 | toggle << 4]) + bytes(7)
            answer = yield from self._request(frame, index, subindex, expects=0, is_segment=True)
            self._check_toggle(answer[0], toggle, index, subindex)
            data += answer[1 : 8 - (answer[0] >> 1 & 7)]
            if answer[0] & 0x01:
                break
            if len(data) > self._longest:
                self._abort(index, subindex, 0x05040005)
                raise SdoProtocolError(
                    "a segmented upload does not end", where=self._where(index, subindex)
                )
            toggle ^= 1
        if size is not None and len(data) != size:
            raise SdoProtocolError(
                "a segmented upload has another length than announced",
                where=self._where(index, subindex),
                value=len(data),
                limit=f"{size} bytes",
            )
        return bytes(data)

    def _request(
        self, frame: bytes, index: int, subindex: int, *, expects: int, is_segment: bool = False
    ) -> _Transfer:
        """Have a frame sent and return the answer with the server command specifier `expects`."""
        for _ in range(_MOST_ANSWERS):
            answer = yield frame
            if answer is None:
                break
            response = self._judge(answer, index, subindex, expects, is_segment)
            if response is not None:
                return response
            frame = b""
        self._abort(index, subindex, _TIMED_OUT)
        raise SdoTimeoutError(
            "no SDO answer",
            where=self._where(index, subindex),
            limit=f"within {self._timeout_ns / 1e6:g} ms",
            remedy="Is the node powered, on this bus and this bit rate, and not stopped?",
        )

    def _judge(
        self, answer: bytes, index: int, subindex: int, expects: int, is_segment: bool
    ) -> bytes | None:
        """The answer if it belongs to the request, None if it is an old one. Raises on aborts and nonsense."""
        if len(answer) < 8:
            self._abort(index, subindex, _LENGTH)
            raise SdoProtocolError(
                "an SDO answer must have 8 bytes",
                where=self._where(index, subindex),
                value=answer.hex(" ") or "none",
            )
        specifier = answer[0] >> 5
        names_object = specifier in (2, 3, 4)
        if names_object and not (is_segment and specifier != 4):
            answered_index, answered_subindex = struct.unpack_from("<HB", answer, 1)
            # Some servers abort without naming the object (0x0000:0); an answer to another object is a late one.
            is_ours = (answered_index, answered_subindex) == (index, subindex)
            if not is_ours and not (
                specifier == 4 and (answered_index, answered_subindex) == (0, 0)
            ):
                return None
        if specifier == 4:
            raise SdoAbortError(self._where(index, subindex), int.from_bytes(answer[4:8], "little"))
        if specifier != expects:
            if is_segment or not names_object:
                # An answer of an earlier segmented transfer that was given up.
                return None
            self._abort(index, subindex, _BAD_COMMAND)
            raise SdoProtocolError(
                "unexpected SDO command",
                where=self._where(index, subindex),
                value=f"0x{answer[0]:02X}",
            )
        return answer

    def _check_toggle(self, command: int, toggle: int, index: int, subindex: int) -> None:
        if command >> 4 & 1 != toggle:
            self._abort(index, subindex, _TOGGLE_ERROR)
            raise SdoProtocolError(
                "the toggle bit did not alternate", where=self._where(index, subindex)
            )

    def _abort(self, index: int, subindex: int, code: int) -> None:
        self._bus.send(
            SDO_REQUEST_BASE + self.node_id, struct.pack("<BHBL", 0x80, index, subindex, code)
        )

    def _on_answer(self, data: bytes, stamp_ns: int) -> None:
        if self._is_waiting:
            self._answers.append(data)
        elif self._posted is not None:
            self._posted.take(data)

    def _where(self, index: int, subindex: int) -> str:
        return f"node {self.node_id}, {object_text(index, subindex)}"
