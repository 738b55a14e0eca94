"""Drills can fail: with the fault taken out, with a wrong cause, by the truth of the plant. And faults in pairs."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from drivers.samples import CycleFlag
from experiments.recording import Event
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig.errors import ConfigurationError
from rig.main import app
from rig.run import trips
from rig.run.make_safe import Stage as StoppingStage
from rig.run.stop import StopRequest
from rig.trial.drill import catalogue, staging
from rig.trial.drill.catalogue import Drill, every_drill
from rig.trial.drill.cause import NOTHING, causes_of_events, marked, not_obeyed, refused
from rig.trial.drill.pairs import PairRow, candidates, drawn, run_pairs
from rig.trial.drill.rigs import DrilledRig, Happening, drilled_rig
from rig.trial.drill.suite import carrier_of, proves_detection, run_drills
from rig.trial.drill.table import markdown
from sim_backend.direct import SimulatedRig
from sim_backend.faults import Fault, RunAway

# One of each kind of injector: device, frames, SDO, object that reads back, press and fault, readout; plant, signal,
# disk, press alone, limits.
ON_THE_WIRE = (
    "EMCY",
    "TPDO lost, one",
    "SDO abort",
    "drive limit reads back differently",
    "quick stop not obeyed",
    "readout garbage",
)
ON_THE_DIRECT_RIG = (
    "run-away",
    "encoder stuck, output",
    "disk full",
    "disk nearly full",
    "writer stalled",
    "Ctrl-C in hold",
    "drive limits read back differently, sim",
)
PAIRS_SEED = 20
"""Of the thirty pairs of the suite; the study is made with another one."""


def test_every_drill_names_a_cause_that_the_program_knows() -> None:
    words = {"STOP", "ABORT", "recorder", NOTHING}
    known = {*trips.TRIPS, *words, *map(marked, CycleFlag), *map(not_obeyed, StoppingStage)}
    for drill in every_drill().values():
        for carrier in drill.carriers:
            cause = drill.cause_on(carrier)
            assert cause in known or cause.startswith(
                ("refused before arming:", "reading refused:")
            )
    silent = {name for name, drill in every_drill().items() if not drill.claims_detection}
    beside = "status page's disk is gone"
    assert silent == {"encoder wrapped, as declared", "Ctrl-C in making-safe", beside}


def test_a_drill_without_a_cause_cannot_be_written() -> None:
    with pytest.raises(TypeError, match="cause"):
        Drill(name="forgotten", what="")  # type: ignore[call-arg]


def test_with_every_fault_taken_out_all_that_claim_a_detection_fail() -> None:
    rows = [
        row
        for backend, names in (("wire", ON_THE_WIRE), ("sim", ON_THE_DIRECT_RIG))
        for row in run_drills(
            [every_drill()[n] for n in names], backend=backend, without_faults=True
        )
    ]
    for row in rows:
        assert not row.happened, row.evidence
        assert not row.passed
        assert row.claims_detection
        assert not row.names_cause, (row.fault, row.causes)
        assert row.safe
    assert proves_detection(rows)
    # The press that gives the fault its occasion is still there, and heard.
    assert {row.fault: row.causes for row in rows}["quick stop not obeyed"] == ("ABORT",)


def test_a_drill_that_finds_its_cause_where_nothing_is_wrong_is_told() -> None:
    always = replace(every_drill()["quick stop and servo off not obeyed"], cause="ABORT")
    (row,) = run_drills([always], backend="sim", without_faults=True)
    assert row.names_cause
    assert not row.passed, "its fault did not happen"
    assert not proves_detection([row])
    assert "**finds its cause**" in markdown([row], [row])


def test_the_wrong_cause_is_not_enough() -> None:
    wrong = replace(every_drill()["encoder stuck, input"], cause=trips.OVER_SPEED)
    (row,) = run_drills([wrong], backend="sim")
    assert row.happened
    assert row.outcome == row.expected
    assert row.safe
    assert not row.passed


def test_a_fault_that_comes_too_late_has_not_happened() -> None:
    late = every_drill()["encoder stuck, output"]
    (row,) = run_drills([late], backend="sim", offset=lambda drill: 100_000)
    assert not row.happened
    assert not row.passed


def test_causes_are_read_from_what_a_run_tells() -> None:
    told = [
        Event(0, "error", "preflight", "preflight", "drive limits: other than written"),
        Event(0, "info", "preflight", "preflight", "disk: 100 GB free"),
        Event(0, "error", "preflight", "session", "not ready"),
        Event(0, "error", "emcy", "node 1", "0x4310"),
        Event(0, "error", "emcy", "session", "TRIPPED"),
    ]
    assert list(causes_of_events(told)) == [refused("drive limits"), "emcy"]


# The truth of the plant ---------------------------------------------------------------------------------------------


class DriftingRig(SimulatedRig):
    """A rig whose shaft turns while every count and statusword says that it stands."""

    @property
    def input_speed(self) -> float:
        return 30.0


@pytest.mark.parametrize("name", ["encoder stuck, output", "Ctrl-C in hold"])
def test_safe_is_the_truth_of_the_plant_and_not_the_word_of_the_program(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rig.trial.drill.rigs.SimulatedRig", DriftingRig)
    (row,) = run_drills([every_drill()[name]], backend="sim")
    assert row.verified, "the program believes what it is told"
    assert not row.safe
    assert not row.passed


def test_a_word_that_comes_too_early_is_not_safe(monkeypatch: pytest.MonkeyPatch) -> None:
    """It stands in the end, but did not when the program said so."""
    monkeypatch.setattr(DrilledRig, "stands", property(lambda rig: not rig.port._open))
    (row,) = run_drills([every_drill()["Ctrl-C in hold"]], backend="sim")
    assert row.verified
    assert not row.safe


def test_two_things_happen_in_one_rig() -> None:
    two = [
        Happening(30, lambda at: RunAway(at, speed=50.0, cycles=5)),
        Happening(60, press=StopRequest.press),
    ]
    for carrier in ("sim", "wire"):
        stop = StopRequest()
        rig = drilled_rig(carrier, shipped_gear(), shipped_motor(), two, stop, 0)
        assert [happening.row for happening in rig.happenings] == [30, 60]
    nothing = Happening(0, Fault)
    assert nothing.evidence() == ""


# Pairs --------------------------------------------------------------------------------------------------------------


def test_thirty_pairs_at_random_are_safe_and_say_so() -> None:
    # Half of them wherever both faults can happen, mostly the wire; half on the direct rig, which is faster.
    rows = [*run_pairs(range(15), seed=PAIRS_SEED)]
    rows += run_pairs(range(15, 30), seed=PAIRS_SEED, backend="sim")
    assert [row.sentence() for row in rows if not row.passed] == []
    assert sum(all(row.ending.evidence) for row in rows) >= 10, "both faults really happen in many"
    for row in rows:
        assert row.ending.report is None or row.ending.file_readable


def test_a_pair_is_the_same_whichever_are_drawn_before_it() -> None:
    assert drawn(17, 5, 1300) == drawn(17, 5, 1300)
    assert drawn(17, 5, 1300) != drawn(17, 6, 1300)
    for number in range(200):
        pair = drawn(number, 1, 1300)
        assert all(pair.carrier in drill.carriers for drill in pair.drills)
        assert 1 <= pair.rows[0] <= pair.rows[1] < 1300 + 400
    assert {drawn(number, 1, 1300, "sim").carrier for number in range(20)} == {"sim"}
    names = [drill.name for drill in candidates()]
    assert len([name for name in names if name.startswith("Ctrl-C")]) == 2, (
        "STOP and ABORT, once each"
    )
    assert not any(drill.moment == "start" for drill in candidates())


@pytest.fixture(scope="module")
def pair() -> PairRow:
    (row,) = run_pairs([3], seed=PAIRS_SEED, backend="sim")
    return row


@pytest.mark.parametrize(
    ("change", "heard", "verdict"),
    [
        ({"safe": True, "verified": True}, True, "safe"),
        ({"safe": True, "verified": False}, True, "SAFE AND NOT SAID"),
        ({"safe": True, "verified": False}, False, "safe, nobody can be heard"),
        (
            {"safe": True, "verified": False, "rightly_denied": True},
            True,
            "safe later, rightly not verified",
        ),
        ({"safe": False, "verified": True}, True, "UNSAFE"),
        ({"safe": False, "verified": False}, False, "UNSAFE"),
    ],
)
def test_the_verdict_of_a_pair(
    change: dict[str, Any], heard: bool, verdict: str, pair: PairRow
) -> None:
    drills = (pair.pair.drills[0], replace(pair.pair.drills[1], is_unheard=not heard))
    row = replace(
        pair, pair=replace(pair.pair, drills=drills), ending=replace(pair.ending, **change)
    )
    assert row.verdict == verdict
    assert row.passed is (verdict.startswith("safe"))


def test_a_run_that_hangs_or_breaks_is_a_row_that_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    def hangs(*arguments: Any, **more: Any) -> None:
        raise ZeroDivisionError("a defect")

    (sound,) = run_drills([every_drill()["Ctrl-C in hold"]], backend="sim")
    assert sound.passed
    real = staging.execute
    monkeypatch.setattr(
        staging,
        "execute",
        lambda order, *a, **k: (hangs if "on_event" in k else real)(order, *a, **k),
    )
    (row,) = run_drills([every_drill()["Ctrl-C in hold"]], backend="sim")
    assert row.outcome == "ERROR"
    assert "ZeroDivisionError" in row.message
    assert not row.passed


# The command --------------------------------------------------------------------------------------------------------


def test_without_faults_the_command_is_content_when_all_fail(tmp_path: Path) -> None:
    arguments = [
        "sim",
        "drill",
        "--backend",
        "sim",
        "--fault",
        "encoder stuck, input",
        "--without-faults",
    ]
    done = CliRunner().invoke(app, [*arguments, "--json"])
    assert done.exit_code == 0
    answer = json.loads(done.stdout)
    (row,) = answer["faults"]
    assert answer["without_faults"] is True
    assert (row["passed"], row["claims_detection"], row["happened"]) == (False, True, False)
    assert row["expected_cause"] == "input_output_disagreement"
    shown = CliRunner().invoke(app, arguments)
    assert "1 of 1 drills that claim a detection fail with their fault taken out" in shown.stdout


def test_without_faults_the_command_refuses_a_drill_that_finds_its_cause_anyway(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    always = replace(every_drill()["quick stop and servo off not obeyed"], cause="ABORT")
    monkeypatch.setattr("rig.trial.drill.suite.chosen", lambda names, backend: [always])
    done = CliRunner().invoke(app, ["sim", "drill", "--backend", "sim", "--without-faults"])
    assert done.exit_code == 6
    assert "0 of 1" in done.stdout
    assert "prove nothing" in done.stdout


def test_pairs_by_the_command() -> None:
    arguments = ["sim", "drill", "--backend", "sim", "--pairs", "2", "--seed", "4"]
    done = CliRunner().invoke(app, [*arguments, "--json"])
    answer = json.loads(done.stdout)
    assert done.exit_code == (0 if all(row["passed"] for row in answer["pairs"]) else 6)
    assert answer["seed"] == 4
    assert sum(answer["verdicts"].values()) == len(answer["pairs"]) == 2
    assert {"faults", "rows", "happened", "safe", "verified", "verdict"} <= set(answer["pairs"][0])
    shown = CliRunner().invoke(app, arguments)
    assert "2 pairs of seed 4" in shown.stdout


@pytest.mark.parametrize(
    "more",
    [
        ["--pairs", "2", "--without-faults"],
        ["--pairs", "2", "--fault", "EMCY"],
        ["--pairs", "2", "--random", "2"],
        ["--without-faults", "--markdown", "x.md"],
    ],
)
def test_what_asks_for_different_things_is_refused(more: list[str]) -> None:
    refused_ = CliRunner().invoke(app, ["sim", "drill", *more])
    assert isinstance(refused_.exception, ConfigurationError)


def test_the_rig_of_a_drill_is_its_own_choice_or_the_one_asked_for() -> None:
    assert carrier_of(every_drill()["run-away"], None) == "wire"
    assert carrier_of(every_drill()["run-away"], "sim") == "sim"


def test_a_row_of_the_table_that_says_what_nobody_knows_is_refused() -> None:
    row = {"name": "A", "what": "nothing", "detects": "", "harmles": True}
    with pytest.raises(ValueError, match="harmles"):
        catalogue._drill(row, {"wire": ("wire",)})
    with pytest.raises(KeyError, match="Unheard"):
        catalogue._fault("UnheardOf(drive)")
