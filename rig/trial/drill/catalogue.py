"""The list of what is drilled: each fault by name, what it is, which simulated rig carries it, and when it happens."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

from drivers import channel as names
from drivers.port import STALE_DATA
from drivers.samples import CycleFlag
from rig.run import trips
from rig.run.make_safe import Stage
from rig.run.stop import StopRequest
from rig.trial.drill.cause import (
    ABORT,
    NO_VALUE,
    NOTHING,
    RECORDER,
    STOP,
    marked,
    not_obeyed,
    reading_refused,
    refused,
)
from rig.trial.drill.rigs import Carrier
from sim_backend import faults as plain
from sim_backend.faults import Fault
from sim_backend.wire import analog_faults as analog
from sim_backend.wire import box_faults as box
from sim_backend.wire import faults as wire
from sim_backend.wire import strangers
from sim_backend.wire.analog_amplifier import NO_ALARM
from sim_backend.wire.bench import ANALOG_INPUT_NODE, COUNTER_NODE, DRIVE_NODE, WireBench

Moment = Literal[
    "preflight",
    "zero-before",
    "switching-on",
    "ramp",
    "hold",
    "reversal",
    "stand",
    "torque-ramp",
    "zero-after",
    "making-safe",
    "start",
]
"""When it happens: in the middle of a segment of the drill's protocol, or between them; "start":
before the rig is opened.
"""
Recording = Literal["", "disk full", "disk nearly full", "writer stalled"]
Readout = Literal["", "garbage", "half lines", "silent", "encoder fault"]

BOTH: tuple[Carrier, ...] = ("sim", "wire", "wire-box", "wire-csp", "wire-analog")
SIM: tuple[Carrier, ...] = ("sim",)
WIRE: tuple[Carrier, ...] = ("wire", "wire-box", "wire-csp", "wire-analog")
WIRE_OR_SIM: tuple[Carrier, ...] = ("wire", "sim", "wire-box", "wire-csp", "wire-analog")
BUS_COUNTER: tuple[Carrier, ...] = ("wire", "wire-csp", "wire-analog")
"""What goes wrong with the counter on the bus, which the rig with a box does not have."""
BOX: tuple[Carrier, ...] = ("wire-box",)
CIA_402: tuple[Carrier, ...] = ("wire", "wire-box", "wire-csp")
"""What goes wrong with a drive on the bus: modes, limits and options that it holds itself."""
TWO_TORQUES: tuple[Carrier, ...] = ("wire", "sim", "wire-box", "wire-csp")
"""Where the drive tells its own torque: nobody else knows that the torque port says something else."""
TORQUE: tuple[Carrier, ...] = ("sim", "wire", "wire-box", "wire-csp")
"""What goes wrong while torque is commanded."""
BY_POSITION: tuple[Carrier, ...] = ("wire-csp",)
"""What goes wrong with a drive that is led by target positions."""
REFERENCE: tuple[Carrier, ...] = ("wire-analog",)
SPEED_MODES: tuple[Carrier, ...] = ("wire", "wire-csp", "wire-pv")
"""A drive by target velocity, by target position and by profile velocity: what another master on the bus can spoil."""
ANY_DRIVE: tuple[Carrier, ...] = (*SPEED_MODES, "wire-box", "wire-analog")


@dataclass(frozen=True, kw_only=True)
class Drill:
    """One fault: what it is in words, the cause that must be detected, when and on which rigs it
    happens, and whether it must do no harm.

    `cause` may differ between carriers; `NOTHING` where there is nothing to detect. `carriers` in
    order of preference. `press` is what the operator does; `fault` is what the rig does, made for
    a cycle; `recording` and `readout` are faults of the computer's disk and of the readout's line.
    Where it `is_unheard`, nobody can be heard any more and software cannot verify standstill.
    """

    name: str
    what: str
    cause: str | Mapping[Carrier, str]
    fault: Callable[[int], Fault] | None = None
    carriers: tuple[Carrier, ...] = WIRE
    moment: Moment = "hold"
    is_harmless: bool = False
    press: Callable[[StopRequest], None] | None = None
    prepare: Callable[[WireBench], None] | None = None
    limits_factor: float = 1.0
    recording: Recording = ""
    readout: Readout = ""
    is_unheard: bool = False

    @property
    def claims_detection(self) -> bool:
        """Whether there is something to detect."""
        return self.cause != NOTHING

    def cause_on(self, carrier: Carrier) -> str:
        """The cause that must be detected on this rig."""
        if isinstance(self.cause, str):
            return self.cause
        return self.cause.get(carrier) or self.cause["wire"]

    def taken_out(self) -> Drill:
        """The same run with a fault that does nothing. A press that only gives it its occasion stays."""
        return replace(
            self,
            fault=Fault if self.fault is not None else None,
            press=self.press if self.fault is not None else None,
            prepare=None,
            limits_factor=1.0,
            recording="",
        )


@dataclass(frozen=True)
class LateNowAndThen(wire.TpdoLate):
    """Process data of every tenth cycle arrive after the next SYNC."""

    def active(self, cycle: int) -> bool:
        return super().active(cycle) and (cycle - self.at_cycle) % 10 == 0


def _narrow_counter(bench: WireBench) -> None:
    """A counter whose declared measuring range is 2048 counts: it wraps about every 10 degrees of the output."""
    bench.counter.dictionary.store(0x6002, 0, 2048)


def _abort(stop: StopRequest) -> None:
    stop.press()
    stop.press()


_DEVICES = (
    Drill(
        name="heartbeat lost, drive",
        cause=trips.HEARTBEAT_LOST,
        what="the drive's heartbeat stays away",
        fault=lambda at: wire.HeartbeatLost(at, DRIVE_NODE),
    ),
    Drill(
        name="heartbeat lost, counter",
        cause=trips.HEARTBEAT_LOST,
        what="the counter's heartbeat stays away",
        fault=lambda at: wire.HeartbeatLost(at, COUNTER_NODE),
        carriers=BUS_COUNTER,
    ),
    Drill(
        name="node reset in motion, drive",
        cause=trips.BOOT_UP,
        what="the drive restarts",
        fault=lambda at: wire.NodeReset(at, DRIVE_NODE),
    ),
    Drill(
        name="node reset in motion, counter",
        cause=trips.BOOT_UP,
        what="the counter restarts",
        fault=lambda at: wire.NodeReset(at, COUNTER_NODE),
        carriers=BUS_COUNTER,
    ),
    Drill(
        name="node dead, analog input",
        cause=STALE_DATA,
        what="the analog module says nothing",
        fault=lambda at: wire.NodeSilent(at, ANALOG_INPUT_NODE),
    ),
    Drill(
        name="EMCY",
        cause=trips.EMERGENCY,
        what="the drive sends an emergency message and goes on",
        fault=wire.EmergencyMessage,
    ),
    Drill(
        name="statusword fault",
        cause=trips.DRIVE_FAULT,
        what="the drive faults and stops by its fault reaction",
        fault=wire.DriveTrip,
    ),
    Drill(
        name="statusword fault, motor coasts",
        cause={
            "sim": trips.DRIVE_FAULT,
            "wire": trips.EMERGENCY,
            "wire-analog": trips.DRIVE_FAULT,
        },
        what="the power stage trips",
        fault=plain.DriveFault,
        carriers=BOTH,
    ),
    Drill(
        name="run-away",
        cause=trips.OVER_SPEED,
        what="the drive goes to 250 rad/s by itself",
        fault=lambda at: plain.RunAway(at, speed=250.0, cycles=400),
        carriers=WIRE_OR_SIM,
    ),
    Drill(
        name="quick stop not obeyed",
        cause={
            "wire": not_obeyed(Stage.QUICK_STOP),
            "wire-analog": not_obeyed(Stage.ZERO_REFERENCE),
        },
        what="the drive faults its quick stop and turns on, after an ABORT",
        fault=wire.QuickStopNotObeyed,
        press=_abort,
    ),
    Drill(
        name="quick stop and servo off not obeyed",
        cause={
            "wire": not_obeyed(Stage.QUICK_STOP),
            "wire-analog": not_obeyed(Stage.ZERO_REFERENCE),
        },
        what="for half a second the drive obeys nothing, after an ABORT",
        fault=lambda at: plain.QuickStopIgnored(at, cycles=500),
        carriers=WIRE_OR_SIM,
        press=_abort,
    ),
    Drill(
        name="something drags at the output",
        cause=trips.DISAGREEMENT,
        what="200 N m on the output for 60 ms",
        fault=lambda at: plain.OutputLoad(at, torque=200.0, cycles=60),
        carriers=WIRE_OR_SIM,
    ),
    Drill(
        name="guard opened in motion",
        cause=trips.GUARD_OPEN,
        what="somebody opens the guard",
        fault=wire.GuardOpened,
    ),
    Drill(
        name="E-stop (STO) in motion",
        cause=trips.UNEXPECTED_STATE,
        what="the emergency stop takes the torque",
        fault=wire.SafeTorqueOff,
    ),
    Drill(
        name="E-stop (STO) at standstill",
        cause=trips.UNEXPECTED_STATE,
        what="the emergency stop takes the torque",
        fault=wire.SafeTorqueOff,
        moment="stand",
    ),
)

_FRAMES = (
    Drill(
        name="TPDO lost",
        cause=STALE_DATA,
        what="the counter's process data stay away for 300 ms",
        fault=lambda at: wire.TpdoLost(at, cycles=300),
        carriers=BUS_COUNTER,
    ),
    Drill(
        name="TPDO lost for good",
        cause=STALE_DATA,
        what="the counter's process data stay away",
        fault=wire.TpdoLost,
        carriers=BUS_COUNTER,
    ),
    Drill(
        name="TPDO lost, one",
        cause=marked(CycleFlag.STALE_OUTPUT),
        what="one cycle of the counter's process data is lost",
        fault=lambda at: wire.TpdoLost(at, cycles=1),
        is_harmless=True,
        carriers=BUS_COUNTER,
    ),
    Drill(
        name="TPDO late, one",
        cause=marked(CycleFlag.LATE),
        what="one cycle of the counter's process data comes a cycle late",
        fault=lambda at: wire.TpdoLate(at, cycles=1),
        is_harmless=True,
        carriers=BUS_COUNTER,
    ),
    Drill(
        name="TPDO late",
        cause=trips.MISSED_CYCLES,
        what="every tenth of the counter's process data comes a cycle late for 200 ms",
        fault=lambda at: LateNowAndThen(at, cycles=200),
        carriers=BUS_COUNTER,
    ),
    Drill(
        name="answers held back",
        cause=trips.MISSED_CYCLES,
        what="the computer gives the bus no time for 20 cycles, then all answers come at once",
        fault=lambda at: wire.AnswersHeld(at, cycles=20),
    ),
    Drill(
        name="TPDO doubled",
        cause=trips.FOREIGN_TPDO,
        what="the counter's process data come twice in every cycle",
        fault=wire.TpdoDoubled,
        carriers=BUS_COUNTER,
    ),
    Drill(
        name="TPDO doubled, twice",
        cause=marked(CycleFlag.DOUBLED),
        what="the counter's process data come twice in two cycles",
        fault=lambda at: wire.TpdoDoubled(at, cycles=2),
        is_harmless=True,
        carriers=BUS_COUNTER,
    ),
    Drill(
        name="TPDO short",
        cause=STALE_DATA,
        what="the counter's process data lack a byte for 200 ms",
        fault=lambda at: wire.TpdoShort(at, cycles=200),
        carriers=BUS_COUNTER,
    ),
    Drill(
        name="SYNC loss",
        cause=STALE_DATA,
        what="the SYNC does not reach the devices for 200 ms",
        fault=lambda at: wire.SyncLost(at, cycles=200),
    ),
    Drill(
        name="bus off",
        cause=trips.BUS_LOST,
        is_unheard=True,
        what="the computer's controller is bus-off",
        fault=wire.BusOff,
    ),
    Drill(
        name="hub gone",
        cause=trips.BUS_LOST,
        is_unheard=True,
        what="hub or adapter disappears",
        fault=wire.HubGone,
    ),
    Drill(
        name="bus lost",
        cause=trips.BUS_LOST,
        is_unheard=True,
        what="the bus is gone for good",
        fault=plain.BusLost,
    ),
    Drill(
        name="no data for 0.4 s",
        cause=STALE_DATA,
        what="nothing arrives, then it does again",
        fault=lambda at: plain.Stall(at, cycles=400),
        carriers=WIRE_OR_SIM,
    ),
    Drill(
        name="SDO abort",
        cause=trips.DEVICE_ERROR,
        what="the drive refuses its mode of operation",
        fault=lambda at: wire.SdoAborted(at, DRIVE_NODE, 0x6060),
        moment="zero-before",
        carriers=CIA_402,
    ),
    Drill(
        name="SDO time-out",
        cause=trips.DEVICE_ERROR,
        what="the drive does not answer when it is to be enabled",
        fault=wire.SdoSilent,
        moment="zero-before",
    ),
    Drill(
        name="drive limit reads back differently",
        cause=refused("drive limits"),
        what="0x6072 reads back as half of what was written",
        fault=wire.ReadsBackDifferently,
        moment="start",
        carriers=CIA_402,
    ),
    Drill(
        name="drive limits read back differently, sim",
        cause=refused("drive limits"),
        what="all limits read back as half of what was written",
        fault=None,
        carriers=SIM,
        moment="start",
        limits_factor=0.5,
    ),
)

_SIGNALS = (
    Drill(
        name="encoder count jump, output",
        cause=trips.DISAGREEMENT,
        what="the output count jumps by 1000",
        fault=plain.CountJump,
        carriers=WIRE_OR_SIM,
    ),
    Drill(
        name="encoder count jump, input",
        cause=trips.DISAGREEMENT,
        what="the input count jumps by 3000",
        fault=lambda at: plain.CountJump(at, channel=names.INPUT_ANGLE, counts=3000),
        carriers=WIRE_OR_SIM,
    ),
    Drill(
        name="encoder stuck, output",
        cause=trips.DISAGREEMENT,
        what="the output count stands still",
        fault=plain.StuckEncoder,
        carriers=WIRE_OR_SIM,
    ),
    Drill(
        name="encoder stuck, input",
        cause=trips.DISAGREEMENT,
        what="the input count stands still",
        fault=lambda at: plain.StuckEncoder(at, channel=names.INPUT_ANGLE),
        carriers=WIRE_OR_SIM,
    ),
    Drill(
        name="encoder reversed, output",
        cause=trips.DISAGREEMENT,
        what="the output counts the other way",
        fault=wire.EncoderReversed,
        carriers=BUS_COUNTER,
    ),
    Drill(
        name="encoder reversed, input",
        cause=trips.DISAGREEMENT,
        what="the motor encoder counts the other way",
        fault=lambda at: wire.EncoderReversed(at, DRIVE_NODE),
    ),
    Drill(
        name="encoder wrapped, as declared",
        cause=NOTHING,
        what="the counter wraps every 2048 counts and says so",
        fault=None,
        moment="start",
        is_harmless=True,
        prepare=_narrow_counter,
        carriers=BUS_COUNTER,
    ),
    Drill(
        name="encoder wrapped, undeclared",
        cause=trips.DISAGREEMENT,
        what="the counter wraps at 2^16 and says 2^32",
        fault=wire.EncoderWrapped,
        carriers=BUS_COUNTER,
    ),
    Drill(
        name="signal-error flag",
        cause={"wire": trips.EMERGENCY, "sim": trips.SIGNAL_ERROR},
        what="the counter says that its value is not valid",
        fault=lambda at: plain.MarkedCycles(at, flag=CycleFlag.SIGNAL_ERROR),
        carriers=("wire", "sim", "wire-csp", "wire-analog"),
    ),
    Drill(
        name="output and input disagree",
        cause=trips.DISAGREEMENT,
        what="the output slips by 3 counts per cycle for 200 ms",
        fault=lambda at: wire.OutputSlips(at, cycles=200),
        carriers=WIRE_OR_SIM,
    ),
    Drill(
        name="torque port saturated",
        cause=trips.OVER_TORQUE,
        what="the monitor stands at the end of its range",
        fault=plain.TorquePortSaturated,
        carriers=WIRE_OR_SIM,
    ),
    Drill(
        name="torque port open",
        cause={"wire": trips.TORQUE_DISAGREEMENT, "sim": trips.TORQUE_PORT},
        what="the monitor's line is open and hums",
        fault=plain.TorquePortOpen,
        carriers=TWO_TORQUES,
    ),
    Drill(
        name="clock jump forward",
        cause=trips.TIME_BASE,
        what="the adapter's clock jumps by 5 s",
        fault=wire.ClockJump,
    ),
    Drill(
        name="clock jump back",
        cause=trips.TIME_BASE,
        what="the adapter's clock jumps back by 0.5 s",
        fault=lambda at: wire.ClockJump(at, stamp_offset_ns=-500_000_000),
    ),
)

_LINES_AND_DISK = (
    Drill(
        name="readout garbage",
        cause=reading_refused("half a line"),
        what="the readout's line brings garbage",
        fault=wire.ReadoutGarbage,
        readout="garbage",
        is_harmless=True,
        moment="start",
    ),
    Drill(
        name="readout half lines",
        cause=reading_refused("half a line"),
        what="the readout's answers stop half-way",
        fault=wire.ReadoutHalfLine,
        readout="half lines",
        is_harmless=True,
        moment="start",
    ),
    Drill(
        name="readout silent",
        cause=reading_refused("the readout does not answer"),
        what="the readout does not answer",
        fault=wire.ReadoutSilent,
        readout="silent",
        is_harmless=True,
        moment="start",
    ),
    Drill(
        name="readout unit '?'",
        cause=reading_refused(NO_VALUE),
        what="the readout shows an encoder fault",
        fault=wire.ReadoutEncoderFault,
        readout="encoder fault",
        is_harmless=True,
        moment="start",
    ),
    Drill(
        name="disk full",
        cause=RECORDER,
        what="nothing can be written any more",
        fault=None,
        carriers=BOTH,
        recording="disk full",
    ),
    Drill(
        name="disk nearly full",
        cause=trips.DISK_SPACE,
        what="less than the least free space is left",
        fault=None,
        carriers=BOTH,
        recording="disk nearly full",
    ),
    Drill(
        name="writer stalled",
        cause=RECORDER,
        what="the disk takes nothing until the ring is full",
        fault=None,
        carriers=BOTH,
        recording="writer stalled",
    ),
)

_STATES: tuple[tuple[Moment, str], ...] = (
    ("preflight", "while the rig is looked at with the servo off"),
    ("zero-before", "with the servo off"),
    ("switching-on", "while the drive is switched on"),
    ("ramp", "in a ramp"),
    ("hold", "at constant speed"),
    ("reversal", "in a reversal"),
    ("stand", "at standstill with the servo on"),
    ("torque-ramp", "in torque mode"),
    ("zero-after", "with the servo off again"),
    ("making-safe", "while the rig is made safe"),
)
_OPERATOR = tuple(
    Drill(
        name=f"Ctrl-C in {moment}",
        # A rig that is made safe already has nothing left to be told.
        cause=NOTHING if moment == "making-safe" else STOP,
        what=f"the operator's STOP {where}",
        fault=None,
        carriers=TORQUE if moment == "torque-ramp" else BOTH,
        moment=moment,
        press=StopRequest.press,
    )
    for moment, where in _STATES
) + tuple(
    Drill(
        name=f"Ctrl-C twice in {moment}",
        cause=ABORT,
        what=f"the operator's ABORT {where}",
        fault=None,
        carriers=TORQUE if moment == "torque-ramp" else BOTH,
        moment=moment,
        press=_abort,
    )
    for moment, where in _STATES
    if moment in ("ramp", "hold", "torque-ramp")
)

_PRE_OPERATIONAL, _STOPPED, _START = 0x80, 0x02, 0x01
_BUS = (
    Drill(
        name="NMT PRE-OPERATIONAL from outside",
        what="another master takes the drive out of OPERATIONAL; it turns on",
        cause=trips.NOT_OPERATIONAL,
        fault=lambda at: wire.NmtFromOutside(at, ((0, _PRE_OPERATIONAL),)),
    ),
    Drill(
        name="NMT PRE-OPERATIONAL from outside, all nodes",
        what="another master takes every node out of OPERATIONAL; the drive turns on",
        cause=trips.NOT_OPERATIONAL,
        fault=lambda at: wire.NmtFromOutside(at, ((0, _PRE_OPERATIONAL),), 0),
    ),
    Drill(
        name="NMT STOPPED from outside",
        what="another master stops the drive's communication; it quick-stops by itself",
        cause=trips.NOT_OPERATIONAL,
        fault=lambda at: wire.NmtFromOutside(at, ((0, _STOPPED),)),
    ),
    Drill(
        name="NMT STOPPED from outside, drive goes on",
        what="another master stops the drive's communication; it turns on and answers no SDO",
        cause=trips.NOT_OPERATIONAL,
        fault=lambda at: wire.NmtFromOutside(at, ((0, _STOPPED),), reacts=False),
    ),
    Drill(
        name="NMT START while made safe",
        what="another master starts the drive again 60 ms after it took it out of OPERATIONAL",
        cause=trips.NOT_OPERATIONAL,
        fault=lambda at: wire.NmtFromOutside(at, ((0, _PRE_OPERATIONAL), (60, _START))),
    ),
    Drill(
        name="SYNC gone for good",
        what="the SYNC reaches no device any more; the drive holds its last set-point",
        cause=STALE_DATA,
        fault=wire.SyncLost,
    ),
    Drill(
        name="SYNC gone for good, drive minds",
        what="the SYNC reaches no device any more; the drive supervises it (0x1006)",
        cause=trips.NOT_OPERATIONAL,
        fault=wire.SupervisedSyncLost,
    ),
    Drill(
        name="SYNC supervision trips",
        what="three SYNCs are lost; the drive supervises them (0x1006)",
        cause=trips.NOT_OPERATIONAL,
        fault=lambda at: wire.SupervisedSyncLost(at, cycles=3),
    ),
    Drill(
        name="SYNC comes back while made safe",
        what="the SYNC reaches no device for 60 ms; the drive holds its last set-point meanwhile",
        cause=STALE_DATA,
        fault=lambda at: wire.SyncLost(at, cycles=60),
    ),
    Drill(
        name="mode changed by another master",
        what="another master puts the drive into profile torque",
        cause=trips.DRIVE_MODE,
        fault=wire.ModeFromOutside,
        carriers=(*SPEED_MODES, "wire-box"),
    ),
    Drill(
        name="mode changed by another master, cyclic torque",
        what="another master puts the drive into cyclic synchronous torque",
        cause=trips.DRIVE_MODE,
        fault=lambda at: wire.ModeFromOutside(at, mode=10),
        carriers=SPEED_MODES,
    ),
)

_STRANGERS = (
    Drill(
        name="second SYNC producer",
        what="somebody else begins to send a SYNC in every cycle, and the nodes answer it",
        cause=trips.FOREIGN_SYNC,
        fault=strangers.SecondSync,
        carriers=ANY_DRIVE,
    ),
    Drill(
        name="second SYNC producer, two SYNCs",
        what="somebody else sends two SYNCs",
        cause=marked(CycleFlag.DOUBLED),
        fault=lambda at: strangers.SecondSync(at, cycles=2),
        carriers=SPEED_MODES,
        is_harmless=True,
    ),
    Drill(
        name="alien process data",
        what="a second device sends with the counter's COB-ID in every fourth cycle",
        cause=trips.FOREIGN_TPDO,
        fault=lambda at: strangers.AlienTpdo(at, every=4),
        carriers=(*SPEED_MODES, "wire-analog"),
    ),
    Drill(
        name="alien process data, drive",
        what="a second device sends with the drive's COB-ID for 40 cycles",
        cause=trips.FOREIGN_TPDO,
        fault=lambda at: strangers.AlienTpdo(at, node_id=DRIVE_NODE, byte=0x27, cycles=40),
        carriers=SPEED_MODES,
    ),
    Drill(
        name="alien set-point",
        what="another master sends the drive one other set-point",
        cause=trips.FOREIGN_COMMAND,
        fault=lambda at: strangers.AlienCommand(at, cycles=1),
        carriers=(*SPEED_MODES, "wire-box"),
    ),
    Drill(
        name="alien controlword",
        what="another master sends the drive one other controlword",
        cause=trips.FOREIGN_COMMAND,
        fault=lambda at: strangers.AlienCommand(at, cycles=1, byte=0, flip=0x08),
        carriers=(*SPEED_MODES, "wire-box"),
    ),
    Drill(
        name="alien controlword, shutdown",
        what="another master tells the drive once to leave operation",
        cause=trips.FOREIGN_COMMAND,
        fault=lambda at: strangers.AlienCommand(at, cycles=1, byte=0, flip=0x09),
        carriers=SPEED_MODES,
    ),
    Drill(
        name="alien reference",
        what="another master writes the coupler's outputs once",
        cause=trips.FOREIGN_COMMAND,
        fault=lambda at: strangers.AlienCommand(at, cycles=1, byte=0),
        carriers=REFERENCE,
    ),
)

_SLOW_LIES = (
    Drill(
        name="torque port frozen",
        what="the monitor sends one value again and again",
        cause=trips.TORQUE_FROZEN,
        fault=plain.ChannelFrozen,
        carriers=TWO_TORQUES,
    ),
    Drill(
        name="torque port's zero drifts",
        what="the monitor's zero runs away by 0.1 mN m per cycle",
        cause=trips.TORQUE_ZERO,
        fault=plain.TorqueZeroDrifts,
        carriers=TWO_TORQUES,
    ),
    Drill(
        name="slip, output",
        what="the output slips once by 20 counts",
        cause=trips.SLIP,
        fault=plain.CountsLost,
        carriers=WIRE_OR_SIM,
    ),
    Drill(
        name="slip, input",
        what="the input encoder loses 30 counts",
        cause=trips.LOST_COUNTS,
        fault=lambda at: plain.CountsLost(at, channel=names.INPUT_ANGLE, counts=-30),
        carriers=WIRE_OR_SIM,
    ),
    Drill(
        name="creep",
        what="the drive turns at 29 r/min while it is commanded to stand",
        cause=trips.CREEP,
        fault=lambda at: plain.RunAway(at, speed=3.04, cycles=400),
        carriers=WIRE_OR_SIM,
        moment="stand",
    ),
    Drill(
        name="thermometer open",
        what="the housing's thermometer reads -40 degC",
        cause=trips.THERMOMETER,
        fault=plain.ThermometerOpen,
        carriers=WIRE_OR_SIM,
    ),
)

_SOURCES = (
    Drill(
        name="counter box unplugged",
        what="the network cable of the output's counter box is pulled",
        cause=STALE_DATA,
        fault=box.BoxUnplugged,
        carriers=BOX,
    ),
    Drill(
        name="counter box silent",
        what="the output's counter box answers nothing",
        cause=STALE_DATA,
        fault=box.BoxSilent,
        carriers=BOX,
    ),
    Drill(
        name="counter box late",
        what="the counter box answers after the next SYNC",
        cause=STALE_DATA,
        fault=box.BoxSlow,
        carriers=BOX,
    ),
    Drill(
        name="counter box garbled",
        what="the counter box answers what nobody understands",
        cause=STALE_DATA,
        fault=box.BoxGarbled,
        carriers=BOX,
    ),
    Drill(
        name="trigger line broken",
        what="the SYNC does not reach the counter box any more, which shows what it latched last",
        cause=STALE_DATA,
        fault=box.BoxDeaf,
        carriers=BOX,
    ),
    Drill(
        name="counter box, encoder invalid",
        what="the counter box says that its encoder's signal is not valid",
        cause=trips.SIGNAL_ERROR,
        fault=box.BoxInvalid,
        carriers=BOX,
    ),
    Drill(
        name="counter box, three answers lost",
        what="three answers of the counter box are lost",
        cause=marked(CycleFlag.STALE_OUTPUT),
        fault=lambda at: box.BoxSilent(at, cycles=3),
        carriers=BOX,
        is_harmless=True,
    ),
)

_REFERENCE = (
    Drill(
        name="reference runs away",
        what="2 V are added to the speed reference on its way",
        cause=trips.OVER_SPEED,
        fault=lambda at: analog.ReferenceOffset(at, volts=2.0),
        carriers=REFERENCE,
    ),
    Drill(
        name="reference's zero drifts",
        what="60 mV are added to the speed reference while it is commanded to stand",
        cause=trips.CREEP,
        fault=analog.ReferenceOffset,
        carriers=REFERENCE,
        moment="stand",
    ),
    Drill(
        name="reference's wire broken",
        what="the amplifier sees no voltage whatever is sent",
        cause=trips.FOLLOWING_ERROR,
        fault=analog.ReferenceBroken,
        carriers=REFERENCE,
    ),
    Drill(
        name="power contact stuck on",
        what="the contact says that the motor has power for ever",
        cause=not_obeyed(Stage.SERVO_OFF),
        fault=analog.ContactStuck,
        carriers=REFERENCE,
        is_unheard=True,
        moment="zero-after",
    ),
    Drill(
        name="alarm contact broken",
        what="the wire of the alarm contact breaks",
        cause=trips.DRIVE_FAULT,
        fault=lambda at: analog.ContactStuck(at, bit=NO_ALARM, says=False),
        carriers=REFERENCE,
    ),
    Drill(
        name="coupler refuses servo-on",
        what="the coupler refuses to write its outputs",
        cause=trips.DEVICE_ERROR,
        fault=lambda at: wire.SdoAborted(at, DRIVE_NODE, 0x6200),
        carriers=REFERENCE,
        moment="zero-before",
    ),
)

_POSITION = (
    Drill(
        name="shaft behind its target position",
        what="the drive says that the shaft is too far behind its target position",
        cause=trips.DRIVE_FOLLOWING,
        fault=wire.FollowingWindowLeft,
        carriers=BY_POSITION,
    ),
    Drill(
        name="target position not followed",
        what="the drive holds still in operation enabled and says that it does not follow its target",
        cause=trips.DRIVE_NOT_FOLLOWING,
        fault=wire.TargetsIgnored,
        carriers=BY_POSITION,
    ),
)

DRILLS: Mapping[str, Drill] = {
    drill.name: drill
    for drill in (
        *_DEVICES,
        *_FRAMES,
        *_SIGNALS,
        *_LINES_AND_DISK,
        *_OPERATOR,
        *_BUS,
        *_STRANGERS,
        *_SLOW_LIES,
        *_SOURCES,
        *_REFERENCE,
        *_POSITION,
    )
}
"""Every drill by name, in the order of the table."""
