"""The analysis store: appended, never edited, valid JSON, traceable to the run file."""

from __future__ import annotations

import json
import math
import stat
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from experiments.result import Covariance
from model.identify.estimate import Cause
from rig.analysis.format_1 import from_format_1
from rig.analysis.store import (
    NO_FIGURES,
    STORE_FORMAT,
    Basis,
    analysis_folder,
    append_analysis,
    json_ready,
    json_text,
    read_analyses,
)
from rig.errors import RunFileError
from rig.runfile.seal import hash_path
from tests.rig.handmade import friction_result, kinematic_result

BASIS = Basis(
    "cd" * 32,
    "2024-03-02T09:00:00+01:00",
    {"name": "CSF-25"},
    {"run": "R-1", "sha256": "ef" * 32},
    {"a": 1},
)


def test_analyses_are_numbered_beside_the_run(tmp_path: Path) -> None:
    run = tmp_path / "R-000042.h5"
    first = append_analysis(run, friction_result(), BASIS)
    second = append_analysis(run, kinematic_result(), BASIS)
    assert first.path == tmp_path / "R-000042.analysis" / "0001.json"
    assert (first.number, second.number) == (1, 2)
    assert [a.kind for a in read_analyses(run)] == ["friction", "kinematic-error"]
    assert not run.exists()


def test_a_stored_analysis_names_what_it_rests_on(tmp_path: Path) -> None:
    stored = append_analysis(tmp_path / "r.h5", friction_result(), BASIS)
    content = json.loads(stored.path.read_text())
    assert content["run_sha256"] == "cd" * 32
    assert content["tare"] == {"run": "R-1", "sha256": "ef" * 32}
    assert content["gear"] == {"name": "CSF-25"}
    assert content["settings"] == {"a": 1}
    assert content["program_version"]
    assert {"outcome", "verdict"}.isdisjoint(content)
    assert {"verdict", "verdicts", "because"}.isdisjoint(content["result"])
    assert content["result"]["parameters"]["F_c"]["value"] == 70.31
    assert read_analyses(tmp_path / "r.h5")[0].result.options["torque_balance"] == "energy"


def test_a_stored_analysis_is_read_only_and_never_written_again(tmp_path: Path) -> None:
    run = tmp_path / "r.h5"
    stored = append_analysis(run, friction_result(), BASIS)
    before = stored.path.read_bytes()
    assert not stored.path.stat().st_mode & (stat.S_IWUSR | stat.S_IWGRP | stat.S_IWOTH)
    append_analysis(run, replace(friction_result(), warnings=("other",)), BASIS)
    assert stored.path.read_bytes() == before
    assert len(read_analyses(run)) == 2
    numbered = sorted(p.name for p in analysis_folder(run).glob("[0-9]*"))
    assert [n for n in numbered if n.endswith("json")] == ["0001.json", "0002.json"]
    assert len(numbered) == 4


def test_figures_tables_and_covariance_are_kept_as_they_were_returned(tmp_path: Path) -> None:
    covariance = Covariance(
        ("F_c", "F_s"), np.eye(2), {Cause.TORQUE_SCALE: np.array([1.0, math.nan])}
    )
    told = replace(friction_result(), covariance=covariance)
    stored = append_analysis(tmp_path / "r.h5", told, BASIS)
    read = read_analyses(tmp_path / "r.h5")[0].whole_result()
    assert json_text(read.as_json()) == json_text(told.as_json())
    assert read.tables == told.tables
    (plot,), (drawn,) = read.plots, told.plots
    assert (plot.name, plot.figure, len(plot.series)) == (drawn.name, "9, 17", 4)
    assert plot.series[1].y == pytest.approx(drawn.series[1].y, rel=1e-8)
    assert read.covariance is not None
    np.testing.assert_array_equal(read.covariance.whole(), covariance.whole())
    # The same figures of a second analysis are not written a second time.
    append_analysis(tmp_path / "r.h5", replace(told, warnings=()), BASIS)
    assert len(list(stored.path.parent.glob("figures-*"))) == 1


def test_figures_that_were_not_kept_or_are_gone_are_said(tmp_path: Path) -> None:
    stored = append_analysis(tmp_path / "r.h5", friction_result(), BASIS)
    before = replace(stored, content={**stored.content, "figures": ""})
    assert before.whole_result().plots == ()
    assert before.whole_result().warnings[-1] == NO_FIGURES
    (figures,) = stored.path.parent.glob("figures-*")
    figures.unlink()
    with pytest.raises(RunFileError, match="holds no result"):
        stored.whole_result()
    elsewhere = replace(stored, content={**stored.content, "figures": "../../etc/passwd"})
    with pytest.raises(RunFileError, match="holds no result"):
        elsewhere.whole_result()


def test_the_same_analysis_is_not_stored_twice(tmp_path: Path) -> None:
    run = tmp_path / "r.h5"
    first = append_analysis(run, friction_result(), BASIS)
    later = replace(BASIS, created="2025-01-01T00:00:00+01:00")
    assert append_analysis(run, friction_result(), later).path == first.path
    assert append_analysis(run, friction_result(), replace(later, settings={})).number == 2


def test_a_number_that_another_program_has_taken_is_left_to_it(tmp_path: Path) -> None:
    run = tmp_path / "r.h5"
    append_analysis(run, friction_result(), BASIS)
    from rig.analysis import store as results

    stored = results._write_next(
        analysis_folder(run), {"format": results.STORE_FORMAT, "kind": "x"}, 1
    )
    assert stored.number == 2


def test_a_stored_analysis_says_what_its_numbers_are(tmp_path: Path) -> None:
    covariance = Covariance(("F_c", "F_s"), np.array([[0.81, 0.1], [0.1, 9.6]]))
    told = replace(friction_result(), covariance=covariance)
    append_analysis(tmp_path / "r.h5", told, replace(BASIS, analysis_version=3))
    (stored,) = read_analyses(tmp_path / "r.h5")
    assert (stored.content["format"], stored.content["analysis_version"]) == (STORE_FORMAT, 3)
    assert set(stored.content["quantities"]) == {*told.estimates, *told.metrics}
    running = stored.content["quantities"]["running_torque"]
    assert (running["title"], running["unit"]) == ("running torque", "N m")
    assert running["definition"].startswith("torque that keeps the input turning")
    assert stored.content["covariance"] == {
        "names": ["F_c", "F_s"],
        "matrix": [[0.81, 0.1], [0.1, 9.6]],
        "shared": {},
    }
    assert stored.content["checks"] == []
    budget = stored.content["result"]["parameters"]["running_torque"]["budget"]
    assert [line["cause"] for line in budget] == [None, "torque scale"]
    assert stored.result.estimates == told.estimates


def test_an_analysis_of_format_1_is_read_as_one_of_format_2(tmp_path: Path) -> None:
    """As version 0.1.0 wrote it: no causes, no quantities, no covariance."""
    stored = append_analysis(tmp_path / "r.h5", friction_result(), BASIS)
    new = ("analysis_version", "quantities", "covariance", "checks")
    old = {name: value for name, value in stored.content.items() if name not in new}
    old["format"] = "harmonic-rig-analysis-1"
    for estimate in old["result"]["parameters"].values():
        for line in estimate["budget"]:
            del line["cause"]
    stored.path.unlink()
    hash_path(stored.path).unlink()
    stored.path.write_text(json_text(old), encoding="utf-8")
    (read,) = read_analyses(tmp_path / "r.h5")
    assert read.result.estimates == friction_result().estimates
    assert (read.content["analysis_version"], read.content["covariance"]) == (1, None)
    assert read.content["quantities"]["F_c"]["unit"] == "N"
    assert {name: value for name, value in read.content.items() if name not in new}.keys() == (
        old.keys()
    )


@pytest.mark.parametrize(
    ("source", "kind", "cause"),
    [
        ("torque scale", "B", Cause.TORQUE_SCALE),
        ("tare", "B", Cause.TARE),
        ("bearing no-load torque", "B", Cause.BEARING_TORQUE),
        ("output encoder, eccentricity of the scale", "B", Cause.OUTPUT_ENCODER),
        ("motor encoder, once and twice per revolution", "B", Cause.MOTOR_ENCODER),
        ("encoder accuracy at this order", "B", Cause.BOTH_ENCODERS),
        ("torque zero", "B", None),
        ("torque scale", "A", None),
    ],
)
def test_the_causes_of_format_1_are_those_of_its_sentences(
    source: str, kind: str, cause: Cause | None
) -> None:
    line = {"source": source, "kind": kind, "standard_uncertainty": 1.0, "note": ""}
    read = from_format_1({"result": {"parameters": {"x": {"unit": "N", "budget": [line]}}}})
    assert read["result"]["parameters"]["x"]["budget"] == [{**line, "cause": cause}]


@pytest.mark.parametrize("text", ["", "{", "[]", '{"format": "something"}'])
def test_a_damaged_store_is_refused_by_name(tmp_path: Path, text: str) -> None:
    folder = analysis_folder(tmp_path / "r.h5")
    folder.mkdir()
    (folder / "0001.json").write_text(text)
    (folder / "notes.txt").write_text("not ours")
    with pytest.raises(RunFileError, match=r"0001\.json"):
        read_analyses(tmp_path / "r.h5")


def test_a_folder_that_cannot_be_made_is_an_error_of_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "r.analysis").write_text("a file is in the way")
    with pytest.raises(RunFileError, match="cannot be written"):
        append_analysis(tmp_path / "r.h5", friction_result(), BASIS)


@pytest.mark.parametrize(
    ("run", "folder"),
    [
        ("a.h5", "a.analysis"),
        ("a.h5.part", "a.analysis"),
        ("a.b.h5", "a.b.analysis"),
        ("a.nxs", "a.analysis"),
    ],
)
def test_the_folder_follows_the_name_of_the_run(run: str, folder: str) -> None:
    assert analysis_folder(run).name == folder


def test_everything_becomes_json_that_every_reader_accepts() -> None:
    odd = {
        "nan": math.nan,
        "inf": np.inf,
        "int": np.int64(3),
        "array": np.array([1.0, np.nan]),
        5: ({1},),
        "path": Path("a"),
    }
    found = json.loads(json_text(odd))
    assert found == {
        "nan": None,
        "inf": None,
        "int": 3,
        "array": [1.0, None],
        "5": [[1]],
        "path": "a",
    }
    assert json_ready(True) is True
