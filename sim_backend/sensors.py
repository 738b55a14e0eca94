"""The instruments of the simulated rig: what is true at a SYNC, as counts of each channel.

Encoders: latched at the true instant of SYNC plus their own delay, wrong by their errors over their own absolute angle,
counted in whole counts; index marks latch the count where the mark stands. Torque port: lag (in the plant), gain, zero
and its drift, noise, steps of the converter. Everything is a pure function of state and cycle index except the index
latches, which are carried.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from drivers import channel as names
from drivers.channel import Calibration, Channel, encoder_channel
from drivers.samples import CycleFlag
from model.kernels import encoder as kernel
from model.kernels import loop_layout as at
from model.loop_tables import error_table
from model.motor import ServoMotor
from model.units import REVOLUTION
from sim_backend.clock import NANOSECOND
from sim_backend.condition import Condition, EncoderErrors
from sim_backend.imperfections import Imperfections
from sim_backend.servo_drive import SPEED_COUNT, TORQUE_COUNT_OF_RATED
from sim_backend.streams import CycleNoise

Array = NDArray[np.float64]
Counts = NDArray[np.int64]

FINE = 4096
"""How many times finer than the real one a channel counts when its steps are switched off."""
_MOTOR_CURRENT = "motor current and its torque constant"
_ADC_RANGE = 2**15 - 1
SLOW = 8
"""Order of its own revolution up to which an encoder's errors are summed one by one; those above are looked up."""
TEMPERATURE_COUNT = 0.01
"""Kelvin per count of the thermometers."""


class Encoder:
    """An incremental encoder with its counter and index latch; `sense` -1 counts down when the
    angle of the plant grows.
    """

    def __init__(
        self,
        channel: Channel,
        errors: EncoderErrors,
        column: int,
        sense: int,
        start: tuple[float, int],
    ) -> None:
        self.quantum = channel.scale
        self._errors, self._column, self._sense = errors, column, float(sense)
        slow = tuple(h for h in errors.series if h.order <= SLOW)
        fine = tuple(h for h in errors.series if h.order > SLOW)
        waves = slow if errors.subdivision is None else (*slow, errors.subdivision)
        # Dozens of cosines for every count would take longer than the plant does.
        self._fine = error_table(fine, 1.0, 1.0)[0] if fine else np.empty((0, 4))
        self._waves = np.array(
            [(h.order, h.amplitude, math.atan2(h.sine, h.cosine)) for h in waves]
        ).reshape(-1, 3)
        angle, count = sense * start[0], start[1]
        shown = kernel.count_at(angle, self._waves, self._fine, self.quantum, 0)
        self._offset = count - int(shown)
        self.latch = np.array([math.floor((angle - errors.index_angle) / REVOLUTION), 0.0, 0.0])

    @property
    def angle_offset(self) -> float:
        """What this counter shows more than the true angle, on average [rad]."""
        return (self._offset - 0.5) * self.quantum

    @property
    def index_angle(self) -> float:
        """Where the index mark stands, in the counter's own angle within a revolution [rad]."""
        return (self._errors.index_angle + self.angle_offset) % REVOLUTION

    def read(self, rows: Array, late: Array) -> tuple[Counts, Counts, NDArray[np.bool_]]:
        """Counts, counts latched at the latest index mark, and whether one was seen (n,) each; carries the latch."""
        counts, indices = np.empty(len(rows), dtype=np.int64), np.empty(len(rows), dtype=np.int64)
        seen = np.empty(len(rows), dtype=np.bool_)
        kernel.read_encoder(
            rows,
            self._column,
            self._sense,
            late,
            self._errors.skew,
            self._waves,
            self._fine,
            self.quantum,
            self._offset,
            self._errors.index_angle,
            self.latch,
            counts,
            indices,
            seen,
        )
        return counts, indices, seen


Latches = tuple[Array, Array]
"""What the instruments carry from block to block: the index latches of input and output encoder."""


class Instruments:
    """All channels of the simulated rig. `output_sense` is -1 where the output turns against the input."""

    def __init__(
        self,
        on: Imperfections,
        condition: Condition,
        motor: ServoMotor,
        seed: int,
        output_sense: int,
        start_output: float,
    ) -> None:
        self._condition = condition
        self.channels = _make_channels(on, motor)
        by_name = {c.name: c for c in self.channels}
        self.column = {c.name: i for i, c in enumerate(self.channels)}
        self.input = Encoder(
            by_name[names.INPUT_ANGLE],
            condition.input_encoder,
            at.ROW_INPUT_ANGLE,
            1,
            (condition.start_angle, condition.input_count),
        )
        self.output = Encoder(
            by_name[names.OUTPUT_ANGLE],
            condition.output_encoder,
            at.ROW_OUTPUT_ANGLE,
            output_sense,
            (start_output, condition.output_count),
        )
        self._torque = by_name[names.TORQUE]
        self._drive_torque = by_name[names.DRIVE_TORQUE]
        self._adc_step = on.sizes.adc_step_counts if on.adc_steps else 1
        self._adc_limit = _ADC_RANGE * _finer(on.adc_steps)
        self._reference = (
            condition.deviations.thermal.reference if condition.deviations.thermal else 22.0
        )
        self._torque_noise = CycleNoise(seed, "torque noise")
        self._housing_noise = CycleNoise(seed, "housing temperature")
        self._ambient_noise = CycleNoise(seed, "ambient temperature")

    def read(
        self,
        rows: Array,
        first_cycle: int,
        lateness_ns: Counts,
        statuswords: Counts,
        targets: tuple[Counts, Counts],
    ) -> tuple[Counts, NDArray[np.uint16]]:
        """Counts (n, channels) and flags (n,) of rows (n, ROW_SIZE); `targets` are speed and torque
        set-points in counts.
        """
        n = len(rows)
        # One channel after the other in memory: everybody behind the port works on whole channels.
        counts = np.zeros((n, len(self.channels)), dtype=np.int64, order="F")
        late = lateness_ns.astype(np.float64) * NANOSECOND
        put = self.column
        inputs, outputs = self.input.read(rows, late), self.output.read(rows, late)
        counts[:, put[names.INPUT_ANGLE]], counts[:, put[names.INPUT_INDEX]] = inputs[:2]
        counts[:, put[names.OUTPUT_ANGLE]], counts[:, put[names.OUTPUT_INDEX]] = outputs[:2]
        counts[:, put[names.INDEX_SEEN]] = inputs[2] + 2 * outputs[2]
        torque, saturated = self._port_counts(rows, first_cycle)
        counts[:, put[names.TORQUE]] = torque
        reference = rows[:, at.ROW_TORQUE_REFERENCE]
        counts[:, put[names.DRIVE_TORQUE]] = np.rint(reference / self._drive_torque.scale).astype(
            np.int64
        )
        counts[:, put[names.TARGET_SPEED]], counts[:, put[names.TARGET_TORQUE]] = targets
        counts[:, put[names.STATUSWORD]] = statuswords
        counts[:, put[names.HOUSING_TEMPERATURE]] = self._temperature(
            rows[:, at.ROW_HOUSING] + self._condition.housing_offset,
            self._housing_noise,
            first_cycle,
        )
        room = np.full(n, self._condition.ambient)
        counts[:, put[names.AMBIENT_TEMPERATURE]] = self._temperature(
            room, self._ambient_noise, first_cycle
        )
        return counts, saturated * np.uint16(CycleFlag.SATURATED)

    def pass_by(self, rows: Array) -> None:
        """Rows of truth that nobody reads: only the index latches see them."""
        late = np.zeros(len(rows))
        self.input.read(rows, late)
        self.output.read(rows, late)

    def latches(self) -> Latches:
        """What must be carried to go on from here."""
        return self.input.latch.copy(), self.output.latch.copy()

    def restore(self, latches: Latches) -> None:
        """Go on from there."""
        self.input.latch[:], self.output.latch[:] = latches

    def _port_counts(self, rows: Array, first_cycle: int) -> tuple[Counts, NDArray[np.bool_]]:
        """Counts of the torque port, and where the converter is at its end."""
        port = self._condition.torque_port
        reading = rows[:, at.ROW_PORT_TORQUE] * (1.0 + port.gain_error) + port.offset
        if port.drift_per_kelvin:
            reading += port.drift_per_kelvin * (rows[:, at.ROW_MOTOR] - self._reference)
        if port.noise:
            reading += port.noise * self._torque_noise.at(first_cycle, len(rows))
        step = self._adc_step
        counts = np.rint(reading / (self._torque.scale * step)).astype(np.int64) * step
        saturated = np.abs(counts) >= self._adc_limit
        return np.where(saturated, np.sign(counts) * self._adc_limit, counts), saturated

    def _temperature(self, truth: Array, noise: CycleNoise, first_cycle: int) -> Counts:
        sigma = self._condition.temperature_noise
        if sigma:
            truth = truth + sigma * noise.at(first_cycle, len(truth))
        return np.rint(truth / TEMPERATURE_COUNT).astype(np.int64)


def _finer(has_steps: bool) -> int:
    """How many times finer than the real one a channel counts."""
    return 1 if has_steps else FINE


def _make_channels(on: Imperfections, motor: ServoMotor) -> tuple[Channel, ...]:
    """The channels of the simulated rig in the order of its columns, with the uncertainties that its sizes imply."""
    sizes = on.sizes
    adc = (
        sizes.adc_volts * sizes.torque_per_volt_of_rated * motor.rated_torque / _finer(on.adc_steps)
    )
    reported = motor.rated_torque * TORQUE_COUNT_OF_RATED
    certificate = "simulated instrument"
    # The monitor port and the drive's own word are one current and one torque constant.
    torque = Calibration(
        certificate=certificate,
        sensor=_MOTOR_CURRENT,
        scale_relative_uncertainty=math.hypot(sizes.torque_scale, sizes.torque_constant),
        offset_uncertainty=sizes.torque_offset,
    )
    drive = Calibration(
        certificate=certificate,
        sensor=_MOTOR_CURRENT,
        scale_relative_uncertainty=sizes.torque_constant,
    )
    thermometer = Calibration(certificate=certificate, offset_uncertainty=sizes.temperature_offset)
    drive_step = reported / _finer(on.drive_torque_steps)
    housing, room = "temperature of the gear housing", "temperature of the room"
    return (
        _encoder_channel(on, names.INPUT_ANGLE, "motor encoder"),
        _encoder_channel(on, names.OUTPUT_ANGLE, "output encoder"),
        _channel(names.TORQUE, "N m", adc, "torque monitor port", torque),
        _channel(
            names.DRIVE_TORQUE, "N m", drive_step, "torque reported by the drive (0x6077)", drive
        ),
        _channel(names.TARGET_SPEED, "rad/s", SPEED_COUNT, "speed set-point (0x60FF)"),
        _channel(names.TARGET_TORQUE, "N m", reported, "torque set-point (0x6071)"),
        _encoder_channel(on, names.INPUT_INDEX, "input angle at its index mark"),
        _encoder_channel(on, names.OUTPUT_INDEX, "output angle at its index mark"),
        _channel(names.INDEX_SEEN, "1", 1.0, "index marks seen (bit 0 input, bit 1 output)"),
        _channel(names.STATUSWORD, "1", 1.0, "statusword (0x6041)"),
        _channel(names.HOUSING_TEMPERATURE, "degC", TEMPERATURE_COUNT, housing, thermometer),
        _channel(names.AMBIENT_TEMPERATURE, "degC", TEMPERATURE_COUNT, room, thermometer),
    )


def _channel(
    name: str, unit: str, scale: float, long_name: str, calibration: Calibration | None = None
) -> Channel:
    """A channel of a simulated instrument; without a calibration it has none of its own to state."""
    channel = Channel(name=name, unit=unit, scale=scale, long_name=long_name, model="simulated")
    return channel if calibration is None else replace(channel, calibration=calibration)


def _encoder_channel(on: Imperfections, name: str, long_name: str) -> Channel:
    """A channel of the input or the output encoder; its accuracy is the half width of its whole curve."""
    sizes = on.sizes
    lines, accuracy = sizes.output_lines, sizes.output_accuracy
    if name in (names.INPUT_ANGLE, names.INPUT_INDEX):
        lines, accuracy = sizes.input_lines, sizes.input_accuracy
    return encoder_channel(
        name,
        lines=lines,
        multiplication=sizes.multiplication * _finer(on.quantisation),
        long_name=long_name,
        model="simulated",
        calibration=Calibration(certificate="simulated instrument", accuracy=accuracy),
    )
