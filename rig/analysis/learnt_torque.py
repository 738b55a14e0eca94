"""The torque scale of a bench, learnt from runs of its bare motor with at least two known inertias, as a sealed file.

Of each channel what the runs show over the inertia is its gain, with the rotor's own inertia as the other unknown
(`model.identify.ramp_inertia`). What becomes of the file stands in `learnt`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path

from experiments.assumed import DISC, TIME_BASE
from experiments.protocols.torque_scale.analysis import EDGE, LEVELS
from experiments.protocols.torque_scale.disc import Disc, disc_of
from experiments.recording import RunMetadata
from experiments.result import Result
from experiments.tares.motor_heat import MAGNETS, WARMER, WARMTH
from experiments.torque.ripple import LAG
from model.channel import Channel
from model.errors import IdentificationError
from model.identify.estimate import NORMAL_COVERAGE_FACTOR, BudgetLine, Estimate
from model.identify.ramp_inertia import Gain, ShownInertia, gain_of
from rig.analysis.in_force import in_force
from rig.analysis.learnt import SCALE_KIND, bench_of, motor_of
from rig.analysis.number_or_none import finite
from rig.bench.config.torque_scale_file import (
    FORMAT,
    ChannelScale,
    ScaleLine,
    TorqueScale,
    torque_scale_text,
)
from rig.errors import ConfigurationError, misstated
from rig.runfile.read import close_recording, open_run
from rig.runfile.seal import sealed_sha256
from rig.runfile.sealed import write_new_sealed

_QUARTZ = 1e-4
"""Relative standard uncertainty of a second that a quartz tells, assumed."""
_STEPS = 5e-4
"""The same of what steps of the set-point leave of a torque that is sampled once in each, assumed: where the drive's
gains are the same in all runs it does not depend on the inertia."""
_BELIEVABLE = (0.5, 2.0)
"""Gains of a torque channel beyond which it is the disc that is wrong."""


@dataclass(frozen=True, kw_only=True)
class _TorqueRun:
    """What one run says of the torque channels of its bench. `skipped` says why it says nothing."""

    run: Path
    metadata: RunMetadata | None = None
    channels: Mapping[str, Channel] | None = None
    disc: Disc | None = None
    result: Result | None = None
    sha256: str = ""
    skipped: str = ""

    @property
    def bench(self) -> tuple[str, str, str]:
        """Origin, bench and motor."""
        assert self.metadata is not None
        return self.metadata.origin, bench_of(self.metadata), motor_of(self.metadata)


@dataclass(frozen=True, kw_only=True)
class LearntScale:
    """The gains of a bench's torque channels as estimates, with the runs that taught them."""

    origin: str
    bench: str
    motor: str
    temperature: float
    rotor_inertia: float
    gains: Mapping[str, Estimate]
    lags: Mapping[str, tuple[float, float]]
    channels: Mapping[str, Channel]
    discs: tuple[str, ...]
    taught: tuple[_TorqueRun, ...]
    skipped: tuple[_TorqueRun, ...]

    def content(self, today: date, due: date | None) -> bytes:
        """The bytes of its file."""
        scale = TorqueScale(
            format=FORMAT,
            bench=self.bench,
            origin=self.origin,
            motor=self.motor,
            certificate=f"none: learnt on this bench from {'; '.join(self.discs)}, not traceable",
            date=today,
            due=due,
            housing_temperature=finite(self.temperature),
            rotor_inertia=self.rotor_inertia,
            runs=tuple(f"{one.run.name} {one.sha256}" for one in self.taught),
            channel=tuple(self._channel(name) for name in self.gains),
        )
        return torque_scale_text(scale).encode()

    def _channel(self, name: str) -> ChannelScale:
        gain, channel = self.gains[name], self.channels[name]
        lag, error = self.lags.get(name, (None, None))

        return ChannelScale(
            name="torque" if name == "torque" else "drive_torque",
            model=channel.model,
            serial_number=channel.serial_number,
            sensor=channel.calibration.sensor,
            gain=gain.value,
            relative_uncertainty=gain.expanded_uncertainty / NORMAL_COVERAGE_FACTOR / gain.value,
            coverage_factor=gain.coverage_factor,
            lag=lag,
            lag_uncertainty=error,
            line=tuple(
                ScaleLine(
                    source=line.source,
                    kind=line.kind,
                    relative_uncertainty=line.standard_uncertainty / gain.value,
                    degrees_of_freedom=finite(line.degrees_of_freedom),
                    note=line.note,
                )
                for line in gain.budget
            ),
        )


def learn_torque(runs: Iterable[Path], bench: str = "") -> LearntScale:
    """The torque scale of a bench by these runs. Raises `ConfigurationError` where they do not tell it."""
    seen = [_torque_run(run) for run in runs]
    taught = tuple(one for one in seen if not one.skipped and bench in ("", one.bench[1]))
    origin, name, motor = _one_bench(taught, seen)
    temperature, apart = _temperature(taught)
    gains: dict[str, Estimate] = {}
    lags: dict[str, tuple[float, float]] = {}
    rotors: dict[str, float] = {}
    for channel in _common_channels(taught):
        gain = _gain(taught, channel)
        _refuse_unbelievable(channel, gain)
        lag = _lag(taught, channel)
        gains[channel] = _estimate(channel, gain, taught, apart, lag)
        rotors[channel] = gain.rotor_inertia
        if lag is not None:
            lags[channel] = lag
    return LearntScale(
        origin=origin,
        bench=name,
        motor=motor,
        temperature=temperature,
        rotor_inertia=rotors.get("torque", math.nan),
        gains=gains,
        lags=lags,
        channels=dict(taught[0].channels or {}),
        discs=tuple(dict.fromkeys(one.disc.words for one in taught if one.disc is not None)),
        taught=taught,
        skipped=tuple(one for one in seen if one.skipped),
    )


def _one_bench(taught: Sequence[_TorqueRun], seen: Sequence[_TorqueRun]) -> tuple[str, str, str]:
    """Origin, bench and motor of the runs that tell something. Raises `ConfigurationError` unless they share them."""
    benches = sorted({one.bench for one in taught})
    if len(benches) == 1:
        return benches[0]
    what, remedy = "hold no run that tells it", "Analyse them first: rig fit RUN."
    if benches:
        what, remedy = "are runs of several benches or motors", "Name the bench: --bench ID."
    told = "; ".join(f"bench {b}, motor {m or 'not named'}" for _, b, m in benches)
    raise ConfigurationError(
        what,
        where="torque scale",
        value=told or "; ".join(sorted({one.skipped for one in seen}))[:300] or None,
        limit="torque-scale runs of one bench, with a disc and without",
        remedy=remedy,
    )


def _common_channels(taught: Sequence[_TorqueRun]) -> list[str]:
    """The torque channels that all runs have, in the order of the first."""
    first, *others = (one.channels or {} for one in taught)
    return [name for name in first if all(name in other for other in others)]


def _refuse_unbelievable(channel: str, gain: Gain) -> None:
    """Raise `ConfigurationError` for a gain that no scale has: the disc that is stated was not the one that turned."""
    low, high = _BELIEVABLE
    if not (low <= gain.gain <= high and gain.rotor_inertia > 0.0):
        raise ConfigurationError(
            "shows another inertia than the one that is stated",
            where=f"{channel} of these runs",
            value=f"gain {gain.gain:.3g}, rotor {1e4 * gain.rotor_inertia:.3g} kg cm2",
            limit=f"a gain of {low:g} to {high:g}, a rotor above 0",
            remedy="Look whether the disc was mounted, and whether its inertia and unit are right.",
        )


def _torque_run(run: Path) -> _TorqueRun:
    """What a run shows by its analysis in force."""
    found = in_force(run, SCALE_KIND)
    if found.analysis is None:
        return _TorqueRun(run=run, skipped="it is not analysed")
    if not found.of_this_run:
        return _TorqueRun(run=run, skipped="its analysis is of other bytes")
    recording = open_run(run, rows=False)
    try:
        metadata = recording.metadata
        channels = {n: c for n, c in recording.signals.items() if n in ("torque", "drive_torque")}
    finally:
        close_recording(recording)
    if not bench_of(metadata):
        return _TorqueRun(run=run, skipped="its bench has no name")
    return _TorqueRun(
        run=run,
        metadata=metadata,
        channels=channels,
        disc=disc_of(metadata.parameters),
        result=found.analysis.whole_result(),
        sha256=sealed_sha256(run),
    )


def _rows(run: _TorqueRun, channel: str) -> list[tuple[float | int | str, ...]]:
    """The rows of a channel in what the run's ramps show: all accelerations first."""
    assert run.result is not None
    table = next(one for one in run.result.tables if one.name == LEVELS)
    return [row for row in table.rows if row[0] == channel]


def _gain(runs: Sequence[_TorqueRun], channel: str) -> Gain:
    shown: list[ShownInertia] = []
    for run in runs:
        disc = run.disc
        assert disc is not None
        whole, *levels = _rows(run, channel)
        shown.append(
            ShownInertia(
                disc=disc.words,
                inertia=disc.inertia,
                inertia_uncertainty=_uncertainty(disc),
                shown=float(whole[2]),
                standard_error=float(whole[3]),
                degrees_of_freedom=float(whole[4]),
                levels=tuple(float(row[2]) for row in levels),
            )
        )
    if len({len(one.levels) for one in shown}) > 1:
        raise ConfigurationError(
            "have other accelerations", where="these runs", limit="the same in all of them"
        )
    try:
        return gain_of(shown)
    except IdentificationError as error:
        raise misstated(error, "these runs") from error


def _estimate(
    channel: str,
    gain: Gain,
    runs: Sequence[_TorqueRun],
    apart: float,
    lag: tuple[float, float] | None,
) -> Estimate:
    """The gain with its budget. `apart` [K]: how much the housing differed between the runs; `lag` with its u [s]."""
    value = gain.gain
    discs = {one.disc.words: one.disc for one in runs if one.disc is not None and one.disc.inertia}
    assert runs[0].metadata is not None
    is_counted = any(m.metadata is not None and m.metadata.time_base == "nominal" for m in runs)
    second = TIME_BASE.standard_uncertainty if is_counted else _QUARTZ
    zero = max(abs(one.result.metrics.get("torque_zero_drift", 0.0)) for one in runs if one.result)
    # Of the drift over a run a pair of ramps sees a hundredth at most; the torques differ by some hundred mN m.
    zero_share = 0.01 * zero / 0.1 if math.isfinite(zero) else 0.0
    budget = (
        BudgetLine(
            "scatter of the ramps", "A", gain.scatter, degrees_of_freedom=gain.degrees_of_freedom
        ),
        *(_disc_line(disc, gain.inertias[words]) for words, disc in discs.items()),
        BudgetLine(WARMTH, "B", abs(MAGNETS) * math.hypot(WARMER, apart) * value),
        BudgetLine("linearity", "B", gain.linearity, "by the accelerations"),
        BudgetLine("steps of the set-point", "B", _STEPS * value, "assumed: gains as they were"),
        BudgetLine("time base", "B", 2.0 * second * value),
        BudgetLine(
            "lag", "B", _late_share(lag) * value, "at the ends of the ramps, which are left out"
        ),
        BudgetLine("torque zero", "B", zero_share * value, "its drift between two ramps"),
    )
    half = NORMAL_COVERAGE_FACTOR * gain.scatter
    return Estimate(
        name=f"{channel}_gain",
        value=value,
        unit="1",
        low=value - half,
        high=value + half,
        budget=budget,
    )


def _uncertainty(disc: Disc) -> float:
    """Standard uncertainty of an inertia [kg m2]: as stated, or as assumed."""
    return disc.stated_uncertainty or DISC.standard_uncertainty * disc.inertia


def _disc_line(disc: Disc, size: float) -> BudgetLine:
    """What the inertia of one disc leaves open of the gain; assumed where nobody stated its U."""
    source = "inertia of the disc"
    if disc.stated_uncertainty:
        return BudgetLine(source, "B", size, disc.words)
    return DISC.line(source, size)


def _late_share(lag: tuple[float, float] | None) -> float:
    """What a port as late as this still lacks of the torque of a ramp, `EDGE` after its corner, relative."""
    late = abs(lag[0]) + 2.0 * lag[1] if lag is not None else LAG
    return late / EDGE * math.exp(-EDGE / late)


def _temperature(runs: Sequence[_TorqueRun]) -> tuple[float, float]:
    """Mean housing temperature [degC], NaN where one run has none, and half the range of the runs [K]."""
    found = [one.result.metrics.get("housing_temperature", math.nan) for one in runs if one.result]
    if not all(map(math.isfinite, found)):
        return math.nan, 0.0
    return sum(found) / len(found), 0.5 * (max(found) - min(found))


def _lag(runs: Sequence[_TorqueRun], channel: str) -> tuple[float, float] | None:
    """Mean lag of the runs with a disc, by their errors, and its standard uncertainty [s]; None without."""
    found = [
        (float(row[5]), float(row[6]), run.metadata.sample_rate)
        for run in runs
        if run.disc is not None and run.disc.inertia and run.metadata is not None
        for row in _rows(run, channel)[:1]
        if math.isfinite(float(row[5])) and float(row[6]) > 0.0
    ]
    if not found:
        return None
    weights = [error**-2 for _, error, _ in found]
    lag = sum(w * one for w, (one, _, _) in zip(weights, found, strict=True)) / sum(weights)
    # A torque that is sampled once a cycle is known to a cycle.
    return lag, math.hypot(sum(weights) ** -0.5, 1.0 / found[0][2] / math.sqrt(12.0))


def write_scale(learnt: LearntScale, path: Path, today: date, due: date | None) -> Path:
    """Write and seal its file; a name that is taken is left alone. Raises `ConfigurationError`."""
    return write_new_sealed(path, learnt.content(today, due))
