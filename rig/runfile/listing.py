"""What a list of runs says of one, read quickly: some twenty small fields and two rows of the file, nothing else.

Everything that is read is examined first, by the same rules as when a run is opened; what is not
read (channels, parameters, the parameter set of the gear) is not. A file in which anything is not
as it should be, and one that still grows, is read by `glance`, which says what is wrong.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import h5py
import numpy as np

# The library's own calls are compiled and have no types.
from h5py import h5s, h5t  # pyright: ignore[reportAttributeAccessIssue]

from experiments.recording import Event, Origin
from model.gear import Mounting
from rig.errors import RigError
from rig.runfile import layout
from rig.runfile.closing import ACQUISITION, CHECKSUM, Closing, outcome_read
from rig.runfile.header import check_format, gear_name
from rig.runfile.layout import PART_SUFFIX
from rig.runfile.opening import require_hdf5
from rig.runfile.read import glance
from rig.runfile.structure import examined_members

RATIO = f"{layout.SAMPLE}/ratio"
_READ = {
    layout.ENTRY: ("run_id", "start_time", "end_time", "outcome", "status", "events"),
    layout.USER: ("name",),
    layout.SAMPLE: ("name", "serial_number", "mounting", "ratio"),
    layout.PROCESS: ("experiment", "origin", "details", ACQUISITION, Path(CHECKSUM).name),
    layout.DATA: (layout.TIME,),
}
"""All that is read of a sealed file, by group."""
_TEXTS = tuple(
    path
    for group, names in _READ.items()
    for name in names
    if (path := f"{group}/{name}")
    not in (CHECKSUM, RATIO, layout.EVENTS, f"{layout.DATA}/{layout.TIME}")
)


@dataclass(frozen=True, kw_only=True)
class _Listing:
    """What a list of runs says of one. `duration` in s from the first to the last row; `notes` the operators', in one
    text; `bench` "" where the file does not say it.
    """

    run_id: str
    protocol: str
    gear_serial: str
    gear: str
    ratio: float
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


def read_listing(path: Path) -> _Listing:
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


def _carefully(path: Path) -> _Listing:
    seen = glance(path)
    m = seen.metadata
    return _Listing(
        run_id=m.run_id,
        protocol=m.experiment,
        gear_serial=m.gear_serial,
        gear=gear_name(m),
        ratio=m.ratio,
        operator=m.operator,
        start=m.start_time,
        duration=seen.duration,
        outcome=m.outcome,
        origin=m.origin,
        backend=str(m.process.get("backend", "")),
        rows=seen.rows,
        notes=_notes_of(seen.events),
        bench=str(m.process.get("bench", "")),
        mounting=m.mounting,
    )


def _notes_of(events: tuple[Event, ...]) -> str:
    """What the operators noted, in one text."""
    return "; ".join(e.text for e in events if e.source == "operator" and e.code == "note")


def _quickly(file: h5py.File) -> _Listing | None:
    """The same of a sealed file; None where something is not as this program writes it."""
    check_format(file)
    found = examined_members(file, _READ)
    texts = {path: _text(found[path]) for path in _TEXTS}
    details = json.loads(texts[f"{layout.PROCESS}/details"] or "{}")
    origin, mounting = texts[f"{layout.PROCESS}/origin"], texts[f"{layout.SAMPLE}/mounting"]
    words = Closing(
        *(texts[f"{layout.ENTRY}/{name}"] for name in ("end_time", "outcome", "status")),
        acquisition=texts[f"{layout.PROCESS}/{ACQUISITION}"],
    )
    ratio = _number(found[RATIO])
    checksum = _rows(found[CHECKSUM], np.dtype("<i8"))
    if (
        origin not in get_args(Origin)
        or mounting not in get_args(Mounting)
        or not isinstance(details, dict)
        or checksum.shape != (1,)
        or int(checksum[0]) != words.checksum
    ):
        return None
    rows, duration = _span(found[f"{layout.DATA}/{layout.TIME}"])
    return _Listing(
        run_id=texts[f"{layout.ENTRY}/run_id"],
        protocol=texts[f"{layout.PROCESS}/experiment"],
        gear_serial=texts[f"{layout.SAMPLE}/serial_number"],
        gear=texts[f"{layout.SAMPLE}/name"],
        ratio=ratio,
        operator=texts[f"{layout.USER}/name"],
        start=texts[f"{layout.ENTRY}/start_time"],
        duration=duration,
        outcome=outcome_read(words.outcome),
        origin=origin,
        backend=str(details.get("backend", "")),
        rows=rows,
        notes=_notes(found[layout.EVENTS]),
        bench=str(details.get("bench", "")),
        mounting=mounting,
    )


def _text(dataset: Any) -> str:
    """A text of fixed length. Raises `TypeError` for what is none."""
    kind = dataset.get_type()
    if not isinstance(kind, h5t.TypeStringID) or kind.is_variable_str():
        raise TypeError("no text of fixed length")
    value = np.empty(dataset.shape, f"S{kind.get_size()}")
    if value.size != 1:
        raise TypeError("no single text")
    dataset.read(h5s.ALL, h5s.ALL, value, kind)
    return bytes(value.item()).decode()


def _number(dataset: Any) -> float:
    """A number. Raises `TypeError` for what is none."""
    if dataset.dtype != np.dtype("<f8") or dataset.shape not in ((), (1,)):
        raise TypeError("no number")
    value = np.empty(dataset.shape)
    dataset.read(h5s.ALL, h5s.ALL, value, dataset.get_type())
    return float(value.item())


def _rows(dataset: Any, dtype: np.dtype[Any]) -> Any:
    """All rows of a table or column. Raises `TypeError` where it is of another form."""
    if dataset.dtype != dtype or len(dataset.shape) != 1:
        raise TypeError("no table of this form")
    rows = np.empty(dataset.shape, dtype)
    if rows.size:
        dataset.read(h5s.ALL, h5s.ALL, rows, dataset.get_type())
    return rows


def _span(stamps: Any) -> tuple[int, float]:
    """Rows, and the time from the first to the last one [s]."""
    if stamps.dtype != np.dtype("<i8") or len(stamps.shape) != 1:
        raise TypeError("no column of time")
    (rows,) = stamps.shape
    if not rows:
        return 0, 0.0
    column = h5py.Dataset(stamps)
    return rows, (int(column[rows - 1]) - int(column[0])) * 1e-9


def _notes(table: Any) -> str:
    events = _rows(table, layout.EVENT_TYPE)
    noted = events[(events["source"] == b"operator") & (events["code"] == b"note")]
    return "; ".join(text.decode() for text in noted["text"])
