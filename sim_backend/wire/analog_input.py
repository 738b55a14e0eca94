"""A simulated analogue input module by CiA 401: 16-bit left-aligned values, 0.3125 mV per increment, +-10.24 V.

Its converters give 14 bits for the two monitors (steps of four increments, which the plant's instruments make) and more
for the thermometers. Event-driven transmission is off until 0x6423 allows it, as the profile demands.
"""

from __future__ import annotations

from sim_backend.wire.dictionary import BOOLEAN, I16, I32, U8, U32, Entry, array
from sim_backend.wire.pdo import Send
from sim_backend.wire.slave import PdoPlan, Slave, standard_entries

CHANNELS = 4
TORQUE_MONITOR, SPEED_MONITOR, HOUSING, ROOM = 1, 2, 3, 4
"""What is connected to which input."""
UPPER_LIMIT, LOWER_LIMIT, DELTA = 0x01, 0x02, 0x04
"""Bits of the interrupt trigger selection 0x6421."""
_ALL_EVENTS = UPPER_LIMIT | LOWER_LIMIT | DELTA


def _analog_input_entries(node_id: int, serial: int) -> list[Entry]:
    """Every object that the simulated module really has. Limits and deltas are left-aligned in 32 bits."""
    numbered = [f"input {i}" for i in range(1, CHANNELS + 1)]
    return [
        *standard_entries(node_id, 0x0004_0191, "Simulated analogue input", 0x401, serial),
        *array(
            0x6401,
            "Read analogue input 16-bit",
            [(n, I16, "ro", 0) for n in numbered],
            mappable="t",
        ),
        *array(
            0x6421,
            "Analogue input interrupt trigger selection",
            [(n, U8, "rw", _ALL_EVENTS) for n in numbered],
            high=_ALL_EVENTS,
        ),
        Entry(
            index=0x6423,
            sub=0,
            name="Analogue input global interrupt enable",
            type=BOOLEAN,
            access="rw",
            default=False,
        ),
        *array(
            0x6424, "Analogue input interrupt upper limit", [(n, I32, "rw", 0) for n in numbered]
        ),
        *array(
            0x6425, "Analogue input interrupt lower limit", [(n, I32, "rw", 0) for n in numbered]
        ),
        *array(0x6426, "Analogue input interrupt delta", [(n, U32, "rw", 0) for n in numbered]),
    ]


_ANALOG_INPUT_PDOS = (
    PdoPlan(1, transmit=True, mapping=(), transmission=255, exists=False),
    PdoPlan(
        2,
        transmit=True,
        mapping=tuple(0x64010010 | i << 8 for i in range(1, CHANNELS + 1)),
        transmission=255,
    ),
)


class AnalogInput(Slave):
    """The module as a node: input 1 torque monitor, 2 speed monitor, 3 and 4 temperatures of housing and room."""

    def __init__(self, node_id: int, send: Send, *, serial: int = 1) -> None:
        self._sent_values = [0] * (CHANNELS + 1)
        super().__init__(node_id, _analog_input_entries(node_id, serial), _ANALOG_INPUT_PDOS, send)

    def take(self, increments: tuple[int, ...]) -> None:
        """The increments latched at this SYNC, input 1 first; beyond the range the converter stands at its end."""
        store = self.dictionary.store
        for sub, value in enumerate(increments, 1):
            store(0x6401, sub, min(max(value, -32768), 32767))
        if self.dictionary.value(0x6423) and any(pdo.takes_events for pdo in self.tpdos):
            for sub in range(1, len(increments) + 1):
                if self._is_event(sub):
                    self._sent_values[sub] = self.dictionary.number(0x6401, sub)
                    self.value_changed(0x6401, sub)

    def on_reset(self, application: bool) -> None:
        self._sent_values = [0] * (CHANNELS + 1)

    def _is_event(self, sub: int) -> bool:
        number = self.dictionary.number
        value, sent, trigger = number(0x6401, sub), self._sent_values[sub], number(0x6421, sub)
        if value == sent:
            return False
        beyond = [number(0x6424, sub) >> 16, number(0x6425, sub) >> 16]
        return bool(
            (trigger & UPPER_LIMIT and value >= beyond[0])
            or (trigger & LOWER_LIMIT and value < beyond[1])
            or (trigger & DELTA and abs(value - sent) << 16 > number(0x6426, sub))
        )
