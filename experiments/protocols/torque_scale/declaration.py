"""Torque scale: what a run can be told, and what comes of it."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Annotated

from annotated_types import Ge, Gt, Le

from experiments.contract import Deferred, Experiment
from experiments.need import TORQUES, Need
from experiments.parameters import Help, Unit
from experiments.planning.shared_parameters import SyncRate, ZeroTime
from experiments.protocols.torque_scale.disc import disc_of
from experiments.quantity import OF_ANGLES, OF_TORQUE_DIFFERENCES, Quantity

NAME = "torque-scale"

QUANTITIES = (
    Quantity(
        name="shown_inertia",
        title="inertia on the bare shaft, by the torque",
        unit="kg m2",
        shown="kg cm2",
        definition="torque shown per acceleration of rotor and disc",
        target_share=0.005,
        target_reason="two of them tell the scale of the torque",
        is_key=True,
        is_above_zero=True,
        rests_on=OF_TORQUE_DIFFERENCES,
    ),
    Quantity(
        name="torque_lag",
        title="lag of the torque",
        unit="s",
        shown="ms",
        definition="by how much the torque shown is later than the acceleration that it makes",
        is_signed=True,
        rests_on=OF_ANGLES,
    ),
    Quantity(name="disc_inertia", title="inertia of the disc", unit="kg m2", shown="kg cm2"),
    Quantity(name="ramps", title="ramps", unit="1"),
    Quantity(name="housing_temperature", title="housing temperature", unit="°C"),
    Quantity(name="torque_zero_drift", title="torque zero drift", unit="N m"),
)

_Length = Annotated[float, Ge(0.0), Le(1000.0), Unit("mm")]
_Mass = Annotated[float, Ge(0.0), Le(100.0), Unit("kg")]
_Speed = Annotated[float, Gt(0.0), Le(10000.0), Unit("r/min")]


@dataclass(frozen=True, kw_only=True)
class Parameters:
    """What a torque-scale run can be told. One run has one disc, or none; a bench learns from two of them at least."""

    inertia: Annotated[
        float, Ge(0.0), Le(1.0), Unit("kg m2"), Help("inertia of the disc; 0: by mass and diameter")
    ] = 0.0
    inertia_uncertainty: Annotated[
        float, Ge(0.0), Le(1.0), Unit("kg m2"), Help("U (k = 2) of the disc's inertia; 0: assumed")
    ] = 0.0
    certificate: Annotated[str, Help("who says the inertia, or how it was found")] = ""
    mass: Annotated[_Mass, Help("mass of the disc, hub not counted; 0: none is mounted")] = 0.0
    diameter_mm: Annotated[_Length, Help("outer diameter of the disc")] = 0.0
    bore_mm: Annotated[_Length, Help("bore of disc and hub")] = 0.0
    hub_mass: Annotated[_Mass, Help("mass of the hub")] = 0.0
    hub_diameter_mm: Annotated[_Length, Help("outer diameter of the hub")] = 0.0
    lowest_rpm: Annotated[_Speed, Help("input speed at the lower end of the ramps")] = 600.0
    highest_rpm: Annotated[_Speed, Help("input speed at their upper end")] = 3000.0
    accelerations: Annotated[
        tuple[float, ...],
        Gt(0.0),
        Le(20000.0),
        Unit("rad/s2"),
        Help("accelerations of the ramps, three or more"),
    ] = (150.0, 300.0, 600.0)
    repeats: Annotated[
        int,
        Ge(2),
        Le(100),
        Unit(""),
        Help("ramps up, and down, of each acceleration and direction"),
    ] = 4
    dwell_time: Annotated[
        float, Ge(0.05), Le(60.0), Unit("s"), Help("constant speed between two ramps")
    ] = 1.0
    zero_time: ZeroTime = 3.0
    sync_rate: SyncRate = 1000.0

    @property
    def disc_inertia(self) -> float:
        """Inertia on the bare shaft [kg m2]."""
        return disc_of(asdict(self)).inertia


EXPERIMENT = Experiment(
    name=NAME,
    title="Torque scale",
    summary="torque shown per torque that accelerates a known inertia, gear removed",
    parameters=Parameters,
    plan=Deferred("experiments.protocols.torque_scale.plan:plan"),
    analyse=Deferred("experiments.protocols.torque_scale.analysis:analyse"),
    asks=Need(channels=(("input_angle",), TORQUES), labels=("ramp",), gear_off=True),
    short={"zero_time": 0.5, "repeats": 2},
    needs=("input_angle", "torque"),
    gear_mounted=False,
    quantities=QUANTITIES,
    live=("speed", "torque", "temperature"),
)
