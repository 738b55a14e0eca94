"""The ring of frames: what is kept, what is written, and that others' logs are read."""

from __future__ import annotations

from pathlib import Path

import can
import pytest

from drivers.bus.frame_log import ERROR, SENT, FrameLog, read_frames
from drivers.errors import DriverError

SECOND = 1_000_000_000


def test_what_is_written_is_read_again_as_it_was(tmp_path: Path) -> None:
    log = FrameLog(cycle_ns=SECOND // 100)
    log.put(1 * SECOND, 0x080, b"", SENT)
    log.put(2 * SECOND, 0x181, bytes(range(8)))
    log.put(3 * SECOND, 0x123, b"\x01", ERROR)
    path = tmp_path / "run-frames.log.gz"
    assert log.write(path, epoch_ns=1000 * SECOND) == 3
    sync, data, error = read_frames(path)
    assert (sync.arbitration_id, sync.is_rx, sync.timestamp) == (0x080, False, 1001.0)
    assert (data.arbitration_id, bytes(data.data), data.is_rx) == (0x181, bytes(range(8)), True)
    assert error.is_error_frame


@pytest.mark.parametrize("frames", [0, 1, 4095, 4096, 4097, 8192, 8193, 20_000])
def test_the_ring_keeps_the_latest_in_their_order(frames: int) -> None:
    """At least as many as it was made for, in two pieces of 4096."""
    log = FrameLog(cycle_ns=2 * SECOND)
    for number in range(frames):
        log.put(number, 0x181, number.to_bytes(2, "little"))
    kept = [int.from_bytes(one.data, "little") for one in log.messages(0)]
    assert kept == list(range(frames - len(kept), frames))
    assert len(kept) >= min(frames, 1000)


@pytest.mark.parametrize(
    "name", ["run-frames.log.gz", "00001-home-SN.1-frames.log.gz", "a.b.c.log.gz"]
)
def test_a_name_may_have_more_dots(name: str, tmp_path: Path) -> None:
    log = FrameLog(cycle_ns=SECOND)
    log.put(SECOND, 0x181, b"\x01")
    assert log.write(tmp_path / name, epoch_ns=0) == 1
    (message,) = read_frames(tmp_path / name)
    assert message.arbitration_id == 0x181


def test_only_the_last_seconds_are_written() -> None:
    log = FrameLog(cycle_ns=SECOND)
    for second in range(100):
        log.put(second * SECOND, 0x080, b"")
    assert len(list(log.messages(0, seconds=10.0))) == 11


@pytest.mark.parametrize("suffix", [".asc", ".blf", ".trc", ".log", ".csv", ".asc.gz"])
def test_logs_of_other_programs_are_read(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"foreign{suffix}"
    with can.Logger(str(path)) as log:
        for second in range(3):
            log.on_message_received(
                can.Message(
                    timestamp=100.0 + second,
                    arbitration_id=0x701,
                    data=b"\x05",
                    is_extended_id=False,
                    channel=1 if suffix == ".trc" else "1",
                )
            )
    found = list(read_frames(path))
    assert [one.arbitration_id for one in found] == [0x701] * 3


@pytest.mark.parametrize(
    ("name", "content"),
    [("x.log", b"\xff\xfe nothing"), ("x.txt", b"hello"), ("x.log.gz", b"no gzip")],
)
def test_what_is_no_log_is_refused_by_name(name: str, content: bytes, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(DriverError, match="no log of frames"):
        list(read_frames(path))
    with pytest.raises(DriverError, match="no log of frames"):
        list(read_frames(tmp_path / "missing.log"))
