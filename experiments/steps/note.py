"""Steps that take no time: a question to the operator, and an event."""

from __future__ import annotations

from dataclasses import dataclass

from experiments.steps.kind import Instant


@dataclass(frozen=True)
class Prompt(Instant):
    """Ask the operator something before going on; the answer becomes an event.

    `consent` is the sentence that the operator has to give as it stands; without one, text is wanted.
    """

    text: str
    key: str = ""
    consent: str = ""


@dataclass(frozen=True)
class Mark(Instant):
    """Write an event into the run."""

    code: str
    text: str
