"""The work of a demonstration: the protocols of one branch, run and fitted, told in messages to whoever shows it."""

from __future__ import annotations

import time
import traceback
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from model.errors import WordedError
from rig.bench.backends.assembly import StartState, WorldChoice
from rig.run.stop import StopRequest

if TYPE_CHECKING:
    from experiments.recording import Recording
    from experiments.result import Result
    from model.gear import HarmonicDrive
    from rig.analysis.fit import Fit

ORDER = ("motor-tare", "kinematic-error", "friction", "velocity-steps")
"""The order in which runs begin."""


@dataclass(frozen=True)
class DemoOrder:
    """What is asked for: folder, seed, values of protocol parameters that differ from their
    defaults (for short tests), and the simulated world.
    """

    folder: Path
    seed: int
    created: str
    values: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    world: WorldChoice = field(default_factory=WorldChoice)

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


@dataclass(frozen=True, kw_only=True)
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


class SharedStop(StopRequest):
    """STOP and ABORT that reach another process through a shared number."""

    def __init__(self, shared: Any) -> None:
        super().__init__()
        self._shared = shared

    @property
    def level(self) -> int:
        """0: go on, 1: STOP, 2: ABORT."""
        return int(self._shared.value)


def work(
    branch: Sequence[str], order: DemoOrder, messages: Any, begun: Mapping[str, Any], shared: Any
) -> None:
    """Run and fit the protocols of one branch; everything that happens goes into `messages`, None at the end."""
    try:
        fits: dict[str, Fit] = {}
        for protocol in branch:
            if not _turn_has_come(protocol, begun):
                _compile_ahead(protocol)
            _wait_for_turn(protocol, begun, shared)
            if shared.value:
                break
            finished = _one(protocol, order, messages, begun, SharedStop(shared), fits)
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


def _turn_has_come(protocol: str, begun: Mapping[str, Any]) -> bool:
    return all(
        begun[earlier].is_set() for earlier in ORDER[: ORDER.index(protocol)] if earlier in begun
    )


def _compile_ahead(protocol: str) -> None:
    """Compile the kernels of an analysis while another process compiles those of the rig: both are
    needed, once each.
    """
    if protocol != "kinematic-error":
        return
    import numpy as np

    from model.identify.angle_regression import AngleRegression

    angle = np.linspace(0.0, 60.0, 6000)
    AngleRegression(120.0).add(angle, np.cos(2.0 * angle))


def _wait_for_turn(protocol: str, begun: Mapping[str, Any], shared: Any) -> None:
    """Until the runs before this one have their numbers."""
    for earlier in ORDER[: ORDER.index(protocol)]:
        while earlier in begun and not begun[earlier].wait(0.1) and not shared.value:
            pass


def _one(
    protocol: str,
    order: DemoOrder,
    messages: Any,
    begun: Mapping[str, Any],
    stop: StopRequest,
    fits: dict[str, Fit],
) -> Finished:
    """Run one protocol, fit it, keep the analysis."""
    from rig.analysis.fit import fit_recording, store
    from rig.analysis.tare import tare_kind
    from rig.present.content import UNFINISHED
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
    report = run_request(
        _request(protocol, order),
        stop=stop,
        ask=lambda prompt: "simulated",
        on_progress=on_progress,
    )
    begun[protocol].set()
    if report.outcome in UNFINISHED:
        seconds = time.monotonic() - started
        return Finished(
            protocol=protocol,
            path=report.path,
            outcome=report.outcome,
            message=report.message,
            result=None,
            stored="",
            seconds=seconds,
        )
    messages.put(Step(protocol, 1.0, 0.0, "fitting"))
    recording = open_run(report.path)
    tare = None if protocol == tare_kind() else fits.get(tare_kind())
    gear = gear_for(protocol, fits, card_in(recording))
    fit = fit_recording(recording, gear=gear, tare=tare, path=report.path)
    fit = fits[protocol] = store(fit, order.created)
    seconds = time.monotonic() - started
    return Finished(
        protocol=protocol,
        path=report.path,
        outcome=report.outcome,
        message=report.message,
        result=fit.result,
        stored=fit.stored,
        seconds=seconds,
    )


def _request(protocol: str, order: DemoOrder) -> Any:
    from model.gear_file import shipped_gear
    from model.motor import shipped_motor
    from rig.run.start import RunRequest

    return RunRequest(
        protocol=protocol,
        gear=shipped_gear(),
        motor=shipped_motor(),
        output=order.folder,
        values=dict(order.values.get(protocol, {})),
        gear_serial=order.serial,
        operator="rig demo",
        seed=order.seed,
        # Which run comes first is chance: number and temperatures must not depend on it.
        world=replace(order.world, number=ORDER.index(protocol) + 1, start=StartState()),
    )


def card_in(recording: Recording) -> HarmonicDrive:
    """The gear's card, with which a run was planned."""
    card = recording.metadata.gear
    assert card is not None
    return card


def gear_for(protocol: str, fits: Mapping[str, Fit], card: HarmonicDrive) -> HarmonicDrive:
    """The parameter set to compare with: the card with what this protocol builds on, as identified just now."""
    from experiments import catalogue
    from rig.analysis.adopt import adopt

    basis = catalogue.load(protocol).builds_on
    results = [fits[earlier].result for earlier in basis if earlier in fits]
    return adopt(card, results).gear
