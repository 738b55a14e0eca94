"""What the doctor says of a drive that differs from the textbook, before anybody trusts its numbers."""

from __future__ import annotations

from typing import cast

import pytest

from drivers.bus.cia402.config import DriveConfig
from drivers.clock import VirtualClock
from drivers.port import Abilities
from experiments.finding import Finding, Severity
from rig.bench.backends.assembly import AssembledRig
from rig.bench.backends.order import Order
from rig.run.dry_run import PlannedRun
from rig.trial.doctor.drive import inspect_drive
from rig.trial.doctor.examine import PARTS, Looked
from tests.drivers.can_bench import servo
from tests.drivers.foreign_bench import bench
from tests.drivers.foreign_slave import READ_ONLY, Traits
from tests.rig.fake_rig import FakeRig


def lines(traits: Traits, config: DriveConfig | None = None) -> dict[str, Finding]:
    with bench(traits, config) as made:
        made.rig.open()
        return {f.what: f for f in inspect_drive(servo(made.rig.nodes), 127)}


@pytest.mark.parametrize(
    ("traits", "evidence", "entry"),
    [
        (Traits(values={(0x6076, 0): 637_000}), "637000 mN m = 637 N m", "rated_torque_n_m"),
        (Traits(absent=frozenset({0x60A9})), "neither 0x60A9 nor 0x6094", "velocity_unit_rad_s"),
        (Traits(absent=frozenset({0x60AA})), "no 0x60AA", "acceleration_unit_rad_s2"),
    ],
)
def test_a_unit_that_the_drive_cannot_be_believed_fails_and_is_asked_for(
    traits: Traits, evidence: str, entry: str
) -> None:
    found = lines(traits)["units"]
    assert found.severity is Severity.BLOCKS
    assert evidence in found.found
    assert f"Give `{entry}`" in found.remedy


def test_factory_factors_are_told_and_no_failure() -> None:
    found = lines(Traits(values={(0x608F, 1): 1}))["units"]
    assert found.severity is Severity.PASSED
    assert "those of [motor_encoder] hold unchecked" in found.found


def test_units_that_are_given_are_fine() -> None:
    told = DriveConfig(rated_torque=0.637, velocity_unit=1e-3, acceleration_unit=1e-3)
    assert (
        lines(Traits(absent=frozenset({0x6076, 0x60A9, 0x60AA})), told)["units"].severity
        is Severity.PASSED
    )


def test_a_quick_stop_that_stays_and_a_watch_that_is_not_there_are_told() -> None:
    stays = Traits(
        values={(0x605A, 0): 6}, refused={(0x605A, 0): READ_ONLY}, absent=frozenset({0x1016})
    )
    found = lines(stays)
    assert "quick-stop ramp, stays" in found["quick stop option"].found
    assert found["quick stop option"].severity is Severity.PASSED
    assert found["watch over the computer"].severity is Severity.WARNS


@pytest.mark.parametrize(
    ("reasons", "covered_by", "result"),
    [((), "", "passed"), (("no 0x1016",), "", "blocks"), (("no 0x1016",), "relay K3", "warns")],
)
def test_the_loss_of_the_computer_is_a_line_of_the_doctor(
    reasons: tuple[str, ...], covered_by: str, result: str
) -> None:
    port = FakeRig(abilities=Abilities(unwatched=lambda: reasons))
    rig = AssembledRig(
        name="hardware",
        port=port,
        clock=VirtualClock(),
        real_time=True,
        guard=lambda: (1, True),
        loss_covered_by=covered_by,
    )
    (part,) = [part for part in PARTS if part.name == "guard"]
    found = {
        f.what: f for f in part.inspect(Looked(rig, cast("PlannedRun", None), cast("Order", None)))
    }
    assert found["guard"].severity is Severity.PASSED
    assert found["loss of the computer"].severity == result
    assert all(words in found["loss of the computer"].found for words in reasons)
