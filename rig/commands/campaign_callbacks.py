"""Who looks after a campaign: a person at the terminal, or another program by lines of JSON."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from experiments.steps.note import Prompt
from rig.commands.terminal import echo
from rig.content.phrase import phrase

if TYPE_CHECKING:
    from rig.bench.backends.order import Order
    from rig.run.dry_run import PlannedRun
    from rig.run.parts import RunReport
    from rig.run.remote import RemoteOperator
    from rig.run.stop import StopRequest
    from rig.trial.campaign.analyst import Analysing
    from rig.trial.campaign.conduct import CampaignCallbacks
    from rig.trial.campaign.journal import DoneStage
    from rig.trial.campaign.walk import Walk, WalkedStage


@contextmanager
def terminal_callbacks(walked: Walk, quiet: bool) -> Iterator[CampaignCallbacks]:
    """STOP by signals, prompts at the terminal, each run armed by whoever sits there, and progress."""
    from rig.commands.ordering import confirmed
    from rig.commands.progress import progress_line
    from rig.commands.prompting import terminal_ask
    from rig.run.stop import StopRequest, pressed_by_signals
    from rig.trial.campaign.conduct import CampaignCallbacks

    stop = StopRequest()
    number = len(walked.stages)

    def begun(index: int, one: WalkedStage) -> None:
        if not quiet:
            echo(f"[{index + 1}/{number}] {one.order.protocol}", errors=True)

    def ended(done: DoneStage, _: RunReport) -> None:
        if not quiet:
            echo(f"      {done.outcome}  {done.run}  {done.message}".rstrip(), errors=True)

    def analysing(one: Analysing) -> None:
        if not quiet:
            echo(f"      {_analysing_in_words(one)}", errors=True)

    def confirm(order: Order, planned: PlannedRun) -> str:
        return confirmed(order, planned, "", not quiet)

    with (
        pressed_by_signals(stop),
        progress_line(f"campaign {walked.plan.name}", walked.nominal, quiet) as (progress, _),
    ):
        yield CampaignCallbacks(
            stop=stop,
            ask=terminal_ask(stop),
            confirm=confirm,
            begun=begun,
            ended=ended,
            analysing=analysing,
            on_progress=progress,
        )


@contextmanager
def program_callbacks(
    walked: Walk, remote: RemoteOperator, stop: StopRequest, *, listens: bool
) -> Iterator[CampaignCallbacks]:
    """Words on standard input where it `listens`, lines of JSON on standard output, STOP by signals as well."""
    from rig.commands.prompting import program_ask
    from rig.run.remote import lines_of
    from rig.run.stop import pressed_by_signals
    from rig.trial.campaign.conduct import CampaignCallbacks

    def confirm(order: Order, planned: PlannedRun) -> str:
        return typed_by(remote, stop, order, planned) if listens else ""

    def begun(index: int, one: WalkedStage) -> None:
        remote.tell("stage", {"index": index, "protocol": one.order.protocol, "state": "begun"})

    def ended(done: DoneStage, report: RunReport) -> None:
        remote.tell("stage", {**_stage_object(done), "state": "ended", "report": report.as_json()})

    def standing(done: DoneStage) -> None:
        remote.tell("stage", {**_stage_object(done), "state": "counts"})

    def analysing(one: Analysing) -> None:
        left = one.left if math.isfinite(one.left) else None
        words = _analysing_in_words(one)
        remote.tell("analysing", {"what": words, "waiting": one.waiting, "left": left})

    remote.tell("campaign", _announced(walked))
    if listens:
        remote.listen_in_background(lines_of(sys.stdin.fileno()))
    with pressed_by_signals(stop):
        yield CampaignCallbacks(
            stop=stop,
            ask=program_ask(remote, stop, listens=listens),
            confirm=confirm,
            begun=begun,
            ended=ended,
            standing=standing,
            analysing=analysing,
            on_progress=remote.on_progress,
            on_event=remote.on_event,
        )


def _announced(walked: Walk) -> dict[str, object]:
    """What a program is told before the first stage."""
    return {
        "campaign": walked.plan.name,
        "title": walked.plan.title,
        "gear": walked.stages[0].order.serial,
        "stages": [
            {
                "protocol": one.order.protocol,
                "nominal": one.planned.nominal,
                "longest": one.planned.longest,
            }
            for one in walked.stages
        ],
    }


def _analysing_in_words(one: Analysing) -> str:
    """Which run is being analysed, and how many wait behind it."""
    return f"analysing {one.run.stem}{phrase(', {} behind it', one.waiting)}"


def typed_by(remote: RemoteOperator, stop: StopRequest, order: Order, planned: PlannedRun) -> str:
    """What the operator of another program typed to arm a run on hardware; "" for every other rig.

    Every run of a campaign is armed anew: between two of them somebody had hands on the rig. A STOP
    leaves it unconfirmed, and arming refuses it.
    """
    from rig.bench.backends.registry import HARDWARE
    from rig.run.start import arming_of

    if order.backend != HARDWARE:
        return ""
    question = arming_of(order, planned).question
    prompt = Prompt(f"{planned.experiment.title}. {question}.", "arming")
    answer = remote.ask(prompt)
    while answer is None and not stop.level:
        answer = remote.ask(prompt)
    return answer or ""


def _stage_object(done: DoneStage) -> dict[str, object]:
    return {
        "index": done.index,
        "protocol": done.protocol,
        "run": done.run,
        "outcome": done.outcome,
        "message": done.message,
    }
