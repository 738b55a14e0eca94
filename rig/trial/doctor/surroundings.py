"""What stands around the rig: the bench and its state folder, disk, calendar, certificates, the guard,
the drive's limits, the readout.
"""

from __future__ import annotations

import math
import os
import shutil
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, date, datetime, timedelta
from pathlib import Path
from typing import Any

from drivers.channel import (
    HOUSING_TEMPERATURE,
    INPUT_ANGLE,
    OUTPUT_ANGLE,
    TORQUE,
    Calibration,
    Channel,
)
from drivers.clock import Clock
from drivers.errors import DriverError
from drivers.port import RigPort
from drivers.readout.nd287 import Readout, ReadoutConfig, open_port
from experiments.assumed import (
    BEARING,
    ENCODERS,
    OUTPUT_INERTIA,
    TEMPERATURE,
    THERMOMETER,
    TORQUE_SCALE,
    Assumed,
)
from experiments.finding import Finding, Severity, passed_if
from experiments.load import UNSTATED
from model.gear import HarmonicDrive
from rig.analysis.alarm.laboratory import watching_in_force
from rig.analysis.passport.gather import moment
from rig.bench.backends.order import Order
from rig.bench.limits import Limits
from rig.bench.state import VARIABLE, Scope
from rig.content.phrase import phrase, quoted
from rig.errors import ConfigurationError, LimitError
from rig.library.index import LibraryIndex
from rig.run.latch import latch_of
from rig.run.preflight import drive_limits_check
from rig.run.start import bench_for
from rig.trial.doctor.standing import gravity

ENOUGH_SPACE, LEAST_SPACE = 1_000_000_000, 100_000_000
"""Bytes that an hour at 1 kHz and a margin take; bytes below which no run should be begun."""
_SOON = timedelta(days=30)
"""Time before its due date from which on a calibration is reminded of."""
_PLAUSIBLE_YEARS = (2024, 2100)
CALIBRATED = (INPUT_ANGLE, OUTPUT_ANGLE, TORQUE)
"""Channels whose certificate matters to results."""


_SCOPES: dict[Scope, str] = {
    "site": "for everybody at this computer",
    "user": "of this user only: the site's cannot be written",
    "hub": "of this user, as of every hub",
    "named": f"named by {VARIABLE}",
    "runs": "that of the runs, as of every simulated rig",
}


def bench_lines(order: Order) -> Iterable[Finding]:
    """Which bench this is, the folder in which a trip of it would be latched, and what is latched there."""
    try:
        bench = bench_for(order)
    except ConfigurationError as error:
        yield Finding(
            "identity and state folder",
            Severity.BLOCKS,
            f"{error.what} ({error.value})",
            error.remedy,
            where="bench",
        )
        return
    text = bench.id if bench.scope != "runs" else f"seed {bench.id} of a simulated rig"
    yield Finding("identity", Severity.PASSED, text, where="bench")
    yield passed_if(
        "state folder",
        bench.scope != "user",
        f"{bench.state}, {'' if bench.scope == 'runs' else 'writable, '}{_SCOPES[bench.scope]}",
        "Another user would not meet its latch: make the site's writable for all who run it"
        f" ({', '.join(str(place) for place in bench.elsewhere[:1])}).",
        where="bench",
        otherwise=Severity.WARNS,
    )
    trip = latch_of(bench).read()
    if trip is not None:
        yield Finding(
            "latch",
            Severity.BLOCKS,
            f"{trip.cause.replace('_', ' ')} in run {trip.run}, {trip.time}: {trip.message}",
            f"Find and remove the cause, then: rig acknowledge --operator NAME {bench.option}",
            where="bench",
        )


def disk(folder: Path) -> Finding:
    """Free space where the runs go."""
    place = folder
    while not place.exists() and place != place.parent:
        place = place.parent
    if not place.is_dir() or not os.access(place, os.W_OK):
        what = f"{place} is no folder that can be written"
        return Finding(
            "disk", Severity.BLOCKS, what, "Name another folder with --runs.", where="computer"
        )
    try:
        free = shutil.disk_usage(place).free
    except OSError as error:
        return Finding(
            "disk",
            Severity.BLOCKS,
            f"{place}: {error.strerror or error}",
            "Name another folder.",
            where="computer",
        )
    return passed_if(
        "disk",
        free >= ENOUGH_SPACE,
        f"{free / 1e9:.1f} GB free for {folder}",
        "Free space: a run stops when the disk is full.",
        where="computer",
        allowed=f">= {ENOUGH_SPACE / 1e9:g} GB",
        value=free / 1e9,
        unit="GB",
        otherwise=gravity(free >= LEAST_SPACE),
    )


def calendar(clock: Clock) -> Finding:
    """Whether the computer's calendar can be the right one."""
    now = datetime.fromtimestamp(clock.calendar_ns() * 1e-9, UTC)
    low, high = _PLAUSIBLE_YEARS
    return passed_if(
        "calendar",
        low <= now.year < high,
        f"{now.isoformat(timespec='seconds')}",
        "Set the clock: start times and due dates rest on it.",
        where="computer",
    )


def golden_gear(order: Order, clock: Clock) -> Iterable[Finding]:
    """Whether the gear that is kept to be measured again is due; nothing where nobody wants to be reminded."""
    watching = watching_in_force(order.config)
    if not watching.golden_gear or not watching.golden_days:
        return
    runs = LibraryIndex(order.folder).search(gear=watching.golden_gear)
    starts = [moment(run.start) for run in runs if run.is_complete]
    now = datetime.fromtimestamp(clock.calendar_ns() * 1e-9, UTC)
    age, found = math.inf, "never measured here"
    if starts:
        age = (now - max(starts)).total_seconds() / 86400.0
        found = f"{age:.0f} days ago"
    yield passed_if(
        f"golden gear {watching.golden_gear}",
        age <= watching.golden_days,
        found,
        f"Measure it: rig run friction --gear {quoted(watching.golden_gear)}, then rig bench check.",
        where="bench",
        allowed=f"every {watching.golden_days:g} days",
        otherwise=Severity.WARNS,
    )


def calibrations(channels: Sequence[Channel], today: date) -> Iterable[Finding]:
    """Certificate, date and due date of every channel whose scale matters."""
    for channel in channels:
        if channel.name not in CALIBRATED:
            continue
        certificate, title = channel.calibration, channel.name.replace("_", " ")
        text = ", ".join(
            part
            for part in (
                certificate.certificate or "no certificate",
                phrase("of {}", certificate.date),
                phrase("due {}", certificate.due) or "no due date",
            )
            if part
        )
        due = _date(certificate.due)
        if due is not None and due < today:
            yield Finding(
                title,
                Severity.BLOCKS,
                f"{text}: overdue",
                "Have it calibrated; reports will say so.",
                where="calibration",
            )
        elif due is not None and due - today <= _SOON:
            text += f": in {(due - today).days} days"
            yield Finding(title, Severity.WARNS, text, "Plan its calibration.", where="calibration")
        else:
            yield passed_if(
                title,
                bool(certificate.certificate) and (due is not None or not certificate.due),
                text,
                "Results rest on a tolerance that nobody has checked.",
                where="calibration",
                otherwise=Severity.WARNS,
            )


def assumptions(channels: Sequence[Channel]) -> Iterable[Finding]:
    """What nobody states of the instruments, and what a result then rests on: one line a kind."""
    by_name = {channel.name: channel for channel in channels}
    unsaid = [
        row
        for name, row in ENCODERS.items()
        if name in by_name and not _says_class(by_name[name].calibration)
    ]
    for name, row, key in (
        (TORQUE, TORQUE_SCALE, "scale_relative_uncertainty"),
        (HOUSING_TEMPERATURE, THERMOMETER, "offset_uncertainty"),
    ):
        if name in by_name and getattr(by_name[name].calibration, key) is None:
            unsaid.append(row)
    if HOUSING_TEMPERATURE not in by_name:
        unsaid.append(TEMPERATURE)
    return [_not_stated(row) for row in unsaid]


def output_assumptions(gear: HarmonicDrive, output_bearing: Mapping[str, Any]) -> Iterable[Finding]:
    """What nobody states of the output of a rig that is no simulation: its bearing, and what it carries."""
    if not output_bearing:
        yield _not_stated(BEARING)
    if gear.value("inertia.output").origin.provenance in UNSTATED:
        yield _not_stated(OUTPUT_INERTIA)


def _not_stated(row: Assumed) -> Finding:
    return Finding(
        f"{row.kind}, not stated",
        Severity.WARNS,
        f"assumed: {row.bounds}",
        f"Give it: {row.replaced_by}.",
        where="calibration",
    )


def _says_class(calibration: Calibration) -> bool:
    return calibration.accuracy is not None or calibration.curve is not None


def _date(text: str) -> date | None:
    """A date as YYYY-MM-DD; None where there is none that can be read."""
    try:
        return date.fromisoformat(text[:10])
    except ValueError:
        return None


def armed(check: Finding) -> Finding:
    """A finding as arming makes it, among the lines of the checklist."""
    return replace(check, where="safety")


def drive_limits(port: RigPort, limits: Limits) -> Finding:
    """Write the limits that a run would write, and compare what reads back."""
    try:
        return armed(drive_limits_check(port, limits))
    except (LimitError, DriverError) as error:
        remedy = "A drive that holds other limits is not armed."
        return Finding("drive limits", Severity.BLOCKS, str(error), remedy, where="safety")


def readout(config: ReadoutConfig | None, clock: Clock) -> Finding:
    """One measured value of the readout on the serial line, where one is configured."""
    if config is None:
        return Finding("ND 287", Severity.NOT_LOOKED_AT, "none is configured", where="readout")
    try:
        port = open_port(config)
    except DriverError as error:
        return Finding("ND 287", Severity.BLOCKS, str(error), where="readout")
    try:
        reading = Readout(port, clock, config).read()
    except DriverError as error:
        return Finding(
            "ND 287",
            Severity.BLOCKS,
            str(error),
            "Check baud rate, data bits and parity on both sides.",
            where="readout",
        )
    finally:
        port.close()
    text = f"{reading.value:.6g} {reading.unit}, last place {reading.quantum:.2g} {reading.unit}"
    return passed_if(
        "ND 287",
        not reading.is_fault,
        text,
        "The readout itself says that its value is none: look at its display.",
        where="readout",
        value=reading.value,
        unit=reading.unit,
    )
