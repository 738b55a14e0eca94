"""Choosing input speeds: logarithmic, incommensurate with SYNC, away from resonances.

At r = speed/(2 pi f_SYNC) input revolutions per cycle, input order m appears in the samples as the
fraction m r mod 1. Where that is close to a whole number the order does not average out over whole
revolutions: 3000 r/min at 1 kHz is 20 samples per revolution, and orders 20, 40, 60 then stand in
the mean. `incommensurate` moves a speed by at most a few per cent to where the worst order up to
`HIGHEST_ORDER` leaks least. Resonance n f_1: order n of the kinematic error meets the first
torsional mode f_1 at the input speed 60 f_1/n [r/min].
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from experiments.errors import PlanError
from model.gear import HarmonicDrive
from model.stiffness import drive_stiffness
from model.units import REVOLUTION, RPM

HIGHEST_ORDER = 120
"""Orders of the input up to which aliasing into the mean is looked at (tooth engagement, motor
slots and their harmonics).
"""
_CANDIDATES = 61
LOCK_HARMONICS, LOCK_REACH, LOCK_SIDEBANDS = 24, 45, 24
"""Harmonics of a counter's saw-tooth; orders over which the error spreads the first; sidebands looked at."""
_LOCK_ALLOWED = 0.11
"""Share of the saw-tooth that may be locked to the input: at 18 arcsec a count, half an arcsecond on one order."""
LOCK_REFUSED = 0.5
"""Share from which on no recording is worth the time."""
JUDGED_ORDER = 6.0
"""Highest input order that a kinematic error is expected to have."""
QUIET_SPEEDS = 300.0 * RPM
"""rad/s up to which a speed is moved for its counts' sake."""
QUASI_STATIC, CORRECTED = 0.02, 0.1
"""Squares of frequency over the first mode's, at the highest order: below the one it matters little, up to
the other it is corrected with an uncertainty that leaves something of the order.
"""


def alias_leak(speed: float, sample_rate: float, seconds: float) -> float:
    """The largest share (0..1) of an aliased input order that stays in a mean of `seconds` at `speed` [rad/s].

    |sin(pi m r M)| <= 1 is taken as 1: bound 1/(M |sin(pi m r)|) with M samples; orders below Nyquist count as none.
    """
    per_cycle = abs(speed) / (REVOLUTION * sample_rate)
    samples = max(seconds * sample_rate, 1.0)
    worst = 0.0
    for order in range(1, HIGHEST_ORDER + 1):
        phase = order * per_cycle
        if phase > 0.5:
            worst = max(worst, 1.0 / max(samples * abs(math.sin(math.pi * phase)), 1.0))
    return worst


def incommensurate(
    speed: float,
    sample_rate: float,
    seconds: float,
    *,
    within: float = 0.015,
    ceiling: float = math.inf,
) -> float:
    """The speed [rad/s] nearest to `speed` (within the share `within`, not above `ceiling`) at
    which orders alias least.

    A speed whose leak is already below 2 % is kept.
    """
    best, least = speed, alias_leak(speed, sample_rate, seconds)
    if least < 0.02:
        return speed
    for step in range(1, _CANDIDATES):
        for sign in (-1.0, 1.0):
            candidate = speed * (1.0 + sign * within * step / (_CANDIDATES - 1))
            if candidate > ceiling:
                continue
            leak = alias_leak(candidate, sample_rate, seconds)
            if leak < 0.9 * least:
                best, least = candidate, leak
    return best


def lattice_lock(speed: float, sample_rate: float, lattice: float, ratio: float) -> float:
    """How much of the output count's rounding falls on orders of the input at a speed [rad/s]: 0 none, 1 all.

    The output encoder gives exactly `lattice` counts per input revolution, phase-locked to the
    input. Harmonic j of its saw-tooth, of size 1/j, is sampled down to |j lattice - i M|, M samples
    per revolution. On a whole order or one of its sidebands k/N it does not average out, and no
    residual shows it; the kinematic error spreads it over some tens of orders about that.
    """
    per_turn = REVOLUTION * sample_rate / abs(speed)
    worst = 0.0
    for j in range(1, LOCK_HARMONICS + 1):
        folded = j * lattice - per_turn * round(j * lattice / per_turn)
        whole = round(folded)
        if abs(whole) <= LOCK_REACH * j:
            side = abs(folded - whole) * ratio
            worst = max(worst, (1.0 - side / LOCK_SIDEBANDS) / j)
    return worst


def off_lattice(
    speed: float,
    sample_rate: float,
    lattice: float,
    ratio: float,
    *,
    within: float = 0.015,
    ceiling: float = math.inf,
) -> float:
    """The speed [rad/s] nearest to `speed` (within the share `within`, not above `ceiling`) at which
    rounding averages out; where none does, the one at which least is locked.
    """
    steps = (0.5 * within * k / _CANDIDATES for k in range(2 * _CANDIDATES + 1))
    candidates = [speed * (1.0 + sign * step) for step in steps for sign in (1.0, -1.0)]
    allowed = [w for w in candidates if w <= ceiling] or [speed]
    locks = [(lattice_lock(w, sample_rate, lattice, ratio), w) for w in allowed]
    return next((w for lock, w in locks if lock <= _LOCK_ALLOWED), min(locks)[1])


def log_speeds(low_rpm: float, high_rpm: float, count: int) -> tuple[float, ...]:
    """`count` speeds [r/min] from low to high in equal ratios: about half of them below 100 r/min for 1 to 3000."""
    if count == 1:
        return (low_rpm,)
    ratio = (high_rpm / low_rpm) ** (1.0 / (count - 1))
    return tuple(low_rpm * ratio**k for k in range(count))


def first_resonances(gear: HarmonicDrive) -> tuple[float, ...]:
    """Candidates of the first torsional mode [rad/s]: sqrt(K/J_o) with the catalogue's K1 and with
    the computed K_HDf.
    """
    stiffnesses = (gear.ratings.stiffness_1, drive_stiffness(gear).combined_output)
    return tuple(sorted(math.sqrt(k / gear.inertia.output) for k in stiffnesses))


def resonance_speeds(
    gear: HarmonicDrive, orders: Iterable[float] = ()
) -> tuple[tuple[float, float], ...]:
    """(order, input speed [rad/s]) pairs at which an order of the kinematic error meets the first mode."""
    wanted = (
        tuple(orders)
        or tuple(h.order for h in gear.kinematic_error if h.order >= 0.5)
        or (1.0, 2.0, 4.0)
    )
    return tuple((n, w / n) for w in first_resonances(gear) for n in wanted)


def near_resonance(
    speed: float, resonances: Sequence[tuple[float, float]], band: float
) -> float | None:
    """The order whose resonance lies within the share `band` of `speed`, or None."""
    for order, critical in resonances:
        if abs(abs(speed) / critical - 1.0) < band:
            return order
    return None


def clear_of_resonances(
    speed: float, resonances: Sequence[tuple[float, float]], band: float, low: float, high: float
) -> float:
    """The nearest speed in [low, high] that is outside every resonance band; `speed` itself where there is none."""
    if near_resonance(speed, resonances, band) is None:
        return speed
    edges = [c * (1.0 + s * 1.001 * band) for _, c in resonances for s in (-1.0, 1.0)]
    free = [e for e in edges if low <= e <= high and near_resonance(e, resonances, band) is None]
    return min(free, key=lambda e: abs(math.log(e / speed)), default=speed)


def refuse_speed(speed_rpm: float, gear: HarmonicDrive, where: str) -> None:
    """Raise `PlanError` for a speed that is not positive or is above the gear's rating."""
    highest = gear.ratings.maximum_input_speed / RPM
    if not 0.0 < speed_rpm <= highest * (1.0 + 1e-9):
        raise PlanError(
            "the input speed is outside what the gear is rated for",
            where=where,
            value=f"{speed_rpm:g} r/min",
            limit=f"> 0 and <= {highest:.0f} r/min (ratings.maximum_input_speed)",
            remedy="Choose a speed within the rating.",
        )


def quiet_speed(
    speed_rpm: float,
    gear: HarmonicDrive,
    mounting: str,
    sync_rate: float,
    output_counts: float,
    where: str,
) -> float:
    """The input speed [rad/s]: the stated one, or the next at which the output's counts average out.

    Raises `PlanError` where their rounding falls on the orders themselves.
    """
    wanted = speed_rpm * RPM
    ratio = gear.mounted_ratio(mounting)  # type: ignore[arg-type]
    highest = max(min(gear.ratings.maximum_input_speed, QUIET_SPEEDS), wanted)
    lattice = output_counts / ratio
    moved = off_lattice(wanted, sync_rate, lattice, ratio, ceiling=highest)
    lock = lattice_lock(moved, sync_rate, lattice, ratio)
    if lock > LOCK_REFUSED:
        raise PlanError(
            "near this speed the rounding of the output's counts falls on the orders themselves",
            where=where,
            value=f"{speed_rpm:g} r/min, {100.0 * lock:.0f} % of it",
            limit=f"<= {100.0 * LOCK_REFUSED:.0f} %",
            remedy="Choose another speed or SYNC rate.",
        )
    return moved
