"""A run in real time: the loop in a thread of its own, the caller's for the operator, nothing else in the process.

Calling thread: Ctrl-C, prompts, progress (`rig.run.serving`). Turn thread: the session. Writer thread: the
recorder's. Watchdog thread: only watches that turns happen. The garbage collector is frozen and off while the
rig turns.
"""

from __future__ import annotations

import contextlib
import gc
from collections.abc import Callable, Generator

from experiments.recording import Event
from rig.run.callbacks import Callbacks, brought_to_its_end
from rig.run.engine import Ask
from rig.run.parts import Begin, Progress, RunReport, SessionParts
from rig.run.serving import Relay, serve
from rig.run.session import execute
from rig.run.stop import StopRequest

_REACTION_TIME = 0.02
"""s of cycles per exchange: how soon the operator is heard."""
_LEAST_DEADLINE = 0.25
"""s without a turn after which the watchdog stops the drive, at least."""


def block_cycles(sample_rate: float, wanted: int, reaction: float = _REACTION_TIME) -> int:
    """Cycles per exchange in real time: never so many that the operator waits longer than `reaction` [s]."""
    return max(1, min(wanted, round(reaction * sample_rate)))


def watchdog_deadline(
    cycles: int, sample_rate: float, stale_cycles: int = 50, patience: float = 5.0
) -> float:
    """s that a turn may take: an exchange in which every cycle waits in full for a node that is silent, with room."""
    return max(_LEAST_DEADLINE, 2.0 * (cycles + min(cycles, stale_cycles) * patience) / sample_rate)


def execute_in_real_time(
    parts: SessionParts,
    begin: Begin,
    *,
    stop: StopRequest | None = None,
    ask: Ask = lambda prompt: "",
    on_progress: Callable[[Progress], None] | None = None,
    on_event: Callable[[Event], None] | None = None,
) -> RunReport:
    """`execute` in a turn thread, served by the calling thread. Raises what `execute` raises, and what a callback
    raised that ends a run (`rig.run.callbacks`), always after the turn thread has ended.
    """
    stop = stop or StopRequest()
    callbacks = Callbacks(stop, ask, on_progress, on_event)

    def turn(relay: Relay) -> RunReport:
        with collector_off():
            return execute(
                parts,
                begin,
                stop=stop,
                ask=relay.ask,
                on_progress=relay.progress,
                on_event=relay.event,
            )

    return brought_to_its_end(lambda: serve(turn, callbacks, stop, parts.watchdog), callbacks, stop)


@contextlib.contextmanager
def collector_off() -> Generator[None, None, None]:
    """The garbage collector frozen and off."""
    was_on = gc.isenabled()
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        gc.unfreeze()
        if was_on:
            gc.enable()
