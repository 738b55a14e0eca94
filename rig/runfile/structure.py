"""What a run file may be made of, looked at once when it is opened and before anything in it is read.

HDF5 can do far more than a run needs: rows that lie in other files, names that point elsewhere,
filters that are programs, a few bytes that claim to be terabytes. A run uses none of it, so all of
it is refused. The rules are two tables: `_RULES` for each dataset, `_CHUNK_RULES` for what its
chunks take in the file.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import h5py

# The library's own calls are compiled and have no types.
from h5py import h5a, h5d, h5g, h5l, h5o, h5s, h5z  # pyright: ignore[reportAttributeAccessIssue]

from rig.errors import RunFileError
from rig.runfile.layout import DATA, MAXIMUM_TEXT, TIME

_MOST_OBJECTS: Final = 20_000
"""Groups and datasets of a file; a channel takes 18 of them."""
DEEPEST: Final = 5
"""Names in a path: /entry/instrument/NAME/calibration/scale."""
_MOST_ATTRIBUTES: Final = 64
"""Of one group or dataset."""
_LARGEST_ATTRIBUTE: Final = 65_536
"""Bytes; what fits into an object header."""
_LARGEST_CHUNK: Final = MAXIMUM_TEXT
"""Bytes that must be held in memory to read one row; a chunk of a column takes 65 kB."""
LARGEST_RATIO: Final = 1032
"""Bytes read per byte stored: the format can do no better (258 bytes by 2 bits), whoever packs. A constant channel of a
run reaches 690."""
LARGEST_TIME_RATIO: Final = 250
"""The same for the time of the rows, which is never constant and reaches 120; it bounds the rows of a file."""
FILTERS: Final = (h5z.FILTER_SHUFFLE, h5z.FILTER_DEFLATE, h5z.FILTER_FLETCHER32)
"""In the order in which a run uses them, each at most once: what was packed twice would grow 1032 times twice."""
_SLACK_CHUNKS: Final = 16
"""Chunks by which a column that is being written may be longer than what is stored of it."""
_LEAST_ENTRY = 8
"""Bytes that the place of a chunk takes in the file, whatever it holds."""


@dataclass(frozen=True)
class _Stored:
    """How a dataset lies in the file. `shape` in rows, `chunk` in rows (0: not in chunks), sizes in bytes."""

    path: str
    layout: int
    external: int
    filters: tuple[int, ...]
    shape: tuple[int, ...]
    itemsize: int
    kind: str
    chunk: int
    file_size: int
    grows: bool

    @property
    def rows(self) -> int:
        """Rows that it says it has; one where it has no dimension."""
        return self.shape[0] if self.shape else 1

    @property
    def claimed(self) -> int:
        """Bytes that it says it has."""
        return self.itemsize * self.rows

    @property
    def chunks(self) -> int:
        """Chunks that its rows need."""
        return -(-self.shape[0] // self.chunk) if self.chunk else 0

    @property
    def slack(self) -> int:
        """Chunks that a growing column may still be without: one there may be claimed and not yet stored."""
        return _SLACK_CHUNKS * self.grows

    @property
    def slack_bytes(self) -> int:
        """The same in bytes."""
        return self.slack * self.chunk * self.itemsize

    @property
    def is_column(self) -> bool:
        """Whether it is a column of rows."""
        return self.path.startswith(f"{DATA}/")


@dataclass
class _Chunks:
    """What the chunks of a dataset take: their number, their bytes, the largest one, and where the last one ends."""

    count: int = 0
    stored: int = 0
    largest: int = 0
    end: int = 0

    def add(self, chunk: Any) -> None:
        self.count += 1
        self.stored += chunk.size
        self.largest = max(self.largest, chunk.size)
        self.end = max(self.end, chunk.byte_offset + chunk.size)


_Rule = tuple[str, Callable[[_Stored], bool]]
_RULES: Final[tuple[_Rule, ...]] = (
    ("is put together from other datasets", lambda d: d.layout == h5d.VIRTUAL),
    ("lies in another file", lambda d: d.external > 0),
    ("is stored in a way that no run uses", lambda d: d.layout > h5d.CHUNKED),
    ("has a type that no run uses", lambda d: d.kind not in "iufSV" or d.itemsize < 1),
    ("has more than one dimension", lambda d: len(d.shape) > 1),
    ("is packed by filters that no run uses", lambda d: not _are_ours(d.filters)),
    ("is a column that is not in chunks", lambda d: d.is_column and not d.chunk),
    ("has chunks of absurd size", lambda d: d.chunk * d.itemsize > _LARGEST_CHUNK),
    ("is larger than its file", lambda d: not d.chunk and d.claimed > d.file_size),
    ("has more rows than its file can hold", lambda d: d.chunks * _LEAST_ENTRY > d.file_size),
)
_ChunkRule = tuple[str, Callable[[_Stored, _Chunks], bool]]
_CHUNK_RULES: Final[tuple[_ChunkRule, ...]] = (
    (
        "has rows that were never stored",
        lambda d, c: d.chunks > c.count + d.slack,
    ),
    ("is cut off: its rows lie beyond the end of the file", lambda d, c: c.end > d.file_size),
    (
        "has chunks that are larger packed than unpacked",
        lambda d, c: c.largest > d.chunk * d.itemsize + LARGEST_RATIO,
    ),
    (
        "unpacks to more than gzip can pack",
        lambda d, c: d.claimed > LARGEST_RATIO * (c.stored + d.slack_bytes),
    ),
    (
        "has more time stamps than can be packed into its bytes",
        lambda d, c: (
            d.path == f"{DATA}/{TIME}"
            and d.claimed > LARGEST_TIME_RATIO * (c.stored + d.slack_bytes)
        ),
    ),
)


@dataclass
class _Walk:
    """What was met so far: objects, and the bytes that all chunks together say they take.

    A file that grows is as large as it is when that is asked: its writer goes on while it is walked.
    """

    file: str
    grows: bool
    file_size: int = 0
    objects: int = 0
    stored: int = 0
    groups: list[tuple[str, Any]] = field(default_factory=list)

    def size(self) -> int:
        """Bytes of the file. Ask after its index was read: what that names was written before it."""
        if self.grows or not self.file_size:
            self.file_size = os.stat(self.file).st_size
        return self.file_size


def refuse_foreign_structure(file: h5py.File, *, grows: bool, leave_out: str = "") -> None:
    """Raise `RunFileError` for a file that is built from anything but what a run is built from; reads no row.

    `grows`: a writer may be at work, so that columns may be ahead of their chunks. `leave_out`: the
    path of a group that the caller never looks into.
    """
    walk = _Walk(file.filename, grows)
    walk.groups.append(("", h5g.open(file.id, b"/")))
    while walk.groups:
        path, group = walk.groups.pop()
        _check_attributes(path, group)
        walk.objects += group.get_num_objs()
        if walk.objects > _MOST_OBJECTS:
            _refuse("has more groups and datasets than any run", path, walk.objects, _MOST_OBJECTS)
        for name in group:
            place = f"{path}/{name.decode()}".lstrip("/")
            if place != leave_out:
                _check_member(walk, group, name, place)


def examined_members(file: h5py.File, members: Mapping[str, Sequence[str]]) -> dict[str, Any]:
    """Some datasets by their paths, held against the same rules, for whoever reads nothing else of a sealed file.

    `members`: names of datasets by the path of their group. Raises `KeyError` for one that is not there, `RunFileError`
    as `refuse_foreign_structure` does.
    """
    walk = _Walk(file.filename, grows=False)
    found: dict[str, Any] = {"": h5g.open(file.id, b"/")}
    for path, names in members.items():
        place = ""
        for step in path.split("/"):
            above, place = found[place], f"{place}/{step}".lstrip("/")
            if place not in found:
                found[place] = _check_member(walk, above, step.encode(), place)
        for name in names:
            inside = f"{path}/{name}"
            found[inside] = _check_member(walk, found[path], name.encode(), inside)
    return found


def refuse_foreign_storage(dataset: h5py.Dataset, file_size: int) -> None:
    """Raise `RunFileError` for an array of another program's file that lies elsewhere, or is larger
    than anything that gzip can pack into the file [bytes].
    """
    path = str(dataset.name)
    if dataset.is_virtual or dataset.external:
        _refuse("lies in other files or datasets", path)
    if dataset.nbytes > LARGEST_RATIO * file_size:
        _refuse("is larger than anything in its file", path, f"{dataset.nbytes} bytes", file_size)


def _check_member(walk: _Walk, group: Any, name: bytes, path: str) -> Any:
    """The object of one name in a group: it must lie here and have no other name."""
    if group.links.get_info(name).type != h5l.TYPE_HARD:
        _refuse("is a link that points elsewhere", path)
    if path.count("/") >= DEEPEST:
        _refuse("lies deeper than anything in a run", path, path.count("/") + 1, DEEPEST)
    member = h5o.open(group, name)
    if h5o.get_info(member).rc != 1:
        _refuse("has a second name", path)
    if isinstance(member, h5g.GroupID):
        walk.groups.append((path, member))
    elif isinstance(member, h5d.DatasetID):
        _check_attributes(path, member)
        _check_dataset(walk, path, member)
    else:
        _refuse("is neither a group nor a dataset", path)
    return member


def _check_dataset(walk: _Walk, path: str, dataset: Any) -> None:
    plan = dataset.get_create_plist()
    layout = plan.get_layout()
    if layout == h5d.COMPACT:
        # It lies in its own header of 64 kB at most, as nearly every field of a run does.
        return
    space = dataset.get_space()
    is_null = space.get_simple_extent_type() == h5s.NULL
    chunk = plan.get_chunk() if layout == h5d.CHUNKED else ()
    stored = _Stored(
        path=path,
        layout=layout,
        external=plan.get_external_count(),
        filters=tuple(plan.get_filter(i)[0] for i in range(plan.get_nfilters())),
        shape=(0, 0) if is_null else space.get_simple_extent_dims(),
        itemsize=dataset.get_type().get_size(),
        kind=dataset.dtype.kind if layout != h5d.VIRTUAL else "V",
        chunk=chunk[0] if len(chunk) == 1 else 0,
        file_size=walk.size(),
        grows=walk.grows,
    )
    for what, breaks in _RULES:
        if breaks(stored):
            _refuse(what, path, _described(stored))
    if not stored.chunk:
        return
    chunks = _Chunks()
    dataset.chunk_iter(chunks.add)
    walk.stored += chunks.stored
    stored = replace(stored, file_size=walk.size())
    for what, breaks_chunks in _CHUNK_RULES:
        if breaks_chunks(stored, chunks):
            _refuse(what, path, f"{_described(stored)}, {chunks.stored} stored")
    # Entries that share one place in the file would make much of little.
    if walk.stored > walk.file_size:
        _refuse("stores more than the file holds", path, walk.stored, walk.file_size)


def _check_attributes(path: str, item: Any) -> None:
    number = h5a.get_num_attrs(item)
    if number > _MOST_ATTRIBUTES:
        _refuse("has more attributes than anything in a run", path, number, _MOST_ATTRIBUTES)
    for index in range(number):
        attribute = h5a.open(item, index=index)
        if attribute.get_storage_size() > _LARGEST_ATTRIBUTE:
            name = f"{path}@{attribute.name.decode()}"
            _refuse(
                "is larger than any attribute of a run",
                name,
                attribute.get_storage_size(),
                _LARGEST_ATTRIBUTE,
            )


def _are_ours(filters: tuple[int, ...]) -> bool:
    """Whether these are some of `FILTERS`, in their order, none twice."""
    return filters == tuple(one for one in FILTERS if one in filters)


def _described(d: _Stored) -> str:
    return f"{d.rows} rows, {d.claimed} bytes in a file of {d.file_size}"


def _refuse(what: str, path: str, value: object = None, limit: object = "") -> None:
    raise RunFileError(
        what,
        where=path or "/",
        value=value,
        limit=str(limit),
        remedy="No run is built like this: take the original.",
    )
