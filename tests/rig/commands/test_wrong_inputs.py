"""What people type wrong: the right exit code, no traceback, and nothing left behind."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest

import rig
from rig import main

LIST = Path(__file__).with_name("wrong_inputs.txt")
QUICK = {"points": 6, "measure_time": 0.2, "settle_time": 0.15, "lowest_rpm": 8.0, "seed": 9931}


def wrong_inputs() -> list[tuple[int, str]]:
    rows = [line.split(None, 1) for line in LIST.read_text(encoding="utf-8").splitlines()]
    return [(int(row[0]), row[1].strip()) for row in rows if row and row[0].isdigit()]


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, str]]:
    """A folder with a tare and an analysed run, a file that is neither, an empty folder; what the list calls them."""
    place = tmp_path_factory.mktemp("place")
    folder = place / "f"
    tare = rig.execute("motor-tare", folder=folder, **QUICK)
    run = rig.execute("friction", serial="A1", folder=folder, **QUICK)
    rig.fit(run).store()
    (place / "notes.toml").write_text("hello, this is no parameter set", encoding="utf-8")
    (place / "e").mkdir()
    names = {"tare": f"f/{tare.path.name}", "run": f"f/{run.path.name}"}
    return place, {**names, "folder": "f", "notes": "notes.toml", "empty": "e"}


def test_the_list_is_long_and_says_nothing_twice() -> None:
    commands = [command for _, command in wrong_inputs()]
    assert len(commands) >= 120
    assert len(set(commands)) == len(commands)


@pytest.mark.parametrize(("code", "command"), wrong_inputs())
def test_it_is_refused_in_words_and_leaves_nothing_behind(
    code: int,
    command: str,
    given: tuple[Path, dict[str, str]],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    if command.startswith("fleet fit"):
        pytest.importorskip("pyarrow")
    place, names = given
    monkeypatch.chdir(place)
    before = set(place.rglob("*"))
    words = shlex.split(command.format(**names))
    with pytest.raises(SystemExit) as ended:
        main.run([] if words == ["rig"] else words)
    told = "".join(capsys.readouterr())
    assert ended.value.code == code, told
    assert len(told.split()) > 5
    assert "Traceback" not in told
    assert "defect" not in told
    # What a library says of a value, in its own words.
    assert "Input should" not in told
    assert "Value error" not in told
    # One thing that is wrong is said once.
    assert told.count("there is no such file") <= 1
    assert set(place.rglob("*")) == before


@pytest.mark.parametrize(
    ("command", "said"),
    [
        ("gear nosuch", "There are: new, check, list, show, set, confirm."),
        ("nosuch", "help."),
        ("fti x.h5", "Did you mean 'fit'?"),
        ("run friction --lowest-rmp 3", "Did you mean --lowest-rpm?"),
        ("runs --last x", "value x, allowed a whole number"),
        ("runs --last -1", "value -1, allowed 0 and more"),
        ("sim serve --sample-rate 10", "value 10, allowed 50 to 20000 Hz"),
        ("sim serve --lifetime -1", "value -1, allowed 0 s and more"),
        ("plan friction --measure-time inf", "and <= 600 s"),
        ("report x.h5 --format docx", "value docx, allowed html, pdf, both"),
    ],
)
def test_what_is_allowed_is_said(
    command: str, said: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    with pytest.raises(SystemExit):
        main.run(shlex.split(command))
    assert said in " ".join("".join(capsys.readouterr()).split())


def test_what_is_wrong_with_a_description_is_said_with_its_reason(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    file = tmp_path / "rig.toml"
    file.write_text('format = "x"\n[rig]\nnosuch = 1\nmotor = "gone.toml"\n', encoding="utf-8")
    with pytest.raises(SystemExit):
        main.run(["config", "check", str(file)])
    told = " ".join(capsys.readouterr().out.split())
    assert "rig.nosuch 1: no such word here" in told
    assert "There are: gear, location, motor" in told
    assert "rig.name is missing" in told
    assert told.count("is not the format of a rig's description") == 1
