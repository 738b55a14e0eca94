"""One line of the checklist."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

Verdict = Literal["ok", "warning", "failed", "skipped"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """What was looked at, how it came out, the evidence, the number behind it where there is one, and what to do.

    "skipped" is what could not or was not to be looked at, and says why.
    """

    group: str
    name: str
    result: Verdict
    evidence: str
    value: float | None = None
    unit: str = ""
    limit: str = ""
    remedy: str = ""

    def as_json(self) -> dict[str, Any]:
        """As `rig doctor --json` prints it."""
        return asdict(self)


def judged(
    group: str,
    name: str,
    fine: bool,
    evidence: str,
    *,
    value: float | None = None,
    unit: str = "",
    limit: str = "",
    remedy: str = "",
    otherwise: Verdict = "failed",
) -> Finding:
    """A finding that is ok or not: the remedy stays only where it is needed."""
    return Finding(
        group=group,
        name=name,
        result="ok" if fine else otherwise,
        evidence=evidence,
        value=value,
        unit=unit,
        limit=limit,
        remedy="" if fine else remedy,
    )
