"""A simulated encoder counter by CiA 406: the output encoder's position, its index latch, its alarms."""

from __future__ import annotations

from sim_backend.wire.dictionary import U8, U16, U32, Abort, AbortError, Entry, Number, array
from sim_backend.wire.pdo import Send
from sim_backend.wire.slave import PdoPlan, Slave, standard_entries

POSITION_ERROR = 0x0001
"""Bit 0 of the alarms 0x6503: the position value is not valid."""


def counter_entries(node_id: int, counts_per_revolution: int, total_range: int, serial: int) -> list[Entry]:
    """Every object that the simulated counter really has. `total_range` 0 stands for 2^32."""
    return [
        *standard_entries(node_id, 0x0002_0196, "Simulated encoder counter", 0x406, serial),
        *array(0x2000, "Index latch", (("position at the last mark", U32, "ro", 0), ("marks seen", U8, "ro", 0)), mappable="t"),
        Entry(0x6000, 0, "Operating parameters", U16, "rw", 0, high=0x0F),
        Entry(0x6001, 0, "Measuring units per revolution", U32, "rw", counts_per_revolution, low=1),
        Entry(0x6002, 0, "Total measuring range in measuring units", U32, "rw", total_range),
        Entry(0x6003, 0, "Preset value", U32, "rw", 0),
        Entry(0x6004, 0, "Position value", U32, "ro", 0, "t"),
        Entry(0x6500, 0, "Operating status", U16, "ro", 0, "t"),
        Entry(0x6501, 0, "Single-turn resolution", U32, "const", counts_per_revolution),
        Entry(0x6502, 0, "Number of distinguishable revolutions", U16, "const", 1),
        Entry(0x6503, 0, "Alarms", U16, "ro", 0, "t"),
        Entry(0x6504, 0, "Supported alarms", U16, "const", POSITION_ERROR),
        Entry(0x6505, 0, "Warnings", U16, "ro", 0, "t"),
        Entry(0x6506, 0, "Supported warnings", U16, "const", 0),
    ]  # fmt: skip


COUNTER_PDOS = (
    PdoPlan(1, transmit=True, mapping=(0x60040020, 0x65030010)),
    PdoPlan(2, transmit=True, mapping=(0x20000120, 0x20000208)),
)


class Counter(Slave):
    """The counter as a node. Position = direction * raw + preset shift, modulo the total range."""

    def __init__(self, node_id: int, counts_per_revolution: int, send: Send, *, total_range: int = 0, serial: int = 1) -> None:
        super().__init__(node_id, counter_entries(node_id, counts_per_revolution, total_range, serial), COUNTER_PDOS, send)
        self._raw = 0
        self._shift = 0
        self.dictionary.on_write(0x6003, 0, self._preset)

    def take(self, raw: int, index: int, seen: int) -> None:
        """The count latched at this SYNC (unwrapped), the latched index position, and whether a mark was seen."""
        self._raw = raw
        self.dictionary.store(0x6004, 0, self._shown(raw))
        self.dictionary.store(0x2000, 1, self._shown(index))
        self.dictionary.store(0x2000, 2, (seen >> 1) & 1)

    def signal_error(self, is_wrong: bool) -> None:
        """The encoder's signals are not valid: alarm bit and emergency message."""
        self.dictionary.store(0x6503, 0, POSITION_ERROR if is_wrong else 0)
        self.emergency(0x7305 if is_wrong else 0, 0x81)

    def _shown(self, raw: int) -> int:
        direction = -1 if self.dictionary.number(0x6000) & 1 else 1
        modulus = self.dictionary.number(0x6002) or 0x1_0000_0000
        return (direction * raw + self._shift) % modulus

    def _preset(self, value: Number) -> None:
        modulus = self.dictionary.number(0x6002) or 0x1_0000_0000
        if int(value) >= modulus:
            raise AbortError(Abort.TOO_HIGH)
        self._shift += int(value) - self._shown(self._raw)
