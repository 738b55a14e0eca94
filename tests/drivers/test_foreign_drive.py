"""Drives that do what CiA 301 and CiA 402 allow, in every shape: they run, or are refused in words
that name the object.

Never a hang, never another exception than `DriverError`, never power after an error.
"""

from __future__ import annotations

import contextlib

import pytest

from drivers.bus.cyclic import CanRig, CanRigConfig
from drivers.bus.motor_encoder import MotorEncoder
from drivers.bus.sdo import SdoAbortError, SdoProtocolError, SdoTimeoutError
from drivers.clock import VirtualClock
from drivers.errors import DriverError
from drivers.port import Mode
from tests.drivers.foreign_bench import RPM, bench
from tests.drivers.foreign_drive import ForeignDrive
from tests.drivers.foreign_slave import (
    DISABLED,
    ENABLED,
    FAULT,
    NOT_NOW,
    NOT_READY,
    ON,
    QUICK,
    REACTION,
    READ_ONLY,
    READY,
    Traits,
    Wire,
)

TPDOS = ((0x60410010, 0x60640020), (0x60770010,), (), ())
RPDOS = ((0x60400010, 0x60FF0020), (0x60710010,), (), ())
"""A vendor's fixed mapping that carries everything."""


def refused(traits: Traits, error: type[DriverError], words: str) -> None:
    """The rig does not open, and says this."""
    with bench(traits) as made, pytest.raises(error, match=words):
        made.rig.open()


# Whole days with drives that differ ---------------------------------------------------------------

FULL = {
    "as it comes": Traits(),
    "found in fault": Traits(state=FAULT), "found enabled, operational": Traits(state=ENABLED, nmt=5),
    "found in quick stop": Traits(state=QUICK), "found ready, stopped": Traits(state=READY, nmt=4),
    "found switched on": Traits(state=ON, nmt=5),
    "found enabled, trembling, stays in quick stop": Traits(
        state=ENABLED, trembles=3, values={(0x605A, 0): 6}, refused={(0x605A, 0): READ_ONLY}
    ),
    "mapping read-only": Traits(mapping="read-only", tpdo_maps=TPDOS, rpdo_maps=RPDOS),
    "mapping fixed in this state": Traits(mapping="present state", tpdo_maps=TPDOS, rpdo_maps=RPDOS),
    "entries not mappable": Traits(mapping="not mappable", tpdo_maps=TPDOS, rpdo_maps=RPDOS),
    "mapping fixed, PDOs off": Traits(
        mapping="read-only", tpdo_cobs=(0xC0000181, 0xC0000281, 0xC0000381, 0xC0000481), tpdo_maps=TPDOS, rpdo_maps=RPDOS  # noqa: E501
    ),
    "mapping fixed, types locked": Traits(mapping="read-only", is_type_locked=True, tpdo_maps=TPDOS, rpdo_maps=RPDOS),
    "first TPDO not by SYNC": Traits(refused={(0x1800, 2): READ_ONLY}),
    "PDOs without identifier": Traits(tpdo_cobs=(0x80000000, 0xC0000281, 0x80000000, 0x80000000)),
    "a PDO with 29 bits": Traits(tpdo_cobs=(0x60000181, 0x40000281, 0x40000381, 0x40000481)),
    "mode can only be written": Traits(
        mapping="read-only", tpdo_maps=TPDOS, unreadable=frozenset({(0x6060, 0)}),
        rpdo_maps=((0x60400010, 0x60600008, 0x60FF0020), (0x60710010,), (), ()),
    ),
    "no 0x6502": Traits(absent=frozenset({0x6502})),
    "hardly any options": Traits(
        absent=frozenset({0x605A, 0x6007, 0x605E, 0x60C2, 0x6085, 0x1016, 0x1014, 0x1018, 0x1008, 0x1000})
    ),
    "no heartbeat": Traits(absent=frozenset({0x1017, 0x1016})), "no mode display": Traits(absent=frozenset({0x6061, 0x606C})),  # noqa: E501
    "no size told": Traits(unsized=True), "everything in segments": Traits(segmented=True),
    "segments, no size told": Traits(segmented=True, unsized=True), "slow answers": Traits(answer_ms=100),
    "no voltage, no remote, makers' bits": Traits(set_bits=0xC980), "warning and limit": Traits(set_bits=0x0A90),
    "slow transitions": Traits(transition_ms=20), "very slow transitions": Traits(transition_ms=400),
    "mode shown late": Traits(mode_ms=300), "fault reset takes long": Traits(reset_ms=1500),
    "a slow heartbeat of its own": Traits(values={(0x1017, 0): 5000}, refused={(0x1017, 0): READ_ONLY}),
    **{f"quick stop option {n}": Traits(values={(0x605A, 0): n}, refused={(0x605A, 0): READ_ONLY}) for n in (0, 1, 2, 5, 6)},  # noqa: E501
}  # fmt: skip


@pytest.mark.parametrize("name", FULL)
def test_it_is_brought_up_turned_stopped_and_put_back_after_a_fault(name: str) -> None:
    with bench(FULL[name]) as made:
        drive = made.drive
        made.open()
        assert drive.state == DISABLED
        assert not made.exchange(Mode.OFF).flags.any()
        block = made.exchange(Mode.SPEED, 100 * RPM, 10)
        assert (block.broken, drive.state, drive.speed, block.flags.any()) == (
            None,
            ENABLED,
            100,
            False,
        )
        made.exchange(Mode.QUICK_STOP, cycles=900)
        assert drive.speed == 0
        made.exchange(Mode.OFF, cycles=900)
        assert drive.state == DISABLED
        made.exchange(Mode.TORQUE, 0.0637, 5)
        assert (drive.state, drive.mode_shown in (0, 4, 10), drive.speed) == (ENABLED, True, 500)
        made.exchange(Mode.SPEED, 0.0, 5)
        assert drive.speed == 0
        drive.fail(0x2310)
        assert made.exchange(Mode.SPEED, 10.0).broken is not None
        with contextlib.suppress(DriverError):
            made.exchange(Mode.SPEED, 10.0)
        assert drive.state == FAULT
        made.exchange(Mode.OFF)
        made.rig.reset_fault()
        assert drive.state == DISABLED
        made.exchange(Mode.SPEED, 10 * RPM, 5)
        assert drive.speed == 10
        made.exchange(Mode.OFF)


@pytest.mark.parametrize(
    ("traits", "error", "words"),
    [
        (
            Traits(state=NOT_READY),
            DriverError,
            r"does not reach servo off; value not ready to switch on \(0x0210\)",
        ),
        (Traits(answer_ms=400), SdoTimeoutError, "node 1, 0x1000:0: no SDO answer"),
        (Traits(wrong_toggle=True), SdoProtocolError, "0x1008:0: the toggle bit did not alternate"),
        (
            Traits(values={(0x1005, 0): 0x81}, refused={(0x1005, 0): READ_ONLY}),
            DriverError,
            "0x1005:0: the device follows another",
        ),
        (
            Traits(values={(0x1005, 0): 0x40000080}, refused={(0x1005, 0): NOT_NOW}),
            DriverError,
            "0x1005:0: the device produces SYNC",
        ),
        (
            Traits(mapping="read-only", tpdo_cobs=(0x181,) * 4),
            DriverError,
            r"two PDOs share a COB-ID; value node 1 TPDO1 \(0x181\)",
        ),
        (
            Traits(mapping="read-only", tpdo_maps=((0x60410010,), (), (), ())),
            DriverError,
            "transferred by PDO; value 0x6064:0",
        ),
        (
            Traits(mapping="read-only", refused={(0x1800, 2): READ_ONLY}),
            DriverError,
            "0x1800:2: a TPDO cannot be tied to every SYNC",
        ),
        (Traits(absent=frozenset({0x6041})), SdoAbortError, "0x6041:0"),
    ],
)
def test_what_cannot_run_is_refused_and_named(
    traits: Traits, error: type[DriverError], words: str
) -> None:
    refused(traits, error, words)


def test_a_fault_reaction_that_does_not_end_is_no_servo_off() -> None:
    clock = VirtualClock()
    wire = Wire(clock)
    ForeignDrive(wire, Traits(state=REACTION))
    rig = CanRig(
        CanRigConfig(motor_encoder=MotorEncoder(largest_speed=900.0)),
        clock,
        lambda: wire,
        pump=wire.pump,
    )
    with pytest.raises(DriverError, match="the end of the fault reaction"):
        rig.open()


# Refusals in the middle of a day ------------------------------------------------------------------


def test_a_drive_that_falls_back_again_and_again_is_given_up() -> None:
    """Main power off, say: it leaves SWITCHED ON at once for SWITCH ON DISABLED. It was pushed for ever."""
    with bench(Traits(drops_to={ON: DISABLED})) as made:
        made.open()
        with pytest.raises(DriverError, match="does not reach operation enabled"):
            made.exchange(Mode.SPEED, 1.0)
        assert made.drive.controls[-1] == 0


def test_a_drive_that_would_be_enabled_after_the_error_is_not() -> None:
    with bench(Traits(transition_ms=2400)) as made:
        made.open()
        with pytest.raises(DriverError, match="does not reach operation enabled"):
            made.exchange(Mode.SPEED, 1.0)
        for _ in range(10):
            made.clock.advance_ns(1_000_000_000)
            made.wire.pump(0)
        assert not made.drive.is_powered
        assert not made.drive.is_enabled_ever


def test_a_drive_that_drops_out_at_once_is_seen_in_the_first_cycle() -> None:
    with bench(Traits(drops_to={ENABLED: DISABLED})) as made:
        made.open()
        block = made.exchange(Mode.SPEED, 1.0)
        assert block.broken is not None
        assert (block.broken.cause, block.broken.row) == ("drive_state", 0)


def test_a_fault_that_stays_is_told_with_its_text_and_is_not_touched_at_the_end() -> None:
    with bench(Traits(refuses_reset=True)) as made:
        made.open()
        made.drive.fail(0x7305)
        made.exchange(Mode.OFF)
        with pytest.raises(DriverError, match="cannot be reset: 0x7305 incremental sensor 1 fault"):
            made.rig.reset_fault()
        with pytest.raises(DriverError, match="is in fault: 0x7305"):
            made.exchange(Mode.SPEED, 1.0)
        made.drive.controls.clear()
        made.rig.close()
        assert 0x80 not in made.drive.controls


def test_a_fault_is_not_acknowledged_by_closing() -> None:
    with bench() as made:
        made.open()
        made.drive.fail(0x4310)
        made.exchange(Mode.OFF)
        made.rig.close()
        assert (made.drive.state, made.drive.code) == (FAULT, 0x4310)


@pytest.mark.parametrize(
    ("absent", "mode", "words"),
    [
        ({0x6071}, Mode.TORQUE, "no set-points for cyclic torque"),
        ({0x60FF}, Mode.SPEED, "no set-points for cyclic velocity"),
        ({0x6080}, Mode.TORQUE, "needs a speed limit that the drive holds itself"),
        ({0x6060}, Mode.SPEED, "0x6060:0"),
    ],
)
def test_a_mode_that_lacks_an_object_is_refused_and_the_object_stands_among_the_missing(
    absent: set[int], mode: Mode, words: str
) -> None:
    with bench(Traits(absent=frozenset(absent))) as made:
        made.open()
        with pytest.raises(DriverError, match=words):
            made.exchange(mode, 0.01)
        missing = {m.index for m in made.rig.missing()[1]}
        assert absent <= missing or absent == {0x6060}
        assert not made.drive.is_powered


def test_a_set_point_that_no_rpdo_carries_is_refused_not_lost() -> None:
    """A fixed mapping without 0x6071: the drive would be enabled in torque mode and hear no set-point."""
    with bench(Traits(mapping="read-only")) as made:
        made.open()
        with pytest.raises(DriverError, match="target_torque: this drive takes no set-points"):
            made.exchange(Mode.TORQUE, 0.1)
        made.exchange(Mode.SPEED, 100 * RPM, 5)
        assert made.drive.speed == 100


def test_a_drive_that_restarts_is_not_enabled_again_before_the_rig_is_opened_anew() -> None:
    for traits in (Traits(), Traits(absent=frozenset({0x1017}))):
        with bench(traits) as made:
            made.open()
            made.exchange(Mode.SPEED, 10.0)
            made.drive.reboot()
            made.drive.is_enabled_ever = False
            assert made.exchange(Mode.SPEED, 10.0).broken is not None
            for mode in (Mode.SPEED, Mode.TORQUE):
                with pytest.raises(DriverError, match="node 1: the node has restarted"):
                    made.exchange(mode, 0.01)
            assert not made.drive.is_enabled_ever
            made.rig.close()
            made.open()
            assert made.exchange(Mode.SPEED, 10 * RPM).broken is None
            assert made.drive.speed == 10


def test_a_drive_that_answers_no_more_is_let_go_by_process_data() -> None:
    """Without 0x1016 nothing else would take its power when the computer goes away."""
    with bench(Traits(absent=frozenset({0x1016, 0x1017}))) as made:
        made.open()
        made.exchange(Mode.SPEED, 10.0)
        made.drive.serve = lambda request: None  # type: ignore[method-assign]
        made.rig.close()
        made.wire.pump(0)
        assert made.drive.state == DISABLED
        assert "close" in [event.code for event in made.events()]


@pytest.mark.parametrize(
    ("absent", "words"),
    [
        (set(), "does not become OPERATIONAL; value BOOT_UP"),
        ({0x1017}, "the node has restarted"),
    ],
)
def test_a_restart_while_the_rig_is_being_opened_is_an_error(absent: set[int], words: str) -> None:
    with bench(Traits(absent=frozenset(absent))) as made:
        prepare = made.rig.segment._prepare

        def interrupted(*arguments: object) -> None:
            prepare(*arguments)  # type: ignore[arg-type]
            made.drive.reboot()

        made.rig.segment._prepare = interrupted  # type: ignore[method-assign]
        with pytest.raises(DriverError, match=words):
            made.rig.open()
