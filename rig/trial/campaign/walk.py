"""A campaign walked without a rig: every protocol planned, the total time, the nearest limit of all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from rig.content.grid import Grid, columns
from rig.errors import RigError
from rig.run.progress import in_words
from rig.trial.campaign.plan import CampaignPlan

if TYPE_CHECKING:
    from rig.bench.backends.order import Order
    from rig.run.dry_run import PlannedRun


@dataclass(frozen=True)
class WalkedStage:
    """One stage as it would be run."""

    order: Order
    planned: PlannedRun


@dataclass(frozen=True)
class Walk:
    """All stages of a campaign, planned."""

    plan: CampaignPlan
    stages: tuple[WalkedStage, ...]

    @property
    def nominal(self) -> float:
        """Nominal duration of all runs [s]; prompts and fits are not counted."""
        return sum(one.planned.nominal for one in self.stages)

    @property
    def longest(self) -> float:
        """Duration if every step takes as long as it may [s]."""
        return sum(one.planned.longest for one in self.stages)

    def as_json(self) -> dict[str, Any]:
        """As `rig campaign --dry-run --json` prints it."""
        return {
            "campaign": self.plan.name,
            "title": self.plan.title,
            "duration": {"nominal": self.nominal, "longest": self.longest, "unit": "s"},
            "protocols": [one.planned.as_json() for one in self.stages],
        }


def walk_grid(walked: Walk, done: Sequence[str] = ()) -> Grid:
    """One row for each run: how long it takes, its nearest limit, and the run that counts for it already."""
    rows = []
    for index, one in enumerate(walked.stages):
        nearest = min(one.planned.margins, key=lambda margin: margin.margin, default=None)
        limit, left = ("–", "–") if nearest is None else (nearest.cells[0], nearest.cells[-1])
        times = (in_words(one.planned.nominal), in_words(one.planned.longest))
        counts = done[index] if index < len(done) else ""
        rows.append((str(index + 1), one.order.protocol, *times, limit, left, counts))
    heads = columns(
        ("run", "number"),
        "protocol",
        ("nominal", "number"),
        ("at most", "number"),
        "nearest limit",
        ("margin left", "number"),
        "done as",
    )
    return Grid(walked.plan.title, heads, rows)


def walk(plan: CampaignPlan, order: Order) -> Walk:
    """Plan every stage with `order` as the pattern of its run. Nothing is opened.

    Raises the first error of any stage as `RigError`s and `PlanError`s say it: a campaign that would
    break a limit in its last protocol does not begin with its first.
    """
    from rig.run.start import plan_order

    stages = []
    for stage in plan.stages:
        wanted = replace(order, protocol=stage.protocol, values=dict(stage.values))
        stages.append(WalkedStage(wanted, plan_order(wanted)))
    if not stages:
        raise RigError("a campaign needs at least one protocol", where=plan.path)
    return Walk(plan, tuple(stages))
