"""A bench that learns its encoder: from runs to a sealed certificate, and into every later analysis."""

from __future__ import annotations

from dataclasses import replace
from datetime import date
from pathlib import Path

import numpy as np
import pytest

from experiments import catalogue
from model.gear_file import shipped_gear
from model.identify.encoder_curve import learnt_curve
from model.motor import shipped_motor
from model.units import ARCSEC, DEGREE
from rig.analysis.fit.recorded import Fit, store
from rig.analysis.fit.run import fit_run
from rig.analysis.in_force import in_force
from rig.analysis.learnt import is_known, learnt_files, with_learnt_curve
from rig.analysis.learnt_encoder import (
    Learnt,
    learn,
    observed,
    stated_angle,
    write_learnt,
)
from rig.bench.backends.order import Order, Setup, WorldChoice
from rig.bench.backends.simulated import parts_of
from rig.errors import ChangedRunError, ConfigurationError
from rig.gears.card import now_text
from rig.run.start import run_order
from rig.runfile.read import close_recording, open_run
from rig.runfile.seal import file_sha256
from sim_backend.drawing import bench_encoder
from tests.rig.commands.calling import Rig
from tests.rig.commands.printed import every_table_has_room

BENCH = 6
GEARS = 5
TODAY = date(2026, 3, 1)


def ordered(folder: Path, gear: int, **world: object) -> Order:
    chosen = WorldChoice(gear_seed=700 + gear, bench_seed=BENCH, mount=2, **world)  # type: ignore[arg-type]
    return Order(
        protocol="kinematic-error",
        gear=shipped_gear(),
        motor=shipped_motor(),
        folder=folder,
        serial=f"G-{gear}",
        operator="A",
        seed=BENCH,
        sample_rate=250.0,
        values=dict(catalogue.load("kinematic-error").short),
        world=chosen,
    )


def run(folder: Path, gear: int, **world: object) -> Path:
    path = run_order(ordered(folder, gear, **world), ask=lambda prompt: "done").path
    fit = fit_run(path)
    store(fit, now_text())
    close_recording(fit.recording)
    return path


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Five gears at 0, 72 ... degrees on one bench, and a sixth that teaches nothing."""
    folder = tmp_path_factory.mktemp("bench")
    return [run(folder, n, mount_turn=n * 72.0 * DEGREE) for n in range(GEARS)] + [run(folder, 9)]


@pytest.fixture(scope="module")
def learnt(runs: list[Path]) -> Learnt:
    return learn(runs[:GEARS])


def true_waves() -> np.ndarray:
    order = ordered(Path(), 0)
    parts = parts_of(order, Setup())
    errors = bench_encoder(parts["imperfections"], "output", parts["world"])
    found = np.zeros(8, dtype=np.complex128)
    for one in errors.series:
        if one.order <= 8:
            wave = complex(one.cosine, one.sine) * np.exp(-1j * one.order * errors.index_angle)
            found[int(one.order) - 1] += wave
    return found


def test_the_encoder_of_the_simulated_bench_is_found_inside_u(learnt: Learnt) -> None:
    assert (learnt.bench, learnt.curve.basis) == (str(BENCH), "population mean")
    true = true_waves()
    assert abs(true[0]) > 1.0 * ARCSEC
    for one in learnt.curve.orders:
        assert abs(one.wave - true[one.order - 1]) <= 1.3 * one.radius, one.order
    # What is found is the encoder and not its mirror image or another zero of its angle.
    fine = [place for place in range(4, 8) if abs(true[place]) > 0.1 * ARCSEC]
    assert fine
    for place in fine:
        assert abs(learnt.curve.orders[place].wave - true[place]) < 0.4 * abs(true[place])


def test_every_later_analysis_takes_it_and_one_that_taught_takes_the_others(
    runs: list[Path], learnt: Learnt, tmp_path: Path
) -> None:
    before = {path: accuracy(fit_run(path)) for path in (runs[0], runs[-1])}
    folder = runs[0].parent
    file = write_learnt(learnt, folder / "learnt-output-encoder-6.csv", TODAY, None)
    try:
        for path, u in before.items():
            fit = fit_run(path)
            assert fit.result.options["corrected_by_certificate"] == "output_angle"
            assert file_sha256(file) in str(fit.result.options["certificates"])
            assert accuracy(fit) < 0.75 * u
        (read,) = learnt_files(folder)
        own = curve_in(runs[0], folder)
        others = read.header.curve_without("G-0")
        assert others is not None
        assert own == others.waves.tolist()
        assert own != read.curve.waves.tolist()
        assert curve_in(runs[-1], folder) == read.curve.waves.tolist()
        assert len(read.header.runs) == GEARS
        # Another bench, another encoder, a curve past its day: as without.
        recording = open_run(runs[-1])
        signal = recording.signals["output_angle"]
        strange = replace(recording, signals={"output_angle": replace(signal, serial_number="X")})
        assert with_learnt_curve(strange, folder) is strange
        close_recording(recording)
        with pytest.raises(ConfigurationError, match="left alone"):
            write_learnt(learnt, file, TODAY, None)
        file.chmod(0o600)
        file.write_bytes(file.read_bytes().replace(b"0,", b"0,1", 1))
        with pytest.raises(ChangedRunError):
            fit_run(runs[-1])
    finally:
        for one in folder.glob("learnt-output-encoder*"):
            one.unlink()


def accuracy(fit: Fit) -> float:
    close_recording(fit.recording)
    return fit.result.estimates["transmission_accuracy_forward"].expanded_uncertainty


def curve_in(run: Path, folder: Path) -> list[list[float]]:
    recording = with_learnt_curve(open_run(run), folder)
    curve = recording.signals["output_angle"].calibration.curve
    close_recording(recording)
    assert curve is not None
    return curve.waves.tolist()  # type: ignore[no-any-return]


def test_what_a_curve_took_off_is_the_encoders_too_when_it_is_learnt_again(
    runs: list[Path], learnt: Learnt
) -> None:
    folder, run = runs[0].parent, runs[2]
    before = observed(run).mounted
    assert before is not None
    try:
        assert in_force(run, "kinematic-error").stale == ()
        write_learnt(learnt, folder / "learnt-output-encoder-6.csv", TODAY, None)
        (stale,) = in_force(run, "kinematic-error").stale
        assert stale == "the output encoder has been learnt since, or learnt anew"
        fit = fit_run(run)
        store(fit, now_text())
        assert in_force(run, "kinematic-error").stale == ()
        close_recording(fit.recording)
        again = observed(run).mounted
        assert again is not None
        # Orders 1 to 4: finer ones may have left the noise, or gone under in it.
        assert again.waves[:4] == pytest.approx(before.waves[:4], abs=0.05 * ARCSEC)
    finally:
        for one in folder.glob("learnt-output-encoder*"):
            one.unlink()
    assert "curve that is gone" in observed(run).skipped
    fit = fit_run(run)
    store(fit, now_text())
    close_recording(fit.recording)
    assert observed(run).skipped == ""


def test_a_curve_that_is_due_is_not_taken(runs: list[Path], learnt: Learnt) -> None:
    folder = runs[0].parent
    write_learnt(
        learnt, folder / "learnt-output-encoder-old.csv", date(2020, 1, 1), date(2020, 6, 1)
    )
    try:
        fit = fit_run(runs[-1])
        close_recording(fit.recording)
        assert "corrected_by_certificate" not in fit.result.options
    finally:
        for one in folder.glob("learnt-output-encoder*"):
            one.unlink()


def test_what_is_not_parted_is_told_and_never_written(
    runs: list[Path], learnt: Learnt, tmp_path: Path
) -> None:
    shared = learnt_curve([replace(one, angle=None) for one in learnt.mounted])
    assert not isinstance(shared, str)
    with pytest.raises(ConfigurationError, match="is no certificate"):
        write_learnt(replace(learnt, curve=shared), tmp_path / "x.csv", TODAY, None)
    assert list(tmp_path.iterdir()) == []


def test_an_encoder_that_could_be_exchanged_unseen_neither_learns_nor_takes(
    runs: list[Path], learnt: Learnt
) -> None:
    recording = open_run(runs[-1])
    metadata, encoder = recording.metadata, recording.signals["output_angle"]
    close_recording(recording)
    real = replace(metadata, origin="hardware", process={"bench": "HB-1"})
    assert is_known(metadata, encoder)
    assert not is_known(real, replace(encoder, serial_number=""))
    assert is_known(real, replace(encoder, serial_number="123"))
    assert not is_known(replace(real, process={}), replace(encoder, serial_number="123"))


def test_what_tells_nothing_is_said_by_its_reason(runs: list[Path], tmp_path: Path) -> None:
    path = run_order(ordered(tmp_path, 1), ask=lambda prompt: "done").path
    assert "no kinematic error of it is analysed" in observed(path).skipped
    with pytest.raises(ConfigurationError, match="hold no run"):
        learn([path])
    with pytest.raises(ConfigurationError, match="at least 5"):
        learn(runs[:2])


def test_runs_of_two_encoders_are_refused_by_the_run_from_which_on_it_is_another(
    runs: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = {run: observed(run) for run in runs[:GEARS]}
    slipped = np.exp(1j * np.arange(1, 9) * 20.0 * DEGREE)
    for run in runs[3:GEARS]:
        mounted = seen[run].mounted
        assert mounted is not None
        seen[run] = replace(seen[run], mounted=replace(mounted, waves=mounted.waves * slipped))
    monkeypatch.setattr("rig.analysis.learnt_encoder.observed", seen.get)
    with pytest.raises(ConfigurationError, match=r"two encoders.*00004-kinematic_error-G_3"):
        learn(reversed(runs[:GEARS]))


def test_the_angle_is_that_of_the_card_where_no_simulated_world_states_one(
    runs: list[Path],
) -> None:
    recording = open_run(runs[1])
    metadata = recording.metadata
    close_recording(recording)
    assert stated_angle(metadata) == pytest.approx(72.0 * DEGREE)
    bare = replace(metadata, process={}, conditions={"mounted_at_deg": 30.0})
    assert stated_angle(bare) == pytest.approx(30.0 * DEGREE)
    assert stated_angle(replace(bare, conditions={})) is None


def test_the_command_learns_shows_and_keeps_its_hands_off_with_dry_run(
    runs: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    rig, folder = Rig(capsys), runs[0].parent
    named = [str(path) for path in runs[:GEARS]]
    (told,) = rig.json("bench", "learn", *named, "--dry-run")["learnt"]
    assert told["of"] == "output encoder"
    assert (told["basis"], told["bench"], told["file"]) == ("population mean", str(BENCH), None)
    assert rig("bench", "show", "--runs", folder) == 2
    assert "rig bench learn" in rig.err
    assert rig("bench", "learn", *named, "--due", "soon") == 2
    try:
        with every_table_has_room():
            assert rig("bench", "learn", *named) == 0
        assert "population mean" in rig.out
        assert "Not traceable" in rig.out
        shown = rig.json("bench", "show", "--runs", folder)
        (one,) = shown["learnt"]
        assert (one["bench"], one["gears"]) == (str(BENCH), [f"G-{n}" for n in range(GEARS)])
        with every_table_has_room():
            assert rig("bench", "show", "--runs", folder) == 0
    finally:
        for file in folder.glob("learnt-output-encoder*"):
            file.unlink()
