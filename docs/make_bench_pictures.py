"""The pictures of a bench that learnt its own instruments: ramps with a disc, and the output encoder beside the truth.

python docs/make_bench_pictures.py        # into docs/screenshots/bench-ramps.png and bench-encoder.png
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from experiments.angle.certified import index_mark
from experiments.result import Plot, Series
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from model.units import ARCSEC, DEGREE, REVOLUTION
from rig.analysis.fit.recorded import Fit, store
from rig.analysis.fit.run import fit_run
from rig.analysis.learnt_encoder import learn
from rig.bench.backends.order import Order, Setup
from rig.bench.backends.simulated import parts_of
from rig.gears.card import now_text
from rig.present.figure import draw_png
from rig.run.start import run_order
from sim_backend.drawing import bench_encoder

HERE = Path(__file__).resolve().parent / "screenshots"
TURNS = (0.0, 30.0, 150.0)


def order(folder: Path, protocol: str, **values: Any) -> Order:
    """What is asked for one run of the simulated bench."""
    return Order(
        protocol=protocol,
        gear=shipped_gear(),
        motor=shipped_motor(),
        folder=folder,
        serial="SN-0815",
        operator="A. Example",
        values=values,
    )


def made(asked: Order) -> Fit:
    """A run with its analysis."""
    fit = fit_run(run_order(asked, ask=lambda prompt: prompt.consent).path)
    store(fit, now_text())
    return fit


def encoder_plot(folder: Path) -> Plot:
    """The learnt curve with U beside the one that the simulator has, over the encoder's own angle."""
    runs = [made(order(folder, "kinematic-error", mounted_at_deg=turn)) for turn in TURNS]
    curve = learn(fit.path for fit in runs if fit.path is not None).curve.certificate()
    parts = parts_of(order(folder, "kinematic-error"), Setup())
    errors = bench_encoder(parts["imperfections"], "output", parts["world"])
    assert index_mark(runs[0].recording, "output_angle")[0] is not None
    angle = np.linspace(0.0, REVOLUTION, 361)
    true = sum(
        one.cosine * np.cos(one.order * (angle + errors.index_angle))
        + one.sine * np.sin(one.order * (angle + errors.index_angle))
        for one in errors.series
        if one.order <= 8
    )
    x, y = np.array(curve.angles), np.array(curve.errors)
    u = np.array(curve.expanded_uncertainties)
    shown = (
        Series(
            label="learnt, with U",
            x=x / DEGREE,
            y=y / ARCSEC,
            low=(y - u) / ARCSEC,
            high=(y + u) / ARCSEC,
            style="band",
        ),
        Series(label="learnt", x=x / DEGREE, y=y / ARCSEC),
        Series(label="simulator", x=angle / DEGREE, y=np.asarray(true) / ARCSEC, group=1),
    )
    return Plot(
        name="encoder",
        title="Output encoder, learnt from one gear at three angles",
        x_label="angle from the index mark [°]",
        y_label="shown minus true [arcsec]",
        series=shown,
    )


def main() -> None:
    """Make both."""
    with tempfile.TemporaryDirectory() as folder:
        fit = made(order(Path(folder), "torque-scale", inertia=2e-4, inertia_uncertainty=4e-7))
        ramps = replace(fit.result.plots[0], title="A disc of 2.0 kg cm2 on the bare motor")
        (HERE / "bench-ramps.png").write_bytes(draw_png(ramps, "simulated"))
        plot = encoder_plot(Path(folder) / "reversal")
        (HERE / "bench-encoder.png").write_bytes(draw_png(plot, "simulated"))


if __name__ == "__main__":
    main()
