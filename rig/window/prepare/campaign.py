"""A campaign on the Prepare page: from its plan to the walk of all its runs, its checks, and what starts it.

No Qt in here, as in `request`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from experiments import catalogue
from experiments.errors import ExperimentError
from experiments.finding import Finding, Severity
from model.errors import ModelError
from rig.bench.backends.order import Order, arguments_of
from rig.errors import RigError
from rig.present.preview.plan import preview_plan
from rig.run.preflight import static_checks
from rig.run.progress import in_words
from rig.trial.campaign import journal as journals
from rig.trial.campaign.plan import CampaignPlan, load_plan, shipped_names, shipped_plan
from rig.trial.campaign.walk import Walk, walk
from rig.window.prepare.request import (
    SAID_OF_A_RUN,
    Intent,
    Outlook,
    gear_checks,
    latch_checks,
    order_for,
    parameters_check,
    prediction_checks,
)

WORST_FIRST = tuple(reversed(Severity))


def plan_named(campaign: str) -> CampaignPlan:
    """The plan of a campaign that ships, or that of a file. Raises `ConfigurationError`."""
    return shipped_plan(campaign) if campaign in shipped_names() else load_plan(Path(campaign))


def armed_protocol(plan: CampaignPlan) -> str:
    """The protocol that speaks for a campaign: its first with a gear, which is what the page asks for."""
    names = [stage.protocol for stage in plan.stages]
    return next((name for name in names if catalogue.load(name).gear_mounted), names[0])


def look_ahead_campaign(intent: Intent) -> Outlook:
    """Walk and check a campaign; what refuses it is part of the answer."""
    problem: Exception | None = None
    order: Order | None = None
    walked: Walk | None = None
    checks: list[Finding] = []
    done: tuple[str, ...] = ()
    try:
        plan = plan_named(intent.campaign)
        order = order_for(replace(intent, protocol=armed_protocol(plan), values={}))
        walked = walk(plan, order)
        checks += _walk_checks(walked, intent)
        if not intent.anew:
            done = _runs_that_count(intent.rig.folder, plan, order.serial)
    except (RigError, ExperimentError, ModelError) as error:
        problem = error
    checks[:0] = gear_checks(intent)
    checks += latch_checks(intent.rig)
    return Outlook(
        intent, order=order, checks=tuple(checks), problem=problem, walk=walked, done=done
    )


def _walk_checks(walked: Walk, intent: Intent) -> list[Finding]:
    """What is known of all the runs: parameters, plan, every prediction that touches a limit, disk and ratings."""
    steps = sum(len(one.planned.plan) for one in walked.stages)
    evidence = (
        f"{len(walked.stages)} runs, {steps} steps, {in_words(walked.nominal)} nominal, "
        f"{in_words(walked.longest)} at most, prompts not counted"
    )
    mounted = next(
        (one.planned for one in walked.stages if one.planned.experiment.gear_mounted),
        walked.stages[0].planned,
    )
    checks = [parameters_check(mounted, intent.rig), Finding("plan", Severity.PASSED, evidence)]
    of_runs = [
        (one.order.protocol, check)
        for one in walked.stages
        for check in (
            *prediction_checks(preview_plan(one.planned)),
            *static_checks(one.planned, intent.rig.folder),
        )
    ]
    return checks + joined(of_runs)


def joined(of_runs: Sequence[tuple[str, Finding]]) -> list[Finding]:
    """The checks of all runs: what is not good once, with the runs that it holds for; what is good in one line."""
    runs: dict[Finding, list[str]] = {}
    for protocol, check in of_runs:
        runs.setdefault(check, []).append(protocol)
    bad = [check for check in runs if check.severity is not Severity.PASSED]
    named = {check.what for check in bad}
    told = [replace(c, found=f"{', '.join(runs[c])}: {c.found}") for c in bad]
    good = dict.fromkeys(check.what for check in runs if check.what not in named)
    told += [Finding(name, Severity.PASSED, "good for every run") for name in good]
    return sorted(told, key=lambda check: WORST_FIRST.index(check.severity))


def _runs_that_count(folder: Path, plan: CampaignPlan, serial: str) -> tuple[str, ...]:
    """The run of every stage of an unfinished campaign that is done already; nothing where none is unfinished.

    Whether it still counts is looked at once more when the campaign goes on. Raises `RunFileError`.
    """
    journal = journals.unfinished(folder, plan, serial)
    if journal is None:
        return ()
    newest = (journal.newest(index) for index in range(len(plan.stages)))
    return tuple(one.run if one is not None and one.counts else "" for one in newest)


def campaign_arguments(
    order: Order, campaign: str, parameters: Path | None = None, *, anew: bool = False
) -> list[str]:
    """What follows `python -m rig` to start a campaign as a child that is spoken to in lines."""
    words = ["campaign"]
    words.append(campaign if campaign in shipped_names() else f"--plan={campaign}")
    words += arguments_of(order, SAID_OF_A_RUN, parameters)
    if anew:
        words.append("--anew")
    return [*words, "--events", "--stdin-control"]
