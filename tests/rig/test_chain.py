"""The chain of evidence attacked: each change is refused by what reads it, or found and named by `rig verify`."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import pytest

from experiments import catalogue
from experiments.finding import Severity, first_blocking
from rig.analysis.chain import links_of_run
from rig.analysis.in_force import in_force, keep
from rig.analysis.recompute import recompute
from rig.analysis.store import (
    NOT_SEALED_THEN,
    STORE_FORMAT,
    read_analyses,
)
from rig.errors import ChangedRunError, UnsealedError
from rig.gears.acceptance import acceptance_named
from rig.main import run as main
from rig.runfile.seal import allowing_unsealed, hash_path
from rig.trial.campaign import journal as journals
from rig.trial.campaign.journal import DoneStage
from rig.trial.campaign.plan import shipped_plan
from rig.trial.chain import links_of
from tests.rig.library.stored import RUNNING, analyse, estimate, write
from tests.rig.runfile.making import reseal

WRITTEN = Path(__file__).parents[1] / "data" / "0.1.0" / "runs"
PASSPORT = ("report", "--gear", "A1", "--passport", "--runs")


def rig(*words: object) -> tuple[int, str, str]:
    """Exit code, output and errors of a command."""
    output, errors = StringIO(), StringIO()
    with redirect_stdout(output), redirect_stderr(errors), pytest.raises(SystemExit) as end:
        main([str(word) for word in words])
    return int(str(end.value.code or 0)), output.getvalue(), " ".join(errors.getvalue().split())


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A sealed run with one analysis, of a folder of its own."""
    path = write(tmp_path, 1)
    analyse(path, estimate(RUNNING, 0.0619))
    return path


def analysis_of(run: Path, number: int = 1) -> Path:
    return run.with_suffix(".analysis") / f"{number:04d}.json"


def rewritten(path: Path, before: str, after: str) -> None:
    """A text editor at work."""
    path.chmod(0o644)
    text = path.read_text(encoding="utf-8")
    assert before in text
    path.write_text(text.replace(before, after), encoding="utf-8")


def broken(place: Path) -> str:
    """The kind and file of the first link that does not hold; "" where all do."""
    link = first_blocking(links_of(place))
    return "" if link is None else f"{link.what} {Path(link.where).name}"


def edit_numbers(run: Path) -> None:
    rewritten(analysis_of(run), "0.0619", "0.0319")


def take_the_note_of_the_analysis(run: Path) -> None:
    hash_path(analysis_of(run)).unlink()


def take_the_note_of_the_run(run: Path) -> None:
    hash_path(run).unlink()


def empty_the_note(run: Path) -> None:
    note = hash_path(analysis_of(run))
    note.chmod(0o644)
    note.write_text("")


def relabel_the_analysis(run: Path) -> None:
    """One of another number put in the place of this one, with its note."""
    analyse(run, estimate(RUNNING, 0.05))
    first, second = analysis_of(run), analysis_of(run, 2)
    first.unlink()
    shutil.copy2(second, first)
    hash_path(first).chmod(0o644)
    hash_path(first).write_text(f"{hash_path(second).read_text().split()[0]}  {first.name}\n")


@pytest.mark.parametrize(
    ("attack", "what"),
    [
        (edit_numbers, "analysis 0001.json"),
        (take_the_note_of_the_analysis, "analysis 0001.json"),
        (empty_the_note, "analysis 0001.json"),
        (take_the_note_of_the_run, "run 00001-friction-A1.h5"),
    ],
)
def test_what_was_changed_is_refused_by_readers_and_named_by_verify(
    run: Path, attack: Callable[[Path], None], what: str
) -> None:
    folder = run.parent
    assert broken(folder) == ""
    attack(run)
    readers: tuple[tuple[object, ...], ...] = (
        ("verify", run),
        ("certificate", "--gear", "A1", "--runs", folder, "--output", folder / "c.html"),
        (*PASSPORT, folder),
        ("report", run, "--output", folder / "r.html"),
        ("verify", folder),
    )
    # Who reads one changed file by this way reads all of them by it.
    for words in readers if attack is edit_numbers else readers[:2]:
        code, output, errors = rig(*words)
        assert code == 6, words
        assert what.split()[1] in output + errors
    assert not list(folder.glob("*.html"))
    assert broken(folder) == what
    # A list of runs goes on.
    assert rig("runs", folder)[0] == 0


@pytest.mark.parametrize("left", ["note", "analyses"])
def test_a_run_that_was_deleted_is_missed_by_what_is_left_of_it(run: Path, left: str) -> None:
    (run.parent / "empty.analysis").mkdir()
    assert broken(run.parent) == ""
    run.unlink()
    if left == "note":
        shutil.rmtree(run.with_suffix(".analysis"))
    else:
        hash_path(run).unlink()
    code, output, _ = rig("verify", run.parent, "--json")
    assert (code, json.loads(output)["trusted"]) == (6, False)
    assert (
        broken(run.parent) == f"run {run.name if left == 'note' else '00001-friction-A1.analysis'}"
    )
    if left == "note":
        # What a kill between the note and the name of the run leaves.
        run.with_name(f"{run.name}.part").touch()
        assert broken(run.parent) == ""


def test_a_tare_that_was_deleted_is_missed_and_one_elsewhere_is_only_told(tmp_path: Path) -> None:
    folder, elsewhere = tmp_path / "runs", tmp_path / "elsewhere"
    folder.mkdir()
    elsewhere.mkdir()
    run = copied(folder, "00002-motor_tare-SN_010.h5", "00003-friction-SN_010.h5")
    tare = folder / "00002-motor_tare-SN_010.h5"
    assert rig("fit", run, "--tare", tare)[0] in (0, 1)
    assert rig("verify", folder)[0] == 0
    for path in (tare, hash_path(tare)):
        path.rename(elsewhere / path.name)
    assert rig("verify", run)[0] == 6
    assert broken(folder) == f"tare {tare.name}"
    assert rig("fit", run, "--tare", elsewhere / tare.name)[0] in (0, 1)
    for path in (*run.with_suffix(".analysis").glob("0001*"), *elsewhere.iterdir()):
        path.unlink()
    assert rig("verify", run)[0] == 0


def test_an_analysis_in_the_place_of_another_is_found(run: Path) -> None:
    relabel_the_analysis(run)
    assert broken(run) == "analysis 0001.json"


def test_verify_tells_the_first_broken_link_as_an_object(run: Path, tmp_path: Path) -> None:
    code, output, _ = rig("verify", run, "--json")
    assert (code, json.loads(output)["trusted"]) == (0, True)
    edit_numbers(run)
    code, output, _ = rig("verify", run, "--json")
    told = json.loads(output)
    assert code == 6
    assert told["trusted"] is False
    assert told["error"]["kind"] == "ChangedRunError"
    assert told["error"]["where"].endswith("0001.json")
    assert told["error"]["remedy"]
    letter = tmp_path / "letter.h5"
    letter.write_text("Dear Sir")
    for name in (letter, tmp_path / "leter.h5"):
        code, output, _ = rig("verify", name, "--json")
        told = json.loads(output)
        assert (code, told["trusted"]) == (6, False)
        assert str(name) in told["error"]["where"]


def test_unsealed_is_read_where_that_is_said_and_stands_on_the_page(run: Path) -> None:
    folder, page = run.parent, run.with_suffix(".html")
    take_the_note_of_the_analysis(run)
    with pytest.raises(UnsealedError):
        read_analyses(run)
    with allowing_unsealed():
        (found,) = read_analyses(run)
    assert found.seal_words.endswith(", not sealed")
    code, _, _ = rig("report", run, "--output", page, "--unsealed")
    assert code == 0
    assert "is not sealed: nothing beside it says" in " ".join(page.read_text().split())
    code, output, _ = rig("report", "--gear", "A1", "--passport", "--runs", folder, "--unsealed")
    assert code == 0
    assert "is not sealed: nothing beside it says" in " ".join(output.split())
    assert rig("verify", run, "--unsealed")[0] == 0


def as_of_0_2_0(run: Path) -> None:
    """The analysis as the version before stored it: of format 2, without a note."""
    rewritten(analysis_of(run), STORE_FORMAT, "harmonic-rig-analysis-2")
    hash_path(analysis_of(run)).unlink()


def test_an_analysis_of_0_2_0_is_read_and_told_as_not_sealed(run: Path) -> None:
    as_of_0_2_0(run)
    (found,) = read_analyses(run)
    assert found.seal_words.endswith(NOT_SEALED_THEN)
    links = {link.what: link for link in links_of_run(run)}
    assert (links["analysis"].severity, links["analysis"].found) == ("warns", NOT_SEALED_THEN)
    assert rig("verify", run)[0] == 0
    # The same result is stored once more, sealed.
    assert analyse(run, estimate(RUNNING, 0.0619)).number == 2


def test_a_note_without_its_file_is_a_number_that_is_taken(run: Path) -> None:
    """What a kill between note and file leaves."""
    analysis_of(run).unlink()
    assert read_analyses(run) == ()
    (left,) = [link for link in links_of_run(run) if link.what == "analysis"]
    assert (left.severity, Path(left.where)) == ("warns", analysis_of(run))
    assert "was cut off, or it was taken away" in left.found
    assert analyse(run, estimate(RUNNING, 0.06)).number == 2
    assert [found.number for found in read_analyses(run)] == [2]


def test_an_analysis_that_is_gone_with_its_note_is_missed_where_a_later_one_is(run: Path) -> None:
    analyse(run, estimate(RUNNING, 0.05))
    analysis_of(run).unlink()
    hash_path(analysis_of(run)).unlink()
    (gone,) = [link for link in links_of_run(run) if link.found.startswith("is not there")]
    assert (gone.severity, Path(gone.where)) == ("warns", analysis_of(run))


def test_figures_that_were_changed_are_refused(tmp_path: Path) -> None:
    import gzip

    run = copied(tmp_path, "00001-home-SN_010.h5")
    assert rig("fit", run)[0] == 0
    (figures,) = run.with_suffix(".analysis").glob("figures-*")
    figures.chmod(0o644)
    figures.write_bytes(gzip.compress(gzip.decompress(figures.read_bytes()) + b" "))
    with pytest.raises(ChangedRunError, match="figures"):
        read_analyses(run)[-1].whole_result()
    assert broken(run).startswith("figures")


def copied(folder: Path, *names: str) -> Path:
    """Runs of version 0.1.0 with their seals, without their analyses; the last of them."""
    path = folder
    for name in names:
        path = folder / name
        shutil.copy2(WRITTEN / name, path)
        shutil.copy2(hash_path(WRITTEN / name), hash_path(path))
    return path


def numbers_in(content: Any) -> int:
    if isinstance(content, dict):
        return sum(map(numbers_in, content.values()))
    if isinstance(content, list):
        return sum(map(numbers_in, content))
    return int(isinstance(content, (int, float)) and not isinstance(content, bool))


def test_an_analysis_made_again_is_equal_to_the_digit_and_an_edited_one_is_not(
    tmp_path: Path,
) -> None:
    run = copied(tmp_path, "00002-motor_tare-SN_010.h5", "00003-friction-SN_010.h5")
    tare = tmp_path / "00002-motor_tare-SN_010.h5"
    assert rig("fit", tare)[0] == 0
    assert rig("fit", run)[0] in (0, 1)
    (stored,) = read_analyses(run)
    assert stored.tare["analysis_sha256"] == read_analyses(tare)[0].seal.sha256
    made = recompute(run, stored)
    assert (made.severity, made.worst, made.differing) == ("passed", 0.0, ())
    assert made.numbers >= numbers_in(stored.content["result"])
    code, output, _ = rig("verify", run, "--recompute", "--json")
    assert (code, json.loads(output)["recomputed"][0]["worst"]) == (0, 0.0)
    # Numbers and note changed by somebody who knows of the note.
    name, told = next(iter(stored.content["result"]["parameters"].items()))
    value = told["value"]
    rewritten(analysis_of(run), repr(value), repr(0.5 * value))
    reseal(analysis_of(run))
    assert rig("verify", run)[0] == 0
    code, output, _ = rig("verify", run, "--recompute", "--json")
    found = json.loads(output)["recomputed"][0]
    assert (code, found["level"], found["worst"]) == (6, "error", pytest.approx(0.5))
    assert any(f"result.parameters.{name}.value" in line for line in found["differing"])
    # An old analysis of the tare put in the place of the one that was subtracted.
    rewritten(analysis_of(tare), '"created": "2', '"created": "1')
    reseal(analysis_of(tare))
    assert broken(run) == "tare 0001.json"


def test_an_analysis_of_another_version_is_not_made_again_and_says_so(run: Path) -> None:
    version = catalogue.load("friction").version
    rewritten(analysis_of(run), f'"analysis_version": {version}', '"analysis_version": 1')
    reseal(analysis_of(run))
    made = recompute(run, read_analyses(run)[0])
    assert made.severity is Severity.WARNS
    assert f"version 1 of friction, which is at {version}" in made.words


def campaign(run: Path) -> Path:
    """A journal that names a run with its hash, and a certificate and an acceptance file at its end."""
    plan, at = shipped_plan("incoming"), "2026-01-01T08:00:00+00:00"
    noted = hash_path(run).read_text().split()[0]
    stage = DoneStage(
        index=0, protocol="home", run=run.name, outcome="COMPLETED", at=at, sha256=noted
    )
    accepted = acceptance_named("demonstration")
    rests_on = {"acceptance": accepted.path, "acceptance_sha256": accepted.sha256}
    facts = {"bench": "0", "mounted": {}}
    begun = journals.begin(run.parent, plan, "A1", facts, at).with_stage(stage)
    return begun.with_end("PASS", "", at, rests_on).path


@pytest.mark.parametrize(
    ("before", "after"),
    [("COMPLETED", "TRIPPED"), ('"what": "stage"', '"what": "other"'), ('"bench": "0"', '"bench": "1"')],
)  # fmt: skip
def test_a_line_of_a_journal_that_was_changed_is_refused(
    run: Path, before: str, after: str
) -> None:
    path = campaign(run)
    assert broken(run.parent) == ""
    rewritten(path, before, after)
    with pytest.raises(ChangedRunError, match=r"line \d"):
        journals.read(path)
    assert broken(run.parent) == f"campaign {path.name}"


def test_a_line_taken_out_of_a_journal_is_found_and_one_cut_off_is_not_counted(run: Path) -> None:
    path = campaign(run)
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(lines[0] + lines[2])
    assert broken(path) == f"campaign {path.name}"
    path.write_bytes(b"".join(lines)[:-5])
    journal = journals.read(path)
    assert journal is not None
    assert journal.ended is None
    again = journal.with_end("FAIL", "", "2026-01-02")
    assert journals.read(again.path) == again


def test_a_run_put_in_the_place_of_one_that_a_journal_names_is_found(run: Path) -> None:
    path = campaign(run)
    run.chmod(0o644)
    run.write_bytes(run.read_bytes() + b" ")
    reseal(run)
    assert broken(path) == f"run {run.name}"


def test_a_journal_of_0_2_0_holds_no_hashes_and_is_read(run: Path) -> None:
    path = campaign(run)
    rows = [json.loads(line) for line in path.read_text().splitlines()]
    for row in rows:
        del row["before"]
    rows[0]["format"] = journals.FORMAT_1
    path.write_text("".join(f"{json.dumps(row)}\n" for row in rows))
    journal = journals.read(path)
    assert journal is not None
    assert not journal.is_chained
    assert next(link.found for link in links_of(path)) == "not sealed (0.2.0)"


def test_a_choice_by_hand_that_was_changed_is_refused(run: Path) -> None:
    analyse(run, estimate(RUNNING, 0.05))
    keep(run, 2, "B. Other", "2026-01-01")
    rewritten(run.with_suffix(".analysis") / "kept.json", '"number": 2', '"number": 1')
    with pytest.raises(ChangedRunError, match=r"kept\.json"):
        in_force(run)
    assert broken(run).startswith("choice")
