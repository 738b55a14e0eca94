"""What a rig declares that it can do beyond exchanging cycles, line by line, with what the lack of it means."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from drivers.port import RigPort
from experiments.finding import Finding, Severity, passed_if


@dataclass(frozen=True)
class _Line:
    name: str
    has: Callable[[RigPort], bool]
    lack: str


LINES: tuple[_Line, ...] = (
    _Line(
        "quick stop",
        lambda port: port.abilities.has_quick_stop,
        "ABORT and trips stop by a set-point of zero, then the servo goes off",
    ),
    _Line(
        "limits read back",
        lambda port: port.abilities.reads_limits_back,
        "somebody sets them by the maker's tool, and says so when the rig is armed",
    ),
    _Line(
        "stop past the loop",
        lambda port: port.abilities.quick_stop_frames is not None,
        "a loop that hangs is stopped by the drive's own watch alone",
    ),
    _Line(
        "direct line",
        lambda port: port.line is not None,
        "a device that sends no process data cannot be asked otherwise",
    ),
    _Line(
        "events of devices",
        lambda port: port.abilities.events is not None,
        "what goes wrong shows in the samples alone",
    ),
    _Line(
        "figures of the acquisition",
        lambda port: port.abilities.acquisition is not None,
        "rate and jitter are those of the stamps",
    ),
)
"""Every ability, in the order in which it matters."""


def inspect_abilities(port: RigPort) -> Iterable[Finding]:
    """A line for each ability of an open rig; what it lacks is said, and is no fault."""
    for line in LINES:
        has = line.has(port)
        yield passed_if(
            line.name,
            has,
            "the rig has it" if has else f"the rig has none: {line.lack}",
            where="abilities",
            otherwise=Severity.NOT_LOOKED_AT,
        )
