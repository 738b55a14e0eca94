"""The whole chain on the simulated rig, and what happens when one of its processes stops, fails or dies."""

from __future__ import annotations

import dataclasses
import json
import os
import queue
import signal
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rig.trial.demo.work import DemoOrder, Failed, Finished, Step

from experiments.errors import PlanError
from model.gear_file import load_gear
from rig.analysis.store import json_text, read_analyses
from rig.commands.demo_tables import print_demonstration
from rig.errors import RigError
from rig.run.start import run_request
from rig.runfile.read import close_recording, open_run
from rig.trial.demo import chain as demo
from rig.trial.demo import work as demo_work
from rig.trial.demo.chain import Demonstration, demonstrate
from tests.rig.handmade import friction_result

SHORT = {
    "motor-tare": {"lowest_rpm": 5.0, "points": 9, "measure_time": 0.3, "settle_time": 0.2},
    "kinematic-error": {"speed_rpm": 241.7},
    "friction": {
        "lowest_rpm": 5.0,
        "points": 10,
        "measure_time": 0.3,
        "settle_time": 0.2,
        "up_and_down": False,
    },
    "velocity-steps": {"speeds_rpm": (600.0, 1800.0), "repeats": 1},
}
CREATED = "2024-03-02T09:00:00+01:00"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Demonstration:
    seen: list[Step | Finished] = []
    order = DemoOrder(tmp_path_factory.mktemp("demo"), 3, CREATED, SHORT)
    found = demonstrate(order, processes=1, show=seen.append)
    assert [m.protocol for m in seen if isinstance(m, Finished)] == list(demo.ORDER)
    assert {m.what for m in seen if isinstance(m, Step)} == {"preparing", "running", "fitting"}
    return found


def test_every_protocol_is_run_in_order_and_fitted(made: Demonstration) -> None:
    assert [f.result.kind for f in made.fits] == list(demo.ORDER)
    assert [f.path.name[:5] for f in made.finished] == ["00001", "00002", "00003", "00004"]
    assert all(f.outcome == "COMPLETED" for f in made.finished)
    assert all(read_analyses(f.path)[0].kind == f.protocol for f in made.finished)


def test_the_order_in_which_runs_happen_changes_no_count(
    made: Demonstration, tmp_path: Path
) -> None:
    """The first run once more, after others of the same gear and day: neither number nor warmth are theirs."""
    first = made.finished[0]
    order = dataclasses.replace(made.order, folder=tmp_path)
    for path in made.order.folder.glob("0000[234]-*.h5*"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    again = run_request(demo_work._request(first.protocol, order))
    assert again.run_id.startswith("00005-")
    one, other = open_run(first.path), open_run(again.path)
    assert one.metadata.process["world"] == other.metadata.process["world"]
    assert all(np.array_equal(one.stored(name), other.stored(name)) for name in one.signals)
    for recording in (one, other):
        close_recording(recording)


def test_the_tare_and_the_kinematic_error_are_handed_on(made: Demonstration) -> None:
    fits = {f.result.kind: f for f in made.fits}
    assert (
        fits["friction"].result.options["tare_run"] == fits["motor-tare"].recording.metadata.run_id
    )
    assert fits["friction"].result.options["torque_is_of"] == "gear"
    assert fits["velocity-steps"].gear.kinematic_error != fits["friction"].gear.kinematic_error


def test_the_truth_is_laid_beside_what_was_found(made: Demonstration) -> None:
    rows = {(kind, row.estimate.name): row for kind, row in made.truth}
    assert ("kinematic-error", "amplitude_2") in rows
    assert ("friction", "coulomb") in rows
    assert rows["kinematic-error", "amplitude_2"].difference == pytest.approx(
        0.0, abs=0.02 * rows["kinematic-error", "amplitude_2"].seen
    )
    assert all(row.estimate.identifiable != "no" for row in rows.values())


def test_report_and_parameter_set_are_written(made: Demonstration) -> None:
    page = made.report.read_text(encoding="utf-8")
    assert page.count("SIMULATED") > 10
    for words in (
        "Found against the simulator",
        "SIM-0003",
        "Velocity steps",
        "00001-motor_tare-SIM_0003",
    ):
        assert words in page
    assert made.report.stat().st_size < 5_000_000
    gear = load_gear(made.parameters)
    assert {o.provenance for p, o in gear.origins.items() if p.startswith("kinematic_error")} == {
        "identified"
    }


def test_json_and_people_get_the_same_story(
    made: Demonstration, capsys: pytest.CaptureFixture[str]
) -> None:
    found = json.loads(json_text(made.as_json()))
    assert [f["kind"] for f in found["fits"]] == list(demo.ORDER)
    assert found["compared"] == len(found["truth"]) > 20
    print_demonstration(made)
    shown = capsys.readouterr().out
    for words in (
        "SIMULATED",
        str(made.report),
        "measurand",
        "bench sees",
        "no verified limit",
    ):
        assert words in shown


def finished(protocol: str, outcome: str = "COMPLETED") -> Finished:
    result = friction_result() if outcome == "COMPLETED" else None
    return Finished(
        protocol=protocol,
        path=Path(f"{protocol}.h5"),
        outcome=outcome,
        message="because",
        result=result,
        stored="",
        seconds=1.0,
    )


def collected(*messages: Any, branches: int = 1) -> list[Finished]:
    box: queue.Queue[Any] = queue.Queue()
    for message in messages:
        box.put(message)
    return demo._collect(box, branches, lambda message: None)


def test_the_error_of_a_process_is_raised_here() -> None:
    error = RigError("no room", where="/disk")
    with pytest.raises(RigError, match="no room"):
        collected(Failed(error, str(error)), None)
    with pytest.raises(RuntimeError, match="Traceback of a defect"):
        collected(Failed(None, "Traceback of a defect"), None)


def test_a_process_that_dies_is_noticed() -> None:
    class Dead:
        exitcode = -9

    with pytest.raises(RigError, match="exit code -9"):
        demo._collect(queue.Queue(), 1, lambda message: None, [Dead()])


@pytest.mark.parametrize(
    ("outcome", "error"), [("ABORTED", KeyboardInterrupt), ("TRIPPED", RigError)]
)
def test_a_run_that_did_not_reach_its_end_ends_the_demonstration(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, outcome: str, error: type[BaseException]
) -> None:
    monkeypatch.setattr(
        demo,
        "_in_this_one",
        lambda order, show: [finished("motor-tare"), finished("friction", outcome)],
    )
    with pytest.raises(error):
        demonstrate(DemoOrder(tmp_path, 1, CREATED), processes=1)


def test_ctrl_c_stops_every_branch(tmp_path: Path) -> None:
    shared = demo._Local(1)
    box: queue.Queue[Any] = queue.Queue()
    begun = {name: threading.Event() for name in demo.ORDER}
    demo.work(demo.ORDER, DemoOrder(tmp_path, 1, CREATED), box, begun, shared)
    assert box.get_nowait() is None
    assert all(event.is_set() for event in begun.values())
    assert demo_work.SharedStop(shared).level == 1
    shared.value = 2
    assert demo_work.SharedStop(shared).level == 2


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_a_closed_terminal_and_a_request_to_end_are_a_stop_too() -> None:
    numbers = [signal.SIGINT, signal.SIGQUIT, signal.SIGTERM, signal.SIGHUP]
    before = [signal.getsignal(number) for number in numbers]
    for number in numbers:
        shared = demo._Local()
        with demo._ctrl_c(shared):
            signal.raise_signal(number)
        assert shared.value == 1
    assert [signal.getsignal(number) for number in numbers] == before


def test_a_stop_while_running_seals_the_run(tmp_path: Path) -> None:
    shared = demo._Local(0)
    box: queue.Queue[Any] = queue.Queue()

    class Press(dict[str, Any]):
        def __getitem__(self, name: str) -> Any:
            shared.value = 1
            return threading.Event()

    demo.work(("motor-tare",), DemoOrder(tmp_path, 1, CREATED, SHORT), box, Press(), shared)
    messages = [box.get_nowait() for _ in range(box.qsize())]
    done = next(m for m in messages if isinstance(m, Finished))
    assert done.outcome == "ABORTED"
    assert done.result is None
    assert done.path.is_file()
    assert messages[-1] is None


def test_an_error_crosses_from_a_process_as_what_it_was(tmp_path: Path) -> None:
    wrong = {"motor-tare": {"points": -1}, "kinematic-error": {"speed_rpm": -1.0}}
    with pytest.raises(PlanError, match="out of range"):
        demonstrate(DemoOrder(tmp_path, 1, CREATED, wrong), processes=2)
    assert not list(tmp_path.glob("*.h5"))
