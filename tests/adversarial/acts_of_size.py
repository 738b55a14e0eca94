"""Acts that have a size, for gears and benches of any size: what they do is a share of what the recording shows.

Each function of a size makes an act of it: `spikes(1.0)(honest)` is the broken recording.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from tests.adversarial.acts import (
    Honest,
    Stored,
    about,
    in_both,
    longest,
    memory_of,
    shown_by_torque,
    with_arrays,
)

Act = Callable[[Honest], Honest]
STRAY = 1e-3
"""Share of the rows in which a reading is a stray one."""
SEED = 23


def _largest(honest: Honest) -> float:
    """The torque that all but a fiftieth of the rows stay below [N m]."""
    return float(np.quantile(np.abs(honest.recording.si("torque")), 0.98))


def _named(act: Act, name: str) -> Act:
    act.__name__ = name
    return act


# The torque.


def clipped_at(share: float) -> Act:
    """The port is cut off at a share of its largest reading."""

    def act(honest: Honest) -> Honest:
        end = share * _largest(honest)
        return shown_by_torque(honest, lambda torque: np.clip(torque, -end, end))

    return _named(act, f"clipped_at_{share:g}")


def clipped_on_one_side_at(share: float) -> Act:
    def act(honest: Honest) -> Honest:
        end = share * _largest(honest)
        return shown_by_torque(honest, lambda torque: np.minimum(torque, end))

    return _named(act, f"clipped_on_one_side_at_{share:g}")


def clipped_in_both_at(share: float) -> Act:
    """Port and drive are cut off: they share a sensor."""

    def act(honest: Honest) -> Honest:
        end = share * _largest(honest)
        return in_both(honest, lambda torque: np.clip(torque, -end, end))

    return _named(act, f"clipped_in_both_at_{share:g}")


def gain_in_both(gain: float) -> Act:
    """Port and drive show too much or too little by the same factor: one sensor, one wrong constant."""
    return _named(
        lambda honest: in_both(honest, lambda torque: gain * torque), f"gain_in_both_{gain:g}"
    )


def gain_of_the_port(gain: float) -> Act:
    return _named(
        lambda honest: shown_by_torque(honest, lambda torque: gain * torque), f"gain_{gain:g}"
    )


def dead_band_in_both(half_width: float) -> Act:
    """Port and drive read nothing within so many N m, and so much less beyond."""
    return _named(
        lambda honest: in_both(honest, _dead(half_width)),
        f"dead_band_in_both_{1e3 * half_width:g}_mNm",
    )


def dead_band_of_the_port(half_width: float) -> Act:
    return _named(
        lambda honest: shown_by_torque(honest, _dead(half_width)),
        f"dead_band_{1e3 * half_width:g}_mNm",
    )


def _dead(half_width: float) -> Callable[[Stored], Stored]:
    return lambda torque: np.sign(torque) * np.maximum(np.abs(torque) - half_width, 0.0)


def torque_spikes(honest: Honest) -> Honest:
    """Ten times the largest torque, either way, in a thousandth of the rows."""
    random = np.random.default_rng(SEED)
    at = random.random(honest.recording.rows) < STRAY
    size = 10.0 * _largest(honest) * random.choice([-1.0, 1.0], len(at))
    return shown_by_torque(honest, lambda torque: np.where(at, size, torque))


# Angles and time.


def stray_rows_of(name: str, counts: int = 4000) -> Act:
    """So many counts beside the angle in a thousandth of the rows, one row each."""

    def act(honest: Honest) -> Honest:
        random = np.random.default_rng(SEED)
        stored = memory_of(honest.recording).arrays[name].astype(np.int64)
        at = np.flatnonzero(random.random(len(stored)) < STRAY)
        stored[at] += random.choice([-counts, counts], len(at))
        return with_arrays(honest, {name: stored})

    return _named(act, f"stray_rows_of_the_{name.partition('_')[0]}")


def input_losing_counts(share: float) -> Act:
    """The counter of the motor's encoder loses a share of its counts, evenly."""

    def act(honest: Honest) -> Honest:
        stored = memory_of(honest.recording).arrays["input_angle"]
        first = stored[0]
        lost = np.rint(first + (stored - first) * (1.0 - share)).astype(np.int64)
        return with_arrays(honest, {"input_angle": lost})

    return _named(act, f"input_losing_{100.0 * share:g}_percent")


def input_losing_counts_one_way(share: float) -> Act:
    """The same where it turns forward only."""

    def act(honest: Honest) -> Honest:
        stored = memory_of(honest.recording).arrays["input_angle"].astype(np.int64)
        forward = np.cumsum(np.maximum(np.diff(stored, prepend=stored[:1]), 0))
        lost = stored - np.rint(share * forward).astype(np.int64)
        return with_arrays(honest, {"input_angle": lost})

    return _named(act, f"input_losing_{100.0 * share:g}_percent_one_way")


def output_jumping(counts: int) -> Act:
    """So many counts of the output are lost at once, late in the longest segment."""

    def act(honest: Honest) -> Honest:
        segment = longest(honest.recording, "hold", "step", "traverse")
        stored = memory_of(honest.recording).arrays["output_angle"].astype(np.int64)
        stored[segment.stop - (segment.stop - segment.start) // 4 :] += counts
        return with_arrays(honest, {"output_angle": stored})

    return _named(act, f"output_jumping_{counts}")


def coarse(name: str, factor: int) -> Act:
    """The angle comes in steps of so many counts."""

    def act(honest: Honest) -> Honest:
        stored = memory_of(honest.recording).arrays[name]
        steps = (np.rint(stored / factor) * factor).astype(np.int64)
        return with_arrays(honest, {name: steps})

    return _named(act, f"{name}_in_steps_of_{factor}")


def curved(name: str, orders: Sequence[int], amplitude: float) -> Act:
    """The encoder has an error of these orders of its own turn, each of an amplitude [rad], that its class denies."""

    def act(honest: Honest) -> Honest:
        recording = honest.recording
        stored = memory_of(recording).arrays[name]
        angle = recording.si(name)
        error = np.sum([amplitude * np.cos(n * angle + n) for n in orders], axis=0)
        gain = recording.signals[name].gain
        return with_arrays(honest, {name: np.rint(stored + error / gain).astype(np.int64)})

    return _named(act, f"{name}_curved_{'_'.join(map(str, orders))}")


def ratio_beside(more: int) -> Act:
    """The header names a ratio that is so many teeth beside the gear's."""

    def act(honest: Honest) -> Honest:
        return about(honest, ratio=honest.recording.metadata.ratio + more)

    return _named(act, f"ratio_beside_{more:+d}")


def slow_axis(factor: float) -> Act:
    """The device's clock is slow, and the rate that the header names goes with it; the computer's clock is right."""

    def act(honest: Honest) -> Honest:
        times = memory_of(honest.recording).times
        slow = times[0] + ((times - times[0]) * factor).astype(np.int64)
        rate = honest.recording.metadata.sample_rate / factor
        return about(with_arrays(honest, times=slow), sample_rate=rate)

    return _named(act, f"slow_axis_{100.0 * (factor - 1.0):g}_percent")


# The thermometers.


def warmer(kelvin: float, *names: str) -> Act:
    """These thermometers read so much too high."""

    def act(honest: Honest) -> Honest:
        signals = dict(honest.recording.signals)
        for name in names:
            signals[name] = dataclasses.replace(signals[name], offset=signals[name].offset + kelvin)
        changed = dataclasses.replace(honest.recording, signals=signals)
        return dataclasses.replace(honest, recording=changed)

    which = "_and_".join(name.partition("_")[0] for name in names)
    return _named(act, f"{which}_{kelvin:+g}_K")


def thermometer_standing(honest: Honest) -> Honest:
    """The housing's thermometer shows its first value throughout."""
    stored = memory_of(honest.recording).arrays["housing_temperature"].copy()
    stored[:] = stored[0]
    return with_arrays(honest, {"housing_temperature": stored})
