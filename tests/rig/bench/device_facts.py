"""What the documents of some devices say of their objects: type, access, whether a PDO takes them, value as it comes.

Every row is from the source that its device names. "K" marks engineering knowledge that no document at hand
shows: check it against the device's own manual.
"""

from __future__ import annotations

from dataclasses import dataclass

Key = tuple[int, int]


@dataclass(frozen=True)
class Fact:
    """One object: its type as it is written in rig.toml, its access, whether it can be mapped, its default."""

    kind: str
    access: str
    is_mappable: bool
    default: int = 0


@dataclass(frozen=True)
class Device:
    """A device's objects, and where they are from."""

    source: str
    objects: dict[Key, Fact]


def _rows(text: str) -> dict[Key, Fact]:
    """Rows as "index:sub type access p|n default", one a line."""
    found: dict[Key, Fact] = {}
    for line in text.strip().splitlines():
        place, kind, access, mappable, default = line.split("#")[0].split()
        index, sub = place.split(":")
        found[int(index, 16), int(sub)] = Fact(kind, access, mappable == "p", int(default, 0))
    return found


EPOS4 = Device(
    "EDS of the EPOS4 Module 50/5, revision 0x0170",
    _rows("""
        0x1000:0 U32 ro n 0x00020192  # K
        0x1016:0 U8  ro n 2
        0x1016:1 U32 rw n 0
        0x1016:2 U32 rw n 0
        0x1017:0 U16 rw n 0
        0x1018:1 U32 ro n 0xFB
        0x1018:2 U32 ro n 0x61500000
        0x3001:2 U32 rw n 5000        # K: output current limit, mA
        0x30D2:1 I16 ro p 0
        0x6007:0 I16 rw n 3
        0x603F:0 U16 ro p 0           # K
        0x6040:0 U16 rw p 0
        0x6041:0 U16 ro p 0
        0x605A:0 I16 rw n 6
        0x605E:0 I16 rw n 2
        0x6060:0 I8  rw p 1
        0x6061:0 I8  ro p 0
        0x6064:0 I32 ro p 0
        0x606C:0 I32 ro p 0
        0x6071:0 I16 rw p 0
        0x6076:0 U32 rw n 228231      # uN m: 3.21 A x 71.1 mN m/A
        0x6077:0 I16 ro p 0
        0x607A:0 I32 rw p 0
        0x607F:0 U32 rw p 50000
        0x6080:0 U32 rw p 50000
        0x6083:0 U32 rw p 10000
        0x6084:0 U32 rw p 10000
        0x6085:0 U32 rw p 10000
        0x60A8:0 U32 ro n 0x00B50000
        0x60A9:0 U32 rw n 0xFDB44700  # 0x00B44700 as it comes
        0x60AA:0 U32 ro n 0x00C00300
        0x60B0:0 I32 rw p 0
        0x60B1:0 I32 rw p 0
        0x60B2:0 I16 rw p 0
        0x60C2:1 U8  rw p 0
        0x60C2:2 I8  rw p 0xFD
        0x60FD:0 U32 ro p 0x00010000
        0x60FE:1 U32 rw p 0
        0x60FF:0 I32 rw p 0
        0x6502:0 U32 ro p 0x3A5       # K
    """),
)

ELMO_GOLD = Device(
    "Whistle Gold V002.dcf, product 0x00030923 revision 0x000103F6",
    _rows("""
        0x1000:0 U32 ro n 0x192
        0x1006:0 U32 rw n 0
        0x1016:0 U8  ro n 2
        0x1016:1 U32 rw n 0
        0x1016:2 U32 rw n 0
        0x1017:0 U16 rw n 0
        0x1018:1 U32 ro n 0x9A
        0x1018:2 U32 ro n 0x30923
        0x2041:0 U32 ro p 0
        0x6007:0 I16 rw n 1
        0x603F:0 U16 ro p 0           # K
        0x6040:0 U16 rw p 0
        0x6041:0 U16 ro p 0
        0x605A:0 I16 rw n 2
        0x605E:0 I16 rw n 2
        0x6060:0 I8  rw p 0
        0x6061:0 I8  ro p 0
        0x6063:0 I32 ro p 0
        0x6064:0 I32 ro p 0
        0x606C:0 I32 ro p 0
        0x6071:0 I16 rw p 0
        0x6072:0 U16 rw n 50000
        0x6075:0 U32 rw n 0
        0x6076:0 U32 rw n 0
        0x6077:0 I16 ro p 0
        0x6078:0 I16 ro p 0
        0x607A:0 I32 rw p 0
        0x607F:0 U32 rw n 2000000000
        0x6080:0 U32 rw n 0xFFFFFFFF
        0x6083:0 U32 rw p 2000000000
        0x6084:0 U32 rw p 2000000000
        0x6085:0 U32 rw p 2000000000
        0x608F:1 U32 rw n 1
        0x608F:2 U32 rw n 1
        0x6091:1 U32 rw n 1
        0x6091:2 U32 rw n 1
        0x6092:1 U32 rw n 1
        0x6092:2 U32 rw n 1
        0x6096:1 U32 ro n 1
        0x6096:2 U32 ro n 1
        0x6097:1 U32 ro n 1
        0x6097:2 U32 ro n 1
        0x60C2:1 U8  rw n 1
        0x60C2:2 I8  rw n 0xFD
        0x60FD:0 U32 ro p 0x00010000
        0x60FE:1 U32 rw p 0
        0x60FF:0 I32 rw p 0
        0x6502:0 U32 ro p 0x3ED       # of a user's device file
    """),
)

AHM36 = Device(
    "SICK 8016869 (2021), pages 21 to 66",
    _rows("""
        0x1000:0 U32 ro n 0x00020196
        0x1017:0 U16 rw n 0           # K
        0x1018:1 U32 ro n 0x01000056
        0x1018:2 U32 ro n 0x7724
        0x6000:0 U16 rw n 4
        0x6001:0 U32 rw n 16384       # K: 14 bits
        0x6002:0 U32 rw n 67108864    # K: 12 bits of turns
        0x6003:0 U32 rw n 0
        0x6004:0 U32 ro p 0
        0x6030:1 U16 ro p 0
        0x6200:0 U16 rw n 0
        0x6500:0 U16 ro n 0           # K
        0x6501:0 U32 ro n 16384       # K
        0x6502:0 U16 ro n 4096        # K
        0x6503:0 U16 ro p 0
        0x6505:0 U16 ro p 0
    """),
)

KL5111 = Device(
    "Beckhoff BK51x0 pages, KL5111 page 13",
    _rows("""
        0x1000:0 U32 ro n 0x00010191
        0x2C00:1 U48 ro p 0
        0x2D00:1 U48 rw p 0
    """),
)

WAGO_750 = Device(
    "WAGO 750-337/338 V3.0.2, pages 57 and 107 to 134; 753-456, page 26",
    _rows("""
        0x1000:0 U32 ro n 0x00040191
        0x6401:1 I16 ro p 0           # U16 in the manual, values in two's complement
        0x6401:2 I16 ro p 0
        0x6423:0 U8  rw n 0
    """),
)
