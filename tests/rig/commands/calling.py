"""`rig` as a person or a program calls it, in this process."""

import json
from typing import Any

import pytest

from rig import main


class Rig:
    """Calls `rig` and keeps what it printed."""

    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self._capsys = capsys
        self.out = self.err = ""

    def __call__(self, *words: object) -> int:
        with pytest.raises(SystemExit) as ending:
            main.run([str(word) for word in words])
        self.out, self.err = self._capsys.readouterr()
        code = ending.value.code
        return code if isinstance(code, int) else 0 if code is None else -1

    def json(self, *words: object, code: int = 0) -> dict[str, Any]:
        assert self(*words, "--json") == code, self.err
        return json.loads(self.out, parse_constant=_no_constant)


def _no_constant(word: str) -> None:
    raise AssertionError(f"{word} is no JSON")
