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
from experiments.finding import Finding, Severity, passed_if

GROUP = "drive"
_VOLTAGE_BIT = 0x0010
"""Statusword bit 4: the power stage has its voltage; clear without main power or with the safe torque off active."""
_ABORT_OPTIONS: Mapping[int, str] = {0: "no action", 1: "fault", 2: "power off", 3: "quick stop"}
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
_FACTORS = (
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
        _ABORT_OPTIONS,
        "It goes on turning when the computer dies: set 3, quick stop.",
    )
    yield _option(
        drive,
        obj.QUICK_STOP_OPTION,
        QUICK_STOP_OPTIONS,
        "A quick stop leaves the motor coasting: set 2.",
    )
    yield _watches(drive, computer)
    for factor in _FACTORS:
        yield from _factor(drive, *factor)
    yield _settings(drive)


def _state(drive: ServoAmplifier) -> Finding:
    try:
        word = drive.statusword()
    except DriverError as error:
        return Finding(
            "state", Severity.BLOCKS, str(error), "Check the drive's supply.", where=GROUP
        )
    state = drive_state(word)
    text = f"statusword 0x{word:04X}, {state.value}"
    if state in (DriveState.FAULT, DriveState.FAULT_REACTION):
        return Finding(
            "state",
            Severity.BLOCKS,
            f"{text}: {drive.error_text()}",
            "Remove the cause, reset the fault.",
            where=GROUP,
        )
    if state in POWERED_STATES or state is DriveState.UNKNOWN:
        return Finding("state", Severity.BLOCKS, text, "The servo must be off here.", where=GROUP)
    if not word & _VOLTAGE_BIT:
        text += ", no voltage at the power stage"
        return Finding(
            "state",
            Severity.WARNS,
            text,
            "Main power off, or the emergency stop (STO) is pressed.",
            where=GROUP,
        )
    if not word & obj.REMOTE_BIT:
        text += ", does not listen to the bus"
        return Finding(
            "state",
            Severity.WARNS,
            text,
            "Release it from its panel or its tool (statusword bit 9).",
            where=GROUP,
        )
    return Finding("state", Severity.PASSED, text, where=GROUP)


def _modes(drive: ServoAmplifier) -> Finding:
    chosen = (drive.readings.speed_mode, drive.readings.torque_mode)
    modes = [mode.name.replace("_", " ").lower() for mode in chosen if mode is not None]
    return passed_if(
        "modes",
        len(modes) == 2,
        ", ".join(modes) or "none",
        "Protocols that need the missing mode cannot run.",
        where=GROUP,
        allowed="one of speed, one of torque",
        otherwise=Severity.WARNS,
    )


def _units(drive: ServoAmplifier) -> Finding:
    readings = drive.readings
    counts = "counts per revolution not told: those of [motor_encoder] hold unchecked"
    if readings.counts_per_revolution:
        counts = f"{readings.counts_per_revolution:g} counts per revolution"
    text = f"rated torque {readings.rated_torque:g} N m, speed unit {readings.velocity_unit:.4g} rad/s, {counts}"
    answers = [q for q in readings.questions if q.entry != "counts_per_revolution"]
    return passed_if(
        "units",
        not answers,
        "; ".join([text, *(question.why for question in answers)]),
        " ".join(
            f"Give `{question.entry}` in [drive] of the configuration. {question.hint}"
            for question in answers
        ),
        where=GROUP,
    )


def _option(
    drive: ServoAmplifier, entry: ObjectRef, meanings: Mapping[int, str], remedy: str
) -> Finding:
    """An option code: 0 is what nobody wants, a drive without the object does what its maker chose."""
    name = entry.name.removesuffix(" code")
    value = drive.device.read_optional(entry)
    if value is None:
        return Finding(
            name,
            Severity.WARNS,
            f"{entry} is not there: its reaction is its own",
            "See its manual.",
            where=GROUP,
        )
    text = f"{value:g}, {meanings.get(int(value), 'its maker knows')}"
    return passed_if(
        name,
        value != 0,
        text,
        remedy,
        where=GROUP,
        allowed="not 0",
        value=float(value),
        otherwise=Severity.WARNS,
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
            return Finding(name, Severity.PASSED, text, where=GROUP, value=waits, unit="ms")
    remedy = "Only its own limits and the hardwired stop are left then."
    return Finding(
        name, Severity.WARNS, "does not notice when the computer dies (0x1016)", remedy, where=GROUP
    )


def _factor(
    drive: ServoAmplifier, name: str, numerator: ObjectRef, divisor: ObjectRef
) -> Iterable[Finding]:
    settings = drive.readings.settings
    above, below = settings.get(str(numerator)), settings.get(str(divisor))
    if above is None or below is None:
        return
    value = above / below if below else float("inf")
    yield passed_if(
        name,
        above == below,
        f"{above:g} : {below:g}",
        "0x6064 is not in encoder counts: set it to 1 : 1, or give the counts per revolution that result.",
        where=GROUP,
        allowed="1",
        value=value,
        unit="1",
        otherwise=Severity.WARNS,
    )


def _settings(drive: ServoAmplifier) -> Finding:
    settings = drive.readings.settings
    shown = ", ".join(f"{name} {value:g}" for name, value in settings.items())
    return passed_if(
        "settings",
        bool(settings),
        shown or "none could be read",
        "Electronic gear, option codes and gains are not known: read them with the vendor's tool.",
        where=GROUP,
        otherwise=Severity.WARNS,
    )
