"""Conditions and calibration of a run in words: parameters, conditions, limits, calibration of
every channel, versions.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from experiments.recording import Recording
from model.units import RPM
from rig.content.grid import Grid, columns
from rig.content.wording import number, readable
from rig.present.provenance import conditions_of, parameters_in_words, value_in_words
from rig.present.run_words import acquisition_facts, world_facts
from rig.program import PROGRAM_KEYS
from rig.runfile.header import RunHeader
from rig.runfile.read import read_run_header
from rig.window.review.words import facts_html, grid_html
from rig.window.shell.palette import Palette

Pairs = tuple[tuple[str, str], ...]
CALIBRATION_COLUMNS = columns(
    "channel",
    ("one count", "number"),
    ("unit", "unit"),
    ("scale uncertainty", "number"),
    ("accuracy", "number"),
    "certificate",
    "dated",
    "due",
    "device",
)
OF_THE_PROGRAM = (*PROGRAM_KEYS, "backend", "seed", "motor", "rig")


@dataclass(frozen=True)
class Facts:
    """What is known of a run besides its signals."""

    parameters: Pairs
    conditions: Pairs
    limits: Pairs
    calibration: Grid
    acquisition: Pairs
    program: Pairs

    def page(self, palette: Palette) -> str:
        """All of it as rich text."""
        return "".join(
            (
                facts_html("Conditions", self.conditions, palette),
                facts_html("Parameters of the protocol", self.parameters, palette),
                grid_html(self.calibration, palette),
                facts_html("Limits that held", self.limits, palette),
                facts_html("Acquisition", self.acquisition, palette),
                facts_html("Program", self.program, palette),
            )
        )


def facts_of(recording: Recording, path: Path) -> Facts:
    """The facts of a run; reads it once from end to end. Raises `RunFileError`."""
    m = recording.metadata
    header = read_run_header(path)
    parameters = parameters_in_words(m.experiment, m.parameters)
    program = tuple(
        (readable(name), value_in_words(m.process[name]))
        for name in OF_THE_PROGRAM
        if m.process.get(name) not in (None, "")
    )
    program += tuple(world_facts(m.process.get("world")))
    acquisition = tuple(acquisition_facts(m.process.get("acquisition")))
    conditions = conditions_of(recording, m.gear if m.gear_mounted else None)
    return Facts(
        parameters,
        conditions,
        _limits(header.limits),
        calibration_grid(header),
        acquisition,
        program,
    )


def calibration_grid(header: RunHeader) -> Grid:
    """One row per channel: what a count is worth and why that can be believed."""
    rows = []
    for c in (column.channel for column in header.columns):
        k = c.calibration
        relative = (
            "–"
            if k.scale_relative_uncertainty is None
            else f"{100.0 * k.scale_relative_uncertainty:.2g} %"
        )
        accuracy = "–" if k.accuracy is None else f"{number(k.accuracy, 2)} {c.unit}"
        quantum = number(c.quantum) if c.quantum else "–"
        device = " ".join(part for part in (c.model, c.serial_number) if part) or "–"
        due = (
            f"{k.due} (overdue)"
            if k.due and k.due < header.metadata.start_time[:10]
            else k.due or "–"
        )
        certificate = k.certificate or "–", k.date or "–", due
        rows.append((c.name, quantum, c.unit, relative, accuracy, *certificate, device))
    return Grid("Calibration of the channels", CALIBRATION_COLUMNS, rows)


def _limits(limits: Mapping[str, Any]) -> Pairs:
    rows = []
    for name, limit in limits.items():
        if isinstance(limit, Mapping) and isinstance(limit.get("value"), (int, float)):
            value, unit = float(limit["value"]), str(limit.get("unit", ""))
            shown = f"{number(value / RPM)} r/min" if unit == "rad/s" else f"{number(value)} {unit}"
            origin = ", ".join(
                str(limit[key]) for key in ("tier", "origin", "provenance") if limit.get(key)
            )
            rows.append((readable(name), f"{shown} ({origin})" if origin else shown))
        else:
            rows.append((readable(name), value_in_words(limit)))
    return tuple(rows)
