"""What is known of one thing that a protocol finds: title, unit, unit shown, definition, what makes values comparable.

Each protocol declares its quantities beside its parameters; every estimate and every metric of a
result is one of them. Terminal, window, report, passport and difference read all they say of a
number from here, so that a new quantity needs one line in one file.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from experiments.errors import AnalysisError
from model.unit_text import scale_in, understood

_DependenceFunction = Callable[[float, str, float], float]
"""Of a value, how a channel may be wrong ("scale", "offset", "zero", "curve", "delay") and by how much (one standard
uncertainty): the standard uncertainty of the value."""
Dependence = Literal["proportional", "difference", "amplitude", "none"] | _DependenceFunction
"""How a number rests on a channel: on its readings as they are, on how they differ, on the amplitude of a wave in them,
not at all, or as a function says."""


def _in_its_budget(value: float, part: str, size: float) -> float:
    """What the analysis itself has in its budget, or takes out of its data: the contract adds nothing."""
    return 0.0


ANGLES_IN_ITS_BUDGET: Mapping[str, Dependence] = {
    "input_angle": _in_its_budget,
    "output_angle": _in_its_budget,
}
"""Of numbers whose analysis knows what the encoders add, and of those to which they add nothing."""
OF_TORQUE_DIFFERENCES: Mapping[str, Dependence] = {"torque": "difference", **ANGLES_IN_ITS_BUDGET}
"""Half-differences of the directions, and whatever has its zero taken off."""
OF_ANGLES: Mapping[str, Dependence] = {"torque": "none", **ANGLES_IN_ITS_BUDGET}
OF_SENT_ANGLES: Mapping[str, Dependence] = {**OF_ANGLES, "target_speed": "none"}
"""As of angles, against where the program sent the input: what it sends it knows."""
OF_EFFORT_DIFFERENCES: Mapping[str, Dependence] = {"effort": "difference"}
OF_CHANNEL_DIFFERENCES: Mapping[str, Dependence] = {
    "channel": "difference",
    **ANGLES_IN_ITS_BUDGET,
}
"""As of torques, for analyses whose options name the channel."""

_PLACEHOLDER = re.compile(r"\{(\w+)\}")


@dataclass(frozen=True, kw_only=True)
class Counterpart:
    """The value of a catalogue that a quantity is held against.

    `rating` is its name in the parameter set, `definition` and `conditions` are those under which
    catalogues customarily state it.
    """

    rating: str
    definition: str
    conditions: str


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """One thing that a protocol finds, or a family of such things that differ in one word of their name.

    A family has a placeholder in its name, which may stand in title and heading too:
    `running_torque_{speed}_rpm` is titled `running torque {speed} r/min`.

    - `name`: Its key among the estimates or metrics.
    - `title`: What it is called within a line or a table.
    - `unit`: SI, as in `Estimate.unit`: "1" for none; "" where it is that of the channel which was
      analysed.
    - `shown`: The unit in which a laboratory reads it; "" leaves that to its size
      (`model.units.by_size`).
    - `definition`: What exactly is meant.
    - `conditions`: Facts of a run that must be equal for two values to be comparable: "part",
      "mounting", "speed".
    - `target_uncertainty`: U that a useful result stays below, in `unit`;
    - `target_share`: or as a share of the value, for what differs by orders of magnitude between gears.
    - `target_elsewhere`: In another unit than `unit` (friction in ampere), as a share of the value.
    - `target_reason`: What such a result is good for.
    - `is_key`: Whether a reader looks for it first; the order of declaration is the order of
      importance.
    - `key_members`: Of a family: the members that are looked for first, the first of them first; none:
      all.
    - `is_watched`: Whether a passport follows it over the life of a gear.
    - `watched_members`: Of a family: the members that every gear should have; none: the largest that
      its runs show.
    - `is_alarmed`: Whether a lasting change over the life of a gear is told as an alarm; at most three quantities
      of a gear are (`rig.analysis.alarm`), and each one more costs sight of all.
    - `alarmed_members`: Of a family: the members that are.
    - `heading`: What it is called where it stands alone, above a chart; "" is the title with a capital
      letter.
    - `axis`: What stands at the axis of its chart, before the unit; "" is the title without the
      placeholder.
    - `is_signed`: Whether zero is a value like any other: an offset, a difference, a place.
    - `is_above_zero`: Whether it is above zero by its nature: an interval that reaches zero says that it was not
      measured.
    - `is_circular`: Whether it is an angle on the circle: two values differ by the shorter way round.
    - `subject`: Of a family of orders: what they are orders of.
    - `rests_on`: By channel (or by the option of the result that names one: "channel", "effort") how the
      number depends on it. What the budget does not have of it, the contract adds. None: nobody said,
      and the contract finds out by analysing again (`experiments.evidence.channel_lines`).
    """

    name: str
    title: str
    unit: str
    shown: str = ""
    definition: str = ""
    conditions: tuple[str, ...] = ()
    target_uncertainty: float | None = None
    target_share: float | None = None
    target_elsewhere: float | None = None
    target_reason: str = ""
    is_key: bool = False
    key_members: tuple[str, ...] = ()
    is_watched: bool = False
    watched_members: tuple[str, ...] = ()
    is_alarmed: bool = False
    alarmed_members: tuple[str, ...] = ()
    heading: str = ""
    axis: str = ""
    catalogue: Counterpart | None = None
    is_circular: bool = False
    is_signed: bool = False
    is_above_zero: bool = False
    subject: str = ""
    # A mapping has no hash; two quantities of one name are told apart by what remains.
    rests_on: Mapping[str, Dependence] | None = field(default=None, hash=False)

    def __post_init__(self) -> None:
        if self.shown and scale_in(self.shown, self.unit) is None:
            raise AnalysisError(
                "cannot be shown in this unit",
                where=self.name,
                value=repr(self.shown),
                limit=f"a multiple of {self.unit}: {', '.join(understood((self.unit,)))}",
            )

    def target_for(self, value: float, unit: str) -> float | None:
        """U that a useful result of this value [unit] stays below; None where none is declared.

        A target in N m says nothing of friction in ampere; a share holds in any unit.
        """
        share, target = self.target_share, self.target_uncertainty
        if unit != self.unit:
            share, target = share or self.target_elsewhere, None
        if share is not None:
            target = share * abs(value)
        return target

    @property
    def target_text(self) -> str:
        """The target as a reader sees it; "" where none is declared."""
        if self.target_share is not None:
            return f"<= {100.0 * self.target_share:g} % of the value"
        if self.target_uncertainty is None:
            return ""
        unit = self.shown or self.unit
        factor = (self.shown and scale_in(self.shown, self.unit)) or 1.0
        return f"<= {self.target_uncertainty / factor:.3g}" + (f" {unit}" if unit != "1" else "")

    @property
    def placeholder(self) -> str:
        """The word that differs within the family: "order", "way", "speed"; "" for a single quantity."""
        match = _PLACEHOLDER.search(self.name)
        return match[1] if match else ""

    @functools.cached_property
    def _pattern(self) -> re.Pattern[str]:
        before, mark, after = self.name.partition("{" + self.placeholder + "}")
        return re.compile(re.escape(before) + ("(.+)" if mark else "") + re.escape(after))

    def member(self, name: str) -> str:
        """The word that stands for the placeholder in a name of this family; "" for a name that is none of it."""
        match = self._pattern.fullmatch(name)
        return match[1] if match and self.placeholder else ""

    def matches(self, name: str) -> bool:
        """Whether an estimate or a metric of this name is this quantity."""
        return self._pattern.fullmatch(name) is not None

    def gives_alarm(self, name: str) -> bool:
        """Whether a lasting change of the estimate of this name is told as an alarm."""
        return self.is_alarmed and (
            not self.placeholder or self.member(name) in self.alarmed_members
        )

    def named(self, member: str) -> str:
        """The name of one member of the family."""
        return _filled(self.name, member)

    def titled(self, name: str) -> str:
        """The title of the estimate or metric of this name."""
        return _filled(self.title, self.member(name).replace("_", " "))

    def headed(self, name: str) -> str:
        """The title of the estimate of this name where it stands alone."""
        if not self.heading:
            title = self.titled(name)
            return title[:1].upper() + title[1:]
        return _filled(self.heading, self.member(name).replace("_", " "))

    @property
    def family_title(self) -> str:
        """The title without the word that differs within the family."""
        return re.sub(r"\s+(?=,|\s)", "", _PLACEHOLDER.sub("", self.title)).strip(" ,")


def _filled(text: str, member: str) -> str:
    return _PLACEHOLDER.sub(lambda _: member, text)


def bare_quantity(name: str, unit: str) -> Quantity:
    """A quantity of which nothing is known but its name and unit; a symbol of the paper (F_c) stays as it is."""
    symbol = any(letter.isupper() for letter in name)
    return Quantity(name=name, title=name if symbol else name.replace("_", " "), unit=unit)


def quantity_of(quantities: Iterable[Quantity], name: str) -> Quantity | None:
    """The quantity of an estimate or a metric: the one of that very name, else the first family that it belongs to."""
    family = None
    for quantity in quantities:
        if quantity.name == name:
            return quantity
        if family is None and quantity.matches(name):
            family = quantity
    return family


def with_bare(quantities: Sequence[Quantity], units: Mapping[str, str]) -> tuple[Quantity, ...]:
    """These quantities, and a bare one for each name (with its unit) that none of them covers."""
    bare = [
        bare_quantity(name, unit)
        for name, unit in units.items()
        if quantity_of(quantities, name) is None
    ]
    return (*quantities, *bare)


def key_names(quantities: Sequence[Quantity], names: Iterable[str]) -> tuple[str, ...]:
    """Of the names of a result's estimates those that a reader looks for first, the most important first."""
    members: dict[int, list[str]] = {}
    for name in names:
        quantity = quantity_of(quantities, name)
        if quantity is not None and quantity.is_key:
            members.setdefault(quantities.index(quantity), []).append(name)
    ordered: list[str] = []
    for place in sorted(members):
        wanted = [quantities[place].named(member) for member in quantities[place].key_members]
        if wanted:
            ordered += [name for name in wanted if name in members[place]]
        else:
            ordered += members[place]
    return tuple(ordered)
