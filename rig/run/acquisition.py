"""How well a run was acquired, in figures for its file: rate, jitter, missed cycles, index marks, torques, skew.

Ports that count for themselves (on the bus) are asked; for every other one the blocks are counted
as they come. What is known only from the whole recording, the skew between the channels, is
estimated from the file before it is sealed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drivers.acquisition_statistics import AcquisitionStatistics
from drivers.errors import DriverError
from drivers.port import RigPort
from drivers.samples import SampleBlock
from experiments.errors import ExperimentError
from model.errors import ModelError
from rig.errors import RigError
from rig.run.logbook import Logbook

if TYPE_CHECKING:
    from rig.runfile.header import RunHeader

_READ_IN = {
    "duration": (1.0, "s"),
    "nominal_rate": (1.0, "Hz"),
    "achieved_rate": (1.0, "Hz"),
    "missed_share": (1e-2, "%"),
}
"""Figures of an acquisition that have a unit, besides the times below: how much of SI it is, and the unit."""
_SHORT_TIMES = ("jitter", "latency")
"""How the names of those begin that are read in microseconds."""


def _in_words(name: str, value: float) -> str:
    """A figure of an acquisition as an event says it."""
    factor, unit = _READ_IN.get(name, (1.0, ""))
    if name.startswith(_SHORT_TIMES):
        factor, unit = 1e-6, "µs"
    return f"{name.replace('_', ' ')} {value / factor:.6g} {unit}".rstrip()


class AcquisitionLog:
    """Counts the blocks of one run, and says at its end how well it was acquired."""

    def __init__(self, port: RigPort, logbook: Logbook) -> None:
        self._port, self._logbook = port, logbook
        self._statistics = AcquisitionStatistics(port.cycle_ns)

    def put(self, block: SampleBlock) -> None:
        """Count a block."""
        self._statistics.add(block.time_ns, None, block.flags)

    def figures(self, reviewed: Mapping[str, Any]) -> tuple[dict[str, float], dict[str, Any]]:
        """Metrics for the report and figures for the file; `reviewed` is what the supervisor reviewed.
        An event says them too.
        """
        counted = self._counted()
        line = ", ".join(_in_words(name, value) for name, value in counted.items())
        self._logbook.event("info", "acquisition", "port", line)
        skews = self._skews()
        metrics = {f"acquisition_{name}": value for name, value in counted.items()}
        return metrics, {**counted, **reviewed, **({"skew": skews} if skews else {})}

    def _counted(self) -> dict[str, float]:
        report = None
        told = self._port.abilities.acquisition
        if told is not None:
            try:
                report = told()
            except DriverError as error:
                self._logbook.event("warning", "acquisition", "port", str(error))
        own = self._statistics.report()
        values = asdict(own if report is None else report)
        if report is None:
            # How long a cycle took on the computer is known to the port alone.
            values = {
                name: value for name, value in values.items() if not name.startswith("latency")
            }
        return {name: float(value) for name, value in values.items()} | {
            "missed_share": own.missed_share
        }

    def _skews(self) -> dict[str, Any]:
        """The skew between the channels, from the file as it stands; an estimate that fails must not cost the data."""
        logbook = self._logbook
        if logbook.error is not None:
            return {}
        logbook.flush()
        try:
            skews, remarks = _skews_of(logbook.run.part, logbook.run.header)
            for text in remarks:
                logbook.event("warning", "skew", "acquisition", text)
            return skews
        except (RigError, ExperimentError, ModelError) as error:
            logbook.event("info", "skew", "acquisition", f"no skew was estimated: {error}")
            return {}


def _skews_of(part: Path, header: RunHeader) -> tuple[dict[str, Any], list[str]]:
    """Skew between the channels of a run file that is still open, as the file keeps it, and what
    has to be said of it.
    """
    from experiments.evidence import skew_remark
    from experiments.evidence.skew import skews
    from rig.runfile.read import close_recording, open_own_run

    recording = open_own_run(part, header)
    try:
        estimates = {name: estimate.as_json() for name, estimate in skews(recording).items()}
        process = {**header.metadata.process, "acquisition": {"skew": estimates}}
        described = replace(recording, metadata=replace(recording.metadata, process=process))
        return estimates, skew_remark(described)
    finally:
        close_recording(recording)
