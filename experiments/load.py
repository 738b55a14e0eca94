"""What the output carries: the inertia of a gear's own load, or that nobody stated it.

The shipped set's inertia is that of its own disc. Of another gear's load it says nothing: what rests on an inertia that
nobody stated is an assumed line, not a correction.
"""

from __future__ import annotations

from dataclasses import dataclass

from experiments.assumed import OUTPUT_INERTIA
from experiments.recording import Recording
from model.gear import HarmonicDrive, Origin
from model.gear_file import shipped_gear
from model.identify.estimate import BudgetLine

STATED = "stated with the recording"
"""Source of an inertia that came with an import."""
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


def _stated_inertia(recording: Recording) -> float | None:
    """Inertia at the output [kg m2] that was stated when the recording was imported; None where nobody did."""
    stated = recording.metadata.process.get("stated", {}).get("load_inertia_kg_m2")
    return None if stated is None else float(stated)


def carrying(recording: Recording, gear: HarmonicDrive) -> HarmonicDrive:
    """The parameter set with the inertia that was stated with the recording; as it is where nobody stated one.

    A recording that names no gear is analysed with the shipped set. Its stiffness is another gear's: with it the
    stated inertia would make a mode of which nobody knows anything.
    """
    inertia = _stated_inertia(recording)
    is_another = recording.metadata.gear is None and gear.name == shipped_gear().name
    if inertia is None or is_another:
        return gear
    return gear.with_values({"inertia.output": inertia}, Origin("measured", STATED))


def is_stated(recording: Recording, gear: HarmonicDrive) -> bool:
    """Whether somebody stated what the output of this recording carries: its card, a fit, or the simulation."""
    origin = gear.value("inertia.output").origin
    return origin.provenance not in UNSTATED or is_simulated(recording)


def load_of(recording: Recording, gear: HarmonicDrive) -> Load:
    """The load of a recording: as stated with it, else by the gear's own parameter set."""
    stated = _stated_inertia(recording)
    if stated is not None:
        return Load(inertia=stated)
    origin, inertia = gear.value("inertia.output").origin, gear.inertia.output
    return Load(
        inertia=inertia,
        relative_uncertainty=(origin.standard_uncertainty or 0.0) / inertia,
        is_stated=is_stated(recording, gear),
    )
