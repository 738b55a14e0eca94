"""Foreign recordings with their truth and all that can be said of them, of which a study then says a part.

Plant and noise are arithmetic of this file and of its neighbours (`recordings_cases`, `recordings_pairs`,
`orders_study`): nothing of the simulated rig, nothing of what is studied. What an instrument's maker could have stated
is stated truly; where it is left unsaid, it is as wrong as such instruments are.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tests.benchmarks import orders_study
from tests.benchmarks.recordings_cases import SCALE, Case, friction_table, joint
from tests.benchmarks.recordings_pairs import encoders, torque_loops

TURN = 2.0 * math.pi
ARCSEC = TURN / 1_296_000.0
RPM = TURN / 60.0
Random = np.random.Generator
Said = dict[str, Any]
EVERYTHING = "nothing"
"""The pattern that leaves nothing unsaid."""


@dataclass(kw_only=True)
class Foreign:
    """A recording as columns (n,) with units, what can be said of channels and of the run, and the truth by quantity.

    `leans` says for each pattern of *not said* which quantities rest on it: beginnings of their names. Only
    these patterns make sense for the recording. `blind` is what a pattern takes away: keys of `said` and `options`.
    """

    kind: str
    time: np.ndarray
    columns: dict[str, tuple[np.ndarray, str]]
    truth: dict[str, float]
    leans: Mapping[str, tuple[str, ...]]
    said: dict[str, Said] = field(default_factory=dict)
    options: Said = field(default_factory=dict)
    settings: Said = field(default_factory=dict)
    rate: float = math.nan
    """Hz that somebody says of the recording where its times are left away; NaN: its rows are not evenly taken."""


MOTOR_ENCODER = {1: 1.0, 2: 0.6, 3: 0.05, 4: 0.3, 5: 0.03, 6: 0.05, 7: 0.02, 8: 0.04}
OUTPUT_ENCODER = {k: 1.0 / k for k in range(1, 9)}
"""Largest amplitudes by order, in proportion: an encoder has a little of every order."""


def _curve(
    random: Random, half_width: float, sizes: Mapping[int, float]
) -> Callable[[np.ndarray], np.ndarray]:
    """An encoder's error over its angle: (largest - smallest)/2 is a half to all of the half-width that is said."""
    size = random.uniform(0.2, 1.0, len(sizes)) * np.array(list(sizes.values()))
    phase = random.uniform(0.0, TURN, len(sizes))

    def raw(angle: np.ndarray) -> np.ndarray:
        terms = zip(size, sizes, phase, strict=True)
        return np.sum([a * np.cos(n * angle + p) for a, n, p in terms], axis=0)

    grid = raw(np.linspace(0.0, TURN, 4096))
    scale = random.uniform(0.5, 1.0) * half_width / (0.5 * np.ptp(grid))
    return lambda angle: scale * raw(angle)


def _gear_orders(random: Random) -> dict[int, tuple[float, float]]:
    """Amplitude and phase of the orders of the input, some of them none at all."""
    sizes = {n: ARCSEC * 10.0 ** random.uniform(-0.5, 1.3) for n in range(1, 7)}
    sizes[2] = ARCSEC * random.uniform(5.0, 25.0)
    for n in (3, 5, 6):
        if random.random() < 0.4:
            sizes[n] = 0.0
    return {n: (a, float(random.uniform(0.0, TURN))) for n, a in sizes.items()}


def two_encoders(random: Random) -> Foreign:
    """Both angles of a gear at one slow speed, a turn of the output each way, with the mode that amplifies orders."""
    ratio = int(random.choice((50, 80, 100)))
    rate = float(random.choice((200.0, 500.0)))
    speed = RPM * random.uniform(40.0, 110.0)
    own = _gear_orders(random)
    slow = {k: (ARCSEC * random.uniform(0.2, 4.0), random.uniform(0.0, TURN)) for k in range(1, 5)}
    output_half = ARCSEC * 10.0 ** random.uniform(math.log10(2.0), math.log10(60.0))
    input_half = ARCSEC * 10.0 ** random.uniform(math.log10(20.0), math.log10(600.0))
    output_curve = _curve(random, output_half, OUTPUT_ENCODER)
    input_curve = _curve(random, input_half, MOTOR_ENCODER)
    mode = TURN * random.uniform(9.0, 60.0)
    seconds = (TURN * ratio + 6.0 * TURN) / speed
    rows = int(seconds * rate)
    times = np.arange(2 * rows) / rate
    there = speed * np.arange(rows) / rate
    theta = random.uniform(0.0, TURN) + np.concatenate([there, there[-1] - there])

    def error(angle: np.ndarray, *, is_driven: bool) -> np.ndarray:
        """Kinematic error at the output; driven at the speed of the run its orders grow by 1/(1 - r^2)."""
        total = np.zeros_like(angle)
        for n, (a, p) in own.items():
            grown = 1.0 / (1.0 - (n * speed / mode) ** 2) if is_driven else 1.0
            total += grown * a * np.cos(n * angle + p)
        for k, (a, p) in slow.items():
            total += a * np.cos(k * angle / ratio + p)
        return total

    output = -theta / ratio + error(theta, is_driven=True)
    shown = output + output_curve(output) + 0.3 * ARCSEC * random.standard_normal(2 * rows)
    seen = theta + input_curve(theta)
    seen = np.rint(seen / (TURN / 2**17)) * TURN / 2**17
    torque = 0.05 * np.repeat([1.0, -1.0], rows) + 0.003 * random.standard_normal(2 * rows)
    grid = np.linspace(0.0, TURN * ratio, 200_000)
    truth = {f"amplitude_{n}": a for n, (a, _) in own.items()}
    truth |= {f"amplitude_{k}/N": a for k, (a, _) in slow.items()}
    whole = float(np.ptp(error(grid, is_driven=False)))
    truth |= {f"transmission_accuracy_{way}": whole for way in ("forward", "reverse")}
    lap = rows / rate
    segments = [
        dict(label="traverse", start=i * lap, stop=(i + 1) * lap, setpoint=s * speed, direction=s)
        for i, s in ((0, 1), (1, -1))
    ]
    small = tuple(truth)
    return Foreign(
        kind="kinematic-error",
        time=times,
        columns={
            "input_angle": (seen, "rad"),
            "output_angle": (shown, "rad"),
            "torque": (torque, "N m"),
        },
        truth=truth,
        leans={
            "encoders": small,
            "output encoder": ("transmission_accuracy", *(f"amplitude_{k}/N" for k in range(1, 9))),
            "input encoder": tuple(f"amplitude_{n}" for n in (1, 2, 4)),
            "inertia": tuple(f"amplitude_{n}" for n in (3, 4, 5, 6)),
            "everything": small,
        },
        said={
            "output_angle": {"accuracy": output_half},
            "input_angle": {"accuracy": input_half},
            "torque": {"scale_uncertainty": 0.01},
        },
        options={
            "ratio": float(ratio),
            "output_sense": -1,
            "resonance_hz": mode / TURN,
            "segments": segments,
        },
    )


def running(random: Random) -> Foreign:
    """An axis at constant speeds both ways: angle, torque, perhaps its temperature; the torque of all that turns."""
    rate = 200.0
    levels = np.geomspace(10.0, random.uniform(800.0, 2500.0), 9)
    extra = np.array([500.0, 1000.0])
    speeds = np.unique(np.round(np.concatenate([levels, extra[extra < levels[-1]]]), 1))
    coulomb = random.uniform(0.02, 0.15)
    dip, critical = coulomb * random.uniform(0.0, 0.5), random.uniform(0.5, 5.0)
    viscous = random.uniform(0.1, 0.8) * coulomb / 200.0
    dry, warm = random.uniform(0.0, 0.006), random.uniform(15.0, 40.0)
    scale_error, zero = random.uniform(-0.05, 0.05), random.uniform(-0.02, 0.02)
    thermometer = random.uniform(-1.5, 1.5)

    def friction(speed: float, temperature: float) -> float:
        law = coulomb + dip * math.exp(-((speed / critical) ** 2)) + viscous * speed
        return law * (1.0 - dry * (temperature - 20.0))

    angle, torque, segments, at, place = [], [], [], 0.0, 0.0
    largest = friction(float(speeds[-1]) * RPM, warm)
    for repeat in range(2):
        for rpm in speeds if repeat == 0 else speeds[::-1]:
            for way in (1, -1):
                seconds = max(2.0, 2.2 * 60.0 / rpm)
                rows = int(seconds * rate)
                travel = way * rpm * RPM * np.arange(1, rows + 1) / rate
                angle.append(place + travel)
                place += float(travel[-1])
                spread = 1.0 + 0.003 * random.standard_normal()
                level = way * friction(rpm * RPM, warm) * spread
                ripple = 0.1 * coulomb * np.cos(2.0 * angle[-1])
                torque.append(level + ripple + 0.05 * coulomb * random.standard_normal(rows))
                stop = at + rows / rate
                segments.append(
                    dict(
                        label="hold",
                        start=at,
                        stop=stop,
                        setpoint=way * rpm * RPM,
                        direction=way,
                        repeat=repeat,
                    )
                )
                at = stop
    shown = (1.0 + scale_error) * np.concatenate(torque) + zero * largest
    count = len(shown)
    columns = {
        "input_angle": (np.concatenate(angle), "rad"),
        "torque": (shown, "N m"),
        "housing_temperature": (np.full(count, warm + thermometer), "degC"),
    }
    names = {f"running_torque_{rpm:g}_rpm": rpm for rpm in (500.0, 1000.0, 2000.0)}
    names |= {f"running_torque_{rpm:g}_rpm": rpm for rpm in speeds}
    truth = {name: friction(rpm * RPM, warm) for name, rpm in names.items()}
    truth |= {f"{n}_at_20_degrees": friction(rpm * RPM, 20.0) for n, rpm in names.items()}
    cold = tuple(f"{n}_at_20_degrees" for n in names)
    slower = 1.0 + random.uniform(-0.005, 0.005)
    return Foreign(
        kind="friction",
        time=np.arange(count) / rate,
        columns=columns,
        truth=truth,
        leans={
            "torque scale": tuple(truth),
            "zero": (),
            "thermometer": cold,
            "temperature": cold,
            "rate": (),
            "everything": tuple(truth),
        },
        said={
            "torque": {
                "scale_uncertainty": 0.05 / math.sqrt(3.0),
                "offset_uncertainty": 0.02 * largest / math.sqrt(3.0),
            },
            "housing_temperature": {"offset_uncertainty": 1.5 / math.sqrt(3.0)},
            "input_angle": {"accuracy": 0.0},
        },
        options={"segments": segments},
        rate=rate * slower,
    )


def _of(case: Case, leans: Mapping[str, tuple[str, ...]], said: dict[str, Said]) -> Foreign:
    """A recording that its neighbours make, as columns."""
    recording = case.recording
    rows = recording.rows
    columns = {
        name: (np.asarray(recording.source.stored(name, 0, rows), dtype=float), signal.unit)
        for name, signal in recording.signals.items()
    }
    metadata = recording.metadata
    options: Said = {}
    if math.isfinite(metadata.ratio):
        options |= {"ratio": metadata.ratio, "output_sense": metadata.output_sense}
    stated = metadata.process.get("stated", {}).get("lag_s", {})
    for name, lag in stated.items():
        said.setdefault(name, {})["lag_s"] = float(lag)
    return Foreign(
        kind=case.kind,
        time=recording.source.time_ns(0, rows) * 1e-9,
        columns=columns,
        truth=case.truth,
        leans=leans,
        said=said,
        options=options,
        settings=dict(case.settings),
    )


TORQUES = ("inertia", "viscous", "coulomb", "static", "load_sin_1", "load_cos_1")


def moving_joint(random: Random) -> Foreign:
    """A joint in motion, with the scale of its torque as good as said or as nobody said."""
    case = joint(random)
    said = {
        "torque": {"scale_uncertainty": SCALE, "offset_uncertainty": 0.0},
        "position": {"accuracy": 0.0},
    }
    made = _of(
        case,
        {"torque scale": TORQUES, "zero": ("offset",), "rate": (), "everything": TORQUES},
        said,
    )
    even = not case.facts["gaps"] and not case.facts["jitter"]
    if even:
        made.rate = case.facts["rate"] * (1.0 + random.uniform(-0.005, 0.005))
        made.leans = {**made.leans, "rate": ("inertia",)}
    return made


def friction_points(random: Random) -> Foreign:
    """A table of friction over speed in N m, or in A of a motor whose constant nobody knows."""
    case = friction_table(random)
    scaled = ("coulomb", "viscous", "static", "offset")
    said = {"torque": {"scale_uncertainty": SCALE, "offset_uncertainty": 0.0}}
    return _of(case, {"torque scale": scaled, "everything": scaled}, said)


def late_encoders(random: Random) -> Foreign:
    """Two encoders apart in time; the ratio said or not."""
    case = encoders(random)
    said: dict[str, Said] = {"input_angle": {"accuracy": 0.0}, "output_angle": {"accuracy": 0.0}}
    return _of(case, {"ratio": (), "encoders": ("hysteresis",), "everything": ()}, said)


def loops(random: Random) -> Foreign:
    """Slow loops of torque over torsion."""
    case = torque_loops(random)
    scaled = ("branch_stiffness", "secant_stiffness", "loss", "lost_motion")
    said = {
        "output_torque": {"scale_uncertainty": SCALE, "offset_uncertainty": 0.0},
        "position": {"accuracy": 0.0},
    }
    return _of(case, {"torque scale": scaled, "everything": scaled}, said)


def lines(random: Random) -> Foreign:
    """Orders of a torque over an angle."""
    one = orders_study.made(int(random.integers(1, 2**31)))
    truth = {f"spectrum_{order:.6g}": size for order, size in one.orders.items()}
    return Foreign(
        kind="order-spectrum",
        time=one.time,
        columns={"input_angle": (one.angle, "rad"), "torque": (one.torque, "N m")},
        truth=truth,
        leans={"torque scale": ("spectrum",), "everything": ("spectrum",)},
        said={
            "torque": {
                "scale_uncertainty": orders_study.SCALE / math.sqrt(3.0),
                "offset_uncertainty": 0.0,
            },
            "input_angle": {"accuracy": 0.0},
        },
        settings={"highest_order": 420.0},
    )


MAKERS: tuple[Callable[[Random], Foreign], ...] = (
    two_encoders,
    running,
    moving_joint,
    two_encoders,
    friction_points,
    loops,
    running,
    lines,
    two_encoders,
    late_encoders,
)
TAKEN: Mapping[str, tuple[tuple[str, str], ...]] = {
    "encoders": (("input_angle", "accuracy"), ("output_angle", "accuracy")),
    "output encoder": (("output_angle", "accuracy"),),
    "input encoder": (("input_angle", "accuracy"),),
    "torque scale": (("torque", "scale_uncertainty"), ("output_torque", "scale_uncertainty")),
    "zero": (("torque", "offset_uncertainty"), ("output_torque", "offset_uncertainty")),
    "thermometer": (("housing_temperature", "offset_uncertainty"),),
}
"""Pattern of *not said*, and the statements about channels that it leaves away."""


def made(seed: int) -> tuple[Foreign, str]:
    """The recording of a seed with the pattern by which it is told: makers and patterns go round."""
    foreign = MAKERS[seed % len(MAKERS)](np.random.default_rng([seed, 26]))
    patterns = (EVERYTHING, *foreign.leans)
    pattern = patterns[(seed // len(MAKERS) + seed % len(MAKERS)) % len(patterns)]
    return told(foreign, pattern), pattern


def told(foreign: Foreign, pattern: str) -> Foreign:
    """The recording without what the pattern leaves unsaid."""
    left_away = (
        [where for places in TAKEN.values() for where in places]
        if pattern == "everything"
        else list(TAKEN.get(pattern, ()))
    )
    for channel, key in left_away:
        foreign.said.get(channel, {}).pop(key, None)
    if pattern in ("ratio",):
        foreign.options.pop("ratio", None)
    if pattern in ("inertia", "everything"):
        foreign.options.pop("resonance_hz", None)
    if pattern in ("temperature", "everything"):
        foreign.columns.pop("housing_temperature", None)
    if pattern != "rate":
        foreign.rate = math.nan
    elif foreign.options.get("segments"):
        # Whoever knows the rate only marks the holds by the time that follows from it.
        slower = foreign.rate * float(np.median(np.diff(foreign.time)))
        for segment in foreign.options["segments"]:
            segment |= {"start": segment["start"] / slower, "stop": segment["stop"] / slower}
    return foreign
