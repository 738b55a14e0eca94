"""A unit read from a text, by a grammar of products, powers and quotients on the words of `model.units`.

A unit is a product of items, divided by items (`/`, `per`). Between the items of a product stands a
space, `*`, `.`, `-`, `_`, or nothing where a force or a mass stands beside a length (`Nm`, `inlb`). An
item is a word with a power (`s2`, `s^-2`, `s²`), a product in brackets, or either behind a power of ten
(`0.1 deg`, `V/1000 rpm`). A second solidus, or a product behind one, needs brackets, for people mean two
things by it; only times may follow each other (`deg/s/s`).
"""

from __future__ import annotations

import difflib
import functools
import operator
import re
import unicodedata
from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction

from model.errors import ParameterError
from model.units import (
    BASE,
    COMMON,
    FREE_FALL,
    LEVERS,
    PREFIXES,
    REFUSED,
    SHOUTED,
    SI,
    WHOLE,
    WORDS,
    Powers,
    Word,
    by_size,
)


@dataclass(frozen=True)
class Unit:
    """A unit as it was read: value in SI = factor * value + zero. The factor is exact where it is rational.

    `symbol` is the spelling of this program, `si` the SI unit, `powers` those of the base units in it,
    `remark` what a reader should know of how it was read.
    """

    symbol: str
    si: str
    factor: Fraction | float
    powers: Powers
    zero: float = 0.0
    remark: str = ""

    @property
    def scale(self) -> float:
        """The factor as a number."""
        return float(self.factor)


def read(text: str, wanted: Iterable[str] = (), where: str = "") -> Unit:
    """The unit that a text means. `wanted` are the SI units that are asked for there: a mass beside a length
    is a force where a torque is, or nothing, and says so in its remark.

    Raises `ParameterError` with the units that would be understood.
    """
    wanted = tuple(wanted)
    try:
        return _as_force(_read(text), wanted or LEVERS)
    except ParameterError as error:
        raise ParameterError(
            error.what,
            where=where,
            value=repr(text),
            limit=", ".join(understood(wanted)),
            remedy=error.remedy,
        ) from None


def fitting(text: str, si: str, where: str = "") -> Unit:
    """The unit that a text means, which has to be a multiple of this SI unit. Raises `ParameterError` as `read`."""
    unit = read(text, (si,), where)
    if unit.si != si:
        raise ParameterError(
            "has a unit of another dimension",
            where=where,
            value=f'"{text}"',
            limit=", ".join(understood((si,))),
        )
    return unit


def scale_in(text: str, si: str) -> float | None:
    """How much of this SI unit one of a unit is; None for what is none of it."""
    try:
        unit = _read(text)
    except ParameterError:
        return None
    return unit.scale if unit.si == si and not unit.zero else None


def understood(wanted: Iterable[str] = ()) -> tuple[str, ...]:
    """Units that would be understood where one of these SI units is asked for; all that are common for none."""
    wanted = tuple(wanted)
    return (*dict.fromkeys((*wanted, *(u for u in COMMON if not wanted or _read(u).si in wanted))),)


@dataclass(frozen=True)
class _Term:
    """A part of a unit. `has_force` tells N m from J; `word` is the word where the part is nothing else."""

    symbol: str
    factor: Fraction | float
    powers: Powers
    has_force: bool = False
    word: Word | None = None

    def times(self, other: _Term) -> _Term:
        powers = tuple(map(operator.add, self.powers, other.powers))
        symbol = f"{self.symbol} {other.symbol}"
        return _Term(symbol, self.factor * other.factor, powers, self.has_force or other.has_force)

    def over(self, other: _Term) -> _Term:
        powers = tuple(map(operator.sub, self.powers, other.powers))
        divisor = f"({other.symbol})" if re.search("[ /]", other.symbol) else other.symbol
        forces = self.has_force or other.has_force
        return _Term(f"{self.symbol}/{divisor}", self.factor / other.factor, powers, forces)

    def to_the(self, power: int) -> _Term:
        if power == 1:
            return self
        powers = tuple(power * each for each in self.powers)
        return _Term(f"{self.symbol}{power}", self.factor**power, powers, self.has_force)


_ONE = _Term("1", Fraction(1), SI["1"])
_SIGNS = str.maketrans({"·": "*", "⋅": "*", "∙": "*", "•": "*", "×": "*", "−": "-", "º": "°", "˚": "°", "′": "'",
                        "’": "'", "″": '"', "”": '"', "µ": "u", "μ": "u"})  # fmt: skip
_TOKEN = re.compile(
    r"[\s.*_-]*(?:(?P<number>0\.0{0,5}1|10{0,6})(?![\d.])"
    r"|(?P<word>°\s?[CF]\b|[°'\"%‰]|[^\W\d_]+)(?:(?:\^|\*\*)?\(?(?P<power>-?[1-9])\)?(?!\d))?"
    r"|(?P<sign>[/()]))"
)
LONGEST = 40
"""Letters of a text that may be a unit; what is longer is a sentence."""


@functools.lru_cache(maxsize=1024)
def _read(text: str) -> Unit:
    """The unit of a text by the grammar, whatever it measures."""
    plain = unicodedata.normalize("NFKC", text.translate(_SIGNS)).translate(_SIGNS).strip()
    plain = re.sub(r"(?i)\(?\br\.?m\.?s\b\.?\)?", " rms", plain)
    tokens = _tokens(WHOLE.get(plain.lower(), plain))
    term = _product(tokens)
    if tokens:
        raise _unknown(text, "Close each bracket.")
    if term.symbol == "g":
        raise _unknown(
            text, "A gram or the acceleration of free fall? Write kg or m/s2, with a scale."
        )
    remark = f"each number counts {term.symbol}" if re.match("[01.]+ ", term.symbol) else ""
    if term.word is not None:
        word = term.word
        return Unit(term.symbol, word.si, term.factor, term.powers, word.zero, remark)
    return Unit(term.symbol, _si_of(term), term.factor, term.powers, remark=remark)


def _tokens(text: str) -> deque[re.Match[str]]:
    """The numbers, words and signs of a text; what stands between them is a product."""
    tokens: deque[re.Match[str]] = deque()
    place = 0
    # Before a bracket, a solidus and the end a point only marks an abbreviation.
    text = re.sub(r"\.(?=\s*($|[/)-]))", "", text)
    while place < len(text):
        match = _TOKEN.match(text, place)
        if match is None or len(text) > LONGEST or (not place and text[0] in ".*_-"):
            raise _unknown(text)
        tokens.append(match)
        place = match.end()
    if not tokens:
        raise _unknown(text)
    return tokens


def _product(tokens: deque[re.Match[str]]) -> _Term:
    """The product or quotient at the head of these tokens, up to a bracket that closes."""
    total, divisor = None, None
    while tokens and tokens[0]["sign"] != ")":
        is_over = tokens[0]["sign"] == "/" or tokens[0]["word"] == "per"
        if is_over:
            tokens.popleft()
        item = _item(tokens, may_be_large=is_over)
        if item.word is not None and item.word.symbol == "rms":
            continue
        if divisor is not None and not (is_over and item.powers == divisor.powers == SI["s"]):
            # N m/rad s: people mean both N m s/rad and N m/(rad s) by it.
            raise _unknown(item.symbol, "Write brackets: mN m/(r/min).")
        if is_over:
            total, divisor = (total or _ONE).over(item), item
        else:
            total = item if total is None else total.times(item)
    if total is None:
        raise _unknown("")
    return total


def _item(tokens: deque[re.Match[str]], *, may_be_large: bool = False) -> _Term:
    """One word, one product in brackets, or either behind a power of ten."""
    token = tokens.popleft() if tokens else None
    if token is None or token["sign"] in ("/", ")"):
        raise _unknown("")
    if token["sign"]:
        term = _product(tokens)
        if not tokens:
            raise _unknown(term.symbol, "Close each bracket.")
        tokens.popleft()
        return term
    if token["word"]:
        return _word(token["word"].replace(" ", ""), int(token["power"] or 1))
    number = Fraction(token["number"])
    # [10 V] is a range, [0.1 V] may be one: both a factor that nobody asked for would hide.
    if number > 1 and not may_be_large:
        raise _unknown(token["number"], "Give the unit without a number, and a scale.")
    if not tokens or not tokens[0]["word"] or tokens[0]["word"] == "per":
        return replace(_ONE, symbol=token["number"], factor=number)
    term = _item(tokens)
    if number == 1:
        return term
    return replace(term, symbol=f"{token['number']} {term.symbol}", factor=number * term.factor)


def _word(text: str, power: int) -> _Term:
    """One word with its power, or two that are written as one; the power is that of the last."""
    folded = text.casefold()
    if folded in REFUSED:
        why, remedy = REFUSED[folded]
        raise ParameterError(f"has a unit that {why}", remedy=remedy)
    exact = _terms()
    term = exact.get(text) or _folded().get(folded)
    if term is not None:
        return term.to_the(power)
    text = SHOUTED.get(folded, text)
    for cut in range(1, len(text)):
        left, right = exact.get(text[:cut]), exact.get(text[cut:])
        if left and right and _is_lever(left, right):
            return left.times(right.to_the(power))
    if text.endswith("s") and len(text) > 2 and power == 1:
        # Nms is newton metre seconds.
        return _word(text[:-1], 1).times(exact["s"])
    raise _unknown(text)


def _is_lever(left: _Term, right: _Term) -> bool:
    """Whether of two parts one is a length and the other a force or a mass."""
    both = {left.powers, right.powers}
    return SI["m"] in both and bool(both & {SI["N"], SI["kg"]})


@functools.cache
def _terms() -> Mapping[str, _Term]:
    """Every word by every spelling, with its prefixes."""
    terms: dict[str, _Term] = {}
    for word in WORDS:
        powers, is_force = SI[word.si], word.si == "N"
        for prefix in ("", *word.prefixes):
            factor = word.factor * PREFIXES.get(prefix, 1)
            symbol = prefix + word.symbol
            terms[symbol] = _Term(symbol, factor, powers, is_force, word)
        terms |= dict.fromkeys(word.spellings.split(), terms[word.symbol])
    return terms


@functools.cache
def _folded() -> Mapping[str, _Term]:
    """The words of more than one letter in any case; with a prefix the case decides."""
    texts = (t for w in WORDS for t in (w.symbol, *w.spellings.split()) if len(t) > 1)
    return {text.casefold(): _terms()[text] for text in texts}


def _si_of(term: _Term) -> str:
    """The SI unit of a product: one of the table, else the base units written out."""
    for name, powers in SI.items():
        if powers == term.powers and (term.has_force or not name.startswith("N")):
            return name
    signed = list(zip(BASE, term.powers, strict=True))
    over, under = (
        [f"{b}{p * s}".removesuffix("1") for b, p in signed if p * s > 0] for s in (1, -1)
    )
    divisor = " ".join(under)
    if len(under) > 1:
        divisor = f"({divisor})"
    return "/".join(filter(None, (" ".join(over) or "1", divisor)))


def _as_force(unit: Unit, wanted: tuple[str, ...]) -> Unit:
    """A mass read as the force that it weighs, where that makes it one of the units that are asked for."""
    heavier = tuple(map(operator.add, unit.powers, SI["m/s2"]))
    for si in wanted:
        if unit.powers[0] == 1 and heavier == (SI.get(si) or _read(si).powers):
            remark = (
                f"{unit.symbol}: a mass where {si} is asked for is read as the force that it weighs"
            )
            return replace(
                unit, si=si, factor=unit.factor * FREE_FALL, powers=heavier, remark=remark
            )
    return unit


def _unknown(text: str, remedy: str = "") -> ParameterError:
    """The refusal of a text that is no unit; `read` adds the place and what would be understood."""
    near = difflib.get_close_matches(text, [*COMMON, *_terms()], n=1)
    hint = f'Did you mean "{near[0]}"?' if near else "Convert the column, or give SI and a scale."
    return ParameterError("has a unit that is not known", remedy=remedy or hint)


def amount_in_words(amount: float, unit: str, size: float, shown: str = "") -> str:
    """An amount [unit] of a number of this size [unit], to three digits in the unit in which that number is read.

    `shown` is the unit that is declared for it; where that is nothing, or of something else, its size decides.
    """
    if not shown or scale_in(shown, unit) is None:
        shown = by_size(unit, size)
    factor = 1.0 if shown == unit else scale_in(shown, unit) or 1.0
    said = "" if shown == "1" else f" {shown}"
    return f"{amount / factor:.3g}{said}"
