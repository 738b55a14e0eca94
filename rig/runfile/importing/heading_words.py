"""What the heading of a column says it is: the words of people's logs, and the channel that they mean."""

from __future__ import annotations

import re
from dataclasses import dataclass

from model.errors import ParameterError
from model.unit_text import scale_in
from model.units import COUNT
from rig.errors import ConfigurationError
from rig.runfile.importing.adapters.table import split_heading
from rig.runfile.importing.units import TRANSMISSION_ERROR, dimensions_of, unit_of

_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[0-9]+|[^\W\d_]+")
_SPOKEN = re.compile(r"(.*\S)\s+in\s+(\S+(?: \S+)?)")
"""A unit that is spoken: `position in mm`."""
_KINDS: dict[str, frozenset[str]] = {
    "time": frozenset({"t", "time", "timestamp", "stamp", "zeit", "elapsed", "clock", "secs"}),
    "angle": frozenset(
        {"position", "pos", "angle", "q", "theta", "phi", "winkel", "lage", "encoder", "enc"}
    ),
    "speed": frozenset(
        {"velocity", "vel", "speed", "dq", "qd", "qdot", "dot", "omega", "rpm", "drehzahl", "velo"}
        | {"geschwindigkeit"}
    ),
    "torque": frozenset(
        {"torque", "tau", "effort", "moment", "drehmoment", "trq", "tq", "mom", "friction"}
    ),
    "current": frozenset({"current", "iq", "i", "strom", "amps", "curr", "cur"}),
    "voltage": frozenset({"voltage", "volt", "volts", "uq", "spannung"}),
    "force": frozenset({"force", "kraft"}),
    "temperature": frozenset({"temperature", "temp", "temperatur"}),
}
"""Words of a quantity."""
_ORDER = ("time", "speed", "torque", "current", "voltage", "force", "temperature", "angle")
_INPUT = frozenset({"motor", "mot", "input", "in", "drive", "antrieb", "wg", "wave", "m"})
_OUTPUT = frozenset({"output", "out", "load", "link", "abtrieb", "last", "l"})
_WANTED = frozenset(
    {"target", "cmd", "command", "commanded", "goal", "ref", "reference", "set", "setpoint"}
    | {"desired", "des", "soll", "sollwert", "demand"}
)
_ROOM = frozenset({"ambient", "room", "raum", "umgebung", "lab"})
_NOT_A_SIGNAL = frozenset(
    {"error", "err", "deviation", "fehler", "residual", "index", "status"}
    | {"enable", "enabled", "state", "mode", "flag", "limit", "max", "min", "gain"}
)
_OF_THE_GEAR = frozenset({"transmission", "kinematic"})
"""Words of an error that is a signal: that of the output beside the input over the ratio."""
_CHANNELS: dict[tuple[str, str], str] = {
    ("time", ""): "time",
    ("angle", ""): "position",
    ("angle", "input"): "input_angle",
    ("angle", "output"): "output_angle",
    ("speed", ""): "speed",
    ("speed", "input"): "input_speed",
    ("speed", "output"): "output_speed",
    ("torque", ""): "torque",
    ("torque", "input"): "torque",
    ("torque", "output"): "output_torque",
    ("current", ""): "current",
    ("current", "input"): "motor_current",
    ("voltage", ""): "voltage",
    ("force", ""): "force",
    ("temperature", ""): "housing_temperature",
}
"""The channel of a quantity on a side of the gear; where the side makes none of its own, that without one."""
_UNIT_KINDS = {"torque": "N m", "speed": "rad/s"}
"""Quantities that are told by their SI unit alone."""
_LATCHED = frozenset({"input_index", "output_index", "index_seen"})
"""What an index mark latched jumps as an angle does not: it is left out, unless somebody names it."""
_NEVER_UNITS = frozenset({"m", "l", "i", "q", "t", "in"})
"""Endings that are read as a side or a name before a unit: `theta_m` is no angle in metres."""


@dataclass(frozen=True)
class Heading:
    """What a heading says: the channel that it means ("" for none), the unit that it states, and which of several.

    `member` is the number that stands in it: of the joint, the axis or the channel.
    """

    channel: str
    unit: str
    member: str
    why: str


def read_heading(heading: str, beside: str = "") -> Heading:
    """What a heading says of its column; where it says nothing, what the name of its file does (`beside`)."""
    found = _read(heading)
    if found.channel or not beside:
        return found
    by_file = _read(beside)
    if not by_file.channel or by_file.channel == "time":
        return found
    why = f"in the file {beside!r}"
    return Heading(by_file.channel, found.unit or by_file.unit, found.member, why)


def _read(heading: str) -> Heading:
    plain, unit = split_heading(heading)
    if not unit and (spoken := _SPOKEN.fullmatch(plain)) and _fits(spoken[2], ""):
        plain, unit = spoken[1], spoken[2]
    words = _words(plain)
    names = [word for word in words if not word.isdigit()]
    member = next((word for word in reversed(words) if word.isdigit()), "")
    said = plain.strip().lower()
    channel = said if dimensions_of(said) else _channel_of(names)
    if channel in _LATCHED:
        return Heading("", unit, member, "")
    if channel and not unit and said != channel:
        unit = _unit_behind(plain, channel)
    if channel == "torque" and unit and not _fits(unit, channel) and _fits(unit, "force"):
        channel = "force"
    why = f"called {heading.strip()!r}" if channel else ""
    return Heading(channel, unit if _fits(unit, channel) else "", member, why)


def _words(plain: str) -> list[str]:
    """The words of a heading, small; `min` of a unit is none."""
    return [word.lower() for word in _WORD.findall(plain.replace("/min", ""))]


def channel_by_unit(heading: str, unit: str) -> tuple[str, str]:
    """The channel that a unit alone makes of a column, and the unit: that of a torque or a speed; "" for another."""
    plain = split_heading(heading)[0]
    for kind, si in _UNIT_KINDS.items():
        said = unit or _unit_behind(plain, kind)
        if scale_in(said, si) is not None:
            return _channel_of(_words(plain), kind), said
    return "", ""


_SIDES = (("input", _INPUT), ("output", _OUTPUT))
"""Words of either side of the gear; where both are there, it is the input's."""


def _channel_of(words: list[str], by_unit: str = "") -> str:
    there = frozenset(words)
    if there & _OF_THE_GEAR and there & {"error", "fehler"}:
        return TRANSMISSION_ERROR
    if there & (_WANTED | _NOT_A_SIGNAL):
        return ""
    kind = next((kind for kind in _ORDER if _KINDS[kind] & there), by_unit)
    if kind == "temperature" and there & _ROOM:
        return "ambient_temperature"
    side = next((name for name, theirs in _SIDES if there & theirs), "")
    return _CHANNELS.get((kind, side), _CHANNELS.get((kind, ""), ""))


def _unit_behind(plain: str, channel: str) -> str:
    """The unit that stands at the end of a name: `speed_rpm`, `pos deg`, `torque_Nm`, `time_ms`."""
    parts = re.split(r"[_\s/]+", plain.strip())
    for size in (2, 1):
        ending = "/".join(parts[-size:])
        is_ending = len(parts) > size and ending.lower() not in _NEVER_UNITS
        if is_ending and _fits(ending, channel):
            return ending
    return "rpm" if "rpm" in plain.lower() and channel.endswith("speed") else ""


def _fits(unit: str, channel: str) -> bool:
    """Whether a text is a unit that the channel may have."""
    if not unit:
        return False
    allowed = dimensions_of(channel) or ()
    try:
        read = unit_of(unit, channel, allowed)
    except (ConfigurationError, ParameterError):
        return False
    return not allowed or read.si in allowed or read.symbol == COUNT
