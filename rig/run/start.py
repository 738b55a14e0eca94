"""Starts a run from names and numbers: protocol, gear, rig, folder. What `rig run` and `rig demo` share."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from drivers.clock import WallClock
from experiments import catalogue
from experiments.parameters import make_parameters, parameter_fields
from experiments.recording import Event
from model.gear import HarmonicDrive, Mounting
from model.motor import ServoMotor
from rig.bench.backends.assembly import Bench, BenchRequest
from rig.bench.backends.registry import HARDWARE, make_port
from rig.errors import ConfigurationError
from rig.run.arming import Arming, guard_check, refuse_unarmed
from rig.run.computer import claim_real_time
from rig.run.devices import StopsAlone
from rig.run.dry_run import DEFAULT_SAMPLE_RATE, PlannedRun, plan_run
from rig.run.engine import Ask
from rig.run.judge import judge_by
from rig.run.latch import TripLatch
from rig.run.opening import begin_inline_run, begin_threaded_run
from rig.run.order import Judge, Progress, RunOrder, RunReport
from rig.run.preflight import Check
from rig.run.realtime import block_cycles, execute_in_real_time, watchdog_deadline
from rig.run.session import execute
from rig.run.stop import StopRequest
from rig.run.watchdog import Watchdog

MOUNTINGS: tuple[Mounting, ...] = ("circular-spline-fixed", "flexspline-fixed")


@dataclass(frozen=True, kw_only=True)
class RunRequest:
    """What somebody wants to run: a protocol with its parameters, on which gear and motor, on which rig, kept where."""

    protocol: str
    gear: HarmonicDrive
    motor: ServoMotor
    output: Path
    values: Mapping[str, Any] = field(default_factory=dict)
    backend: str = "sim"
    mounting: Mounting = "circular-spline-fixed"
    gear_serial: str = "unknown"
    operator: str = ""
    seed: int = 0
    sample_rate: float = DEFAULT_SAMPLE_RATE
    block_cycles: int = 2000
    conditions: Mapping[str, Any] = field(default_factory=dict)
    configuration: Path | None = None
    """The file that describes the rig, for a rig of hardware."""
    limits: Mapping[str, float] = field(default_factory=dict)
    """Limits of the rig by quantity (SI), from its configuration."""
    confirmation: str = ""
    """What the operator typed to arm a run on hardware."""


def plan_request(request: RunRequest) -> PlannedRun:
    """The planned run of a request. Raises `PlanError`, `LimitError`, `ConfigurationError`; nothing is opened."""
    experiment = catalogue.load(request.protocol)
    if request.mounting not in MOUNTINGS:
        raise ConfigurationError(
            "no such mounting",
            where="--mounting",
            value=repr(request.mounting),
            limit=", ".join(MOUNTINGS),
        )
    values = dict(request.values)
    names = {f.name for f in parameter_fields(experiment.parameters)}
    # What the rig already knows is not asked for twice: the protocol's own number is only for planning without a rig.
    for name, value in (("mounting", request.mounting), ("sync_rate", request.sample_rate)):
        if name in names:
            values.setdefault(name, value)
    parameters = make_parameters(experiment.parameters, values, request.protocol)
    return plan_run(
        experiment,
        parameters,
        request.gear,
        request.motor,
        request.mounting,
        sample_rate=request.sample_rate,
        configured=request.limits,
    )


def bench_for(request: RunRequest, planned: PlannedRun) -> Bench:
    """The rig that a request names, put together but not opened."""
    wanted = BenchRequest(
        gear=request.gear,
        motor=request.motor,
        mounting=request.mounting,
        gear_mounted=planned.experiment.gear_mounted,
        serial=request.gear_serial,
        protocol=request.protocol,
        seed=request.seed,
        sample_rate=request.sample_rate,
        disc_inertia=getattr(planned.parameters, "disc_inertia", 0.0),
        configuration=request.configuration,
    )
    return make_port(request.backend, wanted)


def run_request(
    request: RunRequest,
    planned: PlannedRun | None = None,
    *,
    stop: StopRequest | None = None,
    ask: Ask = lambda prompt: "",
    judged: bool = True,
    on_progress: Callable[[Progress], None] | None = None,
    on_event: Callable[[Event], None] | None = None,
) -> RunReport:
    """Plan (unless `planned` is given), open the rig, run, make safe, judge, seal. Raises only
    before anything moves.
    """
    planned = planned or plan_request(request)
    # Before anything is connected: a rig that tripped is left alone until somebody has looked.
    TripLatch(request.output).refuse()
    if request.backend == HARDWARE:
        refuse_unarmed(arming_of(request, planned))
    bench = bench_for(request, planned)
    return run_on(
        bench,
        request,
        planned=planned,
        stop=stop,
        ask=ask,
        judge=judge_by(planned) if judged else None,
        on_progress=on_progress,
        on_event=on_event,
    )


def run_on(
    bench: Bench,
    request: RunRequest,
    planned: PlannedRun,
    stop: StopRequest | None = None,
    ask: Ask = lambda prompt: "",
    judge: Judge | None = None,
    on_progress: Callable[[Progress], None] | None = None,
    on_event: Callable[[Event], None] | None = None,
) -> RunReport:
    """Run what was planned on a rig that is put together and not opened. Whether it may is the caller's business."""
    cycles = request.block_cycles
    if bench.real_time:
        cycles = block_cycles(request.sample_rate, cycles, bench.reaction)
    order = RunOrder(
        planned=planned,
        port=bench.port,
        clock=bench.clock,
        backend=bench.name,
        output=request.output,
        operator=request.operator,
        gear_serial=request.gear_serial,
        seed=request.seed,
        block_cycles=cycles,
        conditions=dict(request.conditions),
        free_space=lambda: shutil.disk_usage(request.output).free,
        latch=TripLatch(request.output),
        watchdog=watchdog_of(bench, cycles) if bench.real_time else None,
        arm=(lambda: arm(bench)) if bench.real_time else None,
    )
    run, begin = (
        (execute_in_real_time, begin_threaded_run)
        if bench.real_time
        else (execute, begin_inline_run)
    )
    return run(
        order, begin, stop=stop, ask=ask, judge=judge, on_progress=on_progress, on_event=on_event
    )


def arming_of(request: RunRequest, planned: PlannedRun) -> Arming:
    """What a request says of who arms it."""
    return Arming(
        request.operator, request.gear_serial, request.confirmation, planned.experiment.gear_mounted
    )


def arm(bench: Bench) -> tuple[Check, ...]:
    """What is looked at last before a rig in real time may move."""
    return (*claim_real_time(bench.priority, bench.lock_memory), guard_check(bench.guard))


def watchdog_of(bench: Bench, cycles: int) -> Watchdog | None:
    """The watchdog of a rig in real time that can be stopped over a bus handle of its own; None where it cannot.

    `Bench.second_bus` opens that handle, where a rig has one; the port tells the frames.
    """
    if bench.second_bus is None or not isinstance(bench.port, StopsAlone):
        return None
    port, bus = bench.port, bench.second_bus()

    def quick_stop() -> None:
        import can

        for cob_id, data in port.quick_stop_frames():
            bus.send(can.Message(arbitration_id=cob_id, data=data, is_extended_id=False))

    return Watchdog(
        WallClock(),
        watchdog_deadline(cycles, 1e9 / bench.port.cycle_ns),
        quick_stop,
        close=bus.shutdown,
    )
