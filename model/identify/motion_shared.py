"""Whether neighbouring samples share their noise: the inertia by instruments that are too far apart for that.

Even and odd samples tell what white noise adds to the normal equations. Noise that passed a filter
or an interpolation before it was recorded is the same in both, and inertia comes out too small. The
motion of some periods of the cut-off frequency before and after, Z, has another noise; so

    Z' X b = Z' y

has no such bias, and a difference to the fit that exceeds its own standard error (Durbin, Wu and
Hausman: Econometrica 46 (1978) 1251) says that there is shared noise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from model.identify.checks import Array
from model.identify.least_squares import inverse_of
from model.identify.motion_moments import Moments, lagged_sum, noise_sums

_APART_OF = {"acceleration": "apart_acceleration", "speed": "apart_speed"}
CLEAR = 3.0
"""Standard errors of the difference."""
LARGEST_DOUBT = 0.3
"""Of the inertia, that a difference may be uncertain by to confirm anything."""
_LEAST_SHARE = 0.01
"""Of the inertia, below which a difference is none."""


@dataclass(frozen=True)
class SharedNoise:
    """By how much the inertia is larger by instruments far apart, with its standard error, beside the inertia."""

    difference: float
    standard_uncertainty: float
    inertia: float

    @property
    def is_told(self) -> bool:
        """Whether instruments far apart say enough of the inertia to confirm it."""
        return self.standard_uncertainty < LARGEST_DOUBT * abs(self.inertia)

    @property
    def may_be(self) -> bool:
        """Whether they find much more inertia, and too little of it to be told."""
        return not self.is_told and self.difference > LARGEST_DOUBT * self.inertia > 0.0

    @property
    def share(self) -> float:
        """Of the inertia that noise which samples share has taken off; 0 where none is seen."""
        is_clear = self.difference > CLEAR * self.standard_uncertainty
        share = self.difference / abs(self.inertia) if self.inertia != 0.0 else math.inf
        return share if is_clear and share > _LEAST_SHARE else 0.0


def shared_noise(moments: Moments, regressors: Sequence[str], values: Array) -> SharedNoise:
    """What instruments far apart say beside the fit `values` (p,) by the halves of the position."""
    names, sums = tuple(regressors), moments.sums
    x, y = moments.places(names), moments.names.index("effort")
    z = moments.places([_APART_OF.get(name, name) for name in names])
    place = names.index("acceleration")
    near = sums[:, x][:, :, x] - noise_sums(moments, names)
    far = sums[:, z][:, :, x]
    inertia = float(values[place])
    try:
        own: Array = inverse_of(near.sum(axis=0))[place]
        whole = inverse_of(far.sum(axis=0))
    except np.linalg.LinAlgError:
        return SharedNoise(0.0, math.inf, inertia)
    other: Array = whole[place]
    apart: Array = whole @ sums[:, z, y].sum(axis=0)
    scores = (sums[:, z, y] - far @ apart) @ other - (sums[:, x, y] - near @ values) @ own
    spread, _ = lagged_sum(scores[np.any(near != 0.0, axis=(1, 2))][:, None])
    return SharedNoise(float(apart[place]) - inertia, math.sqrt(float(spread[0, 0])), inertia)
