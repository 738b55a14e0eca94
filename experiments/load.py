"""What the output carries: the inertia of a gear's own load, or that nobody stated it.

The shipped set's inertia is that of its own disc. Of another gear's load it says nothing: what rests on an inertia that
nobody stated is an assumed line, not a correction.
"""

from __future__ import annotations

from dataclasses import dataclass

from experiments.assumed import OUTPUT_INERTIA
from experiments.recording import Recording
from model.gear import HarmonicDrive
from model.identify.estimate import BudgetLine

UNSTATED = ("assumed", "recalled")
"""Standings of an output inertia that nobody stated of this gear: it is that of another load."""


@dataclass(frozen=True, kw_only=True)
class Load:
    """Inertia at the output [kg m2], its relative standard uncertainty, and whether anybody stated it."""

    inertia: float
    relative_uncertainty: float = 0.0
    is_stated: bool = True

    def marked(self, line: BudgetLine) -> BudgetLine:
        """A line that rests on this inertia: assumed where nobody stated it."""
        return line if self.is_stated else OUTPUT_INERTIA.marked(line)


def is_simulated(recording: Recording) -> bool:
    """Whether a simulated output turned what its parameter set says, assumed or not."""
    metadata = recording.metadata
    return metadata.origin == "simulated" or "truth" in metadata.process


def is_stated(recording: Recording, gear: HarmonicDrive) -> bool:
    """Whether somebody stated what the output of this recording carries: its card, a fit, or the simulation."""
    origin = gear.value("inertia.output").origin
    return origin.provenance not in UNSTATED or is_simulated(recording)


def load_of(recording: Recording, gear: HarmonicDrive) -> Load:
    """The load of a recording by the gear's own parameter set."""
    origin, inertia = gear.value("inertia.output").origin, gear.inertia.output
    return Load(
        inertia=inertia,
        relative_uncertainty=(origin.standard_uncertainty or 0.0) / inertia,
        is_stated=is_stated(recording, gear),
    )
