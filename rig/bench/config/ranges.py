"""Ranges of values in `rig.toml` that other rooms hold to as well, known without what reads the file."""

from __future__ import annotations

ALARM_RANGES = {"false_alarms": (0.002, 0.5), "over": (5, 200), "baseline": (4, 100)}
"""What thresholds of alarms are drawn for: rarer alarms need more series than a minute allows."""
