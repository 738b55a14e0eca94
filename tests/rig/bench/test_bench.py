"""The bench: an identity that is drawn once, and a state folder in which its trips are latched."""

from __future__ import annotations

import json
import re
from importlib import resources
from pathlib import Path

import platformdirs
import pytest
from typer.testing import CliRunner

from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig.bench.backends import hardware
from rig.bench.backends.order import Order
from rig.bench.backends.registry import HARDWARE
from rig.bench.backends.serving import Served, description_of
from rig.bench.config.load import inspect_configuration, load_configuration
from rig.bench.identity import ALPHABET, bench_of, new_bench_id
from rig.bench.state import VARIABLE, state_places
from rig.errors import ConfigurationError
from rig.main import app
from rig.run.latch import HISTORY_NAME, LatchedTrip, LatchedTripError, TripLatch, latch_of
from rig.run.start import run_order
from rig.runfile.read import close_recording, open_run
from rig.trial.doctor.surroundings import bench_lines

TEMPLATE = resources.files("rig.bench.config").joinpath("template.toml").read_text(encoding="utf-8")
TRIP = LatchedTrip("over_speed", "00007-friction-G1", "2026-01-02T03:04:05+00:00", "too fast", True)
NOBODY: dict[str, str] = {}
"""An environment in which no other place is named."""


@pytest.fixture
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where the state of benches lies in this test."""
    folder = tmp_path / "state"
    monkeypatch.setenv(VARIABLE, str(folder))
    return folder


def described(folder: Path, identity: str) -> Path:
    path = folder / "rig.toml"
    path.write_text(TEMPLATE.replace('id = ""', f'id = "{identity}"'), encoding="utf-8")
    return path


def armed(folder: Path, description: Path) -> Order:
    return Order(
        protocol="home",
        gear=shipped_gear(),
        motor=shipped_motor(),
        folder=folder / "runs",
        backend=HARDWARE,
        operator="A. Example",
        serial="SN-1",
        config=description,
    )


def refused(request: Order, monkeypatch: pytest.MonkeyPatch) -> ConfigurationError:
    """The refusal of a run on hardware, by which nothing has been opened or written."""

    def opened(*_: object) -> None:
        raise AssertionError("the bus was opened")

    monkeypatch.setattr(hardware, "open_raw_bus", opened)
    with pytest.raises(ConfigurationError) as caught:
        run_order(request, confirmation="SN-1")
    assert not request.folder.exists()
    return caught.value


# --- identity


def test_an_identity_is_readable_and_drawn_anew_each_time() -> None:
    drawn = {new_bench_id() for _ in range(100)}
    assert len(drawn) == 100
    assert all(re.fullmatch(f"[{ALPHABET}]{{4}}-[{ALPHABET}]{{4}}", one) for one in drawn)
    assert new_bench_id(lambda letters: letters[0]) == "2222-2222"


def test_a_new_description_has_an_identity_of_its_own(tmp_path: Path) -> None:
    found = set()
    for name in ("one.toml", "two.toml"):
        path = tmp_path / name
        made = CliRunner().invoke(app, ["config", "new", str(path)])
        assert made.exit_code == 0
        for told in (made.output, path.read_text(encoding="utf-8")):
            # Without the backend the doctor asks the simulated rig.
            assert "`rig doctor --backend hardware --config" in told
        found.add(load_configuration(path).bench.id)
    assert len(found) == 2
    assert all(re.fullmatch(f"[{ALPHABET}-]{{9}}", identity) for identity in found)


def test_a_description_that_exists_keeps_its_identity(tmp_path: Path) -> None:
    path = described(tmp_path, "bench-1")
    assert CliRunner().invoke(app, ["config", "new", str(path)]).exit_code != 0
    assert load_configuration(path).bench.id == "bench-1"


@pytest.mark.parametrize("identity", ["..", "a/b", "a b", "-", "A", "a" * 65, "a\\\\b"])
def test_an_identity_that_could_be_no_folder_is_refused(tmp_path: Path, identity: str) -> None:
    problems = inspect_configuration(described(tmp_path, identity))
    assert isinstance(problems, tuple)
    assert [problem.what for problem in problems] == ["bench.id"]


def test_a_check_of_a_description_of_before_says_that_the_identity_is_missing(
    tmp_path: Path,
) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(re.sub(r"\[bench\]\nid.*\n", "", TEMPLATE), encoding="utf-8")
    done = CliRunner().invoke(app, ["config", "check", str(path), "--json"])
    assert done.exit_code == 0
    assert any("[bench] id" in warning for warning in json.loads(done.stdout)["warnings"])
    named = CliRunner().invoke(app, ["config", "check", str(described(tmp_path, "b")), "--json"])
    assert not any("[bench]" in warning for warning in json.loads(named.stdout)["warnings"])


def test_a_hub_is_the_bench_at_its_address_whatever_its_description_calls_it(
    tmp_path: Path, state: Path
) -> None:
    request = Order(protocol="", seed=7)
    path, runs = tmp_path / "rig.toml", tmp_path / "runs"
    served = description_of(Served("127.0.0.1", 29536, "can0", "", {}, ""), request)
    for text in (
        served,
        served.replace('id = "hub-127-0-0-1-29536-can0"', 'id = "another-name"'),
        served.replace("127.0.0.1", "localhost"),
        re.sub(r"\[bench\]\nid.*\n", "", served),
    ):
        path.write_text(text)
        bench = bench_of(HARDWARE, runs, path)
        assert bench.id == "hub-127-0-0-1-29536-can0"
        assert (bench.state, bench.has_one_master) == (state / "benches" / bench.id, True)
    assert load_configuration(path).bench.id == ""
    path.write_text(served.replace("29536", "29537"))
    assert bench_of(HARDWARE, runs, path).id != bench.id


def test_the_state_of_a_hub_is_the_user_s(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.setattr(platformdirs, "site_state_path", lambda *_, **__: tmp_path / "site")
    monkeypatch.setattr(platformdirs, "user_state_path", lambda *_, **__: tmp_path / "user")
    request = Order(protocol="")
    path = tmp_path / "rig.toml"
    path.write_text(description_of(Served("127.0.0.1", 29536, "can0", "", {}, ""), request))
    bench = bench_of(HARDWARE, tmp_path / "runs", path)
    assert (bench.scope, bench.state.parts[-3]) == ("hub", "user")
    assert not (tmp_path / "site").exists()


# --- the state folder


def test_a_simulated_bench_is_its_seed_and_its_folder_of_runs(tmp_path: Path) -> None:
    for backend in ("sim", "wire"):
        bench = bench_of(backend, tmp_path, seed=5)
        assert (bench.id, bench.state, bench.elsewhere) == ("5", tmp_path, ())
    replay = bench_of("replay:run.h5", tmp_path)
    assert (replay.id, replay.state) == ("", tmp_path)


def test_a_bench_of_hardware_has_a_folder_outside_the_runs(tmp_path: Path, state: Path) -> None:
    bench = bench_of(HARDWARE, tmp_path / "runs", described(tmp_path, "bench-1"))
    assert (bench.id, bench.state) == ("bench-1", state / "benches" / "bench-1")
    assert bench.state.is_dir()
    assert bench.elsewhere == (tmp_path / "runs",)
    assert not (tmp_path / "runs").exists()


def test_the_site_s_place_comes_first_then_the_user_s(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    site, user = tmp_path / "site", tmp_path / "user"
    monkeypatch.setattr(platformdirs, "site_state_path", lambda *_, **__: site)
    monkeypatch.setattr(platformdirs, "user_state_path", lambda *_, **__: user)
    own = Path("benches", "b")
    assert state_places("b", NOBODY) == [("site", site / own), ("user", user / own)]
    (tmp_path / "taken").write_text("a file where the site's folder would be")
    site = tmp_path / "taken"
    assert state_places("b", NOBODY) == [("user", user / own), ("site", site / own)]
    user = site
    with pytest.raises(ConfigurationError) as caught:
        state_places("b", NOBODY)
    assert caught.value.where == "bench b"
    assert str(caught.value.value).count(str(site / own)) == 2
    assert caught.value.limit
    assert str(site / own) in caught.value.remedy


# --- a run on hardware


def test_a_run_without_an_identity_is_refused_before_anything_is_opened(
    tmp_path: Path, state: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = described(tmp_path, "")
    error = refused(armed(tmp_path, path), monkeypatch)
    assert (error.where, error.value) == (str(path), "no [bench] id")
    assert error.limit
    suggested = re.search(r'id = "(.*?)"', error.remedy)
    assert suggested is not None
    assert load_configuration(described(tmp_path, suggested[1])).bench.id == suggested[1]


def test_a_run_without_a_state_folder_is_refused_before_anything_is_opened(
    tmp_path: Path, state: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    state.write_text("a file where a folder should be")
    error = refused(armed(tmp_path, described(tmp_path, "bench-1")), monkeypatch)
    assert "bench-1" in str(error.where)
    assert str(state) in str(error.value)
    assert "writable" in error.remedy


def test_a_trip_of_the_bench_refuses_runs_of_every_folder_until_it_is_acknowledged(
    tmp_path: Path, state: Path
) -> None:
    path = described(tmp_path, "bench-1")
    latch = latch_of(bench_of(HARDWARE, tmp_path / "runs", path))
    latch.leave(TRIP)
    assert latch.path == state / "benches" / "bench-1" / ".tripped.json"
    for folder in ("today", "tomorrow"):
        with pytest.raises(LatchedTripError, match=re.escape(f"--operator NAME --config {path}")):
            run_order(armed(tmp_path / folder, path), confirmation="SN-1")
    words = ["acknowledge", "--operator", "Ada", "--config", str(path)]
    assert CliRunner().invoke(app, words).exit_code == 0
    assert latch.read() is None
    assert "Ada" in (latch.folder / HISTORY_NAME).read_text()


def test_the_latch_that_version_0_1_0_left_beside_the_runs_still_holds(
    tmp_path: Path, state: Path
) -> None:
    path, runs = described(tmp_path, "bench-1"), tmp_path / "runs"
    TripLatch(runs).leave(TRIP)
    with pytest.raises(LatchedTripError, match=r"over_speed in run 00007-friction-G1"):
        run_order(armed(tmp_path, path), confirmation="SN-1")
    words = ["acknowledge", "--operator", "Ada", "--config", str(path), "--output", str(runs)]
    assert CliRunner().invoke(app, words).exit_code == 0
    assert not TripLatch(runs).path.exists()
    assert (runs / HISTORY_NAME).exists()


def test_the_bench_s_own_trip_is_told_before_one_that_lies_elsewhere(tmp_path: Path) -> None:
    here, there = TripLatch(tmp_path / "here", (tmp_path / "there",)), TripLatch(tmp_path / "there")
    there.leave(TRIP)
    assert here.read() == TRIP
    own = LatchedTrip("bus_lost", "later", "", "", False)
    here.leave(own)
    assert here.read() == own
    assert here.acknowledge("Ada", "now") == own
    assert here.acknowledge("Ada", "now") == TRIP
    assert here.read() is None


# --- what is shown of it


def test_the_doctor_shows_bench_and_state_folder(
    tmp_path: Path, state: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    request = armed(tmp_path, described(tmp_path, "bench-1"))
    identity, folder = bench_lines(request)
    assert (identity.severity, identity.found) == ("passed", "bench-1")
    assert folder.severity == "passed"
    assert str(state / "benches" / "bench-1") in folder.found
    assert "writable" in folder.found
    monkeypatch.delenv(VARIABLE)
    monkeypatch.setattr(platformdirs, "site_state_path", lambda *_, **__: Path(__file__))
    monkeypatch.setattr(platformdirs, "user_state_path", lambda *_, **__: tmp_path / "user")
    _, folder = bench_lines(request)
    assert folder.severity == "warns"
    assert str(tmp_path / "user") in folder.found
    assert __file__ in folder.remedy
    monkeypatch.setattr(platformdirs, "user_state_path", lambda *_, **__: Path(__file__))
    (line,) = bench_lines(request)
    assert line.severity == "blocks"
    assert line.remedy
    (line,) = bench_lines(armed(tmp_path, described(tmp_path, "")))
    assert (line.where, line.severity) == ("bench", "blocks")
    assert "[bench]" in line.remedy


def test_the_doctor_of_a_simulated_rig_names_seed_and_runs(tmp_path: Path) -> None:
    words = ["doctor", "--no-move", "--json", "--seed", "4", "--output", str(tmp_path)]
    checks = json.loads(CliRunner().invoke(app, words).stdout)["checks"]
    evidence = {check["name"]: check["evidence"] for check in checks if check["group"] == "bench"}
    assert "seed 4" in evidence["identity"]
    assert str(tmp_path) in evidence["state folder"]


def test_the_run_file_names_the_bench(tmp_path: Path) -> None:
    request = Order(
        protocol="starting-torque",
        gear=shipped_gear(),
        motor=shipped_motor(),
        folder=tmp_path,
        seed=3,
    )
    report = run_order(request)
    recording = open_run(report.path)
    assert recording.metadata.process["bench"] == "3"
    close_recording(recording)
