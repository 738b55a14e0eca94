"""`rig report` and `rig demo`: the page that a laboratory sends out, and the whole chain in one command."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from enum import Enum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rig.commands.analysis import Parameters
from rig.commands.judgement import AcceptanceFile, RequireVerdict, acceptance_said
from rig.commands.library import (
    Analyse,
    Baseline,
    FalseAlarms,
    Folders,
    OriginWord,
    Over,
    show_passport,
)
from rig.commands.naming import RUNS, runs_meant
from rig.commands.ordering import OF_MANY_RUNS, Said, with_order
from rig.commands.sealing import Unsealed
from rig.commands.terminal import Json, console, echo, print_json

if TYPE_CHECKING:
    from rig.present.build import Reports


_DEMONSTRATION = Path("rig-demo")
"""Where a demonstration goes, unless somebody says otherwise."""


class ReportFormat(str, Enum):  # noqa: UP042  StrEnum has another str() that shows in the help
    """What is written."""

    html = "html"
    pdf = "pdf"
    both = "both"


Runs = Annotated[
    list[Path] | None,
    typer.Argument(
        metavar="[RUN...]",
        help="Runs of one gear, in any order: files, or their numbers in --runs.",
    ),
]
Output = Annotated[
    Path | None,
    typer.Option(
        "--output",
        "-o",
        metavar="FILE",
        help="The file to write, .html or .pdf (report.html); with --per-run the folder for the files (reports).",
    ),
]
Format = Annotated[
    ReportFormat | None,
    typer.Option(
        "--format", help="Instead of the suffix of the file; both writes the two side by side."
    ),
]
_PerRun = Annotated[
    bool,
    typer.Option("--per-run", help="A report of its own for every run, into the folder --output."),
]
Gear = Annotated[
    str,
    typer.Option(
        "--gear",
        metavar="SERIAL",
        help="The report of a gear over its life, from the runs in --runs.",
    ),
]
_PassportHere = Annotated[
    bool,
    typer.Option(
        "--passport",
        help="With --gear: print it here, with what has changed, instead of writing a page; the exit code is 0.",
    ),
]
_AnewWithTare = Annotated[
    Path | None,
    typer.Option(
        "--tare",
        metavar="RUN",
        help="Analyse anew with this motor-tare run; found by itself without it.",
    ),
]
_AnewWithoutTare = Annotated[
    bool, typer.Option("--no-tare", help="Analyse anew, and subtract no tare.")
]
_Refit = Annotated[
    bool,
    typer.Option("--refit", help="Analyse every run anew instead of reading what is in force."),
]
Models = Annotated[
    bool,
    typer.Option(
        "--models",
        help="Judge the models of each protocol of which there are two runs or more by these, as `rig validate`.",
    ),
]


def _chosen_sections(text: str) -> tuple[str, ...]:
    """The sections that a list names. Raises `BadParameter` for a word that is none."""
    from rig.content.page import SECTIONS

    wanted = tuple(word.strip() for word in text.split(",") if word.strip())
    unknown = [word for word in wanted if word not in SECTIONS]
    if unknown:
        raise typer.BadParameter(
            f"{unknown[0]!r} is no section; there are {', '.join(SECTIONS)}",
            param_hint="--sections",
        )
    return wanted


_Sections = Annotated[
    str,
    typer.Option(
        "--sections",
        metavar="LIST",
        help="Only these, with commas between: results, numbers, truth, conditions, calibrations, provenance, "
        "definitions, scope, parameters, data; all without it. Verdict and warnings always stand.",
    ),
]


def report(
    runs: Runs = None,
    output: Output = None,
    format_: Format = None,
    per_run: _PerRun = False,
    gear: Gear = "",
    folders: Folders = None,
    passport: _PassportHere = False,
    analyse: Analyse = False,
    origin: OriginWord = "",
    false_alarms: FalseAlarms = None,
    over: Over = None,
    baseline: Baseline = None,
    tare: _AnewWithTare = None,
    no_tare: _AnewWithoutTare = False,
    refit: _Refit = False,
    parameters: Parameters = None,
    models: Models = False,
    sections: _Sections = "",
    acceptance: AcceptanceFile = "",
    require_verdict: RequireVerdict = False,
    unsealed: Unsealed = False,
    json: Json = False,
) -> None:
    """Write a self-contained report: verdict, figures, parameters with intervals and budgets, conditions, provenance.

    HTML or PDF, of all the runs together, of every run for itself, or of a gear over its life (its
    passport). The exit code is the verdict: 0 PASS or NOT JUDGED, 1 FAIL, 3 MARGINAL. Only runs from
    hardware have room for a signature; all others are marked on every page.
    """
    from rig.analysis.alarm.laboratory import watching_in_force
    from rig.exits import code_of_verdicts
    from rig.present.build import report_on_files, report_on_gear

    _refuse_together(runs, gear, models=models, per_run=per_run, passport=passport)
    if passport:
        watching = watching_in_force(false_alarms=false_alarms, over=over, baseline=baseline)
        show_passport(gear, folders, tare, origin, analyse=analyse, watching=watching, json=json)
        return
    if len(folders or ()) > 1:
        raise typer.BadParameter("a page is of the runs of one folder", param_hint="--runs")
    asked = acceptance_said(acceptance)
    wanted = _chosen_sections(sections)
    runs = runs_meant((folders or [RUNS])[0], runs or ())
    of_files = partial(
        report_on_files,
        sections=wanted,
        tare=tare,
        no_tare=no_tare,
        refit=refit,
        parameters=parameters,
        acceptance=asked,
    )
    if per_run and runs:
        places = _places_per_run(runs, output or Path("reports"), format_)
        reports = [of_files([run], paths) for run, paths in _told_of_each(places, quiet=json)]
    else:
        file = output or Path("report.html")
        paths = [file.with_suffix(suffix) for suffix in suffixes_of(file, format_)]
        if gear:
            (folder,) = folders or [Path("runs")]
            reports = [report_on_gear(folder, gear, paths, acceptance=asked, sections=wanted)]
        else:
            reports = [of_files(runs or [], paths, models=models)]
    _show(reports, json=json)
    verdicts = [one.verdict.verdict for one in reports]
    raise typer.Exit(code_of_verdicts(verdicts, required=require_verdict))


def _refuse_together(
    runs: Sequence[Path] | None, gear: str, *, models: bool, per_run: bool, passport: bool
) -> None:
    """Options that ask for different reports."""
    if bool(runs) == bool(gear):
        raise typer.BadParameter("name either runs or --gear SERIAL", param_hint="RUN... or --gear")
    if models and (gear or per_run):
        raise typer.BadParameter(
            "needs several runs in one report: leave --gear and --per-run out",
            param_hint="--models",
        )
    if passport and not gear:
        raise typer.BadParameter("is of a gear: name it with --gear", param_hint="--passport")


def _places_per_run(
    runs: Sequence[Path], folder: Path, format_: ReportFormat | None
) -> list[tuple[Path, list[Path]]]:
    """Each run with the files of its report. Raises `BadParameter` for a folder that is named as a file, and
    for runs whose reports would have one name.
    """
    from rig.present.page import SUFFIXES

    if folder.suffix.lower() in SUFFIXES:
        raise typer.BadParameter(
            f"{folder}: with --per-run it is a folder; --format chooses html, pdf or both",
            param_hint="--output",
        )
    suffixes = suffixes_of(folder / "report.html", format_)
    names = [run.name.split(".")[0] for run in runs]
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise typer.BadParameter(
            f"{twice[0]}: more than one run has this name, and so would their reports; make them one by one",
            param_hint="RUN...",
        )
    return [
        (run, [folder / f"{name}{suffix}" for suffix in suffixes])
        for run, name in zip(runs, names, strict=True)
    ]


def _told_of_each(
    places: list[tuple[Path, list[Path]]], *, quiet: bool
) -> Iterator[tuple[Path, list[Path]]]:
    """The runs one after the other, each told on the terminal as its turn comes."""
    for number, (run, paths) in enumerate(places, 1):
        if not quiet and len(places) > 1:
            echo(f"{number}/{len(places)} {run}", errors=True)
        yield run, paths


def _show(reports: Sequence[Reports], *, json: bool) -> None:
    """What was written and judged, for a person or for a program."""
    from rig.commands.result_tables import print_verdict

    lines = [line for one in reports for line in one.lines]
    if json:
        print_json(_as_object(reports, [path for one in reports for path in one.paths], lines))
        return
    for line in lines:
        echo(line)
    for one in reports:
        print_verdict(console(), one.verdict)


def _as_object(reports: Sequence[Reports], written: list[Path], lines: list[str]) -> dict[str, Any]:
    """What was written and what was judged; a report per run each with its own verdict."""
    files = {"files": [str(path) for path in written], "lines": lines}
    told = [_reports_object(one) for one in reports]
    return {**files, **told[0]} if len(told) == 1 else {**files, "reports": told}


def _reports_object(report: Reports) -> dict[str, Any]:
    outcomes = [{"run": fit.result.run, "outcome": fit.outcome} for fit in report.fits]
    return {"runs": outcomes, **report.verdict.as_json()}


def suffixes_of(output: Path, format_: ReportFormat | None) -> tuple[str, ...]:
    """The suffixes of what is to be written. Raises `ConfigurationError` for one that no report has."""
    from rig.present.page import suffix_of

    if format_ is ReportFormat.both:
        return (".html", ".pdf")
    if format_ is not None:
        return (f".{format_.value}",)
    return (suffix_of(output),)


@with_order(
    "folder",
    "seed",
    "world",
    world=OF_MANY_RUNS,
    folder=f"Folder for runs, report and parameter set; {_DEMONSTRATION}.",
    seed="Seed of the simulated bench, and serial number of the gear; 0.",
)
def demo(
    said: Said,
    json: Json = False,
    everything: Annotated[
        bool,
        typer.Option("--all", help="Every number beside the truth, every warning, every file."),
    ] = False,
) -> None:
    """Take a simulated gear through its acceptance, compare what was found with the truth, and certify it.

    Ctrl-C is a STOP (controlled ramp, what was recorded is kept), a second one an ABORT (quick stop).
    """
    from datetime import datetime

    from rig.commands.demo_tables import print_demonstration, progress
    from rig.exits import ABORTED, explain
    from rig.run.stop import StopRequest, pressed_by_signals
    from rig.trial.demo.chain import DemoOrder, demonstrate

    order = DemoOrder(
        **{"folder": _DEMONSTRATION, "seed": 0, **said},
        now=lambda: datetime.now().astimezone().isoformat(timespec="seconds"),
    )
    try:
        stop = StopRequest()
        with pressed_by_signals(stop), progress(quiet=json) as show:
            demonstration = demonstrate(order, stop=stop, show=show)
    except KeyboardInterrupt as stopped:
        # Caught here because the command-line library would make an exit code of its own out of it.
        code, sentence = explain(stopped) or (ABORTED, "")
        echo(sentence, errors=True)
        raise typer.Exit(code) from None
    if json:
        print_json(demonstration.as_json())
    else:
        print_demonstration(demonstration, everything=everything)
