"""The journal of a campaign: what was begun, done, found out of date and finished. Appended, never edited.

`<folder of runs>/.campaigns/<gear>-<campaign>-<number>.jsonl`, one JSON object a line, written to the
disk before the next stage begins. A last line that a power cut left unfinished is not counted.

A journal grows, so it has no note beside it: each line holds under `before` the SHA-256 of the line
before, and a line that was changed, taken out or put in is found when it is read. Whole lines taken
away at its end are not: nothing after them tells. Journals of format 1 (version 0.2.0) hold no hashes.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rig.errors import ChangedRunError, RunFileError
from rig.trial.campaign.plan import CampaignPlan

FOLDER = ".campaigns"
"""Lies in the folder of runs."""
FORMAT = "harmonic-rig-campaign-2"
FORMAT_1 = "harmonic-rig-campaign-1"
BEFORE = "before"
"""The key under which a line holds the SHA-256 of the line before, "" in the first one."""
_NOT_IN_NAMES = re.compile(r"[^A-Za-z0-9._]+")
_NUMBER = re.compile(r"-(\d{3,})\.jsonl\Z")


@dataclass(frozen=True, kw_only=True)
class DoneStage:
    """One stage that was run: the file and how it ended. `outdated` says why it does not count any more."""

    index: int
    protocol: str
    run: str
    outcome: str
    message: str = ""
    at: str = ""
    outdated: str = ""
    sha256: str = ""
    """Of the run file as it was sealed; "" where it was not noted."""

    @property
    def counts(self) -> bool:
        """Whether it need not be done again."""
        return self.outcome == "COMPLETED" and not self.outdated


@dataclass(frozen=True)
class Journal:
    """One campaign of one gear, as its file tells it."""

    path: Path
    begun: Mapping[str, Any]
    stages: tuple[DoneStage, ...] = ()
    """Every run of it, the newest of a stage last."""
    ended: Mapping[str, Any] | None = None

    @property
    def is_chained(self) -> bool:
        """Whether each of its lines holds the hash of the line before."""
        return self.begun.get("format") == FORMAT

    @property
    def number(self) -> int:
        """Its number among the campaigns of this gear and name."""
        match = _NUMBER.search(self.path.name)
        return int(match[1]) if match else 0

    def newest(self, index: int) -> DoneStage | None:
        """The last run of a stage."""
        return next((done for done in reversed(self.stages) if done.index == index), None)

    def counts(self, index: int) -> bool:
        """Whether a stage is done and need not be done again."""
        done = self.newest(index)
        return done is not None and done.counts

    def with_stage(self, stage: DoneStage) -> Journal:
        """The journal with one more run, on the disk as well."""
        row = {key: value for key, value in vars(stage).items() if key != "outdated"}
        _append(self.path, {"what": "stage", **row})
        return replace(self, stages=(*self.stages, stage))

    def with_outdated(self, index: int, because: str, at: str) -> Journal:
        """The journal in which the newest run of a stage does not count any more."""
        newest = self.newest(index)
        if newest is None or newest.outdated:
            return self
        _append(self.path, {"what": "outdated", "index": index, "because": because, "at": at})
        stages = tuple(
            replace(one, outdated=because) if one is newest else one for one in self.stages
        )
        return replace(self, stages=stages)

    def with_end(
        self, verdict: str, certificate: str, at: str, rests_on: Mapping[str, Any] | None = None
    ) -> Journal:
        """The journal of a campaign that came to its end; `rests_on` names files with the hashes that they had."""
        ended = {"verdict": verdict, "certificate": certificate, "at": at, **(rests_on or {})}
        _append(self.path, {"what": "ended", **ended})
        return replace(self, ended=ended)


def begin(
    folder: Path, plan: CampaignPlan, serial: str, facts: Mapping[str, Any], at: str
) -> Journal:
    """A new journal under the next free number. Raises `RunFileError` where it cannot be written."""
    begun = {
        "format": FORMAT,
        "campaign": plan.name,
        "plan": plan.path,
        "plan_sha256": plan.sha256,
        "protocols": [stage.protocol for stage in plan.stages],
        "gear": serial,
        "at": at,
        **facts,
    }
    place = folder / FOLDER
    try:
        place.mkdir(parents=True, exist_ok=True)
        number = max((_number(path) for path in place.glob("*.jsonl")), default=0) + 1
        while True:
            path = place / f"{_stem(serial, plan.name)}-{number:03d}.jsonl"
            try:
                path.open("x").close()
                break
            except FileExistsError:
                number += 1
    except OSError as error:
        raise _not_written(place, error) from None
    _append(path, {"what": "begun", **begun})
    return Journal(path, begun)


def unfinished(folder: Path, plan: CampaignPlan, serial: str) -> Journal | None:
    """The newest campaign of this name and gear in a folder, if it did not come to its end."""
    paths = sorted((folder / FOLDER).glob(f"{_stem(serial, plan.name)}-*.jsonl"), key=_number)
    journal = read(paths[-1]) if paths else None
    return journal if journal is not None and journal.ended is None else None


def read(path: Path) -> Journal | None:
    """The journal in a file; None for one in which nothing was begun.

    Raises `RunFileError` for one that is none, `ChangedRunError` for one whose lines are not those that were written.
    """
    rows = _rows(path)
    if not rows:
        return None
    first = rows[0]
    if first.get("what") != "begun" or first.get("format") not in (FORMAT, FORMAT_1):
        raise RunFileError("is no journal of a campaign", where=str(path), limit=f"format {FORMAT}")
    journal = Journal(path, _without_frame(first))
    for row in rows[1:]:
        journal = _taken_in(journal, row)
    return journal


def _without_frame(row: Mapping[str, Any]) -> dict[str, Any]:
    """What a line says, without what it is and the hash of the line before."""
    return {key: value for key, value in row.items() if key not in ("what", BEFORE)}


def _taken_in(journal: Journal, row: Mapping[str, Any]) -> Journal:
    what = row.get("what")
    if what == "stage":
        stage = DoneStage(
            index=int(row["index"]),
            protocol=str(row["protocol"]),
            run=str(row["run"]),
            outcome=str(row["outcome"]),
            message=str(row.get("message", "")),
            at=str(row.get("at", "")),
            sha256=str(row.get("sha256", "")),
        )
        return replace(journal, stages=(*journal.stages, stage))
    if what == "outdated":
        newest = journal.newest(int(row["index"]))
        stages = tuple(
            replace(one, outdated=str(row["because"])) if one is newest else one
            for one in journal.stages
        )
        return replace(journal, stages=stages)
    if what == "ended":
        return replace(journal, ended=_without_frame(row))
    return journal


def _rows(path: Path) -> list[dict[str, Any]]:
    try:
        lines = path.read_bytes().split(b"\n")
    except OSError as error:
        raise RunFileError(
            "the journal of a campaign cannot be read", where=str(path), value=str(error)
        ) from None
    rows: list[dict[str, Any]] = []
    # What stands behind the last newline was being written when the power went.
    for number, line in enumerate(lines[:-1], 1):
        try:
            row = json.loads(line)
        except ValueError:
            row = None
        if not isinstance(row, dict):
            raise RunFileError(
                "the journal of a campaign is damaged",
                where=f"{path}: line {number}",
                remedy="Move the file away and begin the campaign anew; its runs stay what they are.",
            )
        if rows and rows[0].get("format") != FORMAT_1:
            _check_line(path, number, row, lines[number - 2])
        rows.append(row)
    return rows


def _check_line(path: Path, number: int, row: Mapping[str, Any], before: bytes) -> None:
    """Refuse a line that does not follow upon the one before it."""
    digest = hashlib.sha256(before).hexdigest()
    if row.get(BEFORE) != digest:
        raise ChangedRunError(
            "the journal of a campaign was changed since it was written",
            where=f"{path}: line {number - 1}",
            value=f"SHA-256 {digest}",
            limit=f"{row.get(BEFORE) or 'none'} (as line {number} says)",
            remedy="Take the original, or the backup; or begin the campaign anew with --anew.",
        )


def _append(path: Path, row: Mapping[str, Any]) -> None:
    try:
        kept = path.read_bytes() if path.exists() else b""
        whole = kept[: kept.rfind(b"\n") + 1]
        lines = whole.split(b"\n")[:-1]
        before = hashlib.sha256(lines[-1]).hexdigest() if lines else ""
        with path.open("r+b" if path.exists() else "xb") as file:
            # A line that was cut off is taken away: the next one would be glued to it.
            file.truncate(len(whole))
            file.seek(len(whole))
            file.write(json.dumps({**row, BEFORE: before}, ensure_ascii=False).encode() + b"\n")
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise _not_written(path, error) from None


def _not_written(path: Path, error: OSError) -> RunFileError:
    return RunFileError(
        "the journal of a campaign cannot be written",
        where=str(path),
        value=error.strerror or str(error),
        remedy="Make the folder writable, or name another one with --runs.",
    )


def _stem(serial: str, campaign: str) -> str:
    return f"{_in_name(serial)}-{_in_name(campaign)}"


def _in_name(text: str) -> str:
    return _NOT_IN_NAMES.sub("_", text.strip())[:60].strip("._") or "unknown"


def _number(path: Path) -> int:
    match = _NUMBER.search(path.name)
    return int(match[1]) if match else 0
