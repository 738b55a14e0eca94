"""What of a bench was tried before it is trusted: the stages, in their order, and the record of who saw what of them.

The record is a journal in the bench's state folder: each line has the hash of the line before. A stage counts while
the rig's description (the tables that tell of devices, channels, limits and guard, and of nothing else) and the devices
are those with which it was done.

    up to `stop-computer`   gear uncoupled: until they are done nothing turns faster than 30 r/min
    the rest                gear coupled: until they are done the output turns no further than once
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

from model.units import RPM
from rig.content.phrase import phrase
from rig.runfile.chained_lines import Chain

JOURNAL_NAME = "commissioning.jsonl"
SEALED_PREFIX = "commissioning-"
"""How the names of sealed records begin; they end in .json and lie beside the runs."""
FIRST_SPEED = 30.0 * RPM
"""Input speed [rad/s] that a bench may turn at whose uncoupled stages are not done."""
FIRST_TURNS = 1.0
"""Turns of the output that a bench may make whose coupled stages are not done."""
FIRST_TORQUE = 0.1
"""Share of the rated torque to which the motor is limited while it turns for the first time."""

_ROOM = 1.001
"""Over an allowed number: what a sum may be off by."""

_CHAIN = Chain(
    "the record of the commissioning",
    "Take the original, or the backup; or move the file away and commission the bench anew.",
    "Make the bench's state folder writable; `rig doctor` prints where it is.",
)


@dataclass(frozen=True)
class Stage:
    """One stage: its name, whether the gear is coupled in it, what is done, and what must be seen."""

    name: str
    gear: Literal["as it is", "coupled", "uncoupled"]
    does: str
    must_be_seen: str


STAGES: tuple[Stage, ...] = (
    Stage(
        "listen",
        "as it is",
        "The bus is listened to. Nothing is sent.",
        "No other master, no SYNC.",
    ),
    Stage(
        "read",
        "as it is",
        "Every node is asked by SDO who it is and how it is set. Nothing is written.",
        "Each node is the kind that the description says, its numbers are those of the description, the servo is off.",
    ),
    Stage(
        "hand",
        "coupled",
        "The emergency stop is pressed and the input shaft is turned by hand. No controlword is sent.",
        "The drive tells that it is cut off; both encoders count as the shaft was turned, in their sense and ratio; "
        "the guard's contact follows the guard.",
    ),
    Stage(
        "uncoupled",
        "uncoupled",
        "The servo is switched on for the first time: 30 r/min both ways, a tenth of the rated torque.",
        "The motor turns as it is told, the output stands, the torque monitor and the drive agree.",
    ),
    Stage(
        "stop-key",
        "uncoupled",
        "While it turns at 30 r/min, Ctrl-C (in the window: Esc) is pressed.",
        "A controlled ramp to verified standstill.",
    ),
    Stage(
        "stop-guard",
        "uncoupled",
        "While it turns at 30 r/min, the guard is opened.",
        "The run trips by the guard, to verified standstill.",
    ),
    Stage(
        "stop-emergency",
        "uncoupled",
        "While it turns at 30 r/min, the emergency stop is pressed.",
        "The run trips; the motor has no torque.",
    ),
    Stage(
        "stop-cable",
        "uncoupled",
        "While it turns at 30 r/min, the bus cable is unplugged at the computer.",
        "The run trips, and the motor stops by itself within the time that the drive watches.",
    ),
    Stage(
        "stop-kill",
        "uncoupled",
        "While it turns at 30 r/min, this program is killed from another terminal.",
        "The motor stops by itself.",
    ),
    Stage(
        "stop-computer",
        "uncoupled",
        "While it turns at 30 r/min, the computer is cut off: its power, or its adapter.",
        "The motor stops by itself.",
    ),
    Stage(
        "coupled",
        "coupled",
        "The gear is coupled: a degree, a turn of the input, a turn of the output, two speeds both ways.",
        "Direction, ratio, torque, index marks and skew are as described.",
    ),
    Stage(
        "full-speed",
        "coupled",
        "A quarter, a half and the whole of the speed that the limits allow, both ways.",
        "No trip, no limit nearer than planned, and nothing that sounds wrong.",
    ),
)
"""Every stage, in its order."""
NAMES = tuple(stage.name for stage in STAGES)
COUPLED = frozenset(NAMES[NAMES.index("coupled") :])
"""Those that let the output turn further than once; the others let the input turn faster than 30 r/min."""

Device = Mapping[str, str]
_DEVICE_WORDS = ("vendor_id", "product_code", "revision", "serial_number", "software_version")
"""By what a device is known for the same."""


@dataclass(frozen=True, kw_only=True)
class StageDone:
    """One line of the record: a stage as it came out. `runs` are its run files with their SHA-256."""

    stage: str
    at: str
    operator: str
    passed: bool
    description: str
    """The hash of the description that was in force."""
    devices: Mapping[str, Device] = field(default_factory=dict)
    findings: Sequence[Mapping[str, Any]] = ()
    answers: Mapping[str, str] = field(default_factory=dict)
    runs: Mapping[str, str] = field(default_factory=dict)
    program: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Missing:
    """A stage that does not count, and why."""

    stage: str
    reason: str

    def __str__(self) -> str:
        return f"{self.stage} ({self.reason})"


def read_record(state: Path) -> tuple[StageDone, ...]:
    """Every stage that was tried on a bench, the oldest first. Raises `RunFileError`, `ChangedRunError`."""
    path = state / JOURNAL_NAME
    if not path.exists():
        return ()
    return tuple(_line(row) for row in _CHAIN.read(path))


def _line(row: Mapping[str, Any]) -> StageDone:
    known: dict[str, Any] = {k: v for k, v in row.items() if k in StageDone.__dataclass_fields__}
    return StageDone(**{**known, "findings": tuple(row.get("findings", ()))})


def is_sealed_record(path: Path) -> bool:
    """Whether a file is named as the sealed record of a commissioning."""
    return path.name.startswith(SEALED_PREFIX) and path.suffix == ".json"


def keep(state: Path, done: StageDone) -> None:
    """Add a stage to the record. Raises `RunFileError`."""
    path = state / JOURNAL_NAME
    try:
        state.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _CHAIN.not_written(path, error) from None
    _CHAIN.append(path, asdict(done))


def missing_stages(
    record: Sequence[StageDone],
    description: str,
    devices: Mapping[str, Device] | None = None,
) -> tuple[Missing, ...]:
    """The stages that do not count any more or yet; `devices` None: nobody has asked who is on the bus."""
    newest = {done.stage: done for done in record}
    reasons = {name: _why_not(newest.get(name), description, devices) for name in NAMES}
    return tuple(Missing(name, reason) for name, reason in reasons.items() if reason)


def _why_not(done: StageDone | None, description: str, devices: Mapping[str, Device] | None) -> str:
    """Why a stage does not count; "" where it does."""
    if done is None:
        return "never done"
    day = done.at[:10]
    if not done.passed:
        return f"failed on {day}"
    if done.description != description:
        return f"the description has changed since {day}"
    if devices is None or not done.devices:
        return ""
    names = sorted({*done.devices, *devices})
    other = (n for n in names if _known_by(done.devices.get(n)) != _known_by(devices.get(n)))
    return phrase("another {} since {}", next(other, ""), day)


def _known_by(device: Device | None) -> tuple[str, ...]:
    return tuple((device or {}).get(word, "") for word in _DEVICE_WORDS)


@dataclass(frozen=True, kw_only=True)
class Asked:
    """How far a plan goes: the highest input speed [rad/s], turns of a coupled output with both directions added, and
    whether it commands torque, so that nobody can say how fast the input turns.
    """

    fastest: float
    output_turns: float = 0.0
    has_torque: bool = False


def beyond(missing: Iterable[Missing], asked: Asked) -> tuple[str, ...]:
    """What a plan asks for that the missing stages do not allow, in words; empty where it may be run all the same."""
    names = {one.stage for one in missing}
    found: list[str] = []
    if names - COUPLED:
        if asked.fastest > _ROOM * FIRST_SPEED:
            found.append(f"{asked.fastest / RPM:.0f} r/min, allowed {FIRST_SPEED / RPM:.0f} r/min")
        if asked.has_torque:
            found.append("set-points of torque, allowed set-points of speed")
    if names & COUPLED and asked.output_turns > _ROOM * FIRST_TURNS:
        found.append(f"{asked.output_turns:.1f} turns of the output, allowed {FIRST_TURNS:.0f}")
    return tuple(found)


def hash_of(described: Mapping[str, Any]) -> str:
    """The SHA-256 of what describes a rig, as text sorted by its words."""
    text = json.dumps(described, sort_keys=True, ensure_ascii=False, default=str)
    return hashlib.sha256(text.encode()).hexdigest()
