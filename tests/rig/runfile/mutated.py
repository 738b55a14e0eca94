"""Run files of which something was changed at random: bytes, or the structure by h5py. One seed, one file."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from rig import exits
from rig.errors import ChangedRunError
from rig.runfile.export import export_csv
from rig.runfile.layout import PART_SUFFIX
from rig.runfile.read import close_recording, glance, open_run
from rig.runfile.recover import recover_run
from rig.runfile.seal import file_sha256, hash_path
from rig.runfile.verify import verify_run
from tests.rig.fitting import fit_files

FITS = {"00005-import": "motion"}
"""The kind of fit for a run that no protocol of ours made."""
LONGEST = 10.0
"""s of processor time that a reader may take over one of these small files before it counts as hanging."""
NUMBERS = (0, 1, -1, np.nan, np.inf, -np.inf, 1e308, -1e-308, 2**31 - 1, -(2**31), 255)
TEXTS = (b"", b"{", b"null", b"[]", b'{"a": NaN}', b"[" * 5000, b"\xff\xfe", b"\x1b[2J", b"0")


class HangingError(Exception):
    """A reader that did not come back."""


def mutate_bytes(path: Path, random: np.random.Generator) -> str:
    """Other bytes, a hole, an end that is missing, or a piece that stands somewhere else."""
    raw = bytearray(path.read_bytes())
    kind = str(random.choice(["flip", "flip", "flip", "hole", "cut", "move"]))
    first = int(random.integers(len(raw)))
    length = int(random.integers(1, 4096))
    if kind == "flip":
        for place in random.integers(len(raw), size=random.integers(1, 5)):
            raw[place] ^= int(random.integers(1, 256))
    elif kind == "hole":
        raw[first : first + length] = bytes(len(raw[first : first + length]))
    elif kind == "cut":
        del raw[first:]
    else:
        target = int(random.integers(max(len(raw) - length, 1)))
        piece = raw[first : first + length]
        raw[target : target + len(piece)] = piece
    path.write_bytes(raw)
    return kind


def mutate_structure(path: Path, random: np.random.Generator) -> str:
    """An edit by somebody who knows HDF5: something taken away, replaced, lengthened, or given another value."""
    with h5py.File(path, "r+") as file:
        names: list[str] = []
        file.visit(names.append)
        name = str(random.choice(names))
        edit = EDITS[int(random.integers(len(EDITS)))]
        try:
            edit(file, name, random)
        except (
            AttributeError,
            IndexError,
            KeyError,
            OSError,
            OverflowError,
            RuntimeError,
            TypeError,
            ValueError,
        ) as error:
            # Not every edit fits everything: this file is as it was, or nearly.
            return f"{edit.__name__} of {name}: {type(error).__name__}"
    return f"{edit.__name__} of {name}"


def _take_away(file: Any, name: str, _: np.random.Generator) -> None:
    del file[name]


def _give_number(file: Any, name: str, random: np.random.Generator) -> None:
    value = NUMBERS[int(random.integers(len(NUMBERS)))]
    dataset = file[name]
    if isinstance(dataset, h5py.Group):
        raise TypeError
    if dataset.shape == ():
        dataset[()] = value
    else:
        dataset[int(random.integers(dataset.shape[0]))] = value


def _give_text(file: Any, name: str, random: np.random.Generator) -> None:
    text = TEXTS[int(random.integers(len(TEXTS)))]
    group = file[name].parent
    del file[name]
    group.create_dataset(name.rpartition("/")[2], data=np.bytes_(text or b"\0"))


def _give_bytes(file: Any, name: str, random: np.random.Generator) -> None:
    """Rows of a table or column, or a text, out of nothing but chance."""
    dataset = file[name]
    shape = dataset.shape
    count = (shape[0] if shape else 1) * dataset.dtype.itemsize
    rows = np.frombuffer(random.bytes(count), dtype=dataset.dtype)
    dataset[()] = rows.reshape(shape)


def _lengthen(file: Any, name: str, random: np.random.Generator) -> None:
    file[name].resize((int(random.choice([0, 1, 7, 100_000, 4_000_000_000])),))


def _retype(file: Any, name: str, random: np.random.Generator) -> None:
    group = file[name].parent
    del file[name]
    dtype = str(random.choice(["u1", "f4", "f8", "i8", "S5", "i2", "c16", "?"]))
    shape = [(), (3,), (2500,), (0,), (4, 4)][int(random.integers(5))]
    group.create_dataset(name.rpartition("/")[2], data=np.zeros(shape, dtype))


def _link(file: Any, name: str, random: np.random.Generator) -> None:
    group = file[name].parent
    del file[name]
    links = (h5py.SoftLink("/entry"), h5py.SoftLink(f"/{name}"), h5py.ExternalLink("x.h5", "/x"))
    group[name.rpartition("/")[2]] = links[int(random.integers(len(links)))]


def _attribute(file: Any, name: str, random: np.random.Generator) -> None:
    item = file[name]
    names = list(item.attrs)
    if not names:
        raise KeyError(name)
    chosen = names[int(random.integers(len(names)))]
    if random.random() < 0.3:
        del item.attrs[chosen]
        return
    values: tuple[Any, ...] = (*NUMBERS, *TEXTS, np.zeros(5), np.zeros((2, 2)))
    item.attrs[chosen] = values[int(random.integers(len(values)))]


def _chunk(file: Any, name: str, random: np.random.Generator) -> None:
    dataset = file[name]
    dataset.id.write_direct_chunk((0,), random.bytes(int(random.integers(1, 9000))), 0)


def _move(file: Any, name: str, _: np.random.Generator) -> None:
    file.move(name, f"{name}_")


EDITS: tuple[Callable[[Any, str, np.random.Generator], None], ...] = (
    _take_away,
    _give_number,
    _give_number,
    _give_text,
    _give_bytes,
    _lengthen,
    _retype,
    _link,
    _attribute,
    _attribute,
    _chunk,
    _move,
)


def mutated(source: Path, folder: Path, seed: int) -> tuple[Path, str, bool]:
    """A changed copy of a run, what was changed, and whether its note was made anew as well."""
    random = np.random.default_rng(seed)
    path = folder / source.name
    path.write_bytes(source.read_bytes())
    is_part = source.name.endswith(PART_SUFFIX)
    by_structure = not is_part and random.random() < 0.6
    what = (mutate_structure if by_structure else mutate_bytes)(path, random)
    resealed = bool(random.random() < 0.8)
    if not is_part:
        digest = file_sha256(path if resealed else source)
        hash_path(path).write_text(f"{digest}  {path.name}\n")
    return path, what, resealed


@contextmanager
def at_most(seconds: float) -> Iterator[None]:
    """Raise `HangingError` in a block that computes for longer, however busy the machine is."""

    def ring(*_: object) -> None:
        raise HangingError

    before = signal.signal(signal.SIGPROF, ring)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def uses(path: Path) -> dict[str, Callable[[], object]]:
    """What is done with a run file, each of it a way to read it."""

    def read() -> None:
        recording = open_run(path)
        for name in recording.signals:
            recording.si(name)
        close_recording(recording)

    def export() -> None:
        recording = open_run(path)
        export_csv(recording, path.with_suffix(".csv"), overwrite=True)
        close_recording(recording)

    every: dict[str, Callable[[], object]] = {
        "read": read,
        "list": lambda: glance(path),
        "verify": lambda: verify_run(path),
        "fit": lambda: fit_files([path], FITS.get(path.name[:12], "")),
        "export": export,
    }
    if path.name.endswith(PART_SUFFIX):
        every |= {"recover": lambda: recover_run(path)}
    return every


def outcome_of(use: Callable[[], object]) -> str:
    """ "read", "changed" or "refused"; whatever else an exception says is a defect, and raised."""
    try:
        with at_most(LONGEST):
            use()
    except ChangedRunError:
        return "changed"
    except Exception as error:
        known = exits.explain(error)
        if isinstance(error, OSError) or known is None or "\n" in str(error):
            raise
        return "refused"
    return "read"
