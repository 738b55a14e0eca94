"""Arrays by the numbers that they hold, named once for physics, experiments and the simulated rig; and what is made of
numbers and arrays that may not be there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


def quotient(part: float, whole: float, otherwise: float = math.nan) -> float:
    """A part over its whole; `otherwise` where the whole is not above zero and nothing can be told."""
    return part / whole if whole > 0.0 else otherwise


def joined(pieces: Sequence[FloatArray]) -> FloatArray:
    """Arrays end to end; an empty one where there are none."""
    return np.concatenate(pieces) if pieces else np.empty(0)
