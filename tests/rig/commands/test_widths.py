"""Every table that a command prints, at 80, 100 and 160 columns: no row higher than two lines, no cut word, no line
over the width; what has no room is named below.
"""

from __future__ import annotations

import pytest
from typer.testing import CliRunner

import rig
from rig.commands.terminal import FittedTable
from rig.commands.visible import VisibleConsole, breaks
from rig.content.grid import Grid, columns
from rig.main import app
from tests.rig.commands.printed import tables_of

QUICK = {"points": 6, "measure_time": 0.2, "settle_time": 0.15, "lowest_rpm": 8.0, "seed": 9931}
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
    "gear show A1 --runs {folder}",
    "verify {friction}",
    "verify {folder} --recompute",
    "bench show --runs {folder}",
    "doctor --backend sim",
    "config check {rig}",
    "run --help",
    "fit friction --help",
    "import --check {csv}",
    "import {csv}",
    "export-model A1 --to json --runs {folder} -o {out}",
    "export-model A1 --to mjcf --runs {folder} -o {out}",
    "campaign acceptance --gear A9 --dry-run --no-card --runs {folder}",
    "sim drill --backend sim --fault creep",
)


@pytest.fixture(scope="module")
def words(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """A gear with a tare and two analysed runs, and what the commands call them."""
    folder = tmp_path_factory.mktemp("runs")
    tare = rig.execute("motor-tare", folder=folder, **QUICK)
    runs = [rig.execute("friction", serial="A1", folder=folder, **QUICK) for _ in range(2)]
    for run in runs:
        rig.fit(run).store()
    paths = {"tare": tare.path, "friction": runs[0].path, "second": runs[1].path}
    made = {name: folder / f"{name}.toml" for name in ("found", "rig")}
    for command in (
        ["fit", runs[0].path, "--parameters-out", made["found"]],
        ["config", "new", made["rig"], "--example", "epos4"],
        ["gear", "new", "CSF-25-120-2UH", "--serial", "A1", "--by", "B", "--runs", folder],
    ):
        answer = CliRunner().invoke(app, [str(word) for word in command])
        assert answer.exit_code == 0, answer.output
    csv = folder / "recording.csv"
    csv.write_text("t [s],phi [rad],torque [N m]\n" + "".join(f"{i},{i},1\n" for i in range(9)))
    paths |= {**made, "csv": csv, "folder": folder, "out": folder / "out"}
    return {name: str(path) for name, path in paths.items()}


@pytest.mark.parametrize("command", COMMANDS)
def test_every_table_has_room(
    command: str, words: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # The folder of the test, so that no row is about a path of this computer.
    monkeypatch.chdir(words["folder"])
    tables = tables_of(command.format(**words).split(), monkeypatch)
    if not command.endswith("--help"):
        assert tables or "list" in command


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
