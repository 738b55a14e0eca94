"""Benches on the wire that are described by text, rightly or wrongly, and taken through the stages."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path

from drivers.bus.cyclic import CanRig
from drivers.clock import VirtualClock
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig.bench.backends.assembly import AssembledRig
from rig.bench.backends.hardware import can_rig_config
from rig.bench.backends.order import Order, Setup
from rig.bench.backends.simulated import of_bus, reference_config, reference_device
from rig.bench.commissioning import STAGES
from rig.bench.config.apply import configured_limits
from rig.bench.config.load import load_configuration
from rig.run.start import bench_for
from rig.run.stop import StopRequest
from rig.trial.commission.conduct import do_stage
from rig.trial.commission.work import Seen, Work
from sim_backend.wire.bench import WireBench
from sim_backend.world import World

RATE = 50.0
GEAR, MOTOR = shipped_gear(), shipped_motor()
_WORDS = {
    "<rate>": f"{RATE:g}",
    "<gear>": "csf-25-120",
    "<bench>": "abcd-efgh",
    "<channel>": "can0",
    "<host>": "127.0.0.1",
    "<port>": "29536",
    "<drive>": "1",
    "<counter>": "2",
    "<module>": "3",
    "<readout>": "",
}


def right_text() -> str:
    """The description of the bench on the wire, as it is served."""
    text = resources.files("rig.bench.config").joinpath("served.toml").read_text(encoding="utf-8")
    for word, value in _WORDS.items():
        text = text.replace(word, value)
    return text


@dataclass
class Described:
    """A bench on the wire that is driven by a description; `moved` is how fast a coupled motor was ever driven."""

    path: Path
    analog_scale: float = 0.0
    mounting: str = "circular-spline-fixed"
    moved: float = 0.0

    @property
    def order(self) -> Order:
        return order_for(self.path, mounting=self.mounting)

    def make(self, order: Order, setup: Setup) -> AssembledRig:
        """The bench as it is, and the drivers as they were told."""
        clock = VirtualClock(1_790_000_000_000_000_000)
        reference = reference_device(order, MOTOR, setup) if self.analog_scale else None
        bench = WireBench(
            GEAR,
            MOTOR,
            world=World.of(4),
            cycle_ns=round(1e9 / RATE),
            clock=clock,
            gear_mounted=setup.gear_mounted,
            reference=reference,
        )
        if self.analog_scale:
            config = reference_config(bench, MOTOR, has_guard=setup.watches_contact)
            per_volt = config.drive.speed_per_volt  # type: ignore[union-attr]
            drive = replace(config.drive, speed_per_volt=self.analog_scale * per_volt)  # type: ignore[arg-type]
            config = replace(config, drive=drive)
        else:
            configuration = load_configuration(self.path)
            cycle_ns = round(1e9 / order.sample_rate)
            ratio = order.gear.mounted_ratio(order.mounting)
            config = can_rig_config(configuration, MOTOR, self.path.parent, cycle_ns, ratio)
        port = CanRig(
            config, clock, bench.bus, pump=bench.pump, time_base="hardware", origin="simulated"
        )
        if setup.gear_mounted:
            watch(bench, self._moves)
        return AssembledRig(name="wire", port=port, clock=clock, **of_bus(bench, port))

    def _moves(self, speed: float) -> None:
        self.moved = max(self.moved, speed)


def order_for(path: Path, *, backend: str = "wire", mounting: str, **more: object) -> Order:
    """What a commissioning with this description asks for; its records go beside it."""
    configuration = load_configuration(path)
    return Order(
        protocol="commission",
        backend=backend,
        operator="A. Example",
        serial="SN-1",
        folder=path.parent,
        sample_rate=configuration.rig.sample_rate_hz,
        limits=configured_limits(configuration),
        mounting=mounting,  # type: ignore[arg-type]
        **more,  # type: ignore[arg-type]
    )


def watch(bench: WireBench, tell: Callable[[float], None]) -> None:
    """Tell how fast [rad/s] the drive of a bench is driven, whenever it is."""
    demand = bench.drive.demand

    def watched() -> tuple[object, float]:
        mode, target = demand()
        tell(abs(target))
        return mode, target

    bench.drive.demand = watched  # type: ignore[method-assign, assignment]


def described(
    folder: Path, edit: Callable[[str], str] = lambda text: text, **more: object
) -> Described:
    path = folder / "rig.toml"
    path.write_text(edit(right_text()), encoding="utf-8")
    return Described(path, **more)  # type: ignore[arg-type]


def first_failure(
    order: Order, make: Callable[[Order, Setup], AssembledRig], names: Sequence[str]
) -> tuple[str, Seen | None]:
    """The first of these stages that fails, and what was seen in it; "" where none does."""
    for stage in STAGES:
        if stage.name not in names:
            continue
        work = Work(
            order=order,
            bench=bench_for(order),
            ask=lambda prompt: None,
            stop=StopRequest(),
            now=lambda: "2026-11-27T08:00:00+00:00",
            make=make,
        )
        seen = do_stage(stage, work, "described")
        if not seen.is_fine:
            return stage.name, seen
    return "", None
