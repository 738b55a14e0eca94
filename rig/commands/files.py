"""`rig runs`, `show`, `export`, `recover`, `verify`: what can be done with run files."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rig.commands.naming import RUNS, RunsFolder, run_meant
from rig.commands.sealing import Unsealed
from rig.commands.terminal import Json, echo, print_json

if TYPE_CHECKING:
    from experiments.recording import Recording
    from rig.analysis.judging import GearVerdict, JudgedRun
    from rig.library.index import IndexedRun

JsonFlag = Json
_RunArgument = Annotated[
    Path,
    typer.Argument(
        metavar="RUN", help="Run file (.h5), growing or dead (.h5.part), or its number in --runs."
    ),
]


class _TableFormat(str, Enum):  # noqa: UP042  StrEnum has another str() that shows in the help
    """Formats of tables of numbers."""

    csv = "csv"
    mat = "mat"
    parquet = "parquet"


_Place = Annotated[
    Path | None, typer.Argument(metavar="[DIR]", help="Folder of runs; runs without it.")
]

_Folder = Annotated[
    Path | None, typer.Option("--runs", metavar="DIR", help="The same, as everywhere else.")
]

_Text = Annotated[
    str, typer.Option(metavar="WORDS", help="Only runs in which every word is found somewhere.")
]

_Outcome = Annotated[
    str,
    typer.Option(metavar="WORD", help="Only runs that ended so: COMPLETED, ABORTED, TRIPPED, ..."),
]

_Origin = Annotated[
    str, typer.Option(metavar="WORD", help="hardware, simulated, replay or imported.")
]

_Since = Annotated[
    str | None, typer.Option(metavar="DAY", help="Only runs from this day on (YYYY-MM-DD).")
]

_Until = Annotated[
    str | None, typer.Option(metavar="DAY", help="Only runs up to this day, itself included.")
]

_Last = Annotated[
    int | None,
    typer.Option(
        min=0,
        metavar="N",
        help="Only the newest N of what was found; 0 is all. "
        "50 on a terminal, all with --json, unless said.",
    ),
]


def runs(
    place: _Place = None,
    folder: _Folder = None,
    text: _Text = "",
    gear: Annotated[str, typer.Option(metavar="SERIAL", help="Only runs of this gear.")] = "",
    protocol: Annotated[str, typer.Option(metavar="NAME", help="Only runs of this protocol.")] = "",
    outcome: _Outcome = "",
    origin: _Origin = "",
    since: _Since = None,
    until: _Until = None,
    last: _Last = None,
    json: JsonFlag = False,
) -> None:
    """List the runs of a folder and the folders in it: number, protocol, gear, when, outcome, verdict; unreadable
    ones with why.

    What the files say is kept in an index, which is only a cache: a large folder is searched at once.
    """
    from rig.commands.progress import reading_bar
    from rig.library.index import LibraryIndex

    folder = _folder_named(place, folder)
    with reading_bar("Reading the runs", quiet=json) as on_progress:
        index = LibraryIndex(folder, on_progress, nested=True)
        listed = index.search(
            text,
            gear=gear,
            protocol=protocol,
            outcome=outcome,
            since=_day(since, "--since"),
            until=_day(until, "--until"),
            origin=origin,
        )
    from rig.analysis.judging import judge_listed
    from rig.commands.listing import SHOWN, newest

    found = len(listed)
    most = 0 if json else SHOWN
    listed = newest(listed, most if last is None else last)
    judged = judge_listed(listed)
    if json:
        told = [_listed_as_json(run, judged.get(run.path)) for run in listed]
        listing = {"folder": str(folder), "index": index.rebuilt, "found": found}
        print_json({**listing, "not_looked_into": index.refused, "runs": told})
        return
    from rig.commands.file_tables import print_runs

    verdicts = {path: one.verdict for path, one in judged.items()}
    print_runs(folder, listed, verdicts, found=found, refused=index.refused)


def _folder_named(place: Path | None, folder: Path | None) -> Path:
    """The folder of runs, by the word or the option; `runs` where neither is said."""
    if place is not None and folder is not None and place != folder:
        raise typer.BadParameter(f"{folder}, and DIR is {place}: name one", param_hint="--runs")
    return place or folder or Path("runs")


def _day(text: str | None, flag: str) -> str | None:
    from datetime import datetime

    try:
        return None if text is None else (datetime.fromisoformat(text) and text)
    except ValueError:
        raise typer.BadParameter(f"{text!r} is no day; write YYYY-MM-DD", param_hint=flag) from None


def show(
    run: _RunArgument,
    frames: Annotated[
        bool,
        typer.Option(
            "--frames",
            help="The bus frames that were kept with the run, or of any log that python-can reads, in words.",
        ),
    ] = False,
    runs_folder: RunsFolder = RUNS,
    unsealed: Unsealed = False,
    json: JsonFlag = False,
) -> None:
    """Show a run: what, when, who, on which gear, outcome and verdict, channels with their ranges, segments, events."""
    run = run_meant(runs_folder, run)
    if frames:
        _show_frames(run, json)
        return
    from rig.analysis.judging import judge_file
    from rig.commands.file_tables import print_recording
    from rig.runfile.read import close_recording, open_run

    recording = open_run(run)
    try:
        verdict = judge_file(run, recording.metadata)
        if json:
            print_json(_recording_as_json(recording, run, verdict))
        else:
            print_recording(recording, run, verdict)
    finally:
        close_recording(recording)


def _show_frames(path: Path, json: bool) -> None:
    """The log of a run, or a log itself, played to the decoders."""
    from rig.commands.file_tables import print_frames
    from rig.errors import RunFileError
    from rig.run.frames import frames_of
    from rig.runfile.sealed import read_sealed
    from rig.trial.doctor.frames import play

    log = frames_of(path) if path.name.endswith((".h5", ".h5.part")) else path
    if log is not path:
        if not log.exists():
            raise RunFileError(
                "no frames were kept with this run",
                where=str(log),
                remedy="They are kept of runs that tripped and of stages of a commissioning.",
            )
        read_sealed(log)
    played = play(log)
    if json:
        print_json({"file": str(log), **played.as_json()})
    else:
        print_frames(played, log)


_Format = Annotated[
    _TableFormat | None,
    typer.Option(
        "--format",
        help="Text, MATLAB 5 or Parquet (extra: import); by the suffix of FILE without it, else text.",
    ),
]

_ExportFile = Annotated[
    Path | None,
    typer.Option("--output", "-o", metavar="FILE", help="Beside the run without it."),
]


def export(
    run: _RunArgument,
    format: _Format = None,
    output: _ExportFile = None,
    force: Annotated[
        bool, typer.Option("--force", help="Overwrite an export that is there already.")
    ] = False,
    runs_folder: RunsFolder = RUNS,
    unsealed: Unsealed = False,
    json: JsonFlag = False,
) -> None:
    """Write a run for other programs, in SI with units in the headings; SIMULATED or IMPORTED runs
    say so in the file.
    """
    from rig.runfile.export import export_csv, export_mat, export_parquet
    from rig.runfile.read import close_recording, open_run

    run = run_meant(runs_folder, run)
    written_as = _format_of(output, format)
    name = run.name.removesuffix(".part").removesuffix(".h5")
    target = output or run.with_name(f"{name}.{written_as.value}")
    recording = open_run(run)
    try:
        write = {
            _TableFormat.csv: export_csv,
            _TableFormat.mat: export_mat,
            _TableFormat.parquet: export_parquet,
        }[written_as]
        rows = write(recording, target, overwrite=force)
    finally:
        close_recording(recording)
    if json:
        print_json(
            {
                "run": recording.metadata.run_id,
                "file": str(target),
                "format": written_as.value,
                "rows": rows,
            }
        )
    else:
        echo(f"{rows} rows written to {target}")


def _format_of(output: Path | None, said: _TableFormat | None) -> _TableFormat:
    """What is written, by the option or the suffix. Raises `BadParameter` for a suffix that says something else."""
    if output is None:
        return said or _TableFormat.csv
    suffix = output.suffix.lower().removeprefix(".")
    allowed = [one.value for one in _TableFormat if said in (None, one)]
    if suffix not in allowed:
        raise typer.BadParameter(
            f"{output}: ends in .{' or .'.join(allowed)}", param_hint="--output"
        )
    return _TableFormat(suffix)


def recover(
    part: Annotated[
        list[Path],
        typer.Argument(
            metavar="PART|DIR...",
            help="Files (.h5.part) whose writer died, or folders in which all of them are taken.",
        ),
    ],
    json: JsonFlag = False,
) -> None:
    """Turn what a dead writer left behind into runs with outcome INTERRUPTED; says how many rows could be
    read, how many not, and what was cut.

    The .part stays beside its run, byte for byte, as .h5.part.kept. Only a file that is proved to hold
    nothing is taken away. Exit code 6 if one could not be made a run: it is left as it is.
    """
    from rig import exits
    from rig.commands.recovering import as_json, recover_all, words_of

    outcomes = recover_all(part)
    if json:
        print_json(as_json(outcomes))
    for outcome in outcomes:
        refused = outcome.error is not None
        if refused or not json:
            for line in words_of(outcome):
                echo(line, errors=refused)
    if not outcomes and not json:
        echo(f"Nothing to recover in {', '.join(map(str, part))}.")
    if any(outcome.error is not None for outcome in outcomes):
        raise typer.Exit(exits.ERROR)


def _listed_as_json(run: IndexedRun, judged: JudgedRun | None) -> dict[str, Any]:
    """A listed run with its verdict and its analysis in force, as `rig runs --json` tells it."""
    from rig.analysis.judging import verdict_as_json

    found = judged and judged.found
    return {
        **run.as_json(),
        **verdict_as_json(judged and judged.verdict),
        "analysis": found and found.analysis and found.as_json(),
    }


def _recording_as_json(
    recording: Recording, path: Path, verdict: GearVerdict | None = None
) -> dict[str, Any]:
    """Everything that `rig show` says of a run; no verdict of a file that is not sealed."""
    from rig.analysis.in_force import in_force_by_kind
    from rig.analysis.judging import verdict_as_json
    from rig.runfile.contents import moment

    m = recording.metadata
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
        "gear": m.gear.name if m.gear else "",
        "gear_serial": m.gear_serial,
        "ratio": m.ratio,
        "mounting": m.mounting,
        "output_sense": m.output_sense,
        "stated": {name: m.is_said(name) for name in ("mounting", "output_sense")},
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
        "channels": _channels_as_json(recording),
        "segments": [vars(segment) for segment in recording.segments],
        "events": [
            {
                "time": moment(e.time_ns),
                "level": e.level,
                "code": e.code,
                "source": e.source,
                "text": e.text,
            }
            for e in recording.events
        ],
    }


def _channels_as_json(recording: Recording) -> list[dict[str, Any]]:
    from rig.runfile.contents import channel_ranges

    return [
        {
            "name": name,
            "unit": signal.unit,
            "scale": signal.gain,
            "offset": signal.offset,
            "quantum": signal.quantum,
            "long_name": signal.long_name,
            "minimum": low,
            "maximum": high,
        }
        for (name, (low, high)), signal in zip(
            channel_ranges(recording).items(), recording.signals.values(), strict=True
        )
    ]
