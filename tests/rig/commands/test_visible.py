"""Texts from files on a terminal: shown letter by letter, never obeyed."""

import dataclasses
import io
import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from experiments.recording import Event
from rig.analysis.wording import visible
from rig.commands.terminal import table
from rig.commands.visible import Text, VisibleConsole
from rig.main import app, run
from rig.runfile.write import RunWriter
from tests.rig.runfile.making import EPOCH_NS, block, header

EVIL = "[red]A[/red] [/x] \x1b[2J\x1b]0;t\x07 B\rPASS \x9b31m \u202egnorw\u202c :skull: \x08\x7f"
COMMANDS = Path(__file__).parents[3] / "rig" / "commands"
OBEYED = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")


def evil_run(folder: Path) -> Path:
    """A run in which every text that people write is one that a terminal would obey."""
    made = header()
    metadata = dataclasses.replace(
        made.metadata,
        run_id=f"1 {EVIL}",
        title=EVIL,
        operator=EVIL,
        gear_serial="A1 [bold]\x1b[8m",
        parameters={"note": EVIL},
        conditions={EVIL: EVIL},
    )
    channel = dataclasses.replace(made.columns[0].channel, long_name=EVIL)
    columns = (dataclasses.replace(made.columns[0], channel=channel), *made.columns[1:])
    writer = RunWriter(
        folder / "00001-x-y.h5", dataclasses.replace(made, metadata=metadata, columns=columns)
    )
    writer.append(block(0, 40))
    writer.event(Event(EPOCH_NS, "warning [x]", "\x1b[1mCODE", "\roperator", EVIL))
    return writer.seal("COMPLETED")


@pytest.mark.parametrize("command", ["show", "verify", "runs", "fit", "diff", "passport"])
def test_no_command_hands_on_what_a_terminal_obeys(
    tmp_path: Path, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = evil_run(tmp_path)
    arguments = {
        "runs": ["runs", str(tmp_path)],
        "diff": ["diff", str(path), str(path), "--all"],
        "passport": ["passport", "A1 [bold]\x1b[8m", "--output", str(tmp_path)],
    }.get(command, [command, str(path)])
    for more in ([], ["--json"]):
        with pytest.raises(SystemExit):
            run([*arguments, *more])
        shown = capsys.readouterr()
        assert not OBEYED.search(shown.out), repr(OBEYED.search(shown.out))
        assert not OBEYED.search(shown.err), repr(OBEYED.search(shown.err))


def test_what_is_shown_is_what_stands_there(tmp_path: Path) -> None:
    shown = CliRunner().invoke(app, ["show", str(evil_run(tmp_path))]).output
    text = "".join(shown.split())
    assert "[red]A[/red][/x]\\u001b[2J\\u001b]0;t\\u0007B\\u000dPASS" in text
    assert "\\u009b31m\\u202egnorw\\u202c:skull:" in text


def printed(what: object) -> str:
    stream = io.StringIO()
    VisibleConsole(file=stream, width=120, force_terminal=False).print(what)
    return stream.getvalue()


def test_texts_cells_titles_and_texts_made_elsewhere() -> None:
    import rich.text

    grid = table(EVIL, title=EVIL)
    grid.add_row(EVIL)
    grid.add_row(Text(EVIL))
    for what in (EVIL, Text(EVIL), Text("a").append(EVIL), Text.assemble("a", EVIL), grid):
        assert not OBEYED.search(printed(what))
        assert "\\u000dPASS" in printed(what)
    assert not OBEYED.search(printed(rich.text.Text(EVIL)))


def test_no_command_makes_its_texts_past_it() -> None:
    """One place makes texts safe: whoever writes for a terminal uses its `Text` and its console."""
    wrong = re.compile(r"from rich\.text|rich\.text\.Text|\bConsole\(")
    past = [
        path.name
        for path in COMMANDS.glob("*.py")
        if path.name != "visible.py" and wrong.search(path.read_text(encoding="utf-8"))
    ]
    assert not past


@pytest.mark.parametrize(
    "text", ["Öl nachgefüllt τ 25 °C", "two\nlines\tand a tab", "עברית", "日本"]
)
def test_what_people_write_stays(text: str) -> None:
    assert visible(text) == text


def test_a_path_that_is_no_unicode_can_be_printed() -> None:
    assert visible("run\udcff.h5") == "run\\udcff.h5"
