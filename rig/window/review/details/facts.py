"""Conditions and calibration of a run as a page: parameters, limits, calibration of every channel, versions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from experiments.recording import Recording
from rig.content.grid import Fact, Grid
from rig.program import PROGRAM_KEYS, brought_by
from rig.runfile.facts import flat, limit_facts, parameter_facts
from rig.runfile.prevailing import acquisition_facts, calibration_grid, conditions_of, world_facts
from rig.window.review.words import facts_html, grid_html
from rig.window.shell.palette import Palette

_OF_THE_PROGRAM = (*PROGRAM_KEYS, "backend", "seed", "motor", "rig")


@dataclass(frozen=True)
class Facts:
    """What is known of a run besides its signals: facts under their headings, before and behind the calibration."""

    before: dict[str, Sequence[Fact]]
    calibration: Grid
    after: dict[str, Sequence[Fact]]

    def page(self, palette: Palette) -> str:
        """All of it as rich text."""
        before, after = (
            [
                facts_html(title, [(fact.title, fact.text) for fact in facts], palette)
                for title, facts in half.items()
            ]
            for half in (self.before, self.after)
        )
        return "".join((*before, grid_html(self.calibration, palette), *after))


def facts_of(recording: Recording) -> Facts:
    """The facts of a run; reads it once from end to end."""
    m = recording.metadata
    process = {name: m.process[name] for name in _OF_THE_PROGRAM if m.process.get(name)}
    if brought := brought_by(m.process):
        process["another package"] = "; ".join(brought)
    return Facts(
        {
            "Conditions": conditions_of(recording, m.gear if m.gear_mounted else None),
            "Parameters of the protocol": tuple(parameter_facts(m.experiment, m.parameters)),
        },
        calibration_grid(recording),
        {
            "Limits that held": tuple(limit_facts(m.limits)),
            "Acquisition": tuple(acquisition_facts(m.process.get("acquisition"))),
            "Program": (*flat("versions", process), *world_facts(m.process.get("world"))),
        },
    )
