"""A replay of another run than the one that is asked for: refused before anything seems to move, and no alarm."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from model.gear_file import save_gear, shipped_gear
from model.motor import shipped_motor
from rig import exits
from rig.bench.backends.order import AMBIENT, Order, WorldChoice
from rig.commands import ordering
from rig.errors import ConfigurationError
from rig.main import run as main
from rig.run.parts import Progress
from rig.run.start import plan_order, run_order
from rig.run.stop import StopRequest
from rig.runfile.read import read_run_header

VALUES = {"speeds_rpm": (900.0,), "measure_time": 0.2, "settle_time": 0.1, "zero_time": 0.5}


def request_of(folder: Path, backend: str = "sim", protocol: str = "motor-tare") -> Order:
    return Order(
        protocol=protocol,
        gear=shipped_gear(),
        motor=shipped_motor(),
        folder=folder,
        values=VALUES if protocol == "motor-tare" else {},
        backend=backend,
        seed=3,
    )


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    report = run_order(request_of(tmp_path_factory.mktemp("sim")))
    assert report.outcome == "COMPLETED"
    return report.path


def refusal(request: Order) -> ConfigurationError:
    """What the run is refused with; no file, no latch, nothing else is left in its folder."""
    with pytest.raises(ConfigurationError) as refused:
        run_order(request)
    assert not request.folder.exists() or not list(request.folder.iterdir())
    assert "emergency" not in str(refused.value).lower()
    assert refused.value.remedy
    return refused.value


def test_a_replay_is_planned_for_the_gear_of_its_file(recorded: Path, tmp_path: Path) -> None:
    """A gear of a wide population has another ratio than the one that is planned for by default."""
    world = WorldChoice(gear_seed=8052, population="wide", number=1, start_state=AMBIENT)
    of_its_own = replace(request_of(tmp_path), world=world)
    report = run_order(of_its_own)
    own = read_run_header(report.path).metadata.gear
    assert own is not None
    assert own.ratio != shipped_gear().ratio
    assert ordering.order_of("motor-tare", {}, {"backend": f"replay:{report.path}"}).gear == own
    said = {"backend": f"replay:{report.path}", "folder": tmp_path / "replayed"}
    replay = ordering.order_of("motor-tare", VALUES, said)
    assert run_order(replay).outcome == report.outcome
    given = tmp_path / "given.toml"
    save_gear(shipped_gear(), given)
    named = ordering.order_of("motor-tare", {}, {**said, "gear": given})
    assert named.gear.ratio == shipped_gear().ratio


@pytest.mark.parametrize("protocol", ["home", "kinematic-error", "friction"])
def test_another_protocol(recorded: Path, tmp_path: Path, protocol: str) -> None:
    refused = refusal(request_of(tmp_path, f"replay:{recorded}", protocol))
    assert refused.value == f"protocol {protocol} (recorded: motor-tare)"


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("speeds_rpm", (1200.0,), "speeds_rpm 1200 (recorded: 900)"),
        ("speeds_rpm", (900.0, 90.0), "speeds_rpm 900 90 (recorded: 900)"),
        ("measure_time", 0.4, "measure_time 0.4 (recorded: 0.2)"),
    ],
)
def test_other_parameters(
    recorded: Path, tmp_path: Path, name: str, value: object, words: str
) -> None:
    request = request_of(tmp_path, f"replay:{recorded}")
    assert refusal(replace(request, values={**VALUES, name: value})).value == words


def test_another_mounting_or_rate(recorded: Path, tmp_path: Path) -> None:
    request = request_of(tmp_path, f"replay:{recorded}")
    other = refusal(replace(request, mounting="flexspline-fixed", sample_rate=500.0))
    assert str(other.value).split(", ") == [
        "mounting flexspline-fixed (recorded: circular-spline-fixed)",
        "ratio 121 (recorded: 120)",
        "sync_rate 500 (recorded: 1000)",
    ]


def test_a_run_that_was_stopped(tmp_path: Path) -> None:
    stop = StopRequest()

    def in_motion(progress: Progress) -> None:
        if progress.speed:
            stop.stop()

    stopped = run_order(request_of(tmp_path / "sim"), stop=stop, on_progress=in_motion)
    assert stopped.outcome == "ABORTED"
    refused = refusal(request_of(tmp_path / "again", f"replay:{stopped.path}"))
    assert refused.value == "ABORTED"


def test_the_same_run_is_played(recorded: Path, tmp_path: Path) -> None:
    request = request_of(tmp_path, f"replay:{recorded}")
    assert run_order(request, plan_order(request)).outcome == "COMPLETED"


def test_as_people_type_it(
    recorded: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "runs"
    with pytest.raises(SystemExit) as end:
        main(["run", "home", "--backend", f"replay:{recorded}", "--output", str(output), "--json"])
    told = capsys.readouterr()
    assert end.value.code == exits.USAGE
    words = " ".join((told.out + told.err).split())
    assert "protocol home (recorded: motor-tare)" in words
    assert "EMERGENCY" not in words.upper()
    assert not list(output.glob("*"))
