"""What a run keeps of the files that people write: the hash of each, and of a calibration a sealed copy.

A copy lies in `<folder of runs>/.calibrations`, named by its content: each is kept once, when it is
first used. Whoever edits the original afterwards changes nothing that a run rests on.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from rig.bench.config.used import UsedFile
from rig.errors import ChangedRunError, RunFileError
from rig.runfile.seal import hash_path
from rig.runfile.sealed import read_sealed, replace_sealed

FOLDER = ".calibrations"
"""Lies in the folder of runs."""


def keep_files(files: Iterable[UsedFile], folder: Path) -> list[dict[str, str]]:
    """What a run notes of the files that it uses: name, kind, SHA-256, and where the copy of a calibration lies.

    Raises `ChangedRunError` for a copy that was changed since it was kept, `RunFileError` where none can be written.
    """
    return [
        {
            "name": file.name,
            "kind": file.kind,
            "sha256": file.sha256,
            "copy": _sealed_copy(file, folder) if file.kind == "calibration" else "",
        }
        for file in files
    ]


def _sealed_copy(file: UsedFile, folder: Path) -> str:
    """The sealed copy of a file, made where there is none yet, as seen from the folder of runs."""
    name = Path(file.name)
    path = folder / FOLDER / f"{name.stem}-{file.sha256[:12]}{name.suffix}"
    try:
        # By its name its content is known: one that a kill left without its note is written once more.
        if not (path.exists() and hash_path(path).exists()):
            path.parent.mkdir(parents=True, exist_ok=True)
            replace_sealed(path, file.content)
        _, seal = read_sealed(path)
    except OSError as error:
        raise RunFileError(
            "the copy of a calibration cannot be written",
            where=str(path),
            value=error.strerror or str(error),
            remedy="Make the folder writable, or name another one with --runs.",
        ) from error
    if seal.sha256 != file.sha256:
        raise ChangedRunError(
            "is not the copy of this calibration",
            where=str(path),
            value=seal.sha256,
            limit=file.sha256,
            remedy="Move it away: the next run keeps it anew.",
        )
    return path.relative_to(folder).as_posix()
