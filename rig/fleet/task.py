"""What a worker does: it takes the paths of some runs and gives back their rows; the data stay where they are.

    path -> inputs (kind, tare, gear) -> key -> known already?  else fit -> verdict -> rows

A run that cannot be read or analysed gives one row with the reason. The key of a run is a hash of all that its rows
rest on: the bytes of run and tare, what the analysed tare says, the gear's set, settings, version of the analysis,
acceptance file. The same key gives the same rows, so that a run whose key is known is not analysed again.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments import catalogue
from rig.analysis.fit.run import Choices, FitInputs, inputs_of
from rig.analysis.gear_set import set_sha256
from rig.analysis.judging import judge_run
from rig.errors import ChangedRunError
from rig.fleet.neighbours import Neighbours, digest, neighbours_of
from rig.fleet.results import SCHEMA_VERSION, Row
from rig.fleet.rows import failure_of, row_of_failure, rows_of_fit, settings_part
from rig.fleet.table import table_bytes
from rig.runfile.read import close_recording

if TYPE_CHECKING:
    from experiments.recording import Recording

_KEY_LENGTH = 32
"""Hexadecimal digits of a key: 128 bits."""


@dataclass(frozen=True, kw_only=True)
class Job:
    """What is the same for all runs: `name` tells one job from the next, `created` is its calendar time (ISO 8601).

    `kind` is "" where the kind follows from the protocol, `acceptance` "" where it follows from the gear's card.
    `stored`: the analysis is also kept beside its run, as `rig fit` does.
    """

    name: str
    created: str
    kind: str = ""
    settings: Mapping[str, Any] = field(default_factory=dict)
    no_tare: bool = False
    acceptance: str = ""
    stored: bool = False


@dataclass(frozen=True)
class RunTask:
    """One run to be looked at: how the table names it, where the worker finds it, and what is known of it."""

    run_file: str
    path: str
    kind: str
    surroundings: str
    known_key: str = ""


@dataclass(frozen=True, kw_only=True)
class Done:
    """What came of some runs: their rows as the bytes of a Parquet file (none where all were known), and the counts.

    `failed` are run file and reason, `changed` those among them that are refused because a file is not as it was
    sealed; `fit_seconds` is the part of `seconds` that the analyses themselves took, from
    opening the run to closing it.
    """

    rows: bytes = b""
    fitted: tuple[str, ...] = ()
    reused: tuple[str, ...] = ()
    failed: tuple[tuple[str, str], ...] = ()
    changed: tuple[str, ...] = ()
    seconds: float = 0.0
    fit_seconds: float = 0.0


def fit_runs(
    job: Job, tasks: Sequence[RunTask], now: Callable[[], float] = time.perf_counter
) -> Done:
    """Analyse some runs one after the other."""
    began, spent = now(), 0.0
    neighbours = neighbours_of(job.name, job.created)
    rows: list[Row] = []
    fitted, reused, failed, changed = [], [], [], []
    for task in tasks:
        one = _Analysis(job, task, neighbours, now)
        rows += one.rows()
        spent += one.fit_seconds
        if one.error is not None:
            failed.append((task.run_file, failure_of(one.error)))
            if isinstance(one.error, ChangedRunError):
                changed.append(task.run_file)
        elif one.is_known:
            reused.append(task.run_file)
        else:
            fitted.append(task.run_file)
    return Done(
        rows=table_bytes(rows) if rows else b"",
        fitted=tuple(fitted),
        reused=tuple(reused),
        failed=tuple(failed),
        changed=tuple(changed),
        seconds=now() - began,
        fit_seconds=spent,
    )


def lost(task: RunTask, reason: str) -> Done:
    """What is told of a run that no worker survived."""
    shared = {
        "run_file": task.run_file,
        "kind": task.kind,
        "surroundings": task.surroundings,
        "key": "",
    }
    row = row_of_failure(shared, _KilledWorker(reason), None)
    return Done(rows=table_bytes([row]), failed=((task.run_file, reason),))


class _KilledWorker(RuntimeError):
    """A run with which several workers came to their end."""


class _Analysis:
    """One run on its way to rows."""

    def __init__(
        self, job: Job, task: RunTask, neighbours: Neighbours, now: Callable[[], float]
    ) -> None:
        self._job, self._task, self._neighbours, self._now = job, task, neighbours, now
        self._recording: Recording | None = None
        self.error: BaseException | None = None
        self.is_known = False
        self.fit_seconds = 0.0
        self._shared: Row = {
            "run_file": task.run_file,
            "kind": task.kind,
            "surroundings": task.surroundings,
            "settings": settings_part(job.settings),
            "key": "",
        }

    def rows(self) -> list[Row]:
        """The rows; none where the key shows that they are known."""
        try:
            return self._rows()
        except Exception as error:  # noqa: BLE001  a defect of one analysis must not end thousands of others
            self.error = error
            return [row_of_failure(self._shared, error, self._recording)]
        finally:
            began = self._now()
            if self._recording is not None:
                with contextlib.suppress(OSError, ValueError):
                    close_recording(self._recording)
            self.fit_seconds += self._now() - began

    def _rows(self) -> list[Row]:
        job, path = self._job, Path(self._task.path)
        choices = Choices(no_tare=job.no_tare, settings=job.settings)
        began = self._now()
        inputs = inputs_of(path, job.kind, choices, self._neighbours)
        self._recording = inputs.recording
        self.fit_seconds = self._now() - began
        serial = inputs.recording.metadata.gear_serial
        acceptance, accepted = self._neighbours.acceptance(job.acceptance, path.parent, serial)
        self._shared |= {"kind": inputs.kind, "key": self._key(inputs, accepted)}
        if self._shared["key"] == self._task.known_key:
            self.is_known = True
            return []
        began = self._now()
        fit = inputs.fit()
        if job.stored:
            from rig.analysis.fit.recorded import store

            fit = replace(store(fit, job.created), not_in_force="")
        self.fit_seconds += self._now() - began
        return rows_of_fit(fit, judge_run(fit, acceptance), self._shared)

    def _key(self, inputs: FitInputs, accepted: str) -> str:
        source = inputs.source
        tare = tare_run = ""
        if inputs.tared.fit is not None:
            tare = self._neighbours.tare_digest(inputs.tared.fit)
            tare_run = inputs.tared.fit.recording.metadata.sha256
        content = {
            "schema": SCHEMA_VERSION,
            "run": inputs.recording.metadata.sha256,
            "kind": inputs.kind,
            "version": catalogue.load(inputs.kind).version,
            "settings": inputs.settings,
            "no_tare": self._job.no_tare,
            "gear": source.sha256 or source.source,
            "tare": tare,
            "tare_run": tare_run,
            "acceptance": accepted,
            "output_encoder": _output_curve(inputs.recording),
            "other_tares": [dict(other.named) for other in inputs.other_tares],
        }
        if source.builds_on and inputs.gear is not None:
            content["built_on"] = set_sha256(inputs.gear)
        return digest(content)[:_KEY_LENGTH]


def _output_curve(recording: Recording) -> str:
    """The curve that is taken off the output angle, learnt or certified; "" where there is none."""
    signal = recording.signals.get("output_angle")
    if signal is None or (curve := signal.calibration.curve) is None:
        return ""
    return digest([list(curve.errors), list(curve.expanded_uncertainties)])
