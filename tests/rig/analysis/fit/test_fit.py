"""From a recording to a result: the kind, the parameter set, the tare, the store."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from experiments import catalogue
from experiments.contract import Evidence, Experiment, NoParameters, no_plan
from experiments.recording import Recording
from experiments.result import Result
from model.gear import HarmonicDrive, Origin
from model.gear_file import shipped_gear
from rig.analysis.adopt import adopt, compare_with, pooled
from rig.analysis.fit import run as fit_run
from rig.analysis.fit.recorded import Fit, fit_recording, kind_of, score, store
from rig.analysis.store import read_analyses
from rig.analysis.tare import check_tare
from rig.errors import RigError
from tests.rig import handmade

TARE_RESULT = Result(run="R-000040", kind="motor-tare", estimates={})


def take_over(result: Result, gear: HarmonicDrive) -> HarmonicDrive:
    found = result.estimates["F_c"]
    origin = Origin("identified", f"run {result.run}", found.standard_uncertainty)
    return gear.with_values({"mesh_friction.coulomb": found.value}, origin)


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, Evidence]]:
    """Every kind analyses to a hand-made result; what was asked of it is kept."""
    seen: list[tuple[str, Evidence]] = []

    def load(name: str) -> Experiment:
        catalogue.entry(name)

        def analyse(recording: Recording, evidence: Evidence) -> Result:
            seen.append((name, evidence))
            made = {
                "friction": handmade.friction_result(),
                "kinematic-error": handmade.kinematic_result(),
            }
            return replace(made.get(name, TARE_RESULT), kind=name, run=recording.metadata.run_id)

        identified = take_over if name == "friction" else None
        return Experiment(
            name=name,
            title=name,
            summary=name,
            parameters=NoParameters,
            plan=no_plan,
            analyse=analyse,
            identified=identified,
            gives_tare=name == "motor-tare",
        )

    monkeypatch.setattr(catalogue, "load", load)
    return seen


def tare(**more: Any) -> Fit:
    return handmade.fit("simulated", TARE_RESULT, **{"gear_mounted": False, **more})


def test_the_kind_follows_from_the_protocol() -> None:
    assert kind_of(handmade.recording()) == "friction"
    assert kind_of(handmade.recording(), "motion") == "motion"


@pytest.mark.parametrize("protocol", ["", "something else"])
def test_a_recording_without_a_protocol_needs_a_kind(protocol: str) -> None:
    with pytest.raises(RigError, match="rig fit motion RUN"):
        kind_of(handmade.recording("imported", experiment=protocol))


def test_the_run_s_own_parameter_set_is_used(asked: list[tuple[str, Evidence]]) -> None:
    gear = replace(shipped_gear(), name="mine")
    fit_recording(handmade.recording(gear=gear))
    assert asked[0][1].gear.name == "mine"
    fit_recording(handmade.recording(gear=gear), gear=replace(gear, name="given"))
    assert asked[1][1].gear.name == "given"


def test_the_set_of_a_gear_with_another_ratio_is_refused(
    asked: list[tuple[str, Evidence]],
) -> None:
    another = replace(shipped_gear(), name="another")
    with pytest.raises(RigError, match="another ratio") as refused:
        fit_recording(handmade.recording(ratio=80.0), gear=another)
    assert refused.value.value == "120 (circular-spline-fixed)"
    assert refused.value.limit == "80"
    assert "own" in str(refused.value.remedy)
    assert "another" in str(refused.value.where)
    # Of a bare motor no gear was turned.
    fit_recording(handmade.recording(ratio=80.0, gear_mounted=False), gear=another)
    assert [evidence.gear.name for _, evidence in asked] == ["another"]


def test_a_run_without_a_parameter_set_says_which_one_was_used(
    asked: list[tuple[str, Evidence]],
) -> None:
    found = fit_recording(handmade.recording("imported", gear=None)).result
    assert asked[0][1].gear.name == shipped_gear().name
    assert any("carries no parameter set" in w for w in found.warnings)
    assert found.options["parameter_set"] == shipped_gear().name


def test_the_tare_goes_into_the_evidence_and_its_run_into_the_options(
    asked: list[tuple[str, Evidence]],
) -> None:
    found = fit_recording(handmade.recording(), tare=tare(), settings={"laws": "m2"})
    assert asked[0][1].tare is not None
    assert asked[0][1].settings == {"laws": "m2"}
    assert found.result.options["tare_run"] == "R-000040"
    assert fit_recording(handmade.recording()).result.options["tare_run"] == "none"


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (handmade.fit("simulated"), "only a motor-tare run"),
        (tare(gear_mounted=True), "gear mounted"),
        (
            replace(tare(), recording=handmade.recording("hardware", gear_mounted=False)),
            "same kind of rig",
        ),
    ],
)
def test_a_tare_that_is_none_is_refused(wrong: Fit, words: str) -> None:
    with pytest.raises(RigError, match=words):
        check_tare(handmade.recording("simulated"), wrong.recording, wrong.result)


def test_a_fit_is_stored_beside_its_run(tmp_path: Path, asked: list[tuple[str, Evidence]]) -> None:
    path = tmp_path / "R-000042.h5"
    found = fit_recording(handmade.recording(), tare=tare(), path=path)
    kept = store(found, "2024-03-02T09:00:00+01:00")
    assert kept.stored == "R-000042.analysis/0001.json"
    content = read_analyses(path)[0].content
    assert content["run_sha256"] == "ab" * 32
    assert content["tare"]["run"] == "R-000040"
    assert content["gear"]["mesh_friction"]["coulomb"]["value"] == 70.0


def test_a_recording_in_memory_is_not_stored(asked: list[tuple[str, Evidence]]) -> None:
    found = fit_recording(handmade.recording())
    assert store(found, "now") is found


def test_without_a_score_of_its_own_the_fit_is_the_score(asked: list[tuple[str, Evidence]]) -> None:
    found = fit_recording(handmade.recording())
    assert score(found) is found.result


def test_identified_values_are_taken_over_with_their_origin(
    asked: list[tuple[str, Evidence]],
) -> None:
    adopted = adopt(shipped_gear(), [handmade.kinematic_result(), handmade.friction_result()])
    assert adopted.changed == ("mesh_friction.coulomb",)
    assert adopted.gear.mesh_friction.coulomb == 70.31
    origin = adopted.gear.origins["mesh_friction.coulomb"]
    assert (origin.provenance, origin.source) == ("identified", "run R-000042")
    assert adopt(shipped_gear(), []).changed == ()


@pytest.mark.parametrize(("held", "agrees"), [(70.0, True), (90.0, False)])
def test_a_set_is_held_against_what_was_identified(
    asked: list[tuple[str, Evidence]], held: float, agrees: bool
) -> None:
    gear = shipped_gear().with_values({"mesh_friction.coulomb": held})
    (row,) = compare_with(gear, handmade.friction_result())
    assert (row.parameter, row.identified, row.unit) == (held, 70.31, "N")
    assert row.agrees is agrees
    assert row.normalised_error == pytest.approx(abs(held - 70.31) / row.uncertainty)
    assert row.as_json()["agrees"] is agrees


def test_the_spread_between_runs_is_pooled() -> None:
    second = handmade.friction_result()
    moved = replace(second.estimates["F_c"], value=71.31)
    second = replace(second, estimates={"F_c": moved})
    (row,) = pooled([handmade.friction_result(), second])
    assert row.key == "friction.F_c"
    assert (row.mean, row.runs) == (pytest.approx(70.81), 2)
    assert row.deviation == pytest.approx(0.5**0.5)


def test_what_other_runs_of_the_gear_teach_is_a_setting_unless_one_is_given_by_hand(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def learns(results: Sequence[Result]) -> Mapping[str, Any]:
        return {"dry_per_kelvin": tuple(result.run for result in results), "source": "runs"}

    recording = handmade.recording()
    own = recording.metadata.run_id
    runs = [SimpleNamespace(run_id=name, path=name) for name in (own, "R-1", "R-2", "R-3")]

    def in_force(path: str, kind: str) -> Any:
        analysis = SimpleNamespace(whole_result=lambda: replace(TARE_RESULT, run=path))
        return SimpleNamespace(
            analysis=None if path == "R-2" else analysis, stale=("older",) * (path == "R-3")
        )

    monkeypatch.setattr(catalogue, "declared", lambda kind: SimpleNamespace(learns=learns))
    monkeypatch.setattr(fit_run, "_runs_before", lambda recording, folder, kinds: runs)
    monkeypatch.setattr(fit_run, "in_force", in_force)

    def learnt(**by_hand: Any) -> Mapping[str, Any]:
        return fit_run._learnt(recording, Path("run.h5"), "friction", by_hand, around)

    around = fit_run.Surroundings()
    assert learnt() == learnt(seed=3) == {"dry_per_kelvin": ("R-1",), "source": "runs"}
    assert learnt(dry_per_kelvin=(0.0, 0.0)) == {}
    monkeypatch.setattr(fit_run.Surroundings, "learns_from", lambda self, analysis: False)
    assert learnt() == {"dry_per_kelvin": (), "source": "runs"}
