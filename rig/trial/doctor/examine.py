"""Looks a rig over: standing first, then in motion where that is allowed; every line with its evidence."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from drivers.bus.network import PumpedBus
from drivers.bus.rig_nodes import RigNodes
from drivers.errors import DriverError
from drivers.port import Command, Guard, Mode
from drivers.readout.nd287 import ReadoutConfig
from experiments.errors import ExperimentError
from experiments.finding import Finding, Severity, first_blocking, passed_if
from rig.bench.backends.assembly import AssembledRig
from rig.bench.backends.hardware import readout_config
from rig.bench.backends.order import Order
from rig.bench.backends.registry import HARDWARE
from rig.bench.config.load import load_configuration
from rig.content.phrase import phrase
from rig.errors import RigError
from rig.run.arming import guard_check, handle_check, loss_check
from rig.run.commissioned import Standing, commissioned_check, standing_of
from rig.run.dry_run import PlannedRun
from rig.run.parts import RunReport
from rig.run.start import bench_for, handle_of, plan_order, run_on
from rig.run.stop import StopRequest
from rig.runfile.read import close_recording, open_run
from rig.trial.doctor import motion
from rig.trial.doctor.abilities import inspect_abilities
from rig.trial.doctor.bus import heartbeat_period_ns, inspect_bus, inspect_events, scan
from rig.trial.doctor.standing import Stand, inspect_stand
from rig.trial.doctor.surroundings import (
    armed,
    assumptions,
    bench_lines,
    calendar,
    calibrations,
    disk,
    drive_limits,
    golden_gear,
    output_assumptions,
    readout,
)

STANDING_TIME, LONGEST_STAND = 1.5, 10.0
"""s of cycles that are looked at with the servo off; more where heartbeats are slow, so many at most."""
_HEARTBEATS = 4
"""Periods of the slowest heartbeat that are waited for."""
_BLOCK_TIME = 0.02
"""s of cycles per exchange: how finely heartbeats are timed."""
_RESULTS = {
    Severity.PASSED: "ok",
    Severity.NOTES: "ok",
    Severity.WARNS: "warning",
    Severity.BLOCKS: "failed",
    Severity.NOT_LOOKED_AT: "skipped",
}
"""The words of `--json` for how a line came out."""
_HARMLESS = frozenset({"calibration", "readout"})
"""Groups whose failed lines do not make motion unsafe."""


@dataclass(frozen=True)
class Examination:
    """The whole checklist of one rig; `was_stopped`: the operator ended it before it was complete."""

    backend: str
    findings: tuple[Finding, ...]
    was_stopped: bool = False

    @property
    def is_fine(self) -> bool:
        """Whether it is complete and nothing failed; warnings and what was skipped are the reader's to judge."""
        return not self.was_stopped and first_blocking(self.findings) is None

    def as_json(self) -> dict[str, Any]:
        """The object that `rig doctor --json` prints."""
        return {
            "backend": self.backend,
            "ok": self.is_fine,
            "checks": [_as_json(finding) for finding in self.findings],
        }


def _as_json(finding: Finding) -> dict[str, Any]:
    """A line of the checklist: the form of every finding, and the keys of 0.2.0 beside it."""
    return finding.as_json() | {
        "group": finding.where,
        "name": finding.what,
        "result": _RESULTS[finding.severity],
        "evidence": finding.found,
        "limit": finding.allowed,
    }


def examine(
    make: Callable[[], AssembledRig],
    order: Order,
    *,
    moves: bool,
    why_not: str = "",
    serial_line: ReadoutConfig | None = None,
    on_stage: Callable[[str], None] = lambda stage: None,
    stop: StopRequest | None = None,
) -> Examination:
    """Look a rig over. `make` puts it together anew for each stage; `why_not` tells why nothing may move.

    Whatever goes wrong on the way becomes a line that failed; the rig is left with the servo off.
    Raises only what `make` and the plan raise: a configuration that cannot be used.
    """
    planned, stop = plan_order(order, motion.EXPERIMENT), stop or StopRequest()
    on_stage("standing")
    rig = make()
    findings = [*bench_lines(order), disk(order.folder), calendar(rig.clock)]
    findings += golden_gear(order, rig.clock)
    findings += examine_standing(rig, planned, order)
    if order.backend == HARDWARE:
        findings += output_assumptions(planned.gear, order.output_bearing)
    findings.append(readout(serial_line, rig.clock))
    refused = any(
        finding.severity is Severity.BLOCKS and finding.where not in _HARMLESS
        for finding in findings
    )
    if stop.level or refused or not moves:
        reason = why_not if not moves else "not before the lines that failed are in order"
        reason = "stopped by the operator" if stop.level else reason
        findings.append(
            Finding("direction and ratio", Severity.NOT_LOOKED_AT, reason, where="motion")
        )
    else:
        on_stage("motion")
        findings += _examine_motion(make(), order, planned, stop)
    return Examination(order.backend, tuple(findings), stop.level > 0)


def readout_of(order: Order) -> ReadoutConfig | None:
    """The serial line of the readout that the order's configuration describes, where it describes one."""
    if order.config is None:
        return None
    return readout_config(load_configuration(order.config))


# --- standing


@dataclass
class Looked:
    """What the parts of the checklist look at: the open rig, what is planned, and the cycles with the servo off."""

    rig: AssembledRig
    planned: PlannedRun
    order: Order
    standing: Standing | None = None
    stand: Stand | None = None
    heard: Mapping[int, Sequence[int]] = field(default_factory=dict)


@dataclass(frozen=True)
class Part:
    """One part of the checklist; what it raises becomes a line of its own under `group` and `name`."""

    group: str
    name: str
    inspect: Callable[[Looked], Iterable[Finding]]


def _take_stand(looked: Looked) -> Iterable[Finding]:
    """Cycles with the servo off, and when each node's heartbeat was heard."""
    port, heard, blocks = looked.rig.port, {}, []
    cycles = max(1, round(_BLOCK_TIME * 1e9 / port.cycle_ns))
    left = round(_standing_time(looked) * 1e9 / port.cycle_ns)
    looked.heard = heard
    while left > 0:
        block = port.exchange(Command(Mode.OFF), min(cycles, left), Guard())
        if not len(block):
            raise RigError(
                "no cycle came back", where="standing", remedy="Check the bus and the SYNC."
            )
        blocks.append(block)
        left -= len(block)
        if looked.rig.nodes is not None:
            _note_beats(looked.rig.nodes(), heard)
    looked.stand = Stand(
        channels=tuple(port.channels),
        counts=np.concatenate([b.counts for b in blocks]),
        flags=np.concatenate([b.flags for b in blocks]),
        time_ns=np.concatenate([b.time_ns for b in blocks]),
        cycle_ns=port.cycle_ns,
        time_base=port.time_base,
        rated_torque=looked.planned.motor.rated_torque,
    )
    return ()


def _standing_time(looked: Looked) -> float:
    if looked.rig.nodes is None:
        return STANDING_TIME
    devices = looked.rig.nodes().devices
    slowest = max((heartbeat_period_ns(device.watch) for device in devices), default=0)
    return min(max(STANDING_TIME, _HEARTBEATS * slowest * 1e-9), LONGEST_STAND)


def _note_beats(nodes: RigNodes, heard: dict[int, list[int]]) -> None:
    for device in nodes.devices:
        beats = heard.setdefault(device.node_id, [])
        latest = device.watch.heard_ns
        if latest and (not beats or beats[-1] != latest):
            beats.append(latest)


def _limits(looked: Looked) -> Iterable[Finding]:
    return (drive_limits(looked.rig.port, looked.planned.limits),)


def _guard(looked: Looked) -> Iterable[Finding]:
    rig = looked.rig
    if rig.real_time or rig.guard is not None:
        unwatched, handle = rig.port.abilities.unwatched, handle_of(rig)
        found = [armed(guard_check(rig.guard)), armed(loss_check(unwatched, rig.loss_covered_by))]
        if handle is not None:
            check = handle_check(handle.open, handle.known, unwatched, rig.loss_covered_by)
            handle.close()
            found.append(armed(check))
        return found
    return (
        Finding(
            "guard",
            Severity.NOT_LOOKED_AT,
            f"the rig '{looked.rig.name}' has no guard",
            where="safety",
        ),
    )


def _nodes(looked: Looked) -> Iterable[Finding]:
    if looked.rig.nodes is not None:
        return inspect_bus(looked.rig.nodes(), looked.heard)
    return (
        Finding(
            "bus", Severity.NOT_LOOKED_AT, f"the rig '{looked.rig.name}' has no bus", where="nodes"
        ),
    )


def _channels(looked: Looked) -> Iterable[Finding]:
    return () if looked.stand is None else inspect_stand(looked.stand)


def _calibrations(looked: Looked) -> Iterable[Finding]:
    today = datetime.fromtimestamp(looked.rig.clock.calendar_ns() * 1e-9, UTC).date()
    channels = looked.rig.port.channels
    return (*calibrations(channels, today), *assumptions(channels))


def _events(looked: Looked) -> Iterable[Finding]:
    told = looked.rig.port.abilities.events
    return () if told is None else inspect_events(told())


def _abilities(looked: Looked) -> Iterable[Finding]:
    return inspect_abilities(looked.rig.port)


def _commissioned(looked: Looked) -> Iterable[Finding]:
    if looked.standing is None:
        return ()
    found = commissioned_check(looked.rig, looked.order, looked.standing)
    return (replace(found, where="bench"),)


PARTS: tuple[Part, ...] = (
    Part("bench", "commissioning", _commissioned),
    Part("abilities", "abilities", _abilities),
    Part("safety", "drive limits", _limits),
    Part("safety", "guard", _guard),
    Part("acquisition", "cycles", _take_stand),
    Part("nodes", "bus", _nodes),
    Part("acquisition", "channels", _channels),
    Part("calibration", "certificates", _calibrations),
    Part("told by the devices", "events", _events),
)
"""What is looked at while the rig stands open, in this order."""


def examine_standing(rig: AssembledRig, planned: PlannedRun, order: Order) -> list[Finding]:
    """Everything that can be seen with the servo off."""
    port, looked = rig.port, Looked(rig, planned, order)
    findings: list[Finding] = []
    if order.backend == HARDWARE:
        try:
            looked.standing = standing_of(bench_for(order), order)
        except RigError as error:
            findings.append(Finding("commissioning", Severity.BLOCKS, str(error), where="bench"))
    try:
        description = port.open()
        findings.append(
            Finding(
                "connection",
                Severity.PASSED,
                f"{description.title} ({description.origin})",
                where="rig",
            )
        )
        for part in PARTS:
            try:
                # One by one: what was found before an error stays.
                for finding in part.inspect(looked):
                    findings.append(finding)
            except (DriverError, RigError) as error:
                findings.append(
                    Finding(
                        part.name,
                        Severity.BLOCKS,
                        str(error),
                        "Supply, cables, termination.",
                        where=part.group,
                    )
                )
    except (DriverError, RigError) as error:
        findings.append(
            Finding(
                "connection",
                Severity.BLOCKS,
                str(error),
                "Supply, cables, node-IDs, bit rate.",
                where="rig",
            )
        )
        findings += [*_answering(rig), *_events(looked)]
    finally:
        port.close()
    return findings


def _answering(rig: AssembledRig) -> Iterable[Finding]:
    """Who is on the bus all the same, where the rig cannot be opened and the bus can."""
    if rig.second_bus is None:
        return
    try:
        bus = PumpedBus(rig.second_bus(), rig.clock)
        try:
            nodes = scan(bus)
        finally:
            bus.close()
    except DriverError as error:
        yield Finding("scan", Severity.BLOCKS, str(error), where="nodes")
        return
    answers = ", ".join(
        f"node {node_id} (profile {profile or 'not told'})" for node_id, profile in nodes.items()
    )
    yield passed_if(
        "scan",
        bool(nodes),
        answers or "nobody answers",
        where="nodes",
        value=float(len(nodes)),
    )


# --- in motion


def _examine_motion(
    rig: AssembledRig, order: Order, planned: PlannedRun, stop: StopRequest
) -> list[Finding]:
    """Creep, turn, whole turn of the output; recorded into a folder that is thrown away. A trip is
    latched where that of any run is, at once: a doctor that is killed afterwards leaves it behind.
    """
    with tempfile.TemporaryDirectory(prefix="harmonic-rig-doctor-") as folder:
        try:
            thrown_away = replace(order, folder=Path(folder))
            report = run_on(rig, thrown_away, planned, stop, bench=bench_for(order))
            findings = [ending_of(report), *_inspected(report, planned)]
        except (DriverError, RigError, ExperimentError) as error:
            return [Finding("run", Severity.BLOCKS, str(error), where="motion")]
    return findings


def ending_of(report: RunReport) -> Finding:
    safe = report.make_safe
    stands = "STANDSTILL NOT VERIFIED"
    if safe is not None and safe.safe:
        stands = "standstill verified by " + ", ".join(safe.verified_by)
    text = f"{report.outcome}, {stands}{phrase(': {}', report.message)}"
    if report.outcome == "ABORTED" and report.safe:
        return Finding(
            "run",
            Severity.WARNS,
            text,
            "Stopped by the operator: look the rig over again.",
            where="motion",
        )
    return passed_if(
        "run",
        report.outcome == "COMPLETED" and report.safe,
        text,
        "Find the cause before anything else is run; a trip is taken away by name: rig acknowledge.",
        where="motion",
    )


def _inspected(report: RunReport, planned: PlannedRun) -> Iterable[Finding]:
    if not report.readable:
        return [
            Finding(
                "recording", Severity.BLOCKS, "the recorded motion cannot be read", where="motion"
            )
        ]
    recording = open_run(report.path)
    try:
        return list(motion.inspect_motion(recording, planned.gear))
    finally:
        close_recording(recording)
