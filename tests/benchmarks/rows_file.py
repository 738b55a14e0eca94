"""A file of rows: what a study comes to, one line of JSON a case, so that it goes on where it was cut off."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

Line = dict[str, Any]


def read_rows(path: Path | None, key: Mapping[str, Any]) -> list[Line]:
    """The lines that have what `key` says; a line that was cut off while it was written is left out."""
    if path is None or not path.exists():
        return []
    lines: list[Line] = []
    for text in path.read_text(encoding="utf-8").splitlines():
        try:
            line = json.loads(text)
        except ValueError:
            continue
        if all(line.get(name) == value for name, value in key.items()):
            lines.append(line)
    return lines


def add_rows(path: Path | None, lines: Iterable[Line]) -> None:
    """Append lines in one piece."""
    if path is None:
        return
    with path.open("a", encoding="utf-8") as file:
        file.write("".join(json.dumps(line, default=float) + "\n" for line in lines))


def code_commit(*, uncommitted: bool) -> str:
    """The commit of the code; `SystemExit` where files differ from it, unless that is allowed (then "+" is added)."""
    root = Path(__file__).resolve().parents[2]

    def git(*words: str) -> str:
        done = subprocess.run(
            ["git", "-C", str(root), *words], capture_output=True, text=True, check=True
        )
        return done.stdout.strip()

    changed = git("status", "--porcelain")
    if changed and not uncommitted:
        raise SystemExit(
            f"The code has uncommitted changes; commit them, or say --uncommitted:\n{changed}"
        )
    return git("rev-parse", "HEAD") + ("+" if changed else "")
