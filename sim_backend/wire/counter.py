"""A simulated encoder counter by CiA 406: the output encoder's position, its index latch, its alarms.

Position = (direction * count, scaled where 0x6000 says so, + preset shift) modulo the total measuring range 0x6002.
"""

from __future__ import annotations

from sim_backend.wire.dictionary import (
    I32,
    U8,
    U16,
    U32,
    Abort,
    AbortError,
    Entry,
    Number,
    array,
    entry,
)
from sim_backend.wire.pdo import Send
from sim_backend.wire.slave import PdoPlan, Slave, standard_entries

_INCREMENTAL_WITH_TURNS = 0x0005_0196
"""Device type: incremental rotary encoder with electronic turn count, profile 406."""
_POSITION_ERROR = 0x0001
"""Bit 0 of the alarms 0x6503: the position value is not valid."""
REVERSE_BIT, SCALING_BIT = 0x0001, 0x0004
_SENSOR_ERROR = 0x7300


def _counter_entries(
    node_id: int, counts_per_revolution: int, total_range: int, serial: int
) -> list[Entry]:
    """Every object that the simulated counter really has. `total_range` 0 stands for 2^32."""
    turns = min(0xFFFF, (total_range or 0x1_0000_0000) // counts_per_revolution)
    return [
        *standard_entries(node_id, _INCREMENTAL_WITH_TURNS, "Simulated encoder counter", 0x406, serial),
        *array(0x2000, "Index latch", (("position at the last mark", U32, "ro", 0), ("marks seen", U8, "ro", 0)), mappable="t"),  # noqa: E501
        entry(0x6000, 0, "Operating parameters", U16, "rw", 0, low=0, high=REVERSE_BIT | SCALING_BIT),
        entry(0x6001, 0, "Measuring units per revolution", U32, "rw", counts_per_revolution, low=1),
        entry(0x6002, 0, "Total measuring range in measuring units", U32, "rw", total_range),
        entry(0x6003, 0, "Preset value", U32, "rw", 0),
        entry(0x6004, 0, "Position value", U32, "ro", 0, mappable="t"),
        entry(0x6200, 0, "Cyclic timer", U16, "rw", 0),
        entry(0x6500, 0, "Operating status", U16, "ro", 0, mappable="t"),
        entry(0x6501, 0, "Single-turn resolution", U32, "const", counts_per_revolution),
        entry(0x6502, 0, "Number of distinguishable revolutions", U16, "const", turns),
        entry(0x6503, 0, "Alarms", U16, "ro", 0, mappable="t"),
        entry(0x6504, 0, "Supported alarms", U16, "const", _POSITION_ERROR),
        entry(0x6505, 0, "Warnings", U16, "ro", 0, mappable="t"),
        entry(0x6506, 0, "Supported warnings", U16, "const", 0),
        entry(0x6507, 0, "Profile and software version", U32, "const", 0x0100_0302),
        entry(0x6508, 0, "Operating time", U32, "ro", 0xFFFF_FFFF),
        entry(0x6509, 0, "Offset value", I32, "ro", 0),
        *array(0x650A, "Module identification", (("manufacturer offset value", I32, "ro", 0),)),
        entry(0x650B, 0, "Serial number", U32, "const", serial),
    ]  # fmt: skip


_COUNTER_PDOS = (
    PdoPlan(1, transmit=True, mapping=(0x60040020, 0x65030010)),
    PdoPlan(2, transmit=True, mapping=(0x20000120, 0x20000208)),
)


class Counter(Slave):
    """The counter as a node."""

    def __init__(
        self,
        node_id: int,
        counts_per_revolution: int,
        send: Send,
        *,
        total_range: int = 0,
        serial: int = 1,
    ) -> None:
        self._raw = self._true = self._shift = 0
        self._mirror = (1, 0)
        self._index = (0, 0)
        super().__init__(
            node_id,
            _counter_entries(node_id, counts_per_revolution, total_range, serial),
            _COUNTER_PDOS,
            send,
        )
        d = self.dictionary
        d.on_write(0x6000, 0, self._check_parameters)
        d.on_write(0x6003, 0, self._preset)
        d.on_read(0x6500, 0, lambda: d.value(0x6000))
        # The cyclic timer of older versions of the profile is the event timer of the first TPDO under another name.
        d.on_write(0x6200, 0, self._set_cyclic_timer)
        d.on_read(0x6200, 0, lambda: d.value(0x1800, 5))
        d.on_change(self._on_change)

    def take(self, raw: int, index: int, seen: int) -> None:
        """The count latched at this SYNC (unwrapped), the count at the latest index mark, and whether one was seen."""
        self._true = raw
        sense, origin = self._mirror
        raw, index = sense * raw + origin, sense * index + origin
        self._raw, self._index = raw, (index, seen)
        self._show()

    def _show(self) -> None:
        index, seen = self._index
        shown, store = self._shown(self._raw), self.dictionary.store
        store(0x6004, 0, shown)
        store(0x2000, 1, self._shown(index) if seen else 0)
        store(0x2000, 2, seen & 1)
        store(0x6509, 0, (self._shift + 0x8000_0000) % 0x1_0000_0000 - 0x8000_0000)

    def reverse(self) -> None:
        """Two lines are swapped: it counts the other way from where it is."""
        self._mirror = (-self._mirror[0], self._raw - (-self._mirror[0]) * self._true)

    def signal_error(self, is_wrong: bool) -> None:
        """The encoder's signals are not valid: alarm bit and emergency message."""
        self.dictionary.store(0x6503, 0, _POSITION_ERROR if is_wrong else 0)
        if is_wrong:
            self.emergency(_SENSOR_ERROR, 0x20)
        else:
            self.recover(_SENSOR_ERROR)

    def on_reset(self, application: bool) -> None:
        if application:
            self._shift = 0

    @property
    def modulus(self) -> int:
        """The total measuring range; 0 in 0x6002 stands for 2^32."""
        return self.dictionary.number(0x6002) or 0x1_0000_0000

    def _shown(self, raw: int) -> int:
        parameters = self.dictionary.number(0x6000)
        count = -raw if parameters & REVERSE_BIT else raw
        if parameters & SCALING_BIT:
            count = count * self.dictionary.number(0x6001) // self.dictionary.number(0x6501)
        return (count + self._shift) % self.modulus

    def _check_parameters(self, value: Number) -> None:
        if int(value) & ~(REVERSE_BIT | SCALING_BIT):
            raise AbortError(Abort.VALUE)

    def _preset(self, value: Number) -> None:
        if int(value) >= self.modulus:
            raise AbortError(Abort.TOO_HIGH)
        self._shift += int(value) - self._shown(self._raw)

    def _set_cyclic_timer(self, value: Number) -> None:
        self.dictionary.write(self.dictionary.entry(0x1800, 5), value)

    def _on_change(self, index: int, sub: int) -> None:
        if index in (0x6000, 0x6001, 0x6002, 0x6003):
            self._show()
