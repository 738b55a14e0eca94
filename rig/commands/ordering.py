"""The options of an order, made from its fields; and the confirmation of a run on hardware, which is none of them."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rig.bench.backends.order import (
    WORDS,
    WORLD_WORDS,
    Spoken,
    key_of,
    world_of,
    world_said,
)
from rig.commands.judgement import refuse_unknown_acceptance
from rig.commands.signature import Command, with_options
from rig.commands.terminal import echo
from rig.content.phrase import quoted

if TYPE_CHECKING:
    from rig.bench.backends.order import Order, WorldChoice
    from rig.run.dry_run import PlannedRun

Said = Mapping[str, Any]
"""What was said of an order: values by field; what was not said is not in it."""
EARLIER = "earlier_"
"""What stands before the names of the world's words as flags of their own, as version 0.2.0 had them."""
OF_MANY_RUNS = tuple(name for name in WORLD_WORDS if name not in ("number", "start_state"))
"""The words of a world in which several runs are made one after the other: each has a number and a start of its own."""
_PANELS = {"world": "Simulated world"}


def with_order(
    *names: str, world: Sequence[str] = tuple(WORLD_WORDS), **helps: str
) -> Callable[[Command], Command]:
    """Give a command the options of these fields of an order, in the place of its parameter `said`.

    `world` are the words that its simulated world may have; `helps` says otherwise what a field is.
    """

    if "world" in names:
        helps.setdefault(
            "world", f"{WORDS['world'].help} Its words: {', '.join(map(key_of, world))}."
        )

    options = [_option(name, WORDS[name], helps.get(name, WORDS[name].help)) for name in names]
    options += [_earlier(name) for name in world if "world" in names]

    def gathered(given: dict[str, Any]) -> Said:
        said = {name: given.pop(name) for name in names}
        if "world" in said:
            earlier = {name: given.pop(f"{EARLIER}{name}") for name in world}
            said["world"] = _world(said["world"], earlier, world)
        return {name: value for name, value in said.items() if value is not None}

    return with_options(options, gathered)


def _option(name: str, words: Spoken, help_text: str) -> inspect.Parameter:
    option = typer.Option(
        words.option,
        metavar=words.metavar,
        min=words.least,
        max=words.most,
        help=help_text,
        rich_help_panel=_PANELS.get(words.group),
    )
    return _parameter(name, Annotated[words.kind | None, option])


def _earlier(name: str) -> inspect.Parameter:
    """A word of the world as a flag of its own, as version 0.2.0 had it: read for one version more, and not shown."""
    option = typer.Option("--" + name.replace("_", "-"), hidden=True)
    return _parameter(f"{EARLIER}{name}", Annotated[str | None, option])


def _parameter(name: str, annotation: Any) -> inspect.Parameter:
    """A parameter of a command that is None where nothing was said."""
    kind = inspect.Parameter.KEYWORD_ONLY
    return inspect.Parameter(name, kind, default=None, annotation=annotation)


def _world(text: str | None, earlier: Said, taken: Sequence[str]) -> WorldChoice | None:
    """The world that `--world` names, and earlier flags: those are said to go."""
    said: dict[str, Any] = world_said(text or "")
    flags = {key_of(name): value for name, value in earlier.items() if value is not None}
    if flags:
        words = ",".join(f"{key}={value}" for key, value in {**said, **flags}.items())
        echo(
            f"warning: the world's own flags end with the next version; write --world {words}",
            errors=True,
        )
    said |= flags
    return world_of(said, taken) if said else None


NoCard = Annotated[
    bool,
    typer.Option("--no-card", help="A gear without a card on purpose, where the folder has cards."),
]


def order_of(
    protocol: str, values: Mapping[str, Any], said: Said, *, no_card: bool = False
) -> Order:
    """The order that was said; a gear's card that was not confirmed is told on standard error.

    Raises `ConfigurationError` for a serial number that has no card where others have one (it may be mistyped), for a
    rig and for an acceptance file that there is not.
    """
    from rig.run import ordering

    def warn(text: str) -> None:
        echo(f"warning: {text}", errors=True)

    from rig.bench.backends.registry import refuse_unknown

    serial = str(said.get("serial", ""))
    if "serial" in said:
        _check_serial(serial)
    order = ordering.order_of(protocol, values, said, warn)
    # Before anything turns: a run of an hour would end in this refusal.
    refuse_unknown(order.backend)
    refuse_unknown_acceptance(order.acceptance)
    if serial and not no_card:
        _require_card(order, serial, warn)
    _warn_of_acceptance(order, warn)
    return order


def _warn_of_acceptance(order: Order, warn: Callable[[str], None]) -> None:
    """Before anything turns: a file that is for another part judges nothing."""
    from experiments.finding import Severity
    from rig.gears.acceptance import Part
    from rig.gears.card import card_for
    from rig.run.gear import acceptance_checks

    card = card_for(order.folder, order.serial) if order.serial else None
    named = order.acceptance or (card.facts.acceptance if card is not None else "")
    for check in acceptance_checks(named, Part(order.gear.name, order.gear.ratio)):
        if check.severity is Severity.WARNS:
            warn(f"{check.found}. {check.remedy}")


def _check_serial(serial: str) -> None:
    """Refuse a path, and what is no serial number: two gears would differ by a blank that nobody sees."""
    from rig.errors import ConfigurationError

    is_path = "/" in serial or "\\" in serial
    if is_path or serial != serial.strip() or not serial.strip("."):
        raise ConfigurationError(
            "is a path, and no serial number" if is_path else "is no serial number",
            where="--gear",
            value=repr(serial),
            limit="a text that neither begins nor ends with a blank",
            remedy="Give the serial number that stands on the gear; the folder of runs is --runs.",
        )


def _require_card(order: Order, serial: str, warn: Callable[[str], None]) -> None:
    """A gear that is named has a card, or nobody here has one."""
    from rig.errors import ConfigurationError, nearest
    from rig.gears.card import card_for, list_cards

    if card_for(order.folder, serial) is not None:
        return
    serials = [one.card.serial for one in list_cards(order.folder) if one.card]
    if not serials:
        warn(f"{serial} has no card: what is planned rests on the parameter set {order.gear.name}.")
        return
    raise ConfigurationError(
        "there is no card of this gear",
        where=str(order.folder),
        value=serial,
        remedy=f"{nearest(serial, serials)} A new gear: rig gear new PART --serial {quoted(serial)}; "
        "one that is to have none: --no-card.",
    )


def confirmed(order: Order, planned: PlannedRun, given: str, asks: bool) -> str:
    """What the operator typed to arm a run on hardware: `given`, or asked for now; "" for every other rig.

    Asked is whoever sits at the terminal, once the plan and its margins have been shown; without a
    terminal the run stays unconfirmed, and arming refuses it.
    """
    from rig.bench.backends.registry import HARDWARE

    if order.backend != HARDWARE or given or not asks or not sys.stdin.isatty():
        return given
    from rig.commands.run_tables import print_plan
    from rig.run.start import arming_of

    print_plan(planned)
    echo(f"\n{arming_of(order, planned).question}: ", errors=True, is_line=False)
    return sys.stdin.readline().strip()
