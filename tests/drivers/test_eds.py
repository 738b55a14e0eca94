"""Vendors' EDS files: their known defects, and any file at all."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.bus.cia301 import I8, I32, U16, U32
from drivers.bus.dictionary.eds import parse_eds
from drivers.errors import DecodeError, DriverError
from tests.drivers.canopen_peer import counter_eds, drive_eds
from tests.drivers.eds_files import load_eds

GOOD = """[FileInfo]
FileName=drive.eds
[DeviceInfo]
VendorName=Maker
VendorNumber=0x0000021C
ProductName=Amplifier
BaudRate_500=1
BaudRate_1000=1
[Comments]
Lines=1
Line1=hello
[MandatoryObjects]
SupportedObjects=1
1=0x1000
[OptionalObjects]
SupportedObjects=2
1=0x1800
2=0x6064
[ManufacturerObjects]
SupportedObjects=0
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
ParameterName=Number
DataType=0x0005
AccessType=ro
DefaultValue=2
[1800sub1]
ParameterName=COB-ID
DataType=0x0007
AccessType=rw
DefaultValue=$NODEID+0x40000180
[6064]
ParameterName=Position actual value
ObjectType=0x7
DataType=0x0004
AccessType=ro
PDOMapping=1
LowLimit=0x80000000
HighLimit=0x7FFFFFFF
"""


def test_a_good_file_has_no_defects() -> None:
    description = parse_eds(GOOD.encode(), 3)
    assert description.defects == ()
    assert (description.vendor_name, description.vendor_number) == ("Maker", 0x21C)
    assert description.bit_rates == (500_000, 1_000_000)
    position = description.entry(0x6064)
    assert position is not None
    assert (position.data_type, position.is_pdo_mappable, position.low, position.high) == (
        I32,
        True,
        -(2**31),
        2**31 - 1,
    )
    cob_id = description.entry(0x1800, 1)
    assert cob_id is not None
    assert cob_id.default == 0x40000183


@pytest.mark.parametrize("name", ["plain", "crlf", "bom", "utf16", "cr"])
def test_line_ends_and_byte_order_marks(name: str) -> None:
    data = {
        "plain": GOOD.encode(),
        "crlf": GOOD.replace("\n", "\r\n").encode(),
        "bom": b"\xef\xbb\xbf" + GOOD.encode(),
        "utf16": b"\xff\xfe" + GOOD.encode("utf-16-le"),
        "cr": GOOD.replace("\n", "\r").encode(),
    }[name]
    assert parse_eds(data, 3).entries == parse_eds(GOOD.encode(), 3).entries


@pytest.mark.parametrize(
    ("old", "new", "defect"),
    [
        ("VendorNumber=0x0000021C", "VendorNumber=", "vendornumber"),
        ("Lines=1", "Lines=7", "comments"),
        ("PDOMapping=1", "PDOMapping=", "pdomapping"),
        ("SupportedObjects=2", "SupportedObjects=9", "optionalobjects"),
        ("2=0x6064", "2=0x6065", "0x6065"),
        ("[ManufacturerObjects]\nSupportedObjects=0\n", "", "manufacturerobjects"),
        ("[1800]\nParameterName=TPDO1\nObjectType=0x9\nSubNumber=2\n", "", "without its object"),
        ("DataType=0x0004", "DataType=0x00A0", "data type"),
        ("AccessType=rw", "AccessType=", "access type"),
        ("Line1=hello", "Line1=hello\nthis is not a value", "neither a section"),
        ("[6064]", "[6064]\nParameterName=one\n[6064]", "twice"),
    ],
)
def test_known_defects_are_survived_and_listed(old: str, new: str, defect: str) -> None:
    assert old in GOOD
    description = parse_eds(GOOD.replace(old, new).encode(), 3)
    assert description.entry(0x6064) is not None
    assert description.entry(0x1800, 1) is not None
    assert any(defect in line.lower() for line in description.defects), description.defects


def test_a_missing_device_info_and_a_foreign_encoding() -> None:
    without = GOOD[: GOOD.index("[DeviceInfo]")] + GOOD[GOOD.index("[Comments]") :]
    assert "[DeviceInfo] is missing" in parse_eds(without.encode()).defects
    umlaut = parse_eds(GOOD.replace("Maker", "Gerätebau").encode("cp1252"))
    assert umlaut.vendor_name == "Gerätebau"


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("0x1F", 31),
        ("0X1f", 31),
        ("1Fh", 31),
        ("31", 31),
        ("037", 31),
        ("08", 8),
        (" 31 ; comment", 31),
        ("0x", None),
        ("", None),
        ("abc", None),
    ],
)
def test_numbers_as_vendors_write_them(text: str, value: int | None) -> None:
    entry = parse_eds(
        GOOD.replace("DefaultValue=0x00020192", f"DefaultValue={text}").encode()
    ).entry(0x1000)
    assert entry is not None
    assert entry.default == value


def test_compact_arrays_names_and_values() -> None:
    text = GOOD + (
        "[2000]\nParameterName=Gains\nObjectType=0x8\nDataType=0x0006\nAccessType=rw\nCompactSubObj=3\nDefaultValue=5\n"
        "[2000Name]\nNrOfEntries=1\n2=Speed gain\n[2000Value]\nNrOfEntries=1\n2=17\n"
    )
    description = parse_eds(text.encode())
    gain = description.entry(0x2000, 2)
    assert gain is not None
    assert (gain.name, gain.data_type, gain.default, gain.configured) == ("Speed gain", U16, 5, 17)
    count, other = description.entry(0x2000, 0), description.entry(0x2000, 3)
    assert count is not None
    assert count.default == 3
    assert other is not None
    assert (other.name, other.default) == ("Gains", 5)


def test_negative_defaults_in_twos_complement_and_floats() -> None:
    text = GOOD + (
        "[2001]\nParameterName=a\nDataType=2\nAccessType=rw\nDefaultValue=0xFE\n"
        "[2002]\nParameterName=b\nDataType=8\nAccessType=rw\nDefaultValue=0x3F800000\n"
        "[2003]\nParameterName=c\nDataType=8\nAccessType=rw\nDefaultValue=2.5\n"
    )
    entries = parse_eds(text.encode()).entries
    assert entries[0x2001, 0].data_type is I8
    assert [entries[i, 0].default for i in (0x2001, 0x2002, 0x2003)] == [-2, 1.0, 2.5]


# What stands in files of real devices; each text here is our own and shows one of their ways.


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("$NODEID + 0x180", 0x183),
        ("$NodeID +0x180", 0x183),
        ("0x180+$NODEID", 0x183),
        ("0x180 + $NODEID", 0x183),
        ("$NODEID+384", 0x183),
        ("$NODEID+0x80000180", 0x80000183),
        ("$NODEID+0x180+0x40000000", 0x40000183),
        ("NODEID+0x180", 0x183),
        ("($NODEID+0x180)", 0x183),
        ("$NODEID", 3),
        ("$NODEID+", 3),
        ("$NODEID+x", None),
        ("0x183 ; first TPDO", 0x183),
        ("0x183 // first TPDO", 0x183),
        ("0x183 # first TPDO", 0x183),
        ('"0x183"', 0x183),
        ("387UL", 387),
        ("0x183L", 387),
        ("387.0", 387),
        ("387.5", None),
        ("0x0000018", 0x18),
    ],
)
def test_cob_ids_as_vendors_write_them(text: str, value: int | None) -> None:
    entry = parse_eds(GOOD.replace("$NODEID+0x40000180", text).encode(), 3).entry(0x1800, 1)
    assert entry is not None
    assert entry.default == value


def test_a_cob_id_without_a_node_id_is_not_guessed() -> None:
    for text in ("$NODEID+0x180", "0x180+$NODEID"):
        entry = parse_eds(GOOD.replace("$NODEID+0x40000180", text).encode()).entry(0x1800, 1)
        assert entry is not None
        assert entry.default is None


@pytest.mark.parametrize(
    "name", ["DeviceComissioning", "DeviceCommissioning", "DEVICECOMISSIONING"]
)
def test_the_node_id_of_a_dcf_in_either_spelling(name: str) -> None:
    entry = parse_eds(f"{GOOD}[{name}]\nNodeId=0x11\nNodeName=x\n".encode()).entry(0x1800, 1)
    assert entry is not None
    assert entry.default == 0x40000191


@pytest.mark.parametrize(
    ("section", "sub"),
    [
        ("[1800Sub1]", 1),
        ("[1800SUB01]", 1),
        ("[0x1800sub0x1]", 1),
        ("[1800 sub 1]", 1),
        ("[1800sub0A]", 10),
    ],
)
def test_sections_as_vendors_head_them(section: str, sub: int) -> None:
    entry = parse_eds(GOOD.replace("[1800sub1]", section).encode(), 3).entry(0x1800, sub)
    assert entry is not None
    assert entry.name == "COB-ID"


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("DataType=0x0004", "DataType=4"),
        ("DataType=0x0004", "DataType=INTEGER32"),
        ("DataType=0x0004", "DataType=0x0004 ; INTEGER32"),
        ("ObjectType=0x7\nDataType=0x0004", "ObjectType=VAR\nDataType=0x0004"),
        ("ObjectType=0x7\nDataType=0x0004", "DataType=0x0004"),
        ("AccessType=ro\nPDOMapping=1", "AccessType=RO\nPDOMapping=yes"),
        ("AccessType=ro\nPDOMapping=1", 'AccessType="ro"\nPDOMapping=0x1'),
        ("ParameterName=Position actual value", 'ParameterName="Position actual value"'),
        ("LowLimit=0x80000000", "LowLimit=-2147483648"),
        ("[6064]", "[6064]\n;StorageLocation=RAM\n;;ReadLevel=0\n// a remark\nUnit=counts"),
    ],
)
def test_the_same_entry_in_other_words_is_the_same_and_no_defect(old: str, new: str) -> None:
    assert old in GOOD
    plain, other = parse_eds(GOOD.encode(), 3), parse_eds(GOOD.replace(old, new).encode(), 3)
    assert other.entry(0x6064) == plain.entry(0x6064)
    assert other.defects == ()


@pytest.mark.parametrize(
    ("old", "new", "defect"),
    [
        ("VendorNumber=0x0000021C", "VendorNumber=Maker", "vendornumber"),
        ("SubNumber=2", "SubNumber=5", "0x1800: counts 5 sub-objects, describes 2"),
        (
            "[1800sub0]\nParameterName=Number\nDataType=0x0005\nAccessType=ro\nDefaultValue=2\n",
            "",
            "its sub-index 0",
        ),
        ("AccessType=rw", "AccessType=read/write", "taken as rw"),
        ("AccessType=ro\nPDOMapping=1", "AccessType=readonly\nPDOMapping=1", "taken as ro"),
        ("HighLimit=0x7FFFFFFF", "HighLimit=0xFFFFFFF0\nLowLimit=5", "above its highest"),
        ("ObjectType=0x7\nDataType=0x0004", "ObjectType=thing\nDataType=0x0004", "objecttype"),
        ("[1800sub1]", "[1801sub1]", "0x1801:1: a sub-object without its object"),
    ],
)
def test_more_defects_are_survived_and_listed(old: str, new: str, defect: str) -> None:
    assert old in GOOD
    description = parse_eds(GOOD.replace(old, new).encode(), 3)
    position = description.entry(0x6064)
    assert position is not None
    assert position.data_type is I32
    assert any(defect in line.lower() for line in description.defects), description.defects


def test_quotes_around_texts() -> None:
    text = GOOD.replace("VendorName=Maker", 'VendorName="Maker"') + (
        '[1008]\nParameterName="Device name"\nObjectType=7\nDataType=9\nAccessType=const\nDefaultValue="Drive 1; large"\n'  # noqa: E501
    )
    description = parse_eds(text.encode())
    name = description.entry(0x1008)
    assert name is not None
    assert (description.vendor_name, name.name, name.default) == (
        "Maker",
        "Device name",
        "Drive 1; large",
    )


def test_a_compact_array_and_sub_objects_that_say_more() -> None:
    sub = "[1003sub0]\nParameterName=Number of errors\nDataType=5\nAccessType=rw\n"
    compact = "[1003]\nParameterName=Error field\nObjectType=8\nDataType=7\nAccessType=ro\nCompactSubObj=254\n"
    for text in (GOOD + sub + compact, GOOD + compact + sub):
        description = parse_eds(text.encode())
        count, last = description.entry(0x1003, 0), description.entry(0x1003, 254)
        assert count is not None
        assert last is not None
        assert (count.access, count.name) == ("rw", "Number of errors")
        assert (last.access, last.data_type) == ("ro", U32)


def test_compact_values_of_a_short_index() -> None:
    text = (
        GOOD
        + "[0040]\nParameterName=a\nObjectType=8\nDataType=6\nAccessType=rw\nCompactSubObj=2\n[0040Value]\n1=17\n"
    )
    entry = parse_eds(text.encode()).entry(0x40, 1)
    assert entry is not None
    assert entry.configured == 17


def test_sections_of_module_devices_are_left_alone() -> None:
    text = (
        GOOD
        + "[SupportedModules]\nNrOfEntries=1\n[M1FixedObjects]\nNrOfEntries=0\n[M1SubExt1027]\nDataType=6\n[M1Comments]\n"  # noqa: E501
    )
    assert parse_eds(text.encode(), 3) == parse_eds(GOOD.encode(), 3)


def test_xml_is_said_to_be_xml() -> None:
    with pytest.raises(DecodeError, match="XDD"):
        parse_eds(b'\xef\xbb\xbf<?xml version="1.0"?>\n<ISO15745ProfileContainer/>')


def test_what_is_no_eds_is_an_error_that_says_so(tmp_path: Path) -> None:
    for data in (b"", b"\x00" * 100, b"hello", b"[DeviceInfo]\nVendorName=x\n"):
        with pytest.raises(DecodeError, match="no object is described"):
            parse_eds(data)
    with pytest.raises(DriverError, match="cannot be read"):
        load_eds(tmp_path / "none.eds")
    with pytest.raises(DriverError, match="cannot be read"):
        load_eds(tmp_path)


def test_files_of_another_stack(tmp_path: Path) -> None:
    for text, index in ((drive_eds(), 0x6041), (counter_eds(), 0x6004)):
        path = tmp_path / "peer.eds"
        path.write_text(text)
        description = load_eds(path, 1)
        assert description.entry(index) is not None
        cob_id = description.entry(0x1A00, 0)
        assert cob_id is not None
    assert description.entries[0x6004, 0].data_type is U32


PIECES = st.sampled_from(
    [
        *GOOD.splitlines(),
        "[2000]",
        "CompactSubObj=9999999999",
        "ObjectType=8",
        "[6064sub",
        "[ffffsubff]",
        "[x]",
        "=",
        "DataType=-1",
    ]
)
LINES = st.lists(st.one_of(PIECES, st.text(max_size=30), PIECES.map(lambda s: s[:5])), max_size=60)


@given(
    st.one_of(
        st.binary(max_size=300),
        LINES.map(lambda ls: "\n".join(ls).encode("utf-8", "surrogatepass")),
    )
)
@settings(max_examples=300)
def test_any_file_is_a_description_or_a_decode_error(data: bytes) -> None:
    try:
        description = parse_eds(data, 1)
    except DecodeError:
        return
    assert description.entries
    assert all(0 <= i <= 0xFFFF and 0 <= s <= 0xFF for i, s in description.entries)


@given(st.integers(0, len(GOOD) - 1), st.integers(0, 255), st.integers(0, 40))
@settings(max_examples=200)
def test_a_damaged_file_is_survived(at: int, byte: int, cut: int) -> None:
    data = bytearray(GOOD.encode())
    data[at] = byte
    del data[at + 1 : at + 1 + cut]
    assert parse_eds(bytes(data), 1).entries
