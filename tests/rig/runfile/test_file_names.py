"""Names that one of the systems cannot have are refused, or written otherwise, on every system."""

from __future__ import annotations

from pathlib import Path, PurePosixPath, PureWindowsPath

import pytest

from rig import main
from rig.gears.card_places import card_file
from rig.runfile.file_names import is_device, unportable


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
