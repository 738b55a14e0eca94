"""`rig import`: a recording of another rig made into a run, or looked at beforehand."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from rig.commands import import_flags as flags
from rig.commands.terminal import Json, echo, print_json
from rig.content.phrase import quoted

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from model.gear import HarmonicDrive
    from rig.runfile.importing.channel_map import ImportOptions, RunMap
    from rig.runfile.importing.channel_source import ChannelSource
    from rig.runfile.importing.convert import Imported
    from rig.runfile.importing.looking import Look


@flags.with_flags
def import_(words: flags.Words, said: flags.ImportFlags, json: Json = False) -> None:
    """Make a run of a recording from another rig, marked IMPORTED; every analysis then works on it
    or says what it lacks. Units, signs and ratios are asked for, never guessed.

    With a file alone it proposes what the columns are, with the evidence, and asks what stays open.
    """
    way = _ImportTask(
        is_named=bool(said.channel) or said.map_file is not None,
        stated={
            "modulus": _pairs(said.modulus, "--modulus"),
            "lag": _texts(said.lag, "--lag"),
            "accuracy": _texts(said.accuracy, "--accuracy"),
        },
        check=said.check,
        accept=said.accept,
        save_map=said.save_map,
        folder=said.output,
        opens=said.open_page,
        json=json,
    )
    _carry_out(*_kind_and_files(words), _runs(said.map_file, _options(said), way), way)


def _options(said: flags.ImportFlags) -> dict[str, Any]:
    """What was said of the recording, by the names of the options of an import."""
    from rig.runfile.importing.channel_source import parse_channel
    from rig.runfile.importing.suitability import is_of_tables

    return {
        "channels": tuple(parse_channel(text) for text in said.channel or ()),
        "rate": said.rate,
        "speed": said.speed,
        "no_time": said.no_time or is_of_tables(said.protocol),
        "time_base": said.time_base and said.time_base.value,
        "start_time": said.start,
        "drop_bad_rows": said.drop_bad_rows,
        "torque_constant": said.torque_constant,
        "delimiter": said.delimiter,
        "decimal": said.decimal,
        "skip": said.skip or None,
        "header": said.header or None,
        "is_ragged": said.ragged,
        "interpolate": said.interpolate,
        "gap": said.gap,
        "allow_jumps": said.allow_jumps,
        "ignore_headings": said.ignore_headings,
        "experiment": said.protocol,
        "title": said.title,
        "operator": said.operator,
        "gear": _gear_set(said.parameters),
        "gear_file": said.parameters,
        "gear_serial": said.gear,
        "gear_mounted": not said.no_gear,
        "ratio": _finite(said.ratio),
        "mounting": said.mounting and said.mounting.value,
        "output_sense": said.output_sense or None,
        "resonance_hz": said.resonance_hz,
        "load_inertia_kg_m2": said.load_inertia,
        "conditions": _pairs(said.condition, "--condition"),
    }


@dataclass(frozen=True, kw_only=True)
class _ImportTask:
    """How an import is carried out: channels named, only a look, proposals taken over and kept, where to, how told,
    and whether the page of it is opened; `stated` are range, lag and accuracy by channel.
    """

    is_named: bool
    stated: Mapping[str, Mapping[str, Any]]
    check: bool
    accept: bool
    save_map: Path | None
    folder: Path
    opens: bool
    json: bool


def _carry_out(
    kind: str, files: list[Path], runs: list[tuple[RunMap, ImportOptions]], way: _ImportTask
) -> None:
    """Look at the files, or make the runs; of what nobody named, what is proposed and accepted."""
    if way.is_named and (way.accept or way.save_map is not None):
        raise typer.BadParameter(
            "with -c or a map nothing is proposed", param_hint="--accept, --save-map"
        )
    if way.save_map is not None and (way.save_map.exists() or not way.save_map.parent.is_dir()):
        raise typer.BadParameter(
            f"{way.save_map}: is there already, or its folder is not", param_hint="--save-map"
        )
    if way.opens and (way.check or way.json or len(runs) > 1):
        raise typer.BadParameter(
            "opens the page of one recording that was imported: not with --check, --json, or a map of several",
            param_hint="--open",
        )
    if way.check:
        _check(kind, files, runs, json=way.json)
        return
    if not way.is_named:
        runs = [_proposed(kind, files, runs[0], way)]
    _import(kind, files, runs, way.folder, json=way.json)
    if way.json or len(runs) > 1:
        return
    from rig.library.folder import run_files
    from rig.runfile.importing.accepting import good_for

    good, newest = good_for(kind, files, runs[0][1]), run_files(way.folder)[-1]
    if good:
        echo(f"  good for {', '.join(good)}")
    if way.opens:
        _open_page(good, newest)
    elif good:
        echo(f"  next  rig fit {good[0]} {quoted(newest)}")


def _open_page(good: Sequence[str], run: Path) -> None:
    """Fit the first kind that the recording bears and open the page of it; a refusal is the sentence why not."""
    import webbrowser

    from experiments.errors import AnalysisError
    from rig.analysis.fit.recorded import store
    from rig.analysis.fit.run import fit_run
    from rig.gears.card import now_text
    from rig.present.build import report_on_files

    refused = (
        "its channels tell nothing that can be fitted: rig fit --help says what each kind needs"
    )
    for name in good:
        try:
            fit = fit_run(run, name)
        except AnalysisError as error:
            refused = f"{name}: {error}"
            continue
        store(fit, now_text())
        page = report_on_files([run], run.with_suffix(".html")).path
        echo(f"  page  {page}")
        webbrowser.open(page.absolute().as_uri())
        return
    echo(f"  no page: {refused}")


def _kind_and_files(words: Sequence[str]) -> tuple[str, list[Path]]:
    """The kind that was said, or that the first file tells, and the files."""
    from rig.runfile.importing.opening import formats, kind_of

    if words[0] in formats() and len(words) > 1:
        return words[0], [Path(word) for word in words[1:]]
    if words[0] in formats() and not Path(words[0]).exists():
        raise typer.BadParameter(
            f"which file? For instance: rig import {words[0]} FILE", param_hint="FILE"
        )
    files = [Path(word) for word in words]
    if len(words) > 1 and not files[0].suffix and not files[0].exists():
        raise typer.BadParameter(
            f"{words[0]!r} is not one of {', '.join(map(repr, formats()))}, and no file.",
            param_hint="KIND",
        )
    return kind_of(files[0]), files


def _proposed(
    kind: str,
    files: list[Path],
    run: tuple[RunMap, ImportOptions],
    way: _ImportTask,
) -> tuple[RunMap, ImportOptions]:
    """The run with the channels that were proposed and accepted. Raises `ConfigurationError` for what stays open."""
    from rig.commands import import_proposed as proposed
    from rig.runfile.importing import accepting
    from rig.runfile.importing.channel_map import check_said
    from rig.runfile.importing.opening import open_tables
    from rig.runfile.importing.proposal import propose
    from rig.runfile.importing.stated import with_stated

    name, options = run
    proposal = propose(open_tables(kind, files, options))
    if options.rate or options.no_time:
        proposal = accepting.without_time(proposal)
    if not way.json:
        proposed.show(proposal)
    said: tuple[ChannelSource, ...] = ()
    if way.accept or way.json or not proposed.asks():
        accepting.refuse_useless(proposal, files)
        accepting.refuse_open(proposal)
        if not way.accept:
            raise typer.BadParameter(
                "nobody is asked here: say --accept to take over what is proposed.",
                param_hint="--accept",
            )
    else:
        proposal = proposed.settled(proposal, proposed.ask_at_the_terminal)
        said = proposed.said_beside(proposed.ask_at_the_terminal)
    options = with_stated(accepting.accepted(options, proposal, said), **way.stated)
    # Before anything is written: a map of what is refused would stand in the way of the next try.
    check_said(options)
    if way.save_map is not None:
        way.save_map.write_text(accepting.map_text(options), encoding="utf-8")
    if not way.json:
        echo(f"  without a question: {accepting.command_of(kind, files, options)}")
    return name, options


def _runs(
    map_file: Path | None, said: Mapping[str, Any], way: _ImportTask
) -> list[tuple[RunMap, ImportOptions]]:
    """The runs of the map, or the one that needs none, each with its options; what was said goes before the map.

    What is stated of channels waits until there are some, where they are to be proposed.
    """
    from rig.runfile.importing.channel_map import RunMap, read_channel_map
    from rig.runfile.importing.stated import with_stated

    given = {key: value for key, value in said.items() if _is_said(key, value)}
    maps = read_channel_map(map_file) if map_file else (RunMap("", {}),)
    if not way.is_named:
        return [(one, one.options(given)) for one in maps]
    return [(one, with_stated(one.options(given), **way.stated)) for one in maps]


def _is_said(key: str, value: object) -> bool:
    """Whether a flag was given: what it holds without is left to the map."""
    if key == "gear_mounted":
        return value is False
    return value is not None and value is not False and value not in ("", (), {})


def _gear_set(path: Path | None) -> HarmonicDrive | None:
    """The parameter set that was named."""
    if path is None:
        return None
    from model.gear_file import load_gear

    return load_gear(path)


def _finite(ratio: float | None) -> float | None:
    """A ratio that is one: NaN stands for none said."""
    if ratio is not None and not math.isfinite(ratio):
        raise typer.BadParameter(f"{ratio} is no ratio", param_hint="--ratio")
    return ratio


def _import(
    kind: str,
    files: list[Path],
    runs: list[tuple[RunMap, ImportOptions]],
    output: Path,
    *,
    json: bool,
) -> None:
    """Make the runs, and say what came of each."""
    from rig.library.folder import claim_run
    from rig.runfile.importing.convert import import_tables
    from rig.runfile.importing.opening import open_tables

    made: list[Imported] = []
    for one, options in runs:
        serial = options.gear_serial or one.name or files[0].stem
        tables = open_tables(kind, files, options)
        recording = import_tables(
            tables,
            options,
            lambda o=options, s=serial: claim_run(output, o.experiment or "import", s).path,
        )
        made.append(recording)
        if not json:
            echo(f"{recording.rows} rows imported into {recording.path} (IMPORTED)")
            for note in recording.notes:
                echo("  " + note.replace("\n", "\n    "))
    if json:
        told = [
            {
                "run": str(recording.path),
                "rows": recording.rows,
                "rows_left_out": recording.dropped,
                "notes": recording.notes,
            }
            for recording in made
        ]
        _print_told(told)


def _print_told(told: list[dict[str, Any]]) -> None:
    """One run as an object of its own, several together in one."""
    print_json(told[0] if len(told) == 1 else {"runs": told})


def _check(
    kind: str, files: list[Path], runs: list[tuple[RunMap, ImportOptions]], *, json: bool
) -> None:
    """Show what the import would make of the files; nothing is written."""
    from rig.commands import import_proposed as proposed
    from rig.commands.import_tables import print_columns, print_look
    from rig.runfile.importing.looking import columns_of, look_at
    from rig.runfile.importing.opening import open_tables
    from rig.runfile.importing.proposal import propose

    told: list[dict[str, Any]] = []
    for one, options in runs:
        tables = open_tables(kind, files, options)
        if not options.channels:
            listed = columns_of(tables)
            notes = [note for table in tables for note in table.notes]
            proposal = propose(tables)
            told.append(
                {"columns": listed, "notes": notes, "proposal": proposed.proposal_object(proposal)}
            )
            if not json:
                print_columns(listed, notes)
                proposed.show(proposal)
            continue
        look = look_at(tables, options)
        told.append({"map": one.name, **_look_as_json(look, options)})
        if not json:
            print_look(one.name, look, options)
    if json:
        _print_told(told)


def _look_as_json(look: Look, options: ImportOptions) -> dict[str, Any]:
    """A look as one object; numbers that are not known are null."""
    from dataclasses import asdict

    from rig.runfile.importing.suitability import unsuited_for

    return {
        "rows": look.rows,
        "duration_s": look.duration_s,
        "rate_hz": look.rate_hz,
        "gaps": look.gaps,
        "channels": [asdict(channel) for channel in look.channels],
        "output_per_input": look.output_per_input,
        "problems": look.problems,
        "notes": look.notes,
        "good_for": {
            kind: {"ok": not why, "why": why} for kind, why in unsuited_for(look, options).items()
        },
        "segments": [asdict(segment) for segment in look.proposals],
    }


def _pairs(texts: list[str] | None, flag: str) -> dict[str, Any]:
    """NAME=VALUE pairs; values that are numbers are read as such."""
    return {name: _number_or_text(value) for name, value in _texts(texts, flag).items()}


def _texts(texts: list[str] | None, flag: str) -> dict[str, str]:
    """NAME=VALUE pairs."""
    pairs: dict[str, str] = {}
    for text in texts or ():
        name, equals, value = text.partition("=")
        if not equals or not name.strip():
            raise typer.BadParameter(f"{text!r}: write NAME=VALUE", param_hint=flag)
        pairs[name.strip()] = value.strip()
    return pairs


def _number_or_text(value: str) -> float | str:
    try:
        return float(value)
    except ValueError:
        return value
