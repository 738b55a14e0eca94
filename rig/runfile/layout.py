"""The layout of a run file: the names, types and version of everything in it, in one place.

NeXus-like groups with HDF5 dimension scales and CF attributes, so that general viewers open a run without this program:

    /            NX_class=NXroot  default=entry  file_format, file_format_version
    /entry       NXentry   run_id, title, start_time, end_time, status, outcome
      sample       NXsample      gear, its parameter set (JSON and TOML), ratio, mounting, conditions
      user         NXuser        operator
      instrument   NXinstrument  one group per channel: device, lines, calibration
      process      NXprocess     experiment, parameters, limits, backend, seed, truth; rows written and dropped; figures of the
                                 acquisition; CRC of the end
      data         NXdata        time, cycle, flags and one column of raw counts per channel
      segments     table         labelled intervals of rows
      events       table         what happened, in fixed-length bytes

What never changes lies in object headers, which HDF5 checksums; what grows carries a checksum of
its own (Fletcher-32 or that of gzip), so that a damaged file is refused instead of read. Texts have
a fixed length: variable-length strings cannot be read after a writer was killed.
"""  # noqa: E501

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

import h5py
import numpy as np

# The library's own calls are compiled and have no types.
from h5py import h5d, h5o, h5s, h5t  # pyright: ignore[reportAttributeAccessIssue]

from drivers.channel import Channel
from drivers.samples import CycleFlag
from rig.errors import RunFileError

FILE_FORMAT: Final = "harmonic-rig-run"
FILE_FORMAT_VERSION: Final = "1.2"
"""Major.minor: a reader refuses another major version and reads every minor one.

1.1: figures of the acquisition; flags that tell whose values of an incomplete cycle are old.
1.2: an uncertainty of a calibration that nobody stated is left away; 0 is one that was stated.
"""

PART_SUFFIX: Final = ".part"
HASH_SUFFIX: Final = ".sha256"
LIBRARY_VERSION: Final = ("v110", "v110")
"""Bounds of the HDF5 file format: the oldest with SWMR, readable by every library since 2016."""

ENTRY, DATA, SAMPLE, USER = "entry", "entry/data", "entry/sample", "entry/user"
INSTRUMENT, PROCESS, SEGMENTS, EVENTS = (
    "entry/instrument",
    "entry/process",
    "entry/segments",
    "entry/events",
)
TIME, CYCLE, FLAGS = "time", "cycle", "flags"
BOOKKEEPING: Final = (TIME, CYCLE, FLAGS)
"""Columns of the data group that are no channels."""

_TIME_UNITS: Final = "nanoseconds since 1970-01-01 00:00:00"
OPEN_STOP: Final = -1
"""`stop` of a segment that has begun and not yet ended."""
RUNNING, COMPLETE, RECOVERED = "running", "complete", "recovered"

SEGMENT_TYPE: Final = np.dtype(
    [
        ("index", "<i4"),
        ("label", "S64"),
        ("start", "<i8"),
        ("stop", "<i8"),
        ("setpoint", "<f8"),
        ("direction", "<i4"),
        ("repeat", "<i4"),
    ]
)
EVENT_TYPE: Final = np.dtype(
    [
        ("time", "<i8"),
        ("level", "S16"),
        ("code", "S48"),
        ("source", "S48"),
        ("text", "S480"),
        ("truncated", "u1"),
    ]
)

MAXIMUM_TEXT: Final = 16_000_000
"""Bytes; a text field beyond this is damage, not a parameter set."""

_LARGEST_COMPACT: Final = 60_000
"""Bytes that fit into an object header (HDF5 allows 64 KiB)."""

_FILTERS: Final[dict[str, Any]] = {
    "compression": "gzip",
    "compression_opts": 1,
    "shuffle": True,
    "fletcher32": True,
}
_LONG_NAMES: Final = {
    "input_angle": "input angle (wave generator)",
    "output_angle": "output angle",
    "torque": "motor torque, monitor port",
    "drive_torque": "motor torque, reported by the drive",
    "target_speed": "input speed set-point",
    "target_torque": "motor torque set-point",
    "input_index": "input angle at the latest index mark",
    "output_index": "output angle at the latest index mark",
    "index_seen": "index marks seen (bit 0 input, bit 1 output)",
    "statusword": "statusword of the drive",
    "housing_temperature": "gear housing temperature",
    "ambient_temperature": "ambient temperature",
}
_ANGLE_UNITS = ("rad", "m")
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,62}")


@dataclass(frozen=True)
class Column:
    """How a channel lies in the file: counts in int64 or int32, and in float64 a recording that was not in counts."""

    channel: Channel
    dtype: Literal["int64", "int32", "float64"] = "int64"

    def __post_init__(self) -> None:
        name = self.channel.name
        if not _NAME.fullmatch(name) or name in BOOKKEEPING:
            raise RunFileError(
                "is not a name for a channel",
                where="channel",
                value=repr(name),
                limit=f"letters, digits and underscores, none of {', '.join(BOOKKEEPING)}",
            )

    @classmethod
    def of(cls, channel: Channel) -> Column:
        """The column of a rig's channel: counters of angles and times in int64, everything else in int32."""
        return cls(channel, "int64" if channel.unit in (*_ANGLE_UNITS, "s") else "int32")

    @property
    def name(self) -> str:
        """The name of the channel and of its dataset."""
        return self.channel.name

    @property
    def described(self) -> str:
        """The channel's name for axes and tables."""
        return self.channel.long_name or _LONG_NAMES.get(self.name, self.name.replace("_", " "))


def create_field(group: h5py.Group, name: str, value: str | float | bool, unit: str = "") -> None:
    """One scalar or text that never changes, in the checksummed header of the object; a long text compressed."""
    dtype, raw = _field_data(value)
    if raw.nbytes > _LARGEST_COMPACT:
        filters: dict[str, Any] = {"compression": "gzip", "compression_opts": 4, "fletcher32": True}
        group.create_dataset(name, data=raw.reshape(1), dtype=dtype, chunks=(1,), **filters)
        return
    compact = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    compact.set_layout(h5d.COMPACT)
    # The low-level calls: the high-level one makes every dataset contiguous, which has no checksum.
    kind = h5t.py_create(raw.dtype, logical=True)
    created = h5d.create(group.id, name.encode(), kind, h5s.create(h5s.SCALAR), compact)
    created.write(h5s.ALL, h5s.ALL, raw, kind)
    if unit:
        h5py.Dataset(created).attrs["units"] = text_attribute(unit)


def create_changing_field(group: h5py.Group, name: str, value: str | int, length: int = 0) -> None:
    """One scalar or text (of at most `length` bytes) that is rewritten while the file is in SWMR mode."""
    dtype, raw = _field_data(value, length)
    group.create_dataset(name, data=raw, dtype=dtype)


def rewrite_field(group: h5py.Group, name: str, value: str | int) -> None:
    """Give a changing field another value."""
    dataset = group[name]
    assert isinstance(dataset, h5py.Dataset)
    dataset[()] = value.encode() if isinstance(value, str) else value
    dataset.flush()


def _field_data(value: str | float | bool, length: int = 0) -> tuple[Any, Any]:
    if isinstance(value, str):
        raw = value.encode()
        dtype: Any = h5py.string_dtype("utf-8", max(len(raw), length, 1))
        return dtype, np.array(raw, dtype=dtype)
    # A truth value is a whole number too.
    kind = "<i8" if isinstance(value, int) else "<f8"
    dtype = np.dtype("u1" if isinstance(value, bool) else kind)
    return dtype, np.array(value, dtype=dtype)


def read_text(group: h5py.Group, name: str) -> str:
    """A text field; "" where there is none."""
    field = _open_field(group, name)
    if field is None:
        return ""
    kind = _type_of(field)
    is_text = kind is not None and kind.get_class() == h5t.STRING and not kind.is_variable_str()
    if kind is None or not is_text or field.shape not in ((), (1,)):
        raise RunFileError("is not a text", where=f"{group.name}/{name}")
    size = kind.get_size()
    if size > MAXIMUM_TEXT:
        raise RunFileError("is too long", where=f"{group.name}/{name}", value=f"{size} bytes")
    value = np.empty(1, f"S{size}")
    field.read(h5s.ALL, h5s.ALL, value.reshape(field.shape), kind)
    return bytes(value[0]).decode()


def read_number(group: h5py.Group, name: str, default: float) -> float:
    """A numeric field, or `default` where there is none."""
    field = _open_field(group, name)
    if field is None:
        return default
    kind = _type_of(field)
    if kind is None or kind.get_class() not in (h5t.INTEGER, h5t.FLOAT) or field.shape != ():
        raise RunFileError("is not a number", where=f"{group.name}/{name}")
    value = np.empty((), kind.dtype)
    field.read(h5s.ALL, h5s.ALL, value, kind)
    return type(default)(value)


def _open_field(group: h5py.Group, name: str) -> Any:
    """What a name in a group stands for, or None. By the low-level calls: a run has two hundred fields, and is opened
    in half the time."""
    raw = name.encode()
    return h5o.open(group.id, raw) if raw in group.id else None


def _type_of(field: Any) -> Any:
    """The type in which a field is stored; None for what is no dataset."""
    return field.get_type() if isinstance(field, h5d.DatasetID) else None


def number_attribute(item: h5py.Group | h5py.Dataset, name: str) -> float:
    """A numeric attribute."""
    value: Any = item.attrs[name]
    return float(value)


def text_attribute(value: str) -> Any:
    """A text for an attribute in fixed-length bytes."""
    raw = value.encode()
    return np.array(raw, dtype=h5py.string_dtype("utf-8", max(len(raw), 1)))


def create_group(file: h5py.File, path: str, nexus_class: str) -> h5py.Group:
    """A group with its NeXus class."""
    group = file.create_group(path)
    group.attrs["NX_class"] = text_attribute(nexus_class)
    return group


def create_root(file: h5py.File) -> None:
    """Mark the file as a run and its entry as the thing to show."""
    file.attrs["NX_class"] = text_attribute("NXroot")
    file.attrs["default"] = text_attribute("entry")
    file.attrs["file_format"] = text_attribute(FILE_FORMAT)
    file.attrs["file_format_version"] = text_attribute(FILE_FORMAT_VERSION)


def create_data(
    file: h5py.File, columns: Sequence[Column], chunk_rows: int, *, compress: bool
) -> dict[str, h5py.Dataset]:
    """The data group with its empty, growing columns; returns the datasets by name."""
    group = create_group(file, DATA, "NXdata")
    group.attrs["axes"] = np.array([b"time"], dtype=h5py.string_dtype("utf-8", 4))
    group.attrs["time_indices"] = np.int64(0)
    names = [column.name.encode() for column in columns]
    group.attrs["signal"] = text_attribute(columns[0].name)
    if len(names) > 1:
        longest = max(map(len, names))
        group.attrs["auxiliary_signals"] = np.array(
            names[1:], dtype=h5py.string_dtype("utf-8", longest)
        )
    filters = _FILTERS if compress else {"fletcher32": False}
    datasets: dict[str, h5py.Dataset] = {}
    for name, dtype, attributes in _dataset_forms(columns):
        dataset = group.create_dataset(
            name, (0,), dtype, maxshape=(None,), chunks=(chunk_rows,), **filters
        )
        for key, value in attributes.items():
            dataset.attrs[key] = text_attribute(value) if isinstance(value, str) else value
        datasets[name] = dataset
    datasets[TIME].make_scale(TIME)
    for name, dataset in datasets.items():
        dataset.dims[0].label = TIME
        if name != TIME:
            dataset.dims[0].attach_scale(datasets[TIME])
    return datasets


def _dataset_forms(columns: Sequence[Column]) -> Iterator[tuple[str, str, Mapping[str, Any]]]:
    """Name, type and attributes of every dataset: those of the cycles, then those of the channels."""
    time = {"units": _TIME_UNITS, "calendar": "proleptic_gregorian", "long_name": "time (UTC)"}
    yield TIME, "<i8", time
    yield CYCLE, "<i8", {"units": "1", "long_name": "index of the SYNC cycle"}
    flags = [flag for flag in CycleFlag if flag]
    meanings = " ".join(str(flag.name).lower() for flag in flags)
    yield (
        FLAGS,
        "<u2",
        {
            "long_name": "what was wrong with the cycle",
            "flag_meanings": meanings,
            "flag_masks": np.array([int(flag) for flag in flags], dtype="<u2"),
        },
    )
    for column in columns:
        yield (
            column.name,
            "<" + np.dtype(column.dtype).str[1:],
            {
                "units": column.channel.unit,
                "long_name": column.described,
                "scale_factor": np.float64(column.channel.gain),
                "add_offset": np.float64(column.channel.offset),
            },
        )


def create_tables(file: h5py.File) -> tuple[h5py.Dataset, h5py.Dataset]:
    """The empty, growing tables of segments and events."""
    entry = file[ENTRY]
    assert isinstance(entry, h5py.Group)
    segments = entry.create_dataset(
        "segments", (0,), SEGMENT_TYPE, maxshape=(None,), chunks=(64,), fletcher32=True
    )
    # As dimension scales of their own they keep NetCDF readers from inventing nameless dimensions.
    segments.make_scale("segments")
    segments.attrs["description"] = text_attribute(
        "labelled intervals of rows [start, stop); set-points in SI"
    )
    events = entry.create_dataset(
        "events", (0,), EVENT_TYPE, maxshape=(None,), chunks=(16,), fletcher32=True
    )
    events.make_scale("events")
    events.attrs["description"] = text_attribute(
        "what happened; time in nanoseconds since 1970-01-01 UTC"
    )
    return segments, events


def fixed_bytes(text: str, length: int) -> tuple[bytes, bool]:
    """UTF-8 bytes that fit, cut between characters, and whether they were cut."""
    raw = text.encode().replace(b"\0", b" ")
    if len(raw) <= length:
        return raw, False
    return raw[:length].decode(errors="ignore").encode(), True


def to_json(value: object) -> str:
    """Strict JSON text of plain data, numpy numbers and arrays included; numbers that are not finite become null."""
    return json.dumps(_plain(value), ensure_ascii=False, allow_nan=False)


def from_json(text: str, where: str) -> Any:
    """The content of JSON text."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise RunFileError(f"is not JSON: {error}", where=where) from error


def _plain(value: object) -> object:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (np.ndarray, np.generic)):
        return _plain(value.tolist())
    if isinstance(value, (list, tuple, set, frozenset)):
        return [_plain(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, (str, int, bool)):
        return value
    return str(value)
