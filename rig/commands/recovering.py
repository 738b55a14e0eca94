"""What `rig recover` does with several files, and how it tells what became of each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rig import exits
from rig.content.phrase import phrase
from rig.errors import RigError
from rig.library.folder import run_tree
from rig.library.writer_alive import is_being_written
from rig.runfile.layout import PART_SUFFIX
from rig.runfile.recover import Recovered, recover_run


@dataclass(frozen=True)
class Outcome:
    """What became of one `.part` file: a run, an error that leaves it as it is, or neither while it is written."""

    part: Path
    recovered: Recovered | None = None
    error: RigError | None = None


def recover_all(named: Sequence[Path]) -> list[Outcome]:
    """Recover every file that is named or lies in a folder that is. A file that cannot be recovered stops no other.

    Raises the `RigError` of a single file that was named by itself, and that of a folder that cannot be looked into.
    """
    if len(named) == 1 and not named[0].is_dir():
        return [Outcome(named[0], recover_run(named[0]))]
    return [_outcome(part, is_named) for part, is_named in _parts(named)]


def _parts(named: Sequence[Path]) -> Iterator[tuple[Path, bool]]:
    """The files that are meant, and whether each was named by itself."""
    for path in named:
        if not path.is_dir():
            yield path, True
            continue
        for inside in sorted(name for name, _ in run_tree(path)[0] if name.endswith(PART_SUFFIX)):
            yield path / inside, False


def _outcome(part: Path, is_named: bool) -> Outcome:
    if not is_named and is_being_written(part):
        return Outcome(part)
    try:
        return Outcome(part, recover_run(part))
    except RigError as error:
        return Outcome(part, error=error)


def words_of(outcome: Outcome) -> Iterator[str]:
    """What became of a file, in lines for people."""
    run = outcome.recovered
    if outcome.error is not None:
        yield f"{outcome.part} was left as it is: {outcome.error}"
    elif run is None:
        yield f"{outcome.part} is still being written: left alone"
    elif run.is_removed:
        yield f"{run.path} was taken away:"
    else:
        unread = phrase(", {} could not be read", run.unread)
        yield f"{run.rows} rows recovered into {run.path}{unread}, outcome {run.outcome or '-'}"
    if run is None:
        return
    for note in run.notes:
        yield f"  {note}"
    if run.kept is not None:
        yield f"  what was recorded stays as {run.kept}, byte for byte: delete it when the run has what you need"


def as_json(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """The object that `rig recover --json` prints."""
    return {
        "recovered": [_run_as_json(o.recovered) for o in outcomes if o.recovered is not None],
        "refused": [
            {"part": str(o.part), **exits.error_object(o.error, str(o.error))}
            for o in outcomes
            if o.error is not None
        ],
        "being_written": [str(o.part) for o in outcomes if o.recovered is None and o.error is None],
    }


def _run_as_json(run: Recovered) -> dict[str, Any]:
    return {
        "run": str(run.path),
        "rows": run.rows,
        "rows_unread": run.unread,
        "bytes_beyond_last_flush": run.beyond,
        "outcome": run.outcome,
        "notes": run.notes,
        "kept": run.kept,
        "removed": run.is_removed,
    }
