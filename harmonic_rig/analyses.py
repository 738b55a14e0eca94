"""What an analysis of another package computes with: recording, evidence, result, estimates."""

from experiments.contract import Evidence
from experiments.errors import AnalysisError, analysing
from experiments.evidence import check_recording, check_settings, require_time_base, usable
from experiments.recording import Recording, Segment
from experiments.recordings.channels import chosen_channel
from experiments.result import Panel, Plot, Result, Series, Table
from model.identify.estimate import BudgetLine, Estimate
from model.identify.least_squares import LinearFit, solve, student_quantile

__all__ = [
    "AnalysisError",
    "BudgetLine",
    "Estimate",
    "Evidence",
    "LinearFit",
    "Panel",
    "Plot",
    "Recording",
    "Result",
    "Segment",
    "Series",
    "Table",
    "analysing",
    "check_recording",
    "check_settings",
    "chosen_channel",
    "require_time_base",
    "solve",
    "student_quantile",
    "usable",
]
