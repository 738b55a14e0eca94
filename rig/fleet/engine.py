"""Who works: this process, some processes of this computer, or a cluster that is there already. One interface for all.

Runs go out in batches of about two seconds of work, by what runs of their kind took so far. No more batches are
underway than keep every worker busy, so that a scheduler holds few tasks however many runs there are, and workers that
join late get their share. A batch that a worker did not survive goes out again, run by run; what kills two workers
by itself is told as a failure of that run.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any

from rig.errors import RigError
from rig.fleet.task import Done, Job, RunTask, work

if TYPE_CHECKING:
    from distributed import Client, Future

BATCH_SECONDS = 2.0
"""Work of one task [s]: long against what a task costs the scheduler, short against what is lost with a worker."""
FIRST_GUESS = 0.5
"""Seconds per run of a kind of which none is done yet."""
MOST_RUNS = 500
"""Runs of one batch."""
AHEAD = 2
"""Batches underway for every thread of the workers."""


class Batches:
    """The runs that are still to be done, handed out in batches of about `BATCH_SECONDS`."""

    def __init__(self, tasks: Sequence[RunTask]) -> None:
        self._waiting = deque(tasks)
        self._suspects: deque[RunTask] = deque()
        self._seconds: dict[str, float] = {}

    def __bool__(self) -> bool:
        return bool(self._waiting or self._suspects)

    def take(self) -> list[RunTask]:
        """The next batch; empty where nothing is left. A run that was in a batch that killed its worker comes alone."""
        if self._suspects:
            return [self._suspects.popleft()]
        batch: list[RunTask] = []
        expected = 0.0
        while self._waiting and len(batch) < MOST_RUNS:
            expected += self._seconds.get(self._waiting[0].kind, FIRST_GUESS)
            if batch and expected > BATCH_SECONDS:
                break
            batch.append(self._waiting.popleft())
        return batch

    def suspect(self, batch: Sequence[RunTask]) -> None:
        """Hand out these runs again, each alone."""
        self._suspects.extend(batch)

    def learn(self, batch: Sequence[RunTask], seconds: float) -> None:
        """What a batch took; one of several kinds teaches nothing about any of them."""
        kinds = {task.kind for task in batch}
        if len(kinds) == 1 and batch:
            kind = kinds.pop()
            here = max(seconds / len(batch), 1e-3)
            self._seconds[kind] = 0.5 * (self._seconds.get(kind, here) + here)


Finished = tuple[list[RunTask], Done]


def work_here(job: Job, batches: Batches) -> Iterator[Finished]:
    """All batches, one after the other, in this process."""
    while batch := batches.take():
        done = work(job, batch)
        batches.learn(batch, done.seconds)
        yield batch, done


def work_on(client: Client, job: Job, batches: Batches) -> Iterator[Finished]:
    """All batches on the workers of a cluster, in the order in which they come to their end."""
    from distributed import as_completed

    underway: dict[Future, list[RunTask]] = {}
    coming = as_completed(loop=client.loop, raise_errors=False)
    try:
        while batches or underway:
            room = AHEAD * max(sum(client.nthreads().values()), 1) - len(underway)
            for _ in range(room):
                batch = batches.take()
                if not batch:
                    break
                future = client.submit(work, job, batch, pure=False)
                underway[future] = batch
                coming.add(future)
            future = next(coming)
            batch = underway.pop(future)
            done = _outcome(future, batch, batches)
            if done is not None:
                batches.learn(batch, done.seconds)
                yield batch, done
    finally:
        client.cancel(list(underway))


def _outcome(future: Future, batch: Sequence[RunTask], batches: Batches) -> Done | None:
    """What came of a batch; None where its runs go out again, each alone."""
    if future.status == "finished":
        return future.result()
    error = future.exception()
    if len(batch) > 1:
        batches.suspect(batch)
        return None
    reason = f"no worker came to its end with it: {error}"
    from rig.fleet.task import lost

    return lost(batch[0], reason)


@contextmanager
def cluster(workers: int, scheduler: str = "") -> Iterator[Client]:
    """A client of the cluster at `scheduler`, or of one of so many processes of this computer, closed at the end.

    Raises `RigError` where no scheduler answers.
    """
    import dask
    from distributed import Client, LocalCluster

    quiet: dict[str, Any] = {"distributed.comm.timeouts.connect": "10s"}
    with ExitStack() as stack:
        stack.enter_context(dask.config.set(quiet))
        if scheduler:
            try:
                yield stack.enter_context(Client(scheduler, set_as_default=False))
            except OSError as error:
                raise RigError(
                    "no scheduler answers",
                    where="--scheduler",
                    value=scheduler,
                    limit=str(error),
                    remedy="Start one: dask scheduler, and beside it: dask worker ADDRESS --nthreads 1.",
                ) from None
            return
        local = stack.enter_context(
            LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                processes=True,
                dashboard_address=None,
                memory_limit=0,
            )
        )
        yield stack.enter_context(Client(local, set_as_default=False))
