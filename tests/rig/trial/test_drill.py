"""The drills: every fault ends safe, detected, with the right outcome and a file that can be read; none hangs."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from experiments.contract import Evidence
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig.errors import ConfigurationError, RunFileError
from rig.main import app
from rig.run.dry_run import plan_run
from rig.run.stop import StopRequest
from rig.run.trips import TRIPS
from rig.runfile.read import close_recording, open_run
from rig.trial.drill import rigs
from rig.trial.drill.catalogue import Drill, every_drill
from rig.trial.drill.cause import NOTHING
from rig.trial.drill.protocol import EXPERIMENT, DrillParameters, analyse
from rig.trial.drill.rigs import DrillHungError, drilled_rig
from rig.trial.drill.staging import SPOILED, Placed, Staged
from rig.trial.drill.suite import (
    DrillRow,
    chosen,
    random_drills,
    random_offset,
    reference_run,
    row_of,
    run_drills,
)
from rig.trial.drill.table import markdown

# STOP and ABORT in every state are tested block by block in test_session; here one of each is enough.
OPERATOR = (
    "Ctrl-C in switching-on",
    "Ctrl-C in torque-ramp",
    "Ctrl-C in making-safe",
    "Ctrl-C twice in hold",
)
NAMES = [name for name in every_drill() if not name.startswith("Ctrl-C") or name in OPERATOR]


@pytest.fixture(scope="module")
def rows() -> dict[str, DrillRow]:
    # What both rigs carry is drilled on the faster one here; the table of the documentation has it on the wire.
    drills = [every_drill()[name] for name in NAMES]
    done = [*run_drills([drill for drill in drills if "sim" in drill.carriers], backend="sim")]
    done += run_drills([drill for drill in drills if "sim" not in drill.carriers])
    return {row.fault: row for row in done}


@pytest.mark.parametrize("name", NAMES)
def test_every_fault_ends_as_it_must(name: str, rows: dict[str, DrillRow]) -> None:
    row = rows[name]
    assert row.outcome == row.expected, row.message
    assert row.safe
    assert row.file_readable
    assert row.detected
    assert row.happened, row.evidence
    assert row.names_cause, row.causes
    assert row.passed
    assert 0 <= row.cycles <= 1000


def test_no_fault_of_the_rig_fails_the_gear(rows: dict[str, DrillRow]) -> None:
    assert {row.outcome for row in rows.values()} == {"COMPLETED", "TRIPPED", "ABORTED", "ERROR"}
    harmless = [row for row in rows.values() if every_drill()[row.fault].is_harmless]
    assert len(harmless) >= 8
    assert {row.outcome for row in harmless} == {"COMPLETED"}
    assert {row.action for row in harmless} == {"none needed"}


CAUSES = {
    "heartbeat lost, drive": "heartbeat_lost",
    "node reset in motion, drive": "boot_up",
    "EMCY": "emcy",
    "statusword fault": "drive_fault",
    "run-away": "over_speed",
    "E-stop (STO) in motion": "unexpected_state",
    "TPDO lost": "stale_data",
    "TPDO late": "missed_cycles",
    "answers held back": "missed_cycles",
    "bus off": "bus_lost",
    "hub gone": "bus_lost",
    "SDO abort": "device_error",
    "SDO time-out": "device_error",
    "encoder stuck, input": "input_output_disagreement",
    "torque port open": "torque_port",
    "clock jump forward": "time_base",
    "clock jump back": "time_base",
    "disk nearly full": "disk_space",
    "disk full": "recorder",
    "writer stalled": "recorder",
    "drive limit reads back differently": "refused before arming",
    "TPDO lost, one": "marked 1 x INCOMPLETE",
    "TPDO doubled": "foreign_tpdo",
    "TPDO doubled, twice": "marked",
    "quick stop not obeyed": "ABORT; quick stop not seen to be obeyed",
    "encoder wrapped, as declared": "counts are right",
    "readout unit '?'": "none (?)",
    "Ctrl-C in torque-ramp": "STOP",
}


@pytest.mark.parametrize("name", CAUSES)
def test_what_is_detected_is_named(name: str, rows: dict[str, DrillRow]) -> None:
    assert CAUSES[name] in rows[name].detected


@pytest.mark.parametrize(
    ("name", "most"), [("EMCY", 3), ("E-stop (STO) in motion", 3), ("encoder stuck, output", 20)]
)
def test_what_the_guard_watches_is_answered_within_a_few_cycles(
    name: str, most: int, rows: dict[str, DrillRow]
) -> None:
    assert rows[name].cycles <= most


def test_where_nobody_hears_the_drive_stops_alone_and_the_report_is_loud(
    rows: dict[str, DrillRow],
) -> None:
    for name in ("bus off", "hub gone", "bus lost"):
        row = rows[name]
        assert row.safe
        assert not row.verified
        assert "by itself" in row.action
        assert "Press the emergency stop" in row.message


def test_standstill_is_verified_wherever_the_nodes_can_still_be_heard(
    rows: dict[str, DrillRow],
) -> None:
    unverified = {name for name, row in rows.items() if not row.verified}
    # And where the only contact that tells of power on the motor is stuck: nobody says that it is off.
    assert unverified == {"bus off", "hub gone", "bus lost", "power contact stuck on"}
    # A drive that has lost its process data is switched off and asked by SDO.
    assert rows["node reset in motion, drive"].action.endswith("servo off by SDO")


def test_hardware_and_unknown_faults_are_refused() -> None:
    for backend in ("hardware", "replay:run.h5", ""):
        with pytest.raises(ConfigurationError, match="only drilled on simulated rigs"):
            chosen((), backend)
        with pytest.raises(ConfigurationError, match="only drilled on simulated rigs"):
            drilled_rig(backend, shipped_gear(), shipped_motor(), (), StopRequest(), 0)
    with pytest.raises(ConfigurationError, match="no such fault"):
        chosen(["gremlins"])
    with pytest.raises(ConfigurationError, match="does not carry"):
        chosen(["EMCY"], "sim")
    assert {drill.name for drill in chosen((), "sim")} < set(every_drill())


def test_a_run_that_does_not_end_is_cut(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rigs, "LARGEST_EXCHANGES", 20)
    drill = Drill(name="never ends", what="", cause=NOTHING)
    # A seed of its own: the run with nothing going wrong is the one that does not end.
    with pytest.raises(DrillHungError):
        list(run_drills([drill], backend="sim", seed=17))


@pytest.mark.parametrize(
    "wrong",
    [
        {"outcome": "ERROR"},
        {"safe": False},
        {"file_readable": False},
        {"causes": ("over_speed",)},
        {"causes": ()},
        {"evidence": ""},
        {"wrong_counts": 1},
    ],
)
def test_a_drill_that_lacks_anything_does_not_pass(
    wrong: dict[str, Any], rows: dict[str, DrillRow]
) -> None:
    assert not replace(rows["EMCY"], **wrong).passed


def test_a_drill_that_claims_nothing_fails_when_something_is_detected(
    rows: dict[str, DrillRow],
) -> None:
    quiet = rows["encoder wrapped, as declared"]
    assert not quiet.claims_detection
    assert not replace(quiet, causes=("count_jump",)).passed


def test_wrong_counts_that_are_not_marked_are_found(tmp_path: Path) -> None:
    drill = replace(every_drill()["encoder count jump, output"], is_harmless=True)
    planned = plan_run(EXPERIMENT, DrillParameters(), shipped_gear(), shipped_motor())
    reference = reference_run(planned, "sim", 0, tmp_path)
    reference.counts["torque"][700:710] += 5
    ending = Staged(
        parts=(Placed(drill.taken_out(), 10),),
        planned=planned,
        carrier="sim",
        seed=0,
        folder=tmp_path / "again",
        reference=reference,
        compares=True,
    ).run()
    assert "10 WRONG COUNTS NOT MARKED" in ending.detected
    row = row_of(drill, "sim", ending, "COMPLETED")
    assert not replace(row, causes=(row.expected_cause,), evidence="x").passed
    assert replace(row, causes=(row.expected_cause,), evidence="x", wrong_counts=0).passed


def test_a_completed_run_with_lost_revolutions_is_found_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    planned = plan_run(EXPERIMENT, DrillParameters(), shipped_gear(), shipped_motor())
    reference = reference_run(planned, "sim", 0, tmp_path)
    staged = Staged(
        parts=(),
        planned=planned,
        carrier="sim",
        seed=0,
        folder=tmp_path / "again",
        reference=reference,
    )
    assert staged.run().causes == ()
    monkeypatch.setattr("rig.trial.drill.protocol.CLOSURE_LIMIT", -1.0)
    assert staged.run().causes == (SPOILED,)


def test_the_analysis_of_a_drill_measures_and_refuses(tmp_path: Path) -> None:
    planned = plan_run(EXPERIMENT, DrillParameters(), shipped_gear(), shipped_motor())
    reference = reference_run(planned, "sim", 1, tmp_path)
    assert reference.outcome == "COMPLETED"
    recording = open_run(next(tmp_path.glob("*.h5")))
    result = analyse(recording, Evidence(shipped_gear()))
    assert result.metrics["closure"] < 0.002
    assert 0.02 < result.metrics["running_torque"] < 0.3
    close_recording(recording)


def test_random_drills_are_the_same_for_the_same_seed() -> None:
    first, again, other = ([d.name for d in random_drills(12, seed)] for seed in (4, 4, 5))
    assert first == again != other
    moves = [random_offset(4)(every_drill()["EMCY"]) for _ in range(2)]
    assert moves[0] == moves[1]
    assert random_offset(4)(every_drill()["Ctrl-C in ramp"]) == 0


def test_the_command_prints_one_object_and_the_table(tmp_path: Path) -> None:
    table = tmp_path / "drills.md"
    arguments = [
        "sim",
        "drill",
        "--backend",
        "sim",
        "--fault",
        "encoder stuck, input",
        "--json",
        "--markdown",
        str(table),
    ]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0
    (row,) = json.loads(done.stdout)["faults"]
    wanted = {"fault", "detected", "cycles", "action", "safe", "outcome", "file_readable"}
    assert wanted <= set(row)
    assert (row["safe"], row["outcome"], row["file_readable"]) == (True, "TRIPPED", True)
    assert "| encoder stuck, input |" in table.read_text()
    assert "1 of 1 drills" in table.read_text()
    refused = CliRunner().invoke(app, ["sim", "drill", "--backend", "hardware"])
    assert isinstance(refused.exception, ConfigurationError)
    listed = CliRunner().invoke(app, ["sim", "drill", "--list"])
    assert listed.stdout.count("\n") == len(every_drill())


def test_the_table_in_the_documentation_lists_every_drill() -> None:
    text = (Path(__file__).parents[3] / "docs" / "drills.md").read_text()
    missing = [name for name in every_drill() if f"| {name} |" not in text]
    assert not missing
    assert f"{len(every_drill())} of {len(every_drill())} drills ended as they must" in text
    assert "**no** | TRIPPED | **no**" not in markdown([], [])


def test_every_trip_that_a_port_can_name_has_a_rule() -> None:
    for cause in (
        "emcy",
        "heartbeat_lost",
        "boot_up",
        "not_operational",
        "drive_state",
        "bus_lost",
        "signal_error",
        "fault",
    ):
        assert cause in TRIPS
    assert issubclass(RunFileError, Exception)
