"""The error root of this floor. A message says what, where, value, limit, and what to do next."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager

from model.errors import IdentificationError, WordedError


class ExperimentError(WordedError, ValueError):
    """A protocol that cannot be planned or whose recording cannot be analysed."""


class PlanError(ExperimentError):
    """Parameters that are impossible, or a plan that would break a limit."""


class ExtensionError(PlanError):
    """What another package brings and what cannot be used."""


class AnalysisError(ExperimentError):
    """A recording that lacks what the analysis needs, or whose data cannot carry it."""


@contextmanager
def analysing(run: str) -> Generator[None]:
    """Refusals of the identification as refusals of the analysis of this run, in the same words."""
    try:
        yield
    except IdentificationError as error:
        where = ": ".join(filter(None, (run, error.where)))
        raise AnalysisError(
            error.what, where=where, value=error.value, limit=error.limit, remedy=error.remedy
        ) from error


class SettingError(AnalysisError):
    """A setting of an analysis that there is not, or whose value it can't have."""
