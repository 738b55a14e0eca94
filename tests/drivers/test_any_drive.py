"""Drives with any traits at all: they run or raise a `DriverError`, in bounded time, and their
power is off in the end.
"""

from __future__ import annotations

import contextlib

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.bus.cyclic import CanRig, CanRigConfig
from drivers.bus.motor_encoder import MotorEncoder
from drivers.clock import VirtualClock
from drivers.errors import DriverError
from drivers.port import Command, Guard, Mode
from tests.drivers.foreign_bench import LIMITS
from tests.drivers.foreign_drive import DRIVE_ROWS, ForeignDrive
from tests.drivers.foreign_slave import (
    BAD_VALUE,
    DISABLED,
    ENABLED,
    FAULT,
    NOT_MAPPABLE,
    NOT_NOW,
    ON,
    QUICK,
    REACTION,
    READ_ONLY,
    READY,
    Traits,
    Wire,
)

ENTRIES = sorted(ForeignDrive(Wire(VirtualClock())).od)
CODES = (
    READ_ONLY,
    NOT_MAPPABLE,
    NOT_NOW,
    BAD_VALUE,
    0x06040043,
    0x06070010,
    0x08000000,
    0x05040001,
    0x06010000,
    0x06060000,
)
KEYS = st.sampled_from(ENTRIES)
DRIVES = st.builds(
    Traits,
    nmt=st.sampled_from([0x7F, 5, 4]),
    state=st.integers(0, 7),
    absent=st.frozensets(st.sampled_from(sorted({index for index, _ in ENTRIES})), max_size=4),
    values=st.dictionaries(
        st.sampled_from(sorted(DRIVE_ROWS)), st.sampled_from([0, 1, 2, 3, 127, 255]), max_size=3
    ),
    refused=st.dictionaries(KEYS, st.sampled_from(CODES), max_size=6),
    unreadable=st.frozensets(KEYS, max_size=2),
    mapping=st.sampled_from(["free", "free", "read-only", "present state", "not mappable"]),
    tpdo_type=st.sampled_from([0, 1, 254, 255]),
    is_type_locked=st.booleans(),
    unsized=st.booleans(),
    segmented=st.booleans(),
    answer_ms=st.sampled_from([0.0, 0.0, 20.0, 299.0]),
    transition_ms=st.sampled_from([0, 0, 5, 100, 3000]),
    mode_ms=st.sampled_from([0, 50, 600]),
    reset_ms=st.sampled_from([0, 100, 4000]),
    refuses_reset=st.booleans(),
    drops_to=st.sampled_from(
        [
            {},
            {},
            {ON: DISABLED},
            {ENABLED: FAULT},
            {READY: DISABLED},
            {ENABLED: QUICK},
            {DISABLED: READY},
        ]
    ),
    set_bits=st.sampled_from([0x210, 0, 0xFB90, 0x8200]),
    trembles=st.sampled_from([0, 3]),
)
DAY = (Mode.OFF, Mode.SPEED, Mode.TORQUE, Mode.SPEED, Mode.QUICK_STOP, Mode.OFF)


@given(DRIVES)
@settings(max_examples=25)
def test_any_drive_runs_or_is_refused(traits: Traits) -> None:
    clock = VirtualClock()
    wire = Wire(clock)
    drive = ForeignDrive(wire, traits)
    rig = CanRig(
        CanRigConfig(motor_encoder=MotorEncoder(largest_speed=900.0)),
        clock,
        lambda: wire,
        pump=wire.pump,
        time_base="virtual",
        origin="simulated",
    )
    try:
        rig.open()
    except DriverError:
        return
    with contextlib.suppress(DriverError):
        rig.write_limits(LIMITS)
    for mode in DAY:
        target = np.full(5, 0.01) if mode in (Mode.SPEED, Mode.TORQUE) else np.empty(0)
        with contextlib.suppress(DriverError):
            rig.exchange(Command(mode, target), 5, Guard())
    drive.fail(0x2310)
    for action in (lambda: rig.exchange(Command(Mode.OFF), 5, Guard()), rig.reset_fault):
        with contextlib.suppress(DriverError):
            action()
    rig.close()
    for _ in range(8):
        clock.advance_ns(1_000_000_000)
        wire.pump(0)
    assert not drive.is_powered or drive.state == REACTION
    assert clock.monotonic_ns() < 180e9
