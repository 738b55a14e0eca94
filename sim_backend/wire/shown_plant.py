"""What stands behind the devices of the wire bench: one plant, cycle by cycle, and what each device is shown of it.

At each cycle the device faults act, what is true becomes counts, the signal faults spoil them, every device takes its
own, and the plant goes on by the set-point that the drive holds. Plant, instruments and noise streams are those of
`sim_backend.direct`, so that the same commands give the same counts.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers import channel as names
from drivers.channel import Channel
from drivers.port import Mode
from drivers.samples import CycleFlag
from model import closed_loop
from model.kernels import loop_layout as at
from model.motor import ServoMotor
from model.units import REVOLUTION, RPM
from sim_backend.assembly import Assembly
from sim_backend.faults import DeviceFault, Devices, Fault, Sensed, SignalFault
from sim_backend.servo_drive import ServoDrive
from sim_backend.wire.analog_amplifier import AnalogAmplifier
from sim_backend.wire.analog_input import AnalogInput
from sim_backend.wire.counter import Counter
from sim_backend.wire.drive import Drive
from sim_backend.world import ThermalState

Counts = NDArray[np.int64]

SPEED_MONITOR = 0.3125e-3 / 1.0 * 1000.0 * RPM
"""rad/s per increment of the speed monitor: 1 V per 1000 r/min."""
_HAND_RESTS = 0.3
"""s for which a hand holds the shaft once it has turned it."""
_CHUNK = 1024
_LOOP_MODE = {
    Mode.OFF: closed_loop.OFF,
    Mode.SPEED: closed_loop.SPEED,
    Mode.TORQUE: closed_loop.TORQUE,
    Mode.QUICK_STOP: closed_loop.QUICK_STOP,
}
_POWER_STAGE_ERROR = 0x2310


class _TrippedDrive(ServoDrive):
    """The direct rig's drive as its faults see it; a trip falls on the drive on the wire."""

    def __init__(self, motor: ServoMotor, trip: Callable[[], None]) -> None:
        super().__init__(motor)
        self._trip = trip

    def trip(self) -> None:
        self._trip()


class ShownPlant:
    """One plant and its instruments behind the devices that `WireBench` puts in front of them."""

    drive: Drive | AnalogAmplifier
    counter: Counter
    analog_input: AnalogInput
    motor_counter: Counter | None

    def __init__(self, assembly: Assembly, cycle_ns: int) -> None:
        self._assembly, self.cycle_ns = assembly, cycle_ns
        self.plant, self.instruments = assembly.plant, assembly.instruments
        self._column = self.instruments.column
        self._devices = Devices(
            self.plant,
            _TrippedDrive(
                assembly.motor, lambda: self.drive.fault(_POWER_STAGE_ERROR, coasts=True)
            ),
        )
        self._faults: tuple[Fault, ...] = ()
        self._cycle: int = 0
        self._late: Counts = np.empty(0, dtype=np.int64)
        self._late_from = -1
        self._previous: Counts | None = None
        self._counts: Counts = np.zeros(len(self.channels), dtype=np.int64)

    @property
    def channels(self) -> Sequence[Channel]:
        """The channels of the direct rig, in its order."""
        return self.instruments.channels

    @property
    def cycle(self) -> int:
        """How many SYNC cycles the plant has run."""
        return self._cycle

    @property
    def input_speed(self) -> float:
        """The true speed of the input now [rad/s], whatever the devices say."""
        return self.plant.input_speed

    @property
    def thermal_state(self) -> ThermalState:
        """How warm the rig is now."""
        return self.plant.thermal_state

    @property
    def mean_temperatures(self) -> ThermalState:
        """How warm the rig was on average since it started."""
        return self.plant.mean_temperatures

    @functools.cached_property
    def truth(self) -> dict[str, Any]:
        """Every effective parameter of this rig on this day, as of the direct rig."""
        return self._assembly.truth()

    def turn_by_hand(self, turns: float, speed: float = 2.0 * REVOLUTION) -> None:
        """Somebody turns the input shaft evenly, at `speed` [rad/s], whatever the drive does, and lets it rest."""
        per_second = 1e9 / self.cycle_ns
        turning = round(turns * REVOLUTION / speed * per_second)
        for target in (*[speed] * turning, *[0.0] * round(_HAND_RESTS * per_second)):
            rows = self.plant.advance(_LOOP_MODE[Mode.SPEED], np.array([target]))
            self._show(rows, self._lateness(self._cycle))
            self._cycle += 1

    def _lateness(self, cycle: int) -> int:
        """How much later than nominal this SYNC comes [ns]; drawn for many cycles at once."""
        start = cycle - cycle % _CHUNK
        if start != self._late_from:
            self._late, self._late_from = self._assembly.sync.lateness_ns(start, _CHUNK), start
        return int(self._late[cycle - start])

    def _demand(self) -> tuple[int, float]:
        """Loop mode and set-point of this cycle, after the device faults have acted."""
        self._let_device_faults_act(self._devices)
        mode, target = self.drive.demand()
        forced = self._devices.forced
        if forced is not None and mode in (Mode.SPEED, Mode.TORQUE):
            mode, target = forced
        return _LOOP_MODE[mode], target

    def _let_device_faults_act(self, devices: Devices) -> None:
        devices.forced, devices.keeps_turning, devices.load = None, False, 0.0
        for fault in self._faults:
            if isinstance(fault, DeviceFault) and fault.active(self._cycle):
                fault.fall_on(devices, self._cycle)
        self.plant.load = devices.load
        self.drive.ignores_stop = devices.keeps_turning

    def _advance_plant(self) -> None:
        """One cycle: what is true at this SYNC becomes the devices' values, then the set-point acts."""
        if self.drive.limits_changed:
            self.drive.limits_changed = False
            self.plant.write_limits(self._devices.drive.stored(self.drive.limits()))
        loop_mode, target = self._demand()
        rows = self.plant.advance(loop_mode, np.array([target]))
        self._show(rows, self._lateness(self._cycle))

    def _show(self, rows: NDArray[np.float64], lateness_ns: int) -> None:
        none = np.zeros(1, dtype=np.int64)
        late = np.array([lateness_ns], dtype=np.int64)
        counts, flags = self.instruments.read(rows, self._cycle, late, none, (none, none))
        if self._faults:
            self._corrupt(counts, flags)
        self._previous = self._counts = counts[0]
        self._take(counts[0].tolist(), float(rows[0, at.ROW_INPUT_SPEED]))

    def _corrupt(self, counts: Counts, flags: NDArray[np.uint16]) -> None:
        sensed = Sensed(self._cycle, counts, flags, self._column, self._previous)
        for fault in self._faults:
            if isinstance(fault, SignalFault):
                fault.fall_on(sensed)
        self.counter.signal_error(bool(flags[0] & CycleFlag.SIGNAL_ERROR))

    def _take(self, counts: list[int], speed: float) -> None:
        put = self._column
        seen = counts[put[names.INDEX_SEEN]]
        input_angle, input_index = counts[put[names.INPUT_ANGLE]], counts[put[names.INPUT_INDEX]]
        if isinstance(self.drive, AnalogAmplifier):
            self.drive.take(speed)
        else:
            torque = counts[put[names.DRIVE_TORQUE]]
            self.drive.take(input_angle, torque, input_index, seen & 1, speed)
        if self.motor_counter is not None:
            self.motor_counter.take(input_angle, input_index, seen & 1)
        self.counter.take(
            counts[put[names.OUTPUT_ANGLE]], counts[put[names.OUTPUT_INDEX]], seen >> 1 & 1
        )
        self.analog_input.take(
            (
                counts[put[names.TORQUE]],
                round(speed / SPEED_MONITOR),
                counts[put[names.HOUSING_TEMPERATURE]],
                counts[put[names.AMBIENT_TEMPERATURE]],
            )
        )

    def _read_at_rest(self) -> None:
        """What the devices show before the first SYNC; plant and latches stay as they are."""
        before, latches = self.plant.snapshot(), self.instruments.latches()
        none = np.zeros(1, dtype=np.int64)
        rows = self.plant.advance(closed_loop.OFF, np.zeros(1))
        counts, _ = self.instruments.read(rows, 0, none, none, (none, none))
        self.plant.restore(before)
        self.instruments.restore(latches)
        self._counts = counts[0]
        self._take(counts[0].tolist(), 0.0)
