"""The latest frames of a bus, kept while it runs and written once it has ended, in the log format of python-can.

One record of 20 bytes a frame in a ring: nothing is allocated in a cycle. Times are those of this computer's clock when
a frame was sent or taken in, not the adapter's stamps.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from drivers.errors import DriverError
from drivers.python_can import can

_RECORD: Final = struct.Struct("<qHBB8s")
_BYTES: Final = _RECORD.size
_PIECE: Final = 4096 * _BYTES
SENT: Final = 1
"""Mark of a frame that this computer sent."""
ERROR: Final = 2
"""Mark of an error frame."""
_LONGEST_S: Final = 120.0
"""s that the ring holds at the rate of the rig, at least."""
_PER_CYCLE: Final = 10
"""Frames of a cycle that are reckoned with: set-points, SYNC, what the nodes send."""


class FrameLog:
    """A ring of frames of a bus whose SYNC has a period of `cycle_ns`."""

    def __init__(self, cycle_ns: int) -> None:
        frames = max(1000, round(_LONGEST_S * 1e9 / cycle_ns) * _PER_CYCLE)
        self._size = frames * _RECORD.size
        self._ring = bytearray()
        self._at = self._end = 0
        self._is_full = False
        self._pack = _RECORD.pack_into

    def put(self, time_ns: int, cob_id: int, data: bytes | bytearray, marks: int = 0) -> None:
        """Keep one frame with an 11-bit identifier; `marks`: `SENT`, `ERROR`."""
        at = self._at
        if at == self._end:
            at = self._more()
        self._pack(self._ring, at, time_ns, cob_id, len(data), marks, data)
        self._at = at + _BYTES

    def _more(self) -> int:
        """Where the next record goes: the ring grows by pieces until it is whole, then it begins again."""
        if len(self._ring) < self._size:
            self._ring.extend(bytes(min(_PIECE, self._size - len(self._ring))))
            self._end = len(self._ring)
            return self._at
        self._is_full = True
        return 0

    def messages(self, epoch_ns: int, seconds: float = float("inf")) -> Iterator[can.Message]:
        """The frames of the last `seconds`, the oldest first; `epoch_ns` is the calendar time of a time of zero."""
        ring = bytes(self._ring)
        older = ring[self._at :] if self._is_full else b""
        rows = list(_RECORD.iter_unpack(older + ring[: self._at]))
        first = rows[-1][0] - seconds * 1e9 if rows else 0.0
        for time_ns, cob_id, size, marks, data in rows:
            if time_ns >= first:
                yield can.Message(
                    timestamp=(epoch_ns + time_ns) * 1e-9,
                    arbitration_id=cob_id,
                    data=data[:size],
                    is_extended_id=False,
                    is_error_frame=bool(marks & ERROR),
                    is_rx=not marks & SENT,
                    channel="can0",
                )

    def write(self, path: Path, epoch_ns: int, seconds: float = float("inf")) -> int:
        """Write the frames of the last `seconds`; how many. Raises `OSError`."""
        count = 0
        with can.Logger(str(path)) as log:
            for message in self.messages(epoch_ns, seconds):
                log.on_message_received(message)
                count += 1
        return count


def read_frames(path: Path) -> Iterator[can.Message]:
    """The frames of a log that python-can reads; also compressed. Raises `DriverError`."""
    try:
        with can.LogReader(str(path)) as log:
            yield from log
    except (
        OSError,
        ValueError,
        EOFError,
        struct.error,
        can.CanError,
        NotImplementedError,
        ImportError,
    ) as error:
        raise DriverError(
            f"is no log of frames that can be read: {error}",
            where=str(path),
            limit=".log, .asc, .blf, .trc, .csv as python-can writes them, also with .gz",
        ) from error
