"""What a run takes from the card of its gear: the order completed by it, and the preflight's view of it."""

from __future__ import annotations

import dataclasses

from experiments.finding import Finding, Severity
from model.errors import WordedError
from model.gear_file import shipped_gear
from rig.bench.backends.order import Order
from rig.content.wording import named
from rig.gears.acceptance import Part, acceptance_named
from rig.gears.card import EXPECTED, GearCard, conditions_of, gear_of
from rig.gears.facts import stated_facts


def with_card(order: Order, card: GearCard, *, parameters_given: bool = False) -> Order:
    """An order with what the gear's card says: part (unless a parameter file was named), load inertia, mounting,
    conditions. Done twice it changes nothing more. Raises `ParameterError` for a part that cannot be read."""
    facts = dataclasses.replace(card.facts, part="") if parameters_given else card.facts
    return dataclasses.replace(
        order,
        gear=gear_of(facts, order.gear),
        mounting=card.facts.mounting or order.mounting,
        conditions={**conditions_of(card), **order.conditions},
    )


def card_checks(card: GearCard | None, serial: str) -> tuple[Finding, ...]:
    """A preflight's view of a card: is there one, is it confirmed, is anything unknown that results need."""
    if card is None:
        text = f"nothing is known of gear {serial}" if serial.strip() else "no gear is named"
        return (Finding("gear card", Severity.BLOCKS, text, "Fill in its card and confirm it."),)
    if not card.is_confirmed:
        return (
            Finding(
                "gear card",
                Severity.BLOCKS,
                card.warning,
                "Look at the gear, then confirm the card by name.",
            ),
        )
    confirmation = card.confirmation
    assert confirmation is not None
    checks = [
        Finding(
            "gear card",
            Severity.PASSED,
            f"{card.serial} confirmed by {confirmation.by}, {confirmation.at}",
        )
    ]
    unknown = [name for name in EXPECTED if name not in stated_facts(card.facts)]
    if unknown:
        words = ", ".join(named(name)[0] for name in unknown)
        checks.append(
            Finding(
                "gear card",
                Severity.WARNS,
                f"not known of {card.serial}: {words}",
                "Reports will say so.",
            )
        )
    return tuple(checks)


def acceptance_checks(named: str, part: Part) -> tuple[Finding, ...]:
    """A preflight's view of what judges a gear: whether the acceptance file, where one is named, is for such a part.

    Raises `ConfigurationError` for a file that cannot be read.
    """
    if not named:
        return ()
    acceptance = acceptance_named(named)
    if foreign := acceptance.foreign(part):
        text, remedy = (
            f"{foreign}: the verdict will be NOT JUDGED",
            "Name the file of this part: rig gear set SERIAL --by NAME --acceptance FILE",
        )
        return (Finding("acceptance", Severity.WARNS, text, remedy),)
    if acceptance.remark:
        remedy = 'Write parts = ["..."] into it, as its document says.'
        return (Finding("acceptance", Severity.WARNS, acceptance.remark, remedy),)
    return (Finding("acceptance", Severity.PASSED, f"{acceptance.name}, for {acceptance.whom}"),)


def acceptance_checks_of_card(card: GearCard | None) -> tuple[Finding, ...]:
    """The same of the file that a card names, for the part that it names; of one that cannot be read, that."""
    if card is None:
        return ()
    try:
        gear = gear_of(card.facts, shipped_gear()) if card.facts.part else None
        part = Part() if gear is None else Part(gear.name, gear.ratio)
        return acceptance_checks(card.facts.acceptance, part)
    except WordedError as error:
        return (Finding("acceptance", Severity.BLOCKS, str(error)),)
