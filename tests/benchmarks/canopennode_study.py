"""A drive on CANopenNode, disturbed in motion: how long until its motor stands, by the log of the plant.

    git clone https://github.com/CANopenNode/CANopenNode && git -C CANopenNode checkout COMMIT
    CANOPENNODE=CANopenNode python -m tests.benchmarks.canopennode_study [--seed S] [--only NAME] [--modes csv,csp,pv]

The stack is built by gcc from the checkout (`tests.benchmarks.canopennode.library` names the commit; Apache-2.0) and
stepped in virtual time, so that every figure is the same on every machine. NMT, SDO, process data, heartbeats, EMCY
and the SYNC's supervision are CANopenNode's, the amplifier is that of `tests.drivers.amplifier`, the plant and the
whole program before it are those of `rig sim drill`. Each disturbance falls into the middle of a hold at 60 rad/s
(573 r/min). Prints a table in Markdown; exit code 1 when a motor does not stand in the end, or the run is COMPLETED
though the disturbance must end it.

*Stands after*: from the cycle of the disturbance to the last in which the motor turned faster than 1 rad/s.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

from drivers.bus.cia402.config import DriveConfig
from drivers.bus.cia402.tables import OperationMode
from drivers.clock import VirtualClock
from model.gear import HarmonicDrive
from model.motor import ServoMotor
from rig.bench.backends.simulated import wire_config, wire_port
from rig.run.stop import StopRequest
from rig.trial.drill import staging
from rig.trial.drill.catalogue import Drill
from rig.trial.drill.rigs import STANDING_SPEED, START_NS, DrilledRig, Happening
from rig.trial.drill.staging import Ending, Placed
from rig.trial.drill.suite import Stage, stage
from sim_backend.faults import Fault
from sim_backend.individuals import individual_gear
from sim_backend.wire import faults as wire
from sim_backend.wire.bench import DRIVE_NODE
from sim_backend.world import World
from tests.benchmarks.canopennode import strangers
from tests.benchmarks.canopennode.drive import CanopennodeBench
from tests.benchmarks.canopennode.library import checkout

MODES = {
    "csv": OperationMode.CYCLIC_VELOCITY,
    "csp": OperationMode.CYCLIC_POSITION,
    "pv": OperationMode.PROFILE_VELOCITY,
}
LOOKED_AT = 250
"""Cycles after the disturbance in which it shows what it does: the rest of the hold."""
OTHER_MODE = 10
"""Cyclic synchronous torque, which the amplifier has."""


@dataclass(frozen=True)
class Disturbance:
    """What happens at the row, and whether the run may go on to its end."""

    name: str
    fault: Callable[[int], Fault] | None = None
    press: Callable[[StopRequest], None] | None = None
    may_go_on: bool = False

    def drill(self) -> Drill:
        return Drill(name=self.name, what=self.name, cause="", fault=self.fault, press=self.press)


def _nmt(command: int, *, reacts: bool = True, node: int = DRIVE_NODE) -> Callable[[int], Fault]:
    return lambda at: wire.NmtFromOutside(at, ((0, command),), node, reacts)


def _comes(
    does: strangers.Act, period_us: int = 1000, times: int = 1 << 40
) -> Callable[[int], Fault]:
    return lambda at: strangers.Comes(at, does=does, period_us=period_us, times=times)


_other = strangers.AnotherMaster


def _abort(stop: StopRequest) -> None:
    stop.press()
    stop.press()


DISTURBANCES = (
    Disturbance("nothing", may_go_on=True),
    Disturbance("STOP pressed", press=StopRequest.press),
    Disturbance("ABORT pressed", press=_abort),
    Disturbance("NMT START (it is started already)", _nmt(0x01), may_go_on=True),
    Disturbance("NMT PRE-OPERATIONAL", _nmt(0x80)),
    Disturbance("NMT PRE-OPERATIONAL, all nodes", _nmt(0x80, node=0)),
    Disturbance("NMT STOPPED, drive reacts (0x6007 = 3)", _nmt(0x02)),
    Disturbance("NMT STOPPED, drive turns on (0x6007 = 0)", _nmt(0x02, reacts=False)),
    Disturbance("NMT STOPPED, all nodes, drive turns on", _nmt(0x02, reacts=False, node=0)),
    Disturbance("NMT reset communication", _nmt(0x82)),
    Disturbance("NMT reset node", _nmt(0x81)),
    Disturbance("supply dips, drive restarts", lambda at: wire.NodeReset(at, DRIVE_NODE)),
    Disturbance("EMCY 0x4310, drive goes on", wire.EmergencyMessage),
    Disturbance("drive fault 0x7305, fault reaction", lambda at: wire.DriveTrip(at, 0x7305)),
    Disturbance("drive fault 0x2310, motor coasts", lambda at: wire.DriveTrip(at, 0x2310, True)),
    Disturbance("heartbeat of the drive lost", lambda at: wire.HeartbeatLost(at, DRIVE_NODE)),
    Disturbance("drive silent", lambda at: wire.NodeSilent(at, DRIVE_NODE)),
    Disturbance("SYNC lost", wire.SyncLost),
    Disturbance("SYNC lost, supervised by 0x1006", wire.SupervisedSyncLost),
    Disturbance("mode changed by SDO (to torque)", lambda at: wire.ModeFromOutside(at, OTHER_MODE)),
    Disturbance("second SYNC, 1 kHz", _comes(strangers.sends_sync)),
    Disturbance("second SYNC, 100 Hz", _comes(strangers.sends_sync, 10_000)),
    Disturbance("three foreign SYNCs in 0.3 s", _comes(strangers.sends_sync, 100_000, 3)),
    Disturbance("one foreign SYNC", _comes(strangers.sends_sync, times=1), may_go_on=True),
    Disturbance("alien TPDO, 1 kHz", _comes(strangers.sends_process_data)),
    Disturbance("alien TPDO, 100 Hz", _comes(strangers.sends_process_data, 10_000)),
    Disturbance("one alien TPDO", _comes(strangers.sends_process_data, times=1), may_go_on=True),
    Disturbance("foreign set-point, one", lambda at: _other(at, cycles=1, speeds=True)),
    Disturbance("foreign set-points, 1 kHz", lambda at: _other(at, speeds=True)),
    Disturbance("foreign controlword 0x06, one", lambda at: _other(at, cycles=1, controls=True)),
    Disturbance("foreign controlwords, 1 kHz", lambda at: _other(at, controls=True)),
    Disturbance("doubled node", strangers.NodeDoubled),
    Disturbance("hub gone", wire.HubGone),
    Disturbance("bus off", wire.BusOff),
)


class Before:
    """Makes the drill's rig with a drive on CANopenNode in this mode; keeps the bench that was made last."""

    def __init__(self, mode: OperationMode) -> None:
        self.mode = mode
        self.bench: CanopennodeBench | None = None
        self.happenings: Sequence[Happening] = ()

    def __call__(
        self,
        _carrier: str,
        gear: HarmonicDrive,
        motor: ServoMotor,
        happenings: Sequence[Happening],
        stop: StopRequest,
        seed: int,
    ) -> DrilledRig:
        clock = VirtualClock(START_NS)
        bench = CanopennodeBench(
            individual_gear(gear, seed), motor, world=World.of(seed), clock=clock
        )
        usual = wire_config(bench, motor, has_guard=True)
        assert isinstance(usual.drive, DriveConfig)
        config = replace(usual, drive=replace(usual.drive, speed_modes=(self.mode,)))
        self.bench, self.happenings = bench, happenings
        return DrilledRig(
            port=wire_port(bench, motor, config),
            plant=bench,
            clock=clock,
            happenings=happenings,
            stop=stop,
            bench=bench,
        )


@dataclass(frozen=True)
class Row:
    """What came of a disturbance in a mode; times in s."""

    disturbance: Disturbance
    mode: str
    ending: Ending
    stands_after: float
    fastest: float
    """Of its speed when it was disturbed, the largest speed after it."""
    marked: int

    @property
    def is_good(self) -> bool:
        """Whether the motor stands in the end, the file can be read, and the run went on only where it may."""
        ended = self.ending.outcome != "COMPLETED" or self.disturbance.may_go_on
        return ended and self.ending.safe and self.ending.file_readable

    def cell(self) -> str:
        """The row in a cell of the table."""
        ending = self.ending
        causes = [cause for cause in ending.causes if cause not in ending.marks.causes]
        named = ", ".join(causes) or "nothing"
        faster = f", up to {self.fastest:.2f} x" if self.fastest > 1.05 else ""
        if ending.outcome == "COMPLETED":
            marks = f"; {self.marked} rows marked" if self.marked else ""
            return f"{'goes on' if self.disturbance.may_go_on else '**goes on**'}{marks}{faster}"
        words = f"{self.stands_after:.3f} s, {named}{faster}"
        if not ending.safe:
            return f"**TURNS** {words}"
        return words if ending.verified else f"{words}; not verified"


def times(bench: CanopennodeBench, onset_ns: int) -> tuple[float, float]:
    """Stands after [s], and the largest speed within `LOOKED_AT` after the disturbance over the one before it."""
    before = [abs(speed) for ns, speed in bench.log if ns < onset_ns]
    after = [abs(speed) for ns, speed in bench.log if ns >= onset_ns]
    moving = [i for i, speed in enumerate(after) if speed > STANDING_SPEED]
    last = moving[-1] + 1 if moving else 0
    return last * bench.cycle_ns * 1e-9, max(after[:LOOKED_AT]) / max(before[-1], 1e-9)


def run(
    staged: Stage, before: Before, mode: str, disturbances: Sequence[Disturbance]
) -> Iterator[Row]:
    """Each disturbance on a rig of its own."""
    row = staged.reference("wire").rows["hold"]
    for disturbance in disturbances:
        placed = Placed(disturbance.drill(), row)
        ending = staged.run(f"{mode} {disturbance.name}", "wire", (placed,))
        assert before.bench is not None
        onset_ns = before.happenings[0].onset_ns
        after, fastest = times(before.bench, onset_ns or 0)
        marked = sum(int(count) for count in re.findall(r"(\d+) x ", ending.marks.words))
        yield Row(disturbance, mode, ending, after, fastest, marked)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="part of a disturbance's name")
    parser.add_argument("--modes", default="csv,csp,pv")
    chosen = parser.parse_args()
    print(f"CANopenNode in {checkout()}\n", file=sys.stderr)
    modes = chosen.modes.split(",")
    disturbances = [one for one in DISTURBANCES if chosen.only in one.name]
    table: dict[str, list[Row]] = {one.name: [] for one in disturbances}
    for mode in modes:
        before = Before(MODES[mode])
        staging.drilled_rig = before  # type: ignore[assignment]
        with stage(chosen.seed) as staged:
            for row in run(staged, before, mode, disturbances):
                table[row.disturbance.name].append(row)
                print(f"{mode}, {row.disturbance.name}: {row.cell()}", file=sys.stderr)
    print("| disturbance | " + " | ".join(modes) + " |")
    print("|---" * (len(modes) + 1) + "|")
    for name, rows in table.items():
        print(f"| {name} | " + " | ".join(row.cell() for row in rows) + " |")
    bad = [row for rows in table.values() for row in rows if not row.is_good]
    for row in bad:
        print(f"{row.mode}, {row.disturbance.name}: {row.ending.outcome}. {row.ending.message}")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
