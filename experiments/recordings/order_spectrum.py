"""Order spectrum: amplitude of any channel per order of an angle, from whole revolutions, each direction."""

from __future__ import annotations

import numpy as np

from experiments.angle.traverses import traverses_of
from experiments.contract import Evidence, Experiment, NoParameters, no_plan
from experiments.errors import AnalysisError
from experiments.evidence import check_recording, check_settings, rotary_ratio, usable
from experiments.quantity import Quantity
from experiments.recording import Recording, Segment
from experiments.recordings.channels import ANGLES, EFFORTS, chosen_channel
from experiments.result import Plot, Result, Series, Table, way_of
from model.arrays import FloatArray
from model.errors import ModelError
from model.identify.estimate import Estimate
from model.identify.revolution import OrderPeaks, order_peaks
from model.units import DEGREE

NAME = "order-spectrum"
SETTINGS = ("channel", "angle", "highest_order")
KINEMATIC_ERROR = "kinematic_error"
"""The name of a channel that is made here: theta_o - theta_i/N."""
STRONGEST = 8
LARGEST = 4_000_000
"""Samples of one stretch that are transformed at once."""
LABELS = ("traverse", "hold")

QUANTITIES = (
    Quantity(name="amplitude_{order}", title="order {order}, amplitude", unit=""),
    Quantity(name="revolutions_{way}", title="revolutions {way}", unit="1"),
)


def analyse(recording: Recording, evidence: Evidence) -> Result:
    """The strongest orders of a channel over an angle, and the whole spectrum of each direction as a plot.

    Settings: channel ("kinematic_error" where both angles are there, else the torque), angle ("input_angle" or
    "output_angle"), highest_order (64). Stretches in one direction are the run's segments, or found from the angle.
    """
    settings = evidence.settings
    check_settings(settings, SETTINGS, NAME)
    angle_name = chosen_channel(recording, settings, "angle", ANGLES, "an order spectrum")
    channel, unit = _channel(recording, settings)
    highest = float(settings.get("highest_order", 64.0))
    warnings = list(
        check_recording(recording, "an order spectrum", evidence.maximum_missed_share).warnings
    )
    ratio = rotary_ratio(recording, evidence.gear.mounted_ratio(recording.metadata.mounting))
    spectra: dict[int, OrderPeaks] = {}
    for segment in _longest_eachway(recording, angle_name):
        angle, value = _channels(recording, segment, angle_name, channel, ratio)
        try:
            spectra[segment.direction] = order_peaks(angle, value, highest_order=highest)
        except ModelError as error:
            warnings.append(f"{way_of(segment.direction)}: {error.what}.")
    if not spectra:
        raise AnalysisError(
            "there is no stretch of a whole revolution in one direction",
            where=recording.metadata.run_id,
            remedy="Record at least one whole revolution.",
        )
    return Result(
        run=recording.metadata.run_id,
        kind=NAME,
        quantities=QUANTITIES,
        estimates=_strongest(spectra, unit),
        metrics={f"revolutions_{way_of(d)}": float(s.revolutions) for d, s in spectra.items()},
        warnings=tuple(warnings),
        plots=(_plot(spectra, channel, unit, angle_name),),
        tables=(_table(spectra, unit),),
        options={"channel": channel, "angle": angle_name},
    )


def _channel(recording: Recording, settings: dict[str, object]) -> tuple[str, str]:
    """The channel and its unit; the kinematic error is made of both angles."""
    both = recording.has("input_angle", "output_angle")
    wanted = settings.get("channel", KINEMATIC_ERROR if both else None)
    if wanted == KINEMATIC_ERROR:
        recording.require("the kinematic error", "input_angle", "output_angle")
        return KINEMATIC_ERROR, "rad"
    name = chosen_channel(recording, settings, "channel", EFFORTS, "an order spectrum")
    return name, recording.signals[name].unit


def _longest_eachway(recording: Recording, angle_name: str) -> list[Segment]:
    """The longest stretch of each direction: of the run's segments, else of what the angle shows."""
    candidates = recording.labelled(*LABELS)
    if not candidates and angle_name == "input_angle":
        candidates = traverses_of(recording, approach=0.0)
    if not candidates:
        way = (
            recording.si(angle_name, slice(recording.rows - 1, None))[0]
            - recording.si(angle_name, slice(0, 1))[0]
        )
        candidates = (
            Segment(
                index=0,
                label="traverse",
                start=0,
                stop=recording.rows,
                setpoint=0.0,
                direction=1 if way >= 0.0 else -1,
            ),
        )
    best: dict[int, Segment] = {}
    for segment in candidates:
        longest = best.get(segment.direction)
        if longest is None or segment.stop - segment.start > longest.stop - longest.start:
            best[segment.direction] = segment
    return [best[d] for d in sorted(best, reverse=True)]


def _channels(
    recording: Recording, segment: Segment, angle_name: str, channel: str, ratio: float
) -> tuple[FloatArray, FloatArray]:
    rows = slice(segment.start, min(segment.stop, segment.start + LARGEST))
    good = usable(recording, rows)
    angle = (
        recording.output_angle(rows)
        if angle_name == "output_angle"
        else recording.si(angle_name, rows)
    )[good]
    if channel == KINEMATIC_ERROR:
        value = recording.output_angle(rows)[good] - recording.si("input_angle", rows)[good] / ratio
    else:
        value = recording.si(channel, rows)[good]
    return angle, value


def _strongest(spectra: dict[int, OrderPeaks], unit: str) -> dict[str, Estimate]:
    """Amplitudes of the strongest orders that rise above the noise, mean of the directions;
    interval from the noise nearby.
    """
    first = spectra[max(spectra)]
    estimates: dict[str, Estimate] = {}
    for order in first.peaks[:STRONGEST].tolist():
        every = [float(np.interp(order, s.orders, s.amplitude)) for s in spectra.values()]
        floors = [float(np.interp(order, s.orders, s.noise_floor)) for s in spectra.values()]
        value = float(np.mean(every))
        # The floor is the mean power of noise: half of it lies in phase with the order.
        half = 1.96 * float(np.sqrt(0.5 * np.mean(np.square(floors)) / len(floors)))
        name = f"amplitude_{order:.6g}"
        estimates[name] = Estimate(
            name=name, value=value, unit=unit, low=max(value - half, 0.0), high=value + half
        )
    return estimates


def _plot(spectra: dict[int, OrderPeaks], channel: str, unit: str, angle_name: str) -> Plot:
    series = tuple(
        series
        for d, s in spectra.items()
        for series in (
            Series(
                label=way_of(d), x=s.orders, y=s.amplitude, style="line", group=0 if d > 0 else 1
            ),
            Series(
                label=f"noise floor, {way_of(d)}",
                x=s.orders,
                y=s.noise_floor,
                style="line",
                group=2 if d > 0 else 3,
            ),
        )
    )
    name = angle_name.replace("_", " ")
    return Plot(
        name="order-spectrum",
        title=f"Orders of the {channel.replace('_', ' ')}",
        x_label=f"order per revolution of the {name}",
        y_label=f"amplitude [{unit}]",
        series=series,
        y_scale="log",
    )


def _table(spectra: dict[int, OrderPeaks], unit: str) -> Table:
    rows: list[tuple[float | int | str, ...]] = []
    for d, s in spectra.items():
        strongest = sorted(range(len(s.orders)), key=lambda k: -s.amplitude[k])[:40]
        rows += [
            (way_of(d), float(s.orders[k]), float(s.amplitude[k]), float(s.phase[k]) / DEGREE)
            for k in strongest
        ]
    columns = ("direction", "order", f"amplitude [{unit}]", "phase [deg]")
    return Table("orders", "Strongest orders", columns, tuple(rows))


EXPERIMENT = Experiment(
    name=NAME,
    title="Order spectrum",
    summary="order spectrum of a channel over an angle",
    parameters=NoParameters,
    plan=no_plan,
    analyse=analyse,
    needs=(),
    has_plan=False,
    quantities=QUANTITIES,
    version=2,
)
