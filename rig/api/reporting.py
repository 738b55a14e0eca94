"""`rig.report`: the page that a laboratory sends out, of runs and of results."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from rig.analysis.judging import judge_runs
from rig.api.fitting import fit
from rig.api.results import Result
from rig.api.runs import Run, file_of
from rig.gears.acceptance import acceptance_named
from rig.present.build import report_on_files
from rig.present.page import suffix_of
from rig.present.report import write_report

if TYPE_CHECKING:
    from rig.gears.acceptance import Acceptance

    Reported = Result | Run | str | Path


def report(
    what: Reported | Sequence[Reported],
    path: str | Path = "report.html",
    *,
    acceptance: str | Path | None = None,
    note: str = "",
) -> Path:
    """Write a self-contained report (.html or .pdf by the suffix of `path`) and return its path.

    Of runs with a file it shows the analysis in force, as `rig report` does, and analyses once what never was. Of
    results it shows these; a run in memory is fitted. `acceptance` is what the gear must show: a file, or the name of
    one that ships. `note` is a sentence under the title of a report of results.

    Raises `RigError` for nothing to report, a run that does not bear its analysis, a file that cannot be written.
    """
    suffix_of(Path(path))
    asked = acceptance_named(str(acceptance)) if acceptance is not None else None
    items = [what] if isinstance(what, (Result, Run, str, Path)) else list(what)
    files = [_file_of(item) for item in items]
    if items and None not in files:
        runs = [file for file in files if file is not None]
        return report_on_files(runs, Path(path), acceptance=asked).path
    return _report_on_results(items, Path(path), asked, note)


def _report_on_results(
    items: Sequence[Reported], path: Path, acceptance: Acceptance | None, note: str
) -> Path:
    fits = [(item if isinstance(item, Result) else fit(item)).fit for item in items]
    created = datetime.now().astimezone().isoformat(sep=" ", timespec="seconds")
    verdict = judge_runs(fits, acceptance)
    return write_report(fits, path, created=created, verdict=verdict, note=note)


def _file_of(item: Reported) -> Path | None:
    """The run file of an item; None for a result, which is reported as it is, and for a run in memory."""
    if isinstance(item, Result):
        return None
    return file_of(item)
