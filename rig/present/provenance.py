"""Where a report's numbers come from: the identity of every run, the conditions that prevailed, how it was analysed."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rig.analysis.fit.recorded import NOT_SEALED
from rig.content.grid import Fact, Grid, columns
from rig.content.page import Section
from rig.program import EXTENSIONS, brought_by
from rig.runfile.facts import ELSEWHERE, flat, parameter_facts
from rig.runfile.prevailing import alarms_of, certificates_of, conditions_of, world_facts

if TYPE_CHECKING:
    from experiments.recording import Recording
    from rig.analysis.fit.recorded import Fit

LONG = 200
"""Letters of a fact above which it is no line of a table."""


@dataclass(frozen=True)
class Provenance:
    """Where one run comes from: facts by the heading under which they stand beside those of other runs."""

    rows: tuple[Fact, ...] = ()
    conditions: tuple[Fact, ...] = ()
    settings: tuple[Fact, ...] = ()
    options: tuple[Fact, ...] = ()
    calibrations: tuple[Fact, ...] = ()
    alarms: tuple[str, ...] = ()
    """What makes the run's scales doubtful, and a file that could still change."""


_MATRIX_COLUMNS = 4
"""Runs that fit side by side on A4."""


def _side_by_side(facts: Sequence[tuple[str, Sequence[Fact]]], title: str = "") -> tuple[Grid, ...]:
    """Facts of several runs, each under its heading, side by side, at most four to a table; runs
    without any are left out. Facts that most runs do not have stand one by one, each with the runs that have it.
    """
    runs = [(heading, {f.title: f.text for f in rows}) for heading, rows in facts if rows]
    told = sum(len(texts) for _, texts in runs)
    if 2 * told < len(runs) * len({name for _, texts in runs for name in texts}):
        return (_one_by_one(runs, title),)
    grids = []
    for first in range(0, len(runs), _MATRIX_COLUMNS):
        shown = runs[first : first + _MATRIX_COLUMNS]
        names = dict.fromkeys(name for _, texts in shown for name in texts)
        rows = [(name, *(texts.get(name, "–") for _, texts in shown)) for name in names]
        heads = columns(("", "name"), *(heading for heading, _ in shown))
        grids.append(Grid(title, heads, rows))
    return tuple(grids)


def _one_by_one(runs: Sequence[tuple[str, Mapping[str, str]]], title: str) -> Grid:
    """Each fact once for every value that it has, and of which runs."""
    rows = []
    for name in dict.fromkeys(name for _, texts in runs for name in texts):
        of: dict[str, list[str]] = {}
        for heading, texts in runs:
            if name in texts:
                of.setdefault(texts[name], []).append(heading)
        for text, headings in of.items():
            rows.append((name, text, ", ".join(headings) if len(headings) < len(runs) else "all"))
    return Grid(title, columns(("", "name"), "is", "of"), rows)


def provenance_sections(
    sources: Sequence[tuple[str, Provenance]], files: Grid | None, runs: str = "Runs"
) -> Iterator[Section]:
    """Conditions, calibrations and provenance of all runs, one column each; what is empty is left out."""

    def beside(name: str, title: str = "") -> tuple[Grid, ...]:
        return _side_by_side([(heading, getattr(one, name)) for heading, one in sources], title)

    origin = (
        *((files,) if files is not None else ()),
        *beside("rows", runs),
        *beside("options", "Conventions of the analyses"),
        *beside("settings", "Parameters of the protocols and settings of the analyses"),
    )
    for title, grids in (
        ("Conditions", beside("conditions")),
        ("Calibrations", beside("calibrations")),
        ("Provenance", origin),
    ):
        if grids:
            yield Section(title=title, anchor=title.lower(), grids=grids)


def provenance_of(fit: Fit) -> Provenance:
    """The run's identity and how it was analysed."""
    m, recording = fit.recording.metadata, fit.recording
    return Provenance(
        tuple(_identity(fit)),
        conditions_of(recording, fit.gear if fit.gear_known and m.gear_mounted else None),
        tuple(parameter_facts(m.experiment, {**m.parameters, **fit.settings})),
        tuple(flat("options", fit.result.options, _OPTION_UNITS)),
        tuple(certificates_of(recording)),
        tuple(doubts_about(recording)),
    )


def doubts_about(recording: Recording) -> Iterator[str]:
    """Sentences for the top of a report: a file without a seal, and what makes its scales doubtful."""
    if not recording.metadata.is_sealed:
        yield NOT_SEALED
    yield from alarms_of(recording)


def _identity(fit: Fit) -> Iterator[Fact]:
    """Who, what, when and on what, and the program; without long texts and the truth of a simulated rig."""
    m = fit.recording.metadata
    mounted = "none mounted"
    if m.gear_mounted:
        gear = fit.gear.name if fit.gear_known else "not stated"
        mounted = f"{gear}, serial {m.gear_serial or 'not stated'}"
    texts = {
        "run": m.run_id,
        "protocol": m.experiment or "none (recording from another rig)",
        "origin": m.origin,
        "outcome of the run": m.outcome,
        "started": _moment(m.start_time),
        "ended": _moment(m.end_time),
        "operator": m.operator,
        "gear": mounted,
        "mounting": m.mounting_said.replace("-", " ") if m.gear_mounted else "none",
        "file": fit.path.name if fit.path else "in memory",
        "analysis": fit.stored or "not stored",
        "tare": tare_of(fit),
    }
    for title, text in texts.items():
        yield Fact(title, text or "not stated", "", "run")
    process = {
        name: value
        for name, value in m.process.items()
        if (name not in ELSEWHERE or name == "planned_duration")
        and not isinstance(value, Mapping)
        and name != EXTENSIONS
        and len(str(value)) <= LONG
    }
    yield from flat("run", process, {"planned_duration": "s"})
    for one in brought_by(m.process):
        yield Fact("another package", one, "", "run")
    yield from world_facts(m.process.get("world"))


def tare_of(fit: Fit) -> str:
    """The tare that was subtracted, in words: its run, or none; of a stored analysis as it says itself."""
    if fit.tare is not None:
        return f"run {fit.tare.recording.metadata.run_id}"
    named = str(fit.result.options.get("tare_run") or "none")
    return "none" if named == "none" else f"run {named}"


_OPTION_UNITS = {"phase_reference_angle": "rad"}
"""SI units of the conventions that are quantities."""


def _moment(text: str) -> str:
    """A time as it is read: date and time to the second, with its zone."""
    return re.sub(r"(?<=:\d\d)[.]\d+", "", text).replace("T", " ", 1)
