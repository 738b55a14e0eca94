"""From run files to a report: open, fit with the tare that is among them, keep the analyses, write the page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments import catalogue
from rig.errors import RigError, RunFileError
from rig.gears.acceptance import acceptance_for

if TYPE_CHECKING:
    from experiments.recording import Recording
    from model.gear import HarmonicDrive
    from rig.analysis.fit import Fit
    from rig.analysis.judging import GearVerdict
    from rig.gears.acceptance import Acceptance

"""The protocol that identifies a kinematic error, and the one whose analysis needs it."""


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
) -> Reports:
    """Fit these run files and write the report of them: one file, or several of the same content (HTML, PDF).

    A motor-tare run among them is subtracted from the others unless `tare` names another one;
    velocity steps are compared with the kinematic error that a run of the same gear among them
    identified. `created` is the calendar time of the report; now, if not given.
    """
    from model.gear_file import load_gear
    from rig.analysis.fit import fit_recording, store
    from rig.analysis.judging import judge_runs
    from rig.analysis.tare import tare_kind
    from rig.present.page import report_context
    from rig.runfile.read import open_run
    from rig.runfile.seal import forget_hashes

    if not runs:
        raise RigError("there is nothing to report", remedy="Name at least one run.")
    forget_hashes()
    created = created or datetime.now().astimezone().isoformat(timespec="seconds")
    gear = load_gear(parameters) if parameters else None
    opened = [(Path(p), open_run(Path(p))) for p in dict.fromkeys(runs)]
    tares = [
        fit_recording(r, gear=gear, path=p)
        for p, r in opened
        if r.metadata.experiment == tare_kind()
    ]
    if tare is not None:
        tare_fit = fit_recording(open_run(tare), tare_kind(), gear=gear, path=tare)
    else:
        tare_fit = max(tares, key=lambda f: f.recording.metadata.start_time, default=None)
    fits = list(tares)
    # What an analysis builds on has to be identified before it.
    for path, recording in sorted(opened, key=lambda pair: bool(_basis(pair[1]))):
        if recording.metadata.experiment != tare_kind():
            fits.append(
                fit_recording(
                    recording, gear=_gear_for(recording, gear, fits), tare=tare_fit, path=path
                )
            )
    lines = []
    stored_fits = []
    for fit in fits:
        try:
            stored_fits.append(store(fit, created))
        except RunFileError as error:
            stored_fits.append(fit)
            lines.append(f"Not stored: {error}")
    outputs = (output,) if isinstance(output, Path) else tuple(output)
    count = f"{len(stored_fits)} {'run' if len(stored_fits) == 1 else 'runs'}"
    verdict = judge_runs(stored_fits, _acceptance(acceptance, stored_fits))
    context = report_context(stored_fits, created=_readable(created), verdict=verdict)
    lines += _written(context, outputs, count)
    return Reports(outputs, tuple(stored_fits), tuple(lines), verdict)


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
) -> Reports:
    """Write the report of a gear over its life, from the analyses that lie beside its runs in a folder."""
    from rig.analysis.passport.build import passport
    from rig.present.gear import gear_context
    from rig.runfile.seal import forget_hashes

    forget_hashes()
    created = created or datetime.now().astimezone().isoformat(timespec="seconds")
    record = passport(folder, serial)
    asked = acceptance or acceptance_for(folder, serial)
    context = gear_context(record, created=_readable(created), acceptance=asked)
    return Reports(
        tuple(outputs),
        (),
        tuple(_written(context, outputs, f"gear {serial}, {len(record.runs)} runs")),
        context["judged"],
    )


def _written(context: dict[str, Any], outputs: Sequence[Path], what: str) -> list[str]:
    """Write every output; a line for each."""
    from rig.present.page import write_context

    return [
        f"{path}: {what}, {write_context(context, path).stat().st_size / 1e6:.1f} MB"
        for path in outputs
    ]


def _gear_for(
    recording: Recording, gear: HarmonicDrive | None, fits: Sequence[Fit]
) -> HarmonicDrive | None:
    """The parameter set for a run: the one given or the run's own (None), with what runs of the
    same gear identified that its analysis builds on.
    """
    from rig.analysis.adopt import adopt

    metadata = recording.metadata
    base = gear or metadata.gear
    same = [
        f
        for f in fits
        if f.result.kind in _basis(recording)
        and f.recording.metadata.gear_serial == metadata.gear_serial
        and f.recording.metadata.mounting == metadata.mounting
    ]
    if base is None or not same:
        return gear
    return adopt(base, [same[-1].result]).gear


def _basis(recording: Recording) -> tuple[str, ...]:
    """The protocols whose identified parameters the analysis of this recording builds on."""
    experiment = catalogue.declared(recording.metadata.experiment)
    return () if experiment is None else experiment.builds_on


def _readable(created: str) -> str:
    return created.replace("T", " ", 1)
