"""Acceptance files: what a gear must show to be accepted, limit by limit, each with its source and who confirmed it.

A file is TOML (`format = "acceptance-1"`): `name`, `source` (the document), `use`, the `parts` and
`ratios` that it is for (any where it names none), and a list `[[limits]]`. A limit names one quantity
of one protocol ("kinematic-error.transmission_accuracy"), its largest and smallest allowed value in a
unit that stands beside it, the condition under which the document states it, and whose limit it is.
It counts as verified once a named person has confirmed it against the document; no rank of a source
replaces that. A file of `use = "simulated"` judges runs of the simulated rig and nothing else; only
in it may limits of standing "demonstration" stand.

Inside, limits are SI; the file keeps the unit in which they were stated.
"""

from __future__ import annotations

import dataclasses
import hashlib
import math
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from datetime import date
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

from experiments import catalogue
from experiments.quantity import Quantity, quantity_of
from model import quantities
from model.errors import ParameterError, path_of
from model.unit_text import read
from rig.content.phrase import phrase
from rig.errors import ConfigurationError, misstated
from rig.gears.card import card_for
from rig.gears.card_places import places
from rig.runfile.header import gear_name

if TYPE_CHECKING:
    from experiments.recording import RunMetadata

FORMAT = "acceptance-1"
"""The value of `format` in the files that this program reads and writes."""

Use = Literal["any", "simulated"]
Standing = Literal["customer", "catalogue", "statistics", "demonstration"]
_Trust = Literal["A", "B", "C", "derived", ""]
Subject = Literal["gear", "motor + gear"]

_TOP = ("format", "name", "source", "use", "parts", "ratios", "limits")
_WORDS: Mapping[str, tuple[str, ...]] = {"standing": get_args(Standing), "trust": get_args(_Trust)}
_IMPLIED: Mapping[str, str] = {"subject": "gear"}
"""What is meant where a line says nothing, and is not written into a file."""


@dataclass(frozen=True)
class Part:
    """Which part a gear is, by the name of its parameter set, and its ratio as it was mounted (N, or N + 1); "" and
    NaN where nobody has said so.
    """

    name: str = ""
    ratio: float = math.nan

    @classmethod
    def of(cls, run: RunMetadata) -> Part:
        """The part that a recording says was turned."""
        return cls(gear_name(run), run.ratio)


@dataclass(frozen=True, kw_only=True)
class Limit:
    """One line of an acceptance file.

    - `quantity`: protocol and quantity, as in "friction.running_torque_2000_rpm".
    - `upper`, `lower`: largest and smallest allowed value in SI; None where that side is free.
    - `unit`: the unit in which the file states them.
    - `condition`: under which the document states the limit: temperature, speed, grease.
    - `subject`: what a limited torque is that of, "gear" or "motor + gear"; a torque of the other judges nothing.
    - `source`: document, edition, page.
    - `standing`: whose limit it is.
    - `trust`: of a catalogue's limit: A read in the maker's own page, B transcribed by somebody else
      and cross-checked, C third party, derived by a rule; "" for every other standing.
    - `confirmed_by`, `confirmed_on`: who held the limit against its document, and when (YYYY-MM-DD).
    """

    quantity: str
    unit: str
    source: str
    standing: Standing
    upper: float | None = None
    lower: float | None = None
    condition: str = ""
    subject: Subject = "gear"
    trust: _Trust = ""
    confirmed_by: str = ""
    confirmed_on: str = ""

    @property
    def kind(self) -> str:
        """The protocol whose analysis finds the quantity."""
        return self.quantity.partition(".")[0]

    @property
    def name(self) -> str:
        """The quantity's name among that analysis' estimates."""
        return self.quantity.partition(".")[2]

    @property
    def is_verified(self) -> bool:
        """Whether a named person has confirmed the limit against its document."""
        return bool(self.confirmed_by and self.confirmed_on)

    def declared(self) -> Quantity:
        """What its protocol declares of the quantity. Raises `ConfigurationError` for one that it does not have."""
        kinds = catalogue.names()
        if self.kind not in kinds or not self.name:
            raise ConfigurationError(
                "names no quantity of a protocol",
                value=repr(self.quantity),
                limit=f"PROTOCOL.QUANTITY, with a protocol among {', '.join(kinds)}",
            )
        declared = catalogue.load(self.kind).quantities
        found = quantity_of(declared, self.name)
        if found is None:
            raise ConfigurationError(
                "is a quantity that this protocol does not find",
                value=repr(self.quantity),
                limit=", ".join(f"{self.kind}.{q.name}" for q in declared if q.is_key),
            )
        return found


@dataclass(frozen=True, kw_only=True)
class Acceptance:
    """What a gear must show: the limits of one acceptance file, in their order.

    `path` is the file, or the name of one that comes with the program; `sha256` that of the bytes that
    were read, "" for one that was not read from a file. `parts` and `ratios` are those of the gears that it is for,
    all where it names none.
    """

    name: str
    source: str
    use: Use
    limits: tuple[Limit, ...]
    path: str
    sha256: str = field(default="", compare=False)
    parts: tuple[str, ...] = ()
    ratios: tuple[float, ...] = ()

    @property
    def remark(self) -> str:
        """What whoever judges by it should know; "" for nothing."""
        return "" if self.parts or self.ratios else f"{self.name} names no part that it is for"

    @property
    def whom(self) -> str:
        """The gears that it is for, in words."""
        ratios = [f"ratio {ratio:g}" for ratio in self.ratios]
        return " or ".join(self.parts) + phrase(" ({})", " or ".join(ratios))

    def foreign(self, part: Part) -> str:
        """Why its limits say nothing of a gear: it is another part, or nobody knows which; "" where they do."""
        # CSF-25-120 is every CSF-25-120-2UH as well: the longer name is that part in a housing, or with other bores.
        name = f"{part.name.casefold()}-"
        is_named = any(name.startswith(f"{one.casefold()}-") for one in self.parts)
        if self.parts and not is_named:
            return (
                f"{self.name} is for {self.whom}, not for {part.name or 'a part that nobody named'}"
            )
        mounted = {one + step for one in self.ratios for step in (0.0, 1.0)}
        if self.ratios and not any(math.isclose(part.ratio, one) for one in mounted):
            ratio = "a ratio that nobody named" if math.isnan(part.ratio) else f"{part.ratio:g}"
            return f"{self.name} is for {self.whom or 'any part'}, not for {ratio}"
        return ""

    def doubt(self, limit: Limit, part: Part, *, is_simulated: bool) -> str:
        """Why this limit cannot judge a run of a gear, of the simulated rig or not; "" where it can."""
        if foreign := self.foreign(part):
            return foreign
        if self.use == "simulated" and not is_simulated:
            return f"{self.name} is for simulated rigs only"
        if limit.is_verified or limit.standing == "demonstration":
            return ""
        return f"the limit is not confirmed: nobody has held it against {limit.source}"


def load_acceptance(path: str | Path) -> Acceptance:
    """The acceptance file at `path`. Raises `ConfigurationError` with file, table, key, value, limit and remedy."""
    try:
        raw = quantities.read_raw(path)
        content = quantities.parse_toml(raw, str(path))
    except ParameterError as error:
        raise misstated(error) from error
    return _with_hash(_acceptance(content, str(path)), raw)


def shipped_acceptance(name: str) -> Acceptance:
    """An acceptance file that comes with the program. Raises `ConfigurationError` that lists them for another name."""
    names = shipped_names()
    if name not in names:
        raise ConfigurationError(
            "no such shipped acceptance file",
            where="acceptance",
            value=repr(name),
            limit=", ".join(names),
            remedy="Name one of these, or the path of a TOML file.",
        )
    raw = (_shipped() / f"{name}.toml").read_bytes()
    return _with_hash(_acceptance(tomllib.loads(raw.decode("utf-8")), name), raw)


def _with_hash(acceptance: Acceptance, raw: bytes) -> Acceptance:
    return dataclasses.replace(acceptance, sha256=hashlib.sha256(raw).hexdigest())


def shipped_names() -> tuple[str, ...]:
    """The acceptance files that come with the program."""
    files = [entry.name for entry in _shipped().iterdir()]
    return tuple(sorted(name.removesuffix(".toml") for name in files if name.endswith(".toml")))


def acceptance_named(text: str) -> Acceptance:
    """An acceptance file as people name it: a path that ends in .toml, or the name of a shipped one."""
    return load_acceptance(text) if text.lower().endswith(".toml") else shipped_acceptance(text)


def acceptance_for(folder: str | Path, serial: str, named: str = "") -> Acceptance | None:
    """What a gear must show, by the file that is named, else by the gear's card; None where that names none.

    Raises `ConfigurationError` for a card or an acceptance file that cannot be read.
    """
    if named:
        return acceptance_named(named)
    card = card_for(folder, serial)
    if card is None or not card.facts.acceptance:
        return None
    return acceptance_named(card.facts.acceptance)


def acceptance_of_places(
    where: str | Path | Iterable[str | Path], serial: str
) -> Acceptance | None:
    """What a gear must show, by the first of these folders and folders of run files whose card names a file."""
    named = map(Path, places(where))
    folders = dict.fromkeys(place if place.is_dir() else place.parent for place in named)
    found = (acceptance_for(folder, serial) for folder in folders)
    return next((one for one in found if one is not None), None)


def acceptance_text(acceptance: Acceptance) -> str:
    """An acceptance file as TOML that a person can read and change."""
    quote = quantities.quote
    lines = [
        "# What a gear must show to be accepted. A limit judges once somebody has confirmed it by name.",
        f"format = {quote(FORMAT)}",
        f"name = {quote(acceptance.name)}",
        f"source = {quote(acceptance.source)}",
        f"use = {quote(acceptance.use)}",
    ]
    if acceptance.parts:
        lines.append(f"parts = [{', '.join(map(quote, acceptance.parts))}]")
    if acceptance.ratios:
        lines.append(f"ratios = [{', '.join(f'{ratio:g}' for ratio in acceptance.ratios)}]")
    for limit in acceptance.limits:
        si = limit.declared().unit
        lines += ["", "[[limits]]"]
        for f in dataclasses.fields(limit):
            value = getattr(limit, f.name)
            if isinstance(value, float):
                lines.append(f"{f.name} = {quantities.text_in(value, limit.unit, si)}")
            elif value and value != _IMPLIED.get(f.name):
                lines.append(f"{f.name} = {quote(value)}")
    return "\n".join(lines) + "\n"


def _shipped() -> Any:
    return resources.files("rig.gears") / "shipped"


def _acceptance(content: Mapping[str, Any], path: str) -> Acceptance:
    """The acceptance of a parsed file."""
    if content.get("format") != FORMAT:
        raise ConfigurationError(
            "is no acceptance file",
            where=f"{path}: format",
            value=quantities.shorten(content.get("format")),
            limit=f'"{FORMAT}"',
            remedy="Is this the acceptance file of a gear?",
        )
    _check_keys(content, _TOP, path, "")
    words = {key: _text(content, key, path, "") for key in ("name", "source")}
    use = _word(content, "use", get_args(Use), path, "")
    rows = content.get("limits", [])
    if not isinstance(rows, list):
        raise ConfigurationError(
            "is no list of limits",
            where=f"{path}: limits",
            value=quantities.shorten(rows),
            remedy="Begin every limit with a line [[limits]].",
        )
    limits = tuple(_limit(row, path, f"limits[{place}]", use) for place, row in enumerate(rows))
    for place, limit in enumerate(limits):
        if limit.quantity in {earlier.quantity for earlier in limits[:place]}:
            raise ConfigurationError(
                "is limited twice",
                where=f"{path}: limits[{place}].quantity",
                value=repr(limit.quantity),
                limit="each quantity once",
                remedy="Keep one of the two; it may have an upper and a lower value.",
            )
    parts = _list(content, "parts", str, path, '["CSF-25-120"]')
    ratios = _list(content, "ratios", (int, float), path, "[120]")
    return Acceptance(
        **words,
        use=use,
        limits=limits,
        path=path,
        parts=tuple(name.strip() for name in parts),
        ratios=tuple(map(float, ratios)),
    )


def _list(
    content: Mapping[str, Any], key: str, kind: Any, path: str, example: str
) -> tuple[Any, ...]:
    """A list of the file with nothing empty in it; () where it has none."""
    found = content.get(key, [])
    is_one = isinstance(found, list) and all(
        isinstance(one, kind) and not isinstance(one, bool) and one for one in found
    )
    if not is_one or (key in content and not found):
        raise ConfigurationError(
            "is no list of the gears that the file is for",
            where=f"{path}: {key}",
            value=quantities.shorten(found),
            remedy=f"Write {key} = {example}, or leave it away where the limits hold for any.",
        )
    return tuple(found)


def _limit(row: object, path: str, table: str, use: str) -> Limit:
    """One limit, in SI."""
    if not isinstance(row, Mapping):
        raise ConfigurationError(
            "is no limit", where=f"{path}: {table}", value=quantities.shorten(row)
        )
    _check_keys(row, [f.name for f in dataclasses.fields(Limit)], path, table)
    words: dict[str, Any] = {
        key: _text(row, key, path, table) for key in ("quantity", "unit", "source")
    }
    words |= {
        key: _text(row, key, path, table, needed=False) for key in ("condition", "confirmed_by")
    }
    words |= {key: _word(row, key, allowed, path, table) for key, allowed in _WORDS.items()}
    words["subject"] = _word({**_IMPLIED, **row}, "subject", get_args(Subject), path, table)
    limit = Limit(**words, confirmed_on=_day(row, path, table))
    try:
        si = limit.declared().unit
        bounds = {
            key: quantities.to_si(
                quantities.number(row[key], key, f"a number of {limit.unit}"),
                limit.unit,
                si,
                "unit",
            )
            for key in ("upper", "lower")
            if key in row
        }
        remark = "" if limit.unit in ("", si) else read(limit.unit, (si,)).remark
    except ConfigurationError as error:
        raise misstated(error, f"{path}: {table}.quantity{error.where}") from error
    except ParameterError as error:
        raise misstated(error, f"{path}: {table}.{error.where}") from error
    source = limit.source if remark in limit.source else f"{limit.source}; {remark}"
    limit = dataclasses.replace(limit, source=source, **bounds)
    _check_sense(limit, row, path, table, use)
    return limit


def _check_sense(limit: Limit, row: Mapping[str, Any], path: str, table: str, use: str) -> None:
    """Refuse a limit whose parts do not go together, in the numbers of its row."""

    def refuse(key: str, what: str, value: object, allowed: str, remedy: str) -> None:
        raise ConfigurationError(
            what, where=f"{path}: {table}.{key}", value=value, limit=allowed, remedy=remedy
        )

    if limit.upper is None and limit.lower is None:
        refuse("upper", "limits nothing", None, "upper, lower or both", "Give the limit's value.")
    if limit.upper is not None and limit.lower is not None and limit.upper < limit.lower:
        unit = "" if limit.unit == "1" else limit.unit
        upper, lower = (f"{row[key]} {unit}".rstrip() for key in ("upper", "lower"))
        refuse("upper", "is below lower", upper, f">= {lower}", "Exchange the two.")
    if (limit.standing == "catalogue") != bool(limit.trust):
        refuse(
            "trust",
            "is a catalogue's and no other limit's",
            repr(limit.trust),
            f"{', '.join(_WORDS['trust'][:-1])} with standing catalogue, left away with any other",
            "Say how the catalogue's number was come by.",
        )
    if limit.standing == "demonstration" and use != "simulated":
        refuse(
            "standing",
            "judges simulated rigs only",
            "'demonstration'",
            'a file of use = "simulated"',
            "State whose limit it is, or the use of the file.",
        )
    if bool(limit.confirmed_by) != bool(limit.confirmed_on):
        missing = "confirmed_on" if limit.confirmed_by else "confirmed_by"
        remedy = "Name who held the limit against its document, and the day; or leave both away."
        refuse(missing, "is missing", None, "confirmed_by and confirmed_on together", remedy)


def _check_keys(content: Mapping[str, Any], allowed: Any, path: str, table: str) -> None:
    try:
        quantities.check_keys(content, allowed, table)
    except ParameterError as error:
        raise misstated(error, f"{path}: {error.where}") from error


def _place(path: str, table: str, key: str) -> str:
    return f"{path}: {path_of(table, key)}"


def _refusal(
    content: Mapping[str, Any],
    key: str,
    what: str,
    where: str,
    *,
    limit: str = "",
    remedy: str = "",
) -> ConfigurationError:
    """The refusal of what stands under a key, or of nothing where something is needed."""
    if key not in content:
        return ConfigurationError("is missing", where=where, limit=limit, remedy=remedy)
    value = quantities.shorten(content[key])
    return ConfigurationError(what, where=where, value=value, limit=limit, remedy=remedy)


def _text(
    content: Mapping[str, Any], key: str, path: str, table: str, *, needed: bool = True
) -> str:
    """A text of the file, without blanks around it."""
    text = content.get(key, "")
    if not isinstance(text, str) or (needed and not text.strip()):
        remedy = f'Write {key} = "...".'
        raise _refusal(content, key, "is no text", _place(path, table, key), remedy=remedy)
    return text.strip()


def _word(
    content: Mapping[str, Any], key: str, allowed: tuple[str, ...], path: str, table: str
) -> Any:
    """One of a few words; "" where that is one of them and nothing stands there."""
    word = content.get(key, "")
    if word not in allowed:
        what, limit = "is none of the words there are", ", ".join(filter(None, allowed))
        raise _refusal(content, key, what, _place(path, table, key), limit=limit)
    return word


def _day(row: Mapping[str, Any], path: str, table: str) -> str:
    """The day of a confirmation, "" for none; TOML's own dates are dates as well."""
    day = row.get("confirmed_on", "")
    if day == "":
        return ""
    try:
        if type(day) is not date:
            day = date.fromisoformat(day)
        return day.isoformat()
    except (TypeError, ValueError):
        raise ConfigurationError(
            "is no date",
            where=f"{path}: {table}.confirmed_on",
            value=quantities.shorten(day),
            limit="YYYY-MM-DD",
        ) from None
