"""The acts: one thing each that is done to an honest recording, or to the tare that it is analysed with."""

from __future__ import annotations

import dataclasses
import datetime
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.contract import Evidence
from experiments.evidence import SATURATED
from experiments.recording import ArraySource, Recording, Segment
from experiments.result import Result
from experiments.tares.tare import TABLE
from model.identify.estimate import Estimate

Stored = NDArray[Any]
CLIPPED = 0.07
"""N m at which the torque port is cut off: below the friction of the honest gear at speed."""
LINE = ("motor_coulomb", "motor_viscous")
"""The line that a tare's result states of its points."""
MISSING = 1
"""Flag of a cycle that is incomplete."""


class MemorySource(ArraySource):
    """A recording in memory that knows the cycle of each row, as a run file does."""

    def cycles(self, start: int, stop: int) -> NDArray[np.int64]:
        return np.arange(start, min(stop, self.rows))


@dataclass(frozen=True)
class Honest:
    """A recording as it was made, and what it is analysed with."""

    kind: str
    recording: Recording
    evidence: Evidence


def in_memory(recording: Recording) -> Recording:
    """The same recording with its rows in memory, so that they can be changed on a copy."""
    rows = recording.rows
    arrays = {
        name: np.asarray(recording.source.stored(name, 0, rows)) for name in recording.signals
    }
    source = MemorySource(
        arrays, recording.source.time_ns(0, rows), recording.source.flags(0, rows)
    )
    return dataclasses.replace(recording, source=source)


def memory_of(recording: Recording) -> MemorySource:
    assert isinstance(recording.source, MemorySource)
    return recording.source


def with_arrays(
    honest: Honest,
    arrays: Mapping[str, Stored] | None = None,
    *,
    times: Stored | None = None,
    flags: Stored | None = None,
) -> Honest:
    before = memory_of(honest.recording)
    source = MemorySource(
        {**before.arrays, **(arrays or {})},
        before.times if times is None else times,
        before.cycle_flags if flags is None else flags,
    )
    return dataclasses.replace(
        honest, recording=dataclasses.replace(honest.recording, source=source)
    )


def shown_by_torque(honest: Honest, change: Callable[[Stored], Stored]) -> Honest:
    """The torque port reads something else [N m]."""
    signal = honest.recording.signals["torque"]
    torque = change(honest.recording.si("torque"))
    return with_arrays(
        honest, {"torque": np.rint((torque - signal.offset) / signal.gain).astype(int)}
    )


def _counts(honest: Honest, name: str, factor: float) -> Honest:
    counts = memory_of(honest.recording).arrays[name]
    return with_arrays(honest, {name: np.rint(counts * factor).astype(np.int64)})


def about(honest: Honest, **changes: Any) -> Honest:
    metadata = dataclasses.replace(honest.recording.metadata, **changes)
    return dataclasses.replace(
        honest, recording=dataclasses.replace(honest.recording, metadata=metadata)
    )


def longest(recording: Recording, *labels: str) -> Segment:
    return max(recording.labelled(*labels), key=lambda s: s.stop - s.start)


# The torque.


def clipped_and_flagged(honest: Honest) -> Honest:
    ends = np.abs(honest.recording.si("torque")) >= CLIPPED
    flags = honest.recording.flags() | np.where(ends, SATURATED, 0).astype(np.uint16)
    return with_arrays(clipped(honest), flags=flags)


def clipped(honest: Honest) -> Honest:
    return shown_by_torque(honest, lambda torque: np.clip(torque, -CLIPPED, CLIPPED))


def clipped_on_one_side(honest: Honest) -> Honest:
    return shown_by_torque(honest, lambda torque: np.minimum(torque, CLIPPED))


def clipped_low(honest: Honest) -> Honest:
    return shown_by_torque(honest, lambda torque: np.clip(torque, -0.02, 0.02))


def reversed_torque(honest: Honest) -> Honest:
    return shown_by_torque(honest, np.negative)


def rectified(honest: Honest) -> Honest:
    return shown_by_torque(honest, np.abs)


def millinewtons(honest: Honest) -> Honest:
    return shown_by_torque(honest, lambda torque: 1000.0 * torque)


def in_both(honest: Honest, change: Callable[[Stored], Stored]) -> Honest:
    """Port and drive read something else [N m]: they share the motor's current sensor and its torque constant."""
    changed = {}
    for name in ("torque", "drive_torque"):
        signal = honest.recording.signals[name]
        torque = change(honest.recording.si(name))
        changed[name] = np.rint((torque - signal.offset) / signal.gain).astype(int)
    return with_arrays(honest, changed)


def _dead(half_width: float) -> Callable[[Stored], Stored]:
    return lambda torque: np.sign(torque) * np.maximum(np.abs(torque) - half_width, 0.0)


def wide_dead_band_in_both(honest: Honest) -> Honest:
    return in_both(honest, _dead(0.03))


def dead_band_in_both(honest: Honest) -> Honest:
    return in_both(honest, _dead(0.01))


def clipped_in_both(honest: Honest) -> Honest:
    return in_both(honest, lambda torque: np.clip(torque, -CLIPPED, CLIPPED))


def coarse_in_both(honest: Honest) -> Honest:
    """Steps of 20 mN m."""
    return in_both(honest, lambda torque: np.rint(torque / 0.02) * 0.02)


def with_a_torque_cell(honest: Honest, sensor: str = "torque cell 7") -> Honest:
    """The port is that of a sensor of its own; "" is one that nobody named."""
    port = honest.recording.signals["torque"]
    calibration = dataclasses.replace(port.calibration, sensor=sensor)
    signals = {
        **honest.recording.signals,
        "torque": dataclasses.replace(port, calibration=calibration),
    }
    return dataclasses.replace(
        honest, recording=dataclasses.replace(honest.recording, signals=signals)
    )


def stray_rows_of_the_input(honest: Honest) -> Honest:
    """Thousands of counts beside the angle in a thousandth of the rows, one row each."""
    random = np.random.default_rng(23)
    counts = memory_of(honest.recording).arrays["input_angle"].astype(np.int64)
    at = np.flatnonzero(random.random(len(counts)) < 1e-3)
    counts[at] += random.choice([-4000, 4000], len(at))
    return with_arrays(honest, {"input_angle": counts})


def doubled(honest: Honest) -> Honest:
    return shown_by_torque(honest, lambda torque: 2.0 * torque)


def halved(honest: Honest) -> Honest:
    return shown_by_torque(honest, lambda torque: 0.5 * torque)


def frozen(honest: Honest) -> Honest:
    """The port stands still from the middle of the longest segment on."""

    def change(torque: Stored) -> Stored:
        hold = longest(honest.recording, "hold", "traverse")
        middle = (hold.start + hold.stop) // 2
        return np.where(np.arange(len(torque)) < middle, torque, torque[middle])

    return shown_by_torque(honest, change)


def frozen_for_a_while(honest: Honest) -> Honest:
    """The port is not renewed for a fifth of a second."""
    hold = longest(honest.recording, "hold", "traverse")
    torque = memory_of(honest.recording).arrays["torque"].copy()
    middle = (hold.start + hold.stop) // 2
    torque[middle : middle + 200] = torque[middle]
    return with_arrays(honest, {"torque": torque})


def half_in_reverse(honest: Honest) -> Honest:
    return shown_by_torque(honest, lambda torque: np.where(torque > 0.0, torque, 0.5 * torque))


def louder_from_the_middle(honest: Honest) -> Honest:
    def change(torque: Stored) -> Stored:
        return np.where(np.arange(len(torque)) < len(torque) // 2, torque, 1.2 * torque)

    return shown_by_torque(honest, change)


def drifting_zero(honest: Honest) -> Honest:
    return shown_by_torque(honest, lambda torque: torque + np.linspace(0.0, 0.04, len(torque)))


def fading(honest: Honest) -> Honest:
    return shown_by_torque(honest, lambda torque: torque * np.linspace(1.3, 0.7, len(torque)))


# Angles, ratio and time.


def input_four_times(honest: Honest) -> Honest:
    return _counts(honest, "input_angle", 4.0)


def input_half(honest: Honest) -> Honest:
    return _counts(honest, "input_angle", 0.5)


def output_four_times(honest: Honest) -> Honest:
    return _counts(honest, "output_angle", 4.0)


def output_losing_counts(honest: Honest) -> Honest:
    return _counts(honest, "output_angle", 0.995)


def output_reversed(honest: Honest) -> Honest:
    return _counts(honest, "output_angle", -1.0)


def output_standing(honest: Honest) -> Honest:
    """The output angle is not renewed for a fifth of a second, and then goes on from where it should be."""
    segment = longest(honest.recording, "step", "traverse")
    counts = memory_of(honest.recording).arrays["output_angle"].copy()
    middle = segment.stop - (segment.stop - segment.start) // 4
    counts[middle : middle + 200] = counts[middle]
    return with_arrays(honest, {"output_angle": counts})


def input_jumping(honest: Honest) -> Honest:
    """A hundred counts are lost at once in the middle of a segment."""
    segment = longest(honest.recording, "hold", "step", "traverse")
    counts = memory_of(honest.recording).arrays["input_angle"].copy()
    counts[segment.stop - (segment.stop - segment.start) // 4 :] += 100
    return with_arrays(honest, {"input_angle": counts})


def ratio_119(honest: Honest) -> Honest:
    return about(honest, ratio=119.0)


def ratio_121(honest: Honest) -> Honest:
    return about(honest, ratio=121.0)


def output_late(honest: Honest) -> Honest:
    counts = memory_of(honest.recording).arrays["output_angle"]
    late = np.concatenate([np.repeat(counts[:1], 2), counts[:-2]])
    return with_arrays(honest, {"output_angle": late})


def slow_time(honest: Honest) -> Honest:
    return with_arrays(honest, times=_stretched(honest, 1.1))


def fast_time(honest: Honest) -> Honest:
    return with_arrays(honest, times=_stretched(honest, 0.9))


def slow_time_and_rate(honest: Honest) -> Honest:
    """The nominal rate and the computer's clock follow the device's time."""
    metadata = honest.recording.metadata
    start = datetime.datetime.fromisoformat(metadata.start_time)
    end = datetime.datetime.fromisoformat(metadata.end_time)
    return about(
        slow_time(honest),
        sample_rate=metadata.sample_rate / 1.1,
        end_time=(start + 1.1 * (end - start)).isoformat(),
    )


def slow_clock(honest: Honest) -> Honest:
    """The rate follows the device's time, the computer's clock does not, and no set-point was written."""
    recording = slow_time(honest).recording
    bare = tuple(dataclasses.replace(s, setpoint=0.0) for s in recording.segments)
    slow = dataclasses.replace(honest, recording=dataclasses.replace(recording, segments=bare))
    return about(slow, sample_rate=recording.metadata.sample_rate / 1.1)


def _stretched(honest: Honest, factor: float) -> Stored:
    times = memory_of(honest.recording).times
    return times[0] + ((times - times[0]) * factor).astype(np.int64)


def decimated(honest: Honest, every: int) -> Honest:
    """Only every so many rows were recorded."""
    recording, before = honest.recording, memory_of(honest.recording)
    flags = honest.recording.flags()[::every]
    source = MemorySource(
        {name: values[::every] for name, values in before.arrays.items()},
        before.times[::every],
        flags,
    )
    segments = tuple(
        dataclasses.replace(s, start=s.start // every, stop=s.stop // every)
        for s in recording.segments
    )
    thinned = dataclasses.replace(recording, source=source, segments=segments)
    return about(
        dataclasses.replace(honest, recording=thinned),
        sample_rate=recording.metadata.sample_rate / every,
    )


def at_200_hz(honest: Honest) -> Honest:
    return decimated(honest, 5)


def at_125_hz(honest: Honest) -> Honest:
    return decimated(honest, 8)


def rows_missing(honest: Honest) -> Honest:
    """A twentieth of one segment is incomplete: far below the share that is allowed of a run."""
    segment = longest(honest.recording, "hold", "step", "traverse")
    flags = honest.recording.flags().copy()
    flags[segment.start : segment.start + (segment.stop - segment.start) // 20] |= MISSING
    evidence = dataclasses.replace(honest.evidence, maximum_missed_share=0.04)
    return dataclasses.replace(with_arrays(honest, flags=flags), evidence=evidence)


def pause(honest: Honest) -> Honest:
    """The clock goes on for three seconds in the middle of a segment, and no row was written."""
    segment = longest(honest.recording, "hold", "step", "traverse")
    times = memory_of(honest.recording).times.copy()
    times[(segment.start + segment.stop) // 2 :] += 3_000_000_000
    return with_arrays(honest, times=times)


def time_going_back(honest: Honest) -> Honest:
    """Two rows of a segment have changed places."""
    segment = longest(honest.recording, "hold", "step", "traverse")
    times = memory_of(honest.recording).times.copy()
    middle = (segment.start + segment.stop) // 2
    times[[middle, middle + 1]] = times[[middle + 1, middle]]
    return with_arrays(honest, times=times)


def stopped(honest: Honest) -> Honest:
    return about(honest, outcome="ABORTED")


def by_the_drives_ramps(honest: Honest) -> Honest:
    """The drive had no cyclic speed mode."""
    return about(
        honest, process={**honest.recording.metadata.process, "speed_mode": "profile velocity"}
    )


# The tare.


def _tare_run(honest: Honest, **changes: Any) -> Honest:
    run = honest.evidence.tare_recording
    assert run is not None
    changed = dataclasses.replace(run, metadata=dataclasses.replace(run.metadata, **changes))
    evidence = dataclasses.replace(honest.evidence, tare_recording=changed)
    return dataclasses.replace(honest, evidence=evidence)


def _process(honest: Honest, **changes: Any) -> Honest:
    run = honest.evidence.tare_recording
    assert run is not None
    return _tare_run(honest, process={**run.metadata.process, **changes})


def tare_of_another_motor(honest: Honest) -> Honest:
    return _process(honest, motor="SGMJV-04")


def tare_of_another_bench(honest: Honest) -> Honest:
    return _process(honest, bench="another")


def tare_of_another_calibration(honest: Honest) -> Honest:
    run = honest.evidence.tare_recording
    assert run is not None
    torque = dataclasses.replace(run.signals["torque"], scale=run.signals["torque"].scale * 1.1)
    other = dataclasses.replace(run, signals={**run.signals, "torque": torque})
    evidence = dataclasses.replace(honest.evidence, tare_recording=other)
    return dataclasses.replace(honest, evidence=evidence)


def tare_of_last_month(honest: Honest) -> Honest:
    made = datetime.datetime.fromisoformat(honest.recording.metadata.start_time)
    return _tare_run(honest, start_time=(made - datetime.timedelta(days=30)).isoformat())


def _tare_warmer(honest: Honest, kelvin: float) -> Honest:
    run = honest.evidence.tare_recording
    assert run is not None
    room = run.signals["ambient_temperature"]
    warmer = dataclasses.replace(room, offset=room.offset + kelvin)
    other = dataclasses.replace(run, signals={**run.signals, "ambient_temperature": warmer})
    evidence = dataclasses.replace(honest.evidence, tare_recording=other)
    return dataclasses.replace(honest, evidence=evidence)


def tare_warmer(honest: Honest) -> Honest:
    return _tare_warmer(honest, 8.0)


def tare_much_warmer(honest: Honest) -> Honest:
    return _tare_warmer(honest, 20.0)


def tare_reading(result: Result, factor: float, offset: float = 0.0) -> Result:
    """A tare of a motor whose friction was another one: `factor` times as large, and `offset` [N m] more."""

    def changed(name: str, estimate: Estimate) -> Estimate:
        more = offset if name == "motor_coulomb" else 0.0
        value, low, high = (
            factor * v + more for v in (estimate.value, estimate.low, estimate.high)
        )
        return dataclasses.replace(estimate, value=value, low=low, high=high)

    tables = tuple(
        dataclasses.replace(t, rows=tuple((v, factor * float(f) + offset, u) for v, f, u in t.rows))
        if t.name == TABLE
        else t
        for t in result.tables
    )
    estimates = {n: changed(n, e) if n in LINE else e for n, e in result.estimates.items()}
    return dataclasses.replace(result, tables=tables, estimates=estimates)


def _tare_times(honest: Honest, factor: float, offset: float = 0.0) -> Honest:
    tare = honest.evidence.tare
    assert tare is not None
    changed = tare_reading(tare, factor, offset)
    return dataclasses.replace(honest, evidence=dataclasses.replace(honest.evidence, tare=changed))


def tare_six_times(honest: Honest) -> Honest:
    return _tare_times(honest, 6.0)


def tare_negative(honest: Honest) -> Honest:
    return _tare_times(honest, -1.0)


def tare_ten_more(honest: Honest) -> Honest:
    """The coupling rubbed: 10 mN m at every speed."""
    return _tare_times(honest, 1.0, 0.010)


def tare_of_a_cold_motor(honest: Honest) -> Honest:
    return _tare_times(honest, 1.4)


def tare_more_than_double(honest: Honest) -> Honest:
    return _tare_times(honest, 2.2)


def tare_halved(honest: Honest) -> Honest:
    return _tare_times(honest, 0.5)


def tare_of_zeros(honest: Honest) -> Honest:
    return _tare_times(honest, 0.0)


def tare_not_its_own(honest: Honest) -> Honest:
    """Somebody changed the table, and not what the result states."""
    tare = honest.evidence.tare
    assert tare is not None
    changed = dataclasses.replace(tare_reading(tare, 1.4), estimates=tare.estimates)
    return dataclasses.replace(honest, evidence=dataclasses.replace(honest.evidence, tare=changed))


def tare_with_a_stray_point(honest: Honest) -> Honest:
    """The motor stuck at one speed."""
    tare = honest.evidence.tare
    assert tare is not None

    def bent(rows: tuple[tuple[float | int | str, ...], ...]) -> Any:
        middle = len(rows) // 2
        return tuple(
            (v, float(f) * (1.3 if k == middle else 1.0), u) for k, (v, f, u) in enumerate(rows)
        )

    tables = tuple(
        dataclasses.replace(t, rows=bent(t.rows)) if t.name == TABLE else t for t in tare.tables
    )
    evidence = dataclasses.replace(honest.evidence, tare=dataclasses.replace(tare, tables=tables))
    return dataclasses.replace(honest, evidence=evidence)


def tare_alone(honest: Honest) -> Honest:
    """The bench's other tares are not at hand."""
    return dataclasses.replace(
        honest, evidence=dataclasses.replace(honest.evidence, other_tares=())
    )
