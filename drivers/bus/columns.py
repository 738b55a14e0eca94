"""From raw records to the columns of a block: counters unwrapped, index latches placed, set-points beside them, flags.

A block is decoded at once with numpy; `row` gives the same counts for a single cycle, for the guard that cannot wait.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from drivers.bus.cia401 import AnalogInput
from drivers.bus.frames import FrameLayout
from drivers.bus.status_lines import StatusLines
from drivers.channel import Channel
from drivers.counting import Unwrapper, wrapped_difference
from drivers.samples import STALE_OF, CycleFlag

Kind = Literal[
    "count", "plain", "target_speed", "target_torque", "latch", "seen", "contact", "lines"
]
_FAR: Final = 2**62
_DOUBTFUL: Final = CycleFlag.INCOMPLETE | CycleFlag.LATE | CycleFlag.DOUBLED | CycleFlag.SHORT
"""Marks of the pairing: such a value may belong to another cycle, or to nobody."""


@dataclass(frozen=True, kw_only=True)
class Column:
    """One channel of the blocks: what kind of number it is and which fields of the record it comes from.

    `field` its own field (-1: none); `of` the column of the counter that a latch belongs to;
    `seen_fields` (field, mask) of latch states, one bit each, or of a contact, which is 1 when the
    masked field equals `closed`; `largest_step` counts per cycle; `analog` its input, for
    saturation; `lines` of a statusword that is made of a word of contacts.
    """

    channel: Channel
    kind: Kind
    field: int = -1
    of: int = -1
    seen_fields: tuple[tuple[int, int], ...] = ()
    largest_step: int = 0
    closed: int = 0
    analog: AnalogInput | None = None
    lines: StatusLines | None = None


@dataclass(frozen=True)
class Validity:
    """A field in which a device says that its values are not valid, when any bit of the mask is set."""

    field: int
    mask: int


class ColumnDecoder:
    """Decodes blocks and rows of one rig; keeps the unwrapping state between blocks."""

    def __init__(
        self,
        layout: FrameLayout,
        columns: Sequence[Column],
        validities: Sequence[Validity] = (),
        cycle_ns: int = 0,
    ) -> None:
        self.layout, self.columns, self.validities = layout, tuple(columns), tuple(validities)
        self._cycle_ns = cycle_ns
        self._last_sent: int | None = None
        self._unwrappers = {
            i: Unwrapper(c.channel.modulus) for i, c in enumerate(columns) if c.kind == "count"
        }
        # Counter columns first: a latch is placed relative to its counter.
        self._order = sorted(range(len(columns)), key=lambda i: columns[i].kind != "count")
        self._stale_marks = [self._stale_mark(slot) for slot in range(len(layout.pdos))]
        self._row_raw: dict[int, int] = {}
        self._row_count: dict[int, int] = {}
        self._last: NDArray[np.int64] | None = None
        self._gap = 0

    def block(
        self,
        raw: NDArray[np.int64],
        bad: NDArray[np.bool_],
        flags: NDArray[np.uint16],
        speeds: NDArray[np.int64],
        torques: NDArray[np.int64],
        absent: NDArray[np.int64] | None = None,
        sent: NDArray[np.int64] | None = None,
        doubt: NDArray[np.int64] | None = None,
    ) -> NDArray[np.int64]:
        """Counts (n, columns) of raw values (n, fields) and set-points (n,); sets what it finds in `flags` (n,).

        `absent` (n,) are the slots without a frame, one bit each: their channels are marked stale.
        `sent` (n,) [ns] is when the SYNCs went out, `doubt` (n,) [ns] how much later they may have been
        heard: where one came late, the shaft had the time to turn further.
        """
        counts = np.zeros((len(raw), len(self.columns)), dtype=np.int64)
        paired = flags.copy()
        for i in self._order:
            column = self.columns[i]
            if column.kind == "target_speed":
                counts[:, i] = speeds
            elif column.kind == "target_torque":
                counts[:, i] = torques
            elif column.kind == "seen":
                for bit, (field, mask) in enumerate(column.seen_fields):
                    counts[:, i] |= ((raw[:, field] & mask) != 0).astype(np.int64) << bit
            elif column.kind == "contact":
                field, mask = column.seen_fields[0]
                counts[:, i] = (raw[:, field] & mask) == column.closed
            elif column.kind == "count":
                outside = self._outside(raw[:, column.field], column)
                flags[outside] |= np.uint16(CycleFlag.SIGNAL_ERROR)
                trusted = (paired & _DOUBTFUL == 0) & ~outside
                counts[:, i] = self._unwrappers[i].unwrap(raw[:, column.field], trusted)
            elif column.kind == "latch":
                counts[:, i] = self._latch(raw, counts, column)
            elif column.lines is not None:
                counts[:, i] = column.lines.of_all(raw[:, column.field])
            else:
                counts[:, i] = raw[:, column.field]
                if column.analog is not None:
                    flags[column.analog.saturated(counts[:, i])] |= np.uint16(CycleFlag.SATURATED)
                    counts[:, i] &= column.analog.value_mask
        self._mark(raw, bad, counts, flags, self._elapsed(sent, doubt, len(raw)))
        if absent is not None and absent.any():
            self._mark_stale(absent, flags)
        self._remember(counts)
        return counts

    def _mark_stale(self, absent: NDArray[np.int64], flags: NDArray[np.uint16]) -> None:
        """Mark the channels of the slots without a frame."""
        for slot, mark in enumerate(self._stale_marks):
            flags[(absent >> slot & 1) != 0] |= np.uint16(mark)

    def pause(self) -> None:
        """The SYNC has stood while the shaft did: the time until the next one is nobody's chance to turn."""
        self._last_sent = None

    def row(self, record: bytes, speed: int, torque: int, flags: int = 0) -> list[int]:
        """Counts of one record, that of the cycle after the last row or block; `flags` are those of its pairing."""
        raw = self.layout.decode_row(record)
        counts = [0] * len(self.columns)
        for i in self._order:
            column = self.columns[i]
            if column.kind == "plain":
                counts[i] = raw[column.field]
                if column.analog is not None:
                    counts[i] &= column.analog.value_mask
            elif column.kind == "count":
                counts[i] = self._row_unwrap(i, raw[column.field], column, flags)
            elif column.kind == "target_speed":
                counts[i] = speed
            elif column.kind == "target_torque":
                counts[i] = torque
            elif column.kind == "seen":
                counts[i] = sum(
                    (raw[f] & mask != 0) << bit for bit, (f, mask) in enumerate(column.seen_fields)
                )
            elif column.kind == "contact":
                field, mask = column.seen_fields[0]
                counts[i] = int(raw[field] & mask == column.closed)
            elif column.lines is not None:
                counts[i] = column.lines.of(raw[column.field])
            else:
                counts[i] = self._row_latch(raw, counts, column)
        return counts

    def _stale_mark(self, slot: int) -> int:
        """The marks of all channels that come, wholly or in part, from a slot's frame."""
        mark = 0
        for column in self.columns:
            fields = [column.field, *(field for field, mask in column.seen_fields if mask)]
            if any(field >= 0 and self.layout.fields[field].slot == slot for field in fields):
                mark |= STALE_OF.get(column.channel.name, CycleFlag.STALE_OTHER)
        return mark or CycleFlag.STALE_OTHER

    def _outside(self, raw: NDArray[np.int64], column: Column) -> NDArray[np.bool_]:
        """Raw values (n,) that a counter of this range cannot show."""
        low, high = self._range_of(column)
        return (raw < low) | (raw >= high)

    def _range_of(self, column: Column) -> tuple[int, int]:
        modulus = column.channel.modulus
        if not modulus:
            return -_FAR, _FAR
        return (-modulus if self.layout.fields[column.field].data_type.signed else 0), modulus

    def _latch(
        self, raw: NDArray[np.int64], counts: NDArray[np.int64], column: Column
    ) -> NDArray[np.int64]:
        """The latched count beside its unwrapped counter; 0 until a mark has been seen."""
        counter = self.columns[column.of]
        latched, now = raw[:, column.field], raw[:, counter.field]
        placed = counts[:, column.of] + wrapped_difference(latched, now, counter.channel.modulus)
        if not column.seen_fields:
            return np.where(latched == 0, 0, placed)
        field, mask = column.seen_fields[0]
        return np.where((raw[:, field] & mask) != 0, placed, 0)

    def _row_latch(self, raw: list[int], counts: list[int], column: Column) -> int:
        counter = self.columns[column.of]
        latched, modulus = raw[column.field], counter.channel.modulus
        is_seen = latched
        if column.seen_fields:
            field, mark = column.seen_fields[0]
            is_seen = raw[field] & mark
        if not is_seen:
            return 0
        return counts[column.of] + _wrapped(latched - raw[counter.field], modulus)

    def _row_unwrap(self, i: int, raw: int, column: Column, flags: int) -> int:
        modulus = column.channel.modulus
        low, high = self._range_of(column)
        is_trusted = not flags & _DOUBTFUL and low <= raw < high
        if not modulus or (i not in self._row_raw and not is_trusted):
            return raw
        if i not in self._row_raw:
            self._row_raw[i] = self._row_count[i] = raw
        count = self._row_count[i] + _wrapped(raw - self._row_raw[i], modulus)
        if is_trusted:
            self._row_raw[i], self._row_count[i] = raw, count
        return count

    def _mark(
        self,
        raw: NDArray[np.int64],
        bad: NDArray[np.bool_],
        counts: NDArray[np.int64],
        flags: NDArray[np.uint16],
        elapsed: NDArray[np.int64],
    ) -> None:
        """Signal errors and jumps."""
        flags[bad.any(axis=1)] |= np.uint16(CycleFlag.SIGNAL_ERROR)
        for validity in self.validities:
            flags[(raw[:, validity.field] & validity.mask) != 0] |= np.uint16(
                CycleFlag.SIGNAL_ERROR
            )
        if not len(counts):
            return
        gaps = self._gaps((flags & CycleFlag.INCOMPLETE) != 0, elapsed)
        for i, column in enumerate(self.columns):
            if not column.largest_step:
                continue
            first = counts[0, i] if self._last is None else self._last[i]
            steps = np.abs(np.diff(counts[:, i], prepend=first))
            allowed = column.largest_step * gaps
            jumped = steps > allowed
            if column.channel.modulus:
                # After so long a gap the counter may have wrapped unseen.
                jumped |= (gaps > 1) & (2 * allowed >= column.channel.modulus)
            flags[jumped] |= np.uint16(CycleFlag.JUMPED)

    def _elapsed(
        self, sent: NDArray[np.int64] | None, doubt: NDArray[np.int64] | None, rows: int
    ) -> NDArray[np.int64]:
        """For each cycle (rows,): how many periods after the one before it the SYNC was heard at the
        latest, at least one.
        """
        if sent is None or not len(sent) or not self._cycle_ns:
            return np.ones(rows, dtype=np.int64)
        before = sent[0] - self._cycle_ns if self._last_sent is None else self._last_sent
        self._last_sent = int(sent[-1])
        steps = np.diff(sent, prepend=before)
        periods = np.maximum((steps + self._cycle_ns // 2) // self._cycle_ns, 1)
        return periods if doubt is None else periods + doubt // self._cycle_ns

    def _gaps(self, incomplete: NDArray[np.bool_], elapsed: NDArray[np.int64]) -> NDArray[np.int64]:
        """For each cycle (n,): the periods since the latest complete one before it, `elapsed` (n,)
        since the one before.
        """
        now = np.cumsum(elapsed) - 1
        latest_good = np.maximum.accumulate(np.where(incomplete, -1 - self._gap, now))
        before = np.concatenate([[-1 - self._gap], latest_good[:-1]])
        gaps = now - before
        self._gap = int(now[-1] - latest_good[-1])
        return np.minimum(gaps, _FAR)

    def _remember(self, counts: NDArray[np.int64]) -> None:
        """Let the row decoder go on where the block ended."""
        if not len(counts):
            return
        self._last = counts[-1].copy()
        for i, unwrapper in self._unwrappers.items():
            reference, count = unwrapper.reference
            if reference is not None:
                self._row_raw[i], self._row_count[i] = reference, count


def _wrapped(difference: int, modulus: int) -> int:
    half = modulus // 2
    return (difference + half) % modulus - half if modulus else difference
