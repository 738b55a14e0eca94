"""The rigs by name: the direct one and the one on the wire agree, a recorded run comes back, and
nothing else exists.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from experiments.recording import Recording
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig.bench.backends.order import Order, Setup
from rig.bench.backends.registry import make_port
from rig.errors import ConfigurationError
from rig.run.start import run_order
from rig.runfile.read import open_run

SHORT = {
    "speeds_rpm": (900.0,),
    "repeats": 1,
    "measure_time": 0.2,
    "settle_time": 0.1,
    "zero_time": 0.5,
}


def recorded(backend: str, folder: Path) -> Recording:
    request = Order(
        protocol="motor-tare",
        gear=shipped_gear(),
        motor=shipped_motor(),
        folder=folder,
        values=SHORT,
        backend=backend,
        serial="A1",
        seed=3,
    )
    report = run_order(request)
    assert report.outcome == "COMPLETED", report.message
    assert report.safe
    return open_run(report.path)


@pytest.fixture(scope="module")
def direct(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    return recorded("sim", tmp_path_factory.mktemp("sim"))


def assert_same(one: Recording, other: Recording) -> None:
    assert one.rows == other.rows
    assert one.signals.keys() == other.signals.keys()
    for name in one.signals:
        assert np.array_equal(one.stored(name), other.stored(name)), name
    assert one.segments == other.segments


@pytest.mark.parametrize("backend", ["wire", "wire-csp", "wire-box", "wire-analog"])
def test_the_instruments_of_the_wire_are_as_well_known(backend: str, tmp_path: Path) -> None:
    known = {}
    for name in ("sim", backend):
        order = Order(
            protocol="home",
            gear=shipped_gear(),
            motor=shipped_motor(),
            folder=tmp_path,
            backend=name,
        )
        port = make_port(order, Setup()).port
        port.open()
        known[name] = {one.name: one.calibration for one in port.channels}
        port.close()
    for name in ("input_angle", "output_angle", "torque", "housing_temperature"):
        assert known[backend][name] == known["sim"][name], name
    assert known["sim"]["output_angle"].accuracy


def test_a_protocol_over_the_wire_has_the_same_counts(direct: Recording, tmp_path: Path) -> None:
    assert_same(recorded("wire", tmp_path), direct)


def test_a_recorded_run_goes_through_the_engine_again(direct: Recording, tmp_path: Path) -> None:
    path = direct.source.path  # type: ignore[attr-defined]
    again = recorded(f"replay:{path}", tmp_path)
    assert_same(again, direct)
    assert again.metadata.origin == "replay"


def test_an_unknown_rig_is_refused_with_what_there_is() -> None:
    with pytest.raises(
        ConfigurationError,
        match=r"moon.*sim, wire, wire-box, wire-csp, wire-analog, hardware, replay",
    ):
        make_port(Order(protocol="", backend="moon"))
