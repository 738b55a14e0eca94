"""The SDO server, byte by byte (CiA 301, 7.2.4.3)."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.sim_backend.wire.slaves import analog, ask, counter, drive

PAIRS = (
    # request, response
    ("40 00 10 00", "43 00 10 00 92 01 02 00"),  # device type, four bytes expedited
    ("40 05 10 00", "43 05 10 00 80 00 00 00"),
    ("40 17 10 00", "4B 17 10 00 00 00 00 00"),  # two bytes
    ("40 01 10 00", "4F 01 10 00 00 00 00 00"),  # one byte
    ("40 18 10 00", "4F 18 10 00 04 00 00 00"),
    ("40 41 60 00", "4B 41 60 00 50 02 00 00"),
    ("2B 17 10 00 64 00", "60 17 10 00 00 00 00 00"),  # 100 ms
    (
        "22 17 10 00 64 00",
        "60 17 10 00 00 00 00 00",
    ),  # expedited without a size: the object's own length
    ("40 34 12 00", "80 34 12 00 00 00 02 06"),  # no object
    ("40 18 10 09", "80 18 10 09 11 00 09 06"),  # no sub-index
    ("2F 41 60 00 01", "80 41 60 00 02 00 01 06"),  # read only
    ("2F 17 10 00 64", "80 17 10 00 13 00 07 06"),  # too short
    ("23 17 10 00 64 00 00 00", "80 17 10 00 12 00 07 06"),  # too long
    ("21 17 10 00 08 00 00 00", "80 17 10 00 12 00 07 06"),  # too long already when announced
    ("21 41 60 00 02 00 00 00", "80 41 60 00 02 00 01 06"),  # read only already when announced
    ("21 17 10 00 FF FF FF 00", "80 17 10 00 05 00 04 05"),  # out of memory
    ("2B 07 60 00 04 00", "80 07 60 00 31 00 09 06"),  # too high
    ("2F 60 60 00 07", "80 60 60 00 30 00 09 06"),  # a mode that it does not have
    ("A0 00 10 00 7F", "80 00 10 00 01 00 04 05"),  # block upload is not offered
    ("C0 17 10 00", "80 17 10 00 01 00 04 05"),  # block download neither
    ("40 03 10 01", "80 03 10 01 24 00 00 08"),  # no error has been: no data
    ("2F 03 10 00 01", "80 03 10 00 30 00 09 06"),  # the history takes only 0
    ("2F 03 10 00 00", "60 03 10 00 00 00 00 00"),
    ("2F 19 10 00 01", "80 19 10 00 30 00 09 06"),
    ("23 05 10 00 80 00 00 40", "80 05 10 00 30 00 09 06"),  # it produces no SYNC
)


@pytest.mark.parametrize(("request_", "response"), PAIRS)
def test_one_request_one_response(request_: str, response: str) -> None:
    slave, sent = drive()
    assert ask(slave, sent, bytes.fromhex(request_)).hex(" ").upper() == response


def test_a_long_text_comes_in_segments() -> None:
    slave, sent = drive()
    name = b"Simulated servo amplifier"
    assert ask(slave, sent, b"\x40\x08\x10\x00") == b"\x41\x08\x10\x00" + struct.pack(
        "<I", len(name)
    )
    assert ask(slave, sent, b"\x60") == b"\x00Simulat"
    assert ask(slave, sent, b"\x70") == b"\x10ed serv"
    assert ask(slave, sent, b"\x60") == b"\x00o ampli"
    # The last one: four bytes, three unused.
    assert ask(slave, sent, b"\x70") == b"\x17fier\0\0\0"
    assert ask(slave, sent, b"\x60")[0] == 0x80


def test_a_wrong_toggle_aborts_and_names_the_object() -> None:
    slave, sent = drive()
    ask(slave, sent, b"\x40\x08\x10\x00")
    assert ask(slave, sent, b"\x70") == bytes.fromhex("80 08 10 00 00 00 03 05")


def test_a_download_in_segments() -> None:
    slave, sent = drive()
    assert ask(slave, sent, b"\x21\x17\x10\x00\x02\0\0\0") == bytes.fromhex(
        "60 17 10 00 00 00 00 00"
    )
    assert ask(slave, sent, bytes([0x01 | 5 << 1]) + b"\xf4\x01") == b"\x20" + bytes(7)
    assert slave.dictionary.number(0x1017) == 500


def test_a_download_of_another_length_than_announced_is_refused() -> None:
    slave, sent = drive()
    ask(slave, sent, b"\x21\x17\x10\x00\x02\0\0\0")
    assert ask(slave, sent, bytes([0x01 | 6 << 1]) + b"\xf4") == bytes.fromhex(
        "80 17 10 00 10 00 07 06"
    )


def test_an_abort_of_the_client_is_not_answered_and_ends_the_transfer() -> None:
    slave, sent = drive()
    ask(slave, sent, b"\x40\x08\x10\x00")
    sent.clear()
    slave.receive(0x601, bytes.fromhex("80 08 10 00 00 00 04 05"), 0)
    assert not sent
    assert ask(slave, sent, b"\x60")[0] == 0x80


@settings(max_examples=100)
@given(st.lists(st.binary(max_size=9), max_size=12), st.integers(0, 2))
def test_any_bytes_get_an_answer_or_none(requests: list[bytes], which: int) -> None:
    slave, sent = (drive, counter, analog)[which]()
    for request in requests:
        sent.clear()
        slave.receive(0x600 + slave.node_id, request, 0)
        answers = [data for cob_id, data in sent if cob_id == 0x580 + slave.node_id]
        assert len(answers) <= 1
        assert all(len(data) == 8 for data in answers)


@settings(max_examples=100)
@given(st.lists(st.tuples(st.integers(0, 0x7FF), st.binary(max_size=8)), max_size=15))
def test_any_frames_leave_it_alive(frames: list[tuple[int, bytes]]) -> None:
    slave, sent = drive()
    for now, (cob_id, data) in enumerate(frames):
        slave.receive(cob_id, data, now * 1_000_000)
        slave.latch()
        slave.apply_synchronous()
        slave.send_synchronous()
        slave.tick(now * 1_000_000)
    slave.receive(0x000, b"\x80\x00", 0)
    assert ask(slave, sent, b"\x40\x00\x10\x00")[0] == 0x43
