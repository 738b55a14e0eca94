"""Starts a run from names and numbers: protocol, gear, rig, folder. What `rig run` and `rig demo` share."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from drivers.clock import WallClock
from experiments import catalogue
from experiments.contract import Experiment
from experiments.finding import Finding
from experiments.parameters import make_parameters, parameter_fields
from experiments.recording import Event
from rig.bench.backends.assembly import AssembledRig
from rig.bench.backends.order import MOUNTINGS, Order, Setup
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
from rig.run.bystander import standing_by
from rig.run.commissioned import commissioned_check, refuse_sentence, standing_of
from rig.run.computer import claim_real_time
from rig.run.contents import with_contents
from rig.run.dry_run import PlannedRun, plan_run, vars_of
from rig.run.engine import Ask
from rig.run.frames import keep_frames
from rig.run.latch import latch_of
from rig.run.marker import RunMarker
from rig.run.opening import begin_inline_run, begin_threaded_run
from rig.run.own_handle import OwnHandle
from rig.run.parts import Progress, RunReport, SessionParts
from rig.run.preflight import refuse_failed, static_checks
from rig.run.realtime import block_cycles, execute_in_real_time, watchdog_deadline
from rig.run.session import execute
from rig.run.stop import StopRequest
from rig.run.watchdog import Watchdog
from rig.run.world import refuse_world, start_state

_FRAMES_OF = ("TRIPPED", "ERROR")
"""Outcomes of runs whose last frames are kept beside them."""


def plan_order(order: Order, experiment: Experiment | None = None) -> PlannedRun:
    """The planned run of an order: of its protocol, or of an experiment that stands in no catalogue.

    Raises `PlanError`, `LimitError`, `ConfigurationError`; nothing is opened.
    """
    experiment = experiment or catalogue.load(order.protocol)
    if order.mounting not in MOUNTINGS:
        raise ConfigurationError(
            "no such mounting",
            where="--mounting",
            value=repr(order.mounting),
            limit=", ".join(MOUNTINGS),
        )
    values = dict(order.values)
    names = {f.name for f in parameter_fields(experiment.parameters)}
    # What the rig already knows is not asked for twice: the protocol's own number is only for planning without a rig.
    for name, value in (("mounting", order.mounting), ("sync_rate", order.sample_rate)):
        if name in names:
            values.setdefault(name, value)
    values = with_contents(experiment.parameters, values, order.protocol)
    parameters = make_parameters(experiment.parameters, values, order.protocol)
    if experiment.refuse_gear is not None:
        experiment.refuse_gear(parameters, order.serial)
    refuse_world(order.backend, order.world)
    gear, motor = nameplates(order)
    return plan_run(
        experiment,
        parameters,
        gear,
        motor,
        order.mounting,
        sample_rate=order.sample_rate,
        configured=order.limits,
    )


def bench_for(order: Order) -> Bench:
    """The bench that an order is for. Raises `ConfigurationError` for hardware without identity or state folder."""
    chosen = order.world.bench_seed
    seed = order.seed if chosen is None else chosen
    return bench_of(order.backend, order.folder, order.config, seed)


def rig_for(order: Order, planned: PlannedRun) -> AssembledRig:
    """The rig that an order names, put together but not opened."""
    setup = Setup(
        gear_mounted=planned.experiment.gear_mounted,
        parameters=vars_of(planned.parameters),
        disc_inertia=getattr(planned.parameters, "disc_inertia", 0.0),
    )
    return make_port(order, setup)


@contextmanager
def _in_its_world(
    order: Order, planned: PlannedRun
) -> Generator[tuple[Order, RunPlace | None], None, None]:
    """An order whose simulated world is said to the end, and the number in its folder if it owns one already.

    The number owns the noise, so it is taken before the rig is put together, and given back if
    nothing was recorded. Raises `RigError`; nothing is opened.
    """
    choice, place = order.world, None
    if not is_simulated(order.backend):
        yield order, None
        return
    refuse_failed(static_checks(planned, order.folder))
    # A gear that was not chosen by seed follows from its serial number, which the names of its runs bear.
    serial = order.serial if choice.gear_seed is None else None
    start = choice.start or start_state(
        order.folder, choice.start_state, world_record(order), serial
    )
    if choice.number is None:
        place = claim_run(order.folder, planned.experiment.name, order.serial)
        choice = replace(choice, number=place.number)
    try:
        yield replace(order, world=replace(choice, start=start)), place
    finally:
        if place is not None:
            place.give_back()


def run_order(
    order: Order,
    planned: PlannedRun | None = None,
    *,
    confirmation: str = "",
    uncommissioned: str = "",
    stop: StopRequest | None = None,
    ask: Ask = lambda prompt: "",
    on_progress: Callable[[Progress], None] | None = None,
    on_event: Callable[[Event], None] | None = None,
) -> RunReport:
    """Plan (unless `planned` is given), open the rig, run, make safe, seal. Raises only before
    anything moves.

    `confirmation`: what the operator typed to arm this run on hardware; `uncommissioned`: and to run it further than
    its commissioning allows (`rig.run.commissioned.SENTENCE`).
    """
    refuse_sentence(uncommissioned)
    planned = planned or plan_order(order)
    if order.backend == HARDWARE:
        refuse_unarmed(arming_of(order, planned, confirmation))
    bench = bench_for(order)
    with bench_lock(bench, f"rig run {order.protocol}"):
        # Before anything is connected: a rig that tripped is left alone until somebody has looked.
        latch_of(bench).refuse()
        with _in_its_world(order, planned) as (settled, place):
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
                uncommissioned=uncommissioned,
            )


def run_on(
    rig: AssembledRig,
    order: Order,
    planned: PlannedRun,
    stop: StopRequest | None = None,
    ask: Ask = lambda prompt: "",
    bench: Bench | None = None,
    place: RunPlace | None = None,
    on_progress: Callable[[Progress], None] | None = None,
    on_event: Callable[[Event], None] | None = None,
    uncommissioned: str | None = "",
) -> RunReport:
    """Run what was planned on a rig that is put together and not opened. Whether it may is the caller's business.

    `bench`: where a trip is latched and the run marked, if that is not the order's own. `place`: a
    number of its folder that was taken for it. `uncommissioned`: what was typed to go further than the commissioning of
    a rig of hardware allows; None: this is a stage of it, and asks for none.
    """
    bench = bench or bench_for(order)
    # Asked now: between opening a rig and its first turns a drive counts the ms without a heartbeat.
    this_program()
    marker = RunMarker(bench.state, bench.id)
    cycles = order.block_cycles
    if rig.real_time:
        cycles = block_cycles(order.sample_rate, cycles, rig.reaction)
    handle = handle_of(rig)
    commissioned = _commissioning(rig, order, planned, bench, uncommissioned)
    parts = SessionParts(
        order=order,
        planned=planned,
        rig=rig,
        cycles=cycles,
        place=place,
        free_space=lambda: shutil.disk_usage(order.folder).free,
        bench=bench.id,
        latch=latch_of(bench),
        marker=marker,
        watchdog=watchdog_of(rig, handle, cycles),
        arm=(lambda: (*commissioned(), *arm(rig, handle))) if rig.real_time else None,
        files=files_used(order.config),
    )
    hears = {"ask": ask, "on_progress": on_progress, "on_event": on_event}
    try:
        report = _run_beside(parts, stop or StopRequest(), hears)
    finally:
        marker.let_go()
    if report.outcome in _FRAMES_OF or uncommissioned is None:
        keep_frames(rig, report)
    return report


def _commissioning(
    rig: AssembledRig,
    order: Order,
    planned: PlannedRun,
    bench: Bench,
    uncommissioned: str | None,
) -> Callable[[], tuple[Finding, ...]]:
    """The check that a bench of hardware is commissioned for what was planned; of any other rig, and of a stage of the
    commissioning itself, there is none.
    """
    if order.backend != HARDWARE or uncommissioned is None:
        return lambda: ()
    standing = standing_of(bench, order)
    return lambda: (commissioned_check(rig, order, standing, planned, uncommissioned),)


def _run_beside(parts: SessionParts, stop: StopRequest, hears: dict[str, Any]) -> RunReport:
    """The run, in its own time, with a process that stands by where the order wants one."""
    run, begin = execute, begin_inline_run
    if parts.rig.real_time:
        run, begin = execute_in_real_time, begin_threaded_run
    with standing_by(parts.order, stop.problem) as bystander:
        if bystander is not None:
            hears = bystander.hears(**hears)
        report = run(parts, begin, stop=stop, **hears)
        if bystander is not None:
            bystander.reported(report)
    return report


def arming_of(order: Order, planned: PlannedRun, confirmation: str = "") -> Arming:
    """Who arms a run, with what was typed, and what its rig wants to be confirmed."""
    return Arming(
        order.operator,
        order.serial,
        confirmation,
        planned.experiment.gear_mounted,
        limits_by_hand(order.config),
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
