"""A sealed run digested: analysed once, kept, read by everybody, and made anew with the same choices by hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from experiments import catalogue
from experiments.errors import AnalysisError
from model.gear_file import gear_to_mapping, shipped_gear
from rig.analysis.fit import digest as digesting
from rig.analysis.fit.digest import Digest, choices_of, digest, read_or_digest, renew
from rig.analysis.fit.recorded import TARE_DECLINED, Fit, fit_in_force
from rig.analysis.fit.run import TARE_AGE_SETTING, Choices
from rig.analysis.gear_set import GearSource, card_set, set_sha256
from rig.analysis.in_force import in_force, keep
from rig.analysis.judging import judge_run
from rig.analysis.store import Basis, append_analysis, read_analyses
from rig.analysis.tare import FoundTare
from rig.errors import RigError
from rig.gears.card import save_card, with_changes
from rig.runfile.read import open_run
from rig.runfile.seal import check_seal
from tests.rig.handmade import acceptance, friction_result
from tests.rig.library.stored import write

AT = "2026-03-02T10:00:00+00:00"


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A sealed friction run of gear A1."""
    return write(tmp_path, 2)


class Fitting:
    """Stands in for `fit_run`: notes with which choices it was asked, and finds another torque every time."""

    def __init__(self) -> None:
        self.asked: list[Choices | None] = []

    def __call__(self, path: Path, kind: str = "", choices: Choices | None = None) -> Fit:
        self.asked.append(choices)
        gear = shipped_gear()
        return Fit(
            recording=open_run(path),
            gear=gear,
            result=friction_result(0.08 + 0.001 * len(self.asked)),
            path=path,
            gear_source=GearSource("run", "A1", set_sha256(gear)),
            found_tare=FoundTare(None, ("there is no tare",)),
        )


@pytest.fixture
def fitting(monkeypatch: pytest.MonkeyPatch) -> Fitting:
    fitting = Fitting()
    monkeypatch.setattr(digesting, "fit_run", fitting)
    return fitting


def test_a_run_is_analysed_once_and_then_read(run: Path, fitting: Fitting) -> None:
    fit, found, made = read_or_digest(run, AT)
    assert made is not None
    assert (found.number, len(read_analyses(run))) == (1, 1)
    again, same, nothing = read_or_digest(run, AT)
    assert nothing is None
    assert (same, len(fitting.asked)) == (found, 1)
    assert fit is not None
    assert again is not None
    assert again.result.estimates["running_torque"] == fit.result.estimates["running_torque"]


def test_a_stale_analysis_is_read_as_it_is_and_says_so(run: Path, fitting: Fitting) -> None:
    version = catalogue.load("friction").version
    append_analysis(
        run, friction_result(), Basis(check_seal(run).sha256, AT, analysis_version=version - 1)
    )
    fit, found, made = read_or_digest(run, AT)
    assert (made, fitting.asked) == (None, [])
    assert fit is not None
    assert fit.stale == found.stale != ()
    assert judge_run(fit, acceptance()).verdict == "NOT JUDGED"
    renewed = renew(run, AT)
    assert renewed.in_force.number == 2
    assert renewed.fit is not None
    assert judge_run(renewed.fit, acceptance()).verdict == "PASS"


def test_what_a_recording_does_not_bear_is_said_and_not_stored(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> Fit:
        raise AnalysisError("it never turned", where="friction")

    monkeypatch.setattr(digesting, "fit_run", refuse)
    made = digest(run, AT)
    assert made.fit is None
    assert "it never turned" in made.because[0]
    assert read_analyses(run) == ()
    assert (made.key_values, made.next_steps) == ((), ())


def test_a_fit_that_is_not_in_force_afterwards_judges_nothing(run: Path, fitting: Fitting) -> None:
    digest(run, AT)
    keep(run, 1, "B. Example", AT)
    made = digest(run, AT)
    assert made.fit is not None
    assert "analysis 1 is in force (kept by B. Example" in made.fit.not_in_force
    assert judge_run(made.fit, acceptance()).verdict == "NOT JUDGED"
    in_use = fit_in_force(run, in_force(run))
    assert judge_run(in_use, acceptance()).verdict == "PASS"


def test_what_is_to_be_done_next_names_the_tare_that_is_missing(
    run: Path, fitting: Fitting
) -> None:
    made = digest(run, AT)
    assert made.next_steps == (
        f"rig run motor-tare, then rig fit {run}",
        f"rig report --gear A1 --runs {run.parent}",
    )
    assert made.fit is not None
    named = replace(made.fit.recording.metadata, gear_serial="A 1")
    blank = replace(made.fit, recording=replace(made.fit.recording, metadata=named))
    assert "--gear 'A 1' " in Digest(path=run, fit=blank, in_force=made.in_force).next_steps[1]
    by_hand = replace(made.fit, found_tare=FoundTare(None, (TARE_DECLINED,)))
    assert Digest(path=run, fit=by_hand, in_force=made.in_force).next_steps == made.next_steps[1:]


def test_what_was_chosen_by_hand_is_chosen_again(run: Path) -> None:
    gear, version = shipped_gear(), catalogue.load("friction").version
    basis = Basis(
        check_seal(run).sha256,
        AT,
        gear=gear_to_mapping(gear),
        gear_source=GearSource("by hand", "A1", set_sha256(gear)).as_json(),
        tare={"run": "T", "file": "tare.h5", "chosen": "by hand"},
        settings={"channel": "torque", TARE_AGE_SETTING: 10.0},
        analysis_version=version,
    )
    append_analysis(run, friction_result(), basis)
    chosen = choices_of(run, in_force(run))
    assert chosen.tare == run.parent / "tare.h5"
    assert chosen.gear is not None
    assert set_sha256(chosen.gear) == set_sha256(gear)
    assert chosen.settings == {"channel": "torque", TARE_AGE_SETTING: 10.0}
    # What was found is found again, and its age was no choice; what was left away stays away.
    found = replace(basis, tare={**basis.tare, "chosen": "found"}, gear_source={})
    append_analysis(run, friction_result(0.09), found)
    again = choices_of(run, in_force(run))
    assert (again.tare, again.gear, again.settings) == (None, None, {"channel": "torque"})
    write(run.parent, 3)
    (other,) = run.parent.glob("00003-*.h5")
    append_analysis(other, friction_result(), replace(basis, tare={}, no_tare=(TARE_DECLINED,)))
    assert choices_of(other, in_force(other)).no_tare


def test_nothing_is_renewed_where_there_is_no_analysis(run: Path) -> None:
    with pytest.raises(RigError, match=r"no analysis that could be renewed.*rig fit"):
        renew(run, AT)


def test_the_set_of_a_card_is_that_of_its_part_and_else_of_the_run(tmp_path: Path) -> None:
    gear = shipped_gear()
    assert card_set(tmp_path, "A1", lambda: gear) is None
    save_card(tmp_path, with_changes(None, {"serial": "A1"}, "B. Example", AT))
    assert card_set(tmp_path, "A1", lambda: gear) is None
    loaded = with_changes(None, {"serial": "A2", "load_inertia_kg_m2": 0.5}, "B. Example", AT)
    save_card(tmp_path, loaded)
    heavier = card_set(tmp_path, "A2", lambda: gear)
    assert heavier is not None
    assert set_sha256(heavier) != set_sha256(gear)
    assert card_set(tmp_path, "A2", lambda: None) is None
    part = with_changes(None, {"serial": "A3", "part": "csf-25-120"}, "B. Example", AT)
    save_card(tmp_path, part)
    by_part = card_set(tmp_path, "A3", lambda: None)
    assert by_part is not None
    assert set_sha256(by_part) == set_sha256(gear)
