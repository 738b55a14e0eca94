"""`rig verify`: whether files are what was recorded and found, link by link of the chain of evidence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rig.commands.sealing import Unsealed
from rig.commands.terminal import print_json

if TYPE_CHECKING:
    from rig.analysis.chain import Link
    from rig.analysis.recompute import Recomputed
    from rig.errors import RigError
    from rig.runfile.checks import Finding


def verify(
    places: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE|FOLDER...",
            help="Runs, analyses, journals, certificates, or their folders.",
        ),
    ],
    recompute: Annotated[
        bool,
        typer.Option(
            "--recompute", help="Fit each stored analysis again and compare every number."
        ),
    ] = False,
    unsealed: Unsealed = False,
    json: Annotated[
        bool, typer.Option("--json", help="Print one JSON object on standard output.")
    ] = False,
) -> None:
    """Check that runs are what was recorded, and what was found of them what was stored; names the first broken link.

    Of a run: hash, counters, time, flags, segments, calibrations. Then its analyses, the tares and analyses on which
    those rest, and of a folder the campaigns, gear cards and sealed files too. Exit code 6 if not.
    """
    from rig import exits
    from rig.runfile.verify import verify_run
    from rig.trial.chain import first_broken, links_of, runs_in

    runs = list(dict.fromkeys(run for place in places for run in runs_in(place)))
    checked = {str(run): verify_run(run) for run in runs}
    links = [link for place in places for link in links_of(place)]
    again = [one for run in runs for one in _again(run)] if recompute else []
    error = _first_error(checked, first_broken(links), again)
    if json:
        print_json(_as_object(checked, links, again if recompute else None, error))
    else:
        from rig.commands.file_tables import print_findings, print_links

        print_findings(checked)
        print_links(links, again)
    if error:
        raise typer.Exit(exits.ERROR)


def _again(run: Path) -> list[Recomputed]:
    """Every stored analysis of a run that can be read, made again."""
    from model.errors import WordedError
    from rig.analysis.recompute import Recomputed, recompute
    from rig.analysis.store import read_analyses
    from rig.errors import RigError

    try:
        stored = read_analyses(run)
    except RigError:
        return []  # Which of them cannot be read stands among the links.
    made = []
    for analysis in stored:
        try:
            made.append(recompute(run, analysis))
        except WordedError as error:
            made.append(Recomputed(analysis, because=str(error), level="error"))
    return made


def _first_error(
    checked: Mapping[str, Sequence[Finding]], link: Link | None, again: Sequence[Recomputed]
) -> RigError | None:
    """What is wrong first: of the chain, then of a run's content, then of what was made again."""
    from rig.errors import ChangedRunError, RunFileError

    if link is not None:
        return link.error or ChangedRunError(link.text, where=str(link.path))
    for run, findings in checked.items():
        for finding in findings:
            if finding.level == "error":
                return RunFileError(f"{finding.check}: {finding.text}", where=run)
    wrong = next((one for one in again if one.level == "error"), None)
    return wrong and ChangedRunError(wrong.words, where=str(wrong.analysis.path))


def _as_object(
    checked: Mapping[str, Sequence[Finding]],
    links: Sequence[Link],
    again: Sequence[Recomputed] | None,
    error: RigError | None,
) -> dict[str, Any]:
    from rig import exits

    told: dict[str, Any] = {
        "runs": [
            {
                "run": run,
                "findings": [
                    {"check": f.check, "level": f.level, "text": f.text} for f in findings
                ],
            }
            for run, findings in checked.items()
        ],
        "links": [link.as_json() for link in links],
        "trusted": error is None,
    }
    if again is not None:
        told["recomputed"] = [one.as_json() for one in again]
    return told if error is None else told | exits.error_object(error, str(error))
