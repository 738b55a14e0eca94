"""The certificate that a laboratory would have written for an encoder of a simulated bench, errors of its own included.

Half of its variance is one wave per revolution (the eccentricity of the coupling), half is reading
error of each point. Both are drawn by the bench's seed: an encoder has one certificate.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from model.angle_certificate import AngleCertificate
from model.kinematic_error import series_value
from model.units import ARCSEC, REVOLUTION
from sim_backend.drawing import bench_encoder
from sim_backend.imperfections import Imperfections
from sim_backend.streams import stream
from sim_backend.world import World

POINTS = 36
_COVERAGE_FACTOR = 2.0
UNCERTAINTY = {"input": 4.0 * ARCSEC, "output": 0.4 * ARCSEC}
"""Expanded uncertainty of every point [rad]."""


def encoder_certificate(
    imperfections: Imperfections, which: Literal["input", "output"], world: World
) -> AngleCertificate:
    """The certificate of the motor encoder ("input") or output encoder of a world's bench, from its index mark on."""
    errors = bench_encoder(imperfections, which, world)
    angle = np.arange(POINTS) * (REVOLUTION / POINTS)
    shown = series_value(errors.series, errors.index_angle + angle)
    random = stream(world.bench_seed, f"{which} certificate")
    share = UNCERTAINTY[which] / _COVERAGE_FACTOR / math.sqrt(2.0)
    cosine, sine = share * random.standard_normal(2)
    shown += cosine * np.cos(angle) + sine * np.sin(angle)
    shown += share * random.standard_normal(POINTS)
    return AngleCertificate(
        angles=tuple(angle.tolist()),
        errors=tuple(shown.tolist()),
        expanded_uncertainties=(UNCERTAINTY[which],) * POINTS,
        coverage_factor=_COVERAGE_FACTOR,
    )
