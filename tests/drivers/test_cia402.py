"""The servo amplifier byte for byte: transitions, fault reset, mapping, units; with nothing but a
script on the other side.
"""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.bus.cia402 import stop_words
from drivers.bus.cia402 import tables as obj
from drivers.bus.cia402.config import DriveConfig
from drivers.bus.cia402.drive import ServoAmplifier
from drivers.bus.cia402.plausible import unit_si
from drivers.bus.device import RemoteDevice
from drivers.bus.network import PumpedBus
from drivers.bus.pdo import map_objects
from drivers.clock import VirtualClock
from drivers.drive_state import STATUSWORD_OF, DriveState, drive_state
from drivers.errors import DriverError, ReadbackError
from tests.drivers.scripted_bus import ScriptedBus

READ_STATUS = "601 40 41 60 00 00 00 00 00"
READ_ERROR = "601 40 3F 60 00 00 00 00 00"


def status(word: int) -> list[str]:
    return [f"581 4B 41 60 00 {word & 0xFF:02X} {word >> 8:02X} 00 00"]


def control(word: int) -> tuple[str, list[str]]:
    return f"601 2B 40 60 00 {word:02X} 00 00 00", ["581 60 40 60 00 00 00 00 00"]


def amplifier(*script: tuple[str, list[str]]) -> tuple[ScriptedBus, ServoAmplifier]:
    raw = ScriptedBus(list(script))
    return raw, ServoAmplifier(PumpedBus(raw, VirtualClock()), DriveConfig())


def test_the_way_to_operation_enabled() -> None:
    raw, drive = amplifier(
        (READ_STATUS, status(0x0250)),
        control(0x06),
        (READ_STATUS, status(0x0231)),
        control(0x07),
        (READ_STATUS, status(0x0233)),
        control(0x0F),
        (READ_STATUS, status(0x0233)),
        (READ_STATUS, status(0x0237)),
    )
    drive._walk(obj.TO_ENABLED, DriveState.ENABLED, "operation enabled")
    raw.assert_finished()


def test_an_enabled_drive_is_quick_stopped_before_its_power_goes_off() -> None:
    raw, drive = amplifier(
        (READ_STATUS, status(0x0237)),
        control(0x02),
        (READ_STATUS, status(0x0217)),
        ("601 40 6C 60 00 00 00 00 00", ["581 43 6C 60 00 64 00 00 00"]),
        (READ_STATUS, status(0x0217)),
        (READ_STATUS, status(0x0217)),
        ("601 40 6C 60 00 00 00 00 00", ["581 43 6C 60 00 00 00 00 00"]),
        (READ_STATUS, status(0x0217)),
        (READ_STATUS, status(0x0217)),
        control(0x00),
        (READ_STATUS, status(0x0250)),
    )
    drive.to_off()
    raw.assert_finished()


def test_a_fault_is_reset_by_a_rising_edge() -> None:
    raw, drive = amplifier(
        (READ_STATUS, status(0x0218)),
        (READ_STATUS, status(0x0218)),
        control(0x00),
        control(0x80),
        (READ_ERROR, ["581 4B 3F 60 00 11 86 00 00"]),
        (READ_STATUS, status(0x0218)),
        (READ_STATUS, status(0x0250)),
        control(0x00),
    )
    drive.reset_fault()
    raw.assert_finished()
    assert "following error" in drive.bus.events()[-1].text


def test_a_drive_that_does_not_obey_is_told_with_its_state() -> None:
    raw = ScriptedBus(None)

    class Stubborn(ScriptedBus):
        def send(self, msg: object) -> None:
            data = bytes(msg.data)  # type: ignore[attr-defined]
            answer = "4B 41 60 00 31 02 00 00" if data[0] == 0x40 else "60 40 60 00 00 00 00 00"
            self.feed(0x581, bytes.fromhex(answer.replace(" ", "")))

    raw = Stubborn(None)
    clock = VirtualClock()
    drive = ServoAmplifier(PumpedBus(raw, clock), DriveConfig(state_timeout_ms=100))
    with pytest.raises(
        DriverError, match=r"does not reach operation enabled; value ready to switch on \(0x0231\)"
    ):
        drive._walk(obj.TO_ENABLED, DriveState.ENABLED, "operation enabled")
    assert clock.monotonic_ns() <= 200_000_000


def test_the_mapping_procedure_is_that_of_the_standard() -> None:
    ok = "581 60 {} 00 00 00 00"
    raw = ScriptedBus(
        [
            ("602 40 00 18 01 00 00 00 00", ["582 43 00 18 01 82 01 00 40"]),
            ("602 23 00 18 01 82 01 00 C0", [ok.format("00 18 01").replace("581", "582")]),
            ("602 2F 00 1A 00 00 00 00 00", ["582 60 00 1A 00 00 00 00 00"]),
            ("602 23 00 1A 01 20 00 04 60", ["582 60 00 1A 01 00 00 00 00"]),
            ("602 2F 00 1A 00 01 00 00 00", ["582 60 00 1A 00 00 00 00 00"]),
            ("602 2F 00 18 02 01 00 00 00", ["582 60 00 18 02 00 00 00 00"]),
            ("602 40 00 18 03 00 00 00 00", ["582 4B 00 18 03 00 00 00 00"]),
            ("602 40 00 18 05 00 00 00 00", ["582 4B 00 18 05 64 00 00 00"]),
            ("602 2B 00 18 05 00 00 00 00", ["582 60 00 18 05 00 00 00 00"]),
            ("602 40 00 18 06 00 00 00 00", ["582 80 00 18 06 11 00 09 06"]),
            ("602 23 00 18 01 82 01 00 40", ["582 60 00 18 01 00 00 00 00"]),
            ("602 40 00 18 01 00 00 00 00", ["582 43 00 18 01 82 01 00 40"]),
            ("602 40 00 18 02 00 00 00 00", ["582 4F 00 18 02 01 00 00 00"]),
            ("602 40 00 1A 00 00 00 00 00", ["582 4F 00 1A 00 01 00 00 00"]),
            ("602 40 00 1A 01 00 00 00 00", ["582 43 00 1A 01 20 00 04 60"]),
            ("602 40 01 18 01 00 00 00 00", ["582 80 01 18 01 00 00 02 06"]),
        ]
    )
    from drivers.bus.cia406 import POSITION

    device = RemoteDevice(PumpedBus(raw, VirtualClock()), 2)
    (pdo,) = map_objects(device, [POSITION], is_transmit=True)
    assert (pdo.cob_id, pdo.length, pdo.offset_of(POSITION.key)) == (0x182, 4, 0)
    raw.assert_finished()


def test_a_fixed_mapping_is_used_as_it_is() -> None:
    missing = "80 {} 00 00 02 06"
    raw = ScriptedBus(
        [
            ("602 40 00 18 01 00 00 00 00", ["582 43 00 18 01 82 01 00 40"]),
            ("602 23 00 18 01 82 01 00 C0", ["582 80 00 18 01 02 00 01 06"]),
            ("602 2F 00 1A 00 00 00 00 00", ["582 80 00 1A 00 02 00 01 06"]),
            ("602 40 00 18 01 00 00 00 00", ["582 43 00 18 01 82 01 00 40"]),
            *(
                (f"602 40 {n:02X} 18 01 00 00 00 00", [f"582 {missing.format(f'{n:02X} 18 01')}"])
                for n in range(1, 8)
                for _ in (0, 1)
            ),
            ("602 40 00 18 01 00 00 00 00", ["582 43 00 18 01 82 01 00 40"]),
            ("602 40 00 18 02 00 00 00 00", ["582 4F 00 18 02 01 00 00 00"]),
            ("602 40 00 1A 00 00 00 00 00", ["582 4F 00 1A 00 02 00 00 00"]),
            ("602 40 00 1A 01 00 00 00 00", ["582 43 00 1A 01 10 00 00 65"]),
            ("602 40 00 1A 02 00 00 00 00", ["582 43 00 1A 02 20 00 04 60"]),
            *(
                (f"602 40 {n:02X} 18 01 00 00 00 00", [f"582 {missing.format(f'{n:02X} 18 01')}"])
                for n in range(1, 8)
            ),
            ("602 40 01 18 01 00 00 00 00", ["582 80 01 18 01 00 00 02 06"]),
        ]
    )
    from drivers.bus.cia406 import POSITION

    device = RemoteDevice(PumpedBus(raw, VirtualClock()), 2)
    (pdo,) = map_objects(device, [POSITION], is_transmit=True)
    assert (pdo.length, pdo.offset_of(POSITION.key)) == (6, 2)
    raw.assert_finished()


@given(st.integers(0, 0xFFFF))
def test_every_statusword_is_a_state(word: int) -> None:
    state = drive_state(word)
    assert state in DriveState
    if state in STATUSWORD_OF:
        assert drive_state(STATUSWORD_OF[state]) is state


def test_the_tables_lead_somewhere_from_every_state() -> None:
    for table in (obj.TO_ENABLED, stop_words.TO_OFF):
        assert set(table) >= {
            DriveState.SWITCH_ON_DISABLED,
            DriveState.READY,
            DriveState.SWITCHED_ON,
            DriveState.QUICK_STOP,
        }
        assert not set(table) & {
            DriveState.FAULT,
            DriveState.FAULT_REACTION,
            DriveState.NOT_READY,
            DriveState.UNKNOWN,
        }


@pytest.mark.parametrize(
    ("word", "unit"),
    [
        (0x00B44700, 2 * math.pi / 60),
        (0xFDB44700, 2e-3 * math.pi / 60),
        (0x00B50300, 2 * math.pi / 32768),
        (0x00410300, math.pi / 180),
        (0x00100300, 1.0),
        (0x00C00300, 2 * math.pi / 60),
        (0x00B45700, 2 * math.pi),
    ],
)
def test_unit_words(word: int, unit: float) -> None:
    assert unit_si(word, 32768) == pytest.approx(unit, rel=1e-12)


@given(st.integers(0, 2**32 - 1), st.floats(0, 1e9))
def test_any_unit_word_is_a_positive_unit_or_none(word: int, counts: float) -> None:
    unit = unit_si(word, counts)
    assert unit is None or unit > 0.0


def test_a_mode_that_is_not_taken_is_an_error() -> None:
    class Deaf(ScriptedBus):
        def send(self, msg: object) -> None:
            data = bytes(msg.data)  # type: ignore[attr-defined]
            self.feed(0x581, (b"\x4f" if data[0] == 0x40 else b"\x60") + data[1:4] + b"\x03\0\0\0")

    drive = ServoAmplifier(PumpedBus(Deaf(None), VirtualClock()), DriveConfig())
    with pytest.raises(ReadbackError, match="does not take the mode"):
        drive.choose_mode(obj.OperationMode.CYCLIC_TORQUE)
    drive.choose_mode(obj.OperationMode.PROFILE_VELOCITY)
