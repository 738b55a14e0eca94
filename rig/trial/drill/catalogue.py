"""The list of what is drilled: each fault by name, what it is, which simulated rig carries it, and when it happens."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

from drivers import channel as names
from drivers.samples import CycleFlag
from rig.run.stop import StopRequest
from rig.trial.drill.rigs import Carrier
from sim_backend import faults as plain
from sim_backend.faults import Fault
from sim_backend.wire import faults as wire
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

BOTH: tuple[Carrier, ...] = ("sim", "wire")
SIM: tuple[Carrier, ...] = ("sim",)
WIRE: tuple[Carrier, ...] = ("wire",)


@dataclass(frozen=True, kw_only=True)
class Drill:
    """One fault: what it is in words, when and on which rigs it happens, and whether it must do no harm.

    `carriers` in order of preference. `presses` are what the operator does; `faults` is what the
    rig does, made for a cycle on a carrier; `recording` and `readout` are faults of the computer's
    disk and of the readout's line.
    """

    name: str
    what: str
    fault: Callable[[int], Fault] | None = None
    carriers: tuple[Carrier, ...] = WIRE
    moment: Moment = "hold"
    is_harmless: bool = False
    press: Callable[[StopRequest], None] | None = None
    prepare: Callable[[WireBench], None] | None = None
    limits_factor: float = 1.0
    recording: Recording = ""
    readout: Readout = ""


@dataclass(frozen=True)
class LateNowAndThen(wire.TpdoLate):
    """Process data of every tenth cycle arrive after the next SYNC."""

    def active(self, cycle: int) -> bool:
        return super().active(cycle) and (cycle - self.at_cycle) % 10 == 0


def _narrow_counter(bench: WireBench) -> None:
    """A counter whose declared measuring range is 1024 counts: it wraps about every 5 degrees of the output."""
    bench.counter.dictionary.store(0x6002, 0, 1024)


def _abort(stop: StopRequest) -> None:
    stop.press()
    stop.press()


_DEVICES = (
    Drill(
        name="heartbeat lost, drive",
        what="the drive's heartbeat stays away",
        fault=lambda at: wire.HeartbeatLost(at, DRIVE_NODE),
    ),
    Drill(
        name="heartbeat lost, counter",
        what="the counter's heartbeat stays away",
        fault=lambda at: wire.HeartbeatLost(at, COUNTER_NODE),
    ),
    Drill(
        name="node reset in motion, drive",
        what="the drive restarts",
        fault=lambda at: wire.NodeReset(at, DRIVE_NODE),
    ),
    Drill(
        name="node reset in motion, counter",
        what="the counter restarts",
        fault=lambda at: wire.NodeReset(at, COUNTER_NODE),
    ),
    Drill(
        name="node dead, analog input",
        what="the analog module says nothing",
        fault=lambda at: wire.NodeSilent(at, ANALOG_INPUT_NODE),
    ),
    Drill(
        name="EMCY",
        what="the drive sends an emergency message and goes on",
        fault=wire.EmergencyMessage,
    ),
    Drill(
        name="statusword fault",
        what="the drive faults and stops by its fault reaction",
        fault=wire.DriveTrip,
    ),
    Drill(
        name="statusword fault, motor coasts",
        what="the power stage trips",
        fault=plain.DriveFault,
        carriers=BOTH,
    ),
    Drill(
        name="run-away",
        what="the drive goes to 250 rad/s by itself",
        fault=lambda at: plain.RunAway(at, speed=250.0, cycles=400),
        carriers=("wire", "sim"),
    ),
    Drill(
        name="quick stop not obeyed",
        what="the drive faults its quick stop and turns on, after an ABORT",
        fault=wire.QuickStopNotObeyed,
        press=_abort,
    ),
    Drill(
        name="quick stop and servo off not obeyed",
        what="for half a second the drive obeys nothing, after an ABORT",
        fault=lambda at: plain.QuickStopIgnored(at, cycles=500),
        carriers=("wire", "sim"),
        press=_abort,
    ),
    Drill(
        name="something drags at the output",
        what="200 N m on the output for 60 ms",
        fault=lambda at: plain.OutputLoad(at, torque=200.0, cycles=60),
        carriers=("wire", "sim"),
    ),
    Drill(name="guard opened in motion", what="somebody opens the guard", fault=wire.GuardOpened),
    Drill(
        name="E-stop (STO) in motion",
        what="the emergency stop takes the torque",
        fault=wire.SafeTorqueOff,
    ),
    Drill(
        name="E-stop (STO) at standstill",
        what="the emergency stop takes the torque",
        fault=wire.SafeTorqueOff,
        moment="stand",
    ),
)

_FRAMES = (
    Drill(
        name="TPDO lost",
        what="the counter's process data stay away for 300 ms",
        fault=lambda at: wire.TpdoLost(at, cycles=300),
    ),
    Drill(
        name="TPDO lost for good", what="the counter's process data stay away", fault=wire.TpdoLost
    ),
    Drill(
        name="TPDO lost, one",
        what="one cycle of the counter's process data is lost",
        fault=lambda at: wire.TpdoLost(at, cycles=1),
        is_harmless=True,
    ),
    Drill(
        name="TPDO late, one",
        what="one cycle of the counter's process data comes a cycle late",
        fault=lambda at: wire.TpdoLate(at, cycles=1),
        is_harmless=True,
    ),
    Drill(
        name="TPDO late",
        what="every tenth of the counter's process data comes a cycle late for 200 ms",
        fault=lambda at: LateNowAndThen(at, cycles=200),
    ),
    Drill(
        name="TPDO doubled",
        what="the counter's process data come twice",
        fault=wire.TpdoDoubled,
        is_harmless=True,
    ),
    Drill(
        name="TPDO short",
        what="the counter's process data lack a byte for 200 ms",
        fault=lambda at: wire.TpdoShort(at, cycles=200),
    ),
    Drill(
        name="SYNC loss",
        what="the SYNC does not reach the devices for 200 ms",
        fault=lambda at: wire.SyncLost(at, cycles=200),
    ),
    Drill(name="bus off", what="the computer's controller is bus-off", fault=wire.BusOff),
    Drill(name="hub gone", what="hub or adapter disappears", fault=wire.HubGone),
    Drill(name="bus lost", what="the bus is gone for good", fault=plain.BusLost),
    Drill(
        name="no data for 0.4 s",
        what="nothing arrives, then it does again",
        fault=lambda at: plain.Stall(at, cycles=400),
        carriers=("wire", "sim"),
    ),
    Drill(
        name="SDO abort",
        what="the drive refuses its mode of operation",
        fault=lambda at: wire.SdoAborted(at, DRIVE_NODE, 0x6060),
        moment="zero-before",
    ),
    Drill(
        name="SDO time-out",
        what="the drive does not answer when it is to be enabled",
        fault=wire.SdoSilent,
        moment="zero-before",
    ),
    Drill(
        name="drive limit reads back differently",
        what="0x6072 reads back as half of what was written",
        fault=wire.ReadsBackDifferently,
        moment="start",
    ),
    Drill(
        name="drive limits read back differently, sim",
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
        what="the output count jumps by 1000",
        fault=plain.CountJump,
        carriers=("wire", "sim"),
    ),
    Drill(
        name="encoder count jump, input",
        what="the input count jumps by 3000",
        fault=lambda at: plain.CountJump(at, channel=names.INPUT_ANGLE, counts=3000),
        carriers=("wire", "sim"),
    ),
    Drill(
        name="encoder stuck, output",
        what="the output count stands still",
        fault=plain.StuckEncoder,
        carriers=("wire", "sim"),
    ),
    Drill(
        name="encoder stuck, input",
        what="the input count stands still",
        fault=lambda at: plain.StuckEncoder(at, channel=names.INPUT_ANGLE),
        carriers=("wire", "sim"),
    ),
    Drill(
        name="encoder reversed, output",
        what="the output counts the other way",
        fault=wire.EncoderReversed,
    ),
    Drill(
        name="encoder reversed, input",
        what="the motor encoder counts the other way",
        fault=lambda at: wire.EncoderReversed(at, DRIVE_NODE),
    ),
    Drill(
        name="encoder wrapped, as declared",
        what="the counter wraps every 1024 counts and says so",
        fault=None,
        carriers=WIRE,
        moment="start",
        is_harmless=True,
        prepare=_narrow_counter,
    ),
    Drill(
        name="encoder wrapped, undeclared",
        what="the counter wraps at 2^16 and says 2^32",
        fault=wire.EncoderWrapped,
    ),
    Drill(
        name="signal-error flag",
        what="the counter says that its value is not valid",
        fault=lambda at: plain.MarkedCycles(at, flag=CycleFlag.SIGNAL_ERROR),
        carriers=("wire", "sim"),
    ),
    Drill(
        name="output and input disagree",
        what="the output slips by 3 counts per cycle for 200 ms",
        fault=lambda at: wire.OutputSlips(at, cycles=200),
        carriers=("wire", "sim"),
    ),
    Drill(
        name="torque port saturated",
        what="the monitor stands at the end of its range",
        fault=plain.TorquePortSaturated,
        carriers=("wire", "sim"),
    ),
    Drill(
        name="torque port open",
        what="the monitor's line is open and hums",
        fault=plain.TorquePortOpen,
        carriers=("wire", "sim"),
    ),
    Drill(name="clock jump forward", what="the adapter's clock jumps by 5 s", fault=wire.ClockJump),
    Drill(
        name="clock jump back",
        what="the adapter's clock jumps back by 0.5 s",
        fault=lambda at: wire.ClockJump(at, stamp_offset_ns=-500_000_000),
    ),
)

_LINES_AND_DISK = (
    Drill(
        name="readout garbage",
        what="the readout's line brings garbage",
        fault=wire.ReadoutGarbage,
        readout="garbage",
        is_harmless=True,
        moment="start",
    ),
    Drill(
        name="readout half lines",
        what="the readout's answers stop half-way",
        fault=wire.ReadoutHalfLine,
        readout="half lines",
        is_harmless=True,
        moment="start",
    ),
    Drill(
        name="readout silent",
        what="the readout does not answer",
        fault=wire.ReadoutSilent,
        readout="silent",
        is_harmless=True,
        moment="start",
    ),
    Drill(
        name="readout unit '?'",
        what="the readout shows an encoder fault",
        fault=wire.ReadoutEncoderFault,
        readout="encoder fault",
        is_harmless=True,
        moment="start",
    ),
    Drill(
        name="disk full",
        what="nothing can be written any more",
        fault=None,
        carriers=BOTH,
        recording="disk full",
    ),
    Drill(
        name="disk nearly full",
        what="less than the least free space is left",
        fault=None,
        carriers=BOTH,
        recording="disk nearly full",
    ),
    Drill(
        name="writer stalled",
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
        what=f"the operator's STOP {where}",
        fault=None,
        carriers=BOTH,
        moment=moment,
        press=StopRequest.press,
    )
    for moment, where in _STATES
) + tuple(
    Drill(
        name=f"Ctrl-C twice in {moment}",
        what=f"the operator's ABORT {where}",
        fault=None,
        carriers=BOTH,
        moment=moment,
        press=_abort,
    )
    for moment, where in _STATES
    if moment in ("ramp", "hold", "torque-ramp")
)

_SLOW_LIES = (
    Drill(
        name="torque port frozen",
        what="the monitor sends one value again and again",
        fault=plain.ChannelFrozen,
        carriers=("wire", "sim"),
    ),
    Drill(
        name="torque port's zero drifts",
        what="the monitor's zero runs away by 0.1 mN m per cycle",
        fault=plain.TorqueZeroDrifts,
        carriers=("wire", "sim"),
    ),
    Drill(
        name="slip, output",
        what="the output slips once by 20 counts",
        fault=plain.CountsLost,
        carriers=("wire", "sim"),
    ),
    Drill(
        name="slip, input",
        what="the input encoder loses 30 counts",
        fault=lambda at: plain.CountsLost(at, channel=names.INPUT_ANGLE, counts=-30),
        carriers=("wire", "sim"),
    ),
    Drill(
        name="creep",
        what="the drive turns at 29 r/min while it is commanded to stand",
        fault=lambda at: plain.RunAway(at, speed=3.04, cycles=400),
        carriers=("wire", "sim"),
        moment="stand",
    ),
    Drill(
        name="thermometer open",
        what="the housing's thermometer reads -40 degC",
        fault=plain.ThermometerOpen,
        carriers=("wire", "sim"),
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
        *_SLOW_LIES,
    )
}
"""Every drill by name, in the order of the table."""
