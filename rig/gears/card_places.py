"""Where gear cards lie: in a folder of runs, or in one above it; and the places that somebody names."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from urllib.parse import quote as in_file_name

from rig.runfile.file_names import is_device

FOLDER = ".gears"
"""Lies in the folder of runs."""


def cards_folder(folder: str | Path) -> Path:
    """Where the cards of a folder of runs lie."""
    return Path(folder) / FOLDER


def card_file(serial: str) -> str:
    """The name of the file of one gear's card; characters that a file name cannot have are written as %XX, and of a
    name that it cannot have the first one.
    """
    name = in_file_name(serial.strip(), safe=" ()+,=@").replace("~", "%7E")
    if is_device(name):
        name = f"%{ord(name[0]):02X}{name[1:]}"
    return f"{name or '%20'}.toml"


def card_path(folder: str | Path, serial: str) -> Path:
    """The file of one gear's card: the nearest one of this folder and those above it; in this folder where none is."""
    name = card_file(serial)
    # Asked for thousands of gears: texts, not paths, and no file is looked for where no folder of cards is.
    own = os.path.join(folder, FOLDER, name)
    if not os.path.exists(own):
        for place in above(folder):
            cards = os.path.join(place, FOLDER)
            if os.path.isdir(cards) and os.path.isfile(os.path.join(cards, name)):
                return Path(cards, name)
    return Path(own)


def from_cards(part: str) -> str:
    """A parameter set that lies with the cards by its path from there, which stays when they are moved; any other as
    it is named.
    """
    return Path(part).as_posix().rpartition(f"/{FOLDER}/")[2] if FOLDER in part else part


def places(where: str | Path | Iterable[str | Path]) -> list[str | Path]:
    """The folders and files that are named: one alone, or each of several."""
    return [where] if isinstance(where, (str, Path)) else list(where)


def above(folder: str | Path) -> Iterator[str]:
    """The folders above a folder, the nearest first."""
    place = os.path.abspath(folder)
    while (higher := os.path.dirname(place)) != place:
        yield higher
        place = higher
