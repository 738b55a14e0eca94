"""Preflight: what is checked before anything moves, each check with its evidence.

The static checks need no rig (space, folder, calibrations, where the ratings come from); the
standing ones look at a few hundred cycles with the servo off. A check that fails refuses the run; a
warning is kept in it as an event.
"""

from __future__ import annotations

import math
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import asdict
from datetime import date
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.channel import (
    DRIVE_TORQUE,
    INPUT_ANGLE,
    OUTPUT_ANGLE,
    STATUSWORD,
    TARGET_SPEED,
    TARGET_TORQUE,
    TORQUE,
    Channel,
)
from drivers.drive_state import POWERED_STATES, DriveState, drive_state
from drivers.port import DriveLimits, RigPort
from drivers.samples import CycleFlag
from experiments.finding import Finding, Severity, passed_if
from experiments.steps.kind import Motion, Servo
from experiments.steps.vocabulary import Step
from model.units import RPM
from rig.bench.limits import Limits
from rig.errors import LimitError, RigError
from rig.run.dry_run import PlannedRun
from rig.runfile.seal import is_guarded

_VERIFIED_PROVENANCES = ("catalogue", "measured", "identified", "published")
"""Ratings of any other provenance are worth a warning."""

STANDING_TIME = 0.2
"""s with the servo off before anything moves."""
STANDING_COUNTS = 3
"""Counts that an encoder at standstill may flicker by (one on each side of an edge, and one for luck)."""
LARGEST_ZERO = 0.1
"""Share of the rated torque that the torque port may show with the servo off."""
MISSED_SHARE = 0.05
_READBACK_TOLERANCE = 0.02
"""Drives hold their limits in coarse units (0.1 % of rated torque, whole r/min)."""


_HELD_OTHERWISE = {
    "torque": "Name the object by which it limits torque: `torque_limit` and `torque_limit_unit_n_m` in [drive].",
    "deceleration": "A drive with one ramp for both holds it if `acceleration_rad_s2` and `deceleration_rad_s2` in "
    "[limits] are the same.",
}
"""What to do where a drive lacks the usual object of a limit."""


def static_checks(planned: PlannedRun, output: Path) -> tuple[Finding, ...]:
    """What can be known without the rig: disk space, folder, provenance of the ratings, points for what is fitted."""
    return (*_disk(planned, output), *_guarded(output), *_ratings(planned), *_points(planned))


def folder_problem(output: Path) -> str:
    """Why no file can be written in a folder that is there or is yet to be made; "" where one can.

    One is opened: what the permissions say is not all that a disk, a share or a mount has to say.
    """
    folder = _existing(output)
    if not folder.is_dir():
        return f"{output} is no folder"
    try:
        with tempfile.TemporaryFile(dir=folder):
            return ""
    except OSError as error:
        return f"{folder} cannot be written ({error.strerror or error})"


def _existing(output: Path) -> Path:
    """The folder, or the nearest above it that is there."""
    folder = output.absolute()
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    return folder


def _disk(planned: PlannedRun, output: Path) -> tuple[Finding, ...]:
    folder, problem = _existing(output), folder_problem(output)
    if problem:
        return (Finding("folder", Severity.BLOCKS, problem, "Name another with --runs."),)
    try:
        free = shutil.disk_usage(folder).free
    except OSError as error:
        return (
            Finding(
                "folder",
                Severity.BLOCKS,
                f"{folder}: {error.strerror or error}",
                "Name another with --runs.",
            ),
        )
    needed = planned.file_size() + 50_000_000
    # On a roomy disk a megabyte more or less is not another finding: it would take a signature away.
    left = f"{free / 1e9:.0f} GB" if free > 10e9 else f"{free / 1e6:.0f} MB"
    evidence = (
        f"{left} free, {planned.file_size() / 1e6:.0f} MB expected, {needed / 1e6:.0f} MB asked for"
    )
    if free < needed:
        return (
            Finding(
                "disk space",
                Severity.BLOCKS,
                evidence,
                "Free space, or name another folder with --runs.",
            ),
        )
    worst = planned.space_needed()
    if free < worst:
        return (
            Finding(
                "disk space",
                Severity.WARNS,
                f"{evidence}, {worst / 1e6:.0f} MB if every step takes its longest",
            ),
        )
    return (Finding("disk space", Severity.PASSED, evidence),)


def _guarded(output: Path) -> tuple[Finding, ...]:
    """A warning where another program cannot see that a run is being written, and might take it for a broken one."""
    try:
        if is_guarded(_existing(output)):
            return ()
    except OSError:
        # What cannot be written is told with the disk.
        return ()
    text = "nobody guards the file of a run while it is written: this system or file system has no locks"
    remedy = "Let nobody recover, move or delete files in this folder before a run has ended."
    return (Finding("folder", Severity.WARNS, text, remedy),)


def _points(planned: PlannedRun) -> tuple[Finding, ...]:
    """Whether the plan has the points that the curves of its analysis ask for."""
    remedy = "Ask for more speeds, or for each of them again (up and down, repeats)."
    return tuple(
        Finding("points", Severity.WARNS, text.removesuffix("."), remedy)
        for text in planned.remarks
    )


def _ratings(planned: PlannedRun) -> tuple[Finding, ...]:
    if not planned.experiment.gear_mounted:
        return ()
    doubtful: list[str] = []
    for name in ("repeated_peak_torque", "maximum_input_speed"):
        value = planned.gear.value(f"ratings.{name}")
        if value.origin.provenance not in _VERIFIED_PROVENANCES:
            doubtful.append(f"{name} ({value.origin.provenance})")
    if not doubtful:
        return (Finding("ratings", Severity.PASSED, "limits rest on verified ratings"),)
    return (
        Finding(
            "ratings",
            Severity.WARNS,
            f"limits rest on {', '.join(doubtful)}",
            "Check them against the catalogue or the nameplate before a run on hardware.",
        ),
    )


def channel_checks(
    channels: Sequence[Channel], needs: Sequence[str], today: date
) -> tuple[Finding, ...]:
    """Whether the rig has the channels that the protocol needs, and whether their calibrations are still valid."""
    names = {channel.name for channel in channels}
    missing = [name for name in (*needs, INPUT_ANGLE) if name not in names]
    checks: list[Finding] = []
    if missing:
        checks.append(
            Finding(
                "channels",
                Severity.BLOCKS,
                f"missing: {', '.join(dict.fromkeys(missing))}",
                "Map them in the configuration.",
            )
        )
    else:
        checks.append(Finding("channels", Severity.PASSED, ", ".join(sorted(names))))
    if OUTPUT_ANGLE not in names and not missing:
        text = (
            "no output encoder: torsion, disagreement and standstill of the output are not watched"
        )
        checks.append(Finding("output encoder", Severity.WARNS, text))
    if DRIVE_TORQUE not in names and TORQUE in names:
        text = "the drive does not tell its own: a monitor that is open, frozen or drifting in motion is not noticed"
        checks.append(Finding("torque port", Severity.WARNS, text))
    for channel in channels:
        due = channel.calibration.due
        if due:
            checks.append(_calibration(channel.name, due, today))
    return tuple(checks)


def set_point_checks(channels: Sequence[Channel], plan: Sequence[Step]) -> tuple[Finding, ...]:
    """Whether the rig takes every kind of set-point that the plan commands; what cannot be ended is not begun."""
    names = {channel.name for channel in channels}
    servos = {step.servo for step in plan if isinstance(step, Motion)}
    wanted = {SET_POINTS[servo] for servo in servos & SET_POINTS.keys()}
    missing = sorted(wanted - names)
    if not missing:
        return ()
    text = f"the plan commands what this rig takes no set-points for: {', '.join(missing)}"
    remedy = (
        "Choose another protocol; or see what `rig doctor` says of the drive's modes and units."
    )
    return (Finding("set-points", Severity.BLOCKS, text, remedy),)


def _calibration(name: str, due: str, today: date) -> Finding:
    try:
        overdue = date.fromisoformat(due[:10]) < today
    except ValueError:
        return Finding(
            "calibration",
            Severity.WARNS,
            f"{name}: due date {due!r} cannot be read",
            "Write it as YYYY-MM-DD.",
        )
    if overdue:
        return Finding(
            "calibration",
            Severity.WARNS,
            f"{name} was due on {due}",
            "Have it calibrated; results will say so.",
        )
    return Finding("calibration", Severity.PASSED, f"{name} due on {due}")


def drive_limits_check(port: RigPort, limits: Limits) -> Finding:
    """Write the limits into the drive and compare what reads back; where it takes none, look at what somebody has set
    by hand. Raises `LimitError` where it holds others.
    """
    wanted = limits.drive_limits()
    held = port.write_limits(wanted)
    if port.abilities.reads_limits_back:
        return limits_check(wanted, held)
    return _limits_by_hand_check(limits.of_the_rig.drive_limits(), held)


def _limits_by_hand_check(allowed: DriveLimits, held: DriveLimits) -> Finding:
    """Limits that somebody has set by the maker's tool: torque and speed must be said, and be no wider than what gear
    and motor bear. Ramps are the set-points' own there.
    """
    for name in ("torque", "speed"):
        value, most = getattr(held, name), getattr(allowed, name)
        if not value <= (1.0 + _READBACK_TOLERANCE) * most:
            what, words = f"nobody has said which {name} limit was set in the drive", None
            if math.isfinite(value):
                what = f"the drive's {name} limit, set by hand, is wider than gear and motor bear"
                words = _limit_words(name, value)
            raise LimitError(
                what,
                where="drive limits",
                value=words,
                limit=f"<= {_limit_words(name, most)}",
                remedy="Set it by the maker's tool, then say it in [drive.limits_by_hand].",
            )
    words = ", ".join(_limit_words(name, getattr(held, name)) for name in ("torque", "speed"))
    return Finding(
        "drive limits",
        Severity.WARNS,
        f"set by hand and not read back: {words}; the drive holds no ramps",
        "Look them up in the amplifier when something else was mounted meanwhile.",
    )


def limits_check(wanted: DriveLimits, present: DriveLimits) -> Finding:
    """The drive's limits as they read back; a drive that holds others than were written must not be armed."""
    written, read = asdict(wanted), asdict(present)
    for name, value in written.items():
        if math.isfinite(value) and math.isinf(read[name]):
            raise LimitError(
                f"the drive holds no limit of its {name.replace('_', ' ')}: it is not armed",
                where="drive limits",
                limit=f"{value:.5g} as written",
                remedy=_HELD_OTHERWISE.get(name, "`rig doctor` lists the objects that it lacks."),
            )
        if not abs(read[name] - value) <= _READBACK_TOLERANCE * abs(value):
            raise LimitError(
                f"the drive's {name.replace('_', ' ')} limit reads back differently: it is not armed",
                where="drive limits",
                value=f"{read[name]:.5g}",
                limit=f"{value:.5g} as written",
                remedy="Check that the drive accepts the object and its unit, then try again.",
            )
    held = ", ".join(_limit_words(name, value) for name, value in read.items())
    return Finding("drive limits", Severity.PASSED, f"read back: {held}")


def _limit_words(name: str, value: float) -> str:
    """A limit of the drive (SI) in the unit in which it is read."""
    factor, unit = {"torque": (1.0, "N m"), "speed": (RPM, "r/min")}.get(name, (1.0, "rad/s²"))
    return f"{name.replace('_', ' ')} {value / factor:.4g} {unit}"


SET_POINTS = {Servo.SPEED: TARGET_SPEED, Servo.TORQUE: TARGET_TORQUE}
"""The channel that carries the set-point of a step."""
PAIRED = (INPUT_ANGLE, OUTPUT_ANGLE, TORQUE)
"""Channels that every protocol pairs: each value belongs to the same SYNC as those of the others."""


def standing_checks(
    channels: Sequence[Channel],
    counts: NDArray[np.int64],
    flags: NDArray[np.uint16],
    rated_torque: float,
) -> tuple[Finding, ...]:
    """A few hundred cycles with the servo off: drive state, standstill of both encoders, complete
    cycles, torque zero.
    """
    column = {channel.name: i for i, channel in enumerate(channels)}
    by_name = {channel.name: channel for channel in channels}
    checks = [_completeness(flags)]
    polled = [name for name in PAIRED if name in column and by_name[name].acquired == "polled"]
    if polled:
        evidence = f"{', '.join(polled)}: polled at times of their own, not latched at the SYNC"
        remedy = (
            "Wire the SYNC to the device's trigger line, or take the channel from another device."
        )
        checks.append(Finding("pairs", Severity.BLOCKS, evidence, remedy))
    if STATUSWORD in column:
        checks.append(_state(int(counts[-1, column[STATUSWORD]])))
    for name in (INPUT_ANGLE, OUTPUT_ANGLE):
        if name in column:
            spread = int(np.ptp(counts[:, column[name]]))
            standing = spread <= STANDING_COUNTS
            evidence = f"{name} moves by {spread} counts in {len(counts)} cycles"
            checks.append(passed_if("standstill", standing, evidence, "Wait until the rig stands."))
    if TORQUE in column:
        torque = by_name[TORQUE].to_si(counts[:, column[TORQUE]])
        zero, noise = float(torque.mean()), float(torque.std())
        evidence = f"{1e3 * zero:.1f} mN m with {1e3 * noise:.2f} mN m of noise (r.m.s.), servo off"
        fine = abs(zero) <= LARGEST_ZERO * rated_torque
        remedy = "Trim the monitor's offset or check its cable."
        checks.append(passed_if("torque zero", fine, evidence, remedy))
    return tuple(checks)


def _completeness(flags: NDArray[np.uint16]) -> Finding:
    cycles = max(len(flags), 1)
    share = int(np.count_nonzero(flags & CycleFlag.INCOMPLETE)) / cycles if len(flags) else 1.0
    late = int(np.count_nonzero(flags & (CycleFlag.LATE | CycleFlag.DOUBLED))) / cycles
    evidence = f"{100.0 * (1.0 - share):.1f} % of {len(flags)} cycles complete"
    remedy = "Check the bus before anything moves."
    if late:
        evidence += f", {100.0 * late:.1f} % with answers that came late"
        remedy = "Lower the SYNC rate or stop other programs on this computer; then check the bus."
    return passed_if("cycles", share <= MISSED_SHARE, evidence, remedy)


def _state(word: int) -> Finding:
    state = drive_state(word)
    evidence = f"statusword 0x{word:04X}, {state.value}"
    if state in (DriveState.FAULT, DriveState.FAULT_REACTION):
        return Finding(
            "drive",
            Severity.BLOCKS,
            evidence,
            "Remove the cause and acknowledge the fault at the drive.",
        )
    if state in POWERED_STATES or state is DriveState.UNKNOWN:
        return Finding("drive", Severity.BLOCKS, evidence, "The servo must be off before a run.")
    return Finding("drive", Severity.PASSED, evidence)


def refuse_failed(checks: Sequence[Finding]) -> None:
    """Raise `RigError` naming every check that failed."""
    failed = [check for check in checks if check.severity is Severity.BLOCKS]
    if failed:
        raise RigError(
            "the rig is not ready, nothing has moved",
            where="preflight",
            value="; ".join(check.sentence for check in failed),
        )
