"""The seal of a run: whoever opens it to work with it is given the file that was sealed, or is refused."""

import json
import os
import re
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import h5py
import pytest
from typer.testing import CliRunner

from rig.analysis.difference import difference
from rig.analysis.fit.recorded import NOT_SEALED
from rig.analysis.passport.build import passport
from rig.bench.backends.order import Order
from rig.bench.backends.replayed import replayed
from rig.errors import ChangedRunError, RunFileError, UnsealedError
from rig.main import app
from rig.present.build import report_on_files, report_on_gear
from rig.runfile import opening, read, seal
from rig.runfile.read import close_recording, open_run
from rig.runfile.seal import allowing_unsealed, check_seal, file_sha256, hash_path
from tests.rig.fitting import fit_files
from tests.rig.library import stored
from tests.rig.runfile.making import edit, reseal, write_run


def change(path: Path) -> str:
    """One byte of a run's title is another one, where no checksum sees it; returns the hash that is noted."""
    noted = hash_path(path).read_text().split()[0]
    with edit(path) as file:
        file["entry/title"][()] = b"no-load running torqve"
    return noted


def worked_with(path: Path) -> dict[str, Callable[[], object]]:
    """Everything that opens a run to state something of it."""
    report = path.parent / "report.html"
    return {
        "open": lambda: open_run(path),
        "fit": lambda: fit_files([path]),
        "report": lambda: report_on_files([path], report),
        "report of the gear": lambda: report_on_gear(path.parent, "A1", [report]),
        "passport": lambda: passport(path.parent, "A1"),
        "diff": lambda: difference(path, path),
        "replay": lambda: replayed(path, Order(protocol="")),
    }


@pytest.mark.parametrize("use", worked_with(Path("run.h5")))
def test_a_changed_run_is_refused_with_what_differs(tmp_path: Path, use: str) -> None:
    path = write_run(tmp_path, 40)
    noted = change(path)
    with pytest.raises(ChangedRunError) as refusal:
        worked_with(path)[use]()
    text = str(refusal.value)
    assert file_sha256(path) in text
    assert noted in text
    assert f"{path.stat().st_size} bytes" in text
    assert len(re.findall(r"\d{4}-\d\d-\d\dT", text)) == 2
    assert not list(path.parent.glob("report*"))


@pytest.mark.parametrize("command", ["fit", "show", "report", "export"])
def test_the_commands_refuse_it_with_exit_code_6(
    tmp_path: Path, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    from rig.main import run

    path = write_run(tmp_path, 40)
    change(path)
    with pytest.raises(SystemExit) as end:
        run([command, str(path)])
    assert end.value.code == 6
    assert "was changed since it was sealed" in capsys.readouterr().err


def test_a_run_that_is_sealed(tmp_path: Path) -> None:
    path = write_run(tmp_path, 40)
    recording = open_run(path)
    assert recording.metadata.is_sealed
    assert recording.metadata.seal == recording.metadata.sha256 == file_sha256(path)
    close_recording(recording)


@pytest.mark.parametrize("use", worked_with(Path("run.h5")))
def test_a_run_without_a_note_is_refused(tmp_path: Path, use: str) -> None:
    path = stored.write(tmp_path, 1)
    stored.analyse(path, stored.estimate(stored.RUNNING, 0.08))
    hash_path(path).unlink()
    with pytest.raises(UnsealedError, match="the note of its SHA-256 is missing"):
        worked_with(path)[use]()


def test_a_run_without_a_note_is_used_where_that_is_said_and_every_page_says_so(
    tmp_path: Path,
) -> None:
    path = stored.write(tmp_path, 1)
    stored.analyse(path, stored.estimate(stored.RUNNING, 0.08))
    hash_path(path).unlink()
    with allowing_unsealed():
        recording = open_run(path)
        assert recording.metadata.seal == f"{file_sha256(path)}, not sealed"
        close_recording(recording)
        with pytest.raises(RunFileError, match="has no note"):
            open_run(path, verify=True)

    def call(*words: str) -> str:
        return CliRunner().invoke(app, [*words, "--unsealed"]).output

    assert "NOT SEALED" in call("show", str(path))
    assert json.loads(call("show", str(path), "--json"))["sealed"] is False
    assert "not sealed" in call("verify", str(path))
    shown = call("report", "--gear", "A1", "--passport", "--runs", str(tmp_path))
    assert "is not sealed" in " ".join(shown.split())
    export, page = tmp_path / "run.csv", tmp_path / "gear.html"
    call("export", str(path), "--output", str(export))
    assert "not sealed" in export.read_text()
    call("report", "--gear", "A1", "--runs", str(tmp_path), "--output", str(page))
    assert NOT_SEALED in page.read_text()
    assert "NOT SEALED" in page.read_text()
    # What one command was allowed, the next is not.
    assert CliRunner().invoke(app, ["show", str(path)]).exit_code


@pytest.mark.parametrize("content", ["", "\n", "no hash"])
def test_a_note_that_holds_no_hash_is_no_missing_note(tmp_path: Path, content: str) -> None:
    path = write_run(tmp_path, 40)
    hash_path(path).chmod(0o644)
    hash_path(path).write_text(content)
    with pytest.raises(ChangedRunError):
        open_run(path)


def hashed(path: Path, monkeypatch: pytest.MonkeyPatch, *, anew: bool = False) -> bool:
    """Whether a look at the seal read the file."""
    read: list[Path] = []
    with monkeypatch.context() as patch:
        patch.setattr(seal, "file_sha256", lambda run: read.append(run) or file_sha256(run))
        later = 10**12 + path.stat().st_ctime_ns
        check_seal(path, anew=anew, now_ns=lambda: later)
    return bool(read)


def test_a_file_is_not_read_twice_unless_it_changed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_run(tmp_path, 40)
    assert hashed(path, monkeypatch)
    assert not hashed(path, monkeypatch)
    assert hashed(path, monkeypatch, anew=True)
    before = path.stat()
    path.chmod(0o644)
    raw = path.read_bytes()
    path.write_bytes(raw[:-1] + b"x")
    # Neither its size nor the time that a user can set gives it away.
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    with pytest.raises(ChangedRunError):
        check_seal(path)
    path.unlink()
    path.write_bytes(raw)
    assert hashed(path, monkeypatch)
    seal.forget_hashes()
    assert hashed(path, monkeypatch)


def test_no_more_hashes_are_remembered_than_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A process that goes through ten thousand runs must not grow by each of them."""
    monkeypatch.setattr(seal, "HASHES_KEPT", 2)
    monkeypatch.setattr(seal, "_hashes", OrderedDict())
    folders = [tmp_path / name for name in "abc"]
    for folder in folders:
        folder.mkdir()
    paths = [write_run(folder, 10) for folder in folders]
    for path in paths:
        assert hashed(path, monkeypatch)
    assert [hashed(path, monkeypatch) for path in paths[1:]] == [False, False]
    assert hashed(paths[0], monkeypatch)
    assert len(seal._hashes) == 2


def test_a_hash_of_a_moment_ago_is_not_leant_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two changes within one tick of the file system's clock look alike."""
    path = write_run(tmp_path, 40)
    at_once = path.stat().st_ctime_ns + 1
    read: list[Path] = []
    monkeypatch.setattr(seal, "file_sha256", lambda run: read.append(run) or file_sha256(run))
    for _ in range(2):
        check_seal(path, now_ns=lambda: at_once)
    assert len(read) == 2


def test_verify_and_report_read_the_bytes_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_run(tmp_path, 40)
    noted = hash_path(path).read_text().split()[0]
    change(path)
    # As if an earlier look had found these very bytes to be the sealed ones.
    monkeypatch.setitem(seal._hashes, seal._fingerprint(path), noted)
    close_recording(open_run(path))
    result = CliRunner().invoke(app, ["verify", str(path), "--json"])
    assert json.loads(result.output)["trusted"] is False
    with pytest.raises(ChangedRunError):
        report_on_files([path], tmp_path / "report.html")


def test_a_note_that_is_made_anew_is_believed(tmp_path: Path) -> None:
    """What the documentation says of a hash beside a file: it proves no author."""
    path = write_run(tmp_path, 40)
    change(path)
    reseal(path)
    assert open_run(path).metadata.title == "no-load running torqve"
    with h5py.File(path) as file:
        assert cast(Any, file["entry/title"])[()] == b"no-load running torqve"


def test_bytes_that_were_found_sound_are_not_examined_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Other tests of this process may have looked at the same bytes.
    monkeypatch.setattr(read, "_sound", OrderedDict())
    examined: list[str] = []
    examine = opening._examine

    def told(file: h5py.File, **how: Any) -> None:
        examined.append(file.filename)
        examine(file, **how)

    monkeypatch.setattr(opening, "_examine", told)
    path = write_run(tmp_path, 40)
    first, again = (open_run(path, rows=rows) for rows in (False, True))
    assert len(examined) == 1
    assert again.signals == first.signals
    for recording in (first, again):
        close_recording(recording)
    # Other bytes under the same name, with a note of their own.
    with edit(path) as file:
        file["entry/title"][()] = b"no-load running torqve"
    reseal(path)
    close_recording(open_run(path))
    assert len(examined) == 2
