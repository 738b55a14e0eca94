"""A simulated analogue input module by CiA 401: 14 bits over +-10.24 V, 16-bit left-aligned, 0.3125 mV per increment."""

from __future__ import annotations

from sim_backend.wire.dictionary import BOOLEAN, I16, U8, Entry, array
from sim_backend.wire.pdo import Send
from sim_backend.wire.slave import PdoPlan, Slave, standard_entries

VOLTS_PER_INCREMENT = 10.24 / 32768.0
CHANNELS = 4


def analog_input_entries(node_id: int, serial: int) -> list[Entry]:
    """Every object that the simulated module really has."""
    inputs = [(f"input {i}", I16, "ro", 0) for i in range(1, CHANNELS + 1)]
    triggers = [(f"input {i}", U8, "rw", 7) for i in range(1, CHANNELS + 1)]
    return [
        *standard_entries(node_id, 0x0004_0191, "Simulated analogue input", 0x401, serial),
        *array(0x6401, "Read analogue input 16-bit", inputs, mappable="t"),  # type: ignore[arg-type]
        *array(0x6421, "Analogue input interrupt trigger selection", triggers),  # type: ignore[arg-type]
        Entry(0x6423, 0, "Analogue input global interrupt enable", BOOLEAN, "rw", False),
    ]


ANALOG_INPUT_PDOS = (
    PdoPlan(1, transmit=True, mapping=(), transmission=255),
    PdoPlan(2, transmit=True, mapping=(0x64010110, 0x64010210, 0x64010310, 0x64010410)),
)


class AnalogInput(Slave):
    """The module as a node: input 1 torque monitor, 2 speed monitor, 3 and 4 temperatures."""

    def __init__(self, node_id: int, send: Send, *, serial: int = 1) -> None:
        super().__init__(node_id, analog_input_entries(node_id, serial), ANALOG_INPUT_PDOS, send)

    def take(self, increments: tuple[int, ...]) -> None:
        """The increments latched at this SYNC, input 1 first; beyond the range the converter stands at its end."""
        for sub, value in enumerate(increments, 1):
            held = max(-32768, min(32767, value))
            changed = held != self.dictionary.number(0x6401, sub)
            self.dictionary.store(0x6401, sub, held)
            if changed and self.dictionary.value(0x6423):
                self.value_changed(0x6401, sub)
