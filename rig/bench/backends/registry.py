"""The only place where concrete rigs are put together: a name becomes a `RigPort` with the clock it lives in.

Start with `make_port`; one module per kind of rig.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rig.bench.backends.order import Order, Setup
from rig.errors import ConfigurationError

if TYPE_CHECKING:
    # The names of the rigs are asked for where no rig is made: a list of runs needs no bus.
    from model.gear import HarmonicDrive
    from model.motor import ServoMotor
    from rig.bench.backends.assembly import AssembledRig


def make_port(order: Order, setup: Setup = Setup()) -> AssembledRig:
    """The rig that an order names, as its plan needs it. Raises `ConfigurationError` for one that does not exist."""
    name = order.backend
    if name.startswith(REPLAY):
        from rig.bench.backends.replayed import replayed

        return replayed(Path(name.removeprefix(REPLAY)), order, setup)
    refuse_unknown(name)
    return BACKENDS[name](order, setup)


def refuse_unknown(name: str) -> None:
    """Raise `ConfigurationError` for the word of a rig that does not exist."""
    if name in BACKENDS or name.startswith(REPLAY):
        return
    raise ConfigurationError(
        "no such rig",
        where="--backend",
        value=repr(name),
        limit=", ".join((*BACKENDS, f"{REPLAY}RUN.h5")),
        remedy="Choose one of these.",
    )


def nameplates(order: Order) -> tuple[HarmonicDrive, ServoMotor]:
    """Gear and motor of this rig as plan and analysis get them; the truth of a simulated one is not among them.

    Gears of one series have the nameplate of the series.
    """
    if not is_simulated(order.backend) or order.world.population == "narrow":
        return order.gear, order.motor
    from rig.bench.backends import simulated

    return simulated.nameplates(order)


def world_record(order: Order) -> dict[str, Any]:
    """The simulated world of an order, as its run file tells it."""
    from rig.bench.backends import simulated

    return simulated.world_record(order)


def _simulated(order: Order, setup: Setup) -> AssembledRig:
    from rig.bench.backends.simulated import simulated

    return simulated(order, setup)


def _on_the_wire(order: Order, setup: Setup) -> AssembledRig:
    from rig.bench.backends.simulated import on_the_wire

    return on_the_wire(order, setup)


def _on_the_wire_with_box(order: Order, setup: Setup) -> AssembledRig:
    from rig.bench.backends.simulated import on_the_wire_with_box

    return on_the_wire_with_box(order, setup)


def _on_the_wire_by_position(order: Order, setup: Setup) -> AssembledRig:
    from rig.bench.backends.simulated import on_the_wire_by_position

    return on_the_wire_by_position(order, setup)


def _on_the_wire_by_reference(order: Order, setup: Setup) -> AssembledRig:
    from rig.bench.backends.simulated import on_the_wire_by_reference

    return on_the_wire_by_reference(order, setup)


def _hardware(order: Order, setup: Setup) -> AssembledRig:
    from rig.bench.backends.hardware import hardware

    return hardware(order, setup)


def is_simulated(name: str) -> bool:
    """Whether a rig of this name lives in a simulated world."""
    return name in BACKENDS and name != HARDWARE


REPLAY = "replay:"
"""What stands before the run file in the name of a replay."""
HARDWARE = "hardware"
"""The rig that the configuration describes."""
BACKENDS: dict[str, Callable[[Order, Setup], AssembledRig]] = {
    "sim": _simulated,
    "wire": _on_the_wire,
    "wire-box": _on_the_wire_with_box,
    "wire-csp": _on_the_wire_by_position,
    "wire-analog": _on_the_wire_by_reference,
    HARDWARE: _hardware,
}
"""Every rig there is, by the name given to --backend; a replay is named by its file."""
