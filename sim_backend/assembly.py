"""What both simulated rigs are assembled of: a gear on a motor in one world, its instruments, and the SYNC."""

from __future__ import annotations

from dataclasses import dataclass

from model.gear import HarmonicDrive, Mounting
from model.kinematic_error import output_sign
from model.motor import ServoMotor
from sim_backend.clock import SyncTimer
from sim_backend.condition import Condition
from sim_backend.drawing import draw
from sim_backend.imperfections import Imperfections
from sim_backend.plant import Plant
from sim_backend.sensors import Instruments
from sim_backend.truth import tell
from sim_backend.world import ThermalState, World


@dataclass(frozen=True, kw_only=True)
class Assembly:
    """The parts of one simulated rig; `sense` is +1 where the output follows a positive input, else -1."""

    on: Imperfections
    world: World
    motor: ServoMotor
    sense: int
    condition: Condition
    plant: Plant
    instruments: Instruments
    sync: SyncTimer

    def truth(self) -> dict[str, object]:
        """Every effective parameter of this rig on this day (see `sim_backend.truth`)."""
        return tell(
            self.plant.loop,
            self.motor,
            on=self.on,
            condition=self.condition,
            instruments=self.instruments,
            world=self.world,
            output_sense=self.sense,
        )


def assemble(
    gear: HarmonicDrive,
    motor: ServoMotor,
    on: Imperfections,
    world: World,
    *,
    cycle_ns: int,
    mounting: Mounting,
    gear_mounted: bool,
    disc_inertia: float,
    start: ThermalState | None,
    start_ns: int = 0,
) -> Assembly:
    """Put a rig together; parameters as of `SimulatedRig`, `start_ns` the hardware's clock at the first SYNC."""
    sense = round(output_sign(mounting))
    condition = draw(on, gear.mounted_ratio(mounting), world, start)
    plant = Plant(
        condition.gear_of(gear),
        motor,
        condition,
        cycle_ns=cycle_ns,
        mounting=mounting,
        gear_mounted=gear_mounted,
        disc_inertia=disc_inertia,
    )
    return Assembly(
        on=on,
        world=world,
        motor=motor,
        sense=sense,
        condition=condition,
        plant=plant,
        instruments=Instruments(on, condition, motor, world.run_seed, sense, plant.output_angle),
        sync=SyncTimer(
            cycle_ns,
            condition.sync_jitter,
            world.run_seed,
            start_ns,
            rate_error=condition.clock_error,
        ),
    )
