"""How runs, their channels, segments and events are arranged on a screen."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from rig.commands.result_tables import print_verdict
from rig.commands.terminal import console, fact_table, painted
from rig.commands.visible import Text
from rig.content.grid import Fact, Grid, columns, number_columns
from rig.content.phrase import phrase
from rig.content.wording import duration_text
from rig.library.index import IndexedRun
from rig.program import brought_by
from rig.runfile.contents import channel_grid, event_grid, segment_grid
from rig.runfile.header import ORIGIN_WORDS

if TYPE_CHECKING:
    from experiments.recording import Recording
    from rig.analysis.judging import GearVerdict
    from rig.trial.doctor.frames import Played

_SHOWN_SEGMENTS = 24
_SHOWN_EVENTS = 20
WIDE = 110
"""Columns of a terminal from which on the list has room for gear and rows."""
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
    out.print(painted(_run_grid(folder, listed, verdicts, wide=out.width >= WIDE)))
    if found > len(listed):
        out.print(f"The newest {len(listed)} of {found} runs: --last 0 lists all, --text searches.")
    _print_below(out, listed)
    for verdict in (verdicts[run.path] for run in listed if run.path in verdicts):
        for words in verdict.stale:
            out.print(Text(words, style="yellow"), soft_wrap=True)


def _run_grid(
    folder: Path,
    listed: Sequence[IndexedRun],
    verdicts: Mapping[Path, GearVerdict],
    *,
    wide: bool,
) -> Grid:
    rows, words = [], {path: one.verdict for path, one in verdicts.items()}
    for run in listed:
        if run.problem:
            rows.append((_name(folder, run), "", "", "unreadable", "", "", ""))
            continue
        rows.append(
            (
                _name(folder, run).removesuffix(".h5"),
                run.start[:16].replace("T", " ") or "-",
                _lasted(run.duration),
                run.outcome or _STATE_WORDS[run.state],
                words.get(run.path, "-"),
                _gear_text(run.gear, run.gear_serial),
                str(run.rows),
            )
        )
    heads = columns(
        "run",
        ("started", "unit"),
        ("lasted", "number"),
        ("outcome", "word"),
        ("verdict", "word"),
        "gear",
        ("rows", "number"),
    )
    grid = Grid("", heads, rows)
    return grid if wide else grid.without("gear", "rows")


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


def print_recording(recording: Recording, path: Path, verdict: GearVerdict | None = None) -> None:
    """One run on one or two screens, with the verdict on what it measured."""
    out = console(highlight=True)
    m = recording.metadata
    mark = ORIGIN_WORDS[m.origin]
    out.print(
        Text(f"{m.run_id or path.name}", style="bold")
        + Text(phrase("  {}", mark), style="bold magenta")
        + Text("" if m.is_sealed else "  NOT SEALED", style="bold red")
    )
    out.print(fact_table(_facts(recording, path)))
    if verdict is not None:
        print_verdict(out, verdict)
    out.print(painted(channel_grid(recording)))
    segments, events = recording.segments, recording.events
    if segments:
        title = _cut("Segments", f"the first {_SHOWN_SEGMENTS}", len(segments) - _SHOWN_SEGMENTS)
        out.print(painted(segment_grid(segments[:_SHOWN_SEGMENTS], title)))
    if events:
        title = _cut("Events", f"the last {_SHOWN_EVENTS}", len(events) - _SHOWN_EVENTS)
        # A recording without a date has seconds since its first row, and no time of day.
        unknown = "time [s]" if recording.metadata.start_time else "time (UTC)"
        out.print(painted(event_grid(events[-_SHOWN_EVENTS:], title=title).without(unknown)))


def _cut(title: str, shown: str, left: int) -> str:
    return f"{title} ({shown}; {left} more with --json)" if left > 0 else title


def _gear_text(name: str, serial: str) -> str:
    return " ".join(part for part in (name, serial) if part) or "-"


def _facts(recording: Recording, path: Path) -> list[tuple[str, str]]:
    # A list of runs imports this module too, and needs none of these.
    from rig.runfile.facts import flat, parameter_facts
    from rig.runfile.prevailing import acquisition_facts, world_facts

    m = recording.metadata
    outcome = "unfinished" if path.name.endswith(".part") else "-"
    gear, mounting = "none mounted", ""
    if m.gear_mounted:
        ratio = "" if math.isnan(m.ratio) else f", ratio {m.ratio:g}"
        gear = _gear_text(m.gear.name if m.gear else "", m.gear_serial) + ratio
        way = "with" if m.output_sense > 0 else "against"
        mounting = m.mounting_said
        if m.is_said("output_sense"):
            mounting += f", output encoder counts {way} the input"
    backend = {k: m.process[k] for k in ("backend", "seed", "program_version") if k in m.process}
    made = (
        *world_facts(m.process.get("world")),
        *acquisition_facts(m.process.get("acquisition")),
    )
    facts = [
        ("file", str(path)),
        ("title", m.title),
        ("protocol", m.experiment or "-"),
        ("outcome", m.outcome or outcome),
        ("started", m.start_time or "-"),
        ("ended", m.end_time or "-"),
        ("operator", m.operator or "-"),
        ("gear", gear),
        ("mounting", mounting),
        ("rows", _row_text(recording)),
        ("backend", ", ".join(f"{name} {value}" for name, value in backend.items())),
        *(("another package", one) for one in brought_by(m.process)),
        *((fact.title, fact.text) for fact in made),
        ("parameters", _in_a_line(parameter_facts(m.experiment, m.parameters))),
        ("conditions", _in_a_line(flat("conditions", m.conditions))),
        ("SHA-256", m.seal),
    ]
    return [(name, text) for name, text in facts if text]


def _in_a_line(facts: Iterable[Fact]) -> str:
    return ", ".join(f"{fact.title} = {fact.text}" for fact in facts)


def _row_text(recording: Recording) -> str:
    """How many rows, how fast and how long, and in how many cycles something was missed."""
    m, rows = recording.metadata, recording.rows
    rate = "" if math.isnan(m.sample_rate) else f" at {m.sample_rate:g} Hz"
    total = float(recording.time(slice(rows - 1, rows))[0]) if rows else 0.0
    flagged = sum(int((recording.flags(block) != 0).sum()) for block in recording.blocks())
    missed = phrase(", {} cycles flagged", flagged)
    return f"{rows}{rate}, {duration_text(total)}, time base {m.time_base}{missed}"


def print_frames(played: Played, log: Path) -> None:
    """The frames of a bus: by COB-ID, what the nodes told, and the latest of them in words."""
    out = console()
    out.print(f"{log}: {played.frames} frames in {played.seconds:.1f} s")
    span = played.seconds or math.inf
    rows = [
        (
            f"0x{cob_id:03X}",
            one.what,
            str(one.sent or "-"),
            str(one.received or "-"),
            f"{max(one.sent, one.received) / span:.0f}",
            one.latest,
        )
        for cob_id, one in sorted(played.traffic.items())
    ]
    numbers = number_columns("sent", "received", "a second")
    headings = (*columns("COB-ID", "what"), *numbers, *columns("latest data"))
    out.print(painted(Grid("Frames", headings, rows)))
    told = [(f"{at:.3f}", event.level, event.source, event.text) for at, event in played.events]
    if told:
        headings = (*number_columns("s"), *columns("level", "from", ("what", "sentence")))
        out.print(painted(Grid("Told by the nodes", headings, told)))
    latest = [
        (f"{one.at:.4f}", "sent" if one.is_sent else "", f"0x{one.cob_id:03X}", one.data, one.words)
        for one in played.latest
    ]
    headings = (*number_columns("s"), *columns("", "COB-ID", "data", ("what it says", "sentence")))
    out.print(painted(Grid(f"The latest {len(latest)}", headings, latest)))
