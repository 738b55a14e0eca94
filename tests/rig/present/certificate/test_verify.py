"""A certificate is held against its seals, its record, the analyses and what it rests on; each is found by itself."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from typer.testing import CliRunner

from experiments.finding import Severity
from rig.analysis import store
from rig.errors import RigError
from rig.main import app
from rig.present.certificate.record import FORMAT_1
from rig.present.certificate.verify import verify_certificate
from rig.present.certificate.write import write_certificate
from rig.program import Program
from rig.runfile.manifest import Entry, Manifest, read_manifest
from rig.runfile.sealed import seal_in_place
from tests.rig.library.stored import RUNNING
from tests.rig.present.certificate.test_certificate import LABORATORY, accepted, gear, sheets_in

AT = "2026-03-02T10:00:00+00:00"
ROOT = Path(__file__).parents[4]


@pytest.fixture(scope="module")
def certified_gear(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with two runs and their certificate, as HTML: a PDF takes a second to be read."""
    folder = gear(tmp_path_factory.mktemp("certified"))
    write_certificate(
        folder,
        "A1",
        [folder / "c.html"],
        acceptance=accepted(folder),
        laboratory=LABORATORY,
        created=AT,
    )
    return folder


@pytest.fixture
def folder(certified_gear: Path, tmp_path: Path) -> Path:
    """A copy of it that may be attacked, at another place."""
    return Path(shutil.copytree(certified_gear, tmp_path / "copy"))


def overwrite(path: Path, data: bytes, *, seal: bool = True) -> None:
    """Change a read-only file; with `seal` its note as well, as somebody would who knows how."""
    path.chmod(0o644)
    path.write_bytes(data)
    if seal:
        seal_in_place(path, data)


def edit_record(folder: Path, edit: Callable[[dict[str, Any]], None]) -> None:
    record = json.loads((folder / "c.json").read_text(encoding="utf-8"))
    edit(record)
    overwrite(folder / "c.json", json.dumps(record).encode())


def errors(folder: Path, name: str = "c.html") -> dict[str, str]:
    """The checks that found something wrong, with what they say."""
    return {
        f.what: f.found for f in verify_certificate(folder / name) if f.severity is Severity.BLOCKS
    }


@pytest.mark.parametrize("name", ["c.html", "c.json"])
def test_a_certificate_that_nobody_touched_is_believed_wherever_it_lies(
    folder: Path, name: str
) -> None:
    assert errors(folder, name) == {}
    checks = {f.what for f in verify_certificate(folder / name) if f.severity is Severity.PASSED}
    assert checks == {"seal", "rests on", "numbers", "verdict", "printed"}


def test_its_record_keeps_the_published_schema(certified_gear: Path) -> None:
    schema = json.loads((ROOT / "docs/reference/certificate.schema.json").read_text("utf-8"))
    check = jsonschema.Draft202012Validator(schema)
    record = json.loads((certified_gear / "c.json").read_text(encoding="utf-8"))
    assert list(check.iter_errors(record)) == []
    assert set(record) == set(schema["properties"])
    (number,) = record["analyses"][1]["numbers"].values()
    assert (number["unit"], number["degrees_of_freedom"]) == ("N m", None)
    for key in record:
        assert list(check.iter_errors({k: v for k, v in record.items() if k != key})), key
    number["coverage_factor"] = "two"
    assert list(check.iter_errors(record))


def test_a_record_of_many_pages_is_still_read(folder: Path) -> None:
    """Format 1: every number stands on some page, and the manifest's hash on page one."""

    def older(record: dict[str, Any]) -> None:
        record["format"] = FORMAT_1
        del record["page_two"], record["page_one"]["texts"]

    edit_record(folder, older)
    assert set(errors(folder)) == {"printed"}
    assert "on page one" in errors(folder)["printed"]


def test_page_two_is_held_against_the_record(folder: Path) -> None:
    edit_record(folder, lambda record: record["page_two"].append("Method TI 13"))
    assert "on no page: Method TI 13" in errors(folder)["printed"]


def test_a_changed_page_without_its_note_is_refused(folder: Path) -> None:
    page = folder / "c.html"
    text = page.read_text(encoding="utf-8").replace("80.00", "30.00")
    overwrite(page, text.encode(), seal=False)
    assert set(errors(folder)) == {"seal", "pages", "printed"}


def test_a_page_that_was_sealed_anew_is_not_the_one_of_the_record(folder: Path) -> None:
    page = folder / "c.html"
    text = page.read_text(encoding="utf-8").replace("80.00", "30.00")
    overwrite(page, text.encode())
    found = errors(folder)
    assert set(found) == {"pages", "printed"}
    assert "80.00 ± 0.39 mN m" in found["printed"]


def test_a_number_beside_the_right_one_is_seen(folder: Path) -> None:
    page = folder / "c.html"
    text = page.read_text(encoding="utf-8")
    overwrite(page, text.replace("Harmonic drive", "30.00 ± 0.39 mN m, harmonic drive").encode())
    assert "values with their U" in errors(folder)["printed"]


def test_another_pdf_under_the_same_name_does_not_say_what_the_record_says(
    folder: Path, tmp_path: Path
) -> None:
    write_certificate(folder, "A1", [folder / "c.pdf"], acceptance=accepted(folder), created=AT)
    assert errors(folder, "c.pdf") == {}
    (tmp_path / "other").mkdir()
    other = gear(tmp_path / "other", torque=0.03)
    write_certificate(other, "A1", [other / "c.pdf"], acceptance=accepted(other), created=AT)
    forged = (other / "c.pdf").read_bytes()
    overwrite(folder / "c.pdf", forged)
    edit_record(folder, lambda r: r["files"].update({"c.pdf": hashlib.sha256(forged).hexdigest()}))
    assert set(errors(folder, "c.pdf")) == {"printed"}


def test_a_record_with_other_numbers_is_held_against_the_analyses(folder: Path) -> None:
    def edit(record: dict[str, Any]) -> None:
        record["analyses"][1]["numbers"][RUNNING]["value"] = 0.03

    edit_record(folder, edit)
    found = errors(folder)
    assert set(found) == {"numbers"}
    assert "0.03" in found["numbers"]
    assert "0.08" in found["numbers"]


def test_a_verdict_that_the_analyses_do_not_give_is_seen(tmp_path: Path) -> None:
    folder = gear(tmp_path, torque=0.12)
    write_certificate(folder, "A1", [folder / "c.html"], acceptance=accepted(folder), created=AT)

    def edit(record: dict[str, Any]) -> None:
        record["verdict"] = "PASS"
        for line in record["limits"]:
            line["outcome"] = "PASS"

    edit_record(folder, edit)
    assert "FAIL" in errors(folder, "c.html")["verdict"]


def test_what_it_rests_on_is_hashed_again(folder: Path) -> None:
    spec = folder / "spec.toml"
    spec.write_text(spec.read_text().replace("90", "95"))
    assert "spec.toml was changed" in errors(folder)["rests on"]
    spec.unlink()
    assert "is missing" in errors(folder)["rests on"]


def test_a_card_that_was_written_on_since_is_told_and_contradicts_nothing(folder: Path) -> None:
    path = folder / "c.manifest.txt"
    listed = read_manifest(path)
    card = Entry(".gears/A1.toml", "gear card", "a" * 64)
    now = Manifest.made_of(listed.of, [*listed.entries, card])
    overwrite(path, now.as_bytes())
    edit_record(folder, lambda r: r["manifest"].update({"sha256": now.sha256}))
    told = [f.found for f in verify_certificate(folder / "c.html") if f.severity is Severity.WARNS]
    assert any("gear card" in text for text in told)
    assert "rests on" not in errors(folder)


def test_a_manifest_sealed_anew_is_not_the_one_of_the_record(folder: Path) -> None:
    path = folder / "c.manifest.txt"
    listed = read_manifest(path)
    fewer = Manifest.made_of(listed.of, [e for e in listed.entries if e.kind != "acceptance"])
    overwrite(path, fewer.as_bytes())
    assert "not the one that the record names" in errors(folder)["rests on"]
    edit_record(folder, lambda r: r["manifest"].update({"sha256": fewer.sha256}))
    assert fewer.sha256 in errors(folder)["printed"]


@pytest.mark.parametrize("name", ["c.json", "c.manifest.txt"])
def test_without_its_record_or_its_manifest_it_is_no_certificate(folder: Path, name: str) -> None:
    (folder / name).unlink()
    assert name in errors(folder)["readable"]


def test_a_simulated_gear_cannot_be_relabelled(folder: Path) -> None:
    def edit(record: dict[str, Any]) -> None:
        for one in record["analyses"]:
            one["origin"] = "hardware"

    edit_record(folder, edit)
    assert "is simulated" in errors(folder)["origin"]


@pytest.mark.parametrize(("name", "text"), [("c.json", "{}"), ("c.html", "of whom?")])
def test_what_is_no_certificate_is_not_written_over(tmp_path: Path, name: str, text: str) -> None:
    folder = gear(tmp_path)
    (folder / name).write_text(text)
    with pytest.raises(RigError, match="no earlier certificate of gear A1"):
        write_certificate(folder, "A1", [folder / "c.html"], created=AT)
    assert (folder / name).read_text() == text


def test_the_certificate_of_another_gear_is_not_written_over_and_an_earlier_one_is(
    folder: Path,
) -> None:
    edit_record(folder, lambda record: record.update(serial="B2"))
    before = (folder / "c.html").read_bytes()
    with pytest.raises(RigError, match="--output"):
        write_certificate(folder, "A1", [folder / "c.html"], created="2026-03-03")
    assert (folder / "c.html").read_bytes() == before
    edit_record(folder, lambda record: record.update(serial="A1"))
    write_certificate(folder, "A1", [folder / "c.html"], created="2026-03-03")
    assert (folder / "c.html").read_bytes() != before


def test_it_rests_on_nothing_that_came_later_nor_on_itself(folder: Path) -> None:
    kinds = {entry.name: entry.kind for entry in read_manifest(folder / "c.manifest.txt").entries}
    assert not [name for name in kinds if name.startswith("c.")]
    assert sorted(kinds.values()) == (
        ["acceptance", "analysis", "analysis", "figures", "figures", "program", "run", "run"]
    )


def test_analyses_by_different_programs_are_said_to_be(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = gear(tmp_path)
    other = Program("0.3.0", "d" * 40, "e" * 64)
    monkeypatch.setattr(store, "this_program", lambda: other)
    from tests.rig.library.stored import estimate
    from tests.rig.present.certificate.test_certificate import lay

    lay(folder, 3, "friction", {RUNNING: estimate(RUNNING, 0.08, own=2e-4)})
    (remark,) = sheets_in(folder).back.remarks
    assert "different programs" in remark
    assert "friction by version 0.3.0, commit dddddddddddd, files eeeeeeeeeeee" in remark


def test_the_command_writes_a_manifest_once_and_holds_the_folder_against_it(folder: Path) -> None:
    def verify(*words: str) -> tuple[int, dict[str, Any]]:
        ran = CliRunner().invoke(app, ["verify", str(folder), *words, "--json"])
        return ran.exit_code, json.loads(ran.stdout)

    file = str(folder / "m.txt")
    code, told = verify("--manifest", file)
    assert (code, told["manifest"]["written"]) == (0, True)
    listed = Path(file).read_bytes()
    assert told["manifest"]["sha256"] == hashlib.sha256(listed).hexdigest()
    code, told = verify("--manifest", file)
    assert (code, told["manifest"]["missing"], told["manifest"]["added"]) == (0, [], [])
    for path in folder.glob("c.*"):
        path.chmod(0o644)
        path.unlink()
    code, told = verify("--manifest", file)
    assert code == 6
    assert [one["name"] for one in told["manifest"]["missing"]] == (
        ["c.html", "c.json", "c.manifest.txt"]
    )
    assert Path(file).read_bytes() == listed
    other = Manifest.made_of("gear B2", [Entry("x", "run", "a" * 64)])
    Path(file).write_bytes(other.as_bytes())
    ran = CliRunner().invoke(app, ["verify", str(folder), "--manifest", file])
    assert "manifest of something else" in str(ran.exception)


def test_the_command_names_what_is_wrong_with_a_certificate(folder: Path) -> None:
    ran = CliRunner().invoke(app, ["verify", str(folder / "c.html")])
    assert ran.exit_code == 0
    edit_record(folder, lambda record: record.update({"verdict": "FAIL"}))
    ran = CliRunner().invoke(app, ["verify", str(folder / "c.html"), "--json"])
    assert ran.exit_code == 6
    assert "verdict" in json.loads(ran.stdout)["error"]["message"]
