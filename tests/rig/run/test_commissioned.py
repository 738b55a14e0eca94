"""What a run on hardware is told about the commissioning of its bench, before anything moves."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest

from drivers.bus.device import Identity
from drivers.bus.rig_nodes import RigNodes
from drivers.clock import VirtualClock
from drivers.port import RigPort
from experiments.finding import Severity
from rig.bench.backends.assembly import AssembledRig
from rig.bench.backends.order import Order
from rig.bench.commissioning import NAMES, StageDone, keep
from rig.bench.config.described import description_hash
from rig.bench.config.load import load_configuration
from rig.bench.identity import Bench
from rig.errors import ConfigurationError
from rig.run.commissioned import (
    SENTENCE,
    commissioned_check,
    devices_of,
    refuse_sentence,
    standing_of,
)
from rig.run.start import plan_order
from rig.trial.commission.motion import UNCOUPLED
from tests.rig.trial.commission.benches import right_text

IDENTITY = Identity(device_type=402, vendor_id=0x66, serial_number=77)


def rig_of(identity: Identity) -> AssembledRig:
    nodes = SimpleNamespace(
        devices=[SimpleNamespace(node_id=1)],
        identities={"servo amplifier": identity},
        are_simulated=identity.is_simulated,
    )
    return AssembledRig(
        name="hardware",
        port=cast("RigPort", None),
        clock=VirtualClock(),
        nodes=lambda: cast("RigNodes", nodes),
    )


@pytest.fixture
def order(tmp_path: Path) -> Order:
    path = tmp_path / "rig.toml"
    path.write_text(right_text(), "utf-8")
    return Order(protocol="home", operator="A. Example", folder=tmp_path, config=path)


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(id="abcd-efgh", state=tmp_path, scope="named", option="")


def commissioned(bench: Bench, order: Order, names: tuple[str, ...] = NAMES) -> None:
    assert order.config is not None
    for name in names:
        done = StageDone(
            stage=name,
            at="2026-11-27T08:00:00+00:00",
            operator="A",
            passed=True,
            description=description_hash(load_configuration(order.config)),
            devices=devices_of(rig_of(IDENTITY)),
        )
        keep(bench.state, done)


def test_what_goes_too_far_is_refused_and_names_what_is_missing(order: Order, bench: Bench) -> None:
    found = commissioned_check(
        rig_of(IDENTITY), order, standing_of(bench, order), plan_order(order)
    )
    assert found.severity is Severity.BLOCKS
    assert all(name in found.found for name in NAMES)
    assert "r/min, allowed 30 r/min" in found.found
    assert SENTENCE in found.remedy


def test_the_typed_sentence_lets_it_go_and_stays_in_the_run(order: Order, bench: Bench) -> None:
    found = commissioned_check(
        rig_of(IDENTITY), order, standing_of(bench, order), plan_order(order), SENTENCE
    )
    assert found.severity is Severity.WARNS
    assert f"A. Example typed: {SENTENCE}" in found.sentence


def test_a_slow_short_plan_is_told_and_goes_on(order: Order, bench: Bench) -> None:
    found = commissioned_check(
        rig_of(IDENTITY), order, standing_of(bench, order), plan_order(order, UNCOUPLED)
    )
    assert (found.severity, "missing" in found.found) == (Severity.WARNS, True)
    assert (
        commissioned_check(rig_of(IDENTITY), order, standing_of(bench, order)).severity
        is Severity.WARNS
    )


def test_a_commissioned_bench_and_a_simulated_one_are_told_so(order: Order, bench: Bench) -> None:
    simulated = replace(IDENTITY, hardware_version="Simulated")
    assert (
        "simulated" in commissioned_check(rig_of(simulated), order, standing_of(bench, order)).found
    )
    commissioned(bench, order)
    found = commissioned_check(
        rig_of(IDENTITY), order, standing_of(bench, order), plan_order(order)
    )
    assert (found.severity, "every stage was done" in found.found) == (Severity.PASSED, True)


def test_another_device_takes_every_stage_away(order: Order, bench: Bench) -> None:
    commissioned(bench, order)
    other = rig_of(replace(IDENTITY, serial_number=78))
    found = commissioned_check(other, order, standing_of(bench, order), plan_order(order))
    assert found.severity is Severity.BLOCKS
    assert found.found.count("another node 1 since 2026-11-27") == len(NAMES)


@pytest.mark.parametrize("typed", ["yes", SENTENCE.lower(), SENTENCE + "!"])
def test_another_sentence_is_none(typed: str) -> None:
    with pytest.raises(ConfigurationError, match="--uncommissioned"):
        refuse_sentence(typed)
    refuse_sentence("")
    refuse_sentence(f" {SENTENCE}\n")
