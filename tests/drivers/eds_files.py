"""EDS files by the reader of the program alone, without the one of the canopen library."""

from __future__ import annotations

from pathlib import Path

from drivers.bus.dictionary.eds import DeviceDescription, file_bytes, parse_eds


def load_eds(path: str | Path, node_id: int | None = None) -> DeviceDescription:
    """The description in a file by this reader alone; `dictionary.device_file` asks the canopen library as well."""
    return parse_eds(file_bytes(path), node_id, where=str(path))
