"""What the Prepare page hands to the Run page: a run, or a campaign of runs, planned, signed off, not yet started."""

from __future__ import annotations

from dataclasses import dataclass

from rig.bench.backends.order import Order
from rig.run.dry_run import PlannedRun
from rig.trial.campaign.walk import Walk


@dataclass(frozen=True)
class PreparedRun:
    """A run that may be started.

    `arguments` is everything after `python -m rig`: it begins with "run" and ends with "--events --stdin-control".
    `prediction` is the `PlanPreview` that the Prepare page drew in advance (None: nothing was predicted).
    """

    order: Order
    planned: PlannedRun
    arguments: list[str]
    prediction: object | None = None
    title: str = ""
    notes: tuple[str, ...] = ()
    """What is written into the run at its start: who signed which items of the checklist."""


@dataclass(frozen=True)
class PreparedCommission:
    """A commissioning that may be started; its child tells the stages that are missing. `arguments` begins with
    "commission".
    """

    arguments: list[str]
    title: str = ""


@dataclass(frozen=True)
class PreparedCampaign:
    """A campaign that may be started: as `PreparedRun`, all its runs walked; `arguments` begins with "campaign"."""

    walk: Walk
    arguments: list[str]
    title: str = ""
    notes: tuple[str, ...] = ()
