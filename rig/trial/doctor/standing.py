"""What the channels show while the rig stands with the servo off: zero, noise, agreement, time."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers import channel as names
from drivers.channel import Channel
from drivers.samples import CycleFlag
from model.units import ARCSEC
from rig.run.preflight import LARGEST_ZERO, MISSED_SHARE, STANDING_COUNTS
from rig.trial.doctor.finding import Finding, judged

SOUGHT_ZERO = 0.02
"""Share of the rated torque that the torque port should not exceed with the servo off: 20 mV of a monitor of 1 V."""
LARGEST_TORQUE_NOISE = 0.02
"""Share of the rated torque that its noise may have (r.m.s.)."""
DISAGREEMENT = 0.1
"""Share of the rated torque by which port and drive may differ at rest."""
LARGEST_MISSED = 0.001
"""Share of cycles that may be missed without a word."""
ROOM_TEMPERATURES = (-10.0, 60.0)
SLOW_RATE, SLOWEST_RATE = 0.99, 0.9
"""Shares of the nominal rate below which something is to be said, and below which it is not the
rate that was asked for.
"""
LARGEST_JITTER = 0.1
"""Share of the SYNC period by which it may scatter (r.m.s.)."""
LARGEST_STEP = 1e9
"""ns from one time stamp to the next above which the clock has jumped."""


@dataclass(frozen=True, kw_only=True)
class Stand:
    """Cycles with the servo off: channels, counts (n, channels), flags (n,), time stamps (n,) [ns],
    rated torque [N m].
    """

    channels: Sequence[Channel]
    counts: NDArray[np.int64]
    flags: NDArray[np.uint16]
    time_ns: NDArray[np.int64]
    cycle_ns: int
    time_base: str
    rated_torque: float

    def si(self, name: str) -> NDArray[np.float64] | None:
        """A channel in SI over the complete cycles; None where the rig has no such channel."""
        for column, channel in enumerate(self.channels):
            if channel.name == name:
                return channel.to_si(self.counts[(self.flags & CycleFlag.INCOMPLETE) == 0, column])
        return None


def inspect_stand(stand: Stand) -> Iterable[Finding]:
    """Every line that needs data and no motion."""
    yield _complete(stand)
    yield from _time(stand)
    yield from _torque(stand)
    for name in (names.INPUT_ANGLE, names.OUTPUT_ANGLE):
        yield _encoder(stand, name)
    yield from _temperatures(stand)


def _complete(stand: Stand) -> Finding:
    wrong = CycleFlag.INCOMPLETE | CycleFlag.LATE | CycleFlag.DOUBLED | CycleFlag.SHORT
    missed = float(np.mean((stand.flags & wrong) != 0)) if len(stand.flags) else 1.0
    return judged(
        "acquisition",
        "cycles",
        missed <= LARGEST_MISSED,
        f"{100.0 * missed:.2f} % of {len(stand.flags)} cycles incomplete, late or doubled",
        value=missed,
        unit="1",
        limit=f"<= {LARGEST_MISSED:g}",
        otherwise="warning" if missed <= MISSED_SHARE else "failed",
        remedy="Lower the SYNC rate, look at the bus load, the cable and the termination.",
    )


def _time(stand: Stand) -> Iterable[Finding]:
    steps = np.diff(stand.time_ns).astype(np.float64)
    if not len(steps):
        yield Finding(
            group="acquisition", name="rate", result="failed", evidence="no cycle came back"
        )
        return
    rate, nominal = 1e9 / steps.mean(), 1e9 / stand.cycle_ns
    yield judged(
        "acquisition",
        "rate",
        rate >= SLOW_RATE * nominal,
        f"{rate:.1f} Hz of {nominal:g} Hz",
        value=rate,
        unit="Hz",
        limit=f">= {SLOW_RATE * nominal:g} Hz",
        otherwise="warning" if rate >= SLOWEST_RATE * nominal else "failed",
        remedy="A lower SYNC rate, a quieter computer.",
    )
    jitter, largest = float(steps.std()) * 1e-3, float(np.abs(steps - stand.cycle_ns).max()) * 1e-3
    allowed = LARGEST_JITTER * stand.cycle_ns * 1e-3
    yield judged(
        "acquisition",
        "jitter",
        jitter <= allowed,
        f"{jitter:.0f} us r.m.s., {largest:.0f} us at most",
        value=jitter,
        unit="us",
        limit=f"<= {allowed:g} us r.m.s.",
        otherwise="warning",
        remedy="An adapter with time stamps of its own, a lower SYNC rate, a quieter computer.",
    )
    yield judged(
        "acquisition",
        "time base",
        stand.time_base != "host",
        f"time stamps are those of: {stand.time_base}",
        otherwise="warning",
        remedy="Analyses of speed need stamps of the adapter or the devices: pcan, kvaser, gs_usb.",
    )
    wrong = int(np.sum((steps <= 0.0) | (steps > LARGEST_STEP)))
    yield judged(
        "acquisition",
        "clock",
        not wrong,
        f"{wrong} of {len(steps)} steps of the time stamps go backwards or jump",
        value=float(wrong),
        limit="0",
        remedy="The adapter's clock jumps: another driver of it, or stamps of the host.",
    )


def _torque(stand: Stand) -> Iterable[Finding]:
    port, drive = stand.si(names.TORQUE), stand.si(names.DRIVE_TORQUE)
    if port is None or not len(port):
        yield Finding(
            group="torque",
            name="port",
            result="warning",
            evidence="no torque port: 0x6077 is all there is",
            remedy="Map the analogue input.",
        )
    else:
        zero, noise, rated = float(port.mean()), float(port.std()), stand.rated_torque
        yield judged(
            "torque",
            "zero",
            abs(zero) <= SOUGHT_ZERO * rated,
            f"{1e3 * zero:.2f} mN m with the servo off",
            value=zero,
            unit="N m",
            limit=f"+-{SOUGHT_ZERO * rated:.3g} N m",
            otherwise="warning" if abs(zero) <= LARGEST_ZERO * rated else "failed",
            remedy="Trim the monitor's offset, check its cable.",
        )
        yield judged(
            "torque",
            "noise",
            noise <= LARGEST_TORQUE_NOISE * rated,
            f"{1e3 * noise:.3f} mN m r.m.s.",
            value=noise,
            unit="N m",
            limit=f"<= {LARGEST_TORQUE_NOISE * rated:.3g} N m",
            otherwise="warning",
            remedy="Check shield and ground.",
        )
    if port is not None and drive is not None and len(port):
        differs = float(abs(port.mean() - drive.mean()))
        yield judged(
            "torque",
            "cross-check",
            differs <= DISAGREEMENT * stand.rated_torque,
            f"port and drive differ by {1e3 * differs:.2f} mN m at rest",
            value=differs,
            unit="N m",
            limit=f"<= {DISAGREEMENT * stand.rated_torque:.3g} N m",
            remedy="Check scale, direction and zero of the port.",
        )


def _encoder(stand: Stand, name: str) -> Finding:
    title = name.replace("_", " ")
    for column, channel in enumerate(stand.channels):
        if channel.name == name:
            counts = stand.counts[(stand.flags & CycleFlag.INCOMPLETE) == 0, column]
            flicker = int(np.ptp(counts)) if len(counts) else 0
            size = channel.scale / ARCSEC
            noise = size * float(counts.std()) if len(counts) else 0.0
            text = (
                f"moves by {flicker} counts, {noise:.2g} arcsec r.m.s., in {len(counts)} "
                f"cycles; a count is {size:.3g} arcsec"
            )
            remedy = "Something turns, or the signal is disturbed."
            return judged(
                "encoders",
                title,
                flicker <= STANDING_COUNTS and bool(len(counts)),
                text,
                value=float(flicker),
                unit="counts",
                limit=f"<= {STANDING_COUNTS}",
                remedy=remedy,
            )
    return Finding(
        group="encoders",
        name=title,
        result="warning",
        evidence="there is none",
        remedy="Map it in the configuration.",
    )


def _temperatures(stand: Stand) -> Iterable[Finding]:
    low, high = ROOM_TEMPERATURES
    for name in (names.HOUSING_TEMPERATURE, names.AMBIENT_TEMPERATURE):
        values = stand.si(name)
        if values is not None and len(values):
            mean = float(values.mean())
            yield judged(
                "temperature",
                name.replace("_", " "),
                low <= mean <= high,
                f"{mean:.1f} degC",
                value=mean,
                unit="degC",
                limit=f"{low:g} to {high:g} degC",
                otherwise="warning",
                remedy="Is a sensor connected to this input?",
            )
