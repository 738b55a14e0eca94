"""Every table that a command prints, at 80, 100 and 160 columns: no row higher than two lines, no cut word, no line
over the width; what has no room is named below.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import pytest
from rich.table import Table
from typer.testing import CliRunner

import rig
from rig.commands.terminal import HIGHEST_ROW, FittedTable
from rig.commands.visible import VisibleConsole, breaks
from rig.content.grid import Grid, columns
from rig.main import app

QUICK = {"points": 6, "measure_time": 0.2, "settle_time": 0.15, "lowest_rpm": 8.0, "seed": 9931}
WIDTHS = (80, 100, 160)
COMMANDS = (
    "plan friction",
    "plan kinematic-error",
    "plan velocity-steps",
    "run friction --help",
    "runs {folder}",
    "show {friction}",
    "fit {friction}",
    "fit {tare}",
    "validate {friction} --against {found}",
    "validate {friction} {second}",
    "diff {friction} {second}",
    "report --gear A1 --passport --runs {folder}",
    "model",
    "gear list --runs {folder}",
    "gear set --help",
    "export-model A1 --to json --runs {folder} -o {out}",
    "export-model A1 --to mjcf --runs {folder} -o {out}",
    "campaign acceptance --gear A9 --dry-run --no-card --runs {folder}",
    "sim drill --backend sim --fault creep",
)


@dataclass(frozen=True)
class Printed:
    """A table as it stood on a console, and the grid behind it."""

    console: VisibleConsole
    grid: Grid
    table: Table

    def troubles(self) -> Iterator[str]:
        """What is cut, too high or too wide."""
        room = self.console.options.update_width(self.console.width - self.table._extra_width)
        widths = self.table._calculate_column_widths(self.console, room)
        if sum(widths) + self.table._extra_width > self.console.width:
            yield f"{self.grid.headings}: {sum(widths)} wide"
        for place, (column, width) in enumerate(zip(self.grid.columns, widths, strict=True)):
            inner = width - (place < len(widths) - 1)
            for row in self.grid.rows:
                text = self.console.render_str(row[place])
                lines = text.wrap(self.console, max(inner, 1), overflow="fold")
                if column.kind in ("number", "unit") and len(text) > inner:
                    yield f"{column.heading}: {text.plain!r} is cut"
                if column.kind == "sentence" or column.kind == "hash":
                    continue
                if len(lines) > HIGHEST_ROW:
                    yield f"{column.heading}: {text.plain!r} has {len(lines)} lines"
                if any(len(word) > inner for word in text.plain.split()):
                    yield f"{column.heading}: {text.plain!r} has a cut word"


@pytest.fixture(scope="module")
def words(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """A gear with a tare and two analysed runs, and what the commands call them."""
    folder = tmp_path_factory.mktemp("runs")
    tare = rig.execute("motor-tare", folder=folder, **QUICK)
    runs = [rig.execute("friction", serial="A1", folder=folder, **QUICK) for _ in range(2)]
    for run in runs:
        rig.fit(run).store()
    paths = {"tare": tare.path, "friction": runs[0].path, "second": runs[1].path}
    found = folder / "found.toml"
    answer = CliRunner().invoke(app, ["fit", str(runs[0].path), "--parameters-out", str(found)])
    assert answer.exit_code == 0, answer.output
    names = {name: str(path) for name, path in paths.items()}
    return {**names, "folder": str(folder), "found": str(found), "out": str(folder / "out")}


@pytest.mark.parametrize("command", COMMANDS)
def test_every_table_has_room(
    command: str, words: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # The folder of the test, so that no row is about a path of this computer.
    monkeypatch.chdir(words["folder"])
    printed: list[Printed] = []
    plain = VisibleConsole.print

    def noting(console: VisibleConsole, *objects: Any, **look: Any) -> None:
        for one in objects:
            if isinstance(one, FittedTable):
                shown, left_out = one.fitted(console, console.options)
                assert set(shown.headings) | set(left_out) == set(one.grid.headings)
                printed.append(Printed(console, shown, one.table(shown)))
        plain(console, *objects, **look)

    monkeypatch.setattr(VisibleConsole, "print", noting)
    for width in WIDTHS:
        printed.clear()
        answer = CliRunner().invoke(
            app, command.format(**words).split(), env={"COLUMNS": str(width)}
        )
        assert answer.exit_code in (0, 1, 3), answer.output
        troubles = [trouble for one in printed for trouble in one.troubles()]
        assert not troubles, f"{width} columns"
        if not command.endswith("--help"):
            assert printed or "list" in command


def test_what_has_no_room_is_named_and_a_wide_terminal_has_it_all() -> None:
    import io

    grid = Grid(
        "Title",
        columns("what", ("value", "number"), "where", "origin"),
        [("limit", "1.25", "in the hold of the third speed " * 3, "rated by the maker " * 3)],
    )

    def shown(width: int) -> str:
        written = io.StringIO()
        VisibleConsole(file=written, width=width).print(FittedTable(grid, {}))
        return written.getvalue()

    assert "60 columns leave out: where." in shown(60)
    assert "in the hold" not in shown(60)
    assert "rated by" in shown(60)
    assert "40 columns leave out: where, origin." in shown(40).replace("\n", " ")
    assert "rated by" in shown(200)
    assert "leave out" not in shown(200)


def test_a_number_is_left_out_rather_than_cut() -> None:
    import io

    heads = columns("q", *((f"number {place}", "number") for place in range(6)))
    grid = Grid("Title", heads, [("x", *(["1.234567 × 10⁻⁵"] * 6))])
    written = io.StringIO()
    VisibleConsole(file=written, width=60).print(FittedTable(grid, {}))
    assert "…" not in written.getvalue()
    assert written.getvalue().count("1.234567 × 10⁻⁵") == 3
    assert "60 columns leave out: number 3" in written.getvalue()


def test_a_sentence_goes_on_below_itself_and_a_path_stays_whole() -> None:
    text = "PASS by the limit of the maker in /a/folder/whose/name/is/longer/than/a/line and more"
    lines, start = [], 0
    for place in [*breaks(text, 30), len(text)]:
        lines.append(text[start:place].rstrip())
        start = place
    assert " ".join(lines) == text
    assert "/a/folder/whose/name/is/longer/than/a/line" in lines
    assert all(len(line) <= 30 or " " not in line for line in lines)
