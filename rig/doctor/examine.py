"""Looks a rig over: standing first, then in motion where that is allowed; every line with its evidence."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from drivers.cyclic import CanRig
from drivers.errors import DriverError
from drivers.nd287 import ReadoutConfig
from drivers.port import Command, Guard, Mode
from rig.backends import Bench
from rig.doctor import motion
from rig.doctor.bus import inspect_bus
from rig.doctor.finding import Finding
from rig.doctor.standing import Stand, inspect_stand
from rig.doctor.surroundings import calendar, calibrations, disk, drive_limits, guard, readout
from rig.errors import RigError
from rig.run.arming import guard_check
from rig.run.dry_run import PlannedRun, plan_run
from rig.run.order import RunReport
from rig.run.start import RunRequest, run_on
from rig.run.stop import StopRequest
from rig.runfile.read import close_recording, open_run

STANDING_TIME = 1.5
"""s of cycles that are looked at with the servo off."""
BLOCK_TIME = 0.02
"""s of cycles per exchange: how finely heartbeats are timed."""


@dataclass(frozen=True)
class Examination:
    """The whole checklist of one rig. `is_fine`: nothing on it failed."""

    backend: str
    findings: tuple[Finding, ...]

    @property
    def is_fine(self) -> bool:
        """Whether nothing failed; warnings and what was skipped are the reader's to judge."""
        return all(finding.result != "failed" for finding in self.findings)

    def as_json(self) -> dict[str, Any]:
        """The object that `rig doctor --json` prints."""
        return {"backend": self.backend, "ok": self.is_fine, "checks": [finding.as_json() for finding in self.findings]}


def examine(
    make: Callable[[], Bench],
    request: RunRequest,
    *,
    moves: bool,
    why_not: str = "",
    readout_config: ReadoutConfig | None = None,
    on_stage: Callable[[str], None] = lambda stage: None,
    stop: StopRequest | None = None,
) -> Examination:
    """Look a rig over. `make` puts it together anew for each stage; `why_not` tells why nothing may move.

    Whatever goes wrong on the way becomes a line that failed; the rig is left with the servo off. Raises only what `make`
    raises: a configuration that cannot be used.
    """
    planned = plan_of(request)
    on_stage("standing")
    findings = [disk(request.output), *examine_standing(make(), planned, readout_config)]
    refused = any(finding.result == "failed" and finding.group != "calibration" for finding in findings)
    if moves and not refused:
        on_stage("motion")
        findings += examine_motion(make(), request, planned, stop)
    else:
        reason = why_not if not moves else "not before the lines that failed are in order"
        findings.append(Finding("motion", "direction and ratio", "skipped", reason))
    return Examination(request.backend, tuple(findings))


def plan_of(request: RunRequest) -> PlannedRun:
    """The planned motion with its limits."""
    return plan_run(
        motion.EXPERIMENT, motion.DoctorParameters(), request.gear, request.motor, request.mounting,
        sample_rate=request.sample_rate, configured=request.limits,
    )  # fmt: skip


def examine_standing(bench: Bench, planned: PlannedRun, readout_config: ReadoutConfig | None) -> list[Finding]:
    """Everything that can be seen with the servo off."""
    port, found = bench.port, []
    today = datetime.fromtimestamp(bench.clock.calendar_ns() * 1e-9, UTC).date()
    try:
        description = port.open()
        found.append(Finding("rig", "connection", "ok", f"{description.title} ({description.origin})"))
        found.append(drive_limits(port, planned.limits.drive_limits()))
        stand, heard = _stand(bench, planned)
        if isinstance(port, CanRig):
            found += inspect_bus(port, heard)
        else:
            found.append(Finding("nodes", "bus", "skipped", f"the rig '{bench.name}' has no bus"))
        found += inspect_stand(stand)
        found += calibrations(port.channels, today)
        if bench.real_time:
            found.append(guard(guard_check(bench.guard)))
    except (DriverError, RigError) as error:
        found.append(Finding("rig", "connection", "failed", str(error), remedy="Supply, cables, node-IDs, bit rate."))
    finally:
        port.close()
    return [*found, calendar(bench.clock), readout(readout_config, bench.clock)]


def _stand(bench: Bench, planned: PlannedRun) -> tuple[Stand, dict[int, list[int]]]:
    """Cycles with the servo off, and when each node's heartbeat was heard."""
    port = bench.port
    cycles = max(1, round(BLOCK_TIME * 1e9 / port.cycle_ns))
    left = round(STANDING_TIME * 1e9 / port.cycle_ns)
    blocks, heard = [], {}
    while left > 0:
        block = port.exchange(Command(Mode.OFF), min(cycles, left), Guard())
        if not len(block):
            raise RigError("no cycle came back", where="standing", remedy="Check the bus and the SYNC.")
        blocks.append(block)
        left -= len(block)
        if isinstance(port, CanRig):
            _note_beats(port, heard)
    stand = Stand(
        tuple(port.channels), np.concatenate([b.counts for b in blocks]), np.concatenate([b.flags for b in blocks]),
        np.concatenate([b.time_ns for b in blocks]), port.cycle_ns, port.time_base, planned.motor.rated_torque,
    )  # fmt: skip
    return stand, heard


def _note_beats(port: CanRig, heard: dict[int, list[int]]) -> None:
    for device in port.nodes.devices:
        beats = heard.setdefault(device.node_id, [])
        latest = device.watch.heard_ns
        if latest and (not beats or beats[-1] != latest):
            beats.append(latest)


def examine_motion(bench: Bench, request: RunRequest, planned: PlannedRun, stop: StopRequest | None) -> Iterable[Finding]:
    """Creep, turn, whole turn of the output; recorded into a folder that is thrown away."""
    with tempfile.TemporaryDirectory(prefix="harmonic-rig-doctor-") as folder:
        try:
            report = run_on(bench, replace(request, output=Path(folder)), planned, stop)
        except (DriverError, RigError) as error:
            return [Finding("motion", "run", "failed", str(error))]
        return [_ending(report), *_inspected(report, planned)]


def _ending(report: RunReport) -> Finding:
    safe = report.make_safe
    stands = "STANDSTILL NOT VERIFIED"
    if safe is not None and safe.safe:
        stands = "standstill verified by " + ", ".join(safe.verified_by)
    text = f"{report.outcome}, {stands}" + (f": {report.message}" if report.message else "")
    fine = report.outcome == "PASS" and report.safe
    remedy = "" if fine else "Find the cause before anything else is run."
    return Finding("motion", "run", "ok" if fine else "failed", text, remedy=remedy)


def _inspected(report: RunReport, planned: PlannedRun) -> Iterable[Finding]:
    if not report.readable:
        return [Finding("motion", "recording", "failed", "the recorded motion cannot be read")]
    recording = open_run(report.path)
    try:
        return list(motion.inspect_motion(recording, planned.gear))
    finally:
        close_recording(recording)
