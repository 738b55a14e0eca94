"""The table of checks: what a recording must be before anything is computed from it.

Every analysis passes it first, from one place (`experiments.catalogue.load`). A row of the table
looks at the recording and says what it found and what is allowed.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

from experiments.contract import Evidence, Experiment
from experiments.errors import AnalysisError
from experiments.recording import Recording
from experiments.result import Check

Look = Callable[[Recording, Experiment, Evidence], Check]
"""One row of the table: what it finds of a recording that is to be analysed as this kind."""

TABLE: tuple[Look, ...] = ()


def checks_of(recording: Recording, experiment: Experiment, evidence: Evidence) -> Evidence:
    """The evidence with what the table of checks found of the recording; `AnalysisError` names a check that refuses."""
    checks: list[Check] = []
    for look in TABLE:
        check = look(recording, experiment, evidence)
        if check.outcome == "refused":
            raise AnalysisError(
                f"{check.name}: {check.words}",
                where=recording.metadata.run_id,
                value=check.found,
                limit=check.allowed,
            )
        checks.append(check)
    return dataclasses.replace(evidence, checks=tuple(checks))
