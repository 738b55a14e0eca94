"""What a list of runs says of one, read quickly: some twenty small fields and two rows of the file, nothing else.

Everything that is read is examined first, by the same rules as when a run is opened; what is not
read (channels, parameters, the parameter set of the gear) is not. A file in which anything is not
as it should be, and one that still grows, is read by `glance`, which says what is wrong.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import h5py
import numpy as np

# The library's own calls are compiled and have no types.
from h5py import h5d, h5g, h5s  # pyright: ignore[reportAttributeAccessIssue]

from experiments.recording import Event, Origin
from model.gear import Mounting
from rig.errors import RigError
from rig.runfile import layout
from rig.runfile.closing import ACQUISITION, CHECKSUM, Closing, outcome_read
from rig.runfile.header import check_format
from rig.runfile.layout import PART_SUFFIX
from rig.runfile.opening import require_hdf5
from rig.runfile.read import glance
from rig.runfile.structure import refuse_foreign_members

_READ = {
    layout.ENTRY: ("run_id", "start_time", "end_time", "outcome", "status", "events"),
    layout.USER: ("name",),
    layout.SAMPLE: ("name", "serial_number", "mounting"),
    layout.PROCESS: ("experiment", "origin", "details", ACQUISITION, Path(CHECKSUM).name),
    layout.DATA: (layout.TIME,),
}
"""All that is read of a sealed file, by group."""


@dataclass(frozen=True, kw_only=True)
class Listing:
    """What a list of runs says of one. `duration` in s from the first to the last row; `notes` the operators', in one
    text; `bench` "" where the file does not say it.
    """

    run_id: str
    protocol: str
    gear_serial: str
    gear: str
    operator: str
    start: str
    duration: float
    outcome: str
    origin: str
    backend: str
    rows: int
    notes: str
    bench: str
    mounting: str


def read_listing(path: Path) -> Listing:
    """What a list says of a run file. Raises `RunFileError` as `glance` does."""
    if not path.name.endswith(PART_SUFFIX):
        try:
            require_hdf5(path)
            with h5py.File(path, "r", driver="stdio") as file:
                listing = _quickly(file)
        except (RigError, OSError, RuntimeError, LookupError, ValueError, TypeError):
            # Whatever it was, the careful look names it.
            listing = None
        if listing is not None:
            return listing
    return _carefully(path)


def _carefully(path: Path) -> Listing:
    seen = glance(path)
    m = seen.metadata
    return Listing(
        run_id=m.run_id,
        protocol=m.experiment,
        gear_serial=m.gear_serial,
        gear=m.gear.name if m.gear is not None else "",
        operator=m.operator,
        start=m.start_time,
        duration=seen.duration,
        outcome=m.outcome,
        origin=m.origin,
        backend=str(m.process.get("backend", "")),
        rows=seen.rows,
        notes=notes_of(seen.events),
        bench=str(m.process.get("bench", "")),
        mounting=m.mounting,
    )


def notes_of(events: tuple[Event, ...]) -> str:
    """What the operators noted, in one text."""
    return "; ".join(e.text for e in events if e.source == "operator" and e.code == "note")


def _quickly(file: h5py.File) -> Listing | None:
    """The same of a sealed file; None where something is not as this program writes it."""
    check_format(file)
    refuse_foreign_members(file, _READ)
    groups = {path: h5g.open(file.id, path.encode()) for path in _READ}

    def text(group: str, name: str) -> str:
        return _text(groups[group], name)

    details = json.loads(text(layout.PROCESS, "details") or "{}")
    origin, mounting = text(layout.PROCESS, "origin"), text(layout.SAMPLE, "mounting")
    words = Closing(
        *(text(layout.ENTRY, name) for name in ("end_time", "outcome", "status")),
        acquisition=text(layout.PROCESS, ACQUISITION),
    )
    checksum = _rows(groups[layout.PROCESS], Path(CHECKSUM).name, np.dtype("<i8"))
    if (
        origin not in get_args(Origin)
        or mounting not in get_args(Mounting)
        or not isinstance(details, dict)
        or checksum.shape != (1,)
        or int(checksum[0]) != words.checksum
    ):
        return None
    rows, duration = _span(groups[layout.DATA])
    return Listing(
        run_id=text(layout.ENTRY, "run_id"),
        protocol=text(layout.PROCESS, "experiment"),
        gear_serial=text(layout.SAMPLE, "serial_number"),
        gear=text(layout.SAMPLE, "name"),
        operator=text(layout.USER, "name"),
        start=text(layout.ENTRY, "start_time"),
        duration=duration,
        outcome=outcome_read(words.outcome),
        origin=origin,
        backend=str(details.get("backend", "")),
        rows=rows,
        notes=_notes(groups[layout.ENTRY]),
        bench=str(details.get("bench", "")),
        mounting=mounting,
    )


def _text(group: Any, name: str) -> str:
    """A text of fixed length. Raises `KeyError` where there is none, `TypeError` for what is no text."""
    dataset = h5d.open(group, name.encode())
    dtype = dataset.dtype
    if dtype.kind != "S" or dataset.shape not in ((), (1,)):
        raise TypeError(name)
    value = np.empty(dataset.shape, dtype)
    dataset.read(h5s.ALL, h5s.ALL, value, dataset.get_type())
    return bytes(value.reshape(1)[0]).decode()


def _rows(group: Any, name: str, dtype: np.dtype[Any]) -> Any:
    """All rows of a table or column. Raises `TypeError` where it is of another form."""
    dataset = h5d.open(group, name.encode())
    if dataset.dtype != dtype or len(dataset.shape) != 1:
        raise TypeError(name)
    rows = np.empty(dataset.shape, dtype)
    if rows.size:
        dataset.read(h5s.ALL, h5s.ALL, rows, dataset.get_type())
    return rows


def _span(data: Any) -> tuple[int, float]:
    """Rows, and the time from the first to the last one [s]."""
    column = h5d.open(data, layout.TIME.encode())
    if column.dtype != np.dtype("<i8") or len(column.shape) != 1:
        raise TypeError(layout.TIME)
    (rows,) = column.shape
    if not rows:
        return 0, 0.0
    stamps = h5py.Dataset(column)
    duration = (int(stamps[rows - 1]) - int(stamps[0])) * 1e-9
    return rows, duration if math.isfinite(duration) else math.nan


def _notes(entry: Any) -> str:
    events = _rows(entry, "events", layout.EVENT_TYPE)
    noted = events[(events["source"] == b"operator") & (events["code"] == b"note")]
    return "; ".join(text.decode() for text in noted["text"])
