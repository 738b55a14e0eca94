"""Simulated rigs and short runs that several tests need."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drivers.port import Command, Guard, Mode
from drivers.samples import SampleBlock
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from model.units import RPM
from sim_backend.direct import SimulatedRig
from sim_backend.imperfections import Imperfections
from sim_backend.individuals import individual_gear
from sim_backend.world import World

GEAR, MOTOR = shipped_gear(), shipped_motor()
NO_GUARD = Guard()


def rig(
    imperfections: Imperfections | None = None, seed: int = 7, **options: object
) -> SimulatedRig:
    """An opened rig with a gear of its own."""
    made = SimulatedRig(individual_gear(GEAR, 3), MOTOR, imperfections, World.of(seed), **options)  # type: ignore[arg-type]
    made.open()
    return made


def with_only(*names: str) -> Imperfections:
    """None of the imperfections but these."""
    return Imperfections().without(*(set(Imperfections.names()) - set(names)))


def clean(*names: str, seed: int = 7, **options: object) -> SimulatedRig:
    """An opened rig with only these imperfections."""
    return rig(with_only(*names), seed, **options)


def turn(port: SimulatedRig, speed_rpm: float, cycles: int, guard: Guard = NO_GUARD) -> SampleBlock:
    """A block at one speed set-point."""
    return port.exchange(Command(Mode.SPEED, np.full(cycles, speed_rpm * RPM)), cycles, guard)


def off(port: SimulatedRig, cycles: int) -> SampleBlock:
    """A block with the servo off."""
    return port.exchange(Command(Mode.OFF), cycles, NO_GUARD)


def column(port: SimulatedRig, block: SampleBlock, name: str) -> NDArray[np.int64]:
    """The counts of a channel."""
    return block.counts[:, [c.name for c in port.channels].index(name)]


def si(port: SimulatedRig, block: SampleBlock, name: str) -> NDArray[np.float64]:
    """A channel in SI."""
    channel = next(c for c in port.channels if c.name == name)
    return channel.to_si(column(port, block, name))


def joined(
    blocks: list[SampleBlock],
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.uint16]]:
    """Stamps, counts and flags of consecutive blocks."""
    return (
        np.concatenate([b.time_ns for b in blocks]),
        np.concatenate([b.counts for b in blocks]),
        np.concatenate([b.flags for b in blocks]),
    )
