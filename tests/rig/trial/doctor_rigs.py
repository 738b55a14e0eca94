"""Rigs on the wire with something wrong, and how they are looked over."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from drivers.bus.cyclic import CanRig, CanRigConfig
from drivers.clock import VirtualClock
from experiments.finding import Finding, Severity
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig.bench.backends.assembly import AssembledRig
from rig.bench.backends.order import Order
from rig.bench.backends.simulated import wire_config
from rig.trial.doctor.examine import Examination, examine
from sim_backend.faults import Fault
from sim_backend.wire.bench import WireBench
from sim_backend.world import World

START_NS = 1_790_000_000_000_000_000
"""A day in September 2026."""
RATE = 125.0
GEAR, MOTOR = shipped_gear(), shipped_motor()
Change = Callable[[CanRigConfig], CanRigConfig]


def request(folder: Path, **changes: object) -> Order:
    made = Order(
        protocol="doctor", gear=GEAR, motor=MOTOR, folder=folder, sample_rate=RATE, backend="wire"
    )
    return replace(made, **changes)  # type: ignore[arg-type]


def wire_bench(*faults: Fault, **changes: object) -> WireBench:
    return WireBench(
        GEAR,
        MOTOR,
        world=World.of(4),
        cycle_ns=round(1e9 / RATE),
        clock=VirtualClock(START_NS),
        faults=faults,
        **changes,  # type: ignore[arg-type]
    )


def on_the_wire(
    change: Change = lambda c: c, *faults: Fault, bench: WireBench | None = None
) -> AssembledRig:
    bench = bench or wire_bench(*faults)
    config = change(wire_config(bench, MOTOR))
    port = CanRig(
        config, bench.clock, bench.bus, pump=bench.pump, time_base="hardware", origin="simulated"
    )
    return AssembledRig(name="wire", port=port, clock=bench.clock, nodes=lambda: port.nodes)


def counter(config: CanRigConfig, **changes: object) -> CanRigConfig:
    return replace(config, counters=(replace(config.counters[0], **changes),))  # type: ignore[arg-type]


def motor_encoder(config: CanRigConfig, **changes: object) -> CanRigConfig:
    return replace(config, motor_encoder=replace(config.motor_encoder, **changes))  # type: ignore[arg-type]


def torque_input(config: CanRigConfig, **changes: object) -> CanRigConfig:
    module = config.modules[0]
    inputs = (replace(module.inputs[0], **changes), *module.inputs[1:])  # type: ignore[arg-type]
    return replace(config, modules=(replace(module, inputs=inputs),))


def look(
    folder: Path, make: Callable[[], AssembledRig], moves: bool = False, **changes: object
) -> Examination:
    return examine(make, request(folder, **changes), moves=moves, why_not="not asked to")


def line(found: Examination, group: str, name: str) -> Finding:
    """The line under a heading that begins with `group`."""
    fitting = [f for f in found.findings if f.where.startswith(group) and f.what == name]
    assert len(fitting) == 1, [(f.where, f.what) for f in found.findings]
    return fitting[0]


def failed(found: Examination) -> list[tuple[str, str]]:
    return [(f.where, f.what) for f in found.findings if f.severity is Severity.BLOCKS]
