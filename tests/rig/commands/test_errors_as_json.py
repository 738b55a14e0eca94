"""Under --json every error is one object, whatever the command: here a path that is not there."""

import json
from pathlib import Path

import pytest

from model.errors import WordedError, without_traceback
from rig.main import run

NOWHERE = "nowhere/[x].h5"
FILES = (
    ("show", NOWHERE),
    ("export", NOWHERE),
    ("recover", f"{NOWHERE}.part"),
    ("fit", NOWHERE),
    ("report", NOWHERE),
    ("certificate", "SN-0", "--output", "nowhere"),
    ("report", "--gear", "SN-0", "--passport", "--runs", "nowhere"),
    ("diff", NOWHERE, NOWHERE),
    ("import", "nowhere/[x].csv"),
    ("validate", NOWHERE),
    ("runs", "nowhere"),
    ("plan", "home", "--config", "nowhere.toml"),
    ("run", "home", "--config", "nowhere.toml"),
    ("gear", "show", "SN-0", "--output", "nowhere"),
    ("campaign", "incoming", "--gear", "SN-0", "--config", "nowhere.toml"),
    ("config", "check", "nowhere.toml"),
)
TRACED = """the hub says Traceback (most recent call last):
  File "x.py", line 1, in f
    g()
ConnectionResetError: [Errno 104] Connection reset by peer"""


@pytest.mark.parametrize("command", FILES, ids=lambda command: command[0])
def test_every_error_is_one_object(
    command: tuple[str, ...],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as end:
        run([*command, "--json"])
    shown = capsys.readouterr()
    error = json.loads(shown.out)["error"]
    assert int(end.value.code or 0) in (2, 6)
    assert set(error) == {"kind", "where", "value", "limit", "remedy", "message"}
    assert error["message"]
    assert "Traceback" not in shown.out + shown.err
    assert "A defect" not in shown.err


def test_no_message_holds_the_traceback_of_somebody_else() -> None:
    said = "the hub says ConnectionResetError: [Errno 104] Connection reset by peer"
    assert without_traceback(TRACED) == said
    assert str(WordedError(TRACED, where="can0", value=TRACED)) == f"can0: {said}; value {said}"
    assert without_traceback("plain") == "plain"
