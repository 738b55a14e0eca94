"""Which node is what, and what of its numbers can be believed: words of a description, each with its reason.

What the devices tell and can be right is left to them, or written with where it comes from. What only a person knows is
marked: a description in which such a mark is left is refused word by word (`rig config check`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

from drivers.bus.cia402 import plausible
from drivers.bus.cia402.plausible import Question
from drivers.bus.discover import FoundNode
from drivers.bus.load import load_of
from rig.bench.config.load import TO_BE_SAID
from rig.content.phrase import phrase

_ROLES: Final = {402: "drive", 406: "counter", 401: "analogue and digital inputs"}
"""What a node of each device profile is for."""
_USUAL_RATE: Final = 500.0
"""Hz that a computer without real time keeps."""
_CSV, _CSP, _PV, _CST, _TQ = 8, 7, 2, 9, 3
"""Bits of 0x6502: cyclic velocity, cyclic position, profile velocity, cyclic torque, profile torque."""
_SHAPED_BY: Final = {
    "cyclic velocity": "",
    "cyclic position": ": without cyclic velocity the drive is led by positions, whose loop shapes the steps",
    "profile velocity": ": without cyclic velocity the drive's own ramps shape the steps",
}
"""What the first mode of speed that a drive has does to steps."""
_STAYS: Final = (5, 6, 7, 8)
"""Quick stop options (0x605A) that end in QUICK STOP ACTIVE."""


@dataclass(frozen=True)
class Word:
    """A word of a table: name, value (None: left to the device), why. `is_open`: a person must say it."""

    name: str
    value: Any
    why: str
    is_open: bool = False


@dataclass(frozen=True)
class Table:
    """A table of the description: its heading as TOML has it, its words, what stands above it as a remark."""

    heading: str
    words: tuple[Word, ...]
    remark: str = ""


@dataclass(frozen=True)
class Bus:
    """How the bus was reached."""

    interface: str
    channel: str
    bit_rate: int
    arguments: tuple[tuple[str, str | int], ...] = ()


@dataclass(frozen=True)
class Proposal:
    """Tables of the description, and what is refused of the nodes as they are set."""

    tables: tuple[Table, ...]
    refused: tuple[str, ...]
    rate: float

    @property
    def questions(self) -> tuple[tuple[str, str], ...]:
        """What a person must say: table and word, and what is asked."""
        return tuple(
            (f"{table.heading} {word.name}", word.why)
            for table in self.tables
            for word in table.words
            if word.is_open
        )


def say(name: str, what: str) -> Word:
    """A word that a person must say."""
    return Word(name, f"{TO_BE_SAID}{what}", what, is_open=True)


def role_of(node: FoundNode) -> str:
    """What a node is for, by its device profile."""
    return _ROLES.get(node.profile, f"none here (profile {node.profile})")


def propose(nodes: Sequence[FoundNode], bus: Bus, bench_id: str) -> Proposal:
    """A description of a rig of these nodes."""
    drives = [node for node in nodes if node.profile == 402]
    counters = [node for node in nodes if node.profile == 406]
    couplers = [node for node in nodes if node.profile == 401 and node.analog_inputs]
    used = [*drives[:1], *counters, *couplers]
    rate = min(load_of(max(len(used), 1)).largest_rate(bus.bit_rate), _USUAL_RATE)
    tables = [
        _rig(rate, bus),
        Table("[bench]", (Word("id", bench_id, "drawn now, for this rig only"),)),
    ]
    tables.append(_bus(bus))
    tables += _drive(drives)
    tables += [table for k, node in enumerate(counters) for table in _counter(node, k)]
    tables += [table for node in couplers for table in _coupler(node)]
    refused = [f"node {node.node_id}: {what}" for node in nodes for what in node.refused]
    return Proposal(tuple(tables), tuple(refused), rate)


def _rig(rate: float, bus: Bus) -> Table:
    why = f"of {bus.bit_rate // 1000} kbit/s; 1 kHz needs a real-time computer"
    return Table(
        "[rig]",
        (
            Word("name", "Rig 1", "a name for reports"),
            Word("sample_rate_hz", rate, f"SYNC rate that this bus carries, {why}"),
            say("motor", "the motor: sgmjv-02, or the path of its parameter file (TOML)"),
            say("gear", "the gear: csf-25-120, or the path of its parameter file (TOML)"),
        ),
    )


def _bus(bus: Bus) -> Table:
    words = [
        Word("interface", bus.interface, "as it was reached"),
        Word("channel", bus.channel, "as it was reached"),
        Word("bit_rate", bus.bit_rate, "as it was reached"),
    ]
    if bus.arguments:
        words.append(Word("arguments", dict(bus.arguments), "as it was reached"))
    return Table("[bus]", tuple(words))


def _about(node: FoundNode) -> str:
    who = node.identity
    told = f"node {node.node_id}: {who.name or 'no name'}, vendor 0x{who.vendor_id:X}, product 0x{who.product_code:X}"
    return f"{told}, revision 0x{who.revision:X}, serial number {who.serial_number}"


def _stops(drive: FoundNode) -> Iterator[Word]:
    """What has to be said of how the drive stops by itself."""
    if drive.quick_stop_option in _STAYS:
        why = f"0x605A is {drive.quick_stop_option}: it would stay in QUICK STOP ACTIVE"
        yield Word("quick_stop_option", 2, why)
    if not drive.has_consumer:
        what = "what stops the motor when the computer is lost: no 0x1016"
        yield say("computer_loss_covered_by", what)


def _drive(drives: Sequence[FoundNode]) -> Iterator[Table]:
    if not drives:
        yield Table(
            "[drive]", (say("node_id", "the drive's node-ID: no node of profile 402 answers"),)
        )
        yield Table("[motor_encoder]", tuple(_lines("the motor's encoder", None)))
        return
    drive = drives[0]
    words = [
        Word("node_id", drive.node_id, "the only drive" if len(drives) == 1 else "the first drive")
    ]
    stated = drive.statement
    words.append(_believed("rated_torque_n_m", plausible.rated_torque(stated), "N m by 0x6076"))
    counts = plausible.counts_per_revolution(stated)
    words.append(_believed("counts_per_revolution", counts, "by 0x608F, 0x6091, 0x6092"))
    known = counts if isinstance(counts, float) else 0.0
    unit = plausible.velocity_unit(stated, known)
    words.append(_believed("velocity_unit_rad_s", unit, "rad/s per count of 0x60FF"))
    ramp = plausible.acceleration_unit(stated, known)
    words.append(_believed("acceleration_unit_rad_s2", ramp, "rad/s2 per count of 0x6083"))
    words += (*_modes(drive), *_stops(drive))
    others = phrase("; other drives: {}", ", ".join(str(n.node_id) for n in drives[1:]))
    yield Table("[drive]", tuple(words), _about(drive) + others)
    yield Table("[motor_encoder]", tuple(_lines("the motor's encoder", int(known) or None)))
    if drive.has_digital_inputs:
        yield Table(
            "[guard]",
            (
                Word("node_id", drive.node_id, "the drive has digital inputs (0x60FD)"),
                say(
                    "mask",
                    "the bit of 0x60FD to which the guard's contact is wired, such as 0x00010000; or delete [guard]",
                ),
                say("closed", "the same bit where 1 means closed, else 0"),
            ),
        )


def _believed(name: str, found: float | Question, what: str) -> Word:
    """A number that the drive states and that can be right is left to it; else it is asked."""
    if isinstance(found, Question):
        return say(name, f"{found.why}. {found.hint}")
    return Word(name, None, f"asked of the drive: {found:g} {what}")


def _modes(drive: FoundNode) -> Iterator[Word]:
    if drive.modes is None:
        yield Word("speed_modes", None, "the drive has no 0x6502: tried when it is brought up")
        return
    speed = [
        name
        for bit, name in (
            (_CSV, "cyclic velocity"),
            (_CSP, "cyclic position"),
            (_PV, "profile velocity"),
        )
        if drive.modes >> bit & 1
    ]
    torque = [
        name
        for bit, name in ((_CST, "cyclic torque"), (_TQ, "profile torque"))
        if drive.modes >> bit & 1
    ]
    why = f"by 0x6502 = 0x{drive.modes:X}"
    if speed:
        yield Word("speed_modes", speed, why + _SHAPED_BY[speed[0]])
    else:
        yield say("speed_modes", f"{why} it has no velocity mode that this program uses")
    yield Word("torque_modes", torque, why)


def _lines(of: str, counts: int | None) -> Iterator[Word]:
    product = phrase("; their product is {}, by the device", counts)
    yield say("lines", f"lines per revolution of {of}, from its nameplate{product}")
    yield say(
        "multiplication",
        f"counts per line: 4 where edges are counted, more with interpolation{product}",
    )


def _counter(node: FoundNode, k: int) -> Iterator[Table]:
    words = [Word("node_id", node.node_id, "an encoder (profile 406)")]
    if k == 0:
        words.append(
            Word(
                "channel",
                "output_angle",
                "the first encoder on the bus; input_angle if it is the motor's",
            )
        )
    else:
        words.append(
            say(
                "channel",
                "what this encoder measures: output_angle, input_angle, or a name of its own",
            )
        )
    words += _lines("this encoder", node.counts_per_revolution)
    whole = node.total_range or "2^32"
    words.append(Word("modulus", None, f"asked of the device: it wraps at {whole} (0x6002)"))
    yield Table("[[counter]]", tuple(words), _about(node))


def _coupler(node: FoundNode) -> Iterator[Table]:
    yield Table(
        "[[analog_module]]", (Word("node_id", node.node_id, "inputs (profile 401)"),), _about(node)
    )
    yield Table(
        "[[analog_module.input]]",
        (
            Word("channel", "torque", "the torque monitor of the amplifier"),
            say("object", f'which of {node.analog_inputs} inputs, such as "0x6401:1 I16"'),
            say("volts_per_count", "volts per count of that input, from the module's manual"),
            say(
                "volts_per_rated_torque",
                "volts at 100 % of rated torque, from the amplifier's manual",
            ),
        ),
    )
