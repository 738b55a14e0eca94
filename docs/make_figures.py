"""The figures of the explanations, and the first page of a certificate: each made by the program from simulated runs.

python docs/make_figures.py                # all, into docs/screenshots
python docs/make_figures.py uncertainty    # one, by its name
"""

from __future__ import annotations

import re
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any, Literal

import numpy as np
from make_bench_pictures import HERE, made, order

from experiments.result import Plot, Series
from model.friction import friction_torque
from model.gear_file import shipped_gear
from model.units import REVOLUTION, RPM
from rig.analysis.fit.recorded import Fit
from rig.analysis.passport.build import passport
from rig.bench.backends.order import WorldChoice
from rig.gears.acceptance import shipped_acceptance
from rig.present.certificate.gather import certified
from rig.present.certificate.laboratory import LaboratoryWords
from rig.present.certificate.rests_on import manifest_of
from rig.present.certificate.sheets import sheets_of, typeset
from rig.present.figure import draw_png
from rig.runfile.read import open_run
from rig.trial.drill.suite import chosen, run_drills

SIZE = (6.4, 3.0)
"""Inches of a figure beside text."""
_SCRATCH = tempfile.TemporaryDirectory()
RUNS = Path(_SCRATCH.name)
WORN = (0.0,) * 11 + tuple(250.0 * step for step in range(1, 10))
"""Hours of the gear of which the alarms are told: ten runs and one as new, then it wears."""


@cache
def run(protocol: str, **values: Any) -> Fit:
    """One run of the demonstration gear, analysed; a tare comes first."""
    if protocol != "motor-tare":
        run("motor-tare", points=12)
    return made(order(RUNS / "runs", protocol, **values))


def plot_of(protocol: str, name: str) -> Plot:
    """A figure of an analysis, by its name."""
    return next(plot for plot in run(protocol).result.plots if plot.name == name)


def verdicts() -> Plot:
    """The three words of a verdict: value, U and limit."""
    words = {"PASS": (0.8, 0.12), "MARGINAL": (0.95, 0.12), "FAIL": (1.2, 0.12)}
    series = [
        Series(
            label=word,
            x=np.array([float(place)]),
            y=np.array([value]),
            low=np.array([value - u]),
            high=np.array([value + u]),
            style="points",
            group=place - 1,
        )
        for place, (word, (value, u)) in enumerate(words.items(), start=1)
    ]
    limit = Series(label="limit", x=np.array([0.5, 3.5]), y=np.ones(2), style="line", role="limit")
    return Plot(
        name="verdicts",
        title="A value with its U against a limit",
        x_label="measurement",
        y_label="value over limit",
        series=(*series, limit),
    )


def readings() -> Plot:
    """The running torque of one parameter set by both readings of equation 20."""
    speed = np.geomspace(1.0, 3000.0, 200)
    gear = shipped_gear()
    words: dict[str, Literal["energy", "published"]] = {
        "as the equations of motion dissipate": "energy",
        "as published": "published",
    }
    return Plot(
        name="readings",
        title="Equation 20 of one parameter set, by both readings",
        x_label="input speed [r/min]",
        y_label="running torque [mN m]",
        series=tuple(
            Series(label=label, x=speed, y=1e3 * friction_torque(gear, speed * RPM, way), group=n)
            for n, (label, way) in enumerate(words.items())
        ),
        x_scale="log",
    )


def counts() -> Plot:
    """Counts of the output encoder while it creeps, row by row, and the speed that their differences would give."""
    recording = run("kinematic-error").recording
    first = int(np.argmax(np.abs(recording.si("target_speed")) > 1.0)) + 4000
    rows = slice(first, first + 60)
    time = recording.time(rows)
    angle = recording.si("output_angle", rows)
    step = np.min(np.abs(np.diff(angle)[np.diff(angle) != 0.0]))
    return Plot(
        name="counts",
        title="Output encoder at 0.25 r/min: one count is 18 arcsec",
        x_label="time [s]",
        y_label="counts from the first row",
        series=(
            Series(
                label="counted", x=time - time[0], y=np.abs(angle - angle[0]) / step, style="steps"
            ),
        ),
    )


def stopping() -> Plot:
    """The input speed around a drive that tripped over a fault of its own, and what the supervisor did."""
    folder = RUNS / "drill"
    for _ in run_drills(chosen(["encoder stuck, output"]), output=folder):
        pass
    recording = open_run(next(folder.glob("*encoder-stuck*/*.h5")))
    trip = next(event for event in recording.events if event.level == "error")
    time = recording.time() - (trip.time_ns - recording.source.time_ns(0, 1)[0]) * 1e-9
    shown = (time > -0.15) & (time < 0.45)
    speed = np.gradient(recording.si("input_angle"), recording.time())
    steady = np.convolve(speed, np.ones(7) / 7.0, mode="same")[shown] * 60.0 / REVOLUTION
    reach = np.array([np.min(steady), np.max(steady)])
    return Plot(
        name="stopping",
        title="The output encoder sticks in motion: trip, quick stop, servo off",
        x_label="time since the trip [s]",
        y_label="input speed [r/min]",
        series=(
            Series(label="measured", x=time[shown], y=steady),
            Series(label="trip", x=np.zeros(2), y=reach, style="line", role="limit"),
        ),
    )


def alarm() -> Plot:
    """The chart of order 2 of a gear that begins to wear after its eleventh run."""
    folder = RUNS / "worn"
    for hours in WORN:
        asked = order(folder, "kinematic-error", output_revolutions=1.0)
        made(replace(asked, world=WorldChoice(hours=hours)))
    charts = passport(folder, "SN-0815").plots
    return next(plot for plot in charts if plot.title.endswith("of order 2"))


def smooth_ramp() -> Plot:
    """The set-points of the kind of step that its page prints, at 1 kHz."""
    page = (HERE.parent / "howto" / "add-a-step.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"^```python\n(.*?)^```", page, re.DOTALL | re.MULTILINE)
    module = sys.modules["smooth_ramp"] = ModuleType("smooth_ramp")
    exec(compile(code, "add-a-step.md", "exec"), module.__dict__)
    profile = module.HalfCosine(-10.0, 30.0, 1257)
    targets = profile.targets(0, profile.cycles)
    time = np.arange(1, len(targets) + 1) * 1e-3
    return Plot(
        name="smooth-ramp",
        title="A change of speed without a jerk",
        x_label="time [s]",
        y_label="set-point [rad/s]",
        series=(Series(label="set-point", x=time, y=targets),),
    )


def certificate() -> list[bytes]:
    """Both pages of a certificate."""
    for protocol in ("kinematic-error", "friction", "starting-torque"):
        run(protocol)
    accepted = shipped_acceptance("demonstration")
    with certified(RUNS / "runs", "SN-0815", acceptance=accepted) as gathered:
        manifest = manifest_of(gathered)
        told = LaboratoryWords()
        sheets = sheets_of(
            gathered,
            told,
            manifest,
            number="HC-0000000000",
            created="2026-01-01T12:00:00+00:00",
            manifest_file="certificate.manifest.txt",
        )
        return typeset(sheets, format="png", ppi=90.0)


PLOTS: dict[str, Callable[[], Plot]] = {
    "kinematic-error": lambda: plot_of("kinematic-error", "kinematic-error-fit"),
    "orders": lambda: plot_of("kinematic-error", "kinematic-error-orders"),
    "output-revolution": lambda: plot_of("kinematic-error", "transmission-accuracy"),
    "friction": lambda: plot_of("friction", "friction-curve"),
    "reference-speed": lambda: plot_of("friction", "friction-bracket"),
    "starting-torque": lambda: plot_of("starting-torque", "starting-torque"),
    "ladder": lambda: plot_of("velocity-steps", "step-ladder"),
    "step": lambda: plot_of("velocity-steps", "velocity-step-1200"),
    "uncertainty": verdicts,
    "contradictions": readings,
    "counts": counts,
    "stopping": stopping,
    "alarm": alarm,
    "smooth-ramp": smooth_ramp,
}
"""Every figure, by the name of its picture."""


CERTIFICATE = ("certificate-page-one", "certificate-page-two")


def keep(name: str, picture: bytes) -> None:
    """Write a picture, and say so."""
    path = HERE / f"{name}.png"
    path.write_bytes(picture)
    print(f"{path.name}  {len(picture) / 1024:.0f} kB", flush=True)


def main() -> int:
    """Make those that are asked for."""
    names = sys.argv[1:] or [*PLOTS, "certificate"]
    for name in names:
        if name == "certificate":
            for page, picture in zip(CERTIFICATE, certificate(), strict=True):
                keep(page, picture)
        else:
            keep(f"figure-{name}", draw_png(PLOTS[name](), "simulated", SIZE))
    return 0


if __name__ == "__main__":
    sys.exit(main())
