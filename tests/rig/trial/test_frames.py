"""Frames beside a run, and a log played to the decoders."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import can
import pytest
from typer.testing import CliRunner

from rig.bench.backends.order import Order, Setup
from rig.bench.backends.registry import make_port
from rig.errors import ChangedRunError
from rig.main import app
from rig.run.frames import frames_of
from rig.run.parts import Progress, RunReport
from rig.run.start import plan_order, run_on
from rig.trial.commission.motion import UNCOUPLED
from rig.trial.doctor.bundle import without_persons
from rig.trial.doctor.frames import meaning, play, words


def run(folder: Path, act: str) -> RunReport:
    order = Order(protocol="turn", backend="wire", folder=folder, sample_rate=50.0, operator="A")
    rig = make_port(order, Setup(gear_mounted=False, watches_contact=True))
    assert rig.person is not None
    person = rig.person

    def acts(_: Progress) -> None:
        person(act)

    return run_on(rig, order, plan_order(order, UNCOUPLED), on_progress=acts)


def test_a_run_that_trips_keeps_its_frames_and_another_does_not(tmp_path: Path) -> None:
    report = run(tmp_path, "open-guard")
    assert report.outcome == "TRIPPED"
    log = frames_of(report.path)
    played = play(log)
    assert {"SYNC", "TPDO 1 of node 1", "SDO requests to node 1"} <= {
        one.what for one in played.traffic.values()
    }
    shown = CliRunner().invoke(app, ["show", str(report.path), "--frames", "--json"])
    assert json.loads(shown.stdout)["frames"] == played.frames > 100
    table = CliRunner().invoke(app, ["show", str(report.path), "--frames"])
    assert "heartbeat of node 2" in table.stdout
    (tmp_path / ".tripped.json").unlink()
    other = run(tmp_path, "nothing")
    assert (other.outcome, frames_of(other.path).exists()) == ("COMPLETED", False)
    refused = CliRunner().invoke(app, ["show", str(other.path), "--frames"])
    assert "no frames were kept" in str(refused.exception)
    log.chmod(0o644)
    log.write_bytes(log.read_bytes()[:-1] + b"x")
    changed = CliRunner().invoke(app, ["show", str(report.path), "--frames"])
    assert isinstance(changed.exception, ChangedRunError)


def test_a_disk_that_takes_no_frames_costs_a_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*words: object, **more: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("drivers.bus.frame_log.gzip.open", full)
    report = run(tmp_path, "open-guard")
    assert (report.outcome, report.readable) == ("TRIPPED", True)
    assert "No space left" in report.warnings[-1]


def test_a_foreign_log_is_told_by_the_same_decoders(tmp_path: Path) -> None:
    path = tmp_path / "foreign.asc"
    said = (
        (0.0, 0x705, b"\x00"),
        (0.1, 0x705, b"\x05"),
        (0.2, 0x085, bytes([0x10, 0x23, 0x03, 0, 0, 0, 0, 0])),
        (0.3, 0x605, bytes([0x40, 0x41, 0x60, 0, 0, 0, 0, 0])),
        (0.4, 0x585, bytes([0x80, 0x41, 0x60, 0, 0, 0, 0x02, 0x06])),
        (0.5, 0x000, bytes([0x81, 0x05])),
    )
    with can.Logger(str(path)) as log:
        for at, cob_id, data in said:
            message = can.Message(
                timestamp=1e9 + at, arbitration_id=cob_id, data=data, is_extended_id=False
            )
            log.on_message_received(message)
    played = play(path)
    assert [one.words for one in played.latest] == [
        "heartbeat of node 5: BOOT-UP",
        "heartbeat of node 5: OPERATIONAL",
        "emergencies of node 5: 0x2310",
        "SDO requests to node 5: 0x6041:0",
        "SDO answers of node 5: 0x6041:0, abort 0x06020000",
        "NMT reset node, node 5",
    ]
    assert any("2310" in event.text for _, event in played.events)
    assert played.seconds == pytest.approx(0.5)


def test_what_is_not_of_the_predefined_set_is_told_so() -> None:
    assert meaning(0x7E5) == "not of the predefined set"
    assert words(0x080, b"") == "SYNC"
    assert words(0x601, b"\x40") == "SDO requests to node 1"


def test_a_bundle_holds_what_a_stranger_needs_and_names_no_person(tmp_path: Path) -> None:
    path = tmp_path / "bundle.zip"
    words = ["doctor", "--backend", "wire", "--no-move", "--json", "--sample-rate", "50"]
    where = ["--runs", str(tmp_path), "--operator", "Jo Doe", "--bundle", str(path)]
    answer = CliRunner().invoke(app, [*words, *where])
    assert answer.exit_code == 0, answer.stdout
    with zipfile.ZipFile(path) as bundle:
        content = {name: bundle.read(name) for name in bundle.namelist()}
    assert set(content) == {
        "checklist.json",
        "commissioning.json",
        "frames.log.gz",
        "nodes.json",
        "versions.json",
    }
    nodes = json.loads(content["nodes.json"])
    assert [nodes[f"node {k}"]["identity"]["device_type"] & 0xFFFF for k in (1, 2, 3)] == [
        402,
        406,
        401,
    ]
    assert not any(b"Jo Doe" in data for data in content.values())


def test_a_description_loses_its_persons_and_nothing_else() -> None:
    text = '[rig]\nname = "r"\n\n[laboratory]  # us\nname = "L"\ncustomer = "C"\n\n[alarms]\nover = 3\n'
    assert without_persons(text) == '[rig]\nname = "r"\n\n[alarms]\nover = 3\n'
