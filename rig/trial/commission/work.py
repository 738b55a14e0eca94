"""What a stage works with, and what it leaves: findings, answers of the operator, run files."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace

from experiments.contract import Experiment
from experiments.finding import Finding, Severity
from experiments.recording import Event, Recording
from experiments.steps.note import Prompt
from model.units import RPM
from rig.bench import limits as lim
from rig.bench.backends.assembly import AssembledRig
from rig.bench.backends.order import Order, Setup
from rig.bench.backends.registry import make_port
from rig.bench.commissioning import Device
from rig.bench.identity import Bench
from rig.run.dry_run import PlannedRun
from rig.run.engine import Ask
from rig.run.frames import frames_of
from rig.run.parts import Progress, RunReport
from rig.run.start import plan_order, run_on
from rig.run.stop import StopRequest
from rig.runfile.read import close_recording, open_run
from rig.runfile.seal import file_sha256

ROOM = 1.25
"""Over the speed of a stage: what the limits leave for its overshoot."""
Make = Callable[[Order, Setup], AssembledRig]


@dataclass
class Seen:
    """What was seen in one stage."""

    findings: list[Finding] = field(default_factory=list)
    answers: dict[str, str] = field(default_factory=dict)
    runs: dict[str, str] = field(default_factory=dict)
    devices: dict[str, Device] = field(default_factory=dict)
    latest: RunReport | None = None
    """How the run of a stage that turns came to its end."""

    @property
    def is_fine(self) -> bool:
        """Whether nothing failed."""
        return all(finding.severity is not Severity.BLOCKS for finding in self.findings)

    def add(self, *findings: Finding) -> None:
        """Keep findings."""
        self.findings += findings


@dataclass(kw_only=True)
class Work:
    """A bench being commissioned: whose order, how its rig is put together, who is asked, who may stop it."""

    order: Order
    bench: Bench
    ask: Ask
    stop: StopRequest
    now: Callable[[], str]
    make: Make = make_port
    on_progress: Callable[[Progress], None] | None = None
    on_event: Callable[[Event], None] | None = None
    record: Callable[[Seen], None] = lambda seen: None
    """Writes down that a stage has begun from which this program does not come back."""

    def rig(self, *, coupled: bool = True) -> AssembledRig:
        """The rig of the order, put together anew and not opened."""
        return self.make(self.order, Setup(gear_mounted=coupled, watches_contact=True))

    def answer(
        self,
        rig: AssembledRig | None,
        key: str,
        text: str,
        consent: str = "",
        meanwhile: Callable[[], None] = lambda: None,
    ) -> str:
        """Ask until there is an answer, or a STOP (then ""); the person at a simulated bench acts by the key."""
        prompt = Prompt(text, key, consent)
        if rig is not None and rig.person is not None:
            return rig.person(key) or consent
        while not self.stop.level:
            answer = self.ask(prompt)
            meanwhile()
            if answer is not None:
                return answer
        return ""

    def consents(
        self, seen: Seen, rig: AssembledRig | None, key: str, text: str, consent: str
    ) -> None:
        """Ask for consent to a sentence; without it the stage has failed."""
        given = self.answer(rig, key, text, consent)
        seen.answers[key] = given
        if not given:
            seen.add(
                Finding(
                    key.replace("-", " "), Severity.BLOCKS, "nobody confirmed it", where="operator"
                )
            )

    def plan(self, experiment: Experiment, *, fastest: float, torque: float) -> PlannedRun:
        """The run of a stage whose limits are those of the order, and tighter: speed [rad/s], motor torque [N m]."""
        limits = dict(self.order.limits)
        tighter = {lim.INPUT_SPEED: ROOM * fastest + 5.0 * RPM, lim.MOTOR_TORQUE: torque}
        limits |= {name: min(value, limits.get(name, value)) for name, value in tighter.items()}
        return plan_order(replace(self.order, limits=limits), experiment)

    def turn(
        self,
        seen: Seen,
        planned: PlannedRun,
        on_progress: Callable[[AssembledRig, Progress], None] = lambda rig, progress: None,
        stop: StopRequest | None = None,
    ) -> tuple[RunReport, AssembledRig]:
        """Turn by a plan, as every run does; its file is kept, and who was on the bus."""
        rig = self.rig(coupled=planned.experiment.gear_mounted)
        order = replace(self.order, protocol=planned.experiment.name)

        def progressed(progress: Progress) -> None:
            on_progress(rig, progress)
            if self.on_progress is not None:
                self.on_progress(progress)

        report = run_on(
            rig,
            order,
            planned,
            stop or self.stop,
            ask=self.ask,
            bench=self.bench,
            on_progress=progressed,
            on_event=self.on_event,
            uncommissioned=None,
        )
        seen.latest = report
        for path in (report.path, frames_of(report.path)):
            if path.exists():
                seen.runs[path.name] = file_sha256(path)
        return report, rig


def read_back(
    report: RunReport, look: Callable[[Recording], Iterable[Finding]]
) -> Iterable[Finding]:
    """What is seen in the file of a stage's run."""
    if not report.readable:
        return [Finding("recording", Severity.BLOCKS, "the run cannot be read", where="motion")]
    recording = open_run(report.path)
    try:
        return list(look(recording))
    finally:
        close_recording(recording)
