"""Texts from files on a terminal: shown letter by letter, never obeyed."""

import dataclasses
import io
import re
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from experiments.recording import Event
from rig.commands.terminal import painted
from rig.commands.visible import Text, VisibleConsole, plain_column
from rig.content.grid import Grid, columns
from rig.content.wording import visible
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
        "passport": ["report", "--gear", "A1 [bold]\x1b[8m", "--passport", "--runs", str(tmp_path)],
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

    heads = columns(EVIL, (EVIL, "word"))
    grid = painted(Grid(EVIL, heads, [(EVIL, EVIL)], EVIL))
    for what in (EVIL, Text(EVIL), Text("a").append(EVIL), Text.assemble("a", EVIL), grid):
        assert not OBEYED.search(printed(what))
        assert "\\u000dPASS" in printed(what)
    assert not OBEYED.search(printed(rich.text.Text(EVIL)))


def test_no_command_makes_its_texts_past_it() -> None:
    """One place makes texts safe: whoever writes for a terminal uses its `Text` and its console."""
    wrong = re.compile(
        r"from rich\.text|rich\.text\.Text|\bConsole\(|\bTextColumn\(|from_markup|rich_utils"
        r"|typer\.s?echo\("
    )
    past = [
        path.name
        for path in [*COMMANDS.rglob("*.py"), *(COMMANDS.parent / "run").glob("*.py")]
        if path.name not in ("visible.py", "terminal.py")
        and wrong.search(path.read_text(encoding="utf-8"))
    ]
    assert not past


HOSTILE = "SN[x]"


COMMANDS_OF_A_DAY = (
    (0, "gear set SN[x] --by [/z] --lubricant [red]oil[/q]"),
    (0, "gear show SN[x]"),
    (0, "gear list"),
    (0, "plan home --gear SN[x]"),
    (0, "run home --gear SN[x] --operator [bold]A[/y]"),
    (0, "runs runs"),
    (0, "show runs/00001-home-SN_x.h5"),
    (0, "campaign incoming --gear SN[x] --dry-run"),
    (0, "report runs/00001-home-SN_x.h5 -o [b]r[/b].html"),
    (6, "report --gear SN[/y]"),
    (2, "no-such[/x]"),
    (6, "fit [/x].h5"),
    (6, "recover [/x].h5.part"),
)
"""Exit codes and commands, each with what rich would take for markup."""


def test_a_terminal_takes_no_word_of_people_for_markup(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a terminal too, where bars are drawn; the rig is the simulated one."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    for code, command in COMMANDS_OF_A_DAY:
        with pytest.raises(SystemExit) as end:
            run(command.split())
        shown = capsys.readouterr()
        assert int(end.value.code or 0) == code, (command, shown)
        for stream in (shown.out, shown.err):
            assert "MarkupError" not in stream
            assert "A defect" not in stream
            assert "Traceback" not in stream


def test_a_bar_of_progress_shows_a_serial_number_as_it_is() -> None:
    """The columns of rich read markup, whatever their console is told."""
    from rich.progress import Progress

    stream = io.StringIO()
    out = VisibleConsole(file=stream, width=120, force_terminal=True)
    with Progress(plain_column("{task.description}"), console=out) as bar:
        bar.add_task(f"home {HOSTILE} [red]A[/red]")
    assert f"home {HOSTILE} [red]A[/red]" in stream.getvalue()


@pytest.mark.parametrize(
    "text", ["Öl nachgefüllt τ 25 °C", "two\nlines\tand a tab", "עברית", "日本"]
)
def test_what_people_write_stays(text: str) -> None:
    assert visible(text) == text


def test_a_path_that_is_no_unicode_can_be_printed() -> None:
    assert visible("run\udcff.h5") == "run\\udcff.h5"
