"""Whether a run file can be trusted: its seal, and everything that the checks of its content find."""

from __future__ import annotations

from pathlib import Path

from experiments.finding import Finding, Severity
from rig.errors import ChangedRunError, RigError
from rig.runfile import layout
from rig.runfile.checks import findings_of
from rig.runfile.read import open_run
from rig.runfile.seal import check_seal, hash_path
from rig.runfile.source import FileSource


def verify_run(path: str | Path) -> tuple[Finding, ...]:
    """Every check of a run file; an unreadable one is an error among the findings, not an exception."""
    path = Path(path)
    findings = [_check_hash(path)]
    try:
        recording = open_run(path, digest=False)
    except RigError as error:
        return (*findings, Finding("readable", Severity.BLOCKS, str(error)))
    source = recording.source
    assert isinstance(source, FileSource)
    with source:
        rows = f"{recording.rows} rows of {len(recording.signals)} channels"
        findings.append(Finding("readable", Severity.PASSED, rows))
        run_id = recording.metadata.run_id
        if findings[0].severity is Severity.BLOCKS and not path.name.startswith(run_id):
            findings.append(Finding("name", Severity.WARNS, f"the run names itself {run_id}"))
        try:
            findings.extend(findings_of(recording, source))
        except RigError as error:
            findings.append(Finding("readable", Severity.BLOCKS, str(error)))
    return tuple(findings)


def _check_hash(path: Path) -> Finding:
    if path.name.endswith(layout.PART_SUFFIX):
        return Finding(
            "hash",
            Severity.WARNS,
            "the run is not sealed: still being written, or cut off (`rig recover`)",
        )
    try:
        seal = check_seal(path, anew=True)
    except ChangedRunError as error:
        text = f"{error.what}: it is {error.value}, sealed with {error.limit}"
        return Finding("hash", Severity.BLOCKS, text if error.value else str(error))
    except RigError as error:
        return Finding("hash", Severity.BLOCKS, str(error))
    if not seal.is_whole:
        text = f"not sealed: there is no {hash_path(path).name} beside the run to compare with"
        return Finding("hash", Severity.WARNS, text)
    return Finding("hash", Severity.PASSED, f"SHA-256 {seal.sha256}")
