"""Many run files read for a list: by several processes where there are many, because the HDF5 library reads one
file at a time in a process.

A helper is this module run as a program: it is given paths on its standard input, one JSON text per
line, and answers each with one line. What a helper does not answer, its caller reads itself.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import queue
import subprocess
import sys
import threading
from collections.abc import Generator, Sequence
from pathlib import Path
from typing import Any

from rig.errors import RigError

_WORTH_A_HELPER = 250
"""Files per process from which on it gains more than its start costs (half a second)."""
_MOST_HELPERS = 4
"""Processes: more than these wait for the disk."""

_ReadFile = tuple[int, dict[str, Any], str]
"""Place of a file among those that were asked for, what it says of itself by name, and why it cannot be read."""


def read_one(path: Path) -> tuple[dict[str, Any], str]:
    """What a run file says of itself; of one that cannot be read nothing, and the reason."""
    from rig.runfile.listing import read_listing

    try:
        return dataclasses.asdict(read_listing(path)), ""
    except RigError as error:
        return {}, str(error)


def read_many(
    paths: Sequence[Path], processes: int | None = None
) -> Generator[_ReadFile, None, None]:
    """What each of these files says, as it is read, in no order. To close the iterator ends the reading."""
    if processes is None:
        processes = min(_MOST_HELPERS, os.cpu_count() or 1, len(paths) // _WORTH_A_HELPER)
    waiting = set(range(len(paths)))
    if processes > 1:
        with contextlib.closing(_by_helpers(paths, processes)) as answers:
            for answer in answers:
                waiting.discard(answer[0])
                yield answer
    for place in sorted(waiting):
        yield place, *read_one(paths[place])


def _by_helpers(paths: Sequence[Path], processes: int) -> Generator[_ReadFile, None, None]:
    answers: queue.Queue[_ReadFile | None] = queue.Queue()
    helpers: list[subprocess.Popen[str]] = []
    try:
        for first in range(processes):
            share = [(place, paths[place]) for place in range(first, len(paths), processes)]
            helper = _helper()
            if helper is None:
                break
            helpers.append(helper)
            for work in (_ask, _listen):
                threading.Thread(target=work, args=(helper, share, answers), daemon=True).start()
        silent = 0
        while silent < len(helpers):
            answer = answers.get()
            if answer is None:
                silent += 1
            else:
                yield answer
    finally:
        for helper in helpers:
            helper.kill()
            helper.wait()


def _helper() -> subprocess.Popen[str] | None:
    """A process that reads run files; None where none can be started."""
    try:
        return subprocess.Popen(
            [sys.executable, "-m", "rig.library.reading"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            encoding="utf-8",
            env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
        )
    except OSError:
        return None


def _ask(helper: subprocess.Popen[str], share: list[tuple[int, Path]], _: object) -> None:
    assert helper.stdin is not None
    with contextlib.suppress(OSError, ValueError), helper.stdin as stream:
        for place, path in share:
            stream.write(json.dumps([place, os.fspath(path)]) + "\n")


def _listen(
    helper: subprocess.Popen[str],
    share: list[tuple[int, Path]],
    answers: queue.Queue[_ReadFile | None],
) -> None:
    assert helper.stdout is not None
    asked = {place for place, _ in share}
    # A helper that dies, or says something else, is not believed any further.
    with contextlib.suppress(OSError, ValueError, TypeError), helper.stdout as stream:
        for line in stream:
            place, said, problem = json.loads(line)
            if place in asked:
                answers.put((place, said, problem))
    answers.put(None)


def _serve() -> None:
    """Answer the lines of standard input until it ends."""
    for line in sys.stdin:
        place, path = json.loads(line)
        sys.stdout.write(json.dumps([place, *read_one(Path(path))]) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    _serve()
