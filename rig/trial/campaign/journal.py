"""The journal of a campaign: what was begun, done, found out of date and finished. Appended, never edited.

`<folder of runs>/.campaigns/<gear>-<campaign>-<number>.jsonl`, one JSON object a line, written to the
disk before the next stage begins. A last line that a power cut left unfinished is not counted.

Each line holds the hash of the line before (`rig.runfile.chained_lines`). Journals of format 1 (version 0.2.0) hold
no hashes.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rig.errors import RunFileError
from rig.runfile.chained_lines import BEFORE, Chain
from rig.trial.campaign.plan import CampaignPlan

FOLDER = ".campaigns"
"""Lies in the folder of runs."""
FORMAT = "harmonic-rig-campaign-2"
FORMAT_1 = "harmonic-rig-campaign-1"
_CHAIN = Chain(
    "the journal of a campaign",
    "Take the original, or the backup; or begin the campaign anew with --anew: its runs stay what they are.",
    "Make the folder writable, or name another one with --runs.",
)
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
        return _number(self.path)

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
        _CHAIN.append(self.path, {"what": "stage", **row})
        return replace(self, stages=(*self.stages, stage))

    def with_outdated(self, index: int, because: str, at: str) -> Journal:
        """The journal in which the newest run of a stage does not count any more."""
        newest = self.newest(index)
        if newest is None or newest.outdated:
            return self
        _CHAIN.append(self.path, {"what": "outdated", "index": index, "because": because, "at": at})
        return _with_outdated(self, newest, because)

    def with_end(
        self, verdict: str, certificate: str, at: str, rests_on: Mapping[str, Any] | None = None
    ) -> Journal:
        """The journal of a campaign that came to its end; `rests_on` names files with the hashes that they had."""
        ended = {"verdict": verdict, "certificate": certificate, "at": at, **(rests_on or {})}
        _CHAIN.append(self.path, {"what": "ended", **ended})
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
        raise _CHAIN.not_written(place, error) from None
    _CHAIN.append(path, {"what": "begun", **begun})
    return Journal(path, begun)


def unfinished(folder: Path, plan: CampaignPlan, serial: str) -> Journal | None:
    """The newest campaign of this name and gear in a folder, if it did not come to its end."""
    paths = sorted((folder / FOLDER).glob(f"{_stem(serial, plan.name)}-*.jsonl"), key=_number)
    return next((one for one in map(read, paths[-1:]) if one and one.ended is None), None)


def read(path: Path) -> Journal | None:
    """The journal in a file; None for one in which nothing was begun.

    Raises `RunFileError` for one that is none, `ChangedRunError` for one whose lines are not those that were written.
    """
    rows = _CHAIN.read(path, lambda first: first.get("format") != FORMAT_1)
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
        return _with_outdated(journal, journal.newest(int(row["index"])), str(row["because"]))
    if what == "ended":
        return replace(journal, ended=_without_frame(row))
    return journal


def _stem(serial: str, campaign: str) -> str:
    return f"{_in_name(serial)}-{_in_name(campaign)}"


def _in_name(text: str) -> str:
    return _NOT_IN_NAMES.sub("_", text.strip())[:60].strip("._") or "unknown"


def _with_outdated(journal: Journal, stage: DoneStage | None, because: str) -> Journal:
    """The journal in which this run of a stage does not count any more."""
    stages = (replace(one, outdated=because) if one is stage else one for one in journal.stages)
    return replace(journal, stages=tuple(stages))


def _number(path: Path) -> int:
    match = _NUMBER.search(path.name)
    return int(match[1]) if match else 0
