"""A campaign conducted: stage after stage, each run sealed and analysed, until the end or until something stops it.

A trip, an error and a STOP stop it; a quantity that breaks its limit does not. What was done stays in the
journal, and the same command goes on from there. A tare that turned out too old or too far in
temperature while its runs were analysed is taken again, once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rig.analysis.judging import GearVerdict, StoredResult, judge, stored_result
from rig.analysis.tare import takes_tare, tare_kind
from rig.runfile.seal import sealed_sha256
from rig.trial.campaign import journal as journals
from rig.trial.campaign.analyst import Analysed, Analysing, Analyst, analyst
from rig.trial.campaign.journal import DoneStage, Journal
from rig.trial.campaign.standing import facts_of, outdated, refuse_another
from rig.trial.campaign.walk import Walk, WalkedStage

if TYPE_CHECKING:
    from experiments.recording import Event
    from rig.bench.backends.order import Order
    from rig.gears.acceptance import Acceptance
    from rig.run.dry_run import PlannedRun
    from rig.run.engine import Ask
    from rig.run.parts import Progress, RunReport
    from rig.run.stop import StopRequest


@dataclass(frozen=True, kw_only=True)
class CampaignOrder:
    """What is asked for: the walked campaign, for which gear, judged by what.

    `beside` analyses in a process of its own, on simulated rigs only. `anew` begins again where an
    unfinished campaign could go on. `bench` is the identity of the bench; `now` tells the calendar time
    (ISO 8601), which journal and analyses bear.
    """

    walk: Walk
    bench: str
    now: Callable[[], str]
    acceptance: Acceptance | None = None
    beside: bool = False
    anew: bool = False

    @property
    def serial(self) -> str:
        """The serial number of the gear, as the orders of its runs have it."""
        return self.walk.stages[0].order.serial

    @property
    def folder(self) -> Path:
        """Where its runs go."""
        return self.walk.stages[0].order.folder


@dataclass(frozen=True, kw_only=True)
class CampaignCallbacks:
    """Who has a say while a campaign goes on: STOP, prompts, the arming of each run, and what is shown.

    `confirm` asks for what arms a run on hardware, once for each run and kept nowhere; `begun` hears of a stage that
    begins, `ended` of one that was run, `standing` of one that was run before and still counts, `analysing` of each
    analysis that is waited for.
    """

    stop: StopRequest
    ask: Ask
    confirm: Callable[[Order, PlannedRun], str] = lambda order, planned: ""
    begun: Callable[[int, WalkedStage], None] = lambda index, stage: None
    ended: Callable[[DoneStage, RunReport], None] = lambda done, report: None
    standing: Callable[[DoneStage], None] = lambda done: None
    analysing: Callable[[Analysing], None] = lambda one: None
    on_progress: Callable[[Progress], None] | None = None
    on_event: Callable[[Event], None] | None = None


@dataclass(frozen=True, kw_only=True)
class CampaignReport:
    """How a campaign stands: its runs, what stopped it, and the one verdict.

    `outcome` is COMPLETED where every stage is done, else that of the run that stopped it. `problems`
    are analyses that crashed: the file or the program, never the gear.
    """

    walk: Walk
    journal: Journal
    outcome: str
    verdict: GearVerdict
    verdict_rests_on: int
    """Number of analysed runs that were judged."""
    analysed: tuple[Analysed, ...] = ()
    resumed: tuple[str, ...] = field(default=())
    """What was found out of date when it went on, in words."""

    @property
    def is_complete(self) -> bool:
        """Whether every stage was brought to its end."""
        return self.outcome == "COMPLETED"

    @property
    def problems(self) -> tuple[str, ...]:
        """Analyses that crashed, in words."""
        return tuple(f"{one.run.name}: {one.crashed}" for one in self.analysed if one.crashed)

    @property
    def runs(self) -> tuple[DoneStage, ...]:
        """The run of every stage that counts, in order."""
        newest = (self.journal.newest(index) for index in range(len(self.walk.stages)))
        return tuple(done for done in newest if done is not None and done.counts)

    def as_json(self) -> dict[str, Any]:
        """The object that `rig campaign --json` prints."""
        refused = {one.run.name: one.refused for one in self.analysed}
        return {
            "campaign": self.walk.plan.name,
            "gear": self.journal.begun.get("gear", ""),
            "journal": str(self.journal.path),
            "outcome": self.outcome,
            "complete": self.is_complete,
            **self.verdict.as_json(),
            "problems": list(self.problems),
            "resumed": list(self.resumed),
            "runs": [
                {
                    "protocol": done.protocol,
                    "file": done.run,
                    "outcome": done.outcome,
                    "message": done.message,
                    "refused": refused.get(done.run, ""),
                    "outdated": done.outdated,
                }
                for done in self.journal.stages
            ],
        }


def conduct(order: CampaignOrder, crew: CampaignCallbacks) -> CampaignReport:
    """Run what is not done yet, analyse it, and judge the gear. Raises only before anything moves."""
    journal, resumed = _opened(order)
    analysed: list[Analysed] = []
    with analyst(order.now, beside=order.beside, told=crew.analysing) as analyses:
        # What a campaign of an earlier day left unanalysed is analysed first.
        for path in _unanalysed(journal, order.folder):
            analyses.take(path)
        for is_last in (False, True):
            journal, report = _run_missing(journal, order, crew, analyses)
            analysed += analyses.all()
            if report is not None and report.outcome != "COMPLETED":
                return _concluded(order, journal, report.outcome, analysed, resumed)
            journal, outdated_tare = _without_tare(journal, order, analysed)
            if is_last or not outdated_tare:
                break
            resumed = (*resumed, outdated_tare)
        if resumed:
            analysed += _again(journal, order, analyses, analysed)
    return _concluded(order, journal, "COMPLETED", analysed, resumed)


def _opened(order: CampaignOrder) -> tuple[Journal, tuple[str, ...]]:
    """The journal of the campaign that goes on, or of a new one, and what of it is out of date."""
    facts = facts_of(order.folder, order.serial, order.bench)
    found = None if order.anew else journals.unfinished(order.folder, order.walk.plan, order.serial)
    if found is None:
        return journals.begin(order.folder, order.walk.plan, order.serial, facts, order.now()), ()
    refuse_another(found, order.walk.plan, facts)
    words = []
    for index, because in tuple(outdated(found, facts, order.folder, order.now())):
        words.append(f"{order.walk.stages[index].order.protocol} is done again: {because}")
        found = found.with_outdated(index, because, order.now())
    return found, tuple(words)


def _run_missing(
    journal: Journal, order: CampaignOrder, crew: CampaignCallbacks, analyses: Analyst
) -> tuple[Journal, RunReport | None]:
    """Run every stage that does not count yet, until one does not come to its end."""
    from rig.run.start import run_order

    report = None
    for index, one in enumerate(order.walk.stages):
        before = journal.newest(index)
        if before is not None and before.counts:
            crew.standing(before)
            continue
        confirmation = crew.confirm(one.order, one.planned)
        crew.begun(index, one)
        report = run_order(
            one.order,
            one.planned,
            confirmation=confirmation,
            stop=crew.stop,
            ask=crew.ask,
            on_progress=crew.on_progress,
            on_event=crew.on_event,
        )
        done = DoneStage(
            index=index,
            protocol=one.order.protocol,
            run=report.path.name,
            outcome=report.outcome,
            message=report.message,
            at=order.now(),
            sha256=sealed_sha256(report.path) if report.path.is_file() else "",
        )
        journal = journal.with_stage(done)
        crew.ended(done, report)
        if report.outcome != "COMPLETED":
            break
        analyses.take(report.path)
    return journal, report


def _without_tare(
    journal: Journal, order: CampaignOrder, analysed: list[Analysed]
) -> tuple[Journal, str]:
    """The journal in which a tare that was refused by all that needs one does not count, and why; else as it was."""
    lacking = next((one for one in analysed if one.without_tare), None)
    stages = [one.order.protocol for one in order.walk.stages]
    if lacking is None or tare_kind() not in stages:
        return journal, ""
    because = "; ".join(lacking.without_tare)
    journal = journal.with_outdated(stages.index(tare_kind()), because, order.now())
    return journal, f"{tare_kind()} is done again: {because}"


def _again(
    journal: Journal, order: CampaignOrder, analyses: Analyst, analysed: list[Analysed]
) -> list[Analysed]:
    """Analyse again what lacked the tare that is there now."""
    lacking = {one.run for one in analysed if one.without_tare}
    for done in journal.stages:
        path = order.folder / done.run
        if done.counts and takes_tare(done.protocol) and path in lacking:
            analyses.take(path)
    return list(analyses.all())


def _unanalysed(journal: Journal, folder: Path) -> Iterator[Path]:
    """Runs of the journal that count and that nobody has analysed: what a stopped campaign left behind."""
    from rig.analysis.in_force import in_force

    for index in range(len(journal.begun.get("protocols", ()))):
        done = journal.newest(index)
        if done is not None and done.counts:
            path = folder / done.run
            if in_force(path, done.protocol).analysis is None:
                yield path


def _concluded(
    order: CampaignOrder,
    journal: Journal,
    outcome: str,
    analysed: list[Analysed],
    resumed: tuple[str, ...],
) -> CampaignReport:
    newest = {one.run: one for one in analysed}
    found = list(_analyses_in_force(journal, order))
    return CampaignReport(
        walk=order.walk,
        journal=journal,
        outcome=outcome,
        verdict=judge(found, order.acceptance),
        verdict_rests_on=len(found),
        analysed=tuple(newest.values()),
        resumed=resumed,
    )


def _analyses_in_force(journal: Journal, order: CampaignOrder) -> Iterator[StoredResult]:
    """The analyses in force of the runs that count."""
    from rig.analysis.in_force import in_force
    from rig.gears.acceptance import Part
    from rig.runfile.read import read_run_header

    for index in range(len(order.walk.stages)):
        done = journal.newest(index)
        if done is None or not done.counts:
            continue
        path = order.folder / done.run
        found = in_force(path, done.protocol)
        if found.analysis is not None:
            metadata = read_run_header(path).metadata
            yield stored_result(
                found,
                metadata.origin,
                metadata.outcome,
                metadata.gear_serial,
                part=Part.of(metadata),
                path=path,
            )
