"""The acts of `acts_study`: a hundred and twenty that the data can tell, and those that they cannot, with the reason.

Both lists stand before anything is looked at. What cannot be told is run as well, and counted apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from model.units import ARCSEC
from tests.adversarial import acts
from tests.adversarial import acts_of_size as sized
from tests.adversarial.acts_of_size import Act

BOTH_THERMOMETERS = ("housing_temperature", "ambient_temperature")


@dataclass(frozen=True)
class Listed:
    """An act on a recording of a kind. `unseen` says for physical reasons why no recording of this rig can show it."""

    kind: str
    act: Act
    unseen: str = ""
    called: str = ""

    @property
    def name(self) -> str:
        """Kind and act, which no two acts share."""
        return f"{self.kind}: {self.called or self.act.__name__}"


def _zeros_alone(honest: acts.Honest) -> acts.Honest:
    return acts.tare_alone(acts.tare_of_zeros(honest))


_FRICTION: tuple[Act, ...] = (
    # The torque port, alone and together with the drive.
    acts.clipped_and_flagged,
    sized.clipped_at(0.6),
    sized.clipped_on_one_side_at(0.6),
    sized.clipped_in_both_at(0.6),
    acts.reversed_torque,
    acts.rectified,
    acts.millinewtons,
    acts.doubled,
    acts.halved,
    sized.gain_of_the_port(0.9),
    sized.gain_in_both(0.8),
    sized.gain_in_both(1.25),
    acts.half_in_reverse,
    acts.louder_from_the_middle,
    acts.frozen,
    acts.frozen_for_a_while,
    acts.drifting_zero,
    acts.fading,
    sized.torque_spikes,
    sized.dead_band_of_the_port(0.010),
    sized.dead_band_in_both(0.005),
    acts.dead_band_in_both,
    sized.dead_band_in_both(0.020),
    acts.wide_dead_band_in_both,
    acts.coarse_in_both,
    # Angles and time.
    acts.input_four_times,
    acts.input_half,
    acts.input_jumping,
    sized.input_losing_counts(0.005),
    sized.stray_rows_of("input_angle"),
    acts.slow_time,
    acts.fast_time,
    acts.slow_time_and_rate,
    acts.slow_clock,
    sized.slow_axis(1.005),
    acts.rows_missing,
    acts.pause,
    acts.time_going_back,
    # Thermometers.
    sized.warmer(5.0, "housing_temperature"),
    sized.thermometer_standing,
    # The tare.
    acts.tare_of_another_motor,
    acts.tare_of_another_bench,
    acts.tare_of_another_calibration,
    acts.tare_of_last_month,
    acts.tare_warmer,
    acts.tare_much_warmer,
    acts.tare_six_times,
    acts.tare_negative,
    acts.tare_not_its_own,
    acts.tare_more_than_double,
    acts.tare_of_zeros,
    acts.tare_ten_more,
    acts.tare_of_a_cold_motor,
    acts.tare_halved,
    acts.tare_with_a_stray_point,
    acts.tare_alone,
    _zeros_alone,
)
_TARE: tuple[Act, ...] = (
    acts.reversed_torque,
    acts.millinewtons,
    sized.clipped_at(0.6),
    sized.gain_in_both(0.8),
    acts.half_in_reverse,
    acts.frozen,
    acts.drifting_zero,
    sized.torque_spikes,
    acts.dead_band_in_both,
    acts.wide_dead_band_in_both,
    acts.input_half,
)
_KINEMATIC_ERROR: tuple[Act, ...] = (
    sized.ratio_beside(-1),
    sized.ratio_beside(1),
    acts.output_losing_counts,
    acts.output_reversed,
    acts.output_standing,
    acts.output_late,
    sized.output_jumping(300),
    sized.stray_rows_of("output_angle"),
    sized.coarse("output_angle", 16),
    acts.input_four_times,
    acts.input_jumping,
    sized.input_losing_counts(0.005),
    sized.input_losing_counts_one_way(0.001),
    sized.stray_rows_of("input_angle"),
    acts.slow_time,
    sized.slow_axis(1.005),
    acts.time_going_back,
)
_STEPS: tuple[Act, ...] = (
    sized.ratio_beside(-1),
    sized.ratio_beside(1),
    acts.output_reversed,
    acts.output_four_times,
    acts.output_standing,
    acts.output_late,
    sized.stray_rows_of("output_angle"),
    acts.input_jumping,
    sized.input_losing_counts(0.005),
    sized.stray_rows_of("input_angle"),
    acts.at_200_hz,
    acts.at_125_hz,
    acts.slow_time,
    sized.slow_axis(1.005),
    acts.reversed_torque,
    sized.gain_in_both(0.8),
    acts.dead_band_in_both,
)
_STARTING_TORQUE: tuple[Act, ...] = (
    acts.reversed_torque,
    acts.millinewtons,
    sized.clipped_at(0.5),
    sized.gain_in_both(0.8),
    sized.dead_band_in_both(0.005),
    acts.dead_band_in_both,
    acts.wide_dead_band_in_both,
    acts.coarse_in_both,
    sized.torque_spikes,
    acts.input_four_times,
    acts.output_reversed,
    acts.stray_rows_of_the_input,
    sized.warmer(5.0, "housing_temperature"),
)
_WARM_UP: tuple[Act, ...] = (
    acts.reversed_torque,
    acts.doubled,
    sized.dead_band_in_both(0.020),
    sized.torque_spikes,
    sized.warmer(5.0, "housing_temperature"),
)

_ONE_CONSTANT = (
    "Port and drive read one current through one constant. What else knows a torque is the rotor's inertia, by its "
    "card within 10 %, and the motor's friction, by its card within 50 %: a tenth is inside both."
)
_ONE_TEMPERATURE = (
    "Both thermometers lie by the same, and nothing else of the rig knows a temperature; the friction that goes with "
    "it is what is measured."
)
_ONE_ANGLE = (
    "The error turns with the output flange, as the gear's own output orders do: one mounting shows their sum only, "
    "and the certificate that denies it is the only witness."
)
UNSEEN: tuple[Listed, ...] = (
    Listed("friction", sized.gain_in_both(0.9), _ONE_CONSTANT),
    Listed("friction", sized.gain_in_both(1.1), _ONE_CONSTANT),
    Listed("starting-torque", sized.gain_in_both(0.9), _ONE_CONSTANT),
    Listed("friction", sized.warmer(5.0, *BOTH_THERMOMETERS), _ONE_TEMPERATURE),
    Listed("kinematic-error", sized.curved("output_angle", (1,), 30.0 * ARCSEC), _ONE_ANGLE),
    Listed("kinematic-error", sized.curved("output_angle", (2, 3), 15.0 * ARCSEC), _ONE_ANGLE),
    Listed(
        "kinematic-error",
        sized.curved("input_angle", (1, 2), 120.0 * ARCSEC),
        "The motor's encoder turns with the wave generator: its orders and the gear's are one sum.",
    ),
)
"""What is done and cannot be told, and why; counted apart."""


def _listed(kind: str, of: Sequence[Act]) -> tuple[Listed, ...]:
    names = {_zeros_alone: "tare_of_zeros_alone"}
    return tuple(Listed(kind, act, called=names.get(act, "")) for act in of)


SEEN: tuple[Listed, ...] = (
    *_listed("friction", _FRICTION),
    *_listed("motor-tare", _TARE),
    *_listed("kinematic-error", _KINEMATIC_ERROR),
    *_listed("velocity-steps", _STEPS),
    *_listed("starting-torque", _STARTING_TORQUE),
    *_listed("warm-up", _WARM_UP),
)
"""What the data can tell: refused, said, within U, or not called "yes"."""

REFUSED_BY_0_2_0: frozenset[str] = frozenset(
    {
        "friction: clipped_and_flagged",
        "friction: clipped_at_0.6",
        "friction: clipped_in_both_at_0.6",
        "friction: clipped_on_one_side_at_0.6",
        "friction: doubled",
        "friction: drifting_zero",
        "friction: fading",
        "friction: fast_time",
        "friction: frozen",
        "friction: frozen_for_a_while",
        "friction: gain_0.9",
        "friction: half_in_reverse",
        "friction: halved",
        "friction: input_four_times",
        "friction: input_half",
        "friction: input_jumping",
        "friction: input_losing_0.5_percent",
        "friction: louder_from_the_middle",
        "friction: millinewtons",
        "friction: pause",
        "friction: rectified",
        "friction: reversed_torque",
        "friction: rows_missing",
        "friction: slow_clock",
        "friction: slow_time",
        "friction: slow_time_and_rate",
        "friction: stray_rows_of_the_input",
        "friction: tare_much_warmer",
        "friction: tare_negative",
        "friction: tare_of_another_bench",
        "friction: tare_of_another_calibration",
        "friction: tare_of_another_motor",
        "friction: tare_with_a_stray_point",
        "friction: time_going_back",
        "kinematic-error: input_four_times",
        "kinematic-error: input_jumping",
        "kinematic-error: input_losing_0.1_percent_one_way",
        "kinematic-error: input_losing_0.5_percent",
        "kinematic-error: output_jumping_300",
        "kinematic-error: output_losing_counts",
        "kinematic-error: output_reversed",
        "kinematic-error: output_standing",
        "kinematic-error: ratio_beside_+1",
        "kinematic-error: ratio_beside_-1",
        "kinematic-error: slow_time",
        "kinematic-error: stray_rows_of_the_input",
        "kinematic-error: stray_rows_of_the_output",
        "kinematic-error: time_going_back",
        "motor-tare: clipped_at_0.6",
        "motor-tare: drifting_zero",
        "motor-tare: frozen",
        "motor-tare: half_in_reverse",
        "motor-tare: input_half",
        "motor-tare: millinewtons",
        "motor-tare: reversed_torque",
        "starting-torque: clipped_at_0.5",
        "starting-torque: input_four_times",
        "starting-torque: millinewtons",
        "starting-torque: output_reversed",
        "starting-torque: reversed_torque",
        "velocity-steps: input_jumping",
        "velocity-steps: input_losing_0.5_percent",
        "velocity-steps: output_four_times",
        "velocity-steps: output_late",
        "velocity-steps: output_reversed",
        "velocity-steps: output_standing",
        "velocity-steps: ratio_beside_+1",
        "velocity-steps: ratio_beside_-1",
        "velocity-steps: reversed_torque",
        "velocity-steps: slow_time",
        "velocity-steps: stray_rows_of_the_input",
        "velocity-steps: stray_rows_of_the_output",
        "warm-up: doubled",
        "warm-up: reversed_torque",
    }
)
"""Names of the acts that version 0.2.0 (e139ac7) refused on the tuning seeds 100 and 101, in its own runs
of the same gears and benches."""
