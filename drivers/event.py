"""Something that a device or a line told."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Level = Literal["info", "warning", "error"]


@dataclass(frozen=True)
class Event:
    """Something worth a line in the run file: time [ns, base of the samples], level, code, source, text."""

    time_ns: int
    level: Level
    code: str
    source: str
    text: str
