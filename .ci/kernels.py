"""Compiles what the tests run, once, before two of them would each compile it for themselves: a short demonstration."""

from __future__ import annotations

import sys
from pathlib import Path

from rig.gears.card import now_text
from rig.trial.demo.chain import DemoOrder, demonstrate

SHORT = {
    "motor-tare": {"lowest_rpm": 5.0, "points": 9, "measure_time": 0.3, "settle_time": 0.2},
    "kinematic-error": {"speed_rpm": 241.7},
    "friction": {"lowest_rpm": 5.0, "points": 10, "measure_time": 0.3, "settle_time": 0.2},
    "starting-torque": {"positions": 3},
    "velocity-steps": {"speeds_rpm": (600.0, 1800.0), "repeats": 1},
}

if __name__ == "__main__":
    demonstrate(DemoOrder(Path(sys.argv[1]), 3, now_text, SHORT))
