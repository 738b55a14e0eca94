"""What nodes tell becomes a description in which everything that cannot be believed is asked."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import pytest

from drivers.bus.cia402.plausible import Statement
from drivers.bus.device import Identity
from drivers.bus.discover import FoundNode
from rig.bench.config.load import inspect_configuration, load_configuration
from rig.bench.config.schema import RigConfiguration
from rig.trial.doctor.discover.description import description
from rig.trial.doctor.discover.proposal import Bus, Proposal, propose

BUS = Bus("socketcan", "can0", 1_000_000)
GOOD = Statement(
    rated_torque=637,
    rated_current=2800,
    largest_speed=6000,
    encoder=(32768, 1),
    gear=(1, 1),
    velocity_unit=0xFDB44700,
    acceleration_unit=0xFDB44800,
)
ANSWERS = {
    "motor": '"sgmjv-02"',
    "gear": '"csf-25-120"',
    "lines": "8192",
    "multiplication": "4",
    "mask": "8",
    "closed": "8",
    "object": '"0x6401:1 I16"',
    "volts_per_count": "0.3125e-3",
    "volts_per_rated_torque": "1.0",
    "rated_torque_n_m": "0.637",
    "counts_per_revolution": "32768.0",
    "velocity_unit_rad_s": "1e-4",
    "acceleration_unit_rad_s2": "1e-1",
    "computer_loss_covered_by": '"a watchdog relay on STO"',
    "channel": '"motor_side"',
    "speed_modes": '["profile velocity"]',
}


def node(node_id: int, profile: int, **told: object) -> FoundNode:
    identity = Identity(
        device_type=profile, vendor_id=1, product_code=2, revision=3, serial_number=4, name="a node"
    )
    return FoundNode(node_id=node_id, identity=identity, **told)  # type: ignore[arg-type]


def drive(**told: object) -> FoundNode:
    return node(
        1,
        402,
        **{"modes": 0x30C, "has_consumer": True, "statement": GOOD, "quick_stop_option": 2, **told},
    )


COUNTER = node(2, 406, counts_per_revolution=72_000, total_range=0)
COUPLER = node(3, 401, analog_inputs=4)


def proposed(*nodes: FoundNode) -> Proposal:
    return propose(nodes, BUS, "bcdf-2345")


def asked(proposal: Proposal) -> list[str]:
    return [word for word, _ in proposal.questions]


def test_all_that_is_marked_is_named_and_what_is_said_makes_a_rig(tmp_path: Path) -> None:
    proposal = proposed(drive(has_digital_inputs=True), COUNTER, COUPLER)
    path = tmp_path / "rig.toml"
    text = description(proposal)
    path.write_text(text, encoding="utf-8")
    problems = inspect_configuration(path)
    assert not isinstance(problems, RigConfiguration)
    assert len(problems) == len(proposal.questions) == text.count('"SAY: ')
    assert {"motor_encoder.lines", "counter[0].lines", "analog_module[0].input[0].object"} <= {
        problem.what for problem in problems
    }
    assert all(problem.follows.startswith("must still be said: ") for problem in problems)
    lines = [
        f"{line.partition(' = ')[0]} = {ANSWERS[line.partition(' = ')[0]]}"
        if '"SAY: ' in line
        else line
        for line in text.splitlines()
    ]
    path.write_text("\n".join(lines), encoding="utf-8")
    rig = load_configuration(path)
    assert (rig.drive.node_id, rig.counters[0].node_id, rig.analog_modules[0].node_id) == (1, 2, 3)
    assert rig.bench.id == "bcdf-2345"
    assert rig.rig.sample_rate_hz == proposal.rate == 500.0


@pytest.mark.parametrize(
    ("told", "word", "why"),
    [
        ({"statement": replace(GOOD, rated_torque=637_000)}, "rated_torque_n_m", "uN m"),
        ({"statement": replace(GOOD, rated_torque=0)}, "rated_torque_n_m", "nobody has set it"),
        (
            {"statement": replace(GOOD, encoder=(1, 1), feed=(1, 1))},
            "counts_per_revolution",
            "as the factory left them, which is no unit",
        ),
        ({"statement": replace(GOOD, velocity_unit=None)}, "velocity_unit_rad_s", "0x60A9"),
        (
            {"statement": replace(GOOD, acceleration_unit=None)},
            "acceleration_unit_rad_s2",
            "0x60AA",
        ),
        ({"has_consumer": False}, "computer_loss_covered_by", "0x1016"),
        ({"modes": 0x43}, "speed_modes", "no velocity mode"),
    ],
)
def test_what_a_drive_cannot_mean_is_asked(told: dict[str, object], word: str, why: str) -> None:
    questions = dict(proposed(drive(**told)).questions)
    assert why in questions[f"[drive] {word}"]
    assert f"[drive] {word}" not in dict(proposed(drive()).questions)


def test_what_a_drive_can_do_is_written_with_its_reason() -> None:
    text = description(proposed(drive(modes=0x65, quick_stop_option=6)))
    assert 'speed_modes = ["profile velocity"]' in text
    assert "the drive's own ramps shape the steps" in text
    assert "torque_modes = []" in text
    assert "quick_stop_option = 2  # 0x605A is 6: it would stay in QUICK STOP ACTIVE" in text
    assert "# rated_torque_n_m: asked of the drive: 0.637 N m by 0x6076" in text


def test_two_encoders_two_drives_and_nobody() -> None:
    second = replace(COUNTER, node_id=5)
    words = asked(proposed(drive(), COUNTER, second))
    assert words.count("[[counter]] channel") == 1
    assert "other drives: 7" in description(proposed(drive(), replace(drive(), node_id=7)))
    assert "[drive] node_id" in asked(proposed(COUNTER))


def test_what_is_not_built_stands_in_the_file() -> None:
    text = description(proposed(drive(sync_overflow=240)))
    assert "# - node 1: a SYNC with a counter (0x1019 = 240)" in text


def test_names_with_quotes_are_written_as_toml_has_them(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(
        description(propose([drive()], replace(BUS, channel='a "b" \\ c'), "bcdf-2345")),
        encoding="utf-8",
    )
    text = path.read_text(encoding="utf-8")
    assert tomllib.loads(text)["bus"]["channel"] == 'a "b" \\ c'
