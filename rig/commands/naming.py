"""A run as it is typed: its file, or its number or name in the folder of runs."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import typer

RunsFolder = Annotated[
    Path,
    typer.Option("--runs", metavar="DIR", help="Folder in which a run is meant by its number."),
]
"""Of every command whose runs may be typed by their numbers."""
RUNS = Path("runs")
"""The folder of runs where none is named."""
_NAME = re.compile(r"\d+(-.*)?")
_ENDINGS = (".h5", ".part", ".toml", ".json", ".jsonl", ".pdf", ".html", ".csv")
"""What a file ends in: a name that ends so is one, whether it is there or not."""


def is_name(word: str) -> bool:
    """Whether a word may be the number or the name of a run: 12, 00012-friction-A1."""
    return bool(_NAME.fullmatch(word)) and not word.endswith(_ENDINGS)


def run_meant(folder: Path, run: Path) -> Path:
    """The file of a run: itself where it is one, else the run of this number or name in the folder.

    Raises `RunFileError` where the folder has no such run, or several.
    """
    if run.exists() or not is_name(str(run)):
        return run
    from rig.library.folder import run_named

    # Whoever stands in the folder of runs need not name it.
    is_within = folder == RUNS and not folder.is_dir()
    return run_named(Path() if is_within else folder, str(run))


def runs_meant(folder: Path, runs: Iterable[Path]) -> list[Path]:
    """The file of each run, by `run_meant`."""
    return [run_meant(folder, run) for run in runs]
