"""A campaign seen in advance: its runs in their order, how long each takes, which limit each comes nearest to."""

from __future__ import annotations

from collections.abc import Sequence

from rig.content.grid import Grid
from rig.content.phrase import phrase
from rig.run.progress import in_words
from rig.trial.campaign.walk import Walk, walk_grid
from rig.window.review.grid import GridTable
from rig.window.shell.session import WindowSession

_NO_RUNS = Grid("", (), ())


class WalkTable(GridTable):
    """The runs of a campaign. `show_walk` fills it."""

    def __init__(self, session: WindowSession) -> None:
        super().__init__(session, "Runs of the campaign")

    def show_walk(self, walked: Walk | None, done: Sequence[str] = ()) -> None:
        """A walked campaign; `done` names the run that counts already for each of its stages, "" for none."""
        self.show_grid(_NO_RUNS if walked is None else walk_grid(walked, done))


def walk_summary(walked: Walk, done: Sequence[str] = ()) -> str:
    """A campaign in one line: how long what is still to be run takes."""
    left = [one for index, one in enumerate(walked.stages) if index >= len(done) or not done[index]]
    nominal = in_words(sum(one.planned.nominal for one in left))
    longest = in_words(sum(one.planned.longest for one in left))
    words = f"{walked.plan.title}: {len(left)} runs, {nominal} nominal, {longest} at most"
    finished = len(walked.stages) - len(left)
    return words + phrase(" · goes on: {} of {} are done", finished, len(walked.stages))
