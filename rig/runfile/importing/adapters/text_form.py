"""How a text file is written: its encoding, compression, delimiter and decimal marks, said or found out."""

from __future__ import annotations

import csv
import gzip
import io
import re
import zlib
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import cast

from rig.errors import RunFileError

DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_WHITESPACE = "whitespace"
NOTHING = "nothing"
"""A single column: a blank in its heading separates nothing."""
ANY = "any"
"""One comma, semicolon, tab or bar with white space around it, or white space alone."""
_WORDS = re.compile(r"\S+(?:\s+[\[(][^\])]*[\])])?")
_ANY = re.compile(r"\s*[,;|\t]\s*|\s+")
DELIMITERS = {
    "tab": "\t",
    "\\t": "\t",
    "space": _WHITESPACE,
    _WHITESPACE: _WHITESPACE,
    ANY: ANY,
    "comma": ",",
    "semicolon": ";",
}
"""Words for delimiters besides the character itself."""
NAMES = {
    "\t": "tab",
    ",": "comma",
    ";": "semicolon",
    "|": "bar",
    _WHITESPACE: "white space",
    NOTHING: "nothing: there is one",
    ANY: "any of comma, semicolon, bar, tab and white space",
}
MARK_WORDS = {False: "point", True: "comma"}
"""What the decimal mark is called, by whether it is the comma."""
_COMMENTS = ("#", "%", "//")
_GZIP = b"\x1f\x8b"


@dataclass(frozen=True, kw_only=True)
class TextForm:
    """What is said of the form of a text file; what is left open is found out.

    `skip` lines at the beginning are not looked at; line `header` (counted from 1) holds the
    headings; with `is_ragged` lines may end early, and what is not there is not there.
    """

    delimiter: str = ""
    decimal: str = ""
    skip: int = 0
    header: int = 0
    is_ragged: bool = False


def is_named(path: Path, number: int, name: str) -> bool:
    """Whether one of several files is meant by its name, its stem, or its number from 1."""
    return name in (path.name, path.stem, str(number))


@contextmanager
def open_text(path: Path, encoding: str) -> Iterator[io.TextIOBase]:
    """The lines of a text file, unpacked where it is compressed (gzip). Raises `RunFileError`."""
    try:
        with _raw(path) as raw:
            yield io.TextIOWrapper(raw, encoding=encoding, errors="replace", newline=None)
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise RunFileError(f"is damaged: {error}", where=str(path)) from error
    except OSError as error:
        raise RunFileError(f"cannot be read: {error.strerror or error}", where=str(path)) from error


@contextmanager
def _raw(path: Path) -> Iterator[io.BufferedReader]:
    with path.open("rb") as stream:
        is_packed = stream.read(2) == _GZIP
        stream.seek(0)
        if not is_packed:
            yield stream
            return
        with gzip.GzipFile(fileobj=stream) as unpacked:
            yield cast(io.BufferedReader, unpacked)


def encoding_of(path: Path) -> str:
    """The encoding by its mark or by trying; a file with zero bytes is no text."""
    try:
        with _raw(path) as stream:
            head = stream.read(65536)
    except (EOFError, zlib.error, OSError) as error:
        why = getattr(error, "strerror", "") or error
        raise RunFileError(f"cannot be read: {why}", where=str(path)) from error
    if head.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    if b"\0" in head:
        raise RunFileError(
            "is not a text file",
            where=str(path),
            remedy="For a MATLAB file use `rig import mat`; a run file needs no import.",
        )
    try:
        head[: head.rfind(b"\n") + 1].decode("utf-8")
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8-sig"


def find_delimiter(sample: list[str]) -> str:
    """The delimiter that cuts the later lines, which are no headings, into one and the same number (> 1) of cells."""
    lines = sample[len(sample) // 2 :][-20:]
    for candidate in ("\t", ";", "|"):
        if len({line.count(candidate) for line in lines}) == 1 and candidate in lines[0]:
            return candidate
    return _comma_or_blank(lines) or _most_frequent_mark(lines)


def _comma_or_blank(lines: list[str]) -> str:
    """Comma, white space, nothing or any of them, by what cuts these lines alike; "" where none does."""
    commas = {len(split_line(line, ",")) for line in lines}
    words = [line.split() for line in lines]
    blanks = set(map(len, words))
    if _is_table(blanks) and (commas == {1} or all(map(_is_number, chain(*words)))):
        return _WHITESPACE
    if _is_table(commas):
        return ","
    if commas == blanks == {1}:
        return NOTHING
    if _is_table({len(split_line(line, ANY)) for line in lines}) and _all_numbers(lines):
        return ANY
    return ""


def _is_table(widths: set[int]) -> bool:
    """Whether all lines have the same number of cells, more than one."""
    return len(widths) == 1 and max(widths) > 1


def _is_number(cell: str) -> bool:
    return bool(DECIMAL_COMMA.fullmatch(cell) or NUMBER.fullmatch(cell))


def _most_frequent_mark(lines: list[str]) -> str:
    """The mark that most lines have equally often; white space where no line has one."""
    counts = Counter((mark, n) for mark in ",;\t|" for line in lines if (n := line.count(mark)))
    return max(counts, key=counts.__getitem__, default=(_WHITESPACE, 0))[0]


def _all_numbers(lines: list[str]) -> bool:
    """Whether every cell of these lines is a number when each of the delimiters may separate."""
    return all(NUMBER.fullmatch(cell) for line in lines for cell in split_line(line, ANY))


def split_line(line: str, delimiter: str) -> list[str]:
    """The cells of a line."""
    if delimiter == _WHITESPACE:
        # `t [s]` is one heading.
        return _WORDS.findall(line) if "[" in line or "(" in line else line.split()
    if delimiter == NOTHING:
        return [line.strip()]
    if delimiter == ANY:
        return _ANY.split(line.strip())
    line = line.rstrip("\r\n")
    if '"' in line:
        try:
            return [
                cell.strip()
                for cell in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])
            ]
        except csv.Error:
            return line.split(delimiter)
    return [cell.strip() for cell in line.split(delimiter)]


def has_content(line: str) -> bool:
    """Whether a line is neither blank nor a comment."""
    stripped = line.strip()
    return bool(stripped) and not stripped.startswith(_COMMENTS)


def missing_value(cell: str) -> bool:
    """Whether a cell that is no number stands for one that is missing, rather than for a heading."""
    return cell.strip().lower().lstrip("+-") in (
        "",
        "nan",
        "inf",
        "infinity",
        "na",
        "n/a",
        "null",
        "none",
        "-",
    )


def shown(text: str) -> str:
    """A text as a message quotes it."""
    return repr(text if len(text) <= 40 else text[:37] + "...")
