"""The one table of units: constants, words, prefixes, spellings, and what is said of those that mean two things.

Inside, everything is SI: rad, rad/s, N m, s. Multiply by a constant to come in (`speed_rpm * RPM`),
divide to go out (`speed / RPM`). `model.unit_text` reads a text by this table.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction

RPM = 2.0 * math.pi / 60.0
"""rad/s per r/min."""
DEGREE = math.pi / 180.0
"""rad per degree."""
ARCMIN = DEGREE / 60.0
"""rad per minute of arc."""
ARCSEC = DEGREE / 3600.0
"""rad per second of arc."""
REVOLUTION = 2.0 * math.pi
"""rad per revolution."""

COUNT = "count"
"""The unit of a counter's own numbers; its SI unit is itself, for a scale is needed."""

SMALL: Mapping[str, tuple[float, str]] = {
    "rad": (0.02, "arcsec"),
    "N m": (1.0, "mN m"),
    "N m s/rad": (1e-3, "µN m s/rad"),
    "kg m2": (1e-3, "kg cm²"),
    "m": (1e-3, "µm"),
}
"""SI unit: below which magnitude numbers are read in which smaller unit."""

Powers = tuple[int, ...]
BASE = ("kg", "m", "s", "A", "K", "rad", COUNT)
SI: Mapping[str, Powers] = {
    #            kg  m  s  A  K rad count
    "1":         (0, 0, 0, 0, 0, 0, 0),
    "rad":       (0, 0, 0, 0, 0, 1, 0), "rad/s":  (0, 0, -1, 0, 0, 1, 0), "rad/s2": (0, 0, -2, 0, 0, 1, 0),
    "m":         (0, 1, 0, 0, 0, 0, 0), "m/s":    (0, 1, -1, 0, 0, 0, 0), "m/s2":   (0, 1, -2, 0, 0, 0, 0),
    "m2/s":      (0, 2, -1, 0, 0, 0, 0), "s":     (0, 0, 1, 0, 0, 0, 0),
    "N":         (1, 1, -2, 0, 0, 0, 0), "N/m":   (1, 0, -2, 0, 0, 0, 0), "N s/m":  (1, 0, -1, 0, 0, 0, 0),
    "N m":       (1, 2, -2, 0, 0, 0, 0), "N m s": (1, 2, -1, 0, 0, 0, 0), "N m/rad": (1, 2, -2, 0, 0, -1, 0),
    "N m s/rad": (1, 2, -1, 0, 0, -1, 0), "N m s2/rad": (1, 2, 0, 0, 0, -1, 0),
    "N m/A":     (1, 2, -2, -1, 0, 0, 0), "N m/V": (0, 0, 1, 1, 0, 0, 0), "N/A":  (1, 1, -2, -1, 0, 0, 0),
    "kg":        (1, 0, 0, 0, 0, 0, 0), "kg m2":  (1, 2, 0, 0, 0, 0, 0), "kg/m3":  (1, -3, 0, 0, 0, 0, 0),
    "Pa":        (1, -1, -2, 0, 0, 0, 0), "A":    (0, 0, 0, 1, 0, 0, 0), "V":      (1, 2, -3, -1, 0, 0, 0),
    "V s/rad":   (1, 2, -2, -1, 0, -1, 0), COUNT: (0, 0, 0, 0, 0, 0, 1), "degC":   (0, 0, 0, 0, 1, 0, 0),
    "W":         (1, 2, -3, 0, 0, 0, 0), "J":     (1, 2, -2, 0, 0, 0, 0), "1/s":    (0, 0, -1, 0, 0, 0, 0),
    "Hz":        (0, 0, -1, 0, 0, 0, 0),
}  # fmt: skip
"""SI units by name, and the powers of the base units in each. An angle is kept as a base unit: N m/rad is no N m."""
FREE_FALL = Fraction(980665, 100000)
"""m/s2; what makes a pound of mass a pound of force."""
_POUND = Fraction(45359237, 10**8)
PREFIXES = {"M": 10**6, "k": 10**3, "d": Fraction(1, 10), "c": Fraction(1, 100), "m": Fraction(1, 10**3),
             "u": Fraction(1, 10**6), "n": Fraction(1, 10**9), "G": 10**9}  # fmt: skip


@dataclass(frozen=True)
class Word:
    """One word of the table: its SI unit, how much of it one is, prefixes that it takes, other spellings, zero [SI]."""

    symbol: str
    si: str
    factor: Fraction | float = Fraction(1)
    prefixes: str = ""
    spellings: str = ""
    zero: float = 0.0


WORDS: tuple[Word, ...] = (
    Word("rad", "rad", prefixes="mu", spellings="radian radians"),
    Word("deg", "rad", DEGREE, "m", "° degree degrees"),
    Word("arcmin", "rad", ARCMIN, "", "'"),
    Word("arcsec", "rad", ARCSEC, "", '" asec'),
    Word("gon", "rad", math.pi / 200.0),
    Word("rev", "rad", REVOLUTION, "", "revs revolution revolutions turn turns rot umdr"),
    Word("r", "rad", REVOLUTION, "", "U tr"),
    Word("rpm", "rad/s", RPM, "k", "upm"),
    Word("rps", "rad/s", REVOLUTION),
    Word("dps", "rad/s", DEGREE),
    Word("m", "m", prefixes="kdcmun", spellings="metre metres meter meters"),
    Word("in", "m", Fraction(254, 10**4), "", "inch inches"),
    Word("ft", "m", Fraction(3048, 10**4), "", "foot feet"),
    Word("yd", "m", Fraction(9144, 10**4), "", "yard yards"),
    Word("s", "s", prefixes="mun", spellings="S sec secs second seconds sek"),
    Word("min", "s", Fraction(60), "", "minute minutes"),
    Word("h", "s", Fraction(3600), "", "hr hour hours"),
    Word("Hz", "Hz", prefixes="Mk", spellings="hertz"),
    Word("g", "kg", Fraction(1, 1000), "km"),
    Word("lb", "kg", _POUND, "", "lbs lbm pound pounds"),
    Word("oz", "kg", _POUND / 16, "", "ozm ounce ounces"),
    Word("N", "N", prefixes="kmu", spellings="n newton newtons"),
    Word("lbf", "N", _POUND * FREE_FALL, "", "lbsf"),
    Word("kip", "N", 1000 * _POUND * FREE_FALL, "", "kips"),
    Word("ozf", "N", _POUND / 16 * FREE_FALL),
    Word("gf", "N", FREE_FALL / 1000, "k", "p"),
    Word("kp", "N", FREE_FALL),
    Word("Pa", "Pa", prefixes="kMG"),
    Word("bar", "Pa", Fraction(10**5)),
    Word("psi", "Pa", _POUND * FREE_FALL / Fraction(254, 10**4) ** 2),
    Word("cSt", "m2/s", Fraction(1, 10**6)),
    Word("A", "A", prefixes="kmu", spellings="a amp amps ampere amperes arms aeff"),
    Word("V", "V", prefixes="kdmu", spellings="v volt volts vrms"),
    Word("W", "W", prefixes="km", spellings="watt watts"),
    Word("J", "J", prefixes="km", spellings="joule joules"),
    Word("degC", "degC", spellings="°C C celsius"),
    Word("degF", "degC", Fraction(5, 9), "", "°F F fahrenheit", -160.0 / 9.0),
    Word("K", "degC", spellings="kelvin", zero=-273.15),
    Word(COUNT, COUNT, spellings="counts cnt cts inc incs inkr increment increments tick ticks pulse pulses lsb"),
    Word("%", "1", Fraction(1, 100), "", "percent"),
    Word("‰", "1", Fraction(1, 1000)),
    Word("ppm", "1", Fraction(1, 10**6)),
    Word("rms", "1", spellings="eff"),
)  # fmt: skip
"""Every word that is understood, in the spelling of this program. What is said of a current is r.m.s.: A is A r.m.s."""

WHOLE = {"rpm": "r/min", "upm": "r/min", "1/min": "r/min", "/min": "r/min", "min-1": "r/min", "min^-1": "r/min",
         "u/min": "r/min",
         "-": "1", "deg c": "degC", "deg f": "degF", "° c": "degC", "° f": "degF"}  # fmt: skip
"""Texts that mean another one as a whole: 1/min on a drive is its speed."""
SHOUTED = {w.lower(): w for w in ("Nm", "Nmm", "Ncm", "mNm", "uNm", "kNm")}
"""Newtons beside a length as people write them all in capitals or all in small letters; nm are nanometres."""
REFUSED = {
    "grad": ("is degrees in one language and a hundredth of a right angle in others", "Write deg or gon."),
    "gm": ("is a gram here and a gram metre there", "Write g or g m."),
    "mil": ("is a thousandth of an inch here and of a radian there", "Write in or mrad, with a scale."),
    **dict.fromkeys(("pk", "peak", "apk", "apeak", "app", "vpk", "vpp"),
        ("is a peak value, where r.m.s. is reckoned with", "Give A or V, and the scale.")),
    **dict.fromkeys(("pu", "fs", "fsd"), ("is a share of what nobody says", "Give the SI unit and the scale.")),
}  # fmt: skip
"""Words that are met and mean two things: why, and what to write."""

LEVERS = ("N m", "N m/rad", "N m/A", "kg m2")
"""What a mass beside a length is taken for where nobody asks for anything else: oz in, lb in/deg, oz in/A, oz in s2."""

COMMON = (
    "rad", "mrad", "urad", "deg", "arcmin", "arcsec", "rev", "rad/s", "mrad/s", "deg/s", "rev/s", "r/min", "rad/s2",
    "deg/s2", "m", "mm", "um", "nm", "in", "m/s", "mm/s", "m/s2", "s", "ms", "us", "ns", "min", "h", "Hz", "kHz", "MHz",
    "N m", "mN m", "uN m", "N mm", "N cm", "kN m", "lbf in", "lbf ft", "ozf in", "kgf cm", "N", "kN", "mN", "lbf",
    "kgf", "A", "mA", "V", "mV", "kV", "W", "kW", "J", "Pa", "MPa", "GPa", "m2/s", "mm2/s", "cSt", "N m/rad",
    "N m/arcmin", "N m/deg", "lbf in/deg", "N m s/rad", "mN m/(r/min)", "N m/A", "N m/V", "kg m2", "kg cm2", "g cm2",
    "lb in2", "ozf in s2", "degC", "K", "degF", "%", "1", COUNT,
)  # fmt: skip
"""Units that are offered where one is not understood: those that are met on test rigs."""


def by_size(unit: str, size: float) -> str:
    """The unit in which a quantity of this magnitude [unit] is read where nothing else is said of it."""
    limit, smaller = SMALL.get(unit, (0.0, unit))
    return smaller if abs(size) < limit else unit


def printed(unit: str) -> str:
    """A unit as it is printed: m2/s is m²/s, degC is °C, um is µm."""
    named = re.sub(r"\bdeg(?=C|F|\b)", "°", re.sub(r"\bu(?=m\b|N\b|rad\b)", "µ", unit))
    return re.sub(r"(?<=[A-Za-z])[23](?=$|[ /)])", lambda m: {"2": "²", "3": "³"}[m[0]], named)
