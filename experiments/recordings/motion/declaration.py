"""Inertia and friction from motion: what comes of it, and what it asks of a recording."""

from __future__ import annotations

from experiments.contract import Deferred, Experiment, NoParameters, no_plan
from experiments.need import ANGLES, EFFORTS, SPEEDS, Need
from experiments.quantity import (
    OF_EFFORT_DIFFERENCES,
    Quantity,
)
from experiments.setting import Setting

NAME = "motion"

QUANTITIES = (
    Quantity(name="inertia", title="inertia", unit="", rests_on=OF_EFFORT_DIFFERENCES),
    Quantity(name="viscous", title="viscous friction", unit="", rests_on=OF_EFFORT_DIFFERENCES),
    Quantity(name="coulomb", title="Coulomb friction", unit="", rests_on=OF_EFFORT_DIFFERENCES),
    Quantity(name="static", title="static friction", unit="", rests_on=OF_EFFORT_DIFFERENCES),
    Quantity(name="stribeck_velocity", title="Stribeck velocity", unit="", rests_on={}),
    Quantity(name="viscous_{way}", title="viscous {way}", unit="", rests_on=OF_EFFORT_DIFFERENCES),
    Quantity(name="coulomb_{way}", title="coulomb {way}", unit="", rests_on=OF_EFFORT_DIFFERENCES),
    Quantity(
        name="offset", title="offset", unit="", is_signed=True, rests_on=OF_EFFORT_DIFFERENCES
    ),
    Quantity(
        name="load_sin_{harmonic}",
        title="load, sine {harmonic}",
        unit="",
        is_signed=True,
        rests_on=OF_EFFORT_DIFFERENCES,
    ),
    Quantity(
        name="load_cos_{harmonic}",
        title="load, cosine {harmonic}",
        unit="",
        is_signed=True,
        rests_on=OF_EFFORT_DIFFERENCES,
    ),
    Quantity(
        name="speed_lag",
        title="lag of the measured speed",
        unit="s",
        definition="By how much the instrument channel is later than the motion of the position.",
        is_signed=True,
        rests_on={},
    ),
    Quantity(
        name="relative_error_percent",
        title="relative error percent",
        unit="1",
        definition="100 |effort - model| / |effort| over the samples with motion.",
    ),
    Quantity(
        name="hold_out_error_percent",
        title="hold-out error percent",
        unit="1",
        definition="The same on tenths of the time that the fit had not seen.",
    ),
    Quantity(name="standstill_share", title="share of samples at standstill, left out", unit="1"),
    Quantity(name="least_speed", title="speed below which the axis stands", unit=""),
    Quantity(name="cutoff", title="cut-off of the filter", unit="Hz"),
    Quantity(name="effort_lag", title="lag taken off the effort", unit="s", is_signed=True),
    Quantity(name="condition", title="condition", unit="1"),
    Quantity(name="condition_scaled", title="condition scaled", unit="1"),
    Quantity(name="residual_norm", title="residual norm", unit=""),
    Quantity(name="samples", title="samples", unit="1"),
)

SETTINGS = (
    Setting(
        "variant",
        "auto, symmetric, asymmetric, stribeck",
        "auto",
        "",
        "the friction law is known, or directions differ",
    ),
    Setting("position", "channel", "the angle or position that is there", "", "there are several"),
    Setting(
        "effort", "channel", "the torque, force or current that is there", "", "there are several"
    ),
    Setting(
        "instrument",
        "channel, none",
        "a measured speed or a set-point",
        "",
        "the measured speed is made of the position by the drive: none",
    ),
    Setting(
        "load",
        "gravity, harmonics:K",
        "none",
        "",
        "the residual follows the position: a lever (gravity) or cogging (harmonics:K)",
    ),
    Setting(
        "lag_s", "number", "as the import states it", "s", "the effort is late by a known time"
    ),
    Setting(
        "least_speed",
        "number",
        "from the noise",
        "rad/s or m/s",
        "slow motion creeps, and is no friction at speed",
    ),
    Setting(
        "cutoff_hz",
        "number",
        "from the spectrum",
        "Hz",
        "a resonance or noise reaches into the motion",
    ),
    Setting(
        "decimation",
        "whole number",
        "from the cut-off",
        "",
        "residuals of neighbouring rows are alike",
    ),
    Setting(
        "start", "number", "the beginning", "s", "the beginning of the recording is another motion"
    ),
    Setting("stop", "number", "the end", "s", "the end of the recording is another motion"),
)

EXPERIMENT = Experiment(
    name=NAME,
    title="Inertia and friction from motion",
    summary="inertia and friction from any motion (inverse dynamics)",
    parameters=NoParameters,
    plan=no_plan,
    analyse=Deferred("experiments.recordings.motion.analysis:analyse"),
    asks=Need(channels=((*ANGLES, *SPEEDS), EFFORTS)),
    needs=(),
    has_plan=False,
    quantities=QUANTITIES,
    version=8,
    cuts_gaps=True,
    settings=SETTINGS,
)
