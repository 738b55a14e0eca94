"""The page with one gear that passes and one that fails: its commands, run as they stand, give what it prints."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from rig.main import app

PAGE = (Path(__file__).parents[2] / "docs" / "howto" / "one-gear-passes-one-fails.md").read_text(
    encoding="utf-8"
)
COMMANDS = [
    line
    for block in re.findall(r"^```console\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE)
    for line in block.splitlines()
]
PRINTED = re.findall(r"^```text\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE)


@pytest.fixture(scope="module")
def called(tmp_path_factory: pytest.TempPathFactory) -> list[Result]:
    """Every command of the page, one after the other, in a folder of its own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("gears"))
        patch.setenv("COLUMNS", "200")
        return [CliRunner().invoke(app, shlex.split(line)[1:]) for line in COMMANDS]


def test_the_first_gear_passes_and_the_second_fails(called: list[Result]) -> None:
    tare, first, second, untared = called
    assert [tare.exit_code, first.exit_code, second.exit_code] == [0, 0, 1]
    for result, printed in zip((first, second, untared), PRINTED, strict=True):
        output = " ".join(result.output.split())
        for line in printed.splitlines():
            assert " ".join(line.split()) in output, output
    assert "PASS" in PRINTED[0]
    assert "FAIL" in PRINTED[1]
    assert untared.exit_code == 0
    assert "NOT JUDGED" in untared.output


def test_the_table_says_what_the_commands_printed() -> None:
    for column, printed, sign in ((1, PRINTED[0], 1.0), (2, PRINTED[1], -1.0)):
        found = re.search(r"([\d.]+) ± ([\d.]+) mN m, limit ≤ ([\d.]+) mN m", printed)
        assert found
        value, expanded, limit = map(float, found.groups())
        cells = [
            row.split("|")[column + 1].strip()
            for row in PAGE.splitlines()
            if re.match(r"\| (value|the end|limit|verdict)", row)
        ]
        end = value + sign * expanded
        assert cells[0] == f"{found[1]} ± {found[2]} mN m"
        assert cells[1].endswith(f"= {end:.1f} mN m")
        assert cells[2] == f"{found[3]} mN m"
        assert cells[3] == ("PASS" if end <= limit else "FAIL")
