"""A bench that learns its torque scale: from known inertias to a sealed file, and into every later analysis."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any

import pytest

from experiments.protocols.torque_scale.disc import disc_of
from experiments.tares.motor_heat import motor_heat
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig.analysis.fit.recorded import store
from rig.analysis.fit.run import fit_run
from rig.analysis.in_force import in_force
from rig.analysis.learnt import (
    SCALE_PREFIX,
    learnt_scales,
    scale_of,
    with_learnt,
    with_learnt_scale,
)
from rig.analysis.learnt_torque import LearntScale, learn_torque, write_scale
from rig.analysis.recompute import recompute
from rig.analysis.store import read_analyses
from rig.bench.backends.order import Order, WorldChoice
from rig.errors import ChangedRunError, ConfigurationError, RunFileError
from rig.gears.card import now_text
from rig.run.start import run_order
from rig.runfile.read import close_recording, open_run
from tests.rig.commands.calling import Rig
from tests.rig.commands.printed import every_table_has_room

BENCH, TODAY = 8, date(2026, 3, 1)
DISC = {"inertia": 2e-4, "inertia_uncertainty": 4e-7, "certificate": "balance 17"}
SHORT = {"repeats": 2, "zero_time": 0.5, "accelerations": (300.0, 450.0, 600.0)}
TARE = {"speeds_rpm": (500.0, 1000.0, 2000.0), "zero_time": 0.5, "measure_time": 0.2}


def run(
    folder: Path, protocol: str, backend: str = "sim", rate: float = 1000.0, **values: Any
) -> Path:
    order = Order(
        backend=backend,
        sample_rate=rate,
        protocol=protocol,
        gear=shipped_gear(),
        motor=shipped_motor(),
        folder=folder,
        serial="TARE",
        operator="A",
        seed=BENCH,
        values=values,
        world=WorldChoice(gear_seed=1, bench_seed=BENCH),
    )
    path = run_order(order, ask=lambda prompt: prompt.consent).path
    fit = fit_run(path)
    store(fit, now_text())
    close_recording(fit.recording)
    return path


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """The bare motor, the motor with a disc, and a tare of the same bench."""
    folder = tmp_path_factory.mktemp("bench")
    return [
        run(folder, "torque-scale", **SHORT),
        run(folder, "torque-scale", **SHORT, **DISC),
        run(folder, "motor-tare", **TARE),
    ]


@pytest.fixture(scope="module")
def learnt(runs: list[Path]) -> LearntScale:
    return learn_torque(runs[:2])


@pytest.fixture
def written(runs: list[Path], learnt: LearntScale) -> Iterator[Path]:
    path = runs[0].parent / f"{SCALE_PREFIX}-{BENCH}.toml"
    yield write_scale(learnt, path, TODAY, None)
    for one in path.parent.glob(f"{SCALE_PREFIX}*"):
        one.chmod(0o600)
        one.unlink()


def truth(path: Path) -> Any:
    recording = open_run(path, rows=False)
    close_recording(recording)
    return recording.metadata.process["truth"]


def test_gain_and_lag_of_the_simulated_bench_are_found_inside_u(
    runs: list[Path], learnt: LearntScale
) -> None:
    port = truth(runs[0])["torque_port"]
    gain = learnt.gains["torque"]
    assert abs(gain.value - (1.0 + port["scale_error"])) <= gain.expanded_uncertainty
    assert gain.expanded_uncertainty < 0.006
    lag, u = learnt.lags["torque"]
    assert abs(lag - port["lag"]) <= 2.0 * u
    rotor = truth(runs[0])["motor"]["rotor_inertia"]
    assert learnt.rotor_inertia == pytest.approx(rotor, rel=0.03)
    drive = learnt.gains["drive_torque"]
    true = 1.0 / (1.0 + truth(runs[0])["motor"]["torque_constant_error"])
    assert abs(drive.value - true) <= drive.expanded_uncertainty
    assert {line.source for line in gain.budget} >= {
        "scatter of the ramps",
        "inertia of the disc",
        "warmth of the motor",
        "linearity",
        "time base",
        "torque zero",
        "lag",
    }


def test_a_later_analysis_takes_the_scale_and_an_earlier_one_is_stale(
    runs: list[Path], learnt: LearntScale, written: Path
) -> None:
    tare, gain = runs[2], learnt.gains["torque"].value
    before = in_force(tare)
    assert before.analysis is not None
    assert "the torque scale has been learnt since, or learnt anew" in before.stale
    (file,) = learnt_scales(tare.parent)
    fit = fit_run(tare)
    close_recording(fit.recording)
    assert file.path in fit.result.options["torque_scale"]
    channel = fit.recording.signals["torque"]
    assert channel.calibration.temperature == pytest.approx(learnt.temperature)
    assert channel.calibration.scale_relative_uncertainty == pytest.approx(
        learnt.gains["torque"].standard_uncertainty / gain, rel=0.02
    )
    old, new = (
        before.analysis.result.estimates["motor_coulomb"],
        fit.result.estimates["motor_coulomb"],
    )
    # The lag is learnt with it, and what that makes of the cogging is taken off.
    assert new.value == pytest.approx(old.value / gain, rel=1e-5)
    scale = {line.source: line.standard_uncertainty for line in new.budget}["torque scale"]
    assert (
        scale
        < 0.3 * {line.source: line.standard_uncertainty for line in old.budget}["torque scale"]
    )
    store(fit, now_text())
    assert in_force(tare).stale == ()
    # Each is made again with what it took: the first with nothing, the second with the scale while it is there.
    first, second = read_analyses(tare)[0], read_analyses(tare)[-1]
    assert [recompute(tare, one).differing for one in (first, second)] == [(), ()]
    written.chmod(0o600)
    written.unlink()
    with pytest.raises(RunFileError, match="gone"):
        recompute(tare, second)
    assert recompute(tare, first).differing == ()


def test_the_drivers_turn_it_too(tmp_path: Path) -> None:
    """Over the bus, by an analogue speed reference: the gain lies inside U there as well."""
    quick = {**SHORT, "accelerations": (450.0, 520.0, 600.0), "dwell_time": 0.6}
    made = [
        run(tmp_path, "torque-scale", "wire-analog", 500.0, **quick, **disc) for disc in ({}, DISC)
    ]
    gain = learn_torque(made).gains["torque"]
    true = 1.0 + truth(made[0])["torque_port"]["scale_error"]
    assert abs(gain.value - true) <= gain.expanded_uncertainty


def test_what_is_not_its_own_takes_nothing(
    runs: list[Path], learnt: LearntScale, written: Path
) -> None:
    folder = written.parent
    itself, tare = (open_run(path, rows=False) for path in (runs[0], runs[2]))
    for one in (itself, tare):
        close_recording(one)
    assert with_learnt(itself, folder) is itself
    assert with_learnt_scale(tare, folder) is not tare
    process = tare.metadata.process
    for other in (
        {**process, "motor": "another"},
        {**process, "world": {**process["world"], "bench_seed": BENCH + 1}},
    ):
        strange = replace(tare, metadata=replace(tare.metadata, process=other))
        assert with_learnt_scale(strange, folder) is strange
    torque = replace(tare.signals["torque"], serial_number="exchanged")
    exchanged = replace(tare, signals={"torque": torque})
    assert with_learnt_scale(exchanged, folder) is exchanged
    # What a laboratory knows better stays.
    known = replace(
        tare.signals["torque"],
        calibration=replace(tare.signals["torque"].calibration, scale_relative_uncertainty=1e-3),
    )
    better = replace(tare, signals={"torque": known})
    assert with_learnt_scale(better, folder) is better
    assert motor_heat(
        with_learnt_scale(tare, folder), learnt.temperature
    ).reference == pytest.approx(learnt.temperature)
    write_scale(learnt, folder / f"{SCALE_PREFIX}-due.toml", date(2027, 1, 1), date(2000, 1, 1))
    written.chmod(0o600)
    written.unlink()
    assert with_learnt_scale(tare, folder) is tare


def test_without_a_thermometer_it_is_taken_and_named_all_the_same(
    runs: list[Path], learnt: LearntScale
) -> None:
    tare = open_run(runs[2], rows=False)
    close_recording(tare)
    path = runs[0].parent / f"{SCALE_PREFIX}-cold.toml"
    write_scale(replace(learnt, temperature=math.nan), path, TODAY, None)
    try:
        taken = with_learnt_scale(tare, path.parent)
        assert taken.signals["torque"].calibration.temperature is None
        assert path.name in scale_of(taken)
        assert scale_of(tare) == ""
        assert motor_heat(taken, 25.0).reference == 20.0
    finally:
        for one in path.parent.glob(f"{SCALE_PREFIX}*"):
            one.chmod(0o600)
            one.unlink()


def test_a_file_that_was_altered_is_refused(runs: list[Path], written: Path) -> None:
    written.chmod(0o600)
    written.write_bytes(
        written.read_bytes().replace(b"gain = 1", b"gain = 2").replace(b"gain = 0.9", b"gain = 0.8")
    )
    with pytest.raises(ChangedRunError):
        fit_run(runs[2])


def test_one_inertia_teaches_no_scale(runs: list[Path]) -> None:
    with pytest.raises(ConfigurationError, match="two inertias"):
        learn_torque(runs[:1])
    with pytest.raises(ConfigurationError, match="hold no run"):
        learn_torque(runs[2:])


def test_a_disc_that_was_not_mounted_is_refused(
    runs: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The bare motor twice, the second time said to have a disc."""

    def said(parameters: Any) -> Any:
        return disc_of({**parameters, **(DISC if next(turn) else {})})

    turn = iter([False, True])
    monkeypatch.setattr("rig.analysis.learnt_torque.disc_of", said)
    with pytest.raises(ConfigurationError, match="another inertia"):
        learn_torque([runs[0], runs[0]])


def test_the_command_learns_and_shows_it(
    runs: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    rig, folder = Rig(capsys), runs[0].parent
    (told,) = rig.json("bench", "learn", "--runs", folder, "--dry-run")["learnt"]
    assert (told["of"], told["file"]) == ("torque scale", None)
    assert math.isfinite(told["gains"]["torque"]["value"])
    written = folder / "scale.toml"
    try:
        with every_table_has_room():
            assert rig("bench", "learn", *map(str, runs[:2]), "--output", written) == 0
        assert "balance 17" in rig.out
        assert "lay it beside the runs as learnt-torque-scale" in rig.out
        assert rig("bench", "learn", *map(str, runs[:2]), "--output", written) == 2
        assert "exists already" in rig.err
        named = folder / f"{SCALE_PREFIX}-x.toml"
        assert rig("bench", "learn", "--runs", folder, "--output", named) == 0
        # What is learnt again on one day stands beside the first, and is the one that is taken.
        for _ in range(3):
            assert rig("bench", "learn", "--runs", folder) == 0
        today = sorted(folder.glob(f"{SCALE_PREFIX}-{BENCH}-*.toml"))
        assert len(today) == 3
        assert learnt_scales(folder)[0].path.endswith("-3.toml")
        for file in today:
            file.chmod(0o600)
            file.unlink()
        config = folder / "rig.toml"
        config.write_text('[alarms]\ngolden_gear = "TARE"\n')
        shown = rig.json("bench", "show", "--runs", folder, "--config", config)
        assert [one["of"] for one in shown["learnt"]] == [
            "scale of torque",
            "scale of drive_torque",
        ]
        assert [one["run"] for one in shown["tares"]] == ["00003-motor_tare-TARE"]
        assert shown["golden"]["changed"] is None
        assert rig("bench", "show", "--runs", folder) == 0
        assert "Motor tares" in rig.out
    finally:
        for file in (*folder.glob("scale.toml*"), *folder.glob(f"{SCALE_PREFIX}*")):
            file.chmod(0o600)
            file.unlink()
