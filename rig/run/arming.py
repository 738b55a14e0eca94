"""Arming a run on hardware: what must be true before a rig that can hurt somebody is allowed to move.

    before it is connected   operator named, gear named, confirmation typed: the gear's serial number, letter for
                             letter, and after it the limits of a drive that does not tell them
    while it is connected    guard closed (where the configuration names its input), limits written and read back,
                             the computer's loss watched by the drive or covered otherwise, the watchdog's own handle on
                             the bus open or not needed

Every rule is a row here; a rule that is not met refuses the run, and nothing has moved. The limits
are written and compared by `rig.run.session`; the drive is switched on only after all of it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from drivers.errors import DriverError
from experiments.finding import Finding, Severity
from rig.errors import ConfigurationError

WITHOUT_GEAR = "NO GEAR"
"""What is typed to arm a run without a gear."""
_UNNAMED = frozenset({"", "unknown", "none", "nobody", "?"})


@dataclass(frozen=True)
class Arming:
    """Who arms which run: operator, serial number of the gear, what was typed, whether a gear is mounted at all, and
    the limits that somebody has set in a drive that does not tell them.
    """

    operator: str
    gear_serial: str
    confirmation: str
    gear_mounted: bool = True
    limits_by_hand: str = ""

    @property
    def expected(self) -> str:
        """What has to be typed: the gear, and the limits that were set by hand, in one line."""
        gear = self.gear_serial.strip() if self.gear_mounted else WITHOUT_GEAR
        return f"{gear} {self.limits_by_hand}".strip()

    @property
    def question(self) -> str:
        """What is asked before it is typed: between two runs somebody may have taken the gear off, or put it back."""
        gear = f"gear {self.gear_serial.strip()} mounted" if self.gear_mounted else "the gear off"
        return (
            f"This moves the rig with {gear}. Guard closed, hands away, emergency stop within reach? "
            f"Type {self.expected} to arm"
        )


@dataclass(frozen=True)
class Rule:
    """One rule: whether it is met, and what is said when it is not."""

    is_met: Callable[[Arming], bool]
    what: str
    where: str
    remedy: Callable[[Arming], str]


RULES: tuple[Rule, ...] = (
    Rule(
        lambda a: a.operator.strip().lower() not in _UNNAMED,
        "a run on hardware needs a named operator",
        "--operator",
        lambda a: "Say who answers for it.",
    ),
    Rule(
        lambda a: not a.gear_mounted or a.gear_serial.strip().lower() not in _UNNAMED,
        "a run on hardware needs the gear's serial number",
        "--gear",
        lambda a: "Read it from the gear that is mounted.",
    ),
    Rule(
        lambda a: a.confirmation.strip() == a.expected,
        "the run was not confirmed",
        "--confirm",
        lambda a: (
            f"Look at the rig, then type {a.expected} letter for letter."
            + (
                " Its limits were set by hand: look them up in the amplifier."
                * bool(a.limits_by_hand)
            )
        ),
    ),
)
"""What must be true before the rig is connected."""


def refuse_unarmed(arming: Arming) -> None:
    """Raise `ConfigurationError` for the first rule that is not met."""
    for rule in RULES:
        if not rule.is_met(arming):
            typed = arming.confirmation if rule.where == "--confirm" else None
            raise ConfigurationError(
                rule.what,
                where=rule.where,
                value=None if typed is None else repr(typed),
                remedy=rule.remedy(arming),
            )


def loss_check(unwatched: Callable[[], Sequence[str]] | None, covered_by: str) -> Finding:
    """Whether the motor stops when the computer is lost: the drive sees to it, or the rig's description says
    what does. `unwatched` gives the reasons why the drive would not; None: nobody knows.
    """
    reasons = unwatched() if unwatched is not None else ("nobody knows whether it would",)
    if not reasons:
        text = "the drive watches the computer's heartbeat, and stops then: as it reads back"
        return Finding("loss of the computer", Severity.PASSED, text)
    text = f"the drive does not stop by itself: {'; '.join(reasons)}"
    if covered_by.strip():
        return Finding(
            "loss of the computer",
            Severity.WARNS,
            f"{text}. Covered by: {covered_by.strip()}",
            "Try it with the motor free, before a gear is mounted.",
        )
    return Finding(
        "loss of the computer",
        Severity.BLOCKS,
        text,
        "Cover it by hardware (a watchdog relay in the safe-torque-off line, the drive's own life guarding), try it "
        "with the motor free, and say it as `computer_loss_covered_by` in [drive].",
    )


def handle_check(
    open_it: Callable[[], object],
    known: str,
    unwatched: Callable[[], Sequence[str]] | None,
    covered_by: str,
) -> Finding:
    """Whether the watchdog has a handle of its own on the bus; `open_it` opens it, `known` is what is known of the
    adapter. Without one a run goes on where the loss of the whole computer is covered: what is lost is the quick stop
    of a loop that hangs, before the drive misses its heartbeat.
    """
    try:
        open_it()
    except Exception as error:  # noqa: BLE001  whatever an adapter's library raises
        text = f"the bus cannot be opened twice, the run goes on without a watchdog: {error}"
    else:
        return Finding("watchdog", Severity.PASSED, "it has a handle of its own on the bus")
    text += f" ({known})" if known else ""
    watched = unwatched is not None and not unwatched()
    if watched or covered_by.strip():
        covered = "the drive watches the computer's heartbeat" if watched else covered_by.strip()
        return Finding(
            "watchdog",
            Severity.WARNS,
            f"{text}. A loop that hangs is covered by: {covered}",
            "Use an adapter that can be opened twice, or a hub (socketcand) in front of it.",
        )
    return Finding(
        "watchdog",
        Severity.BLOCKS,
        text.replace("the run goes on without a watchdog", "and nothing else stops the motor"),
        "Use an adapter that can be opened twice, or cover the loss of the computer by hardware and say it as "
        "`computer_loss_covered_by` in [drive].",
    )


def guard_check(read: Callable[[], tuple[int, bool]] | None) -> Finding:
    """The guard's contact: `read` gives the input's value and whether that means closed; None: no
    input is configured.
    """
    if read is None:
        return Finding(
            "guard",
            Severity.WARNS,
            "no guard input is configured: nobody looks whether the guard is closed",
        )
    try:
        value, closed = read()
    except DriverError as error:
        return Finding(
            "guard",
            Severity.BLOCKS,
            f"the guard input cannot be read: {error}",
            "Correct [guard] in the configuration.",
        )
    if closed:
        return Finding("guard", Severity.PASSED, f"closed (input 0x{value:X})")
    return Finding(
        "guard", Severity.BLOCKS, f"open (input 0x{value:X})", "Close the guard, then start again."
    )
