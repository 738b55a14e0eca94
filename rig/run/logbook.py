"""The logbook of a run: everything that is kept (rows, segments, events, warnings) goes through it into the recorder.

An error of the recorder is remembered and ends the run, but never the making safe: after it nothing more is written.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Generator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from drivers.samples import SampleBlock
from experiments.recording import Event, Segment
from experiments.steps.vocabulary import SegmentLabel
from rig.errors import RigError
from rig.run.parts import OpenRun


class Logbook:
    """Keeps what happens in one run. `epoch_ns` is the calendar time of a time stamp of zero."""

    def __init__(
        self, run: OpenRun, epoch_ns: int, on_event: Callable[[Event], None] | None = None
    ) -> None:
        self.run = run
        self.error: RigError | None = None
        self.warnings: list[str] = []
        self._epoch = epoch_ns
        self._stamp = 0
        self._segments = 0
        self._on_event = on_event

    def put(self, block: SampleBlock) -> None:
        """Keep a block."""
        if len(block):
            self._stamp = int(block.time_ns[-1])
        with self._recording():
            self.run.recorder.put(block)

    def segment(self, label: SegmentLabel, start: int, stop: int) -> None:
        """Keep a finished segment (rows [start, stop))."""
        segment = Segment(
            index=self._segments,
            label=label.label,
            start=start,
            stop=stop,
            setpoint=label.setpoint,
            direction=label.direction,
            repeat=label.repeat,
        )
        self._segments += 1
        with self._recording():
            self.run.recorder.segment(segment)

    @property
    def now(self) -> str:
        """The calendar time of the latest cycle (ISO 8601 with zone)."""
        return iso_time(self._epoch + self._stamp)

    def event(
        self, level: str, code: str, source: str, text: str, stamp_ns: int | None = None
    ) -> None:
        """Keep an event, at `stamp_ns` of the rig's time base or else at the latest cycle; warnings
        and errors are listed in
        the report as well."""
        event = Event(
            self._epoch + (self._stamp if stamp_ns is None else stamp_ns), level, code, source, text
        )
        if level in ("warning", "error"):
            self.warnings.append(text)
        with self._recording():
            self.run.recorder.event(event)
        if self._on_event is not None:
            self._on_event(event)

    def flush(self) -> None:
        """Bring the file up to date for a reader."""
        with self._recording():
            self.run.flush()

    def close(
        self, outcome: str, acquisition: Mapping[str, Any] | None = None
    ) -> tuple[Path, bool]:
        """Seal the run with the figures of its acquisition: its path, and whether that worked.

        A file that cannot be sealed is left to be recovered.
        """
        recorder = self.run.recorder
        if self.error is None:
            try:
                return recorder.close(
                    outcome, iso_time(self._epoch + self._stamp), acquisition
                ), True
            except RigError as error:
                self._remember(error)
        recorder.abandon()
        return self.run.part, False

    @contextlib.contextmanager
    def _recording(self) -> Generator[None, None, None]:
        if self.error is not None:
            # The recorder has failed and said so: its file is left as it is.
            with contextlib.suppress(RigError):
                yield
            return
        try:
            yield
        except RigError as error:
            self._remember(error)

    def _remember(self, error: RigError) -> None:
        self.error = error
        self.warnings.append(str(error))


def iso_time(calendar_ns: int) -> str:
    """Calendar nanoseconds as ISO 8601 with the zone."""
    return datetime.fromtimestamp(calendar_ns // 1000 * 1e-6, UTC).isoformat(
        timespec="milliseconds"
    )
