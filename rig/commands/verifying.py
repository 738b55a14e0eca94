"""`rig verify`: whether files are what was recorded and found, link by link of the chain of evidence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rig.commands.naming import RUNS, RunsFolder, runs_meant
from rig.commands.sealing import Unsealed
from rig.commands.terminal import Json, echo, print_json

if TYPE_CHECKING:
    from experiments.finding import Finding
    from rig.analysis.chain import Link
    from rig.analysis.recompute import Recomputed
    from rig.errors import RigError
    from rig.trial.manifest import HeldManifest


_Places = Annotated[
    list[Path],
    typer.Argument(
        metavar="FILE|FOLDER...",
        help="Runs, analyses, journals, certificates, or their folders.",
    ),
]

_Recompute = Annotated[
    bool,
    typer.Option("--recompute", help="Fit each stored analysis again and compare every number."),
]

_Manifest = Annotated[
    Path | None,
    typer.Option(
        "--manifest",
        metavar="FILE",
        help="List all evidence of the folder in FILE by name, kind and SHA-256; "
        "where FILE is there already, tell what is missing, changed or added since instead.",
    ),
]

_Gear = Annotated[
    str,
    typer.Option(metavar="SERIAL", help="List only this gear, with the tares that it rests on."),
]


def verify(
    places: _Places,
    recompute: _Recompute = False,
    manifest: _Manifest = None,
    gear: _Gear = "",
    runs_folder: RunsFolder = RUNS,
    unsealed: Unsealed = False,
    json: Json = False,
) -> None:
    """Check that runs are what was recorded, and what was found of them what was stored; names the first broken link.

    Of a run: hash, counters, time, flags, segments, calibrations. Then its analyses, the tares and analyses on which
    those rest, and of a folder the campaigns, gear cards and sealed files too. Of a certificate: its seals,
    everything that it rests on, its record against the stored analyses, its pages against the record. A
    manifest that is there is never written over; the hash that is printed is worth what the place is worth
    where it is kept. Exit code 6 if anything does not hold.
    """
    from rig import exits
    from rig.runfile.damage import refuse_missing
    from rig.trial.manifest import hold_against

    if manifest is not None or gear:
        _refuse_no_manifest(manifest, places)
    places = runs_meant(runs_folder, places)
    if len(places) == 1 and not json:
        # A mistyped name; among several, and for a program, it is one of the findings.
        refuse_missing(*places)
    found = _examine(places, recompute=recompute)
    held = manifest and hold_against(manifest, places[0], gear)
    error = _first_error(found) or (held and held.error)
    if json:
        print_json(_as_object(found, held, error))
    else:
        _print(found, held)
    if error:
        raise typer.Exit(exits.ERROR)


def _refuse_no_manifest(manifest: Path | None, places: Sequence[Path]) -> None:
    """Raise `BadParameter` unless there is a file for the manifest, and one folder that it is of."""
    if manifest is None or len(places) != 1 or not places[0].is_dir():
        raise typer.BadParameter(
            "name one folder and a FILE for its manifest", param_hint="--manifest, --gear"
        )


@dataclass(frozen=True)
class _Examined:
    """How the files were found: what each one says of itself, the links between them, what was made again."""

    checked: Mapping[str, Sequence[Finding]]
    links: Sequence[Link]
    again: Sequence[Recomputed] | None
    """None where nobody asked for it."""


def _examine(places: Sequence[Path], *, recompute: bool) -> _Examined:
    """Every run and every certificate that these places mean, and what they rest on."""
    from rig.present.certificate.verify import certificates_in, verify_certificate
    from rig.runfile.verify import verify_run
    from rig.trial.chain import links_of, runs_in

    runs = list(dict.fromkeys(run for place in places for run in runs_in(place)))
    certificates = [one for place in places for one in certificates_in(place)]
    checked = {str(run): verify_run(run) for run in runs}
    checked |= {str(one): verify_certificate(one) for one in certificates}
    links = [link for place in places for link in links_of(place)]
    return _Examined(checked, links, _made_again(runs, certificates) if recompute else None)


def _made_again(runs: Sequence[Path], certificates: Sequence[Path]) -> list[Recomputed]:
    """Every stored analysis of the runs, and of those on which the certificates rest, made again."""
    from rig.present.certificate.verify import runs_of

    named = [run for one in certificates for run in runs_of(one)]
    return [one for run in dict.fromkeys((*runs, *named)) for one in _again(run)]


def _again(run: Path) -> list[Recomputed]:
    """Every stored analysis of a run that can be read, made again."""
    from experiments.finding import Severity
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
            made.append(Recomputed(analysis, because=str(error), severity=Severity.BLOCKS))
    return made


def _first_error(found: _Examined) -> RigError | None:
    """What is wrong first: of the chain, then of a run's content, then of what was made again."""
    from experiments.finding import first_blocking
    from rig.errors import ChangedRunError, RunFileError

    link = first_blocking(found.links)
    if link is not None:
        return link.error or ChangedRunError(link.found, where=link.where)
    for run, findings in found.checked.items():
        blocking = first_blocking(findings)
        if blocking is not None:
            return RunFileError(blocking.sentence, where=run)
    wrong = first_blocking(one.finding for one in found.again or ())
    return wrong and ChangedRunError(wrong.found, where=wrong.where)


def _as_object(
    found: _Examined, held: HeldManifest | None, error: RigError | None
) -> dict[str, Any]:
    from rig import exits
    from rig.runfile.checks import LEVELS

    told: dict[str, Any] = {
        "runs": [
            {
                "run": run,
                "findings": [
                    f.as_json() | {"check": f.what, "level": LEVELS[f.severity], "text": f.found}
                    for f in findings
                ],
            }
            for run, findings in found.checked.items()
        ],
        "links": [link.as_json() for link in found.links],
        "trusted": error is None,
    }
    if found.again is not None:
        told["recomputed"] = [one.as_json() for one in found.again]
    if error is not None:
        told |= exits.error_object(error, str(error))
    if held is not None:
        told["manifest"] = held.as_json()
    return told


def _print(found: _Examined, held: HeldManifest | None) -> None:
    from rig.commands.findings import print_findings, print_links

    print_findings(found.checked)
    print_links(found.links, found.again or ())
    if held is not None:
        _print_manifest(held)


def _print_manifest(held: HeldManifest) -> None:
    """What was listed or compared, a line per file that is not as it was, and the hash to be kept elsewhere."""
    if held.changes is None:
        echo(f"{held.file}: {len(held.now.entries)} files listed, SHA-256 {held.now.sha256}")
        return
    echo(f"{held.file}: SHA-256 {held.older_sha256}; the folder now: {held.now.sha256}")
    for entry in held.changes.missing:
        echo(f"missing  {entry.kind} {entry.name}")
    for before, now in held.changes.changed:
        echo(f"changed  {now.kind} {now.name}: SHA-256 {now.sha256}, listed {before.sha256}")
    for entry in held.changes.added:
        echo(f"added    {entry.kind} {entry.name}")
    if held.changes.is_kept:
        echo("Nothing that is listed is missing or changed.")
