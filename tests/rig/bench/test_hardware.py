"""The rig of hardware in real time: arming, and runs through the very drivers and the bus interface that hardware has.

The devices are simulated ones in a process of their own, reached over a socketcand hub.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from importlib import resources
from pathlib import Path

import pytest

from drivers.errors import OtherMasterError
from experiments.finding import Severity
from experiments.recording import Event, Recording
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig.bench.backends.order import Order
from rig.bench.backends.registry import HARDWARE
from rig.bench.state import VARIABLE
from rig.errors import ConfigurationError
from rig.exits import ERROR, explain
from rig.run.arming import RULES, WITHOUT_GEAR, Arming, guard_check, refuse_unarmed
from rig.run.commissioned import SENTENCE
from rig.run.dry_run import PlannedRun, plan_run
from rig.run.start import arming_of, plan_order, run_order
from rig.run.stop import StopRequest
from rig.runfile.read import close_recording, open_run
from rig.trial.drill.protocol import EXPERIMENT, DrillParameters
from tests.rig.served_rig import Served, served_rig
from tests.rig.slow_computer import was_too_slow

RATE = 100.0
ARMED = Arming("A. Example", "SN-1", "SN-1")


@pytest.mark.parametrize(
    ("arming", "where"),
    [
        (replace(ARMED, operator=""), "--operator"),
        (replace(ARMED, operator=" Unknown "), "--operator"),
        (replace(ARMED, gear_serial="unknown"), "--gear"),
        (replace(ARMED, confirmation=""), "--confirm"),
        (replace(ARMED, confirmation="sn-1"), "--confirm"),
        (replace(ARMED, confirmation="yes"), "--confirm"),
        (replace(ARMED, gear_mounted=False), "--confirm"),
    ],
)
def test_a_run_that_is_not_armed_is_refused_with_what_is_missing(
    arming: Arming, where: str
) -> None:
    with pytest.raises(ConfigurationError) as refused:
        refuse_unarmed(arming)
    assert refused.value.where == where
    assert refused.value.remedy


def test_what_is_armed_is_not_refused() -> None:
    refuse_unarmed(ARMED)
    refuse_unarmed(
        replace(ARMED, gear_mounted=False, gear_serial="unknown", confirmation=WITHOUT_GEAR)
    )
    assert {rule.where for rule in RULES} == {"--operator", "--gear", "--confirm"}


def test_the_guard_closed_open_and_not_there() -> None:
    assert guard_check(lambda: (8, True)).severity is Severity.PASSED
    assert guard_check(lambda: (0, False)).severity is Severity.BLOCKS
    assert guard_check(None).severity is Severity.WARNS


def test_an_unarmed_run_connects_to_nothing(tmp_path: Path) -> None:
    request = Order(
        protocol="home",
        gear=shipped_gear(),
        motor=shipped_motor(),
        folder=tmp_path,
        backend=HARDWARE,
        operator="A",
        serial="SN-1",
        config=tmp_path / "there-is-none.toml",
    )
    with pytest.raises(ConfigurationError, match="SN-1 letter for letter"):
        run_order(request)
    assert not list(tmp_path.glob("*.h5*"))


@pytest.fixture
def served() -> Iterator[Served]:
    with served_rig(RATE) as found:
        yield found


def planned_drill() -> PlannedRun:
    return plan_run(
        EXPERIMENT,
        DrillParameters(),
        shipped_gear(),
        shipped_motor(),
        "circular-spline-fixed",
        sample_rate=RATE,
    )


def armed_request(folder: Path, configuration: Path) -> Order:
    return Order(
        protocol="drill",
        gear=shipped_gear(),
        motor=shipped_motor(),
        folder=folder / "runs",
        backend=HARDWARE,
        operator="A. Example",
        serial="SN-1",
        sample_rate=RATE,
        config=configuration,
    )


@contextmanager
def opened(path: Path) -> Iterator[Recording]:
    recording = open_run(path)
    yield recording
    close_recording(recording)


@pytest.mark.realtime
def test_a_run_over_the_hub_is_complete_safe_and_marked_simulated(
    served: Served, tmp_path: Path
) -> None:
    request = armed_request(tmp_path, served.configuration(tmp_path))
    events = []
    report = run_order(request, planned_drill(), confirmation="SN-1", on_event=events.append)
    assert report.outcome == "COMPLETED" or was_too_slow(report), report.message
    assert report.safe
    assert report.metrics["missed_share"] < 0.01 or was_too_slow(report)
    assert any(event.code == "preflight" and "guard: closed" in event.text for event in events)
    with opened(report.path) as recording:
        # Devices that call themselves simulated make it a simulated run, whatever the bus.
        assert recording.metadata.origin == "simulated"
        assert recording.metadata.time_base == "host"


@pytest.mark.realtime
def test_a_bench_that_nobody_commissioned_turns_no_faster_than_30_rpm(
    served: Served, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Simulated devices need no commissioning: here they are asked for it all the same.
    monkeypatch.setattr("rig.run.commissioned.is_exempt", lambda rig: False)
    request = armed_request(tmp_path, served.configuration(tmp_path))
    refused = run_order(request, planned_drill(), confirmation="SN-1")
    assert (refused.outcome, refused.safe) == ("ERROR", True)
    assert "listen (never done)" in refused.message
    assert "allowed 30 r/min" in refused.message
    with opened(refused.path) as recording:
        angle = recording.si("input_angle")
        assert float(angle.max() - angle.min()) < 1e-2
    # What was typed, for one run; and it stands in it.
    events = []
    report = run_order(
        request,
        planned_drill(),
        confirmation="SN-1",
        uncommissioned=SENTENCE,
        on_event=events.append,
    )
    assert report.outcome == "COMPLETED" or was_too_slow(report), report.message
    assert any(SENTENCE in event.text for event in events)


@pytest.mark.realtime
def test_an_open_guard_keeps_the_rig_still(served: Served, tmp_path: Path) -> None:
    request = armed_request(tmp_path, served.configuration(tmp_path, guard_closed=0))
    report = run_order(request, planned_drill(), confirmation="SN-1")
    assert report.outcome == "ERROR"
    assert "guard" in report.message
    with opened(report.path) as recording:
        angle = recording.si("input_angle")
        assert float(angle.max() - angle.min()) < 1e-2


@pytest.mark.realtime
def test_a_rig_that_dies_in_motion_trips_and_leaves_a_readable_file(
    served: Served, tmp_path: Path
) -> None:
    request = armed_request(tmp_path, served.configuration(tmp_path))

    def kill(progress: object) -> None:
        if "hold" in str(progress) and served.process.poll() is None:
            served.process.kill()

    report = run_order(request, planned_drill(), confirmation="SN-1", on_progress=kill)
    if was_too_slow(report):
        return
    assert report.outcome == "TRIPPED", report.message
    assert report.trip is not None
    assert report.trip.cause in ("bus_lost", "stale_data")
    # Nobody answers any more: standstill cannot be verified, and that is the loudest thing that is said.
    assert not report.safe
    with opened(report.path) as recording:
        assert recording.rows > 0


@pytest.mark.realtime
def test_a_second_master_is_refused_and_the_first_goes_on(
    served: Served, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    request = armed_request(tmp_path, served.configuration(tmp_path))
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    # Another computer by its state folder: no lock and no folder in common, only the bus.
    second = armed_request(elsewhere, served.configuration(elsewhere))
    refused: list[OtherMasterError] = []

    def join_in(progress: object) -> None:
        if not refused:
            with monkeypatch.context() as computer:
                computer.setenv(VARIABLE, str(elsewhere / "state"))
                with pytest.raises(OtherMasterError) as error:
                    run_order(second, planned_drill(), confirmation="SN-1")
            refused.append(error.value)

    events: list[Event] = []
    report = run_order(
        request, planned_drill(), confirmation="SN-1", on_progress=join_in, on_event=events.append
    )
    for words in ("set-points for node 1 (COB-ID 0x201)", "SYNC (COB-ID 0x080)"):
        assert re.search(rf"{re.escape(words)} \d\d+ times", str(refused[0]))
    code, sentence = explain(refused[0]) or (0, "")
    assert (code, sentence[:33]) == (ERROR, "This rig is led by somebody else:")
    assert not list((elsewhere / "runs").glob("*.h5*"))
    if was_too_slow(report):
        return
    assert report.outcome == "COMPLETED", report.message
    assert report.metrics["missed_share"] < 0.01
    assert not [event for event in events if event.code in ("not-operational", "heartbeat-lost")]


@pytest.mark.realtime
def test_stop_in_real_time_is_a_controlled_ramp(served: Served, tmp_path: Path) -> None:
    request, stop = armed_request(tmp_path, served.configuration(tmp_path)), StopRequest()
    report = run_order(
        request,
        planned_drill(),
        confirmation="SN-1",
        stop=stop,
        on_progress=lambda p: stop.stop() if "hold" in str(p) else None,
    )
    assert report.outcome == "ABORTED" or was_too_slow(report), report.message
    assert report.safe


def test_limits_set_by_hand_are_typed_again_to_arm() -> None:
    arming = Arming("A. Example", "SN-1", "SN-1", limits_by_hand="0.45 N m 3000 r/min")
    with pytest.raises(ConfigurationError, match=r"SN-1 0\.45 N m 3000 r/min letter for letter"):
        refuse_unarmed(arming)
    refuse_unarmed(replace(arming, confirmation="SN-1 0.45 N m 3000 r/min"))
    bare = replace(arming, gear_mounted=False, confirmation=WITHOUT_GEAR)
    with pytest.raises(ConfigurationError, match=r"NO GEAR 0\.45 N m"):
        refuse_unarmed(bare)


def test_arming_asks_the_rigs_description_for_limits_set_by_hand(tmp_path: Path) -> None:
    text = resources.files("rig.bench.config.examples").joinpath("paper-sgdv-vref.toml").read_text()
    path = tmp_path / "rig.toml"
    path.write_text(text, encoding="utf-8")
    request = Order(
        protocol="friction",
        gear=shipped_gear(),
        motor=shipped_motor(),
        folder=tmp_path,
        backend="hardware",
        serial="SN-1",
        config=path,
    )
    planned = plan_order(request)
    assert arming_of(request, planned).expected == "SN-1 0.637 N m 3000 r/min"
