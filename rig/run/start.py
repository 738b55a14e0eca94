"""Starts a run from names and numbers: protocol, gear, rig, folder. What `rig run` and `rig demo` share."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from drivers.clock import WallClock
from experiments import catalogue
from experiments.contract import Experiment
from experiments.finding import Finding
from experiments.parameters import make_parameters, parameter_fields
from experiments.recording import Event
from model.gear import HarmonicDrive, Mounting
from model.motor import ServoMotor
from rig.bench.backends.assembly import AssembledRig, RigRequest, WorldChoice
from rig.bench.backends.registry import (
    HARDWARE,
    is_simulated,
    make_port,
    nameplates,
    world_record,
)
from rig.bench.config.apply import limits_by_hand
from rig.bench.config.used import files_used
from rig.bench.identity import Bench, bench_of
from rig.errors import ConfigurationError
from rig.library.folder import RunPlace, claim_run
from rig.program import this_program
from rig.run.arming import Arming, guard_check, handle_check, loss_check, refuse_unarmed
from rig.run.bench_lock import bench_lock
from rig.run.computer import claim_real_time
from rig.run.dry_run import DEFAULT_SAMPLE_RATE, PlannedRun, plan_run, vars_of
from rig.run.engine import Ask
from rig.run.latch import latch_of
from rig.run.marker import RunMarker
from rig.run.opening import begin_inline_run, begin_threaded_run
from rig.run.order import Progress, RunOrder, RunReport
from rig.run.own_handle import OwnHandle
from rig.run.preflight import refuse_failed, static_checks
from rig.run.realtime import block_cycles, execute_in_real_time, watchdog_deadline
from rig.run.session import execute
from rig.run.stop import StopRequest
from rig.run.watchdog import Watchdog
from rig.run.world import refuse_world, start_state

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
    """Of a simulated rig: its bench, unless `world` names another."""
    world: WorldChoice = field(default_factory=WorldChoice)
    sample_rate: float = DEFAULT_SAMPLE_RATE
    block_cycles: int = 2000
    conditions: Mapping[str, Any] = field(default_factory=dict)
    configuration: Path | None = None
    """The file that describes the rig, for a rig of hardware."""
    limits: Mapping[str, float] = field(default_factory=dict)
    """Limits of the rig by quantity (SI), from its configuration."""
    output_bearing: Mapping[str, Any] = field(default_factory=dict)
    """The bench's output bearing, from its configuration, as run files carry it."""
    confirmation: str = ""
    """What the operator typed to arm a run on hardware."""
    calendar_ns: int | None = None
    """Calendar time at which the clock of a simulated rig begins; None: now."""


def plan_request(request: RunRequest, experiment: Experiment | None = None) -> PlannedRun:
    """The planned run of a request: of its protocol, or of an experiment that stands in no catalogue.

    Raises `PlanError`, `LimitError`, `ConfigurationError`; nothing is opened.
    """
    experiment = experiment or catalogue.load(request.protocol)
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
    refuse_world(request.backend, request.world)
    gear, motor = nameplates(request.backend, _rig_request(request))
    return plan_run(
        experiment,
        parameters,
        gear,
        motor,
        request.mounting,
        sample_rate=request.sample_rate,
        configured=request.limits,
    )


def bench_for(request: RunRequest) -> Bench:
    """The bench that a request is for. Raises `ConfigurationError` for hardware without identity or state folder."""
    chosen = request.world.bench_seed
    seed = request.seed if chosen is None else chosen
    return bench_of(request.backend, request.output, request.configuration, seed)


def rig_for(request: RunRequest, planned: PlannedRun) -> AssembledRig:
    """The rig that a request names, put together but not opened."""
    wanted = replace(
        _rig_request(request),
        gear_mounted=planned.experiment.gear_mounted,
        parameters=vars_of(planned.parameters),
        disc_inertia=getattr(planned.parameters, "disc_inertia", 0.0),
    )
    return make_port(request.backend, wanted)


def _rig_request(request: RunRequest) -> RigRequest:
    """What is asked of the rig, as far as it is known before there is a plan."""
    return RigRequest(
        gear=request.gear,
        motor=request.motor,
        mounting=request.mounting,
        serial=request.gear_serial,
        protocol=request.protocol,
        seed=request.seed,
        world=request.world,
        sample_rate=request.sample_rate,
        configuration=request.configuration,
        calendar_ns=request.calendar_ns,
    )


@contextmanager
def in_its_world(
    request: RunRequest, planned: PlannedRun
) -> Iterator[tuple[RunRequest, RunPlace | None]]:
    """A request whose simulated world is said to the end, and the number in its folder if it owns one already.

    The number owns the noise, so it is taken before the rig is put together, and given back if
    nothing was recorded. Raises `RigError`; nothing is opened.
    """
    choice, place = request.world, None
    if not is_simulated(request.backend):
        yield request, None
        return
    refuse_failed(static_checks(planned, request.output))
    # A gear that was not chosen by seed follows from its serial number, which the names of its runs bear.
    serial = request.gear_serial if choice.gear_seed is None else None
    start = choice.start or start_state(
        request.output, choice.start_state, world_record(_rig_request(request)), serial
    )
    if choice.number is None:
        place = claim_run(request.output, planned.experiment.name, request.gear_serial)
        choice = replace(choice, number=place.number)
    try:
        yield replace(request, world=replace(choice, start=start)), place
    finally:
        if place is not None:
            place.give_back()


def run_request(
    request: RunRequest,
    planned: PlannedRun | None = None,
    *,
    stop: StopRequest | None = None,
    ask: Ask = lambda prompt: "",
    on_progress: Callable[[Progress], None] | None = None,
    on_event: Callable[[Event], None] | None = None,
) -> RunReport:
    """Plan (unless `planned` is given), open the rig, run, make safe, seal. Raises only before
    anything moves.
    """
    planned = planned or plan_request(request)
    if request.backend == HARDWARE:
        refuse_unarmed(arming_of(request, planned))
    bench = bench_for(request)
    with bench_lock(bench, f"rig run {request.protocol}"):
        # Before anything is connected: a rig that tripped is left alone until somebody has looked.
        latch_of(bench).refuse()
        with in_its_world(request, planned) as (settled, place):
            return run_on(
                rig_for(settled, planned),
                settled,
                planned=planned,
                stop=stop,
                ask=ask,
                bench=bench,
                place=place,
                on_progress=on_progress,
                on_event=on_event,
            )


def run_on(
    rig: AssembledRig,
    request: RunRequest,
    planned: PlannedRun,
    stop: StopRequest | None = None,
    ask: Ask = lambda prompt: "",
    bench: Bench | None = None,
    place: RunPlace | None = None,
    on_progress: Callable[[Progress], None] | None = None,
    on_event: Callable[[Event], None] | None = None,
) -> RunReport:
    """Run what was planned on a rig that is put together and not opened. Whether it may is the caller's business.

    `bench`: where a trip is latched and the run marked, if that is not the request's own. `place`: a
    number of its folder that was taken for it.
    """
    bench = bench or bench_for(request)
    # Asked now: between opening a rig and its first turns a drive counts the ms without a heartbeat.
    this_program()
    marker = RunMarker(bench.state, bench.id)

    cycles = request.block_cycles
    if rig.real_time:
        cycles = block_cycles(request.sample_rate, cycles, rig.reaction)
    handle = handle_of(rig)
    order = RunOrder(
        planned=planned,
        port=rig.port,
        clock=rig.clock,
        backend=rig.name,
        output=request.output,
        operator=request.operator,
        gear_serial=request.gear_serial,
        seed=request.seed,
        block_cycles=cycles,
        conditions=dict(request.conditions),
        world=rig.world,
        output_bearing=request.output_bearing,
        thermal_state=rig.thermal_state,
        place=place,
        free_space=lambda: shutil.disk_usage(request.output).free,
        bench=bench.id,
        latch=latch_of(bench),
        marker=marker,
        watchdog=watchdog_of(rig, handle, cycles),
        arm=(lambda: arm(rig, handle)) if rig.real_time else None,
        files=files_used(request.configuration),
    )
    run, begin = (
        (execute_in_real_time, begin_threaded_run) if rig.real_time else (execute, begin_inline_run)
    )
    try:
        return run(
            order,
            begin,
            stop=stop,
            ask=ask,
            on_progress=on_progress,
            on_event=on_event,
        )
    finally:
        marker.let_go()


def arming_of(request: RunRequest, planned: PlannedRun) -> Arming:
    """What a request says of who arms it, and what its rig wants to be confirmed."""
    return Arming(
        request.operator,
        request.gear_serial,
        request.confirmation,
        planned.experiment.gear_mounted,
        limits_by_hand(request.configuration),
    )


def arm(rig: AssembledRig, handle: OwnHandle | None = None) -> tuple[Finding, ...]:
    """What is looked at last before a rig in real time may move; opens the watchdog's own handle."""
    unwatched, covered_by = rig.port.abilities.unwatched, rig.loss_covered_by
    own = (
        () if handle is None else (handle_check(handle.open, handle.known, unwatched, covered_by),)
    )
    return (
        *claim_real_time(rig.priority, rig.lock_memory),
        guard_check(rig.guard),
        loss_check(unwatched, covered_by),
        *own,
    )


def handle_of(rig: AssembledRig) -> OwnHandle | None:
    """The second handle on the bus of a rig in real time, not opened yet; None where it has none.

    `AssembledRig.second_bus` opens it, where a rig has one; the port tells the frames.
    """
    frames = rig.port.abilities.quick_stop_frames
    if not rig.real_time or rig.second_bus is None or frames is None:
        return None
    return OwnHandle(rig.second_bus, frames, rig.second_handle)


def watchdog_of(rig: AssembledRig, handle: OwnHandle | None, cycles: int) -> Watchdog | None:
    """The watchdog of a rig that can be stopped over a bus handle of its own; None where it cannot."""
    if handle is None:
        return None
    return Watchdog(
        WallClock(),
        watchdog_deadline(cycles, 1e9 / rig.port.cycle_ns),
        handle.quick_stop,
        close=handle.close,
    )
