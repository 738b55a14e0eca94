"""EDS files with everything wrong with them that a disk or a vendor can do: what is usable is used,
the rest is told.
"""

from __future__ import annotations

import os
import random
import time
from pathlib import Path

import pytest

from drivers.bus.dictionary.eds import parse_eds
from drivers.errors import DriverError
from tests.drivers.eds_files import load_eds

LISTS = "".join(
    f"[{n}Objects]\nSupportedObjects={count}\n{listed}"
    for n, count, listed in (
        ("Mandatory", 1, "1=0x1000\n"),
        ("Optional", 2, "1=0x1800\n2=0x6083\n"),
        ("Manufacturer", 0, ""),
    )
)
FILE = f"""[FileInfo]
FileName=x.eds
[DeviceInfo]
VendorName=Acme 100% %20
VendorNumber=0x2A
{LISTS}[DummyUsage]
Dummy0001=1
[1000]
ParameterName=Device type
ObjectType=0x7
DataType=0x0007
AccessType=ro
DefaultValue=0x00020192
PDOMapping=0
[1800]
ParameterName=TPDO1
ObjectType=0x9
SubNumber=2
[1800sub0]
ParameterName=count
DataType=5
AccessType=ro
DefaultValue=1
[1800sub1]
ParameterName=COB-ID
DataType=7
AccessType=rw
DefaultValue=$NODEID+0x180
[6083]
ParameterName=acceleration
DataType=7
AccessType=rw
LowLimit=1
HighLimit=1000
"""


def test_the_file_itself_is_in_order() -> None:
    described = parse_eds(FILE, 5)
    assert described.defects == ()
    assert described.vendor_name == "Acme 100% %20"
    assert {k: e.default for k, e in described.entries.items()} == {
        (0x1000, 0): 0x20192,
        (0x1800, 0): 1,
        (0x1800, 1): 0x185,
        (0x6083, 0): None,
    }


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        (
            "DefaultValue=$NODEID+0x180",
            "DefaultValue=0xZZ",
            "0x1800:1: defaultvalue is '0xZZ', not a number",
        ),
        ("DefaultValue=$NODEID+0x180", "DefaultValue={NODEID}+384", "0x1800:1: defaultvalue"),
        ("DefaultValue=$NODEID+0x180", "DefaultValue=--1", "0x1800:1: defaultvalue"),
        ("DefaultValue=$NODEID+0x180", "DefaultValue=+", "0x1800:1: defaultvalue"),
        ("DefaultValue=$NODEID+0x180", "DefaultValue=999999999999", "which UNSIGNED32 cannot hold"),
        ("HighLimit=1000", "HighLimit=much", "0x6083:0: highlimit is 'much', not a number"),
        ("HighLimit=1000", "HighLimit=0", "lowest value 1 is above its highest 0"),
        (
            "DataType=7\nAccessType=rw\nLow",
            "DataType=\nAccessType=rw\nLow",
            "data type '' is not known",
        ),
        (
            "AccessType=ro\nDefaultValue=1\n",
            "AccessType=ro\nAccessType=rw\nDefaultValue=1\n",
            "AccessType stands twice",
        ),
        ("[1800sub1]", "[1800subQ]", "section [1800subq] is not an object's"),
        ("[1800sub1]", "[18001]", "section [18001] is not an object's"),
        ("[1800sub1]", "[[1800sub1]]", "section [[1800sub1] is not an object's"),
        ("SupportedObjects=2", "SupportedObjects=7", "counts '7' objects, lists 2"),
        ("ParameterName=acceleration\nDataType=7", "DataType=7\nVendorNumber=", ""),
    ],
)
def test_what_is_wrong_is_told_and_the_rest_is_used(old: str, new: str, told: str) -> None:
    assert old in FILE
    described = parse_eds(FILE.replace(old, new), 5)
    assert not told or any(told in defect for defect in described.defects), described.defects
    for key in ((0x1000, 0), (0x1800, 0), (0x6083, 0)):
        assert described.entry(*key) is not None


def test_a_node_id_that_is_not_known_is_no_defect_of_the_file() -> None:
    described = parse_eds(FILE)
    assert described.defects == ()
    assert described.entries[0x1800, 1].default is None


def test_sections_beside_the_objects_are_no_defects() -> None:
    beside = "[1000Denotation]\nx=y\n[6083ObjectLinks]\nObjectLinks=0\n[M1SubExt6000]\nx=1\n[SupportedModules]\nNrOfEntries=0\n"  # noqa: E501
    assert parse_eds(FILE + beside, 5).defects == ()


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\0" * 1000,
        b"\x1f\x8b\x08" + random.Random(1).randbytes(20_000),
        random.Random(2).randbytes(100_000),
        b"PK\3\4" + random.Random(3).randbytes(5000),
        b"<?xml version='1.0'?><ISO15745ProfileContainer/>",
        FILE.encode("utf-16-le"),
    ],
    ids=["empty", "zeros", "gzip", "noise", "zip", "xml", "utf-16 without mark"],
)
def test_what_is_no_eds_is_one_clear_error(data: bytes) -> None:
    with pytest.raises(DriverError, match="no object is described"):
        parse_eds(data, 5)


@pytest.mark.parametrize(
    ("filler", "most"),
    [
        (b";" + b"x" * 5_000_000, 0),
        (b"nonsense\n" * 200_000, 1000),
        (b"[" * 1_000_000, 0),
        (b"[6083]\n" * 100_000, 1000),
        (b"[1800sub1]\nDefaultValue=" + b"n" * 5_000_000 + b"\n", 3),
        (b"A=" + b"+-" * 2_000_000 + b"\n", 0),
        (
            b"".join(b"[%X]\nCompactSubObj=254\nDataType=7\n" % i for i in range(0x2000, 0x4000)),
            1000,
        ),
    ],
    ids=[
        "one long line",
        "junk",
        "brackets",
        "one section",
        "long value",
        "signs",
        "more objects than any device",
    ],
)
def test_a_large_file_is_read_in_bounded_time_and_memory(filler: bytes, most: int) -> None:
    began = time.process_time()
    described = parse_eds(FILE.encode() + filler, 5)
    assert len(described.entries) <= 101_000
    assert len(described.defects) <= most
    assert time.process_time() - began < 20.0


def test_what_is_no_file_is_not_waited_for(tmp_path: Path) -> None:
    if hasattr(os, "mkfifo"):
        os.mkfifo(tmp_path / "pipe")
    for path in (
        tmp_path,
        tmp_path / "pipe",
        tmp_path / "missing",
        tmp_path / ("x" * 5000),
        "a\0b",
    ):
        with pytest.raises(DriverError):
            load_eds(path)
