"""What a drive states of itself, judged: believed, or asked for with the word that answers it; never rescaled."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.bus.cia402.config import DriveConfig
from drivers.bus.cia402.plausible import (
    MAXON,
    Question,
    Statement,
    acceleration_unit,
    counts_per_revolution,
    rated_torque,
    velocity_unit,
)
from drivers.errors import DriverError
from tests.drivers.can_bench import servo
from tests.drivers.foreign_bench import LIMITS, bench
from tests.drivers.foreign_slave import Traits

RPM = 2 * math.pi / 60


@pytest.mark.parametrize(
    ("stated", "motor", "words"),
    [
        (Statement(rated_torque=637_000, rated_current=1600, largest_speed=3000), None, "125 kV"),
        (Statement(rated_torque=637_000, rated_current=1600), None, "398 N m/A"),
        (Statement(rated_torque=637_000, largest_speed=3000), None, "200 kW"),
        (Statement(rated_torque=637_000), None, "more than 100 N m"),
        (Statement(rated_torque=228_000, largest_speed=50_000), None, "1.19e+03 kW"),
        (Statement(rated_torque=30_000), 0.03, "the motor that the description names has 0.03 N m"),
        (Statement(rated_torque=1), 0.637, "the motor that the description names has 0.637 N m"),
        (Statement(rated_torque=30_000, vendor_id=MAXON), None, "this maker's drives"),
        (Statement(rated_torque=0), None, "nobody has set it"),
        (Statement(), None, "has no 0x6076"),
    ],
)
def test_a_rated_torque_that_no_motor_has_is_asked_for(
    stated: Statement, motor: float | None, words: str
) -> None:
    asked = rated_torque(stated, motor)
    assert isinstance(asked, Question)
    assert asked.entry == "rated_torque_n_m"
    assert words in str(asked)
    assert "give `rated_torque_n_m`" in str(asked)
    assert ("uN m" in asked.hint) == ((stated.rated_torque or 0) > 1000)


@pytest.mark.parametrize(
    ("stated", "motor", "torque"),
    [
        (Statement(rated_torque=637, rated_current=1600, largest_speed=6000), 0.637, 0.637),
        # A torque motor, a spindle, a limit of speed that nobody has set.
        (Statement(rated_torque=90_000, rated_current=8000, largest_speed=300), None, 90.0),
        (Statement(rated_torque=120_000, rated_current=60_000, largest_speed=6000), None, 120.0),
        (Statement(rated_torque=500_000, rated_current=15_000, largest_speed=100), None, 500.0),
        (Statement(rated_torque=2390, largest_speed=0xFFFF_FFFF), None, 2.39),
        (Statement(rated_torque=1270, largest_speed=50_000), None, 1.27),
    ],
)
def test_a_rated_torque_that_a_motor_can_have_is_believed(
    stated: Statement, motor: float | None, torque: float
) -> None:
    assert rated_torque(stated, motor) == pytest.approx(torque)


@given(st.integers(1, 10_000), st.integers(100, 20_000), st.integers(500, 6000))
def test_a_torque_in_a_thousandth_of_the_unit_is_never_believed(
    torque_mnm: int, current_ma: int, speed: int
) -> None:
    """Motors between 12 and 700 V of counter-voltage, told in uN m."""
    volts = torque_mnm * 1e-3 * speed * RPM / (current_ma * 1e-3)
    stated = Statement(
        rated_torque=1000 * torque_mnm, rated_current=current_ma, largest_speed=speed
    )
    if 12.0 <= volts <= 700.0:
        assert isinstance(rated_torque(stated), Question)


@pytest.mark.parametrize(
    ("stated", "counts"),
    [
        (Statement(encoder=(32768, 1)), 32768.0),
        (Statement(encoder=(1 << 20, 1), feed=(1, 1)), 1048576.0),
        (Statement(feed=(36000, 1), gear=(10, 1), encoder=(32768, 1)), 3600.0),
        (Statement(encoder=(1, 1), gear=(1, 1), feed=(1, 1)), None),
        (Statement(encoder=(1, 1)), None),
        (Statement(feed=(1, 1)), None),
        (Statement(), None),
        (Statement(encoder=(0, 0), feed=(0, 0)), None),
    ],
)
def test_factory_factors_are_no_count_per_revolution(
    stated: Statement, counts: float | None
) -> None:
    found = counts_per_revolution(stated)
    if counts is None:
        assert isinstance(found, Question)
        assert found.entry == "counts_per_revolution"
    else:
        assert found == counts


@pytest.mark.parametrize(
    ("stated", "counts", "words"),
    [
        (Statement(), 8192.0, "neither 0x60A9 nor 0x6094"),
        (Statement(velocity_unit=0x00B50300), 0.0, "0x60A9 says increments"),
        (Statement(velocity_unit=0), 8192.0, "0x60A9 is 0x00000000"),
        (Statement(velocity_factor=(1, 1)), 0.0, "0x6094 is in increments"),
    ],
)
def test_a_unit_of_speed_that_is_not_stated_is_asked_for(
    stated: Statement, counts: float, words: str
) -> None:
    asked = velocity_unit(stated, counts)
    assert isinstance(asked, Question)
    assert asked.entry == "velocity_unit_rad_s"
    assert words in asked.why
    assert velocity_unit(Statement(velocity_factor=(10, 1)), 8192.0) == pytest.approx(
        20 * math.pi / 8192
    )


def test_the_unit_of_ramps_does_not_follow_from_that_of_speeds() -> None:
    asked = acceleration_unit(Statement(velocity_unit=0xFDB44700), 8192.0)
    assert isinstance(asked, Question)
    assert asked.entry == "acceleration_unit_rad_s2"
    assert acceleration_unit(Statement(acceleration_unit=0x00C00300), 0.0) == pytest.approx(RPM)


# On the bus ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("traits", "entry"),
    [
        (Traits(values={(0x6076, 0): 637_000}), "rated_torque_n_m"),
        (Traits(absent=frozenset({0x6076})), "rated_torque_n_m"),
        (Traits(absent=frozenset({0x60A9})), "velocity_unit_rad_s"),
        (Traits(absent=frozenset({0x60AA})), "acceleration_unit_rad_s2"),
    ],
)
def test_a_drive_whose_word_cannot_be_used_is_asked_about_and_not_armed(
    traits: Traits, entry: str
) -> None:
    with bench(traits) as made:
        made.rig.open()
        assert [q.entry for q in servo(made.rig.nodes).readings.questions] == [entry]
        code = entry.removesuffix("_n_m").removesuffix("_rad_s2").removesuffix("_rad_s")
        assert code.replace("_", "-") in {event.code for event in made.events()}
        with pytest.raises(DriverError, match=f"Give `{entry}`"):
            made.rig.write_limits(LIMITS)
        assert not made.drive.is_enabled_ever


def test_what_the_configuration_says_answers_the_question() -> None:
    """A drive that counts in uN m: the limit is written by the nameplate alone, not by a torque a thousand times it."""
    values = {(0x6076, 0): 637_000, (0x608F, 1): 1}
    told = DriveConfig(
        rated_torque=0.637,
        velocity_unit=2 * math.pi / 32768,
        acceleration_unit=2 * math.pi / 32768,
        counts_per_revolution=32768,
    )
    with bench(Traits(values=values, absent=frozenset({0x60A9, 0x60AA})), told) as made:
        made.open()
        assert servo(made.rig.nodes).readings.questions == ()
        assert made.drive.value(0x6072) == 784  # 0.5 N m of 0.637, in thousandths
        (said,) = [event.text for event in made.events() if event.code == "rated-torque"]
        assert "the same in uN m" in said
        assert not {0x60A9, 0x60AA} & {m.index for m in made.rig.missing()[1]}


def test_a_unit_in_the_configuration_that_the_drive_contradicts_is_told() -> None:
    with bench(config=DriveConfig(velocity_unit=0.1 * RPM)) as made:
        made.open()
        (said,) = [event.text for event in made.events() if event.code == "velocity-unit"]
        assert "the configuration holds" in said
        assert servo(made.rig.nodes).readings.velocity_unit == 0.1 * RPM


def test_factory_factors_leave_the_counts_to_the_encoders_description() -> None:
    with bench(Traits(values={(0x608F, 1): 1, (0x6092, 1): 1, (0x6092, 2): 1})) as made:
        made.open()
        readings = servo(made.rig.nodes).readings
        assert readings.counts_per_revolution == 0.0
        assert [q.entry for q in readings.questions] == ["counts_per_revolution"]
        assert not any(event.code == "counts-per-revolution" for event in made.events())
