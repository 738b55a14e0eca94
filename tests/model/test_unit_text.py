"""Units as people write them: 150 spellings of real headings, what each means, and what is refused with which words."""

from __future__ import annotations

import math
from fractions import Fraction

import pytest

from drivers.readout.nd287 import UNITS as ND287
from model.errors import ParameterError
from model.quantities import to_si
from model.unit_text import fitting, read, scale_in, understood
from model.units import ARCMIN, ARCSEC, COMMON, DEGREE, REVOLUTION, RPM, SI, WORDS, by_size, printed

POUND, OUNCE, FALL, INCH, FOOT = 0.45359237, 0.45359237 / 16, 9.80665, 0.0254, 0.3048

# Units of each line mean the same: SI unit, how much of it one is, and the texts.
SPELLINGS = (
    ("rad", 1.0, "rad|radian|Radians"),
    ("rad", 1e-3, "mrad"),
    ("rad", 1e-6, "urad|µrad|μrad"),
    ("rad", DEGREE, "deg|Deg|DEG|°|º|degree|degrees|deg."),
    ("rad", 1e-3 * DEGREE, "mdeg"),
    ("rad", ARCMIN, "arcmin|'|′"),
    ("rad", ARCSEC, 'arcsec|"|″'),
    ("rad", REVOLUTION, "rev|Rev.|revolutions|turn|turns|U|r|Umdr"),
    ("rad", math.pi / 200.0, "gon"),
    ("rad/s", 1.0, "rad/s|rad/sec|radians per second|rad s^-1|rad·s⁻¹|rad.s-1"),
    ("rad/s", DEGREE, "deg/s|°/s|deg/sec|deg per sec|dps"),
    ("rad/s", RPM, "r/min|rpm|RPM|U/min|1/min|min-1|min^-1|min⁻¹|rev/min|rev./min|tr/min|Umdr/min|/min"),
    ("rad/s", 1000 * RPM, "krpm"),
    ("rad/s", REVOLUTION, "rev/s|rps|turns/s"),
    ("rad/s2", 1.0, "rad/s2|rad/s²|rad/s^2|rad/s**2|rad/s/s"),
    ("rad/s2", DEGREE, "deg/s2|deg/s^2|°/s²"),
    ("rad/s2", RPM, "rpm/s|r/min/s"),
    ("m", 1e-3, "mm"),
    ("m", 1e-6, "um|µm"),
    ("m", 1e-9, "nm"),
    ("m", INCH, "in|inch|inches"),
    ("m/s", 1e-3, "mm/s"),
    ("m/s", INCH, "in/s|in/sec"),
    ("m/s2", 1.0, "m/s2|m/s^2|m/s²"),
    ("s", 1.0, "s|S|sec|Sec.|seconds"),
    ("s", 1e-3, "ms"),
    ("s", 1e-6, "us|µs"),
    ("s", 60.0, "min|minutes"),
    ("s", 3600.0, "h|hours"),
    ("Hz", 1.0, "Hz|hz"),
    ("Hz", 1e3, "kHz"),
    ("1/s", 1.0, "1/s|s-1"),
    ("N m", 1.0, "N m|Nm|N.m|N*m|N·m|N⋅m|N-m|NM|n.m|N\u00a0m|N_m"),
    ("N m", 1e-3, "mNm|mN.m|mN m|Nmm|N.mm|N mm|nmm"),
    ("N m", 1e-6, "uNm|µN m"),
    ("N m", 1e-2, "Ncm|N cm"),
    ("N m", 1e3, "kNm"),
    ("N m", POUND * FALL * INCH, "lbf in|lbf·in|lbf-in|lbfin|in-lbf|in lbf"),
    ("N m", POUND * FALL * FOOT, "lbf ft|ft-lbf|ft·lbf"),
    ("N m", OUNCE * FALL * INCH, "ozf in|ozf-in"),
    ("N m", FALL * 1e-2, "kgf cm|kgf-cm|kgf.cm|kgfcm|kp cm"),
    ("N", 1.0, "N|Newtons|newton"),
    ("N", 1e3, "kN"),
    ("N", POUND * FALL, "lbf"),
    ("N", 1000 * POUND * FALL, "kip|kips"),
    ("m", Fraction(9144, 10**4), "yd|yards"),
    ("N", FALL, "kgf|kp"),
    ("A", 1.0, "A|Amps|ampere|Arms|A rms|A_rms|A (rms)|Aeff|ARMS|A r.m.s."),
    ("A", 1e-3, "mA"),
    ("V", 1.0, "V|Volts|v|Vrms"),
    ("V", 1e-3, "mV"),
    ("V", 0.1, "dV"),
    ("W", 1e3, "kW"),
    ("J", 1.0, "J|W s"),
    ("Pa", 1e6, "MPa|N/mm2|N/mm²"),
    ("Pa", 1e5, "bar"),
    ("kg m2", 1.0, "kg m2|kgm2|kg m²|kg*m^2|kg.m²"),
    ("kg m2", 1e-4, "kg cm2|kgcm2|kgcm²|kg·cm²|kg-cm²"),
    ("kg m2", 1e-7, "g cm2|gcm²"),
    ("kg m2", POUND * INCH**2, "lb in2|lb-in²"),
    ("kg m2", OUNCE * FALL * INCH, "ozf in s2"),
    ("N m/rad", 1.0, "N m/rad|Nm/rad"),
    ("N m/rad", 1.0 / ARCMIN, "Nm/arcmin|N·m/arcmin|Nm/'"),
    ("N m s/rad", 1.0, "N m s/rad|Nms/rad|Nm/(rad/s)"),
    ("N m s/rad", 1e-3 / RPM, "mN m/(r/min)|mNm/rpm"),
    ("V s/rad", 1e-3 / RPM, "V/krpm|V/1000 rpm|mV/rpm"),
    ("N m/A", 1.0, "Nm/A|N·m/Arms|Nm/A rms"),
    ("degC", 1.0, "degC|°C|deg C|° C|Celsius|C"),
    ("1", 1e-2, "%"),
    ("1", 1.0, "1|-"),
    ("1", 1e-3, "0.1 %|0.1%|‰"),
    ("count", 1.0, "count|counts|inc|INC|increments|cnt|ticks|pulses"),
    ("count/rad", 1.0 / REVOLUTION, "inc/rev|counts/rev"),
)  # fmt: skip
FORCES = (
    ("N m", POUND * FALL * INCH, "lb in|lb-in|in-lb|in.lb|in-lbs|inlb|lb·in|in.-lbs."),
    ("N m", POUND * FALL * FOOT, "ft-lb|ft lbs|ft.lbs|lb-ft"),
    ("N m", OUNCE * FALL * INCH, "oz in|oz-in|ozin|in-oz|oz.in."),
    ("N m", FALL * 1e-2, "kg cm|kg-cm"),
    ("N m/rad", POUND * FALL * INCH / DEGREE, "in-lb/deg"),
    ("N m/A", OUNCE * FALL * INCH, "oz-in/A"),
    ("kg m2", OUNCE * FALL * INCH, "oz-in-s²|oz in s2"),
)
"""Masses beside a length, read as the forces that they weigh."""
REFUSED = {
    "furlong": "not known", "": "not known", "Motor 1": "not known", "None": "not known", "x": "not known",
    "raw": "not known", "-deg": "not known.*Did you mean", "degg": 'Did you mean "deg"',
    "MV": "not known", "kRPM": "not known", "millimetre": "not known",
    "grad": "degrees in one language.*Write deg or gon", "Grad": "degrees in one language",
    "g": "acceleration of free fall", "gm": "gram here", "mil": "thousandth of an inch",
    "Apk": "peak value.*scale", "A peak": "peak value", "Vpp": "peak value", "p.u.": "not known", "pu": "share of",
    "10 V": "without a number", "1000 rpm": "without a number", "24V": "not known", "0 V": "not known",
    "Nm/rad/s": "Write brackets", "N m/rad s": "Write brackets", "N m/(rad": "Close each bracket", "N)m": "Close each",
    "N m^": "not known", "s^99": "not known", "m9999999": "not known", "/": "not known", "()": "not known",
    "N" * 50: "not known", "((((((((m": "Close each|not known",
}  # fmt: skip


def _each(lines: tuple[tuple[str, float, str], ...]) -> list[tuple[str, str, float]]:
    return [(text, si, factor) for si, factor, texts in lines for text in texts.split("|")]


def test_a_hundred_and_fifty_spellings_and_more() -> None:
    """Every text is what the table says, to the last digits."""
    read_as = _each(SPELLINGS)
    assert len(read_as) >= 150
    wrong = {}
    for text, si, factor in read_as:
        unit = read(text)
        if unit.si != si or not math.isclose(unit.scale, factor, rel_tol=1e-14) or unit.zero:
            wrong[text] = unit
    assert wrong == {}


def test_nothing_plain_has_a_remark() -> None:
    remarks = {t: read(t).remark for t, *_ in _each(SPELLINGS) if read(t).remark}
    assert set(remarks) == {"0.1 %", "0.1%"}


@pytest.mark.parametrize(("si", "factor", "texts"), FORCES)
def test_pounds_and_ounces_beside_a_length_are_forces_and_it_is_said(
    si: str, factor: float, texts: str
) -> None:
    for text in texts.split("|"):
        unit = read(text, (si,))
        assert (unit.si, unit.scale) == (si, pytest.approx(factor, rel=1e-14)), text
        assert f"a mass where {si} is asked for" in unit.remark
        assert read(text).si == si


def test_a_mass_where_a_mass_is_asked_for_stays_one() -> None:
    unit = read("lb in2", ("kg m2",))
    assert unit.remark == ""
    assert unit.scale == pytest.approx(POUND * INCH**2)
    assert read("lb", ("N",)).remark
    assert read("lb").si == "kg"


@pytest.mark.parametrize(("text", "words"), REFUSED.items())
def test_what_is_refused_and_why(text: str, words: str) -> None:
    with pytest.raises(ParameterError, match=words) as caught:
        read(text, ("N m",), "torque")
    assert caught.value.where == "torque"
    assert repr(text) in str(caught.value)
    assert "N m, mN m, uN m" in caught.value.limit


def test_another_dimension_is_refused_with_what_would_be_understood() -> None:
    for text, si in (
        ("deg", "N m"),
        ("J", "N m"),
        ("W s", "N m"),
        ("N m", "J"),
        ("1/s", "rad/s"),
        ("nm", "N m"),
    ):
        with pytest.raises(ParameterError, match=f"torque: has a unit of another dimension.*{si}"):
            fitting(text, si, "torque")
    assert scale_in("deg", "N m") is None
    assert scale_in("furlong", "m") is None
    assert scale_in("K", "degC") is None


def test_zeros_of_temperatures() -> None:
    kelvin, fahrenheit = read("K"), read("degF")
    assert (kelvin.si, kelvin.scale, kelvin.zero) == ("degC", 1.0, -273.15)
    assert 212.0 * fahrenheit.scale + fahrenheit.zero == pytest.approx(100.0)
    assert read("0.1 K").zero == -273.15


def test_common_units_and_si_units_are_read_as_they_are_written() -> None:
    assert [read(text).symbol for text in COMMON] == list(COMMON)
    assert [(read(si).si, read(si).factor) for si in SI if si != "kg"] == [
        (si, 1) for si in SI if si != "kg"
    ]
    assert set(understood(("rad",))) == {"rad", "mrad", "urad", "deg", "arcmin", "arcsec", "rev"}


def test_every_word_is_in_si_by_every_spelling() -> None:
    spellings = [t for w in WORDS for t in (w.symbol, *w.spellings.split())]
    assert len(spellings) == len(set(spellings))
    for word in WORDS:
        for text in (word.symbol, *word.spellings.split()):
            if text not in ("g", "rms", "eff"):
                assert read(text).si == word.si, text


def test_rational_factors_are_exact() -> None:
    assert read("kg cm2").factor == Fraction(1, 10**4)
    assert read("lbf in").factor == Fraction(45359237, 10**8) * Fraction(980665, 10**5) * Fraction(
        254, 10**4
    )
    # 63.5 mm is 0.0635 m, not 0.06350000000000001.
    assert to_si(63.5, "mm", "m", "length") == 0.0635


def test_the_readout_means_the_same_by_its_unit_characters() -> None:
    """Drivers stand beside the model and read bytes of a device; both say the same of a millimetre."""
    texts = {
        " ": "mm",
        '"': "in",
        "G": "deg",
        "M": "deg",
        "R": "rad",
        "m": "mm/min",
        "i": "in/min",
        "U": "r/min",
    }
    assert {key: (read(text).si, read(text).scale) for key, text in texts.items()} == ND287


def test_units_as_they_are_printed() -> None:
    assert [printed(u) for u in ("degC", "deg", "deg/s", "um", "kg m2", "N m/rad")] == [
        "°C", "°", "°/s", "µm", "kg m²", "N m/rad",
    ]  # fmt: skip
    assert by_size("N m", 0.1) == "mN m"
    assert by_size("N m", 2.0) == "N m"
