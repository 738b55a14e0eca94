"""`rig.execute`: a protocol on a rig, as `rig run` does it."""

from __future__ import annotations

import threading
import warnings
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rig.api.reading import load
from rig.api.runs import Run
from rig.bench.backends.order import Order, WorldChoice, world_of
from rig.bench.backends.registry import HARDWARE
from rig.commands.ordering import order_of
from rig.commands.prompting import terminal_ask
from rig.errors import ConfigurationError, RigError
from rig.run.start import plan_order, run_order
from rig.run.stop import StopRequest, pressed_by_signals

if TYPE_CHECKING:
    from experiments.steps.note import Prompt
    from model.gear import HarmonicDrive

_SIMULATED_ANSWER = "simulated"
"""What a simulated rig answers to a prompt: there is nobody who could look."""


def execute(
    protocol: str,
    backend: str = "sim",
    *,
    gear: HarmonicDrive | None = None,
    serial: str = "unknown",
    folder: str | Path | None = None,
    operator: str = "",
    seed: int = 0,
    world: Mapping[str, Any] | None = None,
    config: str | Path | None = None,
    mounting: str | None = None,
    sample_rate: float | None = None,
    status: str | Path | None = None,
    confirm: str = "",
    ask: Callable[[Prompt], str | None] | None = None,
    **parameters: Any,
) -> Run:
    """Execute a protocol on a rig and keep it as one run file; returns that run, however it ended (`Run.outcome`).

    `backend` is "sim", "wire", "replay:RUN.h5" or "hardware"; `gear` the parameter set, `serial` the serial number of
    the gear, `folder` where the run file goes ("runs", or that of the configuration). `parameters` are the protocol's
    own, as `rig run PROTOCOL --help` lists them, with underscores: `points=10`, `speeds_rpm=(60.0, 600.0)`.
    `seed` and `world` (gear_seed, bench_seed, mount, mount_turn_deg, hours, day, day_correlation, number, population,
    start_state) choose a simulated world. `status` is where a page of how the run stands is kept while it goes on.
    A rig of hardware is described by `config` and armed by `confirm`, the serial number once more; prompts are put
    on the terminal, unless `ask` answers them. In the main thread Ctrl-C is a STOP, a second one an ABORT. In another
    thread nobody hears Ctrl-C; the end of the main thread is a STOP. What `ask` raises is a STOP too, and is raised
    here once the rig stands and the run is sealed, with a note of how it ended.

    Raises `PlanError`, `LimitError`, `ConfigurationError` before anything moves; `RigError` where nothing was recorded.
    """
    said: dict[str, object] = {
        "backend": backend,
        "gear": gear,
        "serial": serial,
        "operator": operator,
        "seed": seed,
        "world": _chosen(world or {}),
        "mounting": mounting,
        "sample_rate": sample_rate,
    }
    places = {"folder": folder, "config": config, "status": status}
    said |= {name: Path(place) for name, place in places.items() if place is not None}
    order = order_of(protocol, parameters, {k: v for k, v in said.items() if v is not None})
    return _executed(order, confirm, ask)


def _executed(order: Order, confirm: str, ask: Callable[[Prompt], str | None] | None) -> Run:
    """The run of an order, as it ended."""
    planned = plan_order(order)
    stop = StopRequest()
    # Signals reach the main thread alone: from another one a run cannot be stopped by Ctrl-C.
    in_main = threading.current_thread() is threading.main_thread()
    with pressed_by_signals(stop) if in_main else nullcontext():
        report = run_order(
            order,
            planned,
            confirmation=confirm,
            stop=stop,
            ask=ask or _answers(order.backend, stop),
        )
    if not report.readable:
        raise RigError("the run left no file", where=str(report.path), value=report.message)
    return load(report.path)


def _chosen(world: Mapping[str, Any]) -> WorldChoice:
    """The choice of a world by what a caller names. Raises `ConfigurationError` for a turn in two units."""
    named = dict(world)
    if (turn := named.pop("mount_turn", None)) is not None:
        if "mount_turn_deg" in named:
            raise ConfigurationError(
                "one turn of the gear is stated twice",
                where="world",
                value="mount_turn and mount_turn_deg",
                remedy="Give mount_turn_deg alone, in degrees.",
            )
        warnings.warn(
            "world: mount_turn is in radians and ends with the next version; give mount_turn_deg, in degrees.",
            DeprecationWarning,
            stacklevel=3,
        )
        return replace(world_of(named), mount_turn=turn)
    return world_of(named)


def _answers(backend: str, stop: StopRequest) -> Callable[[Prompt], str | None]:
    """Who answers the prompts of a run: whoever sits at the terminal of a rig of hardware, else the simulation."""
    return terminal_ask(stop) if backend == HARDWARE else lambda prompt: _SIMULATED_ANSWER
