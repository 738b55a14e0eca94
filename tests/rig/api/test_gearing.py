"""Parameter sets by name, file and part number."""

from __future__ import annotations

from pathlib import Path

import pytest

import rig
from model.gear_file import save_gear, shipped_gear


def test_a_gear_by_name_file_and_part_number(tmp_path: Path) -> None:
    assert rig.gear() == shipped_gear("csf-25-120")
    changed = rig.gear().with_values({"inertia.output": 0.0125})
    save_gear(changed, tmp_path / "mine.toml")
    assert rig.gear(tmp_path / "mine.toml").inertia.output == 0.0125
    assert rig.gear("SHG-32-100-2UH").ratio == 100.0
    assert rig.gear(changed) is changed


def test_an_unknown_gear_is_refused_in_the_words_of_the_command_line() -> None:
    with pytest.raises(rig.WordedError, match="csf-25-120"):
        rig.gear("csf-99")


def test_a_gear_is_one_line() -> None:
    assert repr(rig.gear()).startswith("HarmonicDrive(CSF-25-120-2UH, N = 120; values: 31 assumed")
