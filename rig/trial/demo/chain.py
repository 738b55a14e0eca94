"""The whole chain on the simulated rig: an acceptance campaign of one gear, held against the truth, reported.

The protocols run one after the other in this process; a process beside it analyses what was run.
Numbers and start states are named, so that a demonstration gives the same counts whatever lies in its
folder. Ctrl-C is a STOP, a second one an ABORT.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rig.bench.backends.order import StartState, WorldChoice
from rig.errors import RigError
from rig.gears.acceptance import shipped_acceptance
from rig.trial.campaign.conduct import CampaignCallbacks, CampaignOrder, CampaignReport, conduct
from rig.trial.campaign.plan import CampaignPlan, Stage, shipped_plan
from rig.trial.campaign.walk import WalkedStage, walk

if TYPE_CHECKING:
    from experiments.truth import TruthRow
    from model.gear import HarmonicDrive
    from rig.analysis.fit.recorded import Fit
    from rig.run.parts import Progress, RunReport
    from rig.run.stop import StopRequest
    from rig.trial.campaign.journal import DoneStage

CAMPAIGN = "acceptance"
"""The campaign that is demonstrated, and the protocols of it in their order."""
ACCEPTANCE = "demonstration"
"""The acceptance file of a made-up maker, for simulated rigs only."""
REPORT, PARAMETERS = "report.html", "identified.toml"
_CERTIFICATE = ("certificate.html", "certificate.pdf")
ORDER = tuple(stage.protocol for stage in shipped_plan(CAMPAIGN).stages)


@dataclass(frozen=True)
class DemoOrder:
    """What is asked for: folder, seed, values of protocol parameters that differ from their
    defaults (for short tests), and the simulated world. `now` gives the calendar time, ISO 8601.
    """

    folder: Path
    seed: int
    now: Callable[[], str]
    values: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    world: WorldChoice = field(default_factory=WorldChoice)

    @property
    def serial(self) -> str:
        """Serial number of the simulated gear."""
        return f"SIM-{self.seed:04d}"

    @property
    def plan(self) -> CampaignPlan:
        """The campaign with the values of this order."""
        shipped = shipped_plan(CAMPAIGN)
        stages = tuple(Stage(name, dict(self.values.get(name, {}))) for name in ORDER)
        return replace(shipped, stages=stages)


@dataclass(frozen=True)
class Step:
    """One line of progress of one protocol: rig seconds done and left, and what is being done."""

    protocol: str
    done: float
    left: float
    what: str


@dataclass(frozen=True, kw_only=True)
class Finished:
    """One protocol that was run: its file, how it ended, how long it took on this computer [s]."""

    protocol: str
    path: Path
    outcome: str
    message: str
    seconds: float


@dataclass(frozen=True, kw_only=True)
class Demonstration:
    """Everything that a demonstration made."""

    order: DemoOrder
    campaign: CampaignReport
    finished: tuple[Finished, ...]
    fits: tuple[Fit, ...]
    truth: tuple[tuple[str, TruthRow], ...]
    certificate: tuple[Path, ...]
    report: Path
    parameters: Path
    seconds: float

    def as_json(self) -> dict[str, Any]:
        """The object that `rig demo --json` prints."""
        return {
            "seed": self.order.seed,
            "folder": str(self.order.folder),
            "certificate": [str(path) for path in self.certificate],
            "report": str(self.report),
            "parameters": str(self.parameters),
            "seconds": self.seconds,
            "runs": [{"path": str(f.path), "outcome": f.outcome} for f in self.finished],
            "outcome": self.campaign.outcome,
            **self.campaign.verdict.as_json(),
            "fits": [f.result.as_json() for f in self.fits],
            "truth": [_row_as_json(kind, row) for kind, row in self.truth],
            "covered": sum(row.covered for _, row in self.truth),
            "within_uncertainty": sum(row.within for _, row in self.truth),
            "compared": len(self.truth),
        }


def _row_as_json(kind: str, row: TruthRow) -> dict[str, Any]:
    e = row.estimate
    return {
        "kind": kind,
        "name": e.name,
        "found": e.value,
        "low": e.low,
        "high": e.high,
        "expanded_uncertainty": e.expanded_uncertainty,
        "seen_by_this_bench": e.value - row.difference,
        "measurand": e.value - row.error,
        "unit": e.unit,
        "covered": row.covered,
        "within_uncertainty": row.within,
    }


class _Watcher:
    """Tells a demonstration's progress, and keeps what was run."""

    def __init__(self, show: Callable[[Step | Finished], None], folder: Path) -> None:
        self._show, self._folder = show, folder
        self._protocol, self._begun, self._told = "", 0.0, 0.0
        self.finished: list[Finished] = []

    def begun(self, index: int, stage: WalkedStage) -> None:
        self._protocol, self._begun = stage.order.protocol, time.monotonic()
        self._show(Step(self._protocol, 0.0, stage.planned.nominal, "running"))

    def progress(self, now: Progress) -> None:
        instant = time.monotonic()
        if instant - self._told > 0.1:
            self._told = instant
            self._show(Step(self._protocol, now.elapsed, now.left, "running"))

    def ended(self, done: DoneStage, _: RunReport) -> None:
        finished = Finished(
            protocol=done.protocol,
            path=self._folder / done.run,
            outcome=done.outcome,
            message=done.message,
            seconds=time.monotonic() - self._begun,
        )
        self.finished.append(finished)
        self._show(finished)


def demonstrate(
    order: DemoOrder,
    *,
    stop: StopRequest | None = None,
    beside: bool = True,
    show: Callable[[Step | Finished], None] = lambda message: None,
) -> Demonstration:
    """Run, fit, compare and report. Raises `KeyboardInterrupt` when it was stopped, `RigError` where a run or an
    analysis did not come to its end.

    `beside`: the analyses have a process of their own.
    """
    from rig.run.stop import StopRequest

    started = time.monotonic()
    order.folder.mkdir(parents=True, exist_ok=True)
    _name_acceptance(order)
    watcher = _Watcher(show, order.folder)
    report = conduct(
        campaign_order(order, beside=beside),
        CampaignCallbacks(
            stop=stop or StopRequest(),
            ask=lambda prompt: "simulated",
            begun=watcher.begun,
            ended=watcher.ended,
            on_progress=watcher.progress,
        ),
    )
    _refuse_unfinished(order, report)
    report.journal.with_end(report.verdict.verdict, ", ".join(_CERTIFICATE), order.now())
    return _conclude(order, report, tuple(watcher.finished), started)


def campaign_order(order: DemoOrder, *, beside: bool) -> CampaignOrder:
    """The campaign of a demonstration: number and start state of every run are named, whatever lies in its folder."""
    from model.gear_file import shipped_gear
    from model.motor import shipped_motor
    from rig.bench.backends.order import Order
    from rig.run.start import bench_for

    pattern = Order(
        protocol=ORDER[0],
        gear=shipped_gear(),
        motor=shipped_motor(),
        folder=order.folder,
        serial=order.serial,
        operator="rig demo",
        seed=order.seed,
        world=order.world,
    )
    walked = walk(order.plan, pattern)
    stages = tuple(
        replace(one, order=replace(one.order, world=_world(order, number)))
        for number, one in enumerate(walked.stages, 1)
    )
    return CampaignOrder(
        walk=replace(walked, stages=stages),
        bench=bench_for(pattern).id,
        now=order.now,
        acceptance=shipped_acceptance(ACCEPTANCE),
        beside=beside,
        anew=True,
    )


def _name_acceptance(order: DemoOrder) -> None:
    """The gear's card says by what it is judged, so that every reader of the folder gives the same verdict."""
    from rig.gears.card import card_for, save_card, with_changes

    facts = {"serial": order.serial, "acceptance": ACCEPTANCE}
    before = card_for(order.folder, order.serial)
    if before is None or before.facts.acceptance != ACCEPTANCE:
        save_card(order.folder, with_changes(before, facts, "rig demo", order.now()))


def _world(order: DemoOrder, number: int) -> WorldChoice:
    return replace(order.world, number=number, start=StartState())


def _refuse_unfinished(order: DemoOrder, report: CampaignReport) -> None:
    recorded = f"what was recorded is kept in {order.folder}"
    if report.outcome == "ABORTED":
        raise KeyboardInterrupt(recorded)
    last = report.journal.stages[-1]
    refused = [f"{one.run.name}: {one.refused}" for one in report.analysed if one.refused]
    reason = "; ".join([*report.problems, *refused])
    if not report.is_complete:
        reason = f"{last.protocol} {last.outcome}: {last.message}"
    if reason:
        raise RigError(
            "the demonstration did not reach its end", where=str(order.folder), value=reason
        )


def _conclude(
    order: DemoOrder, campaign: CampaignReport, finished: tuple[Finished, ...], started: float
) -> Demonstration:
    from model.gear_file import save_gear
    from rig.analysis.adopt import adopt
    from rig.present.certificate.write import write_certificate
    from rig.present.report import write_report

    fits = tuple(_fit(done.path, done.protocol) for done in finished)
    truth = tuple((fit.result.kind, row) for fit in fits for row in _truth(fit))
    adopted = adopt(_card(fits), [fit.result for fit in fits])
    parameters = order.folder / PARAMETERS
    save_gear(adopted.gear, parameters)
    note = "Made by rig demo: the whole chain, from plan to report, on the simulated rig."
    created = order.now()
    report = write_report(
        fits,
        order.folder / REPORT,
        created=created.replace("T", " ", 1),
        verdict=campaign.verdict,
        truth=truth,
        note=note,
    )
    certificate = write_certificate(
        order.folder,
        order.serial,
        [order.folder / name for name in _CERTIFICATE],
        acceptance=shipped_acceptance(ACCEPTANCE),
        protocols=ORDER,
        created=created,
    )
    return Demonstration(
        order=order,
        campaign=campaign,
        finished=finished,
        fits=fits,
        truth=truth,
        certificate=certificate.paths,
        report=report,
        parameters=parameters,
        seconds=time.monotonic() - started,
    )


def _fit(path: Path, protocol: str) -> Fit:
    """The analysis in force of a run."""
    from rig.analysis.fit.recorded import stored_fit
    from rig.analysis.in_force import in_force

    analysis = in_force(path, protocol).analysis
    assert analysis is not None
    return stored_fit(path, analysis)


def _card(fits: tuple[Fit, ...]) -> HarmonicDrive:
    """The gear's card, with which the runs were planned."""
    card = next(fit.recording.metadata.gear for fit in fits if fit.recording.metadata.gear)
    assert card is not None
    return card


def _truth(fit: Fit) -> Iterator[TruthRow]:
    """What the simulated rig knows of this fit; numbers that the data cannot identify are compared with nothing."""
    from experiments.truth import truth_of, truth_rows

    for row in truth_rows(fit.result, truth_of(fit.recording.metadata.process)):
        if row.estimate.identifiable != "no":
            yield row
