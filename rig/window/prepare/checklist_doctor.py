"""What `rig doctor --json` said, as items of the checklist."""

from __future__ import annotations

from typing import Any

from experiments.finding import Finding, Severity
from rig.exits import ABORTED

NAME = "rig doctor"


def checks_from(answer: Any, code: int, complaint: str) -> tuple[Finding, ...]:
    """The checks of a doctor's JSON object, without what it did not look at; one that says so where there is none."""
    rows = answer.get("checks") if isinstance(answer, dict) else None
    if rows:
        stopped = Finding(NAME, Severity.BLOCKS, "it was stopped before its end", "Ask it again.")
        findings = [
            Finding(row["what"], Severity(row["severity"]), row["found"], row["remedy"])
            for row in rows
        ]
        looked_at = (one for one in findings if one.severity is not Severity.NOT_LOOKED_AT)
        return (stopped,) * (code == ABORTED) + tuple(looked_at)
    if "No such command" in complaint:
        text = "this installation has no `rig doctor`: nobody asked the rig itself"
        return (Finding(NAME, Severity.WARNS, text),)
    last = complaint.splitlines()[-1] if complaint else f"exit code {code}, nothing was said"
    return (Finding(NAME, Severity.BLOCKS, last, "Run `rig doctor` in a terminal."),)
