"""Judges a completed run by its protocol's own analysis, from the file that was just written."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from experiments.contract import Evidence
from rig.run.dry_run import PlannedRun
from rig.run.order import Judgement
from rig.runfile.read import close_recording, open_run


def judge_by(planned: PlannedRun) -> Callable[[Path], Judgement]:
    """The judge of a planned run. It raises the errors of the analysis and of the file."""

    def judge(path: Path) -> Judgement:
        recording = open_run(path, digest=False)
        try:
            result = planned.experiment.analyse(recording, Evidence(planned.gear))
        finally:
            close_recording(recording)
        return Judgement(
            result.outcome, result.warnings, {name: float(v) for name, v in result.metrics.items()}
        )

    return judge
