"""What a result may claim after its recording has passed the table of checks."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import replace

from experiments.contract import Evidence, Experiment
from experiments.evidence.table import checks_of
from experiments.recording import Recording
from experiments.result import Check, Result, Verdict


def checked_analysis(experiment: Experiment) -> Callable[[Recording, Evidence], Result]:
    """The analysis of a protocol after the checks, with their outcome in its result."""
    analyse = experiment.analyse

    @functools.wraps(analyse)
    def checked(recording: Recording, evidence: Evidence) -> Result:
        evidence = checks_of(recording, experiment, evidence)
        return concluded(analyse(recording, evidence), evidence.checks)

    return checked


def concluded(result: Result, checks: tuple[Check, ...]) -> Result:
    """A result with the checks of its recording, its covariance whole, and no PASS without evidence."""
    covariance = result.covariance
    return replace(
        result,
        checks=checks,
        warnings=(*result.warnings, *(c.words for c in checks if c.outcome == "widened")),
        verdicts=tuple(_with_evidence(verdict, checks) for verdict in result.verdicts),
        covariance=covariance and covariance.with_shared(result.estimates),
    )


def _with_evidence(verdict: Verdict, checks: tuple[Check, ...]) -> Verdict:
    """The verdict; NOT JUDGED where a check that a verdict needs could not be made."""
    missing = [c.name for c in checks if c.is_evidence and c.outcome == "not checked"]
    if not missing or verdict.outcome == "NOT JUDGED":
        return verdict
    return replace(verdict, outcome="NOT JUDGED", because=f"not checked: {', '.join(missing)}")
