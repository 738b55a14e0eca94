"""A ladder of models of one quantity: from a null model up, each fitted on some runs and judged on others.

What a protocol measures is brought into a `Sample` per run; a `Rung` is fitted to samples and predicts another one.
Fits minimise the squares by which they are judged, so that a richer rung can only lose where it was not fitted.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from model.arrays import FloatArray, IntArray

if TYPE_CHECKING:
    from experiments.recording import Recording
    from model.gear import HarmonicDrive


@dataclass(frozen=True, kw_only=True)
class Sample:
    """What one run shows: `measured` (n,) in SI; `part` (n,) numbers the stretches of it.

    `origin` is that of the run; `at` is what a model needs to predict it (speeds, angles, steps), `gear` the parameter
    set that the run leans on; `unit` is that of its channel where it is not the ladder's.
    """

    run: str
    origin: str
    measured: FloatArray
    part: IntArray
    at: Any
    gear: HarmonicDrive
    unit: str = ""


@dataclass(frozen=True, kw_only=True)
class Rung:
    """One model: its name, how many numbers it fits, how it is fitted to samples, and what it predicts of another.

    `count` tells the numbers of a fit where they depend on the data; `applies` to which samples it can be fitted.
    """

    name: str
    parameters: int
    fit: Callable[[Sequence[Sample]], Any]
    predict: Callable[[Any, Sample], FloatArray]
    count: Callable[[Any], int] | None = None
    applies: Callable[[Sample], bool] = lambda sample: True

    def numbers(self, fitted: Any) -> int:
        """How many numbers were fitted."""
        return self.parameters if self.count is None else self.count(fitted)


@dataclass(frozen=True, kw_only=True)
class Ladder:
    """The models of one quantity, the null model first. `sample(recording, evidence)` brings a run into its form.

    `is_centred`: a constant of every part belongs to the bench, not to the model, and is taken out of what a rung
    leaves. `shown` is the unit in which a laboratory reads it.
    """

    quantity: str
    unit: str
    shown: str
    sample: Callable[[Recording, Any], Sample]
    rungs: tuple[Rung, ...]
    is_centred: bool = False

    def left(self, rung: Rung, fitted: Any, sample: Sample) -> FloatArray:
        """What a fitted rung leaves of a sample (n,)."""
        residual = sample.measured - rung.predict(fitted, sample)
        return centred(residual, sample.part) if self.is_centred else residual

    def rungs_for(self, samples: Sequence[Sample]) -> tuple[Rung, ...]:
        """The rungs that can be fitted to all of these."""
        return tuple(rung for rung in self.rungs if all(map(rung.applies, samples)))


def centred(values: FloatArray, part: IntArray) -> FloatArray:
    """Values (n,) without the mean of their part (n,)."""
    counts = np.bincount(part)
    return values - (np.bincount(part, weights=values) / np.maximum(counts, 1))[part]


def nothing_fitted(samples: Sequence[Sample]) -> None:
    """The fit of a rung that has none."""
