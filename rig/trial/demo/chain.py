"""The whole chain on the simulated rig: tare and the paper's three experiments, fitted, held
against the truth, reported.

Two processes share the work, because the experiments of one need each other (tare before friction,
kinematic error before velocity steps) and those of different processes do not. Run numbers are
given out in one order, so that the same seed makes the same runs. Ctrl-C is a STOP for both; a
second one an ABORT.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import queue
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rig.errors import RigError
from rig.trial.demo.work import (
    ORDER,
    DemoOrder,
    Failed,
    Finished,
    Step,
    card_in,
    gear_for,
    work,
)

if TYPE_CHECKING:
    from experiments.truth import TruthRow
    from rig.analysis.fit import Fit
    from rig.analysis.judging import GearVerdict

BRANCHES: tuple[tuple[str, ...], ...] = (
    ("motor-tare", "friction"),
    ("kinematic-error", "velocity-steps"),
)
"""What each process runs, one after the other."""
REPORT, PARAMETERS = "report.html", "identified.toml"
DEMONSTRATION = "demonstration"
"""The acceptance file of the made-up maker, by which the simulated gear is judged."""


@dataclass(frozen=True, kw_only=True)
class Demonstration:
    """Everything that a demonstration made."""

    order: DemoOrder
    finished: tuple[Finished, ...]
    fits: tuple[Fit, ...]
    verdict: GearVerdict
    truth: tuple[tuple[str, TruthRow], ...]
    report: Path
    parameters: Path
    seconds: float

    def as_json(self) -> dict[str, Any]:
        """The object that `rig demo --json` prints."""
        return {
            "seed": self.order.seed,
            "folder": str(self.order.folder),
            "report": str(self.report),
            "parameters": str(self.parameters),
            "seconds": self.seconds,
            "runs": [{"path": str(f.path), "outcome": f.outcome} for f in self.finished],
            "fits": [f.result.as_json() for f in self.fits],
            **self.verdict.as_json(),
            "truth": [_row_as_json(kind, row) for kind, row in self.truth],
            "covered": sum(row.covered for _, row in self.truth),
            "within_uncertainty": sum(row.within for _, row in self.truth),
            "compared": len(self.truth),
        }


def _row_as_json(kind: str, row: TruthRow) -> dict[str, Any]:
    e = row.estimate
    return {
        "kind": kind,
        "name": e.name,
        "found": e.value,
        "low": e.low,
        "high": e.high,
        "expanded_uncertainty": e.expanded_uncertainty,
        "seen_by_this_bench": e.value - row.difference,
        "measurand": e.value - row.error,
        "unit": e.unit,
        "covered": row.covered,
        "within_uncertainty": row.within,
    }


@dataclass
class _Local:
    """The shared number of a demonstration in one process."""

    value: int = 0


def _process(*arguments: Any) -> None:
    """A child process: the parent decides what Ctrl-C or a closed terminal means."""
    for number in _sent_to_all():
        signal.signal(number, signal.SIG_IGN)
    work(*arguments)


def demonstrate(
    order: DemoOrder,
    *,
    processes: int = 2,
    show: Callable[[Step | Finished], None] = lambda message: None,
) -> Demonstration:
    """Run, fit, compare and report. Raises the first error of any process, and `KeyboardInterrupt`
    when it was stopped.
    """
    started = time.monotonic()
    order.folder.mkdir(parents=True, exist_ok=True)
    messages = _in_processes(order, show) if processes > 1 else _in_this_one(order, show)
    finished = sorted(messages, key=lambda f: ORDER.index(f.protocol))
    stopped = [f for f in finished if f.result is None]
    if any(f.outcome == "ABORTED" for f in stopped):
        raise KeyboardInterrupt(_recorded(order))
    if stopped or len(finished) < len(ORDER):
        reason = (
            "; ".join(f"{f.protocol} {f.outcome}: {f.message}" for f in stopped)
            or "a run is missing"
        )
        raise RigError(
            "the demonstration did not reach its end", where=str(order.folder), value=reason
        )
    return _conclude(order, tuple(finished), started)


def _recorded(order: DemoOrder) -> str:
    return f"what was recorded is kept in {order.folder}"


def _conclude(order: DemoOrder, finished: tuple[Finished, ...], started: float) -> Demonstration:
    from model.gear_file import save_gear
    from rig.analysis.adopt import adopt
    from rig.analysis.fit import Fit
    from rig.analysis.judging import judge
    from rig.analysis.tare import tare_kind
    from rig.gears.acceptance import shipped_acceptance
    from rig.present.page import write_report
    from rig.runfile.read import open_run

    fits: dict[str, Fit] = {}
    for done in finished:
        assert done.result is not None
        recording = open_run(done.path)
        gear = gear_for(done.protocol, fits, card_in(recording))
        with_tare = done.result.options.get("tare_run") not in (None, "none")
        tare = fits.get(tare_kind()) if with_tare else None
        fits[done.protocol] = Fit(
            recording=recording,
            gear=gear,
            result=done.result,
            path=done.path,
            tare=tare,
            stored=done.stored,
        )
    fitted = tuple(fits.values())
    truth = tuple((fit.result.kind, row) for fit in fitted for row in _truth(fit))
    adopted = adopt(card_in(fitted[0].recording), [fit.result for fit in fitted])
    parameters = order.folder / PARAMETERS
    save_gear(adopted.gear, parameters)
    note = "Made by rig demo: the whole chain, from plan to report, on the simulated rig."
    created = order.created.replace("T", " ", 1)
    verdict = judge(fitted, shipped_acceptance(DEMONSTRATION))
    report = write_report(
        fitted,
        order.folder / REPORT,
        created=created,
        verdict=verdict,
        truth=truth,
        note=note,
    )
    return Demonstration(
        order=order,
        finished=finished,
        fits=fitted,
        verdict=verdict,
        truth=truth,
        report=report,
        parameters=parameters,
        seconds=time.monotonic() - started,
    )


def _truth(fit: Fit) -> Iterator[TruthRow]:
    """What the simulated rig knows of this fit; numbers that the data cannot identify are compared with nothing."""
    from experiments.truth import truth_of, truth_rows

    for row in truth_rows(fit.result, truth_of(fit.recording.metadata.process)):
        if row.estimate.identifiable != "no":
            yield row


def _in_this_one(order: DemoOrder, show: Callable[[Step | Finished], None]) -> list[Finished]:
    """Everything in this process, one protocol after the other."""
    messages: queue.Queue[Any] = queue.Queue()
    begun = {name: threading.Event() for name in ORDER}
    work(ORDER, order, messages, begun, _Local())
    return _collect(messages, 1, show)


def _in_processes(order: DemoOrder, show: Callable[[Step | Finished], None]) -> list[Finished]:
    """One process per branch; they end with this one, however it ends."""
    context = multiprocessing.get_context("spawn")
    messages: Any = context.Queue()
    begun = {name: context.Event() for name in ORDER}
    shared = context.Value("i", 0)
    children = [
        context.Process(target=_process, args=(branch, order, messages, begun, shared), daemon=True)
        for branch in BRANCHES
    ]
    with _one_thread_each():
        for child in children:
            child.start()
    try:
        with _ctrl_c(shared):
            finished = _collect(messages, len(children), show, children)
        if shared.value:
            raise KeyboardInterrupt(_recorded(order))
    except BaseException:
        shared.value = 2
        raise
    finally:
        for child in children:
            child.join(10.0)
            if child.is_alive():
                child.terminate()
                child.join(5.0)
    return finished


@contextlib.contextmanager
def _one_thread_each() -> Iterator[None]:
    """Processes started in here do their linear algebra in one thread: with more, two of them would
    wait for each other.
    """
    names = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")
    before = {name: os.environ.get(name) for name in names}
    os.environ.update({name: "1" for name in names if before[name] is None})
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)


@contextlib.contextmanager
def _ctrl_c(shared: Any) -> Iterator[None]:
    """Ctrl-C presses STOP, then ABORT, in every process; so do a closed terminal and a termination request.

    Only the main thread can ask for that. What is to be ignored (`nohup`) stays ignored.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def press(number: int, frame: object) -> None:
        shared.value = min(shared.value + 1, 2)

    numbers = (*_sent_to_all(), signal.SIGTERM)
    heard = [n for n in numbers if signal.getsignal(n) is not signal.SIG_IGN]
    before = {number: signal.signal(number, press) for number in heard}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler or signal.SIG_DFL)


def _sent_to_all() -> list[int]:
    """The signals that a terminal sends to every process in it, where the system has them."""
    names = ("SIGINT", "SIGQUIT", "SIGHUP")
    return [getattr(signal, name) for name in names if hasattr(signal, name)]


def _collect(
    messages: Any,
    branches: int,
    show: Callable[[Step | Finished], None],
    children: Sequence[Any] = (),
) -> list[Finished]:
    """Everything until each branch has ended. Raises what a branch raised, and `RigError` for a process that died."""
    finished: list[Finished] = []
    failed: list[Failed] = []
    while branches:
        try:
            message = messages.get(timeout=0.5)
        except queue.Empty:
            dead = [c for c in children if c.exitcode]
            if dead:
                raise RigError(
                    "a process of the demonstration died",
                    value=f"exit code {dead[0].exitcode}",
                    remedy="Look for lack of memory or disk, and try again.",
                ) from None
            continue
        if message is None:
            branches -= 1
        elif isinstance(message, Failed):
            failed.append(message)
        else:
            show(message)
            if isinstance(message, Finished):
                finished.append(message)
    for failure in failed:
        if failure.error is not None:
            raise failure.error
        raise RuntimeError(failure.text)
    return finished
