"""The runs behind a gear's report: the newest of every kind as fits, the files with their hashes,
what is wrong with a scale.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from rig.analysis.fit.recorded import Fit, fit_in_force
from rig.analysis.in_force import newest_analysed
from rig.analysis.passport.content import Passport
from rig.content.grid import Grid
from rig.present.provenance import doubts_about
from rig.present.report import run_files, seal_words
from rig.runfile.read import close_recording, open_run
from rig.runfile.seal import check_seal


@contextmanager
def newest_fits(passport: Passport) -> Iterator[tuple[Fit, ...]]:
    """The newest analysed run of every kind, as it lies in the store; closed when it is left."""
    fits: list[Fit] = []
    try:
        for run, found in newest_analysed(passport.runs).runs:
            fits.append(fit_in_force(run.path, found))
        yield tuple(fits)
    finally:
        for fit in fits:
            close_recording(fit.recording)


def gear_files(passport: Passport, fits: Sequence[Fit]) -> Grid:
    """Every run that counts with the hash of its file, and the tares that the newest analyses lean on."""
    seals = [(run, check_seal(run.path)) for run in passport.runs]
    rows = [
        (run.run_id, run.outcome or "not stated", seal_words(seal.is_whole), seal.sha256)
        for run, seal in seals
    ]
    listed = {row[0] for row in rows}
    for fit in fits:
        tare = fit.named_tare
        run = str(tare.get("run", ""))
        if run and run not in listed:
            listed.add(run)
            rows.append((run, "motor tare", "as analysed", str(tare.get("sha256") or "not stated")))
    return run_files(rows)


def gear_alarms(passport: Passport) -> tuple[str, ...]:
    """What makes the scales of these runs doubtful, each alarm once with the runs that it concerns."""
    alarms: dict[str, list[str]] = {}
    for run in passport.runs:
        recording = open_run(run.path)
        try:
            for alarm in doubts_about(recording):
                alarms.setdefault(alarm, []).append(run.run_id)
        finally:
            close_recording(recording)
    return tuple(f"{alarm} ({_named(runs)})" for alarm, runs in alarms.items())


def _named(runs: Sequence[str]) -> str:
    if len(runs) == 1:
        return f"run {runs[0]}"
    if len(runs) <= 3:
        return f"runs {', '.join(runs)}"
    return f"{len(runs)} runs, {runs[0]} to {runs[-1]}"
