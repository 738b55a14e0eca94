"""The only place where concrete rigs are put together: a name becomes a `RigPort` with the clock it lives in.

Start with `make_port`; one module per kind of rig.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rig.errors import ConfigurationError

if TYPE_CHECKING:
    # The names of the rigs are asked for where no rig is made: a list of runs needs no bus.
    from model.gear import HarmonicDrive
    from model.motor import ServoMotor
    from rig.bench.backends.assembly import AssembledRig, RigRequest


def make_port(name: str, request: RigRequest) -> AssembledRig:
    """The rig of this name. Raises `ConfigurationError` for one that does not exist, listing those that do."""
    if name.startswith(REPLAY):
        from rig.bench.backends.replayed import replayed

        return replayed(Path(name.removeprefix(REPLAY)), request)
    maker = BACKENDS.get(name)
    if maker is None:
        raise ConfigurationError(
            "no such rig",
            where="--backend",
            value=repr(name),
            limit=", ".join((*BACKENDS, f"{REPLAY}RUN.h5")),
            remedy="Choose one of these.",
        )
    return maker(request)


def nameplates(name: str, request: RigRequest) -> tuple[HarmonicDrive, ServoMotor]:
    """Gear and motor of this rig as plan and analysis get them; the truth of a simulated one is not among them.

    Gears of one series have the nameplate of the series.
    """
    if not is_simulated(name) or request.world.population == "narrow":
        return request.gear, request.motor
    from rig.bench.backends import simulated

    return simulated.nameplates(request)


def world_record(request: RigRequest) -> dict[str, Any]:
    """The simulated world of a request, as its run file tells it."""
    from rig.bench.backends import simulated

    return simulated.world_record(request)


def _simulated(request: RigRequest) -> AssembledRig:
    from rig.bench.backends.simulated import simulated

    return simulated(request)


def _on_the_wire(request: RigRequest) -> AssembledRig:
    from rig.bench.backends.simulated import on_the_wire

    return on_the_wire(request)


def _on_the_wire_with_box(request: RigRequest) -> AssembledRig:
    from rig.bench.backends.simulated import on_the_wire_with_box

    return on_the_wire_with_box(request)


def _on_the_wire_by_position(request: RigRequest) -> AssembledRig:
    from rig.bench.backends.simulated import on_the_wire_by_position

    return on_the_wire_by_position(request)


def _on_the_wire_by_reference(request: RigRequest) -> AssembledRig:
    from rig.bench.backends.simulated import on_the_wire_by_reference

    return on_the_wire_by_reference(request)


def _hardware(request: RigRequest) -> AssembledRig:
    from rig.bench.backends.hardware import hardware

    return hardware(request)


def is_simulated(name: str) -> bool:
    """Whether a rig of this name lives in a simulated world."""
    return name in BACKENDS and name != HARDWARE


REPLAY = "replay:"
"""What stands before the run file in the name of a replay."""
HARDWARE = "hardware"
"""The rig that the configuration describes."""
BACKENDS: dict[str, Callable[[RigRequest], AssembledRig]] = {
    "sim": _simulated,
    "wire": _on_the_wire,
    "wire-box": _on_the_wire_with_box,
    "wire-csp": _on_the_wire_by_position,
    "wire-analog": _on_the_wire_by_reference,
    HARDWARE: _hardware,
}
"""Every rig there is, by the name given to --backend; a replay is named by its file."""
