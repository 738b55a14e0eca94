"""A campaign seen in advance: its runs in their order, how long each takes, which limit each comes nearest to."""

from __future__ import annotations

from collections.abc import Sequence

from rig.content.grid import Grid, columns
from rig.content.wording import percent
from rig.run.progress import in_words
from rig.trial.campaign.walk import Walk
from rig.window.review.grid import GridTable
from rig.window.shell.session import WindowSession

COLUMNS = columns(
    ("run", "number"),
    "protocol",
    ("nominal", "number"),
    ("at most", "number"),
    "nearest limit",
    ("margin left", "number"),
    "done as",
)


class WalkTable(GridTable):
    """The runs of a campaign. `show_walk` fills it."""

    def __init__(self, session: WindowSession) -> None:
        super().__init__(session, "Runs of the campaign")

    def show_walk(self, walked: Walk | None, done: Sequence[str] = ()) -> None:
        """A walked campaign; `done` names the run that counts already for each of its stages, "" for none."""
        rows = [] if walked is None else walk_rows(walked, done)
        self.show_grid(Grid("", COLUMNS, rows))


def walk_rows(walked: Walk, done: Sequence[str] = ()) -> list[tuple[str, ...]]:
    """One row for each run of a campaign."""
    rows = []
    for index, one in enumerate(walked.stages):
        nearest = min(one.planned.margins, key=lambda margin: margin.margin, default=None)
        rows.append(
            (
                str(index + 1),
                one.order.protocol,
                in_words(one.planned.nominal),
                in_words(one.planned.longest),
                nearest.quantity.replace("_", " ") if nearest else "–",
                percent(nearest.margin) if nearest else "–",
                done[index] if index < len(done) else "",
            )
        )
    return rows


def walk_summary(walked: Walk, done: Sequence[str] = ()) -> str:
    """A campaign in one line: how long what is still to be run takes."""
    left = [one for index, one in enumerate(walked.stages) if index >= len(done) or not done[index]]
    nominal = in_words(sum(one.planned.nominal for one in left))
    longest = in_words(sum(one.planned.longest for one in left))
    words = f"{walked.plan.title}: {len(left)} runs, {nominal} nominal, {longest} at most"
    finished = len(walked.stages) - len(left)
    return words + (f" · goes on: {finished} of {len(walked.stages)} are done" if finished else "")
