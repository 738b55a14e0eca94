"""`rig fit`: identify a model from runs; and a parameter set held against a run (`rig validate --against`)."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rig.commands.judgement import (
    AcceptanceFile,
    RequireVerdict,
    judged_run,
    refuse_unknown_acceptance,
)
from rig.commands.naming import RUNS, RunsFolder, is_name, run_meant, runs_meant
from rig.commands.sealing import Unsealed
from rig.commands.terminal import Json, console, echo, painted, print_json
from rig.content.phrase import phrase
from rig.errors import nearest

if TYPE_CHECKING:
    from collections.abc import Sequence

    from experiments.result import Result
    from model.gear import HarmonicDrive
    from rig.analysis.adopt import Comparison
    from rig.analysis.fit.recorded import Fit
    from rig.analysis.fit.run import Choices
    from rig.analysis.judging import GearVerdict

Parameters = Annotated[
    Path | None,
    typer.Option(
        "--parameters", metavar="FILE", help="Parameter set (TOML) instead of the run's own."
    ),
]
Tare = Annotated[
    Path | None,
    typer.Option(
        "--tare",
        metavar="RUN",
        help="Motor-tare run (gear removed) that is subtracted; found by itself without this.",
    ),
]
NoTare = Annotated[
    bool, typer.Option("--no-tare", help="Subtract no tare, also where one would be found.")
]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="A setting of the analysis, for instance channel=torque.",
    ),
]
MissedShare = Annotated[
    float | None,
    typer.Option(
        "--largest-missed-share",
        min=0.0,
        max=1.0,
        metavar="SHARE",
        help="Share of missed cycles above which a run is refused (0.001 unless given).",
    ),
]


_Words = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="[KIND] RUN...",
        help="Kind of fit (optional), then one or more runs: files, or their numbers in --runs.",
    ),
]
_ParametersOut = Annotated[
    Path | None,
    typer.Option(
        "--parameters-out",
        metavar="FILE",
        help="Write the parameter set with what was identified (TOML).",
    ),
]
_Plots = Annotated[
    bool, typer.Option("--plots", help="With --json: figures and tables as data too.")
]
_Stored = Annotated[
    bool,
    typer.Option(
        "--store/--no-store",
        " /--no-keep",
        help="Append the analysis to the store beside the run, or leave no trace.",
    ),
]
_Keep = Annotated[
    int | None,
    typer.Option(
        "--keep",
        metavar="NUMBER",
        min=0,
        help="Fit nothing: put this stored analysis of RUN in force, by hand; 0 takes the choice back.",
    ),
]
_Everything = Annotated[
    bool, typer.Option("--all", help="The statistical part of every interval too.")
]
_Help = Annotated[
    bool, typer.Option("--help", "-h", help="Show this, and with a KIND its settings, and exit.")
]


def fit(
    context: typer.Context,
    words: _Words = None,
    tare: Tare = None,
    no_tare: NoTare = False,
    parameters: Parameters = None,
    parameters_out: _ParametersOut = None,
    setting: Settings = None,
    largest_missed_share: MissedShare = None,
    plots: _Plots = False,
    stored: _Stored = True,
    keep: _Keep = None,
    by: Annotated[str, typer.Option("--by", metavar="NAME", help="Who chooses, with --keep.")] = "",
    acceptance: AcceptanceFile = "",
    require_verdict: RequireVerdict = False,
    everything: _Everything = False,
    runs_folder: RunsFolder = RUNS,
    unsealed: Unsealed = False,
    json: Json = False,
    show_help: _Help = False,
) -> None:
    """Identify a model from one or more runs; the kind follows from the run's protocol unless given.

    Kinds: kinematic-error, friction, velocity-steps, motor-tare, torque-scale, warm-up, starting-torque,
    home, compensated-error, and for any recording motion (inertia and friction), friction-curve (a table
    of speed and torque), revolution (Fourier series per revolution), order-spectrum, skew (delay between
    two channels) and hysteresis (loops of output torque).

    The exit code is the verdict by the acceptance file of the gear:
    0 PASS or NOT JUDGED, 1 FAIL, 3 MARGINAL, 7 NOT JUDGED under --require-verdict.
    rig fit KIND --help lists the settings of one kind.
    """
    if show_help:
        from rig.commands.run_tables import print_settings

        print_settings(context, words or [])
        return
    if not words:
        raise typer.BadParameter("which run? For instance: rig fit RUN.h5", param_hint="RUN")
    from rig.analysis.fit.run import fit_run
    from rig.exits import code_of_verdicts

    kind, typed = split_kind(words)
    runs = runs_meant(runs_folder, typed)
    tare = tare and run_meant(runs_folder, tare)
    if keep is not None:
        _keep_by_hand(kind, runs, keep, by, json=json)
        return
    choices = choices_of_flags(
        parameters, tare, setting, no_tare=no_tare, largest_missed_share=largest_missed_share
    )
    refuse_unknown_acceptance(acceptance)
    fits = tuple(fit_run(run, kind, choices) for run in runs)
    fits, notes = _store(fits) if stored else (fits, [])
    if parameters_out is not None:
        notes.append(_adopted_into(parameters_out, fits))
    verdicts = [judged_run(one, one.path, acceptance) for one in fits]
    if json:
        print_json(_as_object(fits, verdicts, plots=plots))
    else:
        _print_fits(fits, verdicts, notes, everything=everything)
    raise typer.Exit(code_of_verdicts([v.verdict for v in verdicts], required=require_verdict))


# Its help is its own: with a kind it shows what that kind lets one choose.
fit.__dict__["context_settings"] = {"help_option_names": []}


def _adopted_into(file: Path, fits: Sequence[Fit]) -> str:
    """Write a parameter set with what the fits identified; a line about it."""
    from model.gear_file import save_gear
    from rig.analysis.adopt import adopt

    adopted = adopt(fits[-1].gear, [f.result for f in fits])
    save_gear(adopted.gear, file)
    return f"{file}: {len(adopted.changed)} identified values written"


def compare(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Run file.")],
    parameters: Annotated[
        Path,
        typer.Option(
            "--parameters", metavar="FILE", help="Parameter set (TOML) to hold against it."
        ),
    ],
    kind: Annotated[
        str, typer.Option(help="Kind of fit, where the run's protocol does not say it.")
    ] = "",
    tare: Tare = None,
    no_tare: NoTare = False,
    setting: Settings = None,
    largest_missed_share: MissedShare = None,
    unsealed: Unsealed = False,
    json: Json = False,
) -> None:
    """Hold a parameter set against a run: what it predicts, what was measured, and how far apart they are."""
    choices = choices_of_flags(
        parameters, tare, setting, no_tare=no_tare, largest_missed_share=largest_missed_share
    )
    hold_against(run, parameters, kind, choices, json=json)


def hold_against(run: Path, parameters: Path, kind: str, choices: Choices, *, json: bool) -> None:
    """Print what a parameter set, which the choices hold, predicts of a run, beside what was measured."""
    from rig.analysis.adopt import compare_with
    from rig.analysis.fit.digest import told_tare
    from rig.analysis.fit.recorded import score
    from rig.analysis.fit.run import fit_run

    gear = choices.gear
    assert gear is not None
    fitted = fit_run(run, kind, choices)
    rows = compare_with(gear, fitted.result)
    scored = score(fitted)
    if json:
        values = {
            "run": fitted.result.run,
            "kind": fitted.result.kind,
            "parameter_set": gear.name,
            "parameters_file": str(parameters),
            "tare": told_tare(fitted),
            "comparison": {row.path: row.as_json() for row in rows},
            "metrics": dict(scored.metrics),
            "warnings": list(dict.fromkeys((*scored.warnings, *fitted.result.warnings))),
        }
        print_json(values)
        return
    _print_comparison(fitted, scored, gear, rows)


def split_kind(words: list[str]) -> tuple[str, list[Path]]:
    """KIND and RUNs: the first word is a kind if it is one and no file of that name is there."""
    from experiments import catalogue

    first, rest = words[0], words[1:]
    if first in catalogue.kinds() and not Path(first).is_file():
        if not rest:
            raise typer.BadParameter(
                f"which run? For instance: rig fit {first} RUN.h5", param_hint="RUN"
            )
        return first, [Path(w) for w in rest]
    is_a_run = Path(first).exists() or is_name(first) or any(c in first for c in "./\\")
    if rest and not is_a_run:
        raise typer.BadParameter(
            f"{first!r} is neither a run file nor a kind of fit. {nearest(first, catalogue.kinds())}",
            param_hint="KIND",
        )
    return "", [Path(w) for w in words]


def choices_of_flags(
    parameters: Path | None,
    tare: Path | None,
    setting: list[str] | None,
    *,
    no_tare: bool,
    largest_missed_share: float | None,
) -> Choices:
    """What was chosen by hand. Raises `BadParameter` for a tare that is both named and left away."""
    from rig.analysis.fit.run import Choices

    if tare is not None and no_tare:
        raise typer.BadParameter("a tare is named, and left away", param_hint="--tare, --no-tare")
    return Choices(
        gear=_gear(parameters),
        tare=tare,
        no_tare=no_tare,
        settings=settings_of(setting),
        largest_missed_share=largest_missed_share,
    )


def _keep_by_hand(kind: str, runs: list[Path], number: int, by: str, *, json: bool) -> None:
    """`rig fit RUN --keep NUMBER --by NAME`: the choice is noted, and what is in force now is said."""
    from datetime import datetime

    from rig.analysis.in_force import keep

    if len(runs) != 1:
        raise typer.BadParameter(
            "one run at a time: analyses are numbered by run", param_hint="RUN"
        )
    at = datetime.now().astimezone().isoformat(timespec="seconds")
    now = keep(runs[0], number, by, at, kind)
    if json:
        print_json({"run": str(runs[0]), "in_force": now.as_json()})
        return
    named = f"{now.kind} analysis {now.number}" if now.analysis else "no analysis"
    echo(f"{runs[0].name}: {named} is in force ({now.why_this})")
    for reason in now.stale:
        echo(f"  stale: {reason}")


def _gear(path: Path | None) -> HarmonicDrive | None:
    from model.gear_file import load_gear

    return path and load_gear(path)


def settings_of(pairs: list[str] | None) -> dict[str, Any]:
    """NAME=VALUE pairs; numbers, truth values and lists of numbers are read as such."""
    settings: dict[str, Any] = {}
    for pair in pairs or ():
        name, equals, text = pair.partition("=")
        if not equals or not name.strip():
            raise typer.BadParameter(f"{pair!r} is not NAME=VALUE", param_hint="--set")
        settings[name.strip().replace("-", "_")] = _read(text.strip())
    return settings


def _read(text: str) -> Any:
    if text.lower() in ("true", "false"):
        return text.lower() == "true"
    parts = text.split(",")
    numbers: list[float | int] = []
    for part in parts:
        try:
            numbers.append(int(part) if part.strip().lstrip("+-").isdigit() else float(part))
        except ValueError:
            return text
    return numbers[0] if len(numbers) == 1 else tuple(numbers)


def _store(fits: tuple[Fit, ...]) -> tuple[tuple[Fit, ...], list[str]]:
    """Append every fit to the store beside its run; a folder that cannot be written is said, not fatal."""
    from datetime import datetime

    from rig.analysis.fit.recorded import store
    from rig.errors import ChangedRunError, RunFileError

    kept, notes = [], []
    for one in fits:
        try:
            stored = store(one, datetime.now().astimezone().isoformat(timespec="seconds"))
        except ChangedRunError:
            raise
        except RunFileError as error:
            echo(f"Not stored: {error}", errors=True)
            kept.append(one)
            continue
        kept.append(stored)
        if stored.stored and one.path is not None:
            notes.append(f"kept as {one.path.parent / stored.stored}")
        if stored.not_in_force:
            notes.append(f"not what everybody reads: {stored.not_in_force}")
    return tuple(kept), notes


def _as_object(
    fits: tuple[Fit, ...], verdicts: Sequence[GearVerdict], *, plots: bool = False
) -> dict[str, Any]:
    told = [
        {
            **_with_drawings(one, wanted=plots),
            "outcome": one.outcome,
            **verdict.as_json(),
        }
        for one, verdict in zip(fits, verdicts, strict=True)
    ]
    if len(fits) == 1:
        return told[0]
    from rig.analysis.adopt import pooled

    spread = pooled([f.result for f in fits])
    return {
        "fits": told,
        "pooled": {p.key: p.as_json() for p in spread},
    }


def _with_drawings(fit: Fit, *, wanted: bool) -> dict[str, Any]:
    from rig.analysis.fit.digest import told_tare

    result = fit.result
    told = {**result.as_json(), "tare": told_tare(fit)}
    if not wanted:
        return told
    from rig.analysis.result_data import plot_to_mapping, table_to_mapping

    return {
        **told,
        "plots": [plot_to_mapping(plot) for plot in result.plots],
        "tables": [table_to_mapping(table) for table in result.tables],
    }


def _print_fits(
    fits: tuple[Fit, ...],
    verdicts: Sequence[GearVerdict],
    notes: list[str],
    *,
    everything: bool,
) -> None:
    from experiments.quantity import quantity_of
    from rig.commands.result_tables import print_result
    from rig.commands.visible import Text
    from rig.content.wording import number
    from rig.runfile.header import ORIGIN_WORDS

    out = console()
    for one, verdict in zip(fits, verdicts, strict=True):
        metadata = one.recording.metadata
        word = ORIGIN_WORDS.get(metadata.origin, metadata.origin.upper())
        gear, mark = phrase(", gear {}", metadata.gear_serial), phrase(" · {}", word)
        print_result(
            out,
            one.result,
            f"{one.result.kind} · run {metadata.run_id}{gear}{mark}",
            verdict,
            everything=everything,
        )
        for words in one.tare_words:
            out.print(Text.assemble(("  tare  ", "bold"), words))
    if len(fits) > 1:
        from rig.analysis.adopt import pooled

        spread = pooled([f.result for f in fits])
        if spread:
            out.print()
            out.print(Text("Between runs", style="bold"))
        quantities = {f.result.kind: f.result.quantities for f in fits}
        for p in spread:
            quantity = quantity_of(quantities[p.kind], p.name)
            title = p.name if quantity is None else quantity.titled(p.name)
            text = f"  {p.kind} {title}: mean {number(p.mean)}, standard deviation {number(p.deviation)}"
            out.print(Text(f"{text} {p.unit} over {p.runs} runs"))
    out.print()
    for note in notes:
        out.print(Text(f"  {note}", style="dim"))


def _print_comparison(
    fitted: Fit, scored: Result, gear: HarmonicDrive, rows: Sequence[Comparison]
) -> None:
    from rig.analysis.adopt import comparison_grid
    from rig.commands.result_tables import print_metrics, print_warnings
    from rig.commands.visible import Text

    out = console()
    out.print()
    out.print(
        Text(
            f"{fitted.result.kind} · run {fitted.result.run} against parameter set {gear.name}",
            style="bold",
        )
    )
    if rows:
        out.print(painted(comparison_grid(rows, gear), title=None))
    else:
        out.print(Text("  This run identifies no value that a parameter set holds.", style="dim"))
    print_metrics(out, scored)
    print_warnings(out, tuple(dict.fromkeys((*scored.warnings, *fitted.result.warnings))))
