"""The electronic data sheet of a simulated device, written from its own object dictionary (CiA 306)."""

from __future__ import annotations

from collections import defaultdict

from sim_backend.wire.dictionary import Entry, ObjectDictionary

_EMCY_COB_ID = 0x1014
_PDO_COMMUNICATION = (*range(0x1400, 0x1600), *range(0x1800, 0x1A00))


def electronic_data_sheet(
    dictionary: ObjectDictionary, *, product: str, vendor: str, vendor_number: int
) -> str:
    """The EDS text of a device: every object that it really has, and none that it has not."""
    objects: dict[int, list[Entry]] = defaultdict(list)
    for entry in dictionary:
        objects[entry.index].append(entry)
    lines = [
        "[FileInfo]", "FileName=simulated.eds", "FileVersion=1", "FileRevision=0", "EDSVersion=4.0",
        f"Description={product}", "CreationTime=12:00AM", "CreationDate=01-01-2026", "CreatedBy=harmonic-rig",
        "ModificationTime=12:00AM", "ModificationDate=01-01-2026", "ModifiedBy=harmonic-rig", "",
        "[DeviceInfo]", f"VendorName={vendor}", f"VendorNumber=0x{vendor_number:08X}", f"ProductName={product}",
        f"ProductNumber=0x{dictionary.number(0x1018, 2):08X}", f"RevisionNumber=0x{dictionary.number(0x1018, 3):08X}",
        "OrderCode=simulated",
        *(f"BaudRate_{rate}={int(rate >= 125)}" for rate in (10, 20, 50, 125, 250, 500, 800, 1000)),
        "SimpleBootUpMaster=0", "SimpleBootUpSlave=1", "Granularity=8", "DynamicChannelsSupported=0",
        "GroupMessaging=0", f"NrOfRXPDO={sum(0x1400 <= i < 0x1600 for i in objects)}",
        f"NrOfTXPDO={sum(0x1800 <= i < 0x1A00 for i in objects)}", "LSS_Supported=0", "",
        "[DummyUsage]", *(f"Dummy{index:04X}={int(index > 0)}" for index in range(8)), "",
    ]  # fmt: skip
    mandatory = [i for i in objects if i in (0x1000, 0x1001, 0x1018)]
    makers = [i for i in objects if 0x2000 <= i < 0x6000]
    optional = [i for i in objects if i not in mandatory and i not in makers]
    for title, listed in (
        ("Mandatory", mandatory),
        ("Optional", optional),
        ("Manufacturer", makers),
    ):
        lines += [f"[{title}Objects]", f"SupportedObjects={len(listed)}"]
        lines += [f"{n}=0x{index:04X}" for n, index in enumerate(listed, 1)] + [""]
    node_id = int(objects[0x1014][0].default) & 0x7F
    for index, entries in objects.items():
        lines += _object(index, entries, node_id)
    return "\r\n".join(lines) + "\r\n"


def _object(index: int, entries: list[Entry], node_id: int) -> list[str]:
    if len(entries) == 1 and entries[0].sub == 0:
        return [f"[{index:04X}]", *_fields(entries[0], entries[0].name, node_id), ""]
    name = entries[0].name.split(":")[0]
    # PDO parameters and the identity are records by the standard, even where all fields are of one type.
    is_record = (
        0x1400 <= index < 0x1C00 or index == 0x1018 or len({e.type for e in entries if e.sub}) > 1
    )
    kind = "0x9" if is_record else "0x8"
    lines = [
        f"[{index:04X}]",
        f"ParameterName={name}",
        f"ObjectType={kind}",
        f"SubNumber={len(entries)}",
        "",
    ]
    for entry in entries:
        lines += [
            f"[{index:04X}sub{entry.sub:X}]",
            *_fields(entry, entry.name.split(": ")[-1], node_id),
            "",
        ]
    return lines


def _fields(entry: Entry, name: str, node_id: int) -> list[str]:
    access: str = entry.access
    if access == "rw":
        access = {"t": "rwr", "r": "rww", "tr": "rw"}.get(entry.mappable, "rw")
    default = str(int(entry.default)) if isinstance(entry.default, bool) else str(entry.default)
    if entry.index == _EMCY_COB_ID or (entry.index in _PDO_COMMUNICATION and entry.sub == 1):
        # The same file for every node-ID.
        default = f"$NODEID+0x{int(entry.default) - node_id:X}"
    lines = [
        f"ParameterName={name}",
        "ObjectType=0x7",
        f"DataType=0x{entry.type.code:04X}",
        f"AccessType={access}",
        f"DefaultValue={default}",
        f"PDOMapping={int(bool(entry.mappable))}",
    ]
    if entry.low is not None:
        lines.append(f"LowLimit={int(entry.low)}")
    if entry.high is not None:
        lines.append(f"HighLimit={int(entry.high)}")
    return lines
