"""Arming asks for what a drive cannot do: watch the computer, or hold a limit."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from drivers.bus.network import OPENED_TWICE, BusConfig, open_raw_bus, second_handle_words
from drivers.clock import VirtualClock
from drivers.errors import BusLostError
from drivers.port import Abilities, DriveLimits
from drivers.python_can import can
from experiments.finding import Severity
from experiments.steps.vocabulary import HoldTime, Ramp
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig.bench.backends.assembly import AssembledRig
from rig.bench.backends.order import Order
from rig.errors import LimitError
from rig.run.arming import handle_check, loss_check
from rig.run.own_handle import OwnHandle
from rig.run.preflight import limits_check
from rig.run.session import execute
from rig.run.start import arm, run_on
from rig.run.watchdog import Watchdog
from rig.runfile.read import close_recording, open_run
from tests.rig.fake_rig import FakeRig, ListRun, parts_of, planned_of

REASONS = ("it does not hear the computer's heartbeat (0x1016)",)


def test_a_drive_that_would_not_stop_without_the_computer_is_armed_only_where_it_is_covered() -> (
    None
):
    assert loss_check(lambda: (), "").severity is Severity.PASSED
    assert loss_check(None, "").severity is Severity.BLOCKS
    refused = loss_check(lambda: REASONS, " ")
    assert refused.severity is Severity.BLOCKS
    assert "0x1016" in refused.found
    assert "computer_loss_covered_by" in refused.remedy
    covered = loss_check(lambda: REASONS, "watchdog relay K3 in the STO line")
    assert covered.severity is Severity.WARNS
    assert "watchdog relay K3" in covered.found


def test_it_is_asked_when_a_rig_in_real_time_is_armed() -> None:
    port = FakeRig()
    port.abilities = Abilities(unwatched=lambda: REASONS)
    rig = AssembledRig(
        name="hardware",
        port=port,
        clock=VirtualClock(),
        real_time=True,
        guard=lambda: (1, True),
    )
    assert [c.what for c in arm(rig) if c.severity is Severity.BLOCKS] == ["loss of the computer"]
    assert "blocks" not in {c.severity for c in arm(replace(rig, loss_covered_by="K3"))}


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("torque", "torque_limit_unit_n_m"),
        ("deceleration", "are the same"),
        ("speed", "rig doctor"),
    ],
)
def test_a_limit_that_the_drive_does_not_hold_is_refused_with_what_to_do(
    name: str, words: str
) -> None:
    wanted = DriveLimits(0.5, 300.0, 1000.0, 1000.0, 2000.0)
    with pytest.raises(LimitError, match=f"holds no limit of its {name}.*{words}"):
        limits_check(wanted, replace(wanted, **{name: math.inf}))


def refuses() -> Any:
    """An adapter that is opened already."""
    raise BusLostError("the bus cannot be opened: channel 1 is in use", where="pcan 1")


@pytest.mark.parametrize(
    ("unwatched", "covered_by", "result", "words"),
    [
        ((), "", "warns", "covered by: the drive watches"),
        (REASONS, "watchdog relay K3", "warns", "covered by: watchdog relay K3"),
        (REASONS, "", "blocks", "nothing else stops the motor"),
    ],
)
def test_without_a_second_handle_the_loss_of_the_computer_must_be_covered(
    unwatched: tuple[str, ...], covered_by: str, result: str, words: str
) -> None:
    check = handle_check(refuses, "pcan: not tried", lambda: unwatched, covered_by)
    assert check.severity == result
    for part in ("cannot be opened twice", "channel 1 is in use", "pcan: not tried", words):
        assert part in check.found
    assert check.remedy
    assert handle_check(lambda: None, "", lambda: unwatched, covered_by).severity is Severity.PASSED
    assert handle_check(refuses, "", None, "").severity is Severity.BLOCKS


def test_a_rig_whose_adapter_allows_one_handle_runs_and_says_that_its_watchdog_has_none(
    tmp_path: Path,
) -> None:
    port = FakeRig()
    port.abilities = Abilities(unwatched=lambda: (), quick_stop_frames=lambda: [(0x200, b"")])
    opened: list[bool] = []

    def second() -> Any:
        opened.append(not port.exchanged)
        refuses()

    rig = AssembledRig(
        name="fake",
        port=port,
        clock=port.clock,
        real_time=True,
        second_bus=second,
        second_handle="pcan: not tried",
        guard=lambda: (1, True),
    )
    request = Order(
        protocol="literal",
        gear=shipped_gear(),
        motor=shipped_motor(),
        folder=tmp_path,
        serial="SN-1",
    )
    report = run_on(rig, request, planned_of(Ramp(20.0, 500.0), Ramp(0.0, 500.0)))
    assert report.outcome == "COMPLETED"
    # Once, when the rig was open and before anything was exchanged with it.
    assert opened == [True]
    (warning,) = [text for text in report.warnings if "watchdog" in text]
    assert "pcan: not tried" in warning
    recording = open_run(report.path)
    told = [event for event in recording.events if "without a watchdog" in event.text]
    close_recording(recording)
    assert [(event.level, event.code) for event in told] == [("warning", "preflight")]
    port.abilities = Abilities(unwatched=lambda: REASONS, quick_stop_frames=list)
    refused = run_on(rig, request, planned_of(Ramp(20.0, 500.0), Ramp(0.0, 500.0)))
    assert refused.outcome == "ERROR"
    assert "nothing else stops the motor" in refused.message


def test_a_watchdog_without_a_handle_says_that_it_could_not_stop_the_drive() -> None:
    rig = FakeRig()
    handle = OwnHandle(refuses, list)
    watchdog = Watchdog(rig.clock, 0.25, handle.quick_stop, close=handle.close)

    def stall(rig: FakeRig) -> None:
        rig.clock.advance_ns(400_000_000)
        watchdog.check()

    rig.script[450] = stall
    run, steps = ListRun(), (Ramp(20.0, 500.0), HoldTime(0.3))
    report = execute(parts_of(planned_of(*steps), rig, Path(), watchdog=watchdog), lambda *_: run)
    watchdog.stop()
    assert report.trip is not None
    assert report.trip.cause == "late_turn"
    (text,) = [event.text for event in run.events if event.code == "watchdog"]
    assert "could not stop the drive" in text


def test_what_is_known_of_adapters_is_said_of_each() -> None:
    assert second_handle_words("socketcand") == "socketcand can be opened twice"
    assert second_handle_words("pcan").endswith("not tried")
    assert second_handle_words("no-such-adapter").endswith("not tried")


def test_the_virtual_interface_is_opened_twice() -> None:
    config = BusConfig("virtual", "twice")
    assert OPENED_TWICE[config.interface]
    first, second = open_raw_bus(config), open_raw_bus(config)
    first.send(can.Message(arbitration_id=0x123, is_extended_id=False))
    heard = second.recv(600.0)
    assert heard is not None
    assert heard.arbitration_id == 0x123
    first.shutdown()
    second.shutdown()
