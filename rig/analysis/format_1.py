"""Stored analyses of format 1 (program version 0.1.0) as format 2: the only place that reads sentences.

Format 1 had neither causes nor quantities nor a covariance. The cause of a line of a budget was told
by how its sentence began; its numbers are those that the first version of every analysis gives.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from model.identify.estimate import Cause

FORMAT = "harmonic-rig-analysis-1"
_ANALYSIS_VERSION = 1

_BEGINNINGS: Mapping[str, Cause] = {
    "torque scale": Cause.TORQUE_SCALE,
    "tare": Cause.TARE,
    "bearing no-load torque": Cause.BEARING_TORQUE,
    "output encoder": Cause.OUTPUT_ENCODER,
    "motor encoder": Cause.MOTOR_ENCODER,
    "encoder accuracy at this order": Cause.BOTH_ENCODERS,
}


def from_format_1(content: Mapping[str, Any]) -> dict[str, Any]:
    """The content of a stored analysis of format 1 with the keys of format 2; nothing of it is changed or lost."""
    result = dict(content.get("result", {}))
    parameters = result.get("parameters", {})
    result["parameters"] = {name: _with_causes(estimate) for name, estimate in parameters.items()}
    units = {name: estimate.get("unit", "1") for name, estimate in parameters.items()}
    units |= dict.fromkeys(result.get("metrics", {}), "")
    return {
        **content,
        "result": result,
        "analysis_version": _ANALYSIS_VERSION,
        "quantities": {
            name: {"title": name, "unit": unit, "definition": ""} for name, unit in units.items()
        },
        "covariance": None,
        "checks": [],
    }


def _with_causes(estimate: Mapping[str, Any]) -> dict[str, Any]:
    lines = [{**line, "cause": _cause_of(line)} for line in estimate.get("budget", ())]
    return {**estimate, "budget": lines}


def _cause_of(line: Mapping[str, Any]) -> Cause | None:
    """The cause that the words of a line stand for; scatter of the data (type A) has none."""
    if line.get("kind") != "B":
        return None
    source = str(line.get("source", ""))
    return next((cause for words, cause in _BEGINNINGS.items() if source.startswith(words)), None)
