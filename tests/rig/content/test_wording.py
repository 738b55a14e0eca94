"""Numbers as people read them: rounded by their uncertainty, in the unit of the laboratory."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments import catalogue
from experiments.errors import AnalysisError
from experiments.quantity import Quantity, bare_quantity, quantity_of
from model.identify.estimate import NORMAL_COVERAGE_FACTOR, BudgetLine, Estimate
from model.units import ARCMIN, DEGREE, printed
from rig.content.wording import fixed, metric_text, number, printable, readable, show


def estimate(name: str, value: float, unit: str, u: float) -> Estimate:
    """An estimate with U = 2 u."""
    return Estimate(
        name=name,
        value=value,
        unit=unit,
        low=value - 2 * u,
        high=value + 2 * u,
        budget=(BudgetLine("a", "A", 2 * u / NORMAL_COVERAGE_FACTOR),),
    )


def declared(name: str, unit: str = "") -> Quantity:
    """What any protocol declares of this name; a bare quantity of a name that none does."""
    quantities = (q for kind in catalogue.kinds() for q in catalogue.load(kind).quantities)
    return quantity_of(quantities, name) or bare_quantity(name, unit)


@pytest.mark.parametrize(
    ("made", "text"),
    [
        (estimate("F_c", 70.31, "N", 0.9), "70.3 ± 1.8 N"),
        (estimate("running_torque", 0.08734, "N m", 0.0005), "87.3 ± 1.0 mN m"),
        (
            estimate("transmission_accuracy", 0.84 * ARCMIN, "rad", 0.01 * ARCMIN),
            "0.840 ± 0.020 arcmin",
        ),
        (estimate("phase_2", 30 * DEGREE, "rad", 0.5 * DEGREE), "30.0 ± 1.0 °"),
        (estimate("amplitude_2", 1e-4, "rad", 1e-6), "20.63 ± 0.41 arcsec"),
        (estimate("K_over_J", 463_200.0, "rad2/s2", 1230.0), "463\u202f200 ± 2\u202f460 rad²/s²"),
        (estimate("K_b", 1.08e8, "N/m", 1e6), "108.0 ± 2.0 × 10⁶ N/m"),
        (estimate("inertia", 2.5e-5, "kg m2", 1e-7), "0.2500 ± 0.0020 kg cm²"),
        (Estimate(name="exact", value=3.0, unit="N", low=3.0, high=3.0), "3 N"),
        (estimate("shape", -0.5, "1", 0.25), "−0.50 ± 0.50"),
    ],
)
def test_an_estimate_is_rounded_by_its_uncertainty(made: Estimate, text: str) -> None:
    assert show(made, declared(made.name, made.unit)).with_uncertainty == text


@given(
    st.floats(1e-12, 1e12),
    st.floats(1e-12, 1e12),
    st.sampled_from(["N", "rad", "N m", "m", "1", "kg m2", "rad/s"]),
)
def test_any_estimate_reads_back_to_itself(value: float, u: float, unit: str) -> None:
    shown = show(estimate("speed", value, unit, u), bare_quantity("speed", unit))
    back = float(shown.value.replace("\u202f", "").replace("−", "-")) * shown.scale
    step = float(shown.expanded.replace("\u202f", "")) * shown.scale if shown.expanded else 0.0
    assert math.isclose(back, value, rel_tol=2e-3, abs_tol=0.06 * max(step, 2 * u))


@given(st.floats(allow_nan=True, allow_infinity=True))
def test_any_number_has_a_text(value: float) -> None:
    assert number(value)
    assert fixed(value, 3)


def test_words_and_truths_stay_words() -> None:
    assert [number(v) for v in ("up", True, 12, 0.0, 1e-7, -1234.5)] == [
        "up",
        "True",
        "12",
        "0",
        "1 × 10⁻⁷",
        "−1\u202f234",
    ]


def test_symbols_of_the_paper_stay_symbols() -> None:
    assert [readable(n) for n in ("F_c", "K_HDf", "torque_balance")] == [
        "F_c",
        "K_HDf",
        "torque balance",
    ]


def test_an_estimate_is_called_what_its_protocol_calls_it() -> None:
    names = ("amplitude_2-1/N", "phase_2", "running_torque_2000_rpm", "stribeck_velocity")
    assert [declared(name).titled(name) for name in names] == [
        "order 2-1/N, amplitude",
        "order 2, phase",
        "running torque 2000 r/min",
        "Stribeck velocity",
    ]


def test_no_unit_is_guessed_from_a_name() -> None:
    """A newcomer's backlash is no arcminute unless it says so, and its static no friction."""
    play = estimate("backlash", 1e-4, "rad", 1e-6)
    assert show(play, bare_quantity("backlash", "rad")).with_uncertainty == "20.63 ± 0.41 arcsec"
    arcminutes = Quantity(name="backlash", title="backlash", unit="rad", shown="arcmin")
    assert show(play, arcminutes).with_uncertainty == "0.3438 ± 0.0069 arcmin"
    assert bare_quantity("static", "rad").title == "static"


def test_on_a_circle_nothing_is_further_away_than_half_a_turn() -> None:
    phase = Quantity(name="p", title="", unit="rad", shown="°", is_circular=True)
    wide = show(estimate("p", -67.0 * DEGREE, "rad", 102.0 * DEGREE), phase)
    assert wide.with_uncertainty == "−67 ± 180 °"
    assert (wide.low, wide.high) == ("−247", "113")
    narrow = show(estimate("p", -67.0 * DEGREE, "rad", 6.0 * DEGREE), phase)
    assert narrow.with_uncertainty == "−67 ± 12 °"


def test_a_unit_of_something_else_is_refused_when_it_is_declared() -> None:
    with pytest.raises(AnalysisError, match=r"cannot be shown.*'arcmin'"):
        Quantity(name="x", title="x", unit="N m", shown="arcmin")


def test_units_are_printed_with_powers() -> None:
    assert [printed(u) for u in ("mm2/s", "kg/m3", "kg m2", "1/s2", "m")] == [
        "mm²/s",
        "kg/m³",
        "kg m²",
        "1/s²",
        "m",
    ]


@pytest.mark.parametrize(
    ("kind", "name", "value", "text"),
    [
        ("kinematic-error", "mse_curve_forward", 0.71, "0.71"),
        ("kinematic-error", "raw_peak_to_peak_forward", 1.13 * ARCMIN, "1.13 arcmin"),
        ("motor-tare", "torque_zero_drift", 0.0021, "2.1 mN m"),
        ("starting-torque", "largest_starting_torque", 0.0766, "76.6 mN m"),
        ("friction", "viscous_friction_per_kelvin", -0.0185, "−0.0185 1/K"),
    ],
)
def test_figures_of_merit_have_their_unit(kind: str, name: str, value: float, text: str) -> None:
    quantity = quantity_of(catalogue.load(kind).quantities, name)
    assert quantity is not None
    assert metric_text(quantity, value) == text


@given(st.text())
def test_nothing_unprintable_is_left(text: str) -> None:
    assert all(c >= " " and not 0x7F <= ord(c) < 0xA0 for c in printable(text))
