"""Whether a bench of hardware was commissioned as far as a plan wants to go: asked before it moves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

from experiments.finding import Finding, Severity
from model.units import REVOLUTION
from rig.bench.commissioning import (
    Asked,
    Device,
    Missing,
    StageDone,
    beyond,
    missing_stages,
    read_record,
)
from rig.bench.config.described import description_hash
from rig.bench.config.load import load_configuration
from rig.bench.config.place import DEFAULT_PATH
from rig.errors import ConfigurationError

if TYPE_CHECKING:
    from rig.bench.backends.assembly import AssembledRig
    from rig.bench.backends.order import Order
    from rig.bench.identity import Bench
    from rig.run.dry_run import PlannedRun

SENTENCE = "THIS BENCH WAS NOT COMMISSIONED"
"""What is typed to turn a bench further than its commissioning allows; it is kept in no file but the run's."""
_WHAT = "commissioning"
_REMEDY = "Commission it: rig commission --config FILE"


def refuse_sentence(typed: str) -> None:
    """Raise `ConfigurationError` for a sentence that is another. "" is none."""
    if typed and typed.strip() != SENTENCE:
        raise ConfigurationError(
            "is not the sentence",
            where="--uncommissioned",
            value=repr(typed),
            limit=SENTENCE,
            remedy="Type it letter for letter if you answer for it, or commission the bench: rig commission.",
        )


@dataclass(frozen=True)
class Standing:
    """What a bench was commissioned for: its record, and the hash of the description that is in force."""

    record: tuple[StageDone, ...]
    description: str

    def missing(self, devices: Mapping[str, Device] | None = None) -> tuple[Missing, ...]:
        """The stages that it lacks; `devices` None: nobody has asked who is on the bus."""
        return missing_stages(self.record, self.description, devices)


def standing_of(bench: Bench, order: Order) -> Standing:
    """Read before the rig is opened: an open drive counts the ms without a heartbeat.

    Raises `RigError` where record or description cannot be read.
    """
    configuration = load_configuration(order.config or DEFAULT_PATH)
    return Standing(read_record(bench.state), description_hash(configuration))


def devices_of(rig: AssembledRig) -> dict[str, Device]:
    """Who is on the bus of an open rig, by node; of a rig without a bus nobody is known."""
    if rig.nodes is None:
        return {}
    nodes = rig.nodes()
    found = zip(nodes.devices, nodes.identities.values(), strict=True)
    return {
        f"node {device.node_id}": {key: str(value) for key, value in asdict(identity).items()}
        for device, identity in found
    }


def is_exempt(rig: AssembledRig) -> bool:
    """Whether the devices call themselves simulated: they hurt nobody."""
    return rig.nodes is not None and rig.nodes().are_simulated


def commissioned_check(
    rig: AssembledRig,
    order: Order,
    standing: Standing,
    planned: PlannedRun | None = None,
    typed: str = "",
) -> Finding:
    """What an open rig of hardware may do by its commissioning, beside what a plan wants of it; without a plan, what
    is missing.
    """
    if is_exempt(rig):
        return Finding(
            _WHAT, Severity.PASSED, "the devices call themselves simulated: none is asked for"
        )
    missing = standing.missing(devices_of(rig))
    if not missing:
        text = "every stage was done, with this description and these devices"
        return Finding(_WHAT, Severity.PASSED, text)
    names = f"missing: {', '.join(map(str, missing))}"
    wanted = () if planned is None else beyond(missing, _asked_of(planned))
    if not wanted:
        return Finding(_WHAT, Severity.WARNS, names, _REMEDY)
    text = f"{names}. The plan wants {'; '.join(wanted)}"
    if typed:
        return Finding(
            _WHAT, Severity.WARNS, f"{text}. {order.operator} typed: {SENTENCE}", _REMEDY
        )
    remedy = f'{_REMEDY}. Whoever answers for it types: --uncommissioned "{SENTENCE}"'
    return Finding(_WHAT, Severity.BLOCKS, text, remedy)


def _asked_of(planned: PlannedRun) -> Asked:
    """How far a plan goes."""
    turned = sum(step.turned for step in planned.steps) / REVOLUTION
    is_coupled = planned.experiment.gear_mounted
    return Asked(
        fastest=max((abs(step.speed) for step in planned.steps), default=0.0),
        output_turns=turned / planned.gear.mounted_ratio(planned.mounting) if is_coupled else 0.0,
        has_torque=any(step.torque for step in planned.steps),
    )
