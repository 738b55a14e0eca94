"""What the commands and cells of a page print: kept in a text file per page, shown under each of them.

`RENEW_PRINTED=1 pytest tests/docs tests/extras` runs every command and cell and writes the files anew; without it the
same tests hold what is printed against what is kept: word by word, and a value within its uncertainty. Digits are
those of the processor that wrote them, since what the data hardly tell is another number on the next; a page is too old
where an analysis has another version by now.
"""

from __future__ import annotations

import re
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from docutils import nodes
    from sphinx.application import Sphinx

PRINTED = Path(__file__).parent / "printed"
MOST_LINES = 24
"""Lines of one command that are kept: what a reader sees without scrolling."""
VERSIONS = PRINTED / "versions.txt"
"""Of which versions of the analyses the numbers are."""
_PROMPT = "$ "
_BLOCK = re.compile(r"^```sh\n(.*?)^```", re.DOTALL | re.MULTILINE)
_PASSING = re.compile(
    r"\d{4}-\d\d-\d\d([T ]\d\d:\d\d(:\d\d(\.\d+)?)?([+-]\d\d:\d\d|Z| UTC)?)?"
    r"|\b[0-9a-fA-F]{7,64}\b(\+changed)?|^ *[0-9a-f]{1,64}$|\b\d+(\.\d+)? ?[kMG]?B\b|\b\d+ (s|min|h)\b|\d+\.\d+\.\d+\S*"
)
"""What is another with every run: day and time, hash, size of a file, duration, version."""
_NUMBER = re.compile(r"[-−+]?\d+(?:[.\u00a0\u2009\u202f ]?\d+)*(?:e[-+]?\d+)?")
_POWER = re.compile(r" *× 10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)")
_EXPONENT = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
_DIGITS = r"[-−+]?\d+(?:\u202f\d{3})*(?:\.\d+)?(?:e[-+]?\d+)?"
_WITH_U = re.compile(rf"({_DIGITS}) *± *({_DIGITS})")
"""A value and its U; thousands stand apart by a narrow blank."""


def commands_in(block: str) -> list[str]:
    """Every command line of a block of shell that begins with `rig`, in order, comments taken off."""
    lines = block.replace("\\\n", " ").splitlines()
    commands = [line.partition("  #")[0].strip() for line in lines]
    return [command for command in commands if command.startswith("rig ")]


def commands_of(page: Path) -> list[str]:
    """Every command of a page, in order."""
    blocks = _BLOCK.findall(page.read_text(encoding="utf-8"))
    return [command for block in blocks for command in commands_in(block)]


def file_of(name: str) -> Path:
    """Where what a page prints is kept; `name` is that of the page below `docs`, without its ending."""
    return PRINTED / f"{name.replace('/', '-')}.txt"


def kept_lines(text: str, folder: Path) -> list[str]:
    """The first lines of what a command printed in a folder, as they are kept: without the folder's own path."""
    path = r"(?:\n +)?".join(map(re.escape, f"{folder}/"))
    lines = [line.rstrip() for line in re.sub(path, "", text).strip("\n").splitlines()]
    return [*lines[:MOST_LINES], "…"] if len(lines) > MOST_LINES + 1 else lines


def write_printed(name: str, printed: list[tuple[str, list[str]]]) -> None:
    """Keep what the commands of a page print."""
    PRINTED.mkdir(exist_ok=True)
    parts = ("\n".join((f"{_PROMPT}{command}", *lines)) for command, lines in printed)
    file_of(name).write_text("\n\n".join(parts) + "\n", encoding="utf-8")


def read_printed(name: str) -> dict[str, list[str]]:
    """What is kept of a page, by command; of a command that stands on it twice, the first."""
    kept: dict[str, list[str]] = {}
    lines: list[str] = []
    path = file_of(name)
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else []:
        if line.startswith(_PROMPT):
            lines = []
            kept.setdefault(line.removeprefix(_PROMPT), lines)
        else:
            lines.append(line)
    return {command: "\n".join(lines).rstrip().splitlines() for command, lines in kept.items()}


def differing(kept: list[str], printed: list[str]) -> list[tuple[str, str]]:
    """Lines that say something else: other words, a number more or less, a value beyond what both call uncertain."""
    pairs = zip_longest(kept, printed, fillvalue="")
    return [pair for pair in pairs if _words(pair[0]) != _words(pair[1]) or not _agree(*pair)]


def _agree(one: str, other: str) -> bool:
    """Whether values with U lie within the larger U of both."""
    pairs = zip(_with_uncertainty(one), _with_uncertainty(other), strict=False)
    return all(abs(a - b) <= max(u, v) for (a, u), (b, v) in pairs)


def _with_uncertainty(line: str) -> list[tuple[float, float]]:
    """Every value ± U of a line, in the unit without its power of ten."""
    power = _POWER.search(line)
    factor = 10.0 ** int(power[1].translate(_EXPONENT)) if power else 1.0
    return [(factor * _value(a), factor * _value(u)) for a, u in _WITH_U.findall(line)]


def _value(text: str) -> float:
    return float(text.replace("\u202f", "").replace("−", "-"))


def _words(line: str) -> str:
    """A line with every number, and the power of ten of its unit, made alike."""
    return " ".join(_NUMBER.sub("#", _POWER.sub("", _PASSING.sub("", line))).split())


def _show(app: Sphinx, doctree: nodes.document) -> None:
    """Under each block of commands, and under each cell, what it prints."""
    from docutils import nodes

    kept = read_printed(app.env.docname)
    cells = 0
    for block in list(doctree.findall(nodes.literal_block)):
        commands = commands_in(block.astext()) if block.get("language") == "sh" else []
        if "cell" in block["classes"]:
            cells += 1
            commands = [f"cell {cells}"]
        told = [(command, lines) for command in commands if (lines := kept.get(command))]
        if not told:
            continue
        alone = len(commands) == 1
        parts = ["\n".join([*([] if alone else [f"{_PROMPT}{c}"]), *lines]) for c, lines in told]
        text = "\n\n".join(parts)
        shown = nodes.literal_block(text, text, language="text", classes=["printed"])
        block.parent.insert(block.parent.index(block) + 1, shown)


def setup(app: Sphinx) -> dict[str, bool]:
    """Show what commands print when a page has been read."""
    app.connect("doctree-read", _show)
    return {"parallel_read_safe": True}
