"""Runs for the window to be the parent of: `python children.py KIND FOLDER`. They speak the lines of `rig.run.remote`.

trip      a simulated rig whose drive runs away in the middle of a hold: the supervisor trips, for real
ask       asks the operator a question, notes what it is told, and ends by itself
unsafe    ends without verified standstill
campaign  two runs one after the other; the first one is done when the line "go on" comes
commission  a stage that asks, and one whose purpose is a STOP
mute      ends at once without a report
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

LIMIT = {
    "name": "starting torque",
    "quantity": "starting-torque.starting_torque",
    "unit": "N m",
    "expanded_uncertainty": 0.0023,
    "limit": 0.070,
    "limit_is": "upper",
    "because": "",
}
NOW = 1_800_000_000_000_000_000


def tell(kind: str, **fields: Any) -> None:
    sys.stdout.write(json.dumps({"kind": kind, **fields}) + "\n")
    sys.stdout.flush()


def progress(step: int, what: str, left: float = 3.0) -> None:
    margins = {
        "input_speed": {"peak": 10.0, "limit": 40.0, "margin": 0.75},
        "motor_torque": {"peak": 0.9, "limit": 0.95, "margin": 0.05},
    }
    tell(
        "progress",
        step=step,
        steps=4,
        what=what,
        elapsed=step * 1.0,
        left=left,
        speed=1.0,
        events=0,
        nearest="input_speed",
        margin=0.75,
        margins=margins,
        file="",
    )


def event(level: str, code: str, source: str, text: str) -> None:
    tell("event", time_ns=NOW, level=level, code=code, source=source, text=text)


def report(outcome: str, safe: bool, message: str = "", trip: Any = None) -> None:
    made_safe = {
        "action": "controlled stop",
        "stages": [],
        "safe": safe,
        "verified_by": ["statusword"] if safe else [],
        "problem": "" if safe else "the output still turns",
    }
    tell(
        "report",
        run="00007-ask-SN",
        outcome=outcome,
        path="",
        rows=0,
        message=message,
        trip=trip,
        make_safe=made_safe,
        warnings=[],
        metrics={},
        margins={},
    )


def ask() -> None:
    event("info", "preflight", "preflight", "drive: ready")
    progress(1, "prompt")
    tell("prompt", text="Housing temperature by hand thermometer [°C]?", key="temperature")
    for line in sys.stdin:
        word, _, rest = line.strip().partition(" ")
        event("info", word, "operator", rest)
        if word == "answer":
            break
    event("info", "made-safe", "make-safe", "zero torque: standstill verified by statusword")
    report("COMPLETED", safe=True)


def campaign() -> None:
    done = {"run": "00001-home-SN.h5", "outcome": "COMPLETED", "message": ""}
    ended = {
        "run": "00001-home-SN",
        "outcome": "COMPLETED",
        "path": "",
        "rows": 10,
        "message": "",
        "trip": None,
        "make_safe": {"action": "zero torque", "safe": True, "verified_by": ["statusword"]},
        "margins": {},
    }
    for index, protocol in enumerate(("home", "friction")):
        tell("stage", index=index, protocol=protocol, state="begun")
        progress(1, f"turning in {protocol}")
        for line in sys.stdin:
            event("info", "note", "operator", line.strip())
            break
        event("info", "made-safe", "make-safe", "zero torque: standstill verified by statusword")
        told = {**done, "index": index, "protocol": protocol, "report": ended}
        tell("stage", state="ended", **told)
    tell(
        "report",
        campaign="short",
        gear="SN",
        outcome="COMPLETED",
        complete=True,
        verdict="MARGINAL",
        because=["starting torque: MARGINAL", "the tare is of another day"],
        limits=[
            {**LIMIT, "value": 0.0619, "outcome": "PASS"},
            {**LIMIT, "value": 0.0690, "outcome": "MARGINAL"},
        ],
        problems=[],
        resumed=[],
        runs=[],
        certificate=["/nowhere/certificate.html", "/nowhere/certificate.pdf"],
    )


def commission() -> None:
    names = ("hand", "stop-key")
    rows = [{"protocol": name, "nominal": 0.0, "longest": 0.0} for name in names]
    tell("campaign", campaign="commissioning", gear="SN", title="commissioning", stages=rows)
    for index, name in enumerate(names):
        seen = {"does": f"{name} is done.", "must_be_seen": "It stands."}
        tell("stage", index=index, protocol=name, state="begun", **seen)
        if name == "hand":
            tell("prompt", text="Press it.", key="press", consent="it is pressed")
        else:
            progress(1, "turning")
        # An answer, or the STOP.
        for _ in sys.stdin:
            break
        ended = {"outcome": "COMPLETED", "path": "", "rows": 0, "make_safe": {"safe": True}}
        tell(
            "stage",
            index=index,
            protocol=name,
            state="ended",
            run="",
            outcome="COMPLETED",
            report=ended,
        )
    tell("stage", index=1, protocol="coupled", state="begun", does="", must_be_seen="")
    tell("stage", index=1, protocol="coupled", state="ended", outcome="COMPLETED", report=ended)
    tell(
        "report",
        campaign="commissioning",
        gear="SN",
        complete=True,
        outcome="COMPLETED",
        verdict="every stage is done",
        lines=["2 stages; every stage is done"],
    )


def unsafe() -> None:
    progress(2, "hold 300 r/min")
    event(
        "error", "over_speed", "session", "TRIPPED over_speed: the input turns too fast, row 100."
    )
    event(
        "error",
        "make-safe-failed",
        "make-safe",
        "STANDSTILL NOT VERIFIED after quick stop: the output still turns.",
    )
    trip = {
        "cause": "over_speed",
        "row": 100,
        "value": 400.0,
        "limit": 320.0,
        "unit": "rad/s",
        "action": "quick stop",
    }
    report("TRIPPED", safe=False, message="the output still turns", trip=trip)


def trip(folder: Path) -> None:
    from drivers.clock import WallClock
    from model.gear_file import shipped_gear
    from model.motor import shipped_motor
    from rig.bench.backends.assembly import AssembledRig
    from rig.bench.backends.order import Order
    from rig.run.dry_run import plan_run
    from rig.run.latch import TripLatch
    from rig.run.opening import begin_inline_run
    from rig.run.parts import SessionParts
    from rig.run.remote import RemoteOperator, lines_of
    from rig.run.session import execute
    from rig.run.stop import StopRequest
    from rig.trial.drill.protocol import EXPERIMENT, DrillParameters
    from rig.trial.drill.rigs import Happening, drilled_rig
    from sim_backend import faults

    gear, motor, stop = shipped_gear(), shipped_motor(), StopRequest()
    rig = drilled_rig(
        "sim",
        gear,
        motor,
        [Happening(500, lambda at: faults.RunAway(at, speed=250.0, cycles=400))],
        stop,
        seed=0,
    )
    planned = plan_run(EXPERIMENT, DrillParameters(), gear, motor)
    remote = RemoteOperator(stop, lambda line: print(line, flush=True), WallClock())
    remote.listen_in_background(lines_of(sys.stdin.fileno()))
    order = Order(
        protocol="drill",
        gear=gear,
        motor=motor,
        folder=folder,
        operator="A. Example",
        serial="SN-1",
    )
    parts = SessionParts(
        order=order,
        planned=planned,
        rig=AssembledRig(name="drill", port=rig, clock=rig.clock),
        cycles=20,
        latch=TripLatch(folder),
    )
    remote.report(
        execute(
            parts,
            begin_inline_run,
            stop=stop,
            ask=remote.ask,
            on_progress=remote.on_progress,
            on_event=remote.on_event,
        ).as_json()
    )


if __name__ == "__main__":
    kind = sys.argv[1]
    if kind == "trip":
        trip(Path(sys.argv[2]))
    elif kind == "mute":
        sys.stderr.write("The configuration cannot be accepted: rig.toml: no such motor.\n")
        raise SystemExit(2)
    else:
        {"ask": ask, "unsafe": unsafe, "campaign": campaign, "commission": commission}[kind]()
