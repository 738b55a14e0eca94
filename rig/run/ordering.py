"""From what was said to an order: what was left open comes from the rig's configuration, the recorded run, the card."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from model.gear_file import load_gear
from rig.bench.backends.order import Order
from rig.bench.backends.registry import HARDWARE, REPLAY
from rig.content.phrase import quoted
from rig.errors import ConfigurationError
from rig.gears.card import card_for
from rig.run.gear import with_card
from rig.runfile.read import read_run_header


def order_of(
    protocol: str,
    values: Mapping[str, Any],
    said: Mapping[str, Any],
    warn: Callable[[str], None] = lambda text: None,
) -> Order:
    """The order of a protocol with the fields that were said; `warn` hears of a card that was not confirmed.

    `gear` may be a file of parameters. Raises `ConfigurationError`, `ParameterError`; nothing is connected.
    """
    named = dict(said)
    if isinstance(named.get("gear"), Path):
        named["gear"] = load_gear(named["gear"])
    backend = str(named.get("backend", ""))
    known = described(configuration_of(backend, named.get("config")))
    # A replay plans anew for the gear that was turned: for another one the plan would not be the recorded one.
    recorded = Path(backend.removeprefix(REPLAY)) if backend.startswith(REPLAY) else None
    if recorded is not None and recorded.is_file():
        turned = read_run_header(recorded).metadata.gear
        known |= {} if turned is None else {"gear": turned}
    order = Order(protocol=protocol, values=values, **{**known, **named})
    return _carded(order, named, warn, is_set_known="gear" in named or recorded is not None)


def configuration_of(backend: str, config: Path | None) -> Path | None:
    """The file that describes a rig, where one does: a rig of hardware has one, named or not."""
    if config is not None or backend != HARDWARE:
        return config
    from rig.bench.config.place import DEFAULT_PATH

    return DEFAULT_PATH


def described(config: Path | None) -> dict[str, Any]:
    """The fields of an order that a configuration knows. Raises `ConfigurationError`."""
    if config is None:
        return {}
    from rig.bench.config.apply import configured_rig

    configured = configured_rig(config)
    rig = configured.configuration.rig
    return {
        "config": config,
        "gear": configured.gear,
        "motor": configured.motor,
        "limits": configured.limits,
        "output_bearing": configured.output_bearing,
        "sample_rate": rig.sample_rate_hz,
        "folder": config.parent / rig.output,
    }


def _carded(
    order: Order, said: Mapping[str, Any], warn: Callable[[str], None], *, is_set_known: bool
) -> Order:
    """The order with what is known of its gear. Raises `ConfigurationError` where a card contradicts what was said."""
    card = card_for(order.folder, order.serial)
    if card is None:
        return order
    mounting, noted = said.get("mounting"), card.facts.mounting
    if mounting and noted and mounting != noted:
        raise ConfigurationError(
            "the gear's card says otherwise",
            where="--mounting",
            value=mounting,
            limit=noted,
            remedy=f"If it was mounted anew: "
            f"rig gear set {quoted(card.serial)} --by NAME --mounting {mounting}.",
        )
    if card.warning:
        warn(card.warning)
    return with_card(order, card, parameters_given=is_set_known)
