"""The runs behind a gear's report: the newest of every kind as fits, the files with their hashes,
what is wrong with a scale.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from rig.analysis.fit import Fit
from rig.analysis.passport.content import Passport, PassportPoint
from rig.analysis.store import Analysis, read_analyses
from rig.errors import RigError
from rig.present.content import Grid, run_files, seal_words
from rig.present.provenance import alarms_of
from rig.runfile.read import close_recording, open_run
from rig.runfile.seal import check_seal


@contextmanager
def newest_fits(passport: Passport) -> Iterator[tuple[Fit, ...]]:
    """The newest analysed run of every kind that the passport follows, as it lies in the store;
    closed when it is left.
    """
    from rig.analysis.passport.gather import moment

    newest: dict[str, PassportPoint] = {}
    for series in passport.series:
        last = series.points[-1]
        held = newest.get(series.kind)
        if held is None or (moment(last.start), last.number) > (moment(held.start), held.number):
            newest[series.kind] = last
    fits: list[Fit] = []
    try:
        for kind, point in newest.items():
            fits.append(_stored_fit(kind, point))
        yield tuple(fits)
    finally:
        for fit in fits:
            close_recording(fit.recording)


def _stored_fit(kind: str, point: PassportPoint) -> Fit:
    """A run with the analysis that the passport read. Raises `RigError` for one that is none."""
    from model.gear_file import gear_from_mapping, shipped_gear
    from rig.analysis.result_data import result_from_mapping

    analysis = _analysis(point)
    recording = open_run(point.path)
    try:
        result = result_from_mapping(analysis.result)
    except (KeyError, TypeError, ValueError) as error:
        raise RigError(
            "the stored analysis holds no result",
            where=str(analysis.path),
            value=str(error),
            remedy=f"Move it away and analyse the run again: rig fit {point.path} --kind {kind}",
        ) from None
    leaned_on = analysis.content.get("gear")
    gear = (
        gear_from_mapping(leaned_on, str(analysis.path)) if leaned_on else recording.metadata.gear
    )
    return Fit(
        recording=recording,
        gear=gear or shipped_gear(),
        result=result,
        path=point.path,
        settings=dict(analysis.content.get("settings", {})),
        stored=point.analysis,
        gear_known=recording.metadata.gear is not None,
    )


def _analysis(point: PassportPoint) -> Analysis:
    name = point.analysis.rpartition("/")[2]
    for analysis in read_analyses(point.path):
        if analysis.path.name == name:
            return analysis
    raise RigError(
        "the analysis that the passport read is gone", where=str(point.path), value=point.analysis
    )


def gear_files(passport: Passport, fits: Sequence[Fit]) -> Grid:
    """Every run that counts with the hash of its file, and the tares that the newest analyses lean on."""
    seals = [(run, check_seal(run.path)) for run in passport.runs]
    rows = [
        (run.run_id, run.outcome or "not stated", seal_words(seal.is_whole), seal.sha256)
        for run, seal in seals
    ]
    listed = {row[0] for row in rows}
    for fit in fits:
        tare = _analysis_tare(fit)
        if tare and tare[0] not in listed:
            listed.add(tare[0])
            rows.append((tare[0], "motor tare", "as analysed", tare[1] or "not stated"))
    return run_files(rows)


def _analysis_tare(fit: Fit) -> tuple[str, str] | None:
    """Run and hash of the tare that a stored analysis names."""
    name = fit.stored.rpartition("/")[2]
    for analysis in read_analyses(fit.path) if fit.path else ():
        tare = analysis.content.get("tare") or {}
        if analysis.path.name == name and tare:
            return str(tare.get("run", "")), str(tare.get("sha256", ""))
    return None


def gear_alarms(passport: Passport) -> tuple[str, ...]:
    """What makes the scales of these runs doubtful, each alarm once with the runs that it concerns."""
    alarms: dict[str, list[str]] = {}
    for run in passport.runs:
        recording = open_run(run.path)
        try:
            for alarm in alarms_of(recording):
                alarms.setdefault(alarm, []).append(run.run_id)
        finally:
            close_recording(recording)
    return tuple(f"{alarm} ({_named(runs)})" for alarm, runs in alarms.items())


def _named(runs: Sequence[str]) -> str:
    if len(runs) == 1:
        return f"run {runs[0]}"
    return (
        f"runs {', '.join(runs)}"
        if len(runs) <= 3
        else f"{len(runs)} runs, {runs[0]} to {runs[-1]}"
    )
