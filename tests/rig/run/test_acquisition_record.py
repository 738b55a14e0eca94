"""How well a run was acquired: in the file, read back, shown, and asked for on the command line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from experiments.errors import AnalysisError
from experiments.steps.vocabulary import HoldTime, Ramp
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig.analysis.fit.run import Choices
from rig.bench.backends.order import Order
from rig.errors import RunFileError
from rig.run.dry_run import plan_run
from rig.run.opening import begin_inline_run, begin_threaded_run
from rig.run.session import execute
from rig.run.start import run_order
from rig.runfile.closing import LONGEST_ACQUISITION, acquisition_text
from rig.runfile.prevailing import acquisition_facts
from rig.runfile.read import close_recording, open_run, read_run_header
from rig.runfile.recover import recover_run
from rig.runfile.write import RunWriter
from rig.trial.drill.protocol import EXPERIMENT, DrillParameters
from rig.trial.drill.suite import reference_run
from tests.rig.fake_rig import INCOMPLETE, FakeRig, parts_of, planned_of
from tests.rig.fitting import fit_files
from tests.rig.runfile.making import block, header

STEPS = (Ramp(20.0, 500.0), HoldTime(0.4), Ramp(-20.0, 500.0), HoldTime(0.4), Ramp(0.0, 500.0))


def acquisition_of(path: Path) -> dict[str, Any]:
    recording = open_run(path, verify=True)
    try:
        return recording.metadata.process["acquisition"]
    finally:
        close_recording(recording)


@pytest.mark.parametrize("begin", [begin_inline_run, begin_threaded_run])
def test_a_run_keeps_the_figures_of_its_acquisition(begin: Any, tmp_path: Path) -> None:
    rig = FakeRig(
        script={
            600: lambda r: setattr(r.physics, "flags", INCOMPLETE),
            602: lambda r: setattr(r.physics, "flags", 0),
        }
    )
    report = execute(parts_of(planned_of(*STEPS), rig, tmp_path), begin)
    found = acquisition_of(report.path)
    assert found["cycles"] == report.rows
    assert found["achieved_rate"] == pytest.approx(1000.0)
    assert found["jitter_max"] == 0.0
    assert found["incomplete"] == 2
    assert found["missed_share"] == pytest.approx(2 / report.rows)
    assert found["torque_port_against_drive"]["slope"] == pytest.approx(1.0, abs=0.02)
    assert found["skew"]["encoder_skew"]["identifiability"] == "no"
    assert report.metrics["acquisition_achieved_rate"] == pytest.approx(1000.0)
    header_again = read_run_header(report.path)
    assert "acquisition" not in header_again.metadata.process


def test_a_run_carries_the_benchs_output_bearing(tmp_path: Path) -> None:
    known = {"coulomb": 0.48, "coulomb_u": 0.04, "source": "spun with a cord"}
    report = execute(
        parts_of(planned_of(*STEPS), FakeRig(), tmp_path, said={"output_bearing": known}),
        begin_inline_run,
    )
    assert read_run_header(report.path).metadata.process["output_bearing"] == known


def test_the_wire_tells_its_own_figures(tmp_path: Path) -> None:
    planned = plan_run(EXPERIMENT, DrillParameters(), shipped_gear(), shipped_motor())
    reference_run(planned, "wire", 0, tmp_path)
    found = acquisition_of(next(tmp_path.glob("*.h5")))
    assert found["latency_p50"] >= 0.0
    assert found["index_marks"]["input_angle"]["marks"] > 1
    assert found["index_marks"]["input_angle"]["worst_excess"] == 0
    assert {"encoder_skew", "torque_skew"} == set(found["skew"])
    process = read_run_header(next(tmp_path.glob("*.h5"))).metadata.process
    assert process["speed_mode"] == "cyclic velocity"


def test_the_share_of_missed_cycles_is_asked_for(tmp_path: Path) -> None:
    values = {"points": 6, "highest_rpm": 1200.0, "lowest_rpm": 5.0, "up_and_down": False}
    report = run_order(
        Order(
            protocol="friction",
            gear=shipped_gear(),
            motor=shipped_motor(),
            folder=tmp_path,
            values=values,
            seed=5,
        ),
    )
    with pytest.raises(AnalysisError, match="largest-missed-share"):
        _spoil(report.path, tmp_path)
    fit = _spoil(report.path, tmp_path, 0.5)
    assert fit.result.options["largest_missed_share"] == 0.5
    assert any("are incomplete and were left out" in text for text in fit.result.warnings)


def _spoil(path: Path, folder: Path, share: float | None = None) -> Any:
    """Analyse a copy of a run in which a tenth of the cycles is incomplete."""
    copy = folder / "copy" / path.name
    if not copy.exists():
        copy.parent.mkdir()
        recording = open_run(path)
        writer = RunWriter(copy, read_run_header(path))
        source = recording.source
        flags = recording.flags().copy()
        flags[::10] |= INCOMPLETE
        names = list(recording.signals)
        rows = recording.rows
        writer.append_rows(
            source.time_ns(0, rows),
            source.cycles(0, rows),
            flags,
            [source.stored(n, 0, rows) for n in names],  # type: ignore[attr-defined]
        )
        for segment in recording.segments:
            writer.segment(segment)
        writer.seal("COMPLETED")
        close_recording(recording)
    return fit_files([copy], largest_missed_share=share)[0]


def test_the_command_line_passes_the_share_on(monkeypatch: pytest.MonkeyPatch) -> None:
    import typer

    from rig.commands import analysis

    seen: list[Any] = []

    def fit_nothing(path: Path, kind: str, choices: Choices) -> Any:
        seen.append(choices.largest_missed_share)
        raise AnalysisError("enough", where="test")

    monkeypatch.setattr("rig.analysis.fit.run.fit_run", fit_nothing)
    app = typer.Typer()
    app.command()(analysis.fit)
    runner = CliRunner()
    for words in (["--largest-missed-share", "0.02"], []):
        assert isinstance(runner.invoke(app, ["RUN.h5", *words]).exception, AnalysisError)
    assert seen == [0.02, None]
    assert runner.invoke(app, ["RUN.h5", "--largest-missed-share", "2"]).exit_code == 2


def test_a_file_without_figures_is_read_and_a_dead_one_has_none(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path / "00001-friction-A1.h5", header(), chunk_rows=64)
    writer.append(block(0, 100))
    writer.flush()
    writer.abandon()
    recovered = recover_run(writer.part)
    recording = open_run(recovered.path)
    assert "acquisition" not in recording.metadata.process
    assert recording.metadata.outcome == "INTERRUPTED"
    close_recording(recording)


def test_a_file_of_the_format_before_is_read(tmp_path: Path) -> None:
    import h5py

    writer = RunWriter(tmp_path / "00001-friction-A1.h5", header(), chunk_rows=64)
    writer.append(block(0, 100))
    path = writer.seal("COMPLETED")
    path.chmod(0o600)
    with h5py.File(path, "r+") as file:
        del file["entry/process/acquisition"]
        file.attrs["file_format_version"] = b"1.0"
    recording = open_run(path, digest=False)
    assert recording.metadata.outcome == "COMPLETED"
    assert "acquisition" not in recording.metadata.process
    close_recording(recording)


def test_figures_that_were_changed_are_seen(tmp_path: Path) -> None:
    import h5py

    writer = RunWriter(tmp_path / "00001-friction-A1.h5", header(), chunk_rows=64)
    writer.append(block(0, 100))
    path = writer.seal("COMPLETED", acquisition={"missed_share": 0.25})
    assert acquisition_of(path) == {"missed_share": 0.25}
    path.chmod(0o600)
    with h5py.File(path, "r+") as file:
        file["entry/process/acquisition"][()] = json.dumps({"missed_share": 0.0}).encode()  # type: ignore[index]
    with pytest.raises(RunFileError, match="not what was written"):
        open_run(path, digest=False)


def test_too_many_figures_leave_the_largest_out_by_name() -> None:
    long = {"small": 1, "huge": {str(k): k for k in range(5000)}, "text": "µ" * 100}
    text = acquisition_text(long)
    assert len(text.encode()) <= LONGEST_ACQUISITION
    assert json.loads(text) == {"small": 1, "text": "µ" * 100, "left_out": ["huge"]}
    assert acquisition_text({}) == ""


def test_the_figures_in_words() -> None:
    figures = {
        "achieved_rate": 999.98,
        "jitter_rms": 2.1e-5,
        "jitter_max": 1e-4,
        "missed_share": 0.002,
        "index_marks": {"output_angle": {"marks": 2, "worst_excess": -7}},
        "torque_port_against_drive": {"slope": 1.01, "offset": 0.0106},
        "skew": {
            "encoder_skew": {
                "value": 9e-6,
                "expanded_uncertainty": 2e-5,
                "identifiability": "weakly",
                "note": "why",
            },
            "torque_skew": {
                "value": None,
                "expanded_uncertainty": None,
                "identifiability": "no",
                "note": "too steady",
            },
        },
    }
    facts = [(fact.title, fact.value) for fact in acquisition_facts(figures)]
    assert facts[0] == (
        "acquisition",
        "999.98 Hz achieved, jitter 21 µs r.m.s., 100 µs at most, 0.2 % missed",
    )
    assert ("index marks", "output_angle: 2 marks, at worst -7 counts off") in facts
    assert ("skew, output after input", "+9.0 µs, U 20.0 µs, identifiable: weakly, why") in facts
    assert ("skew, torque port after drive", "identifiable: no, too steady") in facts
    assert list(acquisition_facts(None)) == []
