"""What the Prepare page hands over: the run, or the campaign, that was looked ahead to, and what it is in one line."""

from __future__ import annotations

from pathlib import Path

from rig.bench.backends.order import Order
from rig.window.prepare.campaign import campaign_arguments
from rig.window.prepare.preview_plot import summary
from rig.window.prepare.request import Outlook, arguments_for, title_of
from rig.window.prepare.walk_table import walk_summary
from rig.window.work.prepared import PreparedCampaign, PreparedRun


def handed_over(
    outlook: Outlook, order: Order, parameters: Path | None, notes: tuple[str, ...]
) -> PreparedRun | PreparedCampaign:
    """The run, or the campaign, that an outlook planned without a problem; `notes` say who signed what."""
    if outlook.walk is not None:
        intent = outlook.intent
        words = campaign_arguments(order, intent.campaign, parameters, anew=intent.anew)
        title = f"{outlook.walk.plan.title} · {order.serial}"
        return PreparedCampaign(outlook.walk, words, title, notes)
    assert outlook.planned is not None
    return PreparedRun(
        order,
        outlook.planned,
        arguments_for(order, outlook.intent.confirmation.strip(), parameters),
        outlook.preview,
        title_of(order, outlook.planned),
        notes,
    )


def summary_of(outlook: Outlook) -> str:
    """What is planned, in one line."""
    if outlook.walk is not None:
        return walk_summary(outlook.walk, outlook.done)
    return summary(outlook.preview) if outlook.preview is not None else "No plan."
