"""The record of a commissioning as one sealed file: bench, devices, description, and every stage that counts.

The journal in the bench's state folder grows stage by stage, over days and over a program that two stages kill. What
it says when `rig commission` ends is sealed as analyses are, so that it can be kept, sent and verified elsewhere; it
holds the SHA-256 of the journal, so that lines taken away at the journal's end are missed.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from itertools import count
from pathlib import Path
from typing import Any

from experiments.finding import Severity
from rig.analysis.chain import Link, broken
from rig.bench.commissioning import (
    JOURNAL_NAME,
    NAMES,
    SEALED_PREFIX,
    StageDone,
    missing_stages,
    read_record,
)
from rig.bench.identity import Bench
from rig.content.phrase import phrase
from rig.errors import ChangedRunError, RigError, RunFileError
from rig.program import this_program
from rig.runfile.seal import file_sha256
from rig.runfile.sealed import read_sealed, write_sealed

FORMAT = "commissioning-1"
"""The value of `format` in a sealed record."""


def seal_record(bench: Bench, folder: Path, description: str, at: str) -> Path:
    """Write what the journal of a bench says now, sealed, under the next free name of the folder.

    Raises `RigError` where the journal cannot be read or the record not be written.
    """
    done, journal = read_record(bench.state), bench.state / JOURNAL_NAME
    content = _content(
        bench, description, at, done, hashlib.sha256(journal.read_bytes()).hexdigest()
    )
    data = (json.dumps(content, indent=1, ensure_ascii=False) + "\n").encode()
    for number in count(1):
        path = folder / f"{SEALED_PREFIX}{number:02d}.json"
        try:
            write_sealed(path, data)
        except FileExistsError:
            continue
        except OSError as error:
            raise RunFileError(
                "the record of the commissioning cannot be written",
                where=str(path),
                value=error.strerror or str(error),
                remedy="Make the folder of the runs writable and call `rig commission` again.",
            ) from None
        return path
    raise AssertionError


def _content(
    bench: Bench, description: str, at: str, done: Sequence[StageDone], journal: str
) -> dict[str, Any]:
    newest = {one.stage: one for one in done}
    devices = next((one.devices for one in reversed(done) if one.devices), {})
    missing = missing_stages(done, description, devices or None)
    return {
        "format": FORMAT,
        "bench": bench.id,
        "at": at,
        "description_sha256": description,
        "devices": devices,
        "complete": not missing,
        "missing": [vars(one) for one in missing],
        "stages": [asdict(newest[name]) for name in NAMES if name in newest],
        "journal_sha256": journal,
        "program": this_program().as_json(),
    }


def links_of_record(path: Path) -> Iterable[Link]:
    """The links of a sealed record: itself, and the run files that its stages name by their hash."""
    try:
        data, seal = read_sealed(path)
        content = _read(data, path)
    except RigError as error:
        yield broken("commissioning", path, error)
        return
    missing = ", ".join(one["stage"] for one in content["missing"])
    text = f"ok, bench {content['bench']}, {phrase('missing: {}', missing) or 'complete'}"
    yield Link("commissioning", Severity.PASSED, text, where=str(path), sha256=seal.sha256)
    for stage in content["stages"]:
        for name, sha256 in stage["runs"].items():
            yield from _link_of_run(path, path.with_name(name), sha256)


def _read(data: bytes, path: Path) -> dict[str, Any]:
    try:
        content = json.loads(data)
    except ValueError:
        content = None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise RunFileError(
            "is no record of a commissioning", where=str(path), limit=f"format {FORMAT}"
        )
    return content


def _link_of_run(record: Path, run: Path, sha256: str) -> Iterable[Link]:
    """A file of a stage that is gone, or is another; one that is as it was has nothing to tell."""
    if not run.is_file():
        words = f"is not here, though {record.name} names it"
        yield Link("commissioning", Severity.WARNS, words, where=str(run))
    elif file_sha256(run) != sha256:
        error = ChangedRunError(
            f"is not the one that {record.name} names", where=str(run), limit=f"SHA-256 {sha256}"
        )
        yield broken("commissioning", run, error)
