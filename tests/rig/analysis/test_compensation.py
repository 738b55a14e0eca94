"""From runs to a table, along it, to its proof and to a drive; and what is refused on the way."""

from __future__ import annotations

import shutil
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from experiments import catalogue
from experiments.errors import PlanError
from model.compensation import CompensationTable
from model.compensation_file import compensation_from, compensation_text
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from model.units import ARCSEC, REVOLUTION, RPM
from rig.analysis.compensation import proved_table, table_from
from rig.analysis.fit.digest import digest
from rig.analysis.fit.run import evidence_for
from rig.bench.backends.order import Order, WorldChoice
from rig.errors import ConfigurationError
from rig.exchange.compensation_forms import FORMS, form_of
from rig.run.contents import with_contents
from rig.run.start import plan_order, run_order
from rig.runfile.facts import content_in_words, run_facts
from rig.runfile.read import close_recording, open_run
from rig.runfile.sealed import write_sealed
from tests.rig.commands.calling import Rig
from tests.rig.commands.printed import every_table_has_room
from tests.rig.exchange.corrections import at, read_csv, read_fourier, read_json

SPEEDS = (185.4, 370.8, 741.6)
NOW = "2026-01-01T12:00:00+00:00"


@dataclass(frozen=True)
class Made:
    """A gear's run, its table as a sealed file, and the run along it."""

    folder: Path
    run: Path
    table: CompensationTable
    file: Path
    proof: Path


def order_of(folder: Path, **words: object) -> Order:
    world = WorldChoice(gear_seed=83_000, bench_seed=83)
    known: dict[str, object] = {
        "protocol": "kinematic-error",
        "gear": shipped_gear(),
        "motor": shipped_motor(),
        "folder": folder,
        "serial": "G-1",
        "sample_rate": 250.0,
        "world": world,
    }
    return Order(**{**known, **words})  # type: ignore[arg-type]


def along(folder: Path, table: CompensationTable, **words: object) -> Path:
    """A run along a table, analysed."""
    values = {"table": compensation_text(table), "speeds_rpm": SPEEDS, "zero_time": 0.5}
    report = run_order(order_of(folder, protocol="compensated-error", values=values, **words))
    assert report.outcome == "COMPLETED", report.message
    assert digest(report.path, NOW).fit is not None
    return report.path


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    folder = tmp_path_factory.mktemp("compensated")
    run = run_order(order_of(folder, values={"speed_rpm": 92.7, "zero_time": 0.5})).path
    table = table_from([run])
    file = folder / "table.toml"
    write_sealed(file, compensation_text(table).encode())
    return Made(folder, run, table, file, along(folder, table))


def test_the_orders_of_the_table_are_those_of_the_gear(made: Made) -> None:
    recording = open_run(made.run)
    truth = {
        one["order"]: one
        for one in recording.metadata.process["truth"]["kinematic_error"]["orders"]
    }
    close_recording(recording)
    assert {"1/N", "2", "4"} <= set(made.table.forward.labels)
    for way in (made.table.forward, made.table.reverse):
        at = way.labels.index("2")
        size = np.hypot(way.cosine[at], way.sine[at])
        true = np.hypot(truth[2.0]["cosine"], truth[2.0]["sine"])
        assert size == pytest.approx(true, rel=0.03)
        assert way.encoder[way.labels.index("1/N")] > 1.0 * ARCSEC > way.encoder[at]


def test_it_is_proved_and_takes_out_what_it_says(made: Made) -> None:
    fit = digest(made.proof, NOW).fit
    assert fit is not None
    result = fit.result
    assert result.options["proof"] == "PASS"
    ratio = result.estimates["proof_ratio"]
    assert ratio.low <= 1.0 <= ratio.high < 1.3
    assert result.metrics["removed"] > 0.6
    assert result.metrics["helps_up_to"] == pytest.approx(SPEEDS[-1] * RPM, rel=0.02)
    assert result.metrics["predicted_true"] > result.metrics["predicted_seen"]
    names = {plot.name for plot in result.plots}
    assert names == {"compensated-error", "compensated-orders", "compensated-by-speed"}
    (orders,) = (plot for plot in result.plots if plot.name == "compensated-orders")
    without, beside = orders.series
    assert "without" in without.label
    assert np.hypot.reduce(without.y) > 2.0 * np.hypot.reduce(beside.y)
    table = proved_table(made.proof)
    assert table.proof is not None
    assert table.proof.verdict == "PASS"
    assert table.proof.harms_from is None
    between = replace(table, proof=replace(table.proof, verdict="MARGINAL"))
    with pytest.raises(ConfigurationError, match="MARGINAL"):
        form_of(between)
    assert replace(table, proof=None) == compensation_from(compensation_text(made.table))


def test_wrong_ones_are_refused_by_the_proof(made: Made, tmp_path: Path) -> None:
    def turned(table: CompensationTable) -> CompensationTable:
        ways = {
            name: replace(
                way, sine=tuple(-b for b in way.sine), cosine=tuple(-a for a in way.cosine)
            )
            for name, way in (("forward", table.forward), ("reverse", table.reverse))
        }
        return replace(table, **ways)  # type: ignore[arg-type]

    run = along(tmp_path, turned(made.table))
    fit = digest(run, NOW).fit
    assert fit is not None
    assert fit.result.options["proof"] == "FAIL"
    assert any("refused" in warning for warning in fit.result.warnings)
    assert any("helps at none" in warning for warning in fit.result.warnings)
    table = proved_table(run)
    with pytest.raises(ConfigurationError, match="not proved"):
        form_of(table)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"temperature": 60.0}, "60.0 °C"),
        ({"index_gap": 0.9}, "input revolutions from where the table has them"),
        ({}, ""),
    ],
)
def test_what_is_otherwise_than_the_table_has_it_is_said(
    made: Made, changes: dict[str, float], words: str
) -> None:
    recording, evidence = evidence_for(made.proof, "compensated-error")
    metadata = recording.metadata
    table = replace(made.table, **changes)  # type: ignore[arg-type]
    given = {**metadata.parameters, "table": compensation_text(table)}
    told = replace(recording, metadata=replace(metadata, parameters=given))
    warnings = catalogue.load("compensated-error").analyse(told, evidence).warnings
    close_recording(recording)
    found = [one for one in warnings if "°C" in one or "input revolutions from" in one]
    assert [words in one for one in found] == ([True] if words else [])


def test_it_is_for_its_gear_and_mounting_alone(made: Made) -> None:
    values = {"table": str(made.file)}
    asked = order_of(made.folder, protocol="compensated-error", values=values)
    assert plan_order(asked).plan
    with pytest.raises(PlanError, match="another gear"):
        plan_order(replace(asked, serial="G-2"))
    with pytest.raises(PlanError, match="table for another"):
        plan_order(replace(asked, mounting="flexspline-fixed"))
    for content, words in (("a,b\n1,2\n", "no TOML"), ('format = "x"\n', "missing")):
        with pytest.raises(PlanError, match=words):
            plan_order(replace(asked, values={"table": content}))
    with pytest.raises(PlanError, match="too few speeds"):
        plan_order(replace(asked, values={**values, "speeds_rpm": (60.0, 120.0)}))


def test_a_table_that_was_altered_is_not_driven_by(made: Made, tmp_path: Path) -> None:
    from experiments.protocols.compensated_error.declaration import Parameters

    file = tmp_path / "t.toml"
    write_sealed(file, made.file.read_bytes())
    assert with_contents(Parameters, {"table": str(file)})["table"] == made.file.read_text()
    file.chmod(0o644)
    file.write_text(made.file.read_text().replace("ratio = 120.0", "ratio = 100.0"))
    with pytest.raises(PlanError, match="cannot be taken"):
        with_contents(Parameters, {"table": str(file)}, "compensated-error")
    with pytest.raises(PlanError, match="cannot be read"):
        with_contents(Parameters, {"table": str(tmp_path / "none.toml")})
    text = made.file.read_text()
    assert with_contents(Parameters, {"table": text, "repeats": 2}) == {"table": text, "repeats": 2}


def test_the_run_carries_it_and_names_it_shortly(made: Made) -> None:
    recording = open_run(made.proof)
    text = recording.metadata.parameters["table"]
    facts = {fact.name: fact.value for fact in run_facts(recording)}
    close_recording(recording)
    assert compensation_from(text) == compensation_from(compensation_text(made.table))
    assert content_in_words(text) in facts.values()
    assert not any("cosine_arcsec" in str(value) for value in facts.values())


def test_runs_that_do_not_belong_together_make_none(made: Made, tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="another protocol"):
        table_from([made.proof])
    with pytest.raises(ConfigurationError, match="another protocol"):
        proved_table(made.run)
    other = run_order(
        order_of(tmp_path, serial="G-2", values={"speed_rpm": 92.7, "zero_time": 0.5})
    ).path
    with pytest.raises(ConfigurationError, match="another gear"):
        table_from([made.run, other])


@pytest.mark.parametrize(
    ("form", "read"), [("csv", read_csv), ("json", read_json), ("fourier", read_fourier)]
)
def test_every_form_reads_back_to_the_same_correction(made: Made, form: str, read: object) -> None:
    table = proved_table(made.proof)
    text = FORMS[form](table)
    again = read(text)  # type: ignore[operator]
    angle = np.random.default_rng(1).uniform(-REVOLUTION, 2.0 * REVOLUTION, 5000)
    for way, sign in (("forward", 1.0), ("reverse", -1.0)):
        correction = table.of(sign)
        expected = correction.added(np.mod(angle, REVOLUTION) * table.ratio)
        away = np.abs(at(again, angle, way) - expected).max()
        assert away < 0.01 * correction.largest, way
    facts = again.facts
    assert facts["unit"] == "arcsec of the input"
    for name in ("sign", "zero", "directions", "angle", "gear", "proved_by"):
        assert facts[name], name
    assert float(facts["helps_up_to_rpm"]) == pytest.approx(SPEEDS[-1], rel=0.02)


def test_the_command_line_goes_all_the_way(
    made: Made, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig = Rig(capsys)
    table, proved = tmp_path / "t.toml", tmp_path / "proved.toml"
    with every_table_has_room():
        assert rig("compensate", made.run, "-o", table) == 0
    assert "not proved" in rig.out
    assert table.read_bytes() == made.file.read_bytes()
    assert rig("compensate", table, "--to", "csv", "-o", tmp_path / "c.csv") != 0
    assert "not proved" in rig.err
    assert not (tmp_path / "c.csv").exists()
    told = rig.json("compensate", made.proof, "-o", proved)
    assert told["proof"]["verdict"] == "PASS"
    assert told["takes_out"]["forward"]["rms_arcsec"] > 5.0
    for form in FORMS:
        file = tmp_path / f"c.{form}"
        assert rig("compensate", proved, "--to", form, "-o", file) == 0
        assert file.stat().st_size > 1000
    assert rig("compensate", made.run, "-o", table) != 0
    assert "left alone" in rig.err


def test_a_run_without_an_analysis_is_analysed_first(made: Made, tmp_path: Path) -> None:
    run = tmp_path / made.proof.name
    shutil.copy(made.proof, run)
    shutil.copy(made.proof.with_name(made.proof.name + ".sha256"), tmp_path)
    with pytest.raises(ConfigurationError, match="no analysis in force"):
        proved_table(run)
