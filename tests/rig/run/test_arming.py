"""Arming asks for what a drive cannot do: watch the computer, or hold a limit."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from drivers.clock import VirtualClock
from drivers.port import Abilities, DriveLimits
from rig.bench.backends.assembly import AssembledRig
from rig.errors import LimitError
from rig.run.arming import loss_check
from rig.run.preflight import limits_check
from rig.run.start import arm
from tests.rig.fake_rig import FakeRig

REASONS = ("it does not hear the computer's heartbeat (0x1016)",)


def test_a_drive_that_would_not_stop_without_the_computer_is_armed_only_where_it_is_covered() -> (
    None
):
    assert loss_check(lambda: (), "").result == "ok"
    assert loss_check(None, "").result == "failed"
    refused = loss_check(lambda: REASONS, " ")
    assert refused.result == "failed"
    assert "0x1016" in refused.evidence
    assert "computer_loss_covered_by" in refused.remedy
    covered = loss_check(lambda: REASONS, "watchdog relay K3 in the STO line")
    assert covered.result == "warning"
    assert "watchdog relay K3" in covered.evidence


def test_it_is_asked_when_a_rig_in_real_time_is_armed() -> None:
    port = FakeRig()
    port.abilities = Abilities(unwatched=lambda: REASONS)
    rig = AssembledRig(
        name="hardware",
        port=port,
        clock=VirtualClock(),
        real_time=True,
        guard=lambda: (1, True),
    )
    assert [c.name for c in arm(rig) if c.result == "failed"] == ["loss of the computer"]
    assert "failed" not in {c.result for c in arm(replace(rig, loss_covered_by="K3"))}


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("torque", "torque_limit_unit_n_m"),
        ("deceleration", "are the same"),
        ("speed", "rig doctor"),
    ],
)
def test_a_limit_that_the_drive_does_not_hold_is_refused_with_what_to_do(
    name: str, words: str
) -> None:
    wanted = DriveLimits(0.5, 300.0, 1000.0, 1000.0, 2000.0)
    with pytest.raises(LimitError, match=f"holds no limit of its {name}.*{words}"):
        limits_check(wanted, replace(wanted, **{name: math.inf}))
