"""The whole chain on the simulated rig: tare and the paper's three experiments, fitted, held against the truth, reported.

Two processes share the work, because the experiments of one need each other (tare before friction, kinematic error before
velocity steps) and those of different processes do not. Run numbers are given out in one order, so that the same seed makes
the same runs. Ctrl-C is a STOP for both; a second one an ABORT.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import queue
import signal
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from model.errors import WordedError
from rig.errors import RigError
from rig.run.stop import StopRequest

if TYPE_CHECKING:
    from experiments.result import Result
    from experiments.truth import TruthRow
    from model.gear import HarmonicDrive
    from rig.fit import Fit

BRANCHES: tuple[tuple[str, ...], ...] = (("motor-tare", "friction"), ("kinematic-error", "velocity-steps"))
"""What each process runs, one after the other."""
ORDER = ("motor-tare", "kinematic-error", "friction", "velocity-steps")
"""The order in which runs begin."""
REPORT, PARAMETERS = "report.html", "identified.toml"


@dataclass(frozen=True)
class DemoOrder:
    """What is asked for: folder, seed, and values of protocol parameters that differ from their defaults (for short tests)."""

    folder: Path
    seed: int
    created: str
    values: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    @property
    def serial(self) -> str:
        """Serial number of the simulated gear."""
        return f"SIM-{self.seed:04d}"


@dataclass(frozen=True)
class Step:
    """One line of progress of one protocol: rig seconds done and left, and what is being done."""

    protocol: str
    done: float
    left: float
    what: str


@dataclass(frozen=True)
class Finished:
    """One protocol, run and fitted: its file, outcome, result, and the name of the stored analysis."""

    protocol: str
    path: Path
    outcome: str
    message: str
    result: Result | None
    stored: str
    seconds: float


@dataclass(frozen=True)
class Failed:
    """An error in a process: as it was raised, or in words where it is a defect."""

    error: WordedError | None
    text: str


@dataclass(frozen=True)
class Demonstration:
    """Everything that a demonstration made."""

    order: DemoOrder
    finished: tuple[Finished, ...]
    fits: tuple[Fit, ...]
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
            "truth": [_row_as_json(kind, row) for kind, row in self.truth],
            "covered": sum(row.covered for _, row in self.truth),
            "within_uncertainty": sum(row.within for _, row in self.truth),
            "compared": len(self.truth),
        }


def _row_as_json(kind: str, row: TruthRow) -> dict[str, Any]:
    e = row.estimate
    return {
        "kind": kind, "name": e.name, "found": e.value, "low": e.low, "high": e.high,
        "expanded_uncertainty": e.expanded_uncertainty, "truth": e.value - row.difference, "unit": e.unit,
        "covered": row.covered, "within_uncertainty": row.within,
    }  # fmt: skip


class SharedStop(StopRequest):
    """STOP and ABORT that reach another process through a shared number."""

    def __init__(self, shared: Any) -> None:
        super().__init__()
        self._shared = shared

    @property
    def level(self) -> int:
        """0: go on, 1: STOP, 2: ABORT."""
        return int(self._shared.value)


@dataclass
class _Local:
    """The shared number of a demonstration in one process."""

    value: int = 0


# In the processes that work.


def work(branch: Sequence[str], order: DemoOrder, messages: Any, begun: Mapping[str, Any], shared: Any) -> None:
    """Run and fit the protocols of one branch; everything that happens goes into `messages`, None at the end."""
    try:
        found: dict[str, Fit] = {}
        for protocol in branch:
            _wait_for_turn(protocol, begun, shared)
            if shared.value:
                break
            finished = _one(protocol, order, messages, begun, SharedStop(shared), found)
            messages.put(finished)
            if finished.result is None:
                break
    except WordedError as error:
        messages.put(Failed(error, str(error)))
    except Exception:  # noqa: BLE001  whatever it was, the process that shows it must hear of it
        messages.put(Failed(None, traceback.format_exc()))
    finally:
        for protocol in branch:
            begun[protocol].set()
        messages.put(None)


def _process(*arguments: Any) -> None:
    """A child process: the parent decides what Ctrl-C means."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    work(*arguments)


def _wait_for_turn(protocol: str, begun: Mapping[str, Any], shared: Any) -> None:
    """Until the runs before this one have their numbers."""
    for earlier in ORDER[: ORDER.index(protocol)]:
        while earlier in begun and not begun[earlier].wait(0.1) and not shared.value:
            pass


def _one(
    protocol: str, order: DemoOrder, messages: Any, begun: Mapping[str, Any], stop: StopRequest, found: dict[str, Fit]
) -> Finished:
    """Run one protocol, fit it, keep the analysis."""
    from rig.fit import TARE, fit_recording, store
    from rig.report.content import UNFINISHED
    from rig.run.start import run_request
    from rig.runfile.read import open_run

    started = time.monotonic()
    last = [0.0]

    def on_progress(now: Any) -> None:
        begun[protocol].set()
        instant = time.monotonic()
        if instant - last[0] > 0.1:
            last[0] = instant
            messages.put(Step(protocol, now.elapsed, now.left, "running"))

    messages.put(Step(protocol, 0.0, 1.0, "preparing"))
    report = run_request(_request(protocol, order), stop=stop, ask=lambda prompt: "simulated", on_progress=on_progress)
    begun[protocol].set()
    if report.outcome in UNFINISHED:
        seconds = time.monotonic() - started
        return Finished(protocol, report.path, report.outcome, report.message, None, "", seconds)
    messages.put(Step(protocol, 1.0, 0.0, "fitting"))
    recording = open_run(report.path)
    tare = found.get(TARE) if protocol != TARE else None
    fit = fit_recording(recording, gear=_gear_for(protocol, found), tare=tare, path=report.path)
    fit = found[protocol] = store(fit, order.created)
    seconds = time.monotonic() - started
    return Finished(protocol, report.path, report.outcome, report.message, fit.result, fit.stored, seconds)


def _request(protocol: str, order: DemoOrder) -> Any:
    from model.gear_file import shipped_gear
    from model.motor import shipped_motor
    from rig.run.start import RunRequest

    return RunRequest(
        protocol, shipped_gear(), shipped_motor(), order.folder, dict(order.values.get(protocol, {})),
        gear_serial=order.serial, operator="rig demo", seed=order.seed,
    )  # fmt: skip


def _gear_for(protocol: str, found: Mapping[str, Fit]) -> HarmonicDrive:
    """The parameter set to compare with: the shipped one; velocity steps know the kinematic error that was just found."""
    from model.gear_file import shipped_gear
    from rig.adopt import adopt

    results = [found["kinematic-error"].result] if protocol == "velocity-steps" and "kinematic-error" in found else []
    return adopt(shipped_gear(), results).gear


# In the process that shows.


def demonstrate(
    order: DemoOrder, *, processes: int = 2, show: Callable[[Step | Finished], None] = lambda message: None
) -> Demonstration:
    """Run, fit, compare and report. Raises the first error of any process, and `KeyboardInterrupt` when it was stopped."""
    started = time.monotonic()
    order.folder.mkdir(parents=True, exist_ok=True)
    messages = _in_processes(order, show) if processes > 1 else _in_this_one(order, show)
    finished = sorted(messages, key=lambda f: ORDER.index(f.protocol))
    stopped = [f for f in finished if f.result is None]
    if any(f.outcome == "ABORTED" for f in stopped):
        raise KeyboardInterrupt(f"{stopped[0].path.name} was stopped and is kept")
    if stopped or len(finished) < len(ORDER):
        told = "; ".join(f"{f.protocol} {f.outcome}: {f.message}" for f in stopped) or "a run is missing"
        raise RigError("the demonstration did not reach its end", where=str(order.folder), value=told)
    return _conclude(order, tuple(finished), started)


def _conclude(order: DemoOrder, finished: tuple[Finished, ...], started: float) -> Demonstration:
    from model.gear_file import save_gear, shipped_gear
    from rig.adopt import adopt
    from rig.fit import TARE, Fit
    from rig.report.page import write_report
    from rig.runfile.read import open_run

    fits: dict[str, Fit] = {}
    for done in finished:
        assert done.result is not None
        gear = _gear_for(done.protocol, fits)
        tare = fits.get(TARE) if done.result.options.get("tare_run") not in (None, "none") else None
        fits[done.protocol] = Fit(open_run(done.path), gear, done.result, done.path, tare, stored=done.stored)
    made = tuple(fits.values())
    truth = tuple((fit.result.kind, row) for fit in made for row in _truth(fit))
    adopted = adopt(shipped_gear(), [fit.result for fit in made])
    parameters = order.folder / PARAMETERS
    save_gear(adopted.gear, parameters)
    note = "Made by rig demo: the whole chain, from plan to report, on the simulated rig."
    created = order.created.replace("T", " ", 1)
    report = write_report(made, order.folder / REPORT, created=created, truth=truth, note=note)
    return Demonstration(order, finished, made, truth, report, parameters, time.monotonic() - started)


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
        context.Process(target=_process, args=(branch, order, messages, begun, shared), daemon=True) for branch in BRANCHES
    ]
    for child in children:
        child.start()
    try:
        with _ctrl_c(shared):
            found = _collect(messages, len(children), show, children)
    except BaseException:
        shared.value = 2
        raise
    finally:
        for child in children:
            child.join(10.0)
            if child.is_alive():
                child.terminate()
                child.join(5.0)
    return found


@contextlib.contextmanager
def _ctrl_c(shared: Any) -> Iterator[None]:
    """Ctrl-C presses STOP, then ABORT, in every process. Only the main thread can ask for that."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def press(number: int, frame: object) -> None:
        shared.value = min(shared.value + 1, 2)

    before = signal.signal(signal.SIGINT, press)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _collect(
    messages: Any, branches: int, show: Callable[[Step | Finished], None], children: Sequence[Any] = ()
) -> list[Finished]:
    """Everything until each branch has ended. Raises what a branch raised, and `RigError` for a process that died."""
    found: list[Finished] = []
    failed: list[Failed] = []
    while branches:
        try:
            message = messages.get(timeout=0.5)
        except queue.Empty:
            dead = [c for c in children if c.exitcode]
            if dead:
                raise RigError(
                    "a process of the demonstration died", value=f"exit code {dead[0].exitcode}",
                    remedy="Look for lack of memory or disk, and try again.",
                ) from None  # fmt: skip
            continue
        if message is None:
            branches -= 1
        elif isinstance(message, Failed):
            failed.append(message)
        else:
            show(message)
            if isinstance(message, Finished):
                found.append(message)
    for failure in failed:
        if failure.error is not None:
            raise failure.error
        raise RuntimeError(failure.text)
    return found
