"""The two lists of the safety path: short enough to be read, resting on each other alone, and shown as they are."""

from __future__ import annotations

import pytest

from rig.trial.drill.catalogue import every_drill
from tests import safety_path

PAGE = safety_path.ROOT / "docs" / "reference" / "safety-path.md"


def test_what_stops_the_motor_can_be_read_by_one_person() -> None:
    total = sum(safety_path.statements(module) for module in safety_path.modules("stopping"))
    assert 0 < total <= safety_path.MOST_STOPPING


@pytest.mark.parametrize("module", safety_path.modules("stopping"))
def test_what_stops_the_motor_rests_on_the_two_lists_and_on_errors_alone(module: str) -> None:
    listed = {m for name in safety_path.LISTS for m in safety_path.modules(name)}
    assert safety_path.imports(module) - listed - safety_path.FREE == set()


def test_no_module_stands_in_both_lists() -> None:
    stopping, turning = (safety_path.modules(name) for name in safety_path.LISTS)
    assert len({*stopping, *turning}) == len(stopping) + len(turning)


def test_the_page_shows_every_module_with_its_statements_as_they_are() -> None:
    page = PAGE.read_text(encoding="utf-8")
    for line in safety_path.lists_table():
        assert line in page, f"make the page anew: {safety_path.__doc__}"


def test_the_page_has_a_row_for_every_drill() -> None:
    table = PAGE.read_text(encoding="utf-8").split(safety_path.DRILLS)[1]
    shown = {line.split("|")[1].strip() for line in table.splitlines() if line.startswith("|")}
    assert shown - {""} == set(every_drill())


def test_only_what_is_carried_out_within_is_noted() -> None:
    file = safety_path.source("rig.run.stop")
    run = safety_path.LinesRun({str(file): "rig.run.stop"})
    from rig.run.stop import StopRequest

    stop = StopRequest()
    with run.traced():
        stop.abort()
    stop.stop()
    named = safety_path.worded("rig.run.stop", run.lines[str(file)])
    assert named.startswith("`StopRequest.abort`")
    assert "StopRequest.stop`" not in named
