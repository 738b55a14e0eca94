"""The end of a campaign is told, whatever became of older runs of its gear."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

from rig.commands.campaigning import _alarms
from tests.rig.library.stored import RUNNING, analyse, estimate, start, write


def life(folder: Path) -> list[Path]:
    """Sixteen runs of a gear that changed in the twelfth."""
    runs = [write(folder, day, start_time=start(day)) for day in range(1, 17)]
    for day, run in enumerate(runs, 1):
        analyse(run, estimate(RUNNING, 0.08 + 0.0005 * (day % 3) + 0.02 * (day > 11)))
    return runs


def told(folder: Path, config: Path | None = None) -> tuple[Any, str]:
    report = cast("Any", SimpleNamespace(verdict_rests_on=1))
    return _alarms(report, cast("Any", SimpleNamespace(folder=folder, serial="A1", config=config)))


def test_an_older_run_that_was_altered_takes_no_campaign_s_end_away(tmp_path: Path) -> None:
    runs = life(tmp_path)
    (alarm,), untold = told(tmp_path)
    assert (alarm.since, untold) == ("00012-friction-A1", "")
    runs[2].chmod(0o644)
    content = bytearray(runs[2].read_bytes())
    content[-1] ^= 1
    runs[2].write_bytes(content)
    alarms, untold = told(tmp_path)
    assert alarms == ()
    assert runs[2].name in untold


def test_the_promise_is_that_of_the_campaign_s_own_rig(tmp_path: Path) -> None:
    life(tmp_path)
    described = tmp_path / "elsewhere.toml"
    described.write_text("[alarms]\nbaseline = 16\n", encoding="utf-8")
    assert told(tmp_path, described) == ((), "")
    described.write_text("[alarms]\nbaseline = 1\n", encoding="utf-8")
    assert "baseline" in told(tmp_path, described)[1]
