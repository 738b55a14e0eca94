"""Wrong descriptions of one bench: each is found before the motor has driven anything that is coupled."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from experiments.finding import Severity
from tests.rig.trial.commission.benches import described, first_failure

BEFORE = ("read", "hand", "uncoupled")
"""What is done before the gear is driven, but for listening, which looks at no description, and the stops."""


def word(table: str, key: str, value: str) -> Callable[[str], str]:
    """Set a word of a table, in the first table of this name; a new one is added."""

    def edit(text: str) -> str:
        before, heading, rest = text.partition(table)
        assert heading, table
        head, next_table, after = rest.partition("\n[")
        line = f"\n{key} = {value}"
        changed, count = re.subn(rf"\n{key} = [^\n]*", line, head)
        return before + heading + (changed if count else line + head) + next_table + after

    return edit


def both(*edits: Callable[[str], str]) -> Callable[[str], str]:
    def edit(text: str) -> str:
        for one in edits:
            text = one(text)
        return text

    return edit


def swapped(first: str, second: str) -> Callable[[str], str]:
    return lambda text: text.replace(first, "@@").replace(second, first).replace("@@", second)


@dataclass(frozen=True)
class Wrong:
    """What is wrong, the stage that finds it, and words of the line that says so."""

    name: str
    edit: Callable[[str], str]
    stage: str
    line: str
    mounting: str = "circular-spline-fixed"
    analog_scale: float = 0.0


def same(text: str) -> str:
    return text


OUTPUT, MOTOR_ENCODER, TORQUE = "[[counter]]", "[motor_encoder]", "[[analog_module.input]]"
ROWS = (
    Wrong("sense of the output", word(OUTPUT, "direction", "-1"), "hand", "sense of the output"),
    Wrong("sense of the input", word(MOTOR_ENCODER, "direction", "-1"), "hand", "sense"),
    Wrong(
        "sense of both",
        both(word(OUTPUT, "direction", "-1"), word(MOTOR_ENCODER, "direction", "-1")),
        "uncoupled",
        "run",
    ),
    Wrong("N + 1 for N", same, "hand", "sense", mounting="flexspline-fixed"),
    Wrong(
        "N + 1 for N, and the sense to fit",
        word(OUTPUT, "direction", "-1"),
        "hand",
        "ratio",
        mounting="flexspline-fixed",
    ),
    Wrong("motor lines x 4", word(MOTOR_ENCODER, "multiplication", "16"), "read", "counts per"),
    Wrong("motor bits for lines", word(MOTOR_ENCODER, "lines", "2048"), "read", "counts per"),
    Wrong("output lines x 4", word(OUTPUT, "multiplication", "16"), "read", "counts per"),
    Wrong("output lines / 10", word(OUTPUT, "lines", "1800"), "read", "counts per"),
    Wrong("torque / 10", word(TORQUE, "volts_per_rated_torque", "10.0"), "uncoupled", "torque"),
    Wrong("torque x 10", word(TORQUE, "volts_per_rated_torque", "0.1"), "uncoupled", "zero"),
    Wrong("torque x 3", word(TORQUE, "volts_per_rated_torque", "0.333"), "uncoupled", "torque"),
    Wrong("sense of the torque", word(TORQUE, "direction", "-1"), "uncoupled", "torque direction"),
    Wrong("guard inverted", word("[guard]", "closed", "0x00000000"), "hand", "guard, open"),
    Wrong(
        "another bit for the guard",
        both(word("[guard]", "mask", "4"), word("[guard]", "closed", "4")),
        "hand",
        "guard, closed",
    ),
    Wrong("SYNC rate", word("[rig]", "sample_rate_hz", "400.0"), "uncoupled", "rate"),
    Wrong(
        "drive and counter exchanged", swapped("node_id = 1\n", "node_id = 2\n"), "read", "identity"
    ),
    Wrong(
        "counter and module exchanged",
        swapped("node_id = 2\n", "node_id = 3\n"),
        "read",
        "identity",
    ),
    Wrong("a node that is not there", word("[[analog_module]]", "node_id", "5"), "read", "answers"),
    Wrong(
        "limit in another unit",
        lambda text: text + "\n[limits]\nmotor_torque_n_m = 0.000637\n",
        "uncoupled",
        "",
    ),
    Wrong("rated torque x 10", word("[drive]", "rated_torque_n_m", "6.37"), "read", "rated torque"),
    Wrong("speed unit", word("[drive]", "velocity_unit_rad_s", "0.01"), "uncoupled", ""),
    Wrong(
        "torque and temperature exchanged",
        lambda text: text.replace(
            'channel = "torque"', 'channel = "torque"\nobject = "0x6401:3 I16"'
        ).replace(
            'channel = "housing_temperature"\nobject = "0x6401:3 I16"',
            'channel = "housing_temperature"\nobject = "0x6401:1 I16"',
        ),
        "uncoupled",
        "zero",
    ),
    Wrong(
        "thermometer x 10",
        lambda t: t.replace("unit_per_volt = 32.0", "unit_per_volt = 320.0"),
        "read",
        "temp",
    ),
    Wrong(
        "an object that is not there", word(OUTPUT, "position", '"0x6020:0 I32"'), "read", "0x6020"
    ),
    Wrong("scale of the reference", same, "uncoupled", "", analog_scale=2.0),
)


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_a_wrong_description_is_found_before_anything_coupled_is_driven(
    row: Wrong, tmp_path: Path
) -> None:
    bench = described(tmp_path, row.edit, mounting=row.mounting, analog_scale=row.analog_scale)
    stage, seen = first_failure(bench.order, bench.make, BEFORE)
    assert seen is not None, "nobody found it"
    failed = [finding for finding in seen.findings if finding.severity is Severity.BLOCKS]
    assert (stage, bench.moved) == (row.stage, 0.0), [finding.sentence for finding in failed]
    assert any(row.line in finding.what for finding in failed), [f.sentence for f in failed]
    assert all(finding.remedy or finding.found for finding in failed)


def test_the_right_description_passes(tmp_path: Path) -> None:
    bench = described(tmp_path)
    assert first_failure(bench.order, bench.make, ("listen", *BEFORE)) == ("", None)
