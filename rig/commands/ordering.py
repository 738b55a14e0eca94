"""From what was typed to what is to be run: gear, motor, limits and rates by flag, by the rig's
configuration, or by default.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rig.commands.terminal import echo

if TYPE_CHECKING:
    from model.gear import HarmonicDrive
    from rig.bench.backends.assembly import WorldChoice
    from rig.run.dry_run import PlannedRun
    from rig.run.start import RunRequest


def request_of(
    protocol: str,
    values: Mapping[str, Any],
    *,
    backend: str = "sim",
    config: Path | None = None,
    parameters: Path | None = None,
    gear: HarmonicDrive | None = None,
    mounting: str | None = None,
    sample_rate: float | None = None,
    output: Path | None = None,
    gear_serial: str = "unknown",
    operator: str = "",
    seed: int = 0,
    block: int = 2000,
    confirmation: str = "",
    world: WorldChoice | None = None,
) -> RunRequest:
    """The request that flags make. What they leave open comes from the gear's card in the folder of the runs, from the
    configuration that is named (or that a rig of hardware needs), and by default. `gear` is a parameter set at hand
    in the place of the file `parameters`.

    Raises `ConfigurationError`, `ParameterError`; nothing is connected.
    """
    from model.gear_file import load_gear, shipped_gear
    from model.motor import shipped_motor
    from rig.bench.backends.assembly import WorldChoice
    from rig.bench.backends.registry import HARDWARE, REPLAY
    from rig.run.dry_run import DEFAULT_SAMPLE_RATE
    from rig.run.start import MOUNTINGS, RunRequest
    from rig.runfile.read import read_run_header

    if config is None and backend == HARDWARE:
        from rig.bench.config.place import DEFAULT_PATH

        config = DEFAULT_PATH
    by_hand = gear if parameters is None else load_gear(parameters)
    gear, motor = shipped_gear(), shipped_motor()
    limits: Mapping[str, float] = {}
    output_bearing: Mapping[str, Any] = {}
    rate, folder = DEFAULT_SAMPLE_RATE, Path("runs")
    if config is not None:
        from rig.bench.config.apply import configured_rig

        configured = configured_rig(config)
        gear, motor, limits = configured.gear, configured.motor, configured.limits
        output_bearing = configured.output_bearing
        rate, folder = (
            configured.configuration.rig.sample_rate_hz,
            config.parent / configured.configuration.rig.output,
        )
    # A replay plans anew for the gear that was turned: for another one the plan would not be the recorded one.
    recorded = Path(backend.removeprefix(REPLAY)) if backend.startswith(REPLAY) else None
    if by_hand is not None:
        gear = by_hand
    elif recorded is not None and recorded.is_file():
        gear = read_run_header(recorded).metadata.gear or gear
    request = RunRequest(
        protocol=protocol,
        gear=gear,
        motor=motor,
        output=output or folder,
        values=values,
        backend=backend,
        mounting=mounting or MOUNTINGS[0],  # type: ignore[arg-type]
        gear_serial=gear_serial,
        operator=operator,
        seed=seed,
        sample_rate=sample_rate or rate,
        block_cycles=block,
        configuration=config,
        limits=limits,
        output_bearing=output_bearing,
        confirmation=confirmation,
        world=world or WorldChoice(),
    )
    return carded(request, mounting, by_hand is not None or recorded is not None)


def carded(request: RunRequest, mounting: str | None, parameters_given: bool) -> RunRequest:
    """The request with what is known of its gear; a card that was not confirmed is said on standard error.

    Raises `ConfigurationError` where the flags and the card contradict each other about the mounting.
    """
    from rig.errors import ConfigurationError
    from rig.gears.card import card_for
    from rig.run.gear import with_card

    card = card_for(request.output, request.gear_serial)
    if card is None:
        return request
    noted = card.facts.mounting
    if mounting and noted and mounting != noted:
        raise ConfigurationError(
            "the gear's card says otherwise",
            where="--mounting",
            value=mounting,
            limit=noted,
            remedy=f"If it was mounted anew: rig gear set {card.serial} --mounting {mounting}.",
        )
    if card.warning:
        echo(f"warning: {card.warning}", errors=True)
    return with_card(request, card, parameters_given=parameters_given)


def confirmed(request: RunRequest, planned: PlannedRun, asks: bool) -> RunRequest:
    """The request of a run on hardware with what the operator typed; every other request as it is.

    Asked is whoever sits at the terminal, once the plan and its margins have been shown; without a
    terminal the run stays unconfirmed, and arming refuses it.
    """
    from rig.bench.backends.registry import HARDWARE

    if request.backend != HARDWARE or request.confirmation or not asks or not sys.stdin.isatty():
        return request
    from rig.commands.run_tables import print_plan
    from rig.run.start import arming_of

    print_plan(planned)
    expected = arming_of(request, planned).expected
    question = "This moves the rig. Guard closed, hands away, emergency stop within reach?"
    echo(f"\n{question} Type {expected} to arm: ", errors=True, is_line=False)
    return replace(request, confirmation=sys.stdin.readline().strip())
