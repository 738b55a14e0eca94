"""What is told of a run while it goes on: one line of progress after each turn."""

from __future__ import annotations

from rig.run.dry_run import PlannedRun
from rig.run.engine import Engine
from rig.run.parts import Progress
from rig.run.phases import Machine
from rig.run.supervisor import Supervisor


class ProgressTeller:
    """Makes the progress of one run out of what leads and watches it; `file` is the run file that grows."""

    def __init__(
        self,
        planned: PlannedRun,
        engine: Engine,
        machine: Machine,
        supervisor: Supervisor,
        file: str,
    ) -> None:
        self._planned, self._engine, self._machine = planned, engine, machine
        self._supervisor, self._file = supervisor, file

    def progress(self, events: int, *, engine_leads: bool) -> Progress:
        """Where the run is, after so many warnings; `engine_leads`: its plan leads it, not make-safe."""
        engine, planned, machine = self._engine, self._planned, self._machine
        left = 0.0
        if engine_leads and engine.begun and engine.index < len(planned.steps):
            in_step = (machine.rows - engine.begun[-1]) * machine.period
            left = planned.remaining[engine.index] + max(
                planned.steps[engine.index].nominal - in_step, 0.0
            )
        margins = self._supervisor.margins()
        nearest = min(margins, key=lambda name: margins[name]["margin"], default="")
        return Progress(
            step=min(engine.index + 1, len(planned.plan)),
            steps=len(planned.plan),
            what=engine.words if engine_leads else "making safe",
            elapsed=machine.rows * machine.period,
            left=left,
            speed=machine.speed(cycles=50),
            events=events,
            nearest=nearest,
            margin=margins[nearest]["margin"] if nearest else 1.0,
            margins=margins,
            file=self._file,
            begun=[row * machine.period for row in engine.begun],
        )
