"""The error root of this floor. A message says what, where, value, limit, and what to do next."""

from __future__ import annotations

from model.errors import WordedError


class ExperimentError(WordedError, ValueError):
    """A protocol that cannot be planned or whose recording cannot be analysed."""


class PlanError(ExperimentError):
    """Parameters that are impossible, or a plan that would break a limit."""


class AnalysisError(ExperimentError):
    """A recording that lacks what the analysis needs, or whose data cannot carry it."""
