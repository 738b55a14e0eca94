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


@dataclass(frozen=True)
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
        "heartbeat lost, drive",
        "the drive's heartbeat stays away",
        lambda at: wire.HeartbeatLost(at, DRIVE_NODE),
    ),
    Drill(
        "heartbeat lost, counter",
        "the counter's heartbeat stays away",
        lambda at: wire.HeartbeatLost(at, COUNTER_NODE),
    ),
    Drill(
        "node reset in motion, drive",
        "the drive restarts",
        lambda at: wire.NodeReset(at, DRIVE_NODE),
    ),
    Drill(
        "node reset in motion, counter",
        "the counter restarts",
        lambda at: wire.NodeReset(at, COUNTER_NODE),
    ),
    Drill(
        "node dead, analog input",
        "the analog module says nothing",
        lambda at: wire.NodeSilent(at, ANALOG_INPUT_NODE),
    ),
    Drill("EMCY", "the drive sends an emergency message and goes on", wire.EmergencyMessage),
    Drill("statusword fault", "the drive faults and stops by its fault reaction", wire.DriveTrip),
    Drill("statusword fault, motor coasts", "the power stage trips", plain.DriveFault, BOTH),
    Drill(
        "run-away",
        "the drive goes to 250 rad/s by itself",
        lambda at: plain.RunAway(at, speed=250.0, cycles=400),
        ("wire", "sim"),
    ),
    Drill(
        "quick stop not obeyed",
        "the drive faults its quick stop and turns on, after an ABORT",
        wire.QuickStopNotObeyed,
        press=_abort,
    ),
    Drill(
        "quick stop and servo off not obeyed",
        "for half a second the drive obeys nothing, after an ABORT",
        lambda at: plain.QuickStopIgnored(at, cycles=500),
        ("wire", "sim"),
        press=_abort,
    ),
    Drill(
        "something drags at the output",
        "200 N m on the output for 60 ms",
        lambda at: plain.OutputLoad(at, torque=200.0, cycles=60),
        ("wire", "sim"),
    ),
    Drill("guard opened in motion", "somebody opens the guard", wire.GuardOpened),
    Drill("E-stop (STO) in motion", "the emergency stop takes the torque", wire.SafeTorqueOff),
    Drill(
        "E-stop (STO) at standstill",
        "the emergency stop takes the torque",
        wire.SafeTorqueOff,
        moment="stand",
    ),
)

_FRAMES = (
    Drill(
        "TPDO lost",
        "the counter's process data stay away for 300 ms",
        lambda at: wire.TpdoLost(at, cycles=300),
    ),
    Drill("TPDO lost for good", "the counter's process data stay away", wire.TpdoLost),
    Drill(
        "TPDO lost, one",
        "one cycle of the counter's process data is lost",
        lambda at: wire.TpdoLost(at, cycles=1),
        is_harmless=True,
    ),
    Drill(
        "TPDO late, one",
        "one cycle of the counter's process data comes a cycle late",
        lambda at: wire.TpdoLate(at, cycles=1),
        is_harmless=True,
    ),
    Drill(
        "TPDO late",
        "every tenth of the counter's process data comes a cycle late for 200 ms",
        lambda at: LateNowAndThen(at, cycles=200),
    ),
    Drill(
        "TPDO doubled", "the counter's process data come twice", wire.TpdoDoubled, is_harmless=True
    ),
    Drill(
        "TPDO short",
        "the counter's process data lack a byte for 200 ms",
        lambda at: wire.TpdoShort(at, cycles=200),
    ),
    Drill(
        "SYNC loss",
        "the SYNC does not reach the devices for 200 ms",
        lambda at: wire.SyncLost(at, cycles=200),
    ),
    Drill("bus off", "the computer's controller is bus-off", wire.BusOff),
    Drill("hub gone", "hub or adapter disappears", wire.HubGone),
    Drill("bus lost", "the bus is gone for good", plain.BusLost),
    Drill(
        "no data for 0.4 s",
        "nothing arrives, then it does again",
        lambda at: plain.Stall(at, cycles=400),
        ("wire", "sim"),
    ),
    Drill(
        "SDO abort",
        "the drive refuses its mode of operation",
        lambda at: wire.SdoAborted(at, DRIVE_NODE, 0x6060),
        moment="zero-before",
    ),
    Drill(
        "SDO time-out",
        "the drive does not answer when it is to be enabled",
        wire.SdoSilent,
        moment="zero-before",
    ),
    Drill(
        "drive limit reads back differently",
        "0x6072 reads back as half of what was written",
        wire.ReadsBackDifferently,
        moment="start",
    ),
    Drill(
        "drive limits read back differently, sim",
        "all limits read back as half of what was written",
        None,
        SIM,
        moment="start",
        limits_factor=0.5,
    ),
)

_SIGNALS = (
    Drill(
        "encoder count jump, output",
        "the output count jumps by 1000",
        plain.CountJump,
        ("wire", "sim"),
    ),
    Drill(
        "encoder count jump, input",
        "the input count jumps by 3000",
        lambda at: plain.CountJump(at, channel=names.INPUT_ANGLE, counts=3000),
        ("wire", "sim"),
    ),
    Drill(
        "encoder stuck, output",
        "the output count stands still",
        plain.StuckEncoder,
        ("wire", "sim"),
    ),
    Drill(
        "encoder stuck, input",
        "the input count stands still",
        lambda at: plain.StuckEncoder(at, channel=names.INPUT_ANGLE),
        ("wire", "sim"),
    ),
    Drill("encoder reversed, output", "the output counts the other way", wire.EncoderReversed),
    Drill(
        "encoder reversed, input",
        "the motor encoder counts the other way",
        lambda at: wire.EncoderReversed(at, DRIVE_NODE),
    ),
    Drill(
        "encoder wrapped, as declared",
        "the counter wraps every 1024 counts and says so",
        None,
        WIRE,
        "start",
        is_harmless=True,
        prepare=_narrow_counter,
    ),
    Drill(
        "encoder wrapped, undeclared",
        "the counter wraps at 2^16 and says 2^32",
        wire.EncoderWrapped,
    ),
    Drill(
        "signal-error flag",
        "the counter says that its value is not valid",
        lambda at: plain.MarkedCycles(at, flag=CycleFlag.SIGNAL_ERROR),
        ("wire", "sim"),
    ),
    Drill(
        "output and input disagree",
        "the output slips by 3 counts per cycle for 200 ms",
        lambda at: wire.OutputSlips(at, cycles=200),
        ("wire", "sim"),
    ),
    Drill(
        "torque port saturated",
        "the monitor stands at the end of its range",
        plain.TorquePortSaturated,
        ("wire", "sim"),
    ),
    Drill(
        "torque port open",
        "the monitor's line is open and hums",
        plain.TorquePortOpen,
        ("wire", "sim"),
    ),
    Drill("clock jump forward", "the adapter's clock jumps by 5 s", wire.ClockJump),
    Drill(
        "clock jump back",
        "the adapter's clock jumps back by 0.5 s",
        lambda at: wire.ClockJump(at, stamp_offset_ns=-500_000_000),
    ),
)

_LINES_AND_DISK = (
    Drill(
        "readout garbage",
        "the readout's line brings garbage",
        wire.ReadoutGarbage,
        readout="garbage",
        is_harmless=True,
        moment="start",
    ),
    Drill(
        "readout half lines",
        "the readout's answers stop half-way",
        wire.ReadoutHalfLine,
        readout="half lines",
        is_harmless=True,
        moment="start",
    ),
    Drill(
        "readout silent",
        "the readout does not answer",
        wire.ReadoutSilent,
        readout="silent",
        is_harmless=True,
        moment="start",
    ),
    Drill(
        "readout unit '?'",
        "the readout shows an encoder fault",
        wire.ReadoutEncoderFault,
        readout="encoder fault",
        is_harmless=True,
        moment="start",
    ),
    Drill("disk full", "nothing can be written any more", None, BOTH, recording="disk full"),
    Drill(
        "disk nearly full",
        "less than the least free space is left",
        None,
        BOTH,
        recording="disk nearly full",
    ),
    Drill(
        "writer stalled",
        "the disk takes nothing until the ring is full",
        None,
        BOTH,
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
        f"Ctrl-C in {moment}",
        f"the operator's STOP {where}",
        None,
        BOTH,
        moment,
        press=StopRequest.press,
    )
    for moment, where in _STATES
) + tuple(
    Drill(
        f"Ctrl-C twice in {moment}",
        f"the operator's ABORT {where}",
        None,
        BOTH,
        moment,
        press=_abort,
    )
    for moment, where in _STATES
    if moment in ("ramp", "hold", "torque-ramp")
)

DRILLS: Mapping[str, Drill] = {
    drill.name: drill for drill in (*_DEVICES, *_FRAMES, *_SIGNALS, *_LINES_AND_DISK, *_OPERATOR)
}
"""Every drill by name, in the order of the table."""
