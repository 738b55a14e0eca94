"""Two readers of one file: where canopen and the tolerant reader agree, where they do not, and who holds."""

from __future__ import annotations

import configparser
import io
import logging
import random
from pathlib import Path

import pytest
from canopen.objectdictionary import ODVariable
from canopen.objectdictionary.eds import import_eds

from drivers.bus.cia301 import U16, U32, data_type_named
from drivers.bus.dictionary.device_file import load_device_file, read_device_file
from drivers.bus.dictionary.eds import EdsEntry, parse_eds
from drivers.errors import DecodeError, DriverError
from sim_backend.wire.eds import electronic_data_sheet
from tests.drivers.canopen_peer import analog_eds, counter_eds, drive_eds
from tests.drivers.test_eds import GOOD
from tests.sim_backend.wire.slaves import analog, counter, drive

VARIABLE = "[2000]\nParameterName=gain\nObjectType=0x7\nAccessType=rw\n"
COMPACT = (
    "[2000]\nParameterName=gains\nObjectType=0x8\nDataType=0x0006\nAccessType=rw\n"
    "CompactSubObj=8\nDefaultValue=7\n"
)
SHEETS = {
    f"simulated {name}": electronic_data_sheet(
        make()[0].dictionary, product=name, vendor="nobody", vendor_number=0
    )
    for name, make in (("drive", drive), ("counter", counter), ("analog", analog))
} | {"peer drive": drive_eds(), "peer counter": counter_eds(), "peer analog": analog_eds()}


def by_canopen(text: str, key: tuple[int, int]) -> ODVariable | None:
    entry = import_eds(io.StringIO(text), 3)[key[0]]
    return entry if isinstance(entry, ODVariable) else entry.subindices.get(key[1])


def entry_of(text: str, key: tuple[int, int] = (0x2000, 0)) -> EdsEntry:
    entry = read_device_file(text.encode(), 3).entry(*key)
    assert entry is not None
    return entry


@pytest.mark.parametrize("name", SHEETS)
def test_both_read_every_sheet_that_we_have_alike(name: str) -> None:
    data = SHEETS[name].encode()
    both, ours = read_device_file(data, 3), parse_eds(data, 3)
    assert both.entries == ours.entries
    assert both.defects == ours.defects


# On these sound files they disagree: what the library makes of it, what holds.
DISAGREEMENTS = [
    ("DataType=0x0003\nDefaultValue=0xFFFF\n", "default", 65535, -1),
    ("DataType=0x0010\nLowLimit=0x800000\n", "min", None, -(1 << 23)),
    ("DataType=0x0015\nDefaultValue=0xFFFFFFFFFFFFFFFF\n", "default", (1 << 64) - 1, -1),
    ("DataType=0x0008\nDefaultValue=0x3F800000\n", "default", None, 1.0),
    ("DataType=0x0008\nLowLimit=0.5\n", "min", None, 0.5),
    ("DataType=0x0007\nLowLimit=$NODEID+1\n", "min", None, 4),
    ("DataType=0x0007\nDefaultValue=010\n", "default", None, 8),
    ("DataType=0x0007\nDefaultValue=12;twelve\n", "default", None, 12),
    ('DataType=0x0009\nDefaultValue="abc"\n', "default", '"abc"', "abc"),
]


@pytest.mark.parametrize(("lines", "name", "theirs", "holds"), DISAGREEMENTS)
def test_where_they_disagree_on_a_sound_value_the_one_that_the_standard_means_holds(
    lines: str, name: str, theirs: object, holds: object
) -> None:
    text = GOOD + VARIABLE + lines
    variable = by_canopen(text, (0x2000, 0))
    assert variable is not None
    assert getattr(variable, name) == theirs
    assert getattr(entry_of(text), {"min": "low"}.get(name, name)) == holds


def test_of_a_compact_array_the_library_keeps_the_first_entry_alone() -> None:
    text = GOOD + COMPACT
    assert by_canopen(text, (0x2000, 8)) is None
    assert (entry_of(text, (0x2000, 8)).data_type, entry_of(text, (0x2000, 8)).default) == (U16, 7)
    with pytest.raises(configparser.NoOptionError):
        by_canopen(text + "[2000Name]\nNrOfEntries=1\n2=two\n", (0x2000, 2))


def test_a_type_that_the_file_defines_itself_is_the_librarys_to_know() -> None:
    own_type = (
        "[A0]\nParameterName=range\nObjectType=0x6\nSubNumber=2\n"
        "[A0sub0]\nParameterName=count\nDataType=5\nAccessType=const\nDefaultValue=1\n"
        "[A0sub1]\nParameterName=type\nDataType=7\nAccessType=const\nDefaultValue=0x6\n"
    )
    text = GOOD + VARIABLE + "DataType=0x00A0\nDefaultValue=5\n" + own_type
    tolerant = parse_eds(text.encode(), 3).entry(0x2000)
    assert tolerant is not None
    assert tolerant.data_type == data_type_named("DOMAIN")
    assert (entry_of(text).data_type, entry_of(text).default) == (U16, 5)
    assert any("by canopen" in line for line in read_device_file(text.encode(), 3).defects)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("VendorNumber=0x0000021C", "VendorNumber="),
        ("Lines=1", "Lines=7"),
        ("PDOMapping=1", "PDOMapping="),
        ("[1800]\nParameterName=TPDO1\nObjectType=0x9\nSubNumber=2\n", ""),
        ("AccessType=rw", ""),
        ("[6064]", "[6064]\nParameterName=one\n[6064]"),
    ],
)
def test_what_the_library_refuses_the_tolerant_reader_reads(old: str, new: str) -> None:
    text = GOOD.replace(old, new)
    with pytest.raises((ValueError, KeyError, configparser.Error)):
        import_eds(io.StringIO(text), 3)
    both, ours = read_device_file(text.encode(), 3), parse_eds(text.encode(), 3)
    assert both.entries == ours.entries
    assert both.entry(0x1800, 1)
    assert "canopen refuses the file" in both.defects[-1]


def test_limits_that_contradict_each_other_stay_out() -> None:
    low_above_high = GOOD + VARIABLE + "DataType=0x0007\nLowLimit=9\nHighLimit=3\n"
    assert (entry_of(low_above_high).low, entry_of(low_above_high).high) == (None, None)


def test_a_dcf_carries_what_was_configured(tmp_path: Path) -> None:
    path = tmp_path / "drive.dcf"
    path.write_text(
        GOOD + VARIABLE + "DataType=0x0007\nDefaultValue=$NODEID+0x180\nParameterValue=0x185\n"
        "[DeviceComissioning]\nNodeID=5\nBaudrate=500\n"
    )
    entry = load_device_file(path).entry(0x2000)
    assert entry is not None
    assert (entry.data_type, entry.default, entry.configured) == (U32, 0x185, 0x185)


def test_what_is_no_device_file_is_refused_by_both(tmp_path: Path) -> None:
    with pytest.raises(DecodeError, match="no object"):
        read_device_file(b"[FileInfo]\n")
    with pytest.raises(DriverError, match="cannot be read"):
        load_device_file(tmp_path / "there-is-none.eds")


def test_a_count_without_end_is_kept_from_the_library() -> None:
    text = GOOD + COMPACT + "[2000Name]\nNrOfEntries=999999999999\n1=one\n"
    # It would count for hours.
    assert "too large for it" in read_device_file(text.encode(), 3).defects[-1]


def test_the_librarys_log_stays_off_the_terminal(capfd: pytest.CaptureFixture[str]) -> None:
    read_device_file((GOOD + VARIABLE + "DataType=0x00A0\n").encode(), 3)
    logging.getLogger("canopen.objectdictionary.eds").warning("nobody asked for this")
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("seed", range(40))
def test_any_damaged_sheet_is_a_description_or_a_driver_error(seed: int) -> None:
    rng = random.Random(seed)
    data = bytearray(rng.choice(list(SHEETS.values())).encode())
    for _ in range(rng.randint(1, 30)):
        at = rng.randrange(len(data))
        data[at : at + rng.randint(0, 5)] = rng.randbytes(rng.randint(0, 5))
    try:
        assert read_device_file(bytes(data), 3).entries
    except DriverError:
        return
