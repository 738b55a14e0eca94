"""The latest frames of a bus, kept while it runs and written once it has ended, in the log format of python-can.

One record of 20 bytes a frame in a ring, for which room is made by pieces of 80 kB. Times are those of this computer's
clock when a frame was sent or taken in, not the adapter's stamps.
"""

from __future__ import annotations

import gzip
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from drivers.errors import DriverError
from drivers.python_can import can

_RECORD: Final = struct.Struct("<qHBB8s")
_BYTES: Final = _RECORD.size
_PIECE: Final = 4096
"""Frames for which room is made at once."""
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
        self._most = -(-frames // _PIECE) + 1
        self._pieces = [bytearray(_PIECE * _BYTES)]
        self._piece = self._pieces[0]
        self._number = self._at = 0
        self._is_full = False
        self._pack = _RECORD.pack_into

    def put(self, time_ns: int, cob_id: int, data: bytes | bytearray, marks: int = 0) -> None:
        """Keep one frame with an 11-bit identifier; `marks`: `SENT`, `ERROR`."""
        at = self._at
        if at == _PIECE * _BYTES:
            self._turn_over()
            at = 0
        self._pack(self._piece, at, time_ns, cob_id, len(data), marks, data)
        self._at = at + _BYTES

    def _turn_over(self) -> None:
        """Go on in the next piece: a new one until there are enough, then the oldest. Nothing is ever copied."""
        self._number += 1
        if self._number == self._most:
            self._number, self._is_full = 0, True
        if self._number == len(self._pieces):
            self._pieces.append(bytearray(_PIECE * _BYTES))
        self._piece = self._pieces[self._number]

    def messages(self, epoch_ns: int, seconds: float = float("inf")) -> Iterator[can.Message]:
        """The frames of the last `seconds`, the oldest first; `epoch_ns` is the calendar time of a time of zero."""
        here = bytes(self._piece[: self._at])
        older = self._pieces[self._number + 1 :] if self._is_full else []
        whole = b"".join([*older, *self._pieces[: self._number], here])
        rows = list(_RECORD.iter_unpack(whole))
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
        with gzip.open(path, "wt", encoding="ascii") as file, can.CanutilsLogWriter(file) as log:
            for message in self.messages(epoch_ns, seconds):
                log.on_message_received(message)
                count += 1
        return count


def read_frames(path: Path) -> Iterator[can.Message]:
    """The frames of a log that python-can reads; also compressed. Raises `DriverError`."""
    try:
        # What python-can makes of a name goes wrong where the name has more dots than those of its endings.
        if path.name.endswith(".log.gz"):
            with gzip.open(path, "rt", encoding="ascii") as file:
                yield from can.CanutilsLogReader(file)
            return
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
