"""The checklist tells what is wrong: every wrong is put into a rig on the wire, and the line that names it must fail."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from drivers.channel import Calibration
from drivers.clock import VirtualClock
from drivers.cyclic import CanRigConfig
from drivers.port import DriveLimits
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig import main
from rig.backends import Bench, BenchRequest, make_port
from rig.backends.simulated import wire_config, wire_port
from rig.doctor.examine import Examination, examine
from rig.doctor.finding import Finding
from rig.run.start import RunRequest
from sim_backend.wire.bench import WireBench

START_NS = 1_790_000_000_000_000_000
RATE = 250.0
Change = Callable[[CanRigConfig], CanRigConfig]


def request(folder: Path, **changes: object) -> RunRequest:
    made = RunRequest("doctor", shipped_gear(), shipped_motor(), folder, sample_rate=RATE, backend="wire")
    return replace(made, **changes)  # type: ignore[arg-type]


def on_the_wire(change: Change = lambda c: c) -> Bench:
    motor = shipped_motor()
    bench = WireBench(shipped_gear(), motor, seed=4, cycle_ns=round(1e9 / RATE), clock=VirtualClock(START_NS))
    return Bench("wire", wire_port(bench, motor, change(wire_config(bench, motor))), bench.clock)


def look(folder: Path, make: Callable[[], Bench], moves: bool = False, **changes: object) -> Examination:
    return examine(make, request(folder, **changes), moves=moves, why_not="not asked to")


def line(found: Examination, group: str, name: str) -> Finding:
    return next(f for f in found.findings if f.group.startswith(group) and f.name == name)


def test_a_rig_that_is_fine_is_fine(tmp_path: Path) -> None:
    found = look(tmp_path, on_the_wire, moves=True)
    assert found.is_fine, [f for f in found.findings if f.result == "failed"]
    assert line(found, "node 1", "identity").evidence.startswith("Simulated servo amplifier, profile 402")
    heartbeat = line(found, "node 2", "heartbeat")
    assert heartbeat.value == pytest.approx(100.0, abs=25.0)
    ratio = line(found, "motion", "ratio")
    assert ratio.value == pytest.approx(120.0, abs=0.02)
    assert line(found, "motion", "output direction").result == "ok"
    # Nothing of the motion is kept where the runs go.
    assert not list(tmp_path.iterdir())


def test_what_is_not_looked_at_says_why(tmp_path: Path) -> None:
    found = look(tmp_path, on_the_wire)
    skipped = line(found, "motion", "direction and ratio")
    assert (skipped.result, skipped.evidence) == ("skipped", "not asked to")


def test_the_direct_rig_has_no_bus_and_is_examined_all_the_same(tmp_path: Path) -> None:
    wanted = BenchRequest(shipped_gear(), shipped_motor(), sample_rate=RATE)
    found = look(tmp_path, lambda: make_port("sim", wanted))
    assert line(found, "nodes", "bus").result == "skipped"
    assert line(found, "torque", "zero").result == "ok"


def counter(config: CanRigConfig, **changes: object) -> CanRigConfig:
    return replace(config, counters=(replace(config.counters[0], **changes),))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("change", "failed"),
    [
        (lambda c: counter(c, direction=-1), "output direction"),
        (lambda c: replace(c, motor_encoder=replace(c.motor_encoder, direction=-1)), "output direction"),
        (lambda c: counter(c, lines=17000), "ratio"),
        (lambda c: counter(c, multiplication=2), "ratio"),
    ],
)
def test_a_wrong_encoder_is_found_by_moving(tmp_path: Path, change: Change, failed: str) -> None:
    found = look(tmp_path, lambda: on_the_wire(change), moves=True)
    assert line(found, "motion", failed).result == "failed"
    assert not found.is_fine
    # However wrong the encoders are, the rig stands in the end, and that was verified.
    assert "standstill verified" in line(found, "motion", "run").evidence


def test_the_ratio_of_the_other_mounting_is_recognised(tmp_path: Path) -> None:
    def mounted() -> Bench:
        motor = shipped_motor()
        bench = WireBench(
            shipped_gear(), motor, seed=4, cycle_ns=round(1e9 / RATE), clock=VirtualClock(START_NS), mounting="flexspline-fixed"
        )
        return Bench("wire", wire_port(bench, motor, counter(wire_config(bench, motor), direction=-1)), bench.clock)

    found = look(tmp_path, mounted, moves=True)
    ratio = line(found, "motion", "ratio")
    assert ratio.result == "failed"
    assert ratio.value == pytest.approx(121.0, abs=0.3)
    assert "121 is the ratio of the other mounting" in ratio.remedy


def test_a_node_that_says_nothing_fails_the_connection(tmp_path: Path) -> None:
    found = look(tmp_path, lambda: on_the_wire(lambda c: counter(c, node_id=9)))
    connection = line(found, "rig", "connection")
    assert connection.result == "failed"
    assert "9" in connection.evidence


def test_a_torque_zero_that_is_off_fails(tmp_path: Path) -> None:
    def off(config: CanRigConfig) -> CanRigConfig:
        module = config.modules[0]
        inputs = (replace(module.inputs[0], zero_volts=0.4), *module.inputs[1:])
        return replace(config, modules=(replace(module, inputs=inputs),))

    found = look(tmp_path, lambda: on_the_wire(off))
    zero = line(found, "torque", "zero")
    assert zero.result == "failed"
    assert zero.value == pytest.approx(-0.4 * 0.637, abs=0.02)
    assert line(found, "torque", "cross-check").result == "failed"


def test_a_calibration_that_is_overdue_fails(tmp_path: Path) -> None:
    old = Calibration("certificate 7", "2020-01-01", "2021-01-01")
    found = look(tmp_path, lambda: on_the_wire(lambda c: counter(c, calibration=old)))
    assert "overdue" in line(found, "calibration", "output angle").evidence
    assert not found.is_fine


def test_a_limit_that_reads_back_differently_fails_and_keeps_it_still(tmp_path: Path) -> None:
    def stubborn() -> Bench:
        bench = on_the_wire()
        write = bench.port.write_limits

        def half(limits: DriveLimits) -> DriveLimits:
            return dataclasses.replace(write(limits), torque=0.5 * limits.torque)

        bench.port.write_limits = half  # type: ignore[method-assign]
        return bench

    found = look(tmp_path, stubborn, moves=True)
    assert line(found, "safety", "drive limits").result == "failed"
    assert line(found, "motion", "direction and ratio").result == "skipped"


def test_the_command_prints_one_object_and_its_code_means_something(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as ended:
        main.run(["doctor", "--no-move", "--json"])
    found = json.loads(capsys.readouterr().out)
    assert ended.value.code == (0 if found["ok"] else 6)
    assert set(found["checks"][0]) == {"group", "name", "result", "evidence", "value", "unit", "limit", "remedy"}


def test_motion_on_hardware_is_armed_as_a_run_is(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from importlib import resources

    config = tmp_path / "rig.toml"
    config.write_text(resources.files("rig.config").joinpath("template.toml").read_text(encoding="utf-8"), encoding="utf-8")
    with pytest.raises(SystemExit) as refused:
        main.run(["doctor", "--backend", "hardware", "--config", str(config), "--move", "--gear", "A", "--operator", "B"])
    assert refused.value.code == 2
    assert "--confirm" in capsys.readouterr().err
