"""What `rig doctor --json` said, as items of the checklist."""

from __future__ import annotations

from typing import Any

from rig.exits import ABORTED
from rig.run.preflight import Check

NAME = "rig doctor"
RESULTS = ("ok", "warning", "failed")
NOT_LOOKED_AT = "skipped"


def checks_from(answer: Any, code: int, complaint: str) -> tuple[Check, ...]:
    """The checks of a doctor's JSON object, without what it did not look at; one that says so where there is none."""
    rows = (
        next((v for v in answer.values() if _is_list_of_checks(v)), None)
        if isinstance(answer, dict)
        else None
    )
    if rows is not None:
        stopped = Check(NAME, "failed", "it was stopped before its end", "Ask the rig again.")
        return (stopped,) * (code == ABORTED) + tuple(
            Check(
                str(row["name"]),
                row["result"],
                str(row.get("evidence", "")),
                str(row.get("remedy", "")),
            )
            for row in rows
            if row["result"] in RESULTS
        )
    if "No such command" in complaint:
        return (
            Check(
                NAME,
                "warning",
                "this installation has no `rig doctor`: nobody asked the rig itself",
            ),
        )
    last = complaint.splitlines()[-1] if complaint else f"exit code {code}, nothing was said"
    return (Check(NAME, "failed", last, "Run `rig doctor` in a terminal."),)


def _is_list_of_checks(value: Any) -> bool:
    return (
        isinstance(value, list)
        and bool(value)
        and all(
            isinstance(row, dict)
            and "name" in row
            and row.get("result") in (*RESULTS, NOT_LOOKED_AT)
            for row in value
        )
    )
