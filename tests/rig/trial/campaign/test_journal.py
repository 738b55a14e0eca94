"""The journal of a campaign survives whoever wrote it, and says what still counts."""

from __future__ import annotations

from pathlib import Path

import pytest

from rig.errors import RunFileError
from rig.trial.campaign import journal as journals
from rig.trial.campaign.journal import DoneStage, Journal
from rig.trial.campaign.plan import shipped_plan

PLAN = shipped_plan("incoming")
FACTS = {"bench": "0", "mounted": {"part": "", "mounting": "", "mounted_on": ""}}


def begun(folder: Path) -> Journal:
    return journals.begin(folder, PLAN, "SN 1/2", FACTS, "2026-01-01T08:00:00+00:00")


def stage(index: int, run: str, outcome: str = "COMPLETED") -> DoneStage:
    protocol = PLAN.stages[index].protocol
    return DoneStage(index=index, protocol=protocol, run=run, outcome=outcome, at="2026-01-01")


def test_what_is_noted_is_read_again(tmp_path: Path) -> None:
    journal = begun(tmp_path).with_stage(stage(0, "a.h5")).with_stage(stage(1, "b.h5", "TRIPPED"))
    journal = journal.with_stage(stage(1, "c.h5")).with_outdated(0, "too old", "2026-01-09")
    found = journals.unfinished(tmp_path, PLAN, "SN 1/2")
    assert found is not None
    assert found == journal
    assert [found.counts(index) for index in range(3)] == [False, True, False]
    newest = found.newest(0)
    assert newest is not None
    assert newest.outdated == "too old"
    assert found.with_stage(stage(0, "d.h5")).counts(0)


def test_a_finished_campaign_does_not_go_on_and_the_next_has_a_number_of_its_own(
    tmp_path: Path,
) -> None:
    first = begun(tmp_path).with_end("PASS", "certificate.pdf", "2026-01-02")
    assert journals.unfinished(tmp_path, PLAN, "SN 1/2") is None
    second = begun(tmp_path)
    assert (first.number, second.number) == (1, 2)
    assert journals.unfinished(tmp_path, PLAN, "SN 1/2") == second
    assert journals.unfinished(tmp_path, PLAN, "SN-2") is None


def test_a_line_that_a_power_cut_left_is_not_counted_and_not_glued_to_the_next(
    tmp_path: Path,
) -> None:
    journal = begun(tmp_path).with_stage(stage(0, "a.h5"))
    whole = journal.path.read_bytes()
    for cut in range(whole.index(b"\n") + 1, len(whole)):
        journal.path.write_bytes(whole[:cut])
        found = journals.read(journal.path)
        assert found is not None
        assert not found.stages
        again = found.with_stage(stage(0, "b.h5"))
        assert journals.read(journal.path) == again


def test_a_file_of_which_nothing_was_begun_is_no_campaign(tmp_path: Path) -> None:
    journal = begun(tmp_path)
    journal.path.write_bytes(journal.path.read_bytes()[:20])
    assert journals.unfinished(tmp_path, PLAN, "SN 1/2") is None


def test_a_damaged_journal_is_refused_with_its_line(tmp_path: Path) -> None:
    journal = begun(tmp_path).with_stage(stage(0, "a.h5"))
    journal.path.write_text(journal.path.read_text().replace('"index"', '"ind', 1))
    with pytest.raises(RunFileError, match="line 2"):
        journals.read(journal.path)
    journal.path.write_text('{"what": "stage"}\n')
    with pytest.raises(RunFileError, match="no journal"):
        journals.read(journal.path)
