"""SDO client: byte pairs as in CiA 301, aborts in words, and any bytes at all for an answer."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.bus.cia301 import (
    I32,
    REAL32,
    U8,
    U16,
    U32,
    DataType,
    ObjectRef,
    data_type_named,
    error_code_text,
)
from drivers.bus.cia402.tables import ERROR_CODES
from drivers.bus.network import PumpedBus
from drivers.bus.sdo import SdoAbortError, SdoClient, SdoProtocolError, SdoTimeoutError
from drivers.clock import VirtualClock
from drivers.errors import DecodeError, DriverError
from tests.drivers.scripted_bus import ScriptedBus


def client(*script: tuple[str, list[str]]) -> tuple[ScriptedBus, SdoClient]:
    raw = ScriptedBus(list(script))
    return raw, SdoClient(PumpedBus(raw, VirtualClock()), 1)


def test_expedited_upload_of_every_length() -> None:
    raw, sdo = client(
        ("601 40 41 60 00 00 00 00 00", ["581 4B 41 60 00 37 02 00 00"]),
        ("601 40 01 10 00 00 00 00 00", ["581 4F 01 10 00 81 00 00 00"]),
        ("601 40 64 60 00 00 00 00 00", ["581 43 64 60 00 FE FF FF FF"]),
        ("601 40 02 20 03 00 00 00 00", ["581 42 02 20 03 01 02 03 04"]),
    )
    assert sdo.read_as(0x6041, 0, U16) == 0x0237
    assert sdo.upload(0x1001, 0) == b"\x81"
    assert sdo.read_as(0x6064, 0, I32) == -2
    assert sdo.upload(0x2002, 3) == bytes([1, 2, 3, 4])  # no size indicated
    raw.assert_finished()


def test_segmented_upload_of_a_device_name() -> None:
    raw, sdo = client(
        ("601 40 08 10 00 00 00 00 00", ["581 41 08 10 00 0A 00 00 00"]),
        ("601 60 00 00 00 00 00 00 00", ["581 00 53 47 44 56 2D 4F 43"]),
        ("601 70 00 00 00 00 00 00 00", ["581 19 42 30 31 00 00 00 00"]),
    )
    assert sdo.read_text(0x1008) == "SGDV-OCB01"
    raw.assert_finished()


def test_expedited_and_segmented_download() -> None:
    raw, sdo = client(
        ("601 2B 40 60 00 0F 00 00 00", ["581 60 40 60 00 00 00 00 00"]),
        ("601 21 01 20 00 09 00 00 00", ["581 60 01 20 00 00 00 00 00"]),
        ("601 00 31 32 33 34 35 36 37", ["581 20 00 00 00 00 00 00 00"]),
        ("601 1B 38 39 00 00 00 00 00", ["581 30 00 00 00 00 00 00 00"]),
    )
    sdo.write(ObjectRef(0x6040, 0, U16), 0x0F)
    sdo.download(0x2001, 0, b"123456789")
    raw.assert_finished()


def test_an_abort_is_told_in_words() -> None:
    raw, sdo = client(("601 40 76 60 00 00 00 00 00", ["581 80 76 60 00 00 00 02 06"]))
    with pytest.raises(SdoAbortError, match="does not exist in the object dictionary") as caught:
        sdo.upload(0x6076, 0)
    assert caught.value.is_missing
    assert caught.value.code == 0x06020000
    raw.assert_finished()


def test_a_late_answer_to_another_object_is_not_believed() -> None:
    raw, sdo = client(
        (
            "601 40 41 60 00 00 00 00 00",
            ["581 4B 40 60 00 FF FF 00 00", "581 4B 41 60 00 31 02 00 00"],
        )
    )
    assert sdo.read_as(0x6041, 0, U16) == 0x0231
    raw.assert_finished()


def test_silence_times_out_by_the_clock_and_is_aborted() -> None:
    raw, sdo = client(("601 40 00 10 00 00 00 00 00", []), ("601 80 00 10 00 00 00 04 05", []))
    with pytest.raises(SdoTimeoutError, match="within 300 ms"):
        sdo.upload(0x1000, 0)
    raw.assert_finished()


def test_a_toggle_that_does_not_alternate_is_aborted() -> None:
    raw, sdo = client(
        ("601 40 08 10 00 00 00 00 00", ["581 40 08 10 00 00 00 00 00"]),
        ("601 60 00 00 00 00 00 00 00", ["581 10 41 41 41 41 41 41 41"]),
        ("601 80 08 10 00 00 00 03 05", []),
    )
    with pytest.raises(SdoProtocolError, match="toggle"):
        sdo.upload(0x1008, 0)
    raw.assert_finished()


def test_a_length_that_was_not_kept_is_refused() -> None:
    _, sdo = client(
        ("601 40 08 10 00 00 00 00 00", ["581 41 08 10 00 20 00 00 00"]),
        ("601 60 00 00 00 00 00 00 00", ["581 0D 41 00 00 00 00 00 00"]),
    )
    with pytest.raises(SdoProtocolError, match="another length"):
        sdo.upload(0x1008, 0)


class Babbler(ScriptedBus):
    """Answers every request with the next of the given byte strings."""

    def __init__(self, answers: list[bytes]) -> None:
        super().__init__(None)
        self.answers = list(answers)

    def send(self, msg: object) -> None:
        if self.answers:
            self.feed(0x581, self.answers.pop(0))


ANSWERS = st.lists(
    st.one_of(
        st.binary(max_size=8),
        st.builds(
            lambda c, d: bytes([c, 0x08, 0x10, 0x00]) + d,
            st.integers(0, 255),
            st.binary(min_size=4, max_size=4),
        ),
    ),
    max_size=12,
)


@given(ANSWERS)
@settings(max_examples=300)
def test_any_answer_is_bytes_or_a_driver_error(answers: list[bytes]) -> None:
    for action in (
        lambda s: s.upload(0x1008, 0),
        lambda s: s.download(0x1008, 0, b"0123456789"),
        lambda s: s.read_text(0x1008),
    ):
        sdo = SdoClient(PumpedBus(Babbler(answers), VirtualClock()), 1)
        try:
            result = action(sdo)
        except DriverError:
            continue
        assert result is None or isinstance(result, bytes | str)


@given(ANSWERS)
@settings(max_examples=300)
def test_any_answer_to_a_posted_transfer_ends_it_and_raises_nothing(answers: list[bytes]) -> None:
    bus = PumpedBus(Babbler(answers), VirtualClock())
    sdo = SdoClient(bus, 1)
    for posted in (sdo.post_upload(0x1008, 0), sdo.post_download(0x1008, 0, b"0123456789")):
        for now in range(0, 40_000_000_000, 350_000_000):
            posted.turn(now)
            bus.drain()
        assert posted.is_over


def posted_bus() -> tuple[ScriptedBus, PumpedBus, SdoClient]:
    raw = ScriptedBus()
    bus = PumpedBus(raw, VirtualClock())
    return raw, bus, SdoClient(bus, 1)


def test_a_posted_transfer_sends_one_frame_a_turn_and_never_waits() -> None:
    raw, bus, sdo = posted_bus()
    posted = sdo.post_upload(0x1008, 0)
    assert raw.sent == []
    answers = ("41 08 10 00 0A 00 00 00", "00 53 47 44 56 2D 4F 43", "19 42 30 31 00 00 00 00")
    for number, answer in enumerate(answers, 1):
        posted.turn(0)
        posted.turn(0)
        assert len(raw.sent) == number
        raw.feed(0x581, bytes.fromhex(answer))
        bus.drain()
        assert len(raw.sent) == number
    assert posted.is_over
    assert posted.data == b"SGDV-OCB01"
    assert bus.clock.monotonic_ns() == 0


def test_a_posted_transfer_that_is_not_answered_is_given_up_by_the_clock() -> None:
    raw, _, sdo = posted_bus()
    posted = sdo.post_download(0x6040, 0, b"\2\0")
    posted.turn(0)
    posted.turn(300_000_000)
    assert not posted.is_over
    posted.turn(300_000_001)
    assert posted.is_over
    assert isinstance(posted.error, SdoTimeoutError)
    assert [data[0] for _, data in raw.sent] == [0x2B, 0x80]


def test_the_channel_has_one_owner_at_a_time() -> None:
    raw, bus, sdo = posted_bus()
    first = sdo.post_upload(0x6041, 0)
    first.turn(0)
    second = sdo.post_upload(0x6041, 0)
    assert first.is_over
    second.turn(0)
    raw.feed(0x581, bytes.fromhex("4B 41 60 00 37 02 00 00"))
    bus.drain()
    assert (first.data, second.data) == (b"", b"\x37\x02")
    third = sdo.post_upload(0x6041, 0)
    third.turn(0)
    with pytest.raises(SdoTimeoutError):
        sdo.upload(0x1000, 0)
    assert third.is_over
    raw.feed(0x581, bytes.fromhex("4B 41 60 00 37 02 00 00"))
    bus.drain()
    assert third.data == b""


@given(st.binary(max_size=10))
def test_numbers_of_any_bytes(data: bytes) -> None:
    for kind in (U8, U16, U32, I32, REAL32):
        if len(data) < kind.size:
            with pytest.raises(DecodeError):
                kind.decode(data)
        else:
            number = kind.decode(data)
            assert kind.is_float or kind.encode(number) == data[: kind.size]


def test_values_that_do_not_fit_are_refused() -> None:
    with pytest.raises(DriverError, match="does not fit"):
        U8.encode(256)
    with pytest.raises(DriverError, match="does not fit"):
        U16.encode(-1)
    assert data_type_named("i32") is I32
    assert isinstance(data_type_named("VISIBLE_STRING"), DataType)
    with pytest.raises(DriverError, match="unknown data type"):
        data_type_named("I31")


def test_error_codes_fall_back_on_their_group() -> None:
    assert error_code_text(0x8611, ERROR_CODES) == "following error"
    assert (
        error_code_text(0x2319, ERROR_CODES)
        == "continuous over-current on the output side (0x2319)"
    )
    assert error_code_text(0x8130) == "life guard or heartbeat error"
    assert "device specific" in error_code_text(0xFF07)
    assert "unknown" in error_code_text(0x0B00)
