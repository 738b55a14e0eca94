"""The simulated counter (CiA 406) and the simulated analogue input (CiA 401)."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.sim_backend.wire.slaves import analog, counter, read, start, write


@given(st.integers(-(2**40), 2**40), st.sampled_from([0, 720_000, 1 << 16]))
def test_the_position_wraps_at_its_range(raw: int, total_range: int) -> None:
    made, _ = counter(total_range)
    made.take(raw, 0, 0)
    assert read(made, 0x6004) == raw % (total_range or 1 << 32)


def test_device_types_say_what_they_are() -> None:
    assert read(counter()[0], 0x1000) == 0x0005_0196
    assert read(analog()[0], 0x1000) == 0x0004_0191


def test_sense_preset_and_status() -> None:
    made, sent = counter(720_000)
    made.take(100, 0, 0)
    assert write(made, sent, 0x6000, 0, 1, 2) == 0
    assert read(made, 0x6004) == 720_000 - 100
    assert read(made, 0x6500) == 1
    assert write(made, sent, 0x6003, 0, 5000, 4) == 0
    made.take(100, 0, 0)
    assert read(made, 0x6004) == 5000
    made.take(90, 0, 0)
    assert read(made, 0x6004) == 5010
    assert write(made, sent, 0x6003, 0, 720_000, 4) == 0x06090031
    assert write(made, sent, 0x6000, 0, 2, 2) == 0x06090030


def test_scaling() -> None:
    made, sent = counter()
    write(made, sent, 0x6001, 0, 3600, 4)
    made.take(72_000 + 20, 0, 0)
    assert read(made, 0x6004) == 72_020
    write(made, sent, 0x6000, 0, 4, 2)
    assert read(made, 0x6004) == 3601


def test_the_index_latch_follows_the_position_s_own_scale() -> None:
    made, _sent = counter()
    made.take(500, 0, 0)
    assert (read(made, 0x2000, 1), read(made, 0x2000, 2)) == (0, 0)
    made.take(900, 800, 1)
    assert (read(made, 0x2000, 1), read(made, 0x2000, 2)) == (800, 1)


def test_the_cyclic_timer_is_the_event_timer() -> None:
    made, sent = counter()
    assert write(made, sent, 0x6200, 0, 40, 2) == 0
    assert read(made, 0x1800, 5) == 40
    assert read(made, 0x6200) == 40


def test_a_signal_error_is_an_alarm_and_an_emergency() -> None:
    made, sent = counter()
    made.signal_error(True)
    made.signal_error(True)
    assert sent.taken() == [(0x082, bytes.fromhex("00 73 21 00 00 00 00 00"))]
    assert read(made, 0x6503) == 1
    made.signal_error(False)
    assert sent.taken() == [(0x082, bytes(8))]
    assert read(made, 0x6503) == 0


def test_a_reversed_encoder_keeps_its_place() -> None:
    made, _ = counter()
    shown = []
    for k in range(6):
        if k in (2, 4):
            made.reverse()
        made.take(100 + 10 * k, 0, 0)
        shown.append(read(made, 0x6004))
    assert shown == [100, 110, 100, 90, 100, 110]


@pytest.mark.parametrize(
    ("value", "shown"), [(-40_000, -32768), (40_000, 32767), (-123, -123), (32767, 32767)]
)
def test_a_converter_stands_at_its_end(value: int, shown: int) -> None:
    made, _ = analog()
    made.take((value, 0, 0, 0))
    assert made.dictionary.number(0x6401, 1) == shown


def test_events_only_when_allowed_and_beyond_the_delta() -> None:
    made, sent = analog()
    for sub in range(1, 5):
        write(made, sent, 0x6421, sub, 4, 1)
    start(made)
    sent.clear()
    made.take((100, 0, 0, 0))
    assert not sent, "0x6423 is FALSE by default"
    write(made, sent, 0x6423, 0, 1, 1)
    write(made, sent, 0x6426, 1, 10 << 16, 4)
    sent.clear()
    for value in (150, 155, 160, 161):
        made.take((value, 0, 0, 0))
    assert [data[:2] for _, data in sent] == [b"\x96\0", b"\xa1\0"]


def test_limits_as_triggers() -> None:
    made, sent = analog()
    write(made, sent, 0x6423, 0, 1, 1)
    write(made, sent, 0x6421, 1, 1, 1)
    write(made, sent, 0x6424, 1, 500 << 16, 4)
    for sub in (2, 3, 4):
        write(made, sent, 0x6421, sub, 0, 1)
    start(made)
    sent.clear()
    for value in (499, 500, 400):
        made.take((value, 0, 0, 0))
    assert len(sent) == 1
    assert write(made, sent, 0x6421, 1, 0x10, 1) == 0x06090031
