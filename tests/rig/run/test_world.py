"""The simulated world of a run: what was left open, how warm it starts, and the same run once more."""

from __future__ import annotations

import dataclasses
import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from experiments.recording import Recording
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig.bench.backends import simulated
from rig.bench.backends.order import Order, StartState, WorldChoice
from rig.bench.backends.registry import HARDWARE
from rig.errors import ConfigurationError, RigError, RunFileError
from rig.library.folder import NUMBERS_FOLDER
from rig.run.repeat import repetition
from rig.run.start import plan_order, rig_for, run_order
from rig.run.world import start_state
from rig.runfile.prevailing import world_facts
from rig.runfile.read import close_recording, open_run

SHORT = {"positions": 2, "zero_time": 0.5}
WARM = {"at_most": 300.0, "tolerance": 1e-9, "window": 60.0, "zero_time": 0.5}
TARE = {
    "speeds_rpm": (900.0,),
    "repeats": 1,
    "measure_time": 0.2,
    "settle_time": 0.1,
    "zero_time": 0.5,
}


def request_of(folder: Path, protocol: str = "starting-torque", **changes: Any) -> Order:
    values = {"starting-torque": SHORT, "warm-up": WARM, "motor-tare": TARE}[protocol]
    return dataclasses.replace(
        Order(
            protocol=protocol,
            gear=shipped_gear(),
            motor=shipped_motor(),
            folder=folder,
            values=values,
            serial="G1",
            seed=5,
        ),
        **changes,
    )


def made(request: Order) -> Recording:
    """A run of this request, closed: its metadata and the path of its file."""
    report = run_order(request)
    recording = open_run(report.path)
    close_recording(recording)
    return recording


def path_of(recording: Recording) -> Path:
    return recording.source.path  # type: ignore[attr-defined]


def counts(recording: Recording) -> dict[str, bytes]:
    """Every channel as it was recorded."""
    opened = open_run(path_of(recording))
    kept = {name: opened.stored(name).tobytes() for name in opened.signals}
    close_recording(opened)
    return kept


def world(recording: Recording) -> Any:
    return recording.metadata.process["world"]


@pytest.fixture(scope="module")
def warm_folder(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Recording]:
    """A folder in which the rig was warmed up."""
    folder = tmp_path_factory.mktemp("warm")
    return folder, made(request_of(folder, "warm-up"))


def ended(recording: Recording) -> dict[str, float]:
    return recording.metadata.process["acquisition"]["thermal_state"]["end"]


def test_a_warm_up_warms_the_next_run_and_its_file_says_so(
    warm_folder: tuple[Path, Recording],
) -> None:
    folder, warmed = warm_folder
    assert world(warmed)["start"] == {"run": ""}
    room = warmed.metadata.process["truth"]["thermal"]["ambient"]
    assert ended(warmed)["housing"] > room + 0.5
    assert ended(warmed)["motor"] > room + 1.0
    after = made(request_of(folder))
    assert world(after)["start"] == {"run": warmed.metadata.run_id, **ended(warmed)}
    opened = open_run(path_of(after))
    housing = opened.si("housing_temperature", slice(0, 200)).mean()
    close_recording(opened)
    offset = after.metadata.process["truth"]["thermometer"]["housing_offset"]
    assert housing - offset == pytest.approx(ended(warmed)["housing"], abs=0.02)


@pytest.mark.parametrize(
    "another",
    [
        {"world": WorldChoice(gear_seed=8)},
        {"seed": 6},
        {"world": WorldChoice(mount=2)},
        {"world": WorldChoice(mount_turn=0.5)},
        {"world": WorldChoice(day=2)},
        {"world": WorldChoice(hours=10.0)},
        {"world": WorldChoice(version=1)},
        {"world": WorldChoice(start_state="ambient")},
    ],
    ids=["gear", "bench", "mounting", "turned", "day", "hours", "older", "ambient"],
)
def test_another_gear_bench_mounting_or_day_starts_as_the_room(
    warm_folder: tuple[Path, Recording], another: dict[str, Any]
) -> None:
    assert world(made(request_of(warm_folder[0], **another)))["start"] == {"run": ""}


def test_a_start_state_is_named_by_number_or_by_file(
    warm_folder: tuple[Path, Recording], tmp_path: Path
) -> None:
    folder, warmed = warm_folder
    expected = {"run": warmed.metadata.run_id, **ended(warmed)}
    for word, output in (("1", folder), (str(path_of(warmed)), tmp_path)):
        choice = WorldChoice(start_state=word, day=3)
        assert world(made(request_of(output, world=choice)))["start"] == expected
    with pytest.raises(RunFileError, match="names no run"):
        made(request_of(folder, world=WorldChoice(start_state="77")))
    with pytest.raises(ConfigurationError, match="another gear or bench") as refused:
        made(request_of(folder, world=WorldChoice(start_state="1", gear_seed=8)))
    assert (refused.value.where, refused.value.value) == ("--world start-state", "1")


def test_the_highest_sealed_run_counts_and_one_that_cannot_be_read_is_passed_over(
    tmp_path: Path,
) -> None:
    first, second = (made(request_of(tmp_path)) for _ in range(2))
    growing = path_of(second).with_name("00003-friction-G1.h5.part")
    growing.write_bytes(path_of(second).read_bytes())
    (tmp_path / "00004-friction-G1.h5").write_bytes(b"no run")
    third = made(request_of(tmp_path))
    assert world(second)["start"]["run"] == first.metadata.run_id
    assert world(third)["start"]["run"] == second.metadata.run_id
    assert world(third)["number"] == 5


def test_a_run_from_before_worlds_had_names_has_no_start_state(tmp_path: Path) -> None:
    old = Path(__file__).parents[2] / "data" / "0.1.0" / "runs" / "00001-home-SN_010.h5"
    with pytest.raises(ConfigurationError, match="no temperatures"):
        made(request_of(tmp_path, world=WorldChoice(start_state=str(old))))
    with pytest.raises(ConfigurationError, match="cannot be made again"):
        repetition(old, request_of(tmp_path))


@pytest.mark.parametrize("backend", ["sim", "wire"])
def test_a_repeated_run_has_the_same_counts_whatever_was_run_in_between(
    backend: str, warm_folder: tuple[Path, Recording], tmp_path: Path
) -> None:
    chosen = WorldChoice(mount=3, mount_turn=0.3, day=4, start_state=str(path_of(warm_folder[1])))
    original = made(request_of(tmp_path, "motor-tare", backend=backend, world=chosen))
    following = made(request_of(tmp_path, "motor-tare", backend=backend, world=chosen))
    made(request_of(tmp_path, world=chosen))
    plain = Order(protocol="", gear=shipped_gear(), motor=shipped_motor(), folder=tmp_path)
    request, warning = repetition(path_of(original), plain)
    again = made(request)
    assert warning == ""
    assert counts(again) == counts(original)
    assert counts(again)["torque"] != counts(following)["torque"]
    assert again.metadata.parameters == original.metadata.parameters
    assert path_of(again) != path_of(original)
    assert world(again) == {**world(original), "repeats": original.metadata.run_id}


def test_a_run_of_0_2_0_is_made_again_in_its_world_as_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its file names neither hours nor a version of the draws."""

    def as_written(request: Any) -> dict[str, Any]:
        record = whole(request)
        added = ("version", "hours", "day_correlation")
        return {name: value for name, value in record.items() if name not in added}

    older = WorldChoice(version=1, mount=2, mount_turn=0.3, population="wide", gear_seed=4)
    with monkeypatch.context() as before:
        whole = simulated.world_record
        before.setattr(simulated, "world_record", as_written)
        original = made(request_of(tmp_path, "motor-tare", world=older))
    assert "version" not in world(original)
    again = made(repetition(path_of(original), request_of(tmp_path))[0])
    assert counts(again) == counts(original)
    assert world(again)["version"] == 1
    newer = made(
        request_of(tmp_path, "motor-tare", world=dataclasses.replace(older, version=2, number=1))
    )
    assert counts(newer) != counts(original)
    (told,) = world_facts(world(original))
    assert "mounting 2 turned by 17.1887 deg, day 1, number 1, wide population" in told.text
    # Nothing of its warmth is there for a bench of the newer draws.
    assert world(newer)["start"] == {"run": ""}


def test_a_repeated_run_of_the_wide_population_has_its_gear_and_its_card(tmp_path: Path) -> None:
    chosen = WorldChoice(population="wide", gear_seed=4, bench_seed=9)
    original = made(request_of(tmp_path, "motor-tare", world=chosen))
    again = made(repetition(path_of(original), request_of(tmp_path))[0])
    assert counts(again) == counts(original)
    assert again.metadata.gear == original.metadata.gear


def test_plan_and_file_have_the_card_and_the_truth_stands_in_the_truth_alone(
    tmp_path: Path,
) -> None:
    choice = WorldChoice(population="wide", gear_seed=4, bench_seed=9)
    request = request_of(tmp_path, "motor-tare", world=choice)
    planned, recording = plan_order(request), made(request)
    card, metadata = recording.metadata.gear, recording.metadata
    assert card == planned.gear
    assert card is not None
    assert card.ratio != shipped_gear().ratio
    assert metadata.ratio == card.ratio
    # Nominal friction stands on every card.
    assert card.mesh_friction == shipped_gear().mesh_friction
    inertia = rig_for(request, planned).port._plant.loop.gear.inertia.output  # type: ignore[attr-defined]
    said = json.dumps({name: v for name, v in metadata.process.items() if name != "truth"})
    assert card.inertia.output != inertia
    assert repr(inertia) not in said


def test_a_changed_run_is_not_repeated(tmp_path: Path) -> None:
    path = path_of(made(request_of(tmp_path, "motor-tare")))
    path.chmod(0o644)
    content = path.read_bytes()
    path.write_bytes(content.replace(b'"mount": 1', b'"mount": 2'))
    assert path.read_bytes() != content
    with pytest.raises(RunFileError):
        repetition(path, request_of(tmp_path))


def test_limits_of_another_configuration_are_no_repetition(tmp_path: Path) -> None:
    original = made(request_of(tmp_path, "motor-tare"))
    limited = request_of(tmp_path, limits={"motor_torque": 0.3})
    with pytest.raises(ConfigurationError, match="limits are not those"):
        repetition(path_of(original), limited)


def test_a_number_is_taken_before_the_rig_is_made_and_given_back_where_nothing_came_of_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from rig.run import start

    seen = []

    def failing(request: Order, planned: object) -> Any:
        seen.append(request.world.number)
        # Another process that begins now has the next one.
        seen.append(start.claim_run(tmp_path, "friction", "G2").number)
        raise RigError("no rig today")

    monkeypatch.setattr(start, "rig_for", failing)
    with pytest.raises(RigError, match="no rig today"):
        run_order(request_of(tmp_path))
    monkeypatch.undo()
    assert seen == [1, 2]
    assert sorted(path.name for path in (tmp_path / NUMBERS_FOLDER).iterdir()) == ["00002"]
    recording = made(request_of(tmp_path))
    assert world(recording)["number"] == 3
    assert recording.metadata.run_id.startswith("00003-")


@pytest.mark.parametrize("backend", [HARDWARE, "replay:run.h5"])
@pytest.mark.parametrize(
    ("choice", "flag"),
    [
        (WorldChoice(gear_seed=1), "--world gear-seed"),
        (WorldChoice(mount_turn=0.1), "--world mount-turn-deg"),
        (WorldChoice(start_state="ambient"), "--world start-state"),
        (WorldChoice(population="wide"), "--world population"),
    ],
)
def test_only_a_simulated_rig_has_a_world(
    tmp_path: Path, backend: str, choice: WorldChoice, flag: str
) -> None:
    with pytest.raises(ConfigurationError, match="only a simulated rig") as refused:
        plan_order(request_of(tmp_path, backend=backend, world=choice))
    assert refused.value.where == flag
    assert refused.value.remedy


def test_a_start_state_that_is_given_is_not_looked_for(tmp_path: Path) -> None:
    made(request_of(tmp_path))
    warm = StartState("elsewhere", {"housing": 30.0, "motor": 33.0})
    choice = WorldChoice(start=warm, start_state="77")
    assert world(made(request_of(tmp_path, world=choice)))["start"] == {
        "run": "elsewhere",
        "housing": 30.0,
        "motor": 33.0,
    }


def test_a_run_that_another_has_replaced_is_read_again(
    warm_folder: tuple[Path, Recording], tmp_path: Path
) -> None:
    _, warmed = warm_folder
    known = world(warmed)
    place = tmp_path / path_of(warmed).name
    shutil.copy(path_of(warmed), place)
    assert start_state(tmp_path, "auto", known).temperatures == ended(warmed)
    place.chmod(0o644)
    place.write_bytes(b"no run any more")
    assert start_state(tmp_path, "auto", known) == StartState()
