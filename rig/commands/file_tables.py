"""How runs, their channels, segments and events look on a screen and as JSON."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.table import Table

from model.units import RPM
from rig.analysis.judging import verdict_as_json
from rig.commands.judgement import VERDICT_STYLE
from rig.commands.result_tables import print_verdict
from rig.commands.terminal import console, painted, table
from rig.commands.visible import Text
from rig.content.grid import Fact, Grid, columns
from rig.library.index import IndexedRun
from rig.runfile.header import ORIGIN_WORDS

if TYPE_CHECKING:
    from experiments.recording import Event, Recording, Segment
    from rig.analysis.judging import GearVerdict, JudgedRun

_SHOWN_SEGMENTS = 24
_SHOWN_EVENTS = 20
_LOOK: dict[str, Any] = {"box": None, "header_style": "bold", "pad_edge": False}
WIDE = 110
"""Columns of a terminal from which on the list has room for gear and rows."""
_OUTCOME_COLOURS = {"COMPLETED": "", "ABORTED": "yellow", "being written": "cyan", "-": ""}
_STATE_WORDS = {
    "being written": "being written",
    "left behind": "left behind",
    "sealed": "-",
}


def print_runs(
    folder: Path,
    listed: Sequence[IndexedRun],
    verdicts: Mapping[Path, GearVerdict],
    *,
    found: int,
    refused: Sequence[str] = (),
) -> None:
    """The list of a folder, or what a search found in it, each run with the verdict on what it measured.

    `found`: how many runs there are, of which the newest are listed; `refused`: folders that cannot be looked into.
    """
    out = console(highlight=True)
    for words in refused:
        out.print(Text(f"not looked into: {words}", style="bold red"))
    if not listed:
        out.print(f"No runs in {folder}.")
        return
    wide = out.width >= WIDE
    headings = ["run", "started", "lasted", "outcome", "verdict"]
    headings += ["gear", "rows"] if wide else []
    numbers, whole = ("lasted", "rows"), ("started", "lasted", "outcome", "verdict")
    runs = table(*headings, numbers=numbers, whole=whole, overflow="fold", **_LOOK)
    for run in listed:
        if run.problem:
            runs.add_row(_name(folder, run), Text("unreadable", style="bold red"))
            continue
        outcome = run.outcome or _STATE_WORDS[run.state]
        cells = [
            _name(folder, run).removesuffix(".h5"),
            run.start[:16].replace("T", " ") or "-",
            _lasted(run.duration),
            Text(outcome, style=_OUTCOME_COLOURS.get(outcome, "bold red")),
            _verdict_cell(verdicts.get(run.path)),
        ]
        if wide:
            cells += [_gear_text(run.gear, run.gear_serial), str(run.rows)]
        runs.add_row(*cells)
    out.print(runs)
    if found > len(listed):
        out.print(f"The newest {len(listed)} of {found} runs: --last 0 lists all, --text searches.")
    _print_below(out, listed)
    for run in listed:
        verdict = verdicts.get(run.path)
        for words in verdict.stale if verdict is not None else ():
            out.print(Text(words, style="yellow"), soft_wrap=True)


def _name(folder: Path, run: IndexedRun) -> str:
    """The file of a run as it is found from the folder that is listed."""
    return run.path.relative_to(folder).as_posix()


def _print_below(out: Console, listed: Sequence[IndexedRun]) -> None:
    """What needs more room than a column: files that cannot be read, and where the runs are from."""
    for run in listed:
        if run.problem:
            out.print(Text(f"{run.path.name}: unreadable: {run.problem}", style="bold red"))
        elif run.state == "left behind":
            out.print(
                Text(
                    f"{run.path.name}: unfinished, left behind by a program that died: rig recover",
                    style="bold red",
                )
            )
    origins: dict[str, list[str]] = {}
    for run in listed:
        mark = ORIGIN_WORDS.get(run.origin, run.origin)
        if mark and not run.problem:
            origins.setdefault(mark, []).append(run.path.name.removesuffix(".h5"))
    for mark, names in origins.items():
        every = "all of them" if len(names) == len(listed) else ", ".join(names)
        out.print(Text(f"{mark}: {every}", style="bold magenta"))


def _lasted(seconds: float) -> str:
    """A duration in hours, minutes and seconds as clocks show it."""
    if not math.isfinite(seconds):
        return "-"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


def _verdict_cell(verdict: GearVerdict | None) -> Text:
    word = "-" if verdict is None else verdict.verdict
    return Text(word, style=VERDICT_STYLE.get(word, ""))


def print_recording(recording: Recording, path: Path, verdict: GearVerdict | None = None) -> None:
    """One run on one or two screens, with the verdict on what it measured."""
    out = console(highlight=True)
    m = recording.metadata
    mark = ORIGIN_WORDS[m.origin]
    out.print(
        Text(f"{m.run_id or path.name}", style="bold")
        + Text(f"  {mark}" if mark else "", style="bold magenta")
        + Text("" if m.is_sealed else "  NOT SEALED", style="bold red")
    )
    facts = Table(box=None, show_header=False, pad_edge=False)
    facts.add_column(style="dim")
    facts.add_column(overflow="fold")
    for name, text in _facts(recording, path):
        facts.add_row(name, text)
    out.print(facts)
    if verdict is not None:
        print_verdict(out, verdict)
    for grid in (
        _channel_grid(recording),
        _segment_grid(recording.segments),
        _event_grid(recording.events),
    ):
        if grid.rows:
            out.print(painted(grid, title=grid.title, box=None, header_style="bold"))


def recording_as_json(
    recording: Recording, path: Path, verdict: GearVerdict | None = None
) -> dict[str, Any]:
    """Everything that `rig show` says of a run; no verdict of a file that is not sealed."""
    from rig.analysis.in_force import in_force_by_kind

    m = recording.metadata
    ranges = _channel_ranges(recording)
    return {
        "run": m.run_id,
        "file": str(path),
        "title": m.title,
        "protocol": m.experiment,
        "origin": m.origin,
        "outcome": m.outcome,
        **(verdict.as_json() if verdict is not None else verdict_as_json(None)),
        "started": m.start_time,
        "ended": m.end_time,
        "operator": m.operator,
        "gear": _run_gear(m.gear),
        "gear_serial": m.gear_serial,
        "ratio": m.ratio,
        "mounting": m.mounting,
        "output_sense": m.output_sense,
        "gear_mounted": m.gear_mounted,
        "rows": recording.rows,
        "sample_rate": m.sample_rate,
        "time_base": m.time_base,
        "analyses": [found.as_json() for found in in_force_by_kind(path).values()],
        "sha256": m.sha256,
        "sealed": m.is_sealed,
        "parameters": m.parameters,
        "conditions": m.conditions,
        "process": {k: v for k, v in m.process.items() if k != "truth"},
        "channels": [
            {
                "name": s.name,
                "unit": s.unit,
                "scale": s.gain,
                "offset": s.offset,
                "quantum": s.quantum,
                "long_name": s.long_name,
                "minimum": ranges[s.name][0],
                "maximum": ranges[s.name][1],
            }
            for s in recording.signals.values()
        ],
        "segments": [
            {
                "index": s.index,
                "label": s.label,
                "start": s.start,
                "stop": s.stop,
                "setpoint": s.setpoint,
                "direction": s.direction,
                "repeat": s.repeat,
            }
            for s in recording.segments
        ],
        "events": [
            {
                "time": _moment(e.time_ns),
                "level": e.level,
                "code": e.code,
                "source": e.source,
                "text": e.text,
            }
            for e in recording.events
        ],
    }


def _channel_ranges(recording: Recording) -> dict[str, tuple[float, float]]:
    """Smallest and largest SI value of every channel, in constant memory; NaN for a run without rows."""
    ranges: dict[str, tuple[float, float]] = {}
    for name in recording.signals:
        low, high = math.inf, -math.inf
        for block in recording.blocks():
            values = recording.si(name, block)
            low, high = min(low, float(values.min())), max(high, float(values.max()))
        ranges[name] = (low, high) if low <= high else (math.nan, math.nan)
    return ranges


def listed_as_json(run: IndexedRun, judged: JudgedRun | None) -> dict[str, Any]:
    """A listed run with its verdict and its analysis in force, as `rig runs --json` tells it."""
    found = judged and judged.found
    return {
        **run.as_json(),
        **verdict_as_json(judged and judged.verdict),
        "analysis": found.as_json() if found and found.analysis is not None else None,
    }


def _run_gear(gear: Any) -> str:
    """The part number of a gear, "" without one."""
    return gear.name if gear is not None else ""


def _gear_text(name: str, serial: str) -> str:
    return " ".join(part for part in (name, serial) if part) or "-"


def _facts(recording: Recording, path: Path) -> list[tuple[str, str]]:
    # A list of runs imports this module too, and needs none of these.
    from rig.content.wording import duration_text
    from rig.runfile.facts import flat, parameter_facts
    from rig.runfile.prevailing import acquisition_facts, world_facts

    m = recording.metadata
    ratio = "" if math.isnan(m.ratio) else f", ratio {m.ratio:g}"
    mounted = f"{m.mounting}, output encoder counts {'with' if m.output_sense > 0 else 'against'} the input"
    rate = "" if math.isnan(m.sample_rate) else f" at {m.sample_rate:g} Hz"
    flagged = _flagged(recording)
    total = (
        float(recording.time(slice(recording.rows - 1, recording.rows))[0])
        if recording.rows
        else 0.0
    )
    missed = f", {flagged} cycles flagged" if flagged else ""
    made = (
        *world_facts(m.process.get("world")),
        *acquisition_facts(m.process.get("acquisition")),
    )
    facts = [
        ("file", str(path)),
        ("title", m.title),
        ("protocol", m.experiment or "-"),
        ("outcome", m.outcome or ("unfinished" if path.name.endswith(".part") else "-")),
        ("started", m.start_time or "-"),
        ("ended", m.end_time or "-"),
        ("operator", m.operator or "-"),
        (
            "gear",
            f"{_gear_text(_run_gear(m.gear), m.gear_serial)}{ratio}"
            if m.gear_mounted
            else "none mounted",
        ),
        ("mounting", mounted if m.gear_mounted else ""),
        (
            "rows",
            f"{recording.rows}{rate}, {duration_text(total)}, time base {m.time_base}{missed}",
        ),
        (
            "backend",
            ", ".join(
                f"{k} {m.process[k]}"
                for k in ("backend", "seed", "program_version")
                if k in m.process
            ),
        ),
        *((fact.title, fact.text) for fact in made),
        ("parameters", _in_a_line(parameter_facts(m.experiment, m.parameters))),
        ("conditions", _in_a_line(flat("conditions", m.conditions))),
        ("SHA-256", m.seal),
    ]
    return [(name, text) for name, text in facts if text]


def _flagged(recording: Recording) -> int:
    return sum(int((recording.flags(block) != 0).sum()) for block in recording.blocks())


def _in_a_line(facts: Iterable[Fact]) -> str:
    return ", ".join(f"{fact.title} = {fact.text}" for fact in facts)


def _channel_grid(recording: Recording) -> Grid:
    ranges, rows = _channel_ranges(recording), []
    for name, signal in recording.signals.items():
        quantum = f"{signal.quantum:.4g}" if signal.quantum else "-"
        extremes = (f"{value:.6g}" for value in ranges[name])
        rows.append((name, signal.long_name, signal.unit, quantum, *extremes))
    heads = columns(
        "channel",
        "what",
        ("unit", "unit"),
        ("one count", "number"),
        ("minimum", "number"),
        ("maximum", "number"),
    )
    return Grid("Channels", heads, rows)


def _segment_grid(segments: Sequence[Segment]) -> Grid:
    rows = [
        (
            str(s.index),
            s.label,
            str(s.start),
            str(s.stop),
            f"{s.setpoint:.6g}",
            f"{s.setpoint / RPM:.5g}" if s.setpoint else "-",
            f"{s.direction:+d}",
            str(s.repeat),
        )
        for s in segments[:_SHOWN_SEGMENTS]
    ]
    left = len(segments) - _SHOWN_SEGMENTS
    more = f" (the first {_SHOWN_SEGMENTS}; {left} more with --json)" if left > 0 else ""
    heads = columns(
        ("#", "number"),
        "label",
        ("from row", "number"),
        ("to row", "number"),
        ("set-point (SI)", "number"),
        ("r/min", "number"),
        ("direction", "number"),
        ("repeat", "number"),
    )
    return Grid(f"Segments{more}", heads, rows)


def _event_grid(events: Sequence[Event]) -> Grid:
    rows = [
        (_moment(e.time_ns)[11:23], e.level, e.code, e.source, e.text)
        for e in events[-_SHOWN_EVENTS:]
    ]
    left = len(events) - _SHOWN_EVENTS
    more = f" (the last {_SHOWN_EVENTS}; {left} more with --json)" if left > 0 else ""
    heads = columns("time (UTC)", ("level", "word"), "code", "source", "text")
    return Grid(f"Events{more}", heads, rows)


def _moment(time_ns: int) -> str:
    return datetime.fromtimestamp(time_ns // 1_000_000 / 1e3, UTC).isoformat(
        timespec="milliseconds"
    )
