"""Who works: this process, some processes of this computer, or a cluster that is there already. One interface for all.

Pieces of work (runs to fit, days to simulate) go out in batches of about two seconds, by what their kind took so far.
Where workers are many, batches are longer.
No more batches are underway than keep every worker busy, so that a scheduler holds few tasks however many pieces there
are, and workers that join late get their share. A batch that its workers did not survive goes out again, piece by
piece; a piece that no worker survives is told as lost.
"""

from __future__ import annotations

import logging
import math
import time
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar, cast

from model.errors import without_traceback
from rig.errors import ConfigurationError, RigError

if TYPE_CHECKING:
    from distributed import Client, Future

BATCH_SECONDS = 2.0
"""Work of one task [s]: long against what a task costs the scheduler, short against what is lost with a worker."""
_FIRST_GUESS = 0.5
"""Seconds of a piece of work of a kind of which none is done yet."""
_LARGEST_BATCH = 500
"""Pieces of one batch."""
CONNECT_TIMEOUT = "10s"
"""How long a scheduler is called before it does not answer."""
SETTINGS: dict[str, Any] = {"distributed.worker.profile.enabled": False}
"""What is set in the processes that are made here: by a profile of every second, kept for an hour, they would grow."""
_TASKS_PER_SECOND = 50.0
"""Tasks that one scheduler is given: with more than a hundred workers a batch is longer than `BATCH_SECONDS`."""
_COUNTED_AGAIN = 1.0
"""s after which the workers are counted again: some may have joined, others have left."""
AHEAD = 2
"""Batches underway for every thread of the workers."""


@dataclass(frozen=True, kw_only=True)
class Workforce:
    """Who works: `workers` processes of this computer, 0 for this one alone, or the cluster at the address `scheduler`.

    `batch_seconds` of work is one task. Raises `ConfigurationError` for both, and for fewer processes than none.
    """

    workers: int = 0
    scheduler: str = ""
    batch_seconds: float = BATCH_SECONDS

    def __post_init__(self) -> None:
        if self.workers < 0 or (self.workers and self.scheduler):
            raise ConfigurationError(
                "is no crew",
                where="--workers, --scheduler",
                value=", ".join(map(str, filter(None, (self.workers, self.scheduler)))),
                limit="a number of processes of this computer >= 0, or a cluster",
            )

    @property
    def is_this_process(self) -> bool:
        """Whether nobody else works."""
        return not (self.workers or self.scheduler)

    @property
    def packages(self) -> tuple[str, ...]:
        """What must be installed for it to work, the results' own format included."""
        return ("pyarrow",) if self.is_this_process else ("pyarrow", "distributed")


class Piece(Protocol):
    """A piece of work: pieces of one kind take about the same time."""

    @property
    def kind(self) -> str: ...


class Outcome(Protocol):
    """What came of a batch, and how long it took [s]."""

    @property
    def seconds(self) -> float: ...


_SomePiece = TypeVar("_SomePiece", bound=Piece)
_SomeOutcome = TypeVar("_SomeOutcome", bound=Outcome)


class Batches(Generic[_SomePiece]):
    """The pieces that are still to be done, handed out in batches of about `batch_seconds` of work."""

    def __init__(self, pieces: Sequence[_SomePiece], batch_seconds: float = BATCH_SECONDS) -> None:
        self._least_seconds = self._batch_seconds = batch_seconds
        self._waiting = deque(pieces)
        self._suspects: deque[_SomePiece] = deque()
        self._seconds: dict[str, float] = {}

    def __bool__(self) -> bool:
        return bool(self._waiting or self._suspects)

    def take(self) -> list[_SomePiece]:
        """The next batch; empty where nothing is left. What was in a batch that killed its worker comes alone."""
        if self._suspects:
            return [self._suspects.popleft()]
        batch: list[_SomePiece] = []
        expected = 0.0
        while self._waiting and len(batch) < _LARGEST_BATCH:
            expected += self._seconds.get(self._waiting[0].kind, _FIRST_GUESS)
            if batch and expected > self._batch_seconds:
                break
            batch.append(self._waiting.popleft())
        return batch

    def suit(self, threads: int) -> None:
        """Hand out batches from here on that keep so many threads busy with few enough tasks."""
        self._batch_seconds = max(self._least_seconds, threads / _TASKS_PER_SECOND)

    def suspect(self, batch: Sequence[_SomePiece]) -> None:
        """Hand out these pieces again, each alone."""
        self._suspects.extend(batch)

    def learn(self, batch: Sequence[_SomePiece], seconds: float) -> None:
        """What a batch took, shared among its kinds by what they were expected to take."""
        expected = [self._seconds.get(piece.kind, _FIRST_GUESS) for piece in batch]
        factor = seconds / max(sum(expected), 1e-9)
        for kind in {piece.kind for piece in batch}:
            now = max(self._seconds.get(kind, _FIRST_GUESS) * factor, 1e-3)
            # What nobody had timed yet is what it took now.
            self._seconds[kind] = 0.5 * (self._seconds.get(kind, now) + now)


@dataclass(frozen=True)
class BatchTask(Generic[_SomePiece, _SomeOutcome]):
    """What is done with a batch, on whichever computer; and what is told of a piece that no worker survived."""

    work: Callable[[Sequence[_SomePiece]], _SomeOutcome]
    lost: Callable[[_SomePiece, str], _SomeOutcome]


class Hands:
    """A crew at work. Processes and connections are made when the first piece comes, and kept for the next errand."""

    def __init__(self, crew: Workforce, stack: ExitStack) -> None:
        self._crew, self._stack = crew, stack
        self._client: Client | None = None

    def outcomes(
        self, errand: BatchTask[_SomePiece, _SomeOutcome], pieces: Sequence[_SomePiece]
    ) -> Generator[tuple[list[_SomePiece], _SomeOutcome]]:
        """Batches with what came of them, as they come to their end."""
        batches = Batches(pieces, self._crew.batch_seconds)
        if not pieces:
            return
        if self._crew.is_this_process:
            yield from _work_here(errand, batches)
            return
        if self._client is None:
            crew = self._crew
            self._client = self._stack.enter_context(cluster(crew.workers, crew.scheduler))
        yield from _work_on(self._client, errand, batches)


@contextmanager
def at_work(crew: Workforce) -> Iterator[Hands]:
    """The crew, sent home at the end. Raises `RigError` where no scheduler answers when the first piece comes."""
    with ExitStack() as stack:
        yield Hands(crew, stack)


def _work_here(
    errand: BatchTask[_SomePiece, _SomeOutcome], batches: Batches[_SomePiece]
) -> Generator[tuple[list[_SomePiece], _SomeOutcome]]:
    while batch := batches.take():
        outcome = errand.work(batch)
        batches.learn(batch, outcome.seconds)
        yield batch, outcome


def _work_on(
    client: Client, errand: BatchTask[_SomePiece, _SomeOutcome], batches: Batches[_SomePiece]
) -> Generator[tuple[list[_SomePiece], _SomeOutcome]]:
    from distributed import as_completed

    underway: dict[Future, list[_SomePiece]] = {}
    coming = as_completed(loop=client.loop, raise_errors=False)
    threads, counted = 0, -math.inf
    try:
        while batches or underway:
            if time.monotonic() - counted > _COUNTED_AGAIN or not underway:
                threads, counted = _threads_of(client), time.monotonic()
                batches.suit(threads)
            for _ in range(AHEAD * max(threads, 1) - len(underway)):
                batch = batches.take()
                if not batch:
                    break
                future = client.submit(errand.work, batch, pure=False)
                underway[future] = batch
                coming.add(future)
            future = next(coming)
            batch = underway.pop(future)
            # Waits where a worker died with its result: the result is made again.
            failure = future.exception()
            if failure is None:
                outcome = future.result()
                batches.learn(batch, outcome.seconds)
            elif len(batch) > 1:
                batches.suspect(batch)
                continue
            else:
                outcome = errand.lost(
                    batch[0], f"no worker survived it: {without_traceback(str(failure))}"
                )
            yield batch, outcome
    finally:
        client.cancel(list(underway))


def _threads_of(client: Client) -> int:
    """How many threads all workers have that are there now."""
    return sum(cast("dict[str, int]", client.nthreads()).values())


@contextmanager
def cluster(workers: int, scheduler: str = "") -> Iterator[Client]:
    """A client of the cluster at `scheduler`, or of one of so many processes of this computer, closed at the end.

    Raises `RigError` where no scheduler answers.
    """
    from dask import config
    from distributed import Client, LocalCluster

    with ExitStack() as stack:
        patience = {"distributed.comm.timeouts.connect": CONNECT_TIMEOUT}
        stack.enter_context(config.set(patience | SETTINGS))
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
                host="127.0.0.1",
                dashboard_address="127.0.0.1:0",
                scheduler_kwargs={"dashboard": False},
                worker_dashboard_address=None,
                memory_limit=0,
                silence_logs=logging.CRITICAL,
            )
        )
        yield stack.enter_context(Client(local, set_as_default=False))
