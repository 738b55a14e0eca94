"""Text exports of the TwinCAT 3 scope: properties of the channels above the data, a column of time for each
channel or for each run of channels of one rate.

Time columns are milliseconds after the start of the export, which the file gives as 100 ns since
1601. Channels of different rates stand side by side: a row holds samples of different times, and the
channels that are through leave their cells blank. Whether ScaleFactor, Offset and the unit's own
scale have been applied to the numbers, the file does not say.

Between the file's own four lines and the channels there may be blocks of something else
(`TriggerGroup`), which are passed over: the channels are the block that begins with `Name` and has
data behind it.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import islice, zip_longest
from pathlib import Path

from rig.errors import RunFileError
from rig.runfile.importing.adapters.text import TextRows
from rig.runfile.importing.adapters.text_form import MARK_WORDS, encoding_of, open_text
from rig.runfile.importing.clocks import FILETIME_1970, FILETIME_TICKS

_LOOKED_AT = 60
_OWN_LINES = 4
"""Name, file, start and end of the export."""
_HEADER_LINES = 2000
"""Lines within which the data begin; a scope of many triggers says much before them."""
_NO_UNIT = "(None)"
_UNIT = re.compile(r"(\S+)\s+\(.*\)")


@dataclass(frozen=True)
class _Head:
    """Lines of the export's own header: delimiter, properties by name, first line of data, start [ns since 1970]."""

    delimiter: str
    properties: dict[str, list[str]]
    first_row: int
    start_ns: int


def is_scope_export(path: Path) -> bool:
    """Whether a text file begins as these exports do."""
    with open_text(path, encoding_of(path)) as stream:
        first = [line.replace('"', "") for line in islice(stream, 4)]
    return (
        len(first) == 4
        and first[0].startswith("Name")
        and first[1].startswith("File")
        and first[2].startswith("Starttime of export")
    )


class ScopeTable(TextRows):
    """The channels of a scope export; each knows its column of time."""

    is_ragged = True
    last_line = "EOF"

    def __init__(self, path: Path) -> None:
        self.path = path
        self.encoding = encoding_of(path)
        head = _head(path, self.encoding)
        self.delimiter, self.first_row = head.delimiter, head.first_row
        names = head.properties["Name"]
        units = head.properties.get("Unit", [])
        found: list[tuple[str, int | None, str]] = []
        latest: int | None = None
        for index, (name, unit) in enumerate(zip_longest(names, units, fillvalue="")):
            if name == "Name":
                latest = index
                found.append(("time", None, "ms"))
            else:
                found.append((name, latest, _unit(unit)))
        self.headings, self.times, self.units = zip(*found, strict=True)
        self.start_ns = head.start_ns
        comma = self._has_decimal_comma()
        self.decimal_commas = (comma,) * len(found)
        self.notes = (
            f"TwinCAT scope export, {sum(t is not None for t in self.times)} channels, "
            f"decimal {MARK_WORDS[comma]}",
            *self._scaled(head.properties),
        )

    def _has_decimal_comma(self) -> bool:
        if self.delimiter == ",":
            return False
        with open_text(self.path, self.encoding) as stream:
            rows = list(islice(stream, self.first_row - 1, self.first_row + _LOOKED_AT))
        return any("," in row for row in rows) and not any("." in row for row in rows)

    def _scaled(self, properties: dict[str, list[str]]) -> list[str]:
        """A warning for each channel whose scaling the export states without saying whether it is in the numbers."""
        usual = {"ScaleFactor": "1", "Offset": "0", "Unit ScaleFactor": "1", "Unit Offset": "0"}
        said = []
        for index, name in enumerate(self.headings):
            stated = {
                key: properties[key][index]
                for key in usual
                if index < len(properties.get(key, [])) and properties[key][index] != key
            }
            unusual = [f"{k} {v}" for k, v in stated.items() if v and v != usual[k]]
            if unusual and self.times[index] is not None:
                said.append(
                    f"{name}: the export states {', '.join(unusual)}, and not whether the numbers have it"
                )
        return said


def _head(path: Path, encoding: str) -> _Head:
    """The header. Raises `RunFileError` where the properties and the data don't have the same columns."""
    with open_text(path, encoding) as stream:
        lines = [line.rstrip("\r\n") for line in islice(stream, _HEADER_LINES)]
    delimiter = lines[0][len("Name") : len("Name") + 1]
    rows = [[cell.strip() for cell in line.split(delimiter or None)] for line in lines]
    properties, first_row = _channels(rows)
    if not properties or not delimiter:
        raise RunFileError(
            "begins as a TwinCAT scope export and is none",
            where=str(path),
            limit="4 lines, blocks of other things, the channels' properties from `Name` on, a blank line, the data",
            remedy="Export it again, or name its lines with --skip and --header.",
        )
    width = len(properties["Name"])
    for name, cells in properties.items():
        if len(cells) > width:
            raise RunFileError(
                "a line of its header has more cells than there are columns",
                where=f"{path}, {name}",
                value=f"{len(cells)} cells",
                limit=f"{width}",
                remedy="The decimal comma of the header is the delimiter too: export with another "
                "delimiter, or name the lines with --skip and --header and every column's unit by hand.",
            )
    return _Head(delimiter, properties, first_row, _start_ns(rows))


def _channels(rows: list[list[str]]) -> tuple[dict[str, list[str]], int]:
    """The properties of the channels by name, and the line after them: of the last block that begins with `Name` and is
    followed by a row of numbers. Nothing where there is no such block.
    """
    properties: dict[str, list[str]] = {}
    for number, cells in enumerate(rows[_OWN_LINES:], _OWN_LINES + 1):
        if cells and cells[0] == "Name":
            properties = {"Name": cells}
        elif properties and cells and cells[0]:
            properties[cells[0]] = cells
        elif properties:
            following = next((row for row in rows[number:] if any(row)), [""])
            if _is_number(following[0]):
                return properties, number + 1
            properties = {}
    return {}, 0


def _is_number(text: str) -> bool:
    try:
        float(text.replace(",", "."))
    except ValueError:
        return False
    return True


def _start_ns(rows: list[list[str]]) -> int:
    """Start of the export in ns since 1970; 0 where it is no number of ticks."""
    for cells in rows[:_OWN_LINES]:
        if cells[0] == "Starttime of export" and len(cells) > 1 and cells[1].isdigit():
            return (int(cells[1]) - FILETIME_1970) * FILETIME_TICKS
    return 0


def _unit(text: str) -> str:
    """The unit out of `V (Voltage)`; "" for a channel without one."""
    if text in ("", _NO_UNIT):
        return ""
    match = _UNIT.fullmatch(text)
    return match.group(1) if match else text
