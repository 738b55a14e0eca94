"""From run files to a report: the analysis in force of each, judged, on a page. Nothing is fitted that was before."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from experiments import catalogue
from rig.content.phrase import counted, quoted
from rig.errors import RigError
from rig.gears.acceptance import acceptance_for

if TYPE_CHECKING:
    from rig.analysis.fit.recorded import Fit
    from rig.analysis.fit.run import Choices
    from rig.analysis.judging import GearVerdict
    from rig.analysis.validate import Validation
    from rig.content.page import Page
    from rig.gears.acceptance import Acceptance


@dataclass(frozen=True)
class Reports:
    """A written report: its files, the fits in it, and what to tell whoever asked for it."""

    paths: tuple[Path, ...]
    fits: tuple[Fit, ...]
    lines: tuple[str, ...]
    verdict: GearVerdict

    @property
    def path(self) -> Path:
        """The first file."""
        return self.paths[0]


def report_on_files(
    runs: Sequence[Path],
    output: Path | Sequence[Path],
    *,
    tare: Path | None = None,
    parameters: Path | None = None,
    created: str | None = None,
    acceptance: Acceptance | None = None,
    no_tare: bool = False,
    refit: bool = False,
    models: bool = False,
    sections: Sequence[str] = (),
) -> Reports:
    """Write the report of these run files: one file, or several of the same content (HTML, PDF).

    What is reported of each is its analysis in force, as everybody reads it; a stale one says so. A run
    that was never analysed is analysed once, and that is kept. `refit`, a tare or a parameter set
    chosen by hand, and `no_tare` make every analysis anew. `sections` are those that are wanted
    (`rig.content.page.SECTIONS`), all without any. `models`: of every kind with two runs or more the models of
    its ladder are judged by these. `created` is the calendar time of the
    report; now, if not given. Raises `RigError` for a run that does not bear its analysis.
    """
    from model.gear_file import load_gear
    from rig.analysis.fit.run import Choices
    from rig.analysis.judging import judge_runs
    from rig.present.report import report_page
    from rig.runfile.seal import forget_hashes

    if not runs:
        raise RigError("there is nothing to report", remedy="Name at least one run.")
    forget_hashes()
    created = created or datetime.now().astimezone().isoformat(timespec="seconds")
    gear = parameters and load_gear(parameters)
    anew = refit or no_tare or tare is not None or gear is not None
    choices = Choices(gear=gear, tare=tare, no_tare=no_tare) if anew else None
    lines: list[str] = []
    stored_fits = []
    for path in _in_order(runs):
        fit, words = _fit_in_force(path, created, choices)
        stored_fits.append(fit)
        lines += words
    outputs = (output,) if isinstance(output, Path) else tuple(output)
    count = counted(len(stored_fits), "run", "runs")
    verdict = judge_runs(stored_fits, _acceptance(acceptance, stored_fits))
    judged = _judged_models(stored_fits, choices) if models else ()
    page = report_page(stored_fits, created=_readable(created), verdict=verdict, models=judged)
    page = page.only(sections)
    lines += _written(page, outputs, count)
    return Reports(outputs, tuple(stored_fits), tuple(lines), verdict)


def _judged_models(fits: Sequence[Fit], choices: Choices | None) -> tuple[Validation, ...]:
    """Of every kind with a ladder its models, each fitted to all runs but one and judged on that one.

    Raises `RigError` where no kind has two runs.
    """
    from rig.analysis.validate import validate_runs

    runs: dict[str, list[Path]] = {}
    for fit in fits:
        if fit.result.kind in catalogue.ladders() and fit.path is not None:
            runs.setdefault(fit.result.kind, []).append(fit.path)
    several = {kind: paths for kind, paths in runs.items() if len(paths) > 1}
    if not several:
        raise RigError(
            "there are no two runs of a kind by which its models could be judged",
            where="--models",
            limit=f"two runs of one of {', '.join(catalogue.ladders())}",
            remedy="Name further runs, or leave --models out.",
        )
    return tuple(validate_runs(paths, (), kind, choices) for kind, paths in several.items())


def _acceptance(named: Acceptance | None, fits: Sequence[Fit]) -> Acceptance | None:
    """The acceptance file that was named, else the one that the card of the gear names that was turned."""
    mounted = [fit for fit in fits if fit.recording.metadata.gear_mounted and fit.path is not None]
    if named is not None or not mounted or mounted[0].path is None:
        return named
    return acceptance_for(mounted[0].path.parent, mounted[0].serial)


def report_on_gear(
    folder: Path,
    serial: str,
    outputs: Sequence[Path],
    *,
    created: str | None = None,
    acceptance: Acceptance | None = None,
    sections: Sequence[str] = (),
) -> Reports:
    """Write the report of a gear over its life, from the analyses that lie beside its runs in a folder."""
    from rig.analysis.passport.build import passport
    from rig.present.gear import gear_page
    from rig.runfile.seal import forget_hashes

    forget_hashes()
    created = created or datetime.now().astimezone().isoformat(timespec="seconds")
    record = passport(folder, serial)
    asked = acceptance or acceptance_for(folder, serial)
    page, verdict = gear_page(record, created=_readable(created), acceptance=asked)
    page = page.only(sections)
    return Reports(
        tuple(outputs),
        (),
        tuple(_written(page, outputs, f"gear {serial}, {len(record.runs)} runs")),
        verdict,
    )


def _written(page: Page, outputs: Sequence[Path], what: str) -> list[str]:
    """Write every output; a line for each."""
    from rig.present.page import write_page

    return [
        f"{path}: {what}, {write_page(page, path).stat().st_size / 1e6:.1f} MB" for path in outputs
    ]


def _in_order(runs: Sequence[Path]) -> list[Path]:
    """The runs in the order of their analyses: tares first, and last what builds on others."""
    from rig.analysis.fit.digest import protocol_of
    from rig.analysis.tare import tare_kind

    def place(path: Path) -> tuple[bool, bool]:
        protocol = protocol_of(path)
        experiment = catalogue.declared(protocol)
        return protocol != tare_kind(), experiment is not None and bool(experiment.builds_on)

    return sorted((Path(run) for run in dict.fromkeys(runs)), key=place)


def _fit_in_force(path: Path, created: str, choices: Choices | None) -> tuple[Fit, list[str]]:
    """What is reported of a run, and what is to be said of it; with choices it is made anew."""
    from rig.analysis.fit.digest import digest, protocol_of, read_or_digest
    from rig.analysis.in_force import in_force
    from rig.analysis.judging import doubts_of

    if choices is None:
        fit, _, made = read_or_digest(path, created)
    else:
        # A tare that was named is for the others.
        own = replace(choices, tare=None) if choices.tare == path else choices
        # A recording that names no kind is analysed anew as what it was analysed last.
        named = protocol_of(path) in catalogue.kinds()
        made = digest(path, created, "" if named else in_force(path).kind, choices=own)
        fit = made.fit
    if fit is None:
        because = made.because if made is not None else ()
        remedy = ""
        if protocol_of(path) not in catalogue.kinds():
            remedy = f"A recording of another rig is analysed first: rig fit KIND {quoted(path)}."
        raise RigError(
            "this run does not bear its analysis",
            where=str(path),
            value="; ".join(because),
            remedy=remedy,
        )
    lines = [] if made is None or not made.not_stored else [f"Not stored: {made.not_stored}"]
    return fit, lines + [f"{path.name}: {words}" for words in doubts_of(fit)]


def _readable(created: str) -> str:
    return created.replace("T", " ", 1)
