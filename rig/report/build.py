"""From run files to a report: open, fit with the tare that is among them, keep the analyses, write the page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from rig.errors import RigError, RunFileError

if TYPE_CHECKING:
    from rig.fit import Fit


@dataclass(frozen=True)
class Made:
    """A written report: its file, the fits in it, and what to tell whoever asked for it."""

    path: Path
    fits: tuple[Fit, ...]
    lines: tuple[str, ...]


def report_on_files(
    runs: Sequence[Path],
    output: Path,
    *,
    tare: Path | None = None,
    parameters: Path | None = None,
    created: str | None = None,
) -> Made:
    """Fit these run files and write the report of them.

    A motor-tare run among them is subtracted from the others unless `tare` names another one. `created` is the calendar time
    of the report; now, if not given.
    """
    from model.gear_file import load_gear
    from rig.fit import TARE, fit_recording, store
    from rig.report.page import write_report
    from rig.runfile.read import open_run

    if not runs:
        raise RigError("there is nothing to report", remedy="Name at least one run.")
    created = created or datetime.now().astimezone().isoformat(timespec="seconds")
    gear = load_gear(parameters) if parameters else None
    opened = [(Path(p), open_run(Path(p))) for p in dict.fromkeys(runs)]
    tares = [fit_recording(r, gear=gear, path=p) for p, r in opened if r.metadata.experiment == TARE]
    if tare is not None:
        used = fit_recording(open_run(tare), TARE, gear=gear, path=tare)
    else:
        used = max(tares, key=lambda f: f.recording.metadata.start_time, default=None)
    fits = list(tares)
    for path, recording in opened:
        if recording.metadata.experiment != TARE:
            fits.append(fit_recording(recording, gear=gear, tare=used, path=path))
    lines = []
    kept = []
    for fit in fits:
        try:
            kept.append(store(fit, created))
        except RunFileError as error:
            kept.append(fit)
            lines.append(f"Not stored: {error}")
    written = write_report(kept, output, created=_readable(created))
    size = written.stat().st_size / 1e6
    lines.append(f"{written}: {len(kept)} {'run' if len(kept) == 1 else 'runs'}, {size:.1f} MB")
    return Made(written, tuple(kept), tuple(lines))


def _readable(created: str) -> str:
    return created.replace("T", " ", 1)
