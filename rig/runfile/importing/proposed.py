"""A proposal of what the columns of a file are: columns with their evidence, and the questions that stay."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final, Literal

from rig.runfile.importing.channel_source import ChannelSource

ANGLES = ("input_angle", "output_angle", "position")
_TURNING = ANGLES[:2]
SPEEDS = ("input_speed", "output_speed", "speed")
EFFORTS = ("torque", "output_torque", "current", "motor_current", "force", "voltage")
NO_NUMBERS, BY_FILE = "no numbers", "the file says so"
COUNTS: Final = "counts per revolution"
Why = Literal["unit", "counts per revolution", "channel", "rate", "which"]


@dataclass(frozen=True, kw_only=True)
class ProposedColumn:
    """One column: its heading, the channel that it becomes ("" for one that is left out), its unit, and why.

    `meant` is the channel that it would be, were it not left out for another; `member` the joint or axis of several.
    """

    reference: str
    heading: str
    channel: str = ""
    meant: str = ""
    unit: str = ""
    member: str = ""
    file: str = ""
    evidence: tuple[str, ...] = ()

    @property
    def key(self) -> str:
        """Which column of which file."""
        return f"{self.reference}@{self.file}"

    @property
    def is_counted(self) -> bool:
        """Whether its numbers are counts."""
        return self.unit in ("count", "counts")

    def freed_of(self, channel: str) -> ProposedColumn:
        """The same column; left out where it is this channel."""
        return replace(self, channel="") if self.channel == channel else self


@dataclass(frozen=True)
class Question:
    """Something that stays open: what it asks of which column, and the answers that are usual."""

    why: Why
    about: str
    text: str
    usual: tuple[str, ...] = ()

    @property
    def by_evidence(self) -> str:
        """The answer that has evidence; "" leaves a column without a unit out."""
        if self.why == "which":
            return self.about
        return self.usual[0] if self.why == "channel" else ""


@dataclass(frozen=True)
class Proposal:
    """Columns, what the numbers say of the gear, and the questions that stay; `rate` [Hz] 0 where times are there."""

    columns: tuple[ProposedColumn, ...]
    questions: tuple[Question, ...]
    ratio: float = math.nan
    output_sense: int = 0
    is_table: bool = False
    counts: Mapping[str, float] = field(default_factory=dict)
    """Counts per revolution by channel, as somebody answered."""
    slopes: Mapping[str, float] = field(default_factory=dict)
    """By the angle's channel: how many of it go by in a second at 1 of its speed, where this is its derivative."""
    slope_of_angles: float = math.nan
    """Output angle over input angle, in the columns' own numbers."""
    rate: float = 0.0
    """Hz, as somebody answered."""

    @property
    def used(self) -> tuple[ProposedColumn, ...]:
        """The columns that become channels."""
        return tuple(column for column in self.columns if column.channel)

    @property
    def used_first(self) -> tuple[ProposedColumn, ...]:
        """All columns, those that become channels before the others."""
        return (*self.used, *(column for column in self.columns if not column.channel))

    @property
    def sources(self) -> tuple[ChannelSource, ...]:
        """The channels, as an import takes them."""
        return tuple(self._source(one) for one in self.used)

    def _source(self, one: ProposedColumn) -> ChannelSource:
        unit, scale = one.unit, self.counts.get(one.channel)
        if scale is not None and one.channel not in _TURNING:
            # Counts of a position may be of a scale: those of a turn are said as turns.
            unit, scale = "rev", 1.0 / scale
        return ChannelSource(
            name=one.channel, column=one.reference, unit=unit, file=one.file, scale=scale
        )

    @property
    def sentences(self) -> tuple[str, ...]:
        """What is proposed and why, one line a channel."""
        lines = [
            f"{one.channel} = {one.heading} [{one.unit or '?'}]: {'; '.join(one.evidence)}"
            for one in self.used
        ]
        if self.output_sense:
            way = "with" if self.output_sense > 0 else "against"
            turns = f", ratio {self.ratio:g}" if math.isfinite(self.ratio) else ""
            lines.append(
                f"the output angle counts {way} the input angle{turns}: both in proportion"
            )
        return tuple(lines)
