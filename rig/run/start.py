"""Starts a run from names and numbers: protocol, gear, rig, folder. What `rig run` and `rig demo` share."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from experiments import catalogue
from experiments.parameters import make_parameters, parameter_fields
from experiments.recording import Event
from model.gear import HarmonicDrive, Mounting
from model.motor import ServoMotor
from rig.backends import Bench, BenchRequest, make_port
from rig.errors import ConfigurationError
from rig.run.dry_run import DEFAULT_SAMPLE_RATE, PlannedRun, plan_run
from rig.run.engine import Ask
from rig.run.judge import judge_by
from rig.run.opening import begin_inline_run
from rig.run.order import Progress, RunOrder, RunReport
from rig.run.session import execute
from rig.run.stop import StopRequest

MOUNTINGS: tuple[Mounting, ...] = ("circular-spline-fixed", "flexspline-fixed")


@dataclass(frozen=True)
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
    block_cycles: int = 1000
    conditions: Mapping[str, Any] = field(default_factory=dict)


def plan_request(request: RunRequest) -> PlannedRun:
    """The planned run of a request. Raises `PlanError`, `LimitError`, `ConfigurationError`; nothing is opened."""
    experiment = catalogue.load(request.protocol)
    if request.mounting not in MOUNTINGS:
        raise ConfigurationError(
            "no such mounting", where="--mounting", value=repr(request.mounting), limit=", ".join(MOUNTINGS)
        )
    values = dict(request.values)
    known = {f.name for f in parameter_fields(experiment.parameters)}
    # What the rig already knows is not asked for twice: the protocol's own number is only for planning without a rig.
    for name, value in (("mounting", request.mounting), ("sync_rate", request.sample_rate)):
        if name in known:
            values.setdefault(name, value)
    parameters = make_parameters(experiment.parameters, values, request.protocol)
    return plan_run(
        experiment, parameters, request.gear, request.motor, request.mounting, sample_rate=request.sample_rate
    )


def bench_for(request: RunRequest, planned: PlannedRun) -> Bench:
    """The rig that a request names, put together but not opened."""
    wanted = BenchRequest(
        request.gear,
        request.motor,
        request.mounting,
        planned.experiment.gear_mounted,
        request.gear_serial,
        request.protocol,
        request.seed,
        request.sample_rate,
        disc_inertia=getattr(planned.parameters, "disc_inertia", 0.0),
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
    """Plan (unless `planned` is given), open the rig, run, make safe, judge, seal. Raises only before anything moves."""
    planned = planned or plan_request(request)
    bench = bench_for(request, planned)
    order = RunOrder(
        planned=planned,
        port=bench.port,
        clock=bench.clock,
        backend=bench.name,
        output=request.output,
        operator=request.operator,
        gear_serial=request.gear_serial,
        seed=request.seed,
        block_cycles=request.block_cycles,
        conditions=dict(request.conditions),
        free_space=lambda: shutil.disk_usage(request.output).free,
    )
    judge = judge_by(planned) if judged else None
    return execute(order, begin_inline_run, stop=stop, ask=ask, judge=judge, on_progress=on_progress, on_event=on_event)
