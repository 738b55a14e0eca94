"""The proof that a `.part` file holds nothing: the only one that is ever taken away.

The superblock of an HDF5 file says in its first 48 bytes whether somebody writes it, and where its content ends. Its
writer puts both down when the header is complete, before it takes the first row, and again at each flush. Rows lie
behind that end until a flush has brought them into the table of contents, and that table begins with a word of its own.
So a file is empty

- without a byte;
- whose writer had not begun to take rows, and which does not reach beyond the end that its superblock states;
- whose header is complete, in which no column has a row, and which ends where its superblock says,

in each case only where the word of the table of contents is nowhere in it. Whatever else is there is kept.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

from rig.runfile.damage import refusing_damage

SIGNATURE = b"\x89HDF\r\n\x1a\n"
VERSION_AND_SIZES = b"\x03\x08\x08"
"""What follows the signature: version of the superblock, and the bytes of an address and of a length."""
BEING_WRITTEN, TAKING_ROWS = 0x01, 0x05
"""The mark of a writer that is still at its header, and of one that may have appended rows (SWMR)."""
_TABLE_OF_ROWS = b"EAHD"
"""How the index of a growing column or table begins: it stands in the file as soon as a flush has brought a row."""
_SUPERBLOCK = 48
_MARK_AT = 11
_END_AT = 28
_STEP = 1 << 20


@dataclass(frozen=True)
class PartBytes:
    """What the bytes of a `.part` file say without the library: size, mark of the writer, stated end of the content.

    `mark` and `end` are 0 where the superblock is not there, or is that of no run.
    """

    size: int
    mark: int
    end: int
    has_table: bool

    @property
    def beyond(self) -> int:
        """Bytes behind the stated end: what was written after the last flush, and nothing points to."""
        return max(self.size - self.end, 0)

    @property
    def has_no_header(self) -> bool:
        """Whether its writer died before it could take a row, and nothing lies where rows would."""
        if not self.size:
            return True
        return self.mark == BEING_WRITTEN and not self.beyond and not self.has_table

    @property
    def may_have_no_header(self) -> bool:
        """Whether its writer seems to have died at its header, and it is longer than can be proved empty."""
        return self.mark == BEING_WRITTEN and not self.has_no_header

    @property
    def ends_with_its_header(self) -> bool:
        """Whether nothing lies behind a complete header; that no column has a row is for the library to say."""
        return self.mark == TAKING_ROWS and self.size == self.end and not self.has_table


def part_bytes(part: Path) -> PartBytes:
    """Look at the bytes of a `.part` file. Raises `RunFileError` for one that cannot be read."""
    with refusing_damage(part), part.open("rb") as stream:
        size = part.stat().st_size
        head = stream.read(_SUPERBLOCK)
        mark = end = 0
        if len(head) == _SUPERBLOCK and head.startswith(SIGNATURE + VERSION_AND_SIZES):
            mark = head[_MARK_AT]
            (end,) = struct.unpack_from("<Q", head, _END_AT)
        stream.seek(0)
        found, before = False, b""
        while not found and (step := stream.read(_STEP)):
            found = _TABLE_OF_ROWS in before + step
            before = step[1 - len(_TABLE_OF_ROWS) :]
        return PartBytes(size, mark, end, found)
    raise AssertionError
