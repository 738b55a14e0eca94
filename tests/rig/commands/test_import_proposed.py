"""`rig import FILE` and nothing else, as a script and as somebody at a terminal."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import h5py
import numpy as np
import pytest
import typer

from rig import main
from rig.commands import import_proposed
from rig.runfile.importing.accepting import FLAGS
from rig.runfile.importing.map_keys import GEAR_KEYS, RECORDING_KEYS


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def called(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as ended:
        main.run(list(words))
    shown = capsys.readouterr()
    return int(ended.value.code or 0), shown.out, shown.err


def swinging(units: bool) -> Path:
    """A log of a joint that swings."""
    time = np.arange(3000) * 0.002
    columns = {
        "time [s]": time,
        "pos [rad]" if units else "pos": 1.3 * np.sin(1.7 * time),
        "tau [N m]" if units else "tau": 0.4 * np.sign(np.cos(1.7 * time)),
    }
    path = Path("joint.csv")
    rows = np.column_stack(list(columns.values()))
    np.savetxt(path, rows, delimiter=",", header=",".join(columns), comments="")
    return path


def stated(run: Path) -> dict[str, object]:
    with h5py.File(run) as file:
        found: dict[str, object] = json.loads(file["entry/process/details"][()])["stated"]
        return found


def test_its_page_is_opened_with_the_numbers_of_what_it_bears(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    path = swinging(units=True)
    code, out, _ = called(capsys, "import", str(path), "--accept", "--open")
    assert code == 0
    (page,) = Path("runs").glob("*.html")
    assert opened == [page.absolute().as_uri()]
    assert f"page  {page}" in out
    assert "Coulomb friction" in page.read_text(encoding="utf-8")
    assert called(capsys, "import", str(path), "--accept", "--open", "--json")[0] == 2


def test_a_script_takes_over_what_has_evidence(capsys: pytest.CaptureFixture[str]) -> None:
    path = swinging(units=True)
    words = ("import", str(path), "--accept", "--operator", "A. Example", "--save-map", "map.toml")
    code, out, _ = called(capsys, *words)
    assert code == 0
    (run,) = Path("runs").glob("*.h5")
    said = stated(run)
    assert said["accepted_by"] == "A. Example"
    assert "position = pos [rad] [rad]: called 'pos [rad]'; unit rad as written" in str(
        said["proposed"]
    )
    assert "good for motion" in out
    # The one command that does the same, and the map, make the same rows.
    (line,) = (line for line in out.splitlines() if "without a question" in line)
    again = shlex.split(line.partition(": ")[2])[1:]
    assert called(capsys, *again, "--runs", "second")[0] == 0
    assert (
        called(capsys, "import", "csv", str(path), "--map", "map.toml", "--runs", "third")[0] == 0
    )
    rows = []
    for folder in ("runs", "second", "third"):
        with h5py.File(next(Path(folder).glob("*.h5"))) as file:
            rows.append({name: np.asarray(data) for name, data in file["entry/data"].items()})
    for other in rows[1:]:
        assert other.keys() == rows[0].keys()
        assert all(np.array_equal(other[name], rows[0][name]) for name in other)
    assert "proposed" not in stated(next(Path("second").glob("*.h5")))


SAID = (
    *("--lag", "torque=2ms", "--accuracy", "position=5arcsec", "--modulus", "position=40"),
    *("--skip", "1", "--decimal", ".", "--drop-bad-rows", "--interpolate", "--gap", "2.5", "--allow-jumps"),
    *("--start", "2026-03-01T10:00:00+00:00", "--time-base", "host", "--torque-constant", "0.1234567891"),
    *("--gear", "R7", "--ratio", "100", "--mounting", "flexspline-fixed", "--resonance-hz", "31.5"),
    *("--load-inertia", "0.25", "--condition", "load_kg=2.5", "--condition", "oil=4 B No. 2"),
    *("--title", "a joint, swinging", "--operator", "A. Example"),
)  # fmt: skip


def test_what_was_said_beside_a_proposal_is_in_the_command_and_in_the_map(
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = swinging(units=True)
    path.write_text("made by a logger\n" + path.read_text())
    words = ("import", str(path), "--accept", *SAID, "--save-map", "map.toml")
    code, out, err = called(capsys, *words)
    assert (code, err) == (0, "")
    (line,) = (line for line in out.splitlines() if "without a question" in line)
    again = shlex.split(line.partition(": ")[2])[1:]
    assert called(capsys, *again, "--runs", "second")[0] == 0
    assert called(capsys, "import", str(path), "--map", "map.toml", "--runs", "third")[0] == 0
    proposals = ("proposed", "accepted_by")
    (run,), *others = (list(Path(folder).glob("*.h5")) for folder in ("runs", "second", "third"))
    said = {key: value for key, value in stated(run).items() if key not in proposals}
    with h5py.File(run) as first:
        for (other,) in others:
            assert stated(other) == said
            with h5py.File(other) as second:
                assert first["entry/title"][()] == second["entry/title"][()]
                assert first["entry/start_time"][()] == second["entry/start_time"][()]


def test_every_key_of_a_map_is_a_flag() -> None:
    """So that what stands in a map can be said at the terminal too, and written down as a command."""
    command = typer.main.get_command(main.app).commands["import"]  # type: ignore[attr-defined]
    flags = {flag for one in command.params for flag in one.opts}
    for key in (*RECORDING_KEYS, *GEAR_KEYS):
        assert FLAGS.get(key.name, f"--{key.name.replace('_', '-')}") in flags


def test_a_script_is_refused_what_stays_open(capsys: pytest.CaptureFixture[str]) -> None:
    path = swinging(units=False)
    code, _, errors = called(capsys, "import", str(path), "--accept")
    assert code == 2
    assert "unit of pos (position); unit of tau (torque)" in errors
    assert not Path("runs").exists()


def test_a_time_that_runs_back_is_told_with_its_line(capsys: pytest.CaptureFixture[str]) -> None:
    path = swinging(units=True)
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join([*lines, *lines[1:]]))
    code, _, errors = called(capsys, "import", str(path), "--accept")
    assert code == 6
    assert "line 3002, column time [s]: the time does not increase" in " ".join(errors.split())
    assert "say --rate in place of time [s]" in " ".join(errors.split())
    assert called(capsys, "import", str(path), "--accept", "--rate", "500")[0] == 0


def test_what_is_left_out_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    path = swinging(units=True)
    path.write_text(path.read_text().replace("tau [N m]", "status", 1))
    out = called(capsys, "import", str(path), "--accept")[1]
    assert "Proposed (1 other column is left out: status)" in " ".join(out.split())


def test_a_date_named_in_seconds_is_told_how_to_name_it(capsys: pytest.CaptureFixture[str]) -> None:
    rows = "".join(f"2026-01-01T00:00:{k:02d},{k}\n" for k in range(40))
    Path("log.csv").write_text(f"at,pos\n{rows}", encoding="utf-8")
    words = ("import", "log.csv", "-c", "position=pos:rad", "-c")
    code, _, errors = called(capsys, *words, "time=at:s")
    assert code == 6
    assert "It is a date: -c time=at:iso" in " ".join(errors.split())
    assert called(capsys, *words, "time=at:iso")[0] == 0


def test_what_was_named_is_told_what_it_is_good_for(capsys: pytest.CaptureFixture[str]) -> None:
    path = swinging(units=True)
    words = ("import", str(path), "-c", "time=1:s", "-c", "position=2:rad", "-c", "torque=3:N m")
    out = called(capsys, *words)[1]
    assert "good for motion" in out
    (run,) = Path("runs").glob("*.h5")
    assert f"next  rig fit motion {run}" in out
    assert "good for" not in called(capsys, *words, "--json")[1]


def test_a_look_shows_the_proposal_and_writes_nothing(
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = str(swinging(units=False))
    found = json.loads(called(capsys, "import", path, "--check", "--json")[1])["proposal"]
    assert [one["channel"] for one in found["columns"]] == ["time", "position", "torque"]
    assert [one["about"] for one in found["questions"]] == ["position", "torque"]
    assert "called 'pos'" in called(capsys, "import", path, "--check")[1]
    assert not Path("runs").exists()


def test_without_a_terminal_nothing_is_taken_over(capsys: pytest.CaptureFixture[str]) -> None:
    code, _, errors = called(capsys, "import", str(swinging(units=True)))
    assert code == 2
    assert "--accept" in errors
    assert not Path("runs").exists()


def test_somebody_answers_and_it_is_imported(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    answers = iter(["furlong/h", "deg", "A", ""])
    asked: list[str] = []

    def ask(text: str) -> str:
        asked.append(text)
        return next(answers)

    monkeypatch.setattr(import_proposed, "asks", lambda: True)
    monkeypatch.setattr(import_proposed, "ask_at_the_terminal", ask)
    code, out, errors = called(capsys, "import", str(swinging(units=False)))
    assert code == 0
    assert next(answers, None) is None
    assert "furlong" in errors, "a wrong answer is told and asked for again"
    assert "-c position=pos:deg -c current=tau:A" in out
    assert "Ctrl-C leaves it" in asked[-1]


def test_what_nobody_knows_is_left_out(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    answers = iter(["rad", "", ""])
    monkeypatch.setattr(import_proposed, "asks", lambda: True)
    monkeypatch.setattr(import_proposed, "ask_at_the_terminal", lambda text: next(answers))
    code, out, _ = called(capsys, "import", str(swinging(units=False)))
    assert code == 0
    assert "torque" not in out.partition("without a question")[2].splitlines()[0]


def test_columns_that_nothing_tells_are_refused_with_what_to_say(
    capsys: pytest.CaptureFixture[str],
) -> None:
    Path("odd.csv").write_text("a,b\n" + "1,2\n2,1\n" * 30, encoding="utf-8")
    code, _, errors = called(capsys, "import", "odd.csv", "--accept")
    assert code == 2
    assert "no column is recognised" in errors
    assert "-c position=COLUMN:rad" in errors


def test_what_nothing_tells_is_said_at_the_end(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    swinging(units=True).rename("joint2.csv")
    text = Path("joint2.csv").read_text(encoding="utf-8").replace("pos [rad]", "xyz", 1)
    Path("joint2.csv").write_text(text, encoding="utf-8")
    answers = iter(["position=xyz:parsec", "position xyz", "position=xyz:deg", "", ""])
    monkeypatch.setattr(import_proposed, "asks", lambda: True)
    monkeypatch.setattr(import_proposed, "ask_at_the_terminal", lambda text: next(answers))
    code, out, errors = called(capsys, "import", "joint2.csv")
    assert "position xyz" in errors, "a line that is no channel is told and asked for again"
    assert code == 2, "a unit that is none is refused by the import, as everywhere"
    answers = iter(["position=xyz:deg", ""])
    code, out, _ = called(capsys, "import", "joint2.csv")
    assert code == 0
    assert "-c position=xyz:deg" in out


def test_an_export_of_our_own_needs_no_key(capsys: pytest.CaptureFixture[str]) -> None:
    words = ("run", "velocity-steps", "--gear", "A1", "--speeds-rpm", "300", "--repeats", "1")
    assert called(capsys, *words, "--runs", "own")[0] == 0
    (own,) = Path("own").glob("*.h5")
    assert called(capsys, "export", str(own), "--output", "own.csv")[0] == 0
    code, out, _ = called(capsys, "import", "own.csv", "--accept")
    assert code == 0
    assert "--ratio 120 --output-sense -1" in out
    (run,) = Path("runs").glob("*.h5")
    with h5py.File(own) as first, h5py.File(run) as second:
        ours, theirs = first["entry/data/input_angle"], second["entry/data/input_angle"]
        assert len(ours) == len(theirs)


def test_a_rate_stands_for_the_time_of_the_file(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = called(capsys, "import", str(swinging(units=True)), "--accept", "--rate", "500")
    assert code == 0
    assert "-c time=" not in out
    assert "--rate 500" in out


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("csv",), "which file?"),
        (("joint.csv", "-c", "position=2:rad", "--accept"), "nothing is proposed"),
        (("joint.csv", *("-c", "torque=tau") * 2), "a channel is given twice"),
        (("joint.csv", "--accept", "--lag", "tau=2ms"), "is no channel of the import"),
        (("joint.csv", "--accept", "--gap", "1", "--save-map", "gap.toml"), "no length of a gap"),
        (("joint.csv", "--accept", "--save-map", "joint.csv"), "is there already"),
        (("joint.csv", "--accept", "--save-map", "no/map.toml"), "its folder is not"),
        (("joint.csv", "--accept", "--save-map", "aux.toml"), "device on Windows"),
    ],
)
def test_what_cannot_be_meant_is_refused(
    words: tuple[str, ...], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    swinging(units=True)
    code, _, errors = called(capsys, "import", *words)
    assert code == 2
    assert told in " ".join(errors.replace("│", " ").split())
    assert not Path("runs").exists()
    assert not list(Path().glob("*.toml"))


def test_a_word_that_is_neither_kind_nor_file_is_refused(
    capsys: pytest.CaptureFixture[str],
) -> None:
    code, _, errors = called(capsys, "import", "cvs", str(swinging(units=True)))
    assert code == 2
    assert "'cvs' is not one of" in " ".join(errors.split())
