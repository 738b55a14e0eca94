"""The golden gear beside its first five runs: what the check tells, what it does not, and when it is due."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from drivers.clock import VirtualClock
from experiments.finding import Severity
from model.gear_file import shipped_gear
from rig.analysis.golden import FIRST, golden_check
from rig.bench.backends.order import Order
from rig.errors import RigError
from rig.present.golden import difference_plot
from rig.trial.doctor.surroundings import golden_gear
from tests.rig.analysis.passport_runs import VALUES, WORN, analysed, folder, fourteen, history
from tests.rig.commands.calling import Rig
from tests.rig.commands.printed import every_table_has_room
from tests.rig.library.stored import start

__all__ = ["folder", "fourteen", "history"]
NOW = datetime.fromisoformat(start(14)).astimezone(UTC) + timedelta(days=10)


def test_a_bench_that_did_not_change_shows_none_and_one_that_did_shows_it(history: Path) -> None:
    analysed(history, VALUES)
    (one,) = golden_check(history, "A1", NOW).quantities
    assert (one.state, len(one.runs)) == ("no change seen", 14)
    assert one.mean == pytest.approx(0.080)
    assert [run.is_apart for run in one.runs] == [False] * 14
    analysed(history, WORN)
    found = golden_check(history, "A1", NOW)
    (one,) = found.quantities
    assert found.is_changed
    assert found.age_days == pytest.approx(10.0)
    assert one.newest.difference == pytest.approx(10.5e-3)
    assert "+10.5" in one.sentence
    # The scatter of five runs, of 0.79 mN m, as wide as Student's t of four makes it at 99 %.
    assert one.newest.expanded_uncertainty == pytest.approx(4.604 * 0.7906e-3 * 1.0954, rel=1e-3)
    later = difference_plot(one).series[1]
    assert (len(later.x), later.low is not None) == (14 - FIRST, True)


def test_what_all_runs_share_cancels(history: Path) -> None:
    """A torque scale known to 5 mN m hides no change of 4 between runs of one channel."""
    analysed(history, [80.0 + (4.0 if day > 11 else 0.01 * day) for day in range(14)], scale=5.0)
    (one,) = golden_check(history, "A1", NOW).quantities
    assert one.state == "changed"
    assert one.newest.expanded_uncertainty < 1e-3


def test_few_runs_are_gathered_first_and_a_gear_without_runs_is_named(folder: Path) -> None:
    analysed(folder, VALUES)
    (one,) = golden_check(folder, "A1", NOW).quantities
    assert (one.state, one.sentence) == ("learning", "4 of 5 first runs are there")
    with pytest.raises(RigError, match="golden gear"):
        golden_check(folder, "B2", NOW)


def test_the_command_ends_with_1_where_the_bench_changed(
    history: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig, page = Rig(capsys), tmp_path / "golden.html"
    analysed(history, WORN)
    with every_table_has_room():
        assert rig("bench", "check", "--runs", history, "--gear", "A1", "--output", page) == 1
    assert "changed" in rig.out
    assert "CHANGED" in page.read_text(encoding="utf-8")
    analysed(history, VALUES)
    told = rig.json("bench", "check", "--runs", history, "--gear", "A1")
    assert (told["changed"], told["gear"]) == (False, "A1")
    # No tare, and nothing learnt: nothing to show.
    assert rig("bench", "show", "--runs", history) == 2


@pytest.mark.parametrize(("days", "is_due"), [(30.0, False), (5.0, True)])
def test_the_doctor_reminds_of_it(history: Path, tmp_path: Path, days: float, is_due: bool) -> None:
    config = tmp_path / "rig.toml"
    config.write_text(f'[alarms]\ngolden_gear = "A1"\ngolden_days = {days}\n')
    clock = VirtualClock(int(NOW.timestamp() * 1e9))
    order = Order(protocol="friction", gear=shipped_gear(), folder=history, config=config)
    (found,) = golden_gear(order, clock)
    assert found.severity is (Severity.WARNS if is_due else Severity.PASSED)
    assert found.found == "10 days ago"
    config.write_text('[alarms]\ngolden_gear = "NONE"\ngolden_days = 5\n')
    (found,) = golden_gear(order, clock)
    assert "never measured" in found.found
    config.write_text('[alarms]\ngolden_gear = "A1"\n')
    assert list(golden_gear(order, clock)) == []
