"""The record of a commissioning: what counts, why something does not, and how far a bench may go without it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from model.units import RPM
from rig.bench.commissioning import (
    COUPLED,
    JOURNAL_NAME,
    NAMES,
    Asked,
    Missing,
    StageDone,
    beyond,
    keep,
    missing_stages,
    read_record,
)
from rig.bench.config.described import description_hash
from rig.bench.config.load import load_configuration
from rig.errors import ChangedRunError
from tests.rig.trial.commission.benches import right_text

DRIVE = {"vendor_id": "1", "product_code": "2", "serial_number": "77", "name": "drive"}


def done(stage: str, **changes: object) -> StageDone:
    made = StageDone(
        stage=stage,
        at="2026-11-27T08:00:00+00:00",
        operator="A. Example",
        passed=True,
        description="D",
        devices={"node 1": DRIVE},
    )
    return replace(made, **changes)  # type: ignore[arg-type]


ALL = tuple(done(name) for name in NAMES)


def reasons(record: tuple[StageDone, ...], **asked: object) -> dict[str, str]:
    description, devices = asked.get("description", "D"), asked.get("devices")
    found = missing_stages(record, description, devices)  # type: ignore[arg-type]
    return {one.stage: one.reason for one in found}


def test_a_bench_that_nobody_met_lacks_everything() -> None:
    assert reasons(()) == dict.fromkeys(NAMES, "never done")


def test_what_was_done_with_this_description_and_these_devices_counts() -> None:
    assert reasons(ALL, devices={"node 1": DRIVE}) == {}


@pytest.mark.parametrize(
    ("record", "asked", "reason"),
    [
        ((*ALL, done("hand", passed=False)), {}, "failed on 2026-11-27"),
        (ALL, {"description": "E"}, "the description has changed since 2026-11-27"),
        (ALL, {"devices": {"node 1": {**DRIVE, "serial_number": "78"}}}, "another node 1"),
        (ALL, {"devices": {"node 1": DRIVE, "node 4": DRIVE}}, "another node 4"),
        (ALL, {"devices": {}}, "another node 1"),
    ],
)
def test_what_is_older_than_a_change_does_not_count(
    record: tuple[StageDone, ...], asked: dict[str, object], reason: str
) -> None:
    assert reason in reasons(record, **asked)["hand"]


def test_a_stage_that_failed_counts_once_it_was_done_again() -> None:
    assert reasons((*ALL, done("hand", passed=False), done("hand"))) == {}


EVERYTHING = tuple(Missing(name, "never done") for name in NAMES)
LATER = tuple(one for one in EVERYTHING if one.stage in COUPLED)


@pytest.mark.parametrize(
    ("missing", "asked", "words"),
    [
        (EVERYTHING, Asked(fastest=31.0 * RPM), ("31 r/min, allowed 30 r/min",)),
        (EVERYTHING, Asked(fastest=30.0 * RPM, output_turns=1.0), ()),
        (EVERYTHING, Asked(fastest=0.0, has_torque=True), ("set-points of torque, allowed",)),
        (LATER, Asked(fastest=3000.0 * RPM, output_turns=1.0, has_torque=True), ()),
        (LATER, Asked(fastest=RPM, output_turns=1.2), ("1.2 turns of the output, allowed 1",)),
        ((), Asked(fastest=5000.0 * RPM, output_turns=500.0, has_torque=True), ()),
    ],
)
def test_how_far_a_plan_may_go(
    missing: tuple[Missing, ...], asked: Asked, words: tuple[str, ...]
) -> None:
    found = beyond(missing, asked)
    assert len(found) == len(words)
    assert all(said.startswith(word) for said, word in zip(found, words, strict=True))


def test_a_line_that_was_changed_is_refused_by_name(tmp_path: Path) -> None:
    for stage in ALL[:3]:
        keep(tmp_path / "state", stage)
    assert read_record(tmp_path / "state") == ALL[:3]
    path = tmp_path / "state" / JOURNAL_NAME
    path.write_text(path.read_text("utf-8").replace("A. Example", "B. Example", 1), "utf-8")
    with pytest.raises(ChangedRunError, match="record of the commissioning was changed"):
        read_record(tmp_path / "state")


def hash_after(folder: Path, edit: Callable[[str], str]) -> str:
    path = folder / "rig.toml"
    path.write_text(edit(right_text()), "utf-8")
    return description_hash(load_configuration(path))


@pytest.mark.parametrize(
    ("edit", "changes"),
    [
        (lambda text: text.replace("lines = 18000", "lines = 18000\ndirection = -1"), True),
        (lambda text: text.replace("closed = 0x00000008", "closed = 0x00000000"), True),
        (lambda text: text + "\n[limits]\ninput_speed_rpm = 2000.0\n", True),
        (lambda text: text.replace("sample_rate_hz = 50", "sample_rate_hz = 200"), True),
        (lambda text: text.replace('"simulated encoder"', '"x"\nserial_number = "5"'), True),
        (lambda text: text + '\n[laboratory]\nname = "L"\n', False),
        (lambda text: text + "\n[alarms]\nover = 40\n", False),
        (lambda text: text.replace("accuracy = 2.4e-5", "accuracy = 2.5e-5"), False),
    ],
)
def test_the_hash_is_over_what_describes_devices_channels_limits_and_guard(
    edit: Callable[[str], str], changes: bool, tmp_path: Path
) -> None:
    before = hash_after(tmp_path, lambda text: text)
    assert edit(right_text()) != right_text()
    assert (hash_after(tmp_path, edit) != before) is changes
