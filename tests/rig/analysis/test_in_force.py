"""The analysis in force: order of strength, what makes one stale, and the choice by hand."""

from __future__ import annotations

import hashlib
import json
import random
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from experiments import catalogue
from model.gear import HarmonicDrive
from model.gear_file import gear_to_mapping, save_gear, shipped_gear
from rig.analysis import format_1
from rig.analysis.gear_set import GearSource, set_sha256
from rig.analysis.in_force import InForce, in_force, in_force_by_kind, keep, kept_by_hand
from rig.analysis.store import Analysis, Basis, analysis_folder, append_analysis, json_text
from rig.errors import ConfigurationError, RunFileError
from rig.gears.card import save_card, with_changes
from rig.runfile.seal import check_seal, hash_path
from rig.runfile.sealed import seal_in_place
from tests.rig.handmade import friction_result, kinematic_result
from tests.rig.library.stored import write

AT = "2026-03-02T10:00:00+00:00"
NOW = catalogue.load("friction").version


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A sealed friction run of gear A1."""
    return write(tmp_path, 2)


def tare_of(path: Path, **more: Any) -> dict[str, Any]:
    return {
        "run": path.name.removesuffix(".h5"),
        "sha256": check_seal(path).sha256,
        "file": path.name,
        "chosen": "found",
        "age_days": 1.0,
        **more,
    }


def stored(run: Path, number: int, *, tare: dict[str, Any] | None = None, **more: Any) -> Analysis:
    """One analysis beside a run, told from the others by its warning."""
    gear = shipped_gear()
    basis = Basis(
        check_seal(run).sha256,
        AT,
        gear=gear_to_mapping(gear),
        gear_source=GearSource("run", "A1", set_sha256(gear)).as_json(),
        tare=tare or {},
        analysis_version=NOW,
    )
    result = replace(friction_result(), warnings=(f"the {number}th",))
    return append_analysis(run, result, replace(basis, **more))


def rewritten(run: Path, text: str) -> None:
    """The run of that name replaced by another one, sealed as such."""
    run.chmod(0o644)
    hash_path(run).chmod(0o644)
    run.write_bytes(run.read_bytes() + text.encode())
    hash_path(run).unlink()


def test_a_run_without_an_analysis_has_none_in_force(run: Path) -> None:
    assert in_force(run) == InForce(kind="")
    assert in_force(run, "friction") == InForce(kind="friction")


def test_the_newest_is_in_force_of_analyses_that_are_equal_otherwise(run: Path) -> None:
    stored(run, 1)
    stored(run, 2)
    found = in_force(run)
    assert (found.kind, found.number, found.stale) == ("friction", 2, ())
    assert found.why_this == "the newest of 2 analyses"
    assert found.renewed_by == ""


def test_an_analysis_with_a_tare_is_stronger_than_a_newer_one_without(run: Path) -> None:
    tare = write(run.parent, 1)
    stored(run, 1, tare=tare_of(tare))
    stored(run, 2)
    found = in_force(run, "friction")
    assert (found.number, found.why_this) == (1, "with a tare of 2 analyses")


def test_what_is_not_stale_is_stronger_than_what_has_a_tare(run: Path) -> None:
    tare = write(run.parent, 1)
    stored(run, 1, tare=tare_of(tare))
    stored(run, 2)
    rewritten(tare, "another recording")
    assert (in_force(run).number, in_force(run).why_this) == (2, "not stale of 2 analyses")


def test_one_kept_by_hand_is_stronger_than_all(run: Path) -> None:
    stored(run, 1, analysis_version=NOW - 1)
    tare = write(run.parent, 1)
    stored(run, 2, tare=tare_of(tare))
    assert in_force(run).number == 2
    kept = keep(run, 1, "B. Example", AT)
    assert (kept.number, kept.why_this) == (1, f"kept by B. Example, {AT}")
    assert len(kept.stale) == 1
    assert kept.renewed_by == f"rig fit {run}, then rig fit RUN --keep NUMBER --by NAME"
    assert in_force(run) == kept
    assert keep(run, 0, "B. Example", AT).number == 2
    assert [choice.number for choice in kept_by_hand(run)] == [1, 0]


def test_a_choice_whose_analysis_is_gone_chooses_nothing(run: Path) -> None:
    stored(run, 1)
    gone = stored(run, 2)
    keep(run, 2, "B. Example", AT)
    gone.path.unlink()
    assert (in_force(run).number, in_force(run).why_this) == (1, "the only analysis")


@pytest.mark.parametrize(
    ("number", "by", "error", "words"),
    [
        (3, "B. Example", RunFileError, r"no analysis of this number.*3.*1"),
        (1, " ", ConfigurationError, "nobody is named"),
    ],
)
def test_a_choice_that_cannot_be_made_is_refused(
    run: Path, number: int, by: str, error: type[Exception], words: str
) -> None:
    stored(run, 1)
    with pytest.raises(error, match=words):
        keep(run, number, by, AT)
    assert kept_by_hand(run) == ()


@pytest.mark.parametrize("text", ["", "{}", '{"format": "other", "kept": []}'])
def test_choices_that_cannot_be_read_are_refused_by_name(run: Path, text: str) -> None:
    stored(run, 1)
    (analysis_folder(run) / "kept.json").write_text(text)
    with pytest.raises(RunFileError, match=r"kept\.json"):
        in_force(run)


def test_a_run_file_that_was_replaced_makes_its_analysis_stale(run: Path) -> None:
    stored(run, 1)
    rewritten(run, "x")
    found = in_force(run)
    assert found.stale == ("the run file is not sealed: its note is missing",)
    seal_in_place(run, run.read_bytes())
    found = in_force(run)
    assert found.stale == ("the run file is not the one that was analysed",)
    assert not found.of_this_run
    assert found.renewed_by == f"rig fit {run}"


def test_a_run_file_that_was_changed_behind_its_seal_makes_its_analysis_stale(run: Path) -> None:
    stored(run, 1)
    run.chmod(0o644)
    run.write_bytes(run.read_bytes() + b"x")
    assert in_force(run).stale == ("the run file is not the one that was analysed",)


def test_a_tare_that_was_replaced_makes_the_analysis_stale(run: Path) -> None:
    tare = write(run.parent, 1)
    stored(run, 1, tare=tare_of(tare, chosen="by hand"))
    assert in_force(run).stale == ()
    rewritten(tare, "x")
    found = in_force(run)
    assert found.stale == ("the tare 00001-friction-A1 is not the one that was subtracted",)
    assert found.renewed_by == f"rig fit {run} --tare {tare}"


def test_a_tare_that_is_gone_contradicts_nobody(run: Path) -> None:
    tare = write(run.parent, 1)
    stored(run, 1, tare=tare_of(tare))
    tare.unlink()
    assert in_force(run).stale == ()


def test_a_tare_that_would_not_be_found_any_more_makes_the_analysis_stale(run: Path) -> None:
    tare = write(run.parent, 1)
    stored(run, 1, tare=tare_of(tare, age_days=9.2))
    assert in_force(run).stale == ("its tare is 9.2 days old, and the setting tare_days is 7 now",)
    stored(run, 2, tare=tare_of(tare, age_days=9.2, chosen="by hand"))
    assert in_force(run).stale == ()


def test_another_part_on_the_gears_card_makes_the_analysis_stale(run: Path) -> None:
    stored(run, 1)
    card = with_changes(None, {"serial": "A1", "part": "csf-25-120"}, "B. Example", AT)
    save_card(run.parent, card)
    assert in_force(run).stale == ()
    heavier = with_changes(card, {"load_inertia_kg_m2": 0.5}, "B. Example", AT)
    save_card(run.parent, heavier)
    assert in_force(run).stale == ("the parameter set of the gear is another one now",)


def carded_set(run: Path, gear: HarmonicDrive) -> None:
    """The card of gear A1 names this set as its part."""
    part = run.parent / "part.toml"
    save_gear(gear, part)
    card = with_changes(None, {"serial": "A1", "part": str(part)}, "B. Example", AT)
    save_card(run.parent, card)


def with_origin(gear: HarmonicDrive, **changes: Any) -> HarmonicDrive:
    """The set with another origin of its first number."""
    path, first = next(iter(gear.origins.items()))
    return replace(gear, origins={**gear.origins, path: replace(first, **changes)})


@pytest.mark.parametrize(
    ("changes", "is_stale"),
    [
        ({"source": "the same number, told in other words"}, False),
        ({"provenance": "identified"}, True),
        ({"standard_uncertainty": 0.123}, True),
    ],
)
def test_only_what_an_analysis_reads_of_a_set_makes_it_stale(
    run: Path, changes: dict[str, Any], is_stale: bool
) -> None:
    stored(run, 1)
    carded_set(run, with_origin(shipped_gear(), **changes))
    assert bool(in_force(run).stale) is is_stale


def test_a_set_that_was_named_by_the_earlier_hash_is_the_same_set(run: Path) -> None:
    gear = shipped_gear()
    whole = hashlib.sha256(json_text(gear_to_mapping(gear)).encode()).hexdigest()
    assert whole != set_sha256(gear)
    stored(run, 1, gear_source=GearSource("card", "A1", whole).as_json())
    carded_set(run, gear)
    assert in_force(run).stale == ()
    carded_set(run, with_origin(gear, source="other words"))
    assert len(in_force(run).stale) == 1


def test_a_set_given_by_hand_is_held_against_no_card(run: Path) -> None:
    stored(run, 1, gear_source=GearSource("by hand", "A1", "ab" * 32).as_json())
    values = {"serial": "A1", "part": "csf-25-120", "load_inertia_kg_m2": 0.5}
    save_card(run.parent, with_changes(None, values, "B. Example", AT))
    assert in_force(run).stale == ()


def test_a_card_whose_part_cannot_be_read_is_said(run: Path) -> None:
    stored(run, 1)
    save_card(
        run.parent,
        with_changes(None, {"serial": "A1", "part": str(run.parent / "g.toml")}, "B. Example", AT),
    )
    (words,) = in_force(run).stale
    assert words.startswith("the parameter set of the gear cannot be read")


def test_an_analysis_that_builds_on_another_one_than_is_in_force_is_stale(run: Path) -> None:
    other = write(run.parent, 1)
    first = append_analysis(other, kinematic_result(), Basis(check_seal(other).sha256, AT))
    built_on = {"run": "R1", "file": other.name, "kind": "kinematic-error", "number": first.number}
    gear = set_sha256(shipped_gear())
    stored(run, 1, gear_source=GearSource("run", "A1", gear, built_on).as_json())
    assert in_force(run).stale == ()
    again = replace(kinematic_result(), warnings=("again",))
    append_analysis(other, again, Basis(check_seal(other).sha256, AT))
    assert in_force(run).stale == (
        "it builds on analysis 1 of R1, of which analysis 2 is in force now",
    )


def test_another_version_of_the_kind_makes_the_analysis_stale(run: Path) -> None:
    stored(run, 1, analysis_version=NOW - 1)
    (words,) = in_force(run).stale
    assert words == (
        f"it was made by version {NOW - 1} of the friction analysis, which is at {NOW}"
    )


def test_an_analysis_of_format_1_was_checked_for_nothing_and_is_stale(run: Path) -> None:
    analysis = stored(run, 1)
    old = {**analysis.content, "format": format_1.FORMAT}
    analysis.path.chmod(0o644)
    analysis.path.write_text(json_text(old), encoding="utf-8")
    hash_path(analysis.path).unlink()
    assert in_force(run).stale[0] == "it was made before analyses were checked for evidence"


def test_each_kind_has_its_own_analysis_in_force(run: Path) -> None:
    stored(run, 1)
    motion = replace(friction_result(), kind="motion")
    append_analysis(run, motion, Basis(check_seal(run).sha256, AT))
    found = in_force_by_kind(run)
    assert {kind: one.number for kind, one in found.items()} == {"friction": 1, "motion": 2}
    assert in_force(run).kind == "friction"


def test_the_strongest_is_in_force_whatever_was_stored_in_which_order(tmp_path: Path) -> None:
    """Random stores: nothing that is stronger by the order of strength is passed over."""
    draw = random.Random(4711)
    run, tare = write(tmp_path, 2), write(tmp_path, 1)
    for _ in range(25):
        shutil.rmtree(analysis_folder(run), ignore_errors=True)
        facts = {}
        for number in range(1, draw.randint(2, 7)):
            has_tare, stale = draw.random() < 0.5, draw.random() < 0.4
            one = stored(
                run,
                number,
                tare=tare_of(tare) if has_tare else None,
                analysis_version=NOW - stale,
            )
            facts[one.number] = (not stale, has_tare, one.number)
        chosen = draw.choice([None, *facts])
        if chosen is not None:
            keep(run, chosen, "B. Example", AT)
        found = in_force(run)
        assert found.number == (chosen or max(facts, key=lambda n: facts[n])), facts
        assert bool(found.stale) is not facts[found.number][0]
        assert bool(found.renewed_by) is bool(found.stale)
        json.dumps(found.as_json())
