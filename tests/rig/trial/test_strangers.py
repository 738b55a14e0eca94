"""Strangers on the bus of a whole run: by target position and by profile velocity they trip as by target velocity."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from experiments.recording import Event
from rig.run.trips import DEVICE_CAUSES, TRIPS
from rig.runfile.read import close_recording, open_run
from rig.trial.drill.catalogue import every_drill
from rig.trial.drill.rigs import Carrier
from rig.trial.drill.staging import Ending, Placed
from rig.trial.drill.suite import Stage, row_of, stage

CASES: tuple[tuple[str, Carrier], ...] = (
    ("alien process data, drive", "wire-csp"),
    ("alien set-point", "wire-csp"),
    ("second SYNC producer", "wire-pv"),
    ("mode changed by another master, cyclic torque", "wire-pv"),
)


@pytest.fixture(scope="module")
def staged() -> Iterator[Stage]:
    with stage(0) as made:
        yield made


def ended(staged: Stage, name: str, carrier: Carrier) -> Ending:
    drill = every_drill()[name]
    placed = Placed(drill, staged.reference(carrier).rows["hold"])
    return staged.run(name, carrier, (placed,), compares=drill.is_harmless)


@pytest.mark.parametrize(("name", "carrier"), CASES)
def test_a_stranger_trips_in_every_speed_mode(staged: Stage, name: str, carrier: Carrier) -> None:
    ending = ended(staged, name, carrier)
    row = row_of(every_drill()[name], carrier, ending, "COMPLETED")
    assert row.passed, (row.causes, row.message)
    assert row.cycles <= 3
    # Who it was stands in the sentence that the operator reads.
    assert {"COB-ID", "SYNC", "0x6061"} & set(
        row.message.replace("(", " ").replace(")", " ").split()
    )


def test_two_strangers_are_warnings_in_the_run_file(staged: Stage) -> None:
    ending = ended(staged, "second SYNC producer, two SYNCs", "wire-pv")
    assert ending.report is not None
    assert ending.report.outcome == "COMPLETED"
    recording = open_run(ending.report.path)
    try:
        events: list[Event] = [e for e in recording.events if e.code == "foreign-sync"]
    finally:
        close_recording(recording)
    assert [event.level for event in events] == ["warning", "warning"]
    assert "2 within 10 s, 3 end a run" in events[1].text


def test_each_has_a_rule_and_the_words_of_who_told_it() -> None:
    for cause in ("foreign_sync", "foreign_tpdo", "foreign_command", "drive_mode"):
        assert cause in TRIPS
        assert cause in DEVICE_CAUSES
