"""What the channels show while the rig stands with the servo off: zero, noise, agreement, time."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers import channel as names
from drivers.channel import Channel
from drivers.samples import CycleFlag
from experiments.finding import Finding, Severity, passed_if
from model.units import ARCSEC
from rig.run.preflight import LARGEST_ZERO, MISSED_SHARE, STANDING_COUNTS

_SOUGHT_ZERO = 0.02
"""Share of the rated torque that the torque port should not exceed with the servo off: 20 mV of a monitor of 1 V."""
_LARGEST_TORQUE_NOISE = 0.02
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
_LARGEST_JITTER = 0.1
"""Share of the SYNC period by which it may scatter (r.m.s.)."""
_LARGEST_STEP = 1e9
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


def share_marked(flags: NDArray[np.uint16], marks: int) -> float:
    """Share of the cycles that bear one of these marks; all, where there are no cycles."""
    return float(np.mean((flags & marks) != 0)) if len(flags) else 1.0


def gravity(is_bearable: bool) -> Severity:
    """How grave it is that something is not as it must be: a warning where a run can go on with it."""
    return Severity.WARNS if is_bearable else Severity.BLOCKS


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
    missed = share_marked(stand.flags, wrong)
    return passed_if(
        "cycles",
        missed <= LARGEST_MISSED,
        f"{100.0 * missed:.2f} % of {len(stand.flags)} cycles incomplete, late or doubled",
        "Lower the SYNC rate, look at the bus load, the cable and the termination.",
        where="acquisition",
        allowed=f"<= {LARGEST_MISSED:g}",
        value=missed,
        unit="1",
        otherwise=gravity(missed <= MISSED_SHARE),
    )


def _time(stand: Stand) -> Iterable[Finding]:
    steps = np.diff(stand.time_ns).astype(np.float64)
    if not len(steps):
        yield Finding("rate", Severity.BLOCKS, "no cycle came back", where="acquisition")
        return
    rate, nominal = 1e9 / steps.mean(), 1e9 / stand.cycle_ns
    yield passed_if(
        "rate",
        rate >= SLOW_RATE * nominal,
        f"{rate:.1f} Hz of {nominal:g} Hz",
        "A lower SYNC rate, a quieter computer.",
        where="acquisition",
        allowed=f">= {SLOW_RATE * nominal:g} Hz",
        value=rate,
        unit="Hz",
        otherwise=gravity(rate >= SLOWEST_RATE * nominal),
    )
    jitter, largest = float(steps.std()) * 1e-3, float(np.abs(steps - stand.cycle_ns).max()) * 1e-3
    allowed = _LARGEST_JITTER * stand.cycle_ns * 1e-3
    yield passed_if(
        "jitter",
        jitter <= allowed,
        f"{jitter:.0f} us r.m.s., {largest:.0f} us at most",
        "An adapter with time stamps of its own, a lower SYNC rate, a quieter computer.",
        where="acquisition",
        allowed=f"<= {allowed:g} us r.m.s.",
        value=jitter,
        unit="us",
        otherwise=Severity.WARNS,
    )
    yield passed_if(
        "time base",
        stand.time_base != "host",
        f"time stamps are those of: {stand.time_base}",
        "Analyses of speed need stamps of the adapter or the devices: pcan, kvaser, gs_usb.",
        where="acquisition",
        otherwise=Severity.WARNS,
    )
    wrong = int(np.sum((steps <= 0.0) | (steps > _LARGEST_STEP)))
    yield passed_if(
        "clock",
        not wrong,
        f"{wrong} of {len(steps)} steps of the time stamps go backwards or jump",
        "The adapter's clock jumps: another driver of it, or stamps of the host.",
        where="acquisition",
        allowed="0",
        value=float(wrong),
    )


def _torque(stand: Stand) -> Iterable[Finding]:
    port, drive = stand.si(names.TORQUE), stand.si(names.DRIVE_TORQUE)
    if port is None or not len(port):
        yield Finding(
            "port",
            Severity.WARNS,
            "no torque port: 0x6077 is all there is",
            "Map the analogue input.",
            where="torque",
        )
    else:
        zero, noise, rated = float(port.mean()), float(port.std()), stand.rated_torque
        yield passed_if(
            "zero",
            abs(zero) <= _SOUGHT_ZERO * rated,
            f"{1e3 * zero:.2f} mN m with the servo off",
            "Trim the monitor's offset, check its cable.",
            where="torque",
            allowed=f"+-{_SOUGHT_ZERO * rated:.3g} N m",
            value=zero,
            unit="N m",
            otherwise=gravity(abs(zero) <= LARGEST_ZERO * rated),
        )
        yield passed_if(
            "noise",
            noise <= _LARGEST_TORQUE_NOISE * rated,
            f"{1e3 * noise:.3f} mN m r.m.s.",
            "Check shield and ground.",
            where="torque",
            allowed=f"<= {_LARGEST_TORQUE_NOISE * rated:.3g} N m",
            value=noise,
            unit="N m",
            otherwise=Severity.WARNS,
        )
    if port is not None and drive is not None and len(port):
        differs = float(abs(port.mean() - drive.mean()))
        yield passed_if(
            "cross-check",
            differs <= DISAGREEMENT * stand.rated_torque,
            f"port and drive differ by {1e3 * differs:.2f} mN m at rest",
            "Check scale, direction and zero of the port.",
            where="torque",
            allowed=f"<= {DISAGREEMENT * stand.rated_torque:.3g} N m",
            value=differs,
            unit="N m",
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
            return passed_if(
                title,
                flicker <= STANDING_COUNTS and bool(len(counts)),
                text,
                remedy,
                where="encoders",
                allowed=f"<= {STANDING_COUNTS}",
                value=float(flicker),
                unit="counts",
            )
    return Finding(
        title, Severity.WARNS, "there is none", "Map it in the configuration.", where="encoders"
    )


def _temperatures(stand: Stand) -> Iterable[Finding]:
    low, high = ROOM_TEMPERATURES
    for name in (names.HOUSING_TEMPERATURE, names.AMBIENT_TEMPERATURE):
        values = stand.si(name)
        if values is not None and len(values):
            mean = float(values.mean())
            yield passed_if(
                name.replace("_", " "),
                low <= mean <= high,
                f"{mean:.1f} degC",
                "Is a sensor connected to this input?",
                where="temperature",
                allowed=f"{low:g} to {high:g} degC",
                value=mean,
                unit="degC",
                otherwise=Severity.WARNS,
            )
