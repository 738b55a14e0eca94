"""The servo amplifier as it is set: state, modes, units, what it does when the computer dies,
electronic gear, gains.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from drivers.bus.cia301 import U8, U32, ObjectRef
from drivers.bus.cia402 import tables as obj
from drivers.bus.cia402.drive import ServoAmplifier
from drivers.drive_state import POWERED_STATES, DriveState, drive_state
from drivers.errors import DriverError
from rig.trial.doctor.finding import Finding, judged

GROUP = "drive"
VOLTAGE_BIT = 0x0010
"""Statusword bit 4: the power stage has its voltage; clear without main power or with the safe torque off active."""
ABORT_OPTIONS: Mapping[int, str] = {0: "no action", 1: "fault", 2: "power off", 3: "quick stop"}
"""0x6007: what the drive does when the connection is lost."""
QUICK_STOP_OPTIONS: Mapping[int, str] = {
    0: "power off, the motor coasts",
    1: "slow-down ramp, then power off",
    2: "quick-stop ramp, then power off",
    3: "current limit, then power off",
    4: "voltage limit, then power off",
    5: "slow-down ramp, stays",
    6: "quick-stop ramp, stays",
    7: "current limit, stays",
    8: "voltage limit, stays",
}
"""0x605A: how a quick stop ends."""
FACTORS = (
    ("electronic gear", obj.GEAR_MOTOR, obj.GEAR_SHAFT),
    ("position factor", obj.POSITION_FACTOR, obj.POSITION_DIVISOR),
)
"""What may stand between the encoder's counts and 0x6064: numerator and divisor."""


def inspect_drive(drive: ServoAmplifier, computer: int) -> Iterable[Finding]:
    """Every line about the servo amplifier; `computer` is the node-ID of the computer's heartbeat.
    Raises `DriverError`.
    """
    yield _state(drive)
    yield _modes(drive)
    yield _units(drive)
    yield _option(
        drive,
        obj.ABORT_OPTION,
        ABORT_OPTIONS,
        "It goes on turning when the computer dies: set 3, quick stop.",
    )
    yield _option(
        drive,
        obj.QUICK_STOP_OPTION,
        QUICK_STOP_OPTIONS,
        "A quick stop leaves the motor coasting: set 2.",
    )
    yield _watches(drive, computer)
    for factor in FACTORS:
        yield from _factor(drive, *factor)
    yield _settings(drive)


def _state(drive: ServoAmplifier) -> Finding:
    try:
        word = drive.statusword()
    except DriverError as error:
        return Finding(
            group=GROUP,
            name="state",
            result="failed",
            evidence=str(error),
            remedy="Check the drive's supply.",
        )
    state = drive_state(word)
    text = f"statusword 0x{word:04X}, {state.value}"
    if state in (DriveState.FAULT, DriveState.FAULT_REACTION):
        return Finding(
            group=GROUP,
            name="state",
            result="failed",
            evidence=f"{text}: {drive.error_text()}",
            remedy="Remove the cause, reset the fault.",
        )
    if state in POWERED_STATES or state is DriveState.UNKNOWN:
        return Finding(
            group=GROUP,
            name="state",
            result="failed",
            evidence=text,
            remedy="The servo must be off here.",
        )
    if not word & VOLTAGE_BIT:
        text += ", no voltage at the power stage"
        return Finding(
            group=GROUP,
            name="state",
            result="warning",
            evidence=text,
            remedy="Main power off, or the emergency stop (STO) is pressed.",
        )
    if not word & obj.REMOTE_BIT:
        text += ", does not listen to the bus"
        return Finding(
            group=GROUP,
            name="state",
            result="warning",
            evidence=text,
            remedy="Release it from its panel or its tool (statusword bit 9).",
        )
    return Finding(group=GROUP, name="state", result="ok", evidence=text)


def _modes(drive: ServoAmplifier) -> Finding:
    chosen = (drive.readings.speed_mode, drive.readings.torque_mode)
    modes = [mode.name.replace("_", " ").lower() for mode in chosen if mode is not None]
    return judged(
        GROUP,
        "modes",
        len(modes) == 2,
        ", ".join(modes) or "none",
        limit="one of speed, one of torque",
        otherwise="warning",
        remedy="Protocols that need the missing mode cannot run.",
    )


def _units(drive: ServoAmplifier) -> Finding:
    readings = drive.readings
    counts = (
        f"{readings.counts_per_revolution:g} counts per revolution"
        if readings.counts_per_revolution
        else "counts per revolution not told: those of [motor_encoder] hold unchecked"
    )
    text = f"rated torque {readings.rated_torque:g} N m, speed unit {readings.velocity_unit:.4g} rad/s, {counts}"
    answers = [q for q in readings.questions if q.entry != "counts_per_revolution"]
    return judged(
        GROUP,
        "units",
        not answers,
        "; ".join([text, *(question.why for question in answers)]),
        remedy=" ".join(
            f"Give `{question.entry}` in [drive] of the configuration. {question.hint}"
            for question in answers
        ),
    )


def _option(
    drive: ServoAmplifier, entry: ObjectRef, meanings: Mapping[int, str], remedy: str
) -> Finding:
    """An option code: 0 is what nobody wants, a drive without the object does what its maker chose."""
    name = entry.name.removesuffix(" code")
    value = drive.device.read_optional(entry)
    if value is None:
        return Finding(
            group=GROUP,
            name=name,
            result="warning",
            evidence=f"{entry} is not there: its reaction is its own",
            remedy="See its manual.",
        )
    text = f"{value:g}, {meanings.get(int(value), 'its maker knows')}"
    return judged(
        GROUP,
        name,
        value != 0,
        text,
        value=float(value),
        limit="not 0",
        remedy=remedy,
        otherwise="warning",
    )


def _watches(drive: ServoAmplifier, computer: int) -> Finding:
    """Whether an entry of 0x1016 names the computer: the last line of defence against a loop that is dead."""
    device, name = drive.device, "watch over the computer"
    count = int(device.read_optional(ObjectRef(0x1016, 0, U8, "consumer heartbeat time")) or 0)
    for subindex in range(1, count + 1):
        entry = int(
            device.read_optional(ObjectRef(0x1016, subindex, U32, "consumer heartbeat time")) or 0
        )
        if entry >> 16 & 0x7F == computer and entry & 0xFFFF:
            waits = float(entry & 0xFFFF)
            text = f"misses the heartbeat of the computer (node {computer}) after {waits:g} ms"
            return Finding(
                group=GROUP, name=name, result="ok", evidence=text, value=waits, unit="ms"
            )
    remedy = "Only its own limits and the hardwired stop are left then."
    return Finding(
        group=GROUP,
        name=name,
        result="warning",
        evidence="does not notice when the computer dies (0x1016)",
        remedy=remedy,
    )


def _factor(
    drive: ServoAmplifier, name: str, numerator: ObjectRef, divisor: ObjectRef
) -> Iterable[Finding]:
    settings = drive.readings.settings
    above, below = settings.get(str(numerator)), settings.get(str(divisor))
    if above is None or below is None:
        return
    value = above / below if below else float("inf")
    yield judged(
        GROUP,
        name,
        above == below,
        f"{above:g} : {below:g}",
        value=value,
        unit="1",
        limit="1",
        otherwise="warning",
        remedy="0x6064 is not in encoder counts: set it to 1 : 1, or give the counts per revolution that result.",
    )


def _settings(drive: ServoAmplifier) -> Finding:
    settings = drive.readings.settings
    shown = ", ".join(f"{name} {value:g}" for name, value in settings.items())
    return judged(
        GROUP,
        "settings",
        bool(settings),
        shown or "none could be read",
        otherwise="warning",
        remedy="Electronic gear, option codes and gains are not known: read them with the vendor's tool.",
    )
