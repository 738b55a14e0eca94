"""Every way to stop, tried while the bare motor turns at 30 r/min, and timed."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from drivers.bus.analog.config import ReferenceConfig
from drivers.bus.cia402 import tables as obj
from drivers.bus.device import RemoteDevice
from drivers.drive_state import POWERED_STATES, drive_state
from drivers.errors import DriverError
from experiments.contract import Experiment
from experiments.finding import Finding, Severity, passed_if
from experiments.steps import vocabulary as s
from model.gear import HarmonicDrive
from rig.bench.backends.assembly import AssembledRig
from rig.bench.commissioning import FIRST_SPEED
from rig.run.latch import latch_of
from rig.run.parts import Progress, RunReport
from rig.run.stop import StopRequest
from rig.run.trips import GUARD_OPEN
from rig.trial.commission.motion import GENTLE, UNCOUPLED, FirstTurns, gentle
from rig.trial.commission.work import Seen, Work

PATIENCE = 60.0
"""s for which it turns and waits to be stopped."""
_ACTS_AFTER = 2.0
"""s after which the person at a simulated bench acts."""
LONGEST = 2.0
"""s from the act to standstill at 30 r/min, at most."""


@dataclass(frozen=True)
class Act:
    """One way to stop: what the operator is told, how the run must end, and whether this program sees it stand.

    `by` is the key by which the person at a simulated bench does it; `cause` of the trip that it must be, "" for any.
    """

    says: str
    outcome: str
    by: str = ""
    cause: str = ""
    is_seen: bool = True
    """This program sees that the motor stands."""
    ends_program: bool = False
    """It does not live to see anything: it is started again and looks then."""


ACTS: Mapping[str, Act] = {
    "stop-key": Act("press Ctrl-C once", "ABORTED", by="press-key"),
    "stop-guard": Act("open the guard", "TRIPPED", by="open-guard", cause=GUARD_OPEN),
    "stop-emergency": Act("press the emergency stop", "TRIPPED", by="press-emergency-stop"),
    "stop-cable": Act(
        "unplug the bus cable at the computer", "TRIPPED", by="unplug", is_seen=False
    ),
    "stop-kill": Act(
        "kill this program from another terminal (kill -9 {process})", "", ends_program=True
    ),
    "stop-computer": Act("cut the computer off: its power, or its adapter", "", ends_program=True),
}


def _turning(parameters: FirstTurns, gear: HarmonicDrive) -> Iterator[s.Step]:
    """30 r/min until somebody stops it."""
    yield s.Ramp(FIRST_SPEED, GENTLE)
    yield s.HoldTime(PATIENCE, s.SegmentLabel("turning", FIRST_SPEED, 1))
    yield s.Ramp(0.0, GENTLE)


TURNING = Experiment(
    name="commission-stop",
    title="commissioning: a stop is tried at 30 r/min",
    summary="how it stops, and how fast",
    parameters=FirstTurns,
    plan=_turning,
    analyse=UNCOUPLED.analyse,
    needs=("input_angle",),
    gear_mounted=False,
)


def try_stop(name: str, work: Work, seen: Seen) -> None:
    """Turn, let it be stopped, and look how that went."""
    act = ACTS[name]
    rig = work.rig(coupled=False)
    if act.ends_program and rig.person is not None:
        text = "a simulated bench in this process has no computer to lose: rig sim drill tries it"
        seen.add(Finding(name, Severity.NOT_LOOKED_AT, text, where="stop"))
        return
    if act.cause == GUARD_OPEN and (rig.described is None or rig.described.guard is None):
        text = "no guard input is configured: opening the guard stops nothing by this program"
        seen.add(Finding(name, Severity.WARNS, text, "Describe it as [guard].", where="stop"))
        return
    told = act.says.format(process=os.getpid())
    text = (
        f"The gear is uncoupled, the emergency stop released, the guard closed. The motor will turn at 30 r/min for "
        f"{PATIENCE:.0f} s. Then {told}, and look how long it goes on turning."
    )
    work.consents(seen, rig, f"ready-{name}", text, "ready")
    if not seen.is_fine:
        return
    if act.ends_program:
        work.record(seen)
    stop = StopRequest() if act.by == "press-key" and rig.person is not None else work.stop
    report, turned = work.turn(seen, gentle(work, TURNING), _acting(act, stop), stop)
    if act.ends_program:
        text = f"{report.outcome}: {report.message or 'the time was over'}"
        seen.add(
            Finding(
                name, Severity.BLOCKS, text, "It was not done: try this stage again.", where="stop"
            )
        )
        return
    _judge(name, act, work, seen, report, turned)


def _acting(act: Act, stop: StopRequest) -> Callable[[AssembledRig, Progress], None]:
    """Lets the person at a simulated bench act once it turns."""
    done: list[bool] = []

    def on_progress(rig: AssembledRig, progress: Progress) -> None:
        if rig.person is None or done or progress.elapsed < _ACTS_AFTER:
            return
        done.append(True)
        if act.by == "press-key":
            stop.press()
        else:
            rig.person(act.by)

    return on_progress


def _judge(
    name: str, act: Act, work: Work, seen: Seen, report: RunReport, rig: AssembledRig
) -> None:
    cause = report.trip.cause if report.trip is not None else ""
    fits = report.outcome == act.outcome and act.cause in ("", cause)
    text = f"{report.outcome}: {report.message}"
    seen.add(passed_if(name, fits, text, f"It should have been: {act.says}.", where="stop"))
    if report.outcome == "TRIPPED":
        _acknowledge(name, work)
    if not fits:
        return
    if act.is_seen:
        made, fine, text = report.make_safe, False, "STANDSTILL NOT VERIFIED"
        if made is not None and report.safe:
            seconds = made.rows / work.order.sample_rate
            fine = seconds <= LONGEST
            text = f"verified by {', '.join(made.verified_by)} after {seconds:.2f} s"
        seen.add(passed_if("standstill", fine, text, where="stop", allowed=f"<= {LONGEST:g} s"))
        return
    _seconds(work, seen, rig)


def _acknowledge(name: str, work: Work) -> None:
    """The trip was the purpose: it is released in the operator's name, and kept with that remark."""
    latch = latch_of(work.bench)
    if latch.read() is not None:
        latch.acknowledge(work.order.operator, work.now(), f"stage {name} of the commissioning")


def look_afterwards(name: str, work: Work, seen: Seen) -> None:
    """The program was started again after it was killed, or its computer was: what does the drive say now?"""
    _acknowledge(name, work)
    _seconds(work, seen, work.rig(coupled=False))


def _seconds(work: Work, seen: Seen, rig: AssembledRig) -> None:
    """How long it went on, by eye; and that the drive has no power now, by SDO."""
    text = "Plug everything in again. For how many seconds did the motor go on turning? Type the number:"
    answer = work.answer(rig, "seconds", text)
    seen.answers["seconds"] = answer
    if rig.person is not None:
        seen.add(
            Finding(
                "standstill",
                Severity.NOT_LOOKED_AT,
                "nobody has looked at a simulated bench",
                where="stop",
            )
        )
        return
    try:
        seconds = float(answer.replace(",", "."))
    except ValueError:
        seconds = float("inf")
    text = f"after {seconds:g} s by eye"
    remedy = "What covers the loss of the computer? 0x1016 with 0x6007, or hardware: `computer_loss_covered_by`."
    seen.add(
        passed_if(
            "standstill",
            seconds <= LONGEST,
            text,
            remedy,
            where="stop",
            allowed=f"<= {LONGEST:g} s",
        ),
        _without_power(rig),
    )


def _without_power(rig: AssembledRig) -> Finding:
    """Whether the drive has let go of the motor, read by SDO."""
    config = rig.described
    if rig.quiet_bus is None or config is None or isinstance(config.drive, ReferenceConfig):
        return Finding("drive", Severity.NOT_LOOKED_AT, "the amplifier tells nothing", where="stop")
    bus = rig.quiet_bus()
    try:
        word = int(RemoteDevice(bus, config.drive.node_id).read(obj.STATUSWORD))
    except DriverError as error:
        return Finding(
            "drive", Severity.BLOCKS, str(error), "Plug it in, then try again.", where="stop"
        )
    finally:
        bus.close()
    state = drive_state(word)
    return passed_if(
        "drive",
        state not in POWERED_STATES,
        f"statusword 0x{word:04X}, {state.value}",
        "It has power, though nobody commands it.",
        where="stop",
    )
