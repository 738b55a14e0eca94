"""Names that one of the systems cannot have are refused, or written otherwise, on every system."""

from __future__ import annotations

import os
from pathlib import Path, PurePosixPath, PureWindowsPath
from types import SimpleNamespace

import pytest

from rig import main
from rig.errors import ConfigurationError, RunFileError
from rig.gears.card import list_cards, save_card, with_changes
from rig.gears.card_places import card_file
from rig.library.folder import claim_run
from rig.runfile.file_names import is_device, unportable

AT = "2026-11-27T08:00:00+00:00"


@pytest.mark.parametrize("name", ["CON", "con.pdf", "Nul", "COM1.tar.gz", "lpt9", "aux .txt"])
def test_names_of_devices_are_known(name: str) -> None:
    assert is_device(name)
    assert "device on Windows" in unportable(PurePosixPath("runs") / name)


@pytest.mark.parametrize("name", ["CONTROL", "com", "com10", "nully.pdf", "a.con", "..", "."])
def test_names_like_them_are_names(name: str) -> None:
    assert not is_device(name)
    assert unportable(PurePosixPath("runs") / name) == ""


def test_a_path_from_a_root_is_one() -> None:
    assert unportable(PurePosixPath("/data/runs/a.pdf")) == ""
    assert unportable(PureWindowsPath(r"C:\data\runs")) == ""
    assert "ends with a dot or a blank" in unportable(PurePosixPath("/data/runs./a.pdf"))


def test_a_gear_that_is_called_as_a_device_has_a_card_all_the_same() -> None:
    assert card_file("con") == "%63on.toml"
    assert card_file("CON-1") == "CON-1.toml"


@pytest.mark.parametrize(
    "words",
    [
        ("report", "--gear", "A1", "--output", "aux.pdf"),
        ("run", "home", "--gear", "A1", "--runs", "nul"),
        ("export", "a.h5", "--output", "rows."),
    ],
)
def test_a_command_does_not_write_one(
    words: tuple[str, ...],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as ended:
        main.run(list(words))
    assert ended.value.code == 2
    assert "Windows" in " ".join(capsys.readouterr().err.split())
    assert not list(tmp_path.iterdir())


def test_a_path_that_is_too_long_for_windows_is_refused_before_a_number_is_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    deep = tmp_path / ("a" * 150) / ("b" * 150)
    assert claim_run(deep, "home", "A1").number == 1
    # Not `os` itself: paths of this system stay what they are.
    monkeypatch.setattr("rig.runfile.file_names.os", SimpleNamespace(name="nt", path=os.path))
    with pytest.raises(RunFileError, match="letters, allowed 259"):
        claim_run(deep, "home", "A1")
    assert sorted(path.name for path in (deep / ".run-numbers").iterdir()) == ["00001"]
    assert claim_run(tmp_path / "near", "home", "A1").number == 1


def test_a_serial_that_differs_in_capitals_alone_gets_no_card_of_its_own(tmp_path: Path) -> None:
    for serial in ("SN-1", "SN-1", "SN-2"):
        save_card(tmp_path, with_changes(None, {"serial": serial}, "A. Example", AT))
    with pytest.raises(ConfigurationError, match="differs in capitals alone"):
        save_card(tmp_path, with_changes(None, {"serial": "sn-1"}, "A. Example", AT))
    assert len(list_cards(tmp_path)) == 2
