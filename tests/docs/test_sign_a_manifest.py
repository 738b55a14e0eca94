"""The page on signing does what it says: its commands, one after the other, in a shell."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.docs.given_files import lay_out

PAGE = Path(__file__).parents[2] / "docs" / "howto" / "sign-a-manifest.md"
NEEDED = ("ssh-keygen", "sh")


@pytest.mark.skipif(
    any(shutil.which(name) is None for name in NEEDED), reason="no OpenSSH or no shell"
)
def test_the_commands_of_the_page(tmp_path: Path) -> None:
    lay_out(PAGE, tmp_path)
    write_it, keys, sign, check = re.findall(r"```sh\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)
    # `rig` of this environment, under its name.
    rig = f'rig() {{ "{sys.executable}" -m rig "$@"; }}\nset -e\n'

    def shell(script: str) -> subprocess.CompletedProcess[str]:
        order = ["sh", "-c", rig + script]
        return subprocess.run(order, cwd=tmp_path, capture_output=True, text=True, check=False)

    made = shell(write_it + keys + sign + check)
    assert made.returncode == 0, made.stderr
    assert "Good" in made.stdout
    assert "Nothing that is listed is missing or changed." in made.stdout
    manifest = tmp_path / "A1.manifest.txt"
    manifest.write_text(manifest.read_text(encoding="utf-8").replace("\trun\t", "\ttare\t"))
    assert shell(check.splitlines()[0]).returncode != 0
