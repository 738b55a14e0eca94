"""What is seen with the servo off: every wrong is put into a rig on the wire, and the line that names it must fail."""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any

import pytest

from drivers.channel import OUTPUT_ANGLE, Calibration, encoder_channel
from drivers.readout.nd287 import ReadoutConfig, open_port
from experiments.finding import Severity
from model.gear import Origin
from model.gear_file import shipped_gear
from rig.bench.backends.order import Order
from rig.bench.backends.registry import make_port
from rig.run.stop import StopRequest
from rig.trial.doctor import surroundings
from rig.trial.doctor.examine import examine
from sim_backend.faults import Fault
from sim_backend.wire import faults
from sim_backend.wire.bench import DRIVE_NODE
from tests.rig.trial.doctor_rigs import (
    RATE,
    Change,
    counter,
    failed,
    line,
    look,
    motor_encoder,
    on_the_wire,
    request,
    torque_input,
    wire_bench,
)


def test_what_a_rig_on_the_wire_tells_of_itself(tmp_path: Path) -> None:
    found = look(tmp_path, on_the_wire)
    assert found.is_fine, failed(found)
    assert line(found, "node 1", "identity").found.startswith(
        "Simulated servo amplifier, profile 402"
    )
    assert "software 1.0" in line(found, "node 3", "firmware").found
    assert line(found, "node 2", "heartbeat").value == pytest.approx(100.0, abs=25.0)
    # Every object that is missing is named, with what follows from it; nothing is cut off.
    objects = line(found, "node 1", "objects")
    assert objects.value == objects.found.count("0x")
    assert "counts per revolution must stand in the configuration" in objects.found
    assert line(found, "drive", "abort connection option").found == "3, quick stop"
    assert line(found, "drive", "watch over the computer").unit == "ms"
    assert line(found, "drive", "electronic gear").value == 1.0
    assert line(found, "acquisition", "rate").value == pytest.approx(RATE, rel=1e-3)
    skipped = line(found, "motion", "direction and ratio")
    assert (skipped.severity, skipped.found) == ("not looked at", "not asked to")


def test_the_direct_rig_has_no_bus_and_is_examined_all_the_same(tmp_path: Path) -> None:
    wanted = Order(protocol="", sample_rate=RATE)
    found = look(tmp_path, lambda: make_port(wanted))
    assert line(found, "nodes", "bus").severity == "not looked at"
    assert line(found, "torque", "zero").severity == "passed"


@pytest.mark.parametrize(
    ("fault", "group", "name", "words"),
    [
        (faults.NodeSilent(50, node_id=DRIVE_NODE), "node 1", "state", "lost"),
        (faults.NodeSilent(50), "node 2", "state", "lost"),
        (faults.HeartbeatLost(10), "node 1", "heartbeat", "1 heard"),
        (faults.NodeReset(120), "told by the devices", "boot-up", "node 2: the node has restarted"),
        (faults.EmergencyMessage(50), "told by the devices", "emcy", "0x4310"),
        (faults.DriveTrip(50), "drive", "state", "0x8611 following error"),
        (faults.TpdoLost(50), "acquisition", "cycles", "incomplete"),
        (faults.ClockJump(50), "acquisition", "clock", "1 of"),
        (faults.ReadsBackDifferently(0), "safety", "drive limits", "reads back differently"),
        (faults.SdoSilent(0, index=0x6041), "rig", "connection", "0x6041"),
        (faults.HubGone(50), "acquisition", "cycles", "gone"),
    ],
    ids=lambda value: type(value).__name__ if isinstance(value, Fault) else None,
)
def test_a_fault_is_found_and_keeps_the_rig_still(
    tmp_path: Path, fault: Fault, group: str, name: str, words: str
) -> None:
    found = look(tmp_path, lambda: on_the_wire(lambda c: c, fault), moves=True)
    finding = line(found, group, name)
    assert finding.severity == "blocks"
    assert words in finding.found
    assert not found.is_fine
    skipped = line(found, "motion", "direction and ratio")
    assert (skipped.severity, skipped.found) == (
        "not looked at",
        "not before the lines that failed are in order",
    )


@pytest.mark.parametrize(
    ("fault", "name", "words"),
    [
        (faults.SafeTorqueOff(20), "state", "no voltage at the power stage"),
        (faults.SdoAborted(0, index=0x6007), "abort connection option", "not there"),
        (faults.SdoAborted(0, index=0x1016), "watch over the computer", "does not notice"),
    ],
)
def test_what_is_left_to_judgement_is_a_warning(
    tmp_path: Path, fault: Fault, name: str, words: str
) -> None:
    finding = line(look(tmp_path, lambda: on_the_wire(lambda c: c, fault)), "drive", name)
    assert finding.severity == "warns"
    assert words in finding.found
    assert finding.remedy


@pytest.mark.parametrize(
    ("change", "group", "name", "result", "words"),
    [
        (
            lambda c: motor_encoder(c, lines=2048),
            "told by the devices",
            "counts-per-revolution",
            "blocks",
            "32768",
        ),
        (lambda c: torque_input(c, zero_volts=0.4), "torque", "zero", "blocks", "-24"),
        (lambda c: torque_input(c, zero_volts=0.06), "torque", "zero", "warns", "-3"),
    ],
)
def test_a_wrong_description_is_found(
    tmp_path: Path, change: Change, group: str, name: str, result: str, words: str
) -> None:
    found = look(tmp_path, lambda: on_the_wire(change))
    finding = line(found, group, name)
    assert finding.severity == result
    assert words in finding.found
    # Port and drive are compared too: 0.4 V are more than they may differ by, 0.06 V are not.
    assert line(found, "torque", "cross-check").severity == (
        "blocks" if words == "-24" else "passed"
    )


@pytest.mark.parametrize(
    ("due", "result", "words"),
    [
        ("2021-01-01", "blocks", "overdue"),
        ("2026-10-01", "warns", "in 10 days"),
        ("2027-01-01", "passed", "certificate 7"),
        ("next autumn", "warns", "next autumn"),
        ("", "passed", "no due date"),
    ],
)
def test_a_calibration_ends(due: str, result: str, words: str) -> None:
    channel = encoder_channel(
        OUTPUT_ANGLE,
        lines=18000,
        multiplication=4,
        calibration=Calibration(certificate="certificate 7", due=due),
    )
    (finding,) = surroundings.calibrations([channel], date(2026, 9, 21))
    assert finding.severity == result
    assert words in finding.found


def test_a_node_that_says_nothing_is_named_and_who_is_there_instead(tmp_path: Path) -> None:
    bench = wire_bench()
    rig = on_the_wire(lambda c: counter(c, node_id=9), bench=bench)
    found = look(tmp_path, lambda: replace(rig, second_bus=bench.bus))
    assert "node 9" in line(found, "rig", "connection").found
    told = "node 1 (profile 402), node 2 (profile 406), node 3 (profile 401)"
    assert line(found, "nodes", "scan").found == told


def test_an_open_guard_fails(tmp_path: Path) -> None:
    found = look(
        tmp_path,
        lambda: replace(on_the_wire(), real_time=True, guard=lambda: (0, False)),
        moves=True,
    )
    assert line(found, "safety", "guard").severity == "blocks"
    assert line(found, "motion", "direction and ratio").severity == "not looked at"


def test_a_folder_that_cannot_take_runs_fails(tmp_path: Path) -> None:
    taken = tmp_path / "runs"
    taken.write_text("a file", encoding="utf-8")
    assert surroundings.disk(taken).severity == "blocks"
    assert surroundings.disk(tmp_path / "not" / "yet" / "there").severity != "blocks"


@pytest.mark.parametrize(
    ("fault", "result", "words"),
    [
        (None, "passed", "rad"),
        (faults.ReadoutEncoderFault(0), "blocks", ""),
        (faults.ReadoutGarbage(0), "blocks", ""),
        (faults.ReadoutSilent(0), "blocks", "does not answer"),
    ],
)
def test_the_readout_is_asked_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fault: Fault | None, result: str, words: str
) -> None:
    bench = wire_bench(*([] if fault is None else [fault]))
    monkeypatch.setattr(surroundings, "open_port", lambda config: bench.serial())
    finding = surroundings.readout(ReadoutConfig(url="/dev/ttyUSB0"), bench.clock)
    assert finding.severity == result
    assert words in finding.found
    assert finding.remedy or result == "passed"


def test_a_readout_that_fails_does_not_keep_the_rig_from_moving(tmp_path: Path) -> None:
    stop, there_is_none = StopRequest(), ReadoutConfig(url=str(tmp_path / "no-such-line"))
    found = examine(
        on_the_wire,
        request(tmp_path),
        moves=True,
        serial_line=there_is_none,
        stop=stop,
        on_stage=lambda stage: stop.stop() if stage == "motion" else None,
    )
    assert failed(found) == [("readout", "ND 287")]
    assert "standstill verified" in line(found, "motion", "run").found


@pytest.mark.skipif(
    sys.platform == "win32", reason="pseudo-terminals are a matter of POSIX systems"
)
def test_the_line_of_a_pseudo_terminal_opens_as_often_as_it_is_asked(tmp_path: Path) -> None:
    controller, terminal = os.openpty()
    try:
        for _ in range(3):
            open_port(ReadoutConfig(url=os.ttyname(terminal))).close()
    finally:
        os.close(controller)
        os.close(terminal)


def test_what_nobody_states_of_the_output_has_a_line() -> None:
    gear, bearing = shipped_gear(), {"coulomb": 0.3}
    stated = gear.with_values({"inertia.output": 0.1}, Origin("measured", "gear card"))

    def names(*given: Any) -> list[str]:
        return [found.what for found in surroundings.output_assumptions(*given)]

    assert names(gear, {}) == ["output bearing, not stated", "output inertia, not stated"]
    assert names(stated, {}) == ["output bearing, not stated"]
    assert names(stated, bearing) == []
    (line,) = surroundings.output_assumptions(gear, bearing)
    assert line.severity is Severity.WARNS
    assert "rig gear set" in line.remedy


def test_the_lines_of_the_output_are_of_a_rig_that_is_no_simulation(tmp_path: Path) -> None:
    found = [
        {finding.what for finding in examine(on_the_wire, asked, moves=False).findings}
        for asked in (request(tmp_path), request(tmp_path, backend="hardware"))
    ]
    assert "output bearing, not stated" not in found[0]
    assert "output bearing, not stated" in found[1]
