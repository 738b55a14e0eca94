"""What is drilled: the rows of `drills.toml`, each made a fault that can be let happen on a simulated rig."""

from __future__ import annotations

import ast
import functools
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from importlib import resources
from typing import Any, Literal

from drivers import channel as names
from drivers.samples import CycleFlag
from rig.run.stop import StopRequest
from rig.trial.drill.cause import NOTHING
from rig.trial.drill.rigs import Carrier
from sim_backend import faults as plain
from sim_backend.faults import Fault
from sim_backend.wire import analog_faults as analog
from sim_backend.wire import box_faults as box
from sim_backend.wire import faults as wire
from sim_backend.wire import strangers
from sim_backend.wire.analog_amplifier import NO_ALARM
from sim_backend.wire.bench import ANALOG_INPUT_NODE, COUNTER_NODE, DRIVE_NODE, WireBench

Moment = Literal[
    "preflight",
    "zero-before",
    "switching-on",
    "ramp",
    "hold",
    "reversal",
    "stand",
    "torque-ramp",
    "zero-after",
    "making-safe",
    "start",
]
"""When it happens: in the middle of a segment of the drill's protocol, or between them; "start":
before the rig is opened.
"""
Recording = Literal["", "disk full", "disk nearly full", "writer stalled", "no status page"]
Readout = Literal["", "garbage", "half lines", "silent", "encoder fault"]


@dataclass(frozen=True, kw_only=True)
class Drill:
    """One fault: what it is in words, the cause that must be detected, when and on which rigs it
    happens, and whether it must do no harm.

    `cause` may differ between carriers; `NOTHING` where there is nothing to detect. `carriers` in
    order of preference. `press` is what the operator does; `fault` is what the rig does, made for
    a cycle; `recording` and `readout` are faults of the computer's disk and of the readout's line.
    Where it `is_unheard`, nobody can be heard any more and software cannot verify standstill.
    """

    name: str
    what: str
    cause: str | Mapping[Carrier, str]
    fault: Callable[[int], Fault] | None = None
    carriers: tuple[Carrier, ...] = ()
    moment: Moment = "hold"
    is_harmless: bool = False
    press: Callable[[StopRequest], None] | None = None
    prepare: Callable[[WireBench], None] | None = None
    limits_factor: float = 1.0
    recording: Recording = ""
    readout: Readout = ""
    is_unheard: bool = False

    @property
    def claims_detection(self) -> bool:
        """Whether there is something to detect."""
        return self.cause != NOTHING

    def cause_on(self, carrier: Carrier) -> str:
        """The cause that must be detected on this rig."""
        if isinstance(self.cause, str):
            return self.cause
        return self.cause.get(carrier) or self.cause["wire"]

    def taken_out(self) -> Drill:
        """The same run with a fault that does nothing. A press that only gives it its occasion stays."""
        return replace(
            self,
            fault=self.fault and Fault,
            press=self.fault and self.press,
            prepare=None,
            limits_factor=1.0,
            recording="",
        )


@dataclass(frozen=True)
class LateNowAndThen(wire.TpdoLate):
    """Process data of every tenth cycle arrive after the next SYNC."""

    def active(self, cycle: int) -> bool:
        return super().active(cycle) and (cycle - self.at_cycle) % 10 == 0


def _narrow_counter(bench: WireBench) -> None:
    """A counter whose declared measuring range is 2048 counts: it wraps about every 10 degrees of the output."""
    bench.counter.dictionary.store(0x6002, 0, 2048)


def _abort(stop: StopRequest) -> None:
    stop.press()
    stop.press()


_PRESSES: Mapping[str | None, Callable[[StopRequest], None] | None] = {
    None: None,
    "STOP": StopRequest.press,
    "ABORT": _abort,
}
_PREPARED: Mapping[str | None, Callable[[WireBench], None] | None] = {
    None: None,
    "narrow counter": _narrow_counter,
}
_FAULTS: Mapping[str, type[Fault]] = {
    name: kind
    for module in (plain, wire, analog, box, strangers)
    for name, kind in vars(module).items()
    if isinstance(kind, type) and issubclass(kind, Fault)
} | {"LateNowAndThen": LateNowAndThen}
"""What may go wrong, by the name that a row says."""
_WORDS: Mapping[str, Any] = {
    "drive": DRIVE_NODE,
    "counter": COUNTER_NODE,
    "analog_input": ANALOG_INPUT_NODE,
    "input_angle": names.INPUT_ANGLE,
    "NO_ALARM": NO_ALARM,
    "PRE_OPERATIONAL": 0x80,
    "STOPPED": 0x02,
    "START": 0x01,
    **CycleFlag.__members__,
}
"""Words that a row may say in place of a number."""
_KEYS = frozenset(
    [
        "name",
        "what",
        "fault",
        "press",
        "disk",
        "readout",
        "prepare",
        "limits_factor",
        "moment",
        "on",
        "detects",
        "harmless",
        "unheard",
    ]
)


@functools.cache
def every_drill() -> Mapping[str, Drill]:
    """Every drill by name, in the order of the table."""
    text = resources.files("rig.trial.drill").joinpath("drills.toml").read_text(encoding="utf-8")
    groups = tomllib.loads(text)
    carriers = {name: tuple(rigs) for name, rigs in groups.pop("on").items()}
    made = [_drill(row, carriers) for rows in groups.values() for row in rows]
    return {drill.name: drill for drill in made}


def _drill(row: Mapping[str, Any], carriers: Mapping[str, tuple[Carrier, ...]]) -> Drill:
    unknown = row.keys() - _KEYS
    if unknown:
        raise ValueError(f"drills.toml, {row['name']}: no such key {', '.join(unknown)}")
    return Drill(
        name=row["name"],
        what=row["what"],
        cause=row["detects"],
        fault=_fault(row["fault"]) if "fault" in row else None,
        carriers=carriers[row.get("on", "wire")],
        moment=row.get("moment", "hold"),
        is_harmless=row.get("harmless", False),
        press=_PRESSES[row.get("press")],
        prepare=_PREPARED[row.get("prepare")],
        limits_factor=row.get("limits_factor", 1.0),
        recording=row.get("disk", ""),
        readout=row.get("readout", ""),
        is_unheard=row.get("unheard", False),
    )


def _fault(text: str) -> Callable[[int], Fault]:
    """What a row says: the name of a fault, with what it is made with in brackets beside its cycle."""
    said = ast.parse(text, mode="eval").body
    if isinstance(said, ast.Name):
        return _FAULTS[said.id]
    if not isinstance(said, ast.Call):
        raise ValueError(f"{text!r} names no fault")
    kind = _FAULTS[ast.unparse(said.func)]
    given = [_value(argument) for argument in said.args]
    named = {str(keyword.arg): _value(keyword.value) for keyword in said.keywords}
    return lambda at: kind(at, *given, **named)


def _value(said: ast.expr) -> Any:
    """A number, a truth value or a word; or a tuple of them."""
    if isinstance(said, ast.Tuple):
        return tuple(_value(part) for part in said.elts)
    if isinstance(said, ast.Name):
        return _WORDS[said.id]
    return ast.literal_eval(said)
