"""Every protocol from plan to sealed file on the simulated rig, and what comes of it: each ends
safe and is readable.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from experiments import catalogue
from experiments.finding import Severity
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig.bench.backends.order import Order
from rig.run.start import run_order
from rig.runfile.read import open_run
from rig.runfile.verify import verify_run
from tests.rig.fitting import fit_files

SHORT: dict[str, dict[str, Any]] = {
    "friction": {"points": 6, "highest_rpm": 1200.0, "lowest_rpm": 5.0, "up_and_down": False},
    "motor-tare": {"points": 6, "lowest_rpm": 5.0, "highest_rpm": 1200.0},
    "kinematic-error": {"speed_rpm": 118.3},
    "compensated-error": {"speeds_rpm": (247.2, 494.4, 988.8)},
    "velocity-steps": {"speeds_rpm": (300.0, 1200.0)},
}


@pytest.mark.parametrize("protocol", catalogue.names())
def test_a_protocol_ends_safe_and_leaves_a_good_file(protocol: str, tmp_path: Path) -> None:
    values = SHORT.get(protocol, {})
    request = Order(
        protocol=protocol,
        gear=shipped_gear(),
        motor=shipped_motor(),
        folder=tmp_path,
        values=values,
        serial="A1",
        operator="test",
        seed=5,
    )
    report = run_order(request)
    assert report.outcome == "COMPLETED"
    assert report.safe
    recording = open_run(report.path)
    assert recording.rows > 1000
    assert recording.metadata.origin == "simulated"
    assert {"torque-zero-before", "torque-zero-after"} <= {s.label for s in recording.segments}
    assert not recording.flags().any()
    assert [f for f in verify_run(report.path) if f.severity is Severity.BLOCKS] == []
    (fit,) = fit_files([report.path])
    assert fit.result.kind == protocol
    assert fit.result.as_json()["parameters"] or fit.result.metrics
