"""What every identification demands of its arrays before it computes: finite, long enough, time that increases."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.errors import IdentificationError

Array = NDArray[np.float64]


def series(name: str, values: ArrayLike, *, minimum: int = 2) -> Array:
    """One channel as a contiguous float64 array of shape (n,); refused if empty, short, not
    one-dimensional or not finite.
    """
    try:
        array = np.ascontiguousarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise IdentificationError(
            "is not an array of numbers",
            where=name,
            remedy="Check the channel map and the unit of this channel.",
        ) from error
    if array.ndim != 1:
        raise IdentificationError(
            "is not one-dimensional", where=name, value=f"shape {array.shape}", limit="shape (n,)"
        )
    if array.size < minimum:
        raise IdentificationError(
            "has too few samples",
            where=name,
            value=array.size,
            limit=f">= {minimum}",
            remedy="Record longer.",
        )
    finite = np.isfinite(array)
    if not finite.all():
        first = int(np.argmin(finite))
        raise IdentificationError(
            f"has {int((~finite).sum())} samples that are not finite numbers, the first at index {first}",
            where=name,
            value=array[first],
            limit="finite numbers",
            remedy="Leave out marked cycles before the analysis; never fill them.",
        )
    return array


def channels(minimum: int = 2, **named: ArrayLike) -> tuple[Array, ...]:
    """Several channels of one recording: each checked by `series`, all of the same length."""
    arrays = tuple(series(name, values, minimum=minimum) for name, values in named.items())
    lengths = {name: len(values) for name, values in zip(named, arrays, strict=True)}
    if len(set(lengths.values())) > 1:
        raise IdentificationError(
            "channels differ in length",
            where=", ".join(lengths),
            value=", ".join(str(n) for n in lengths.values()),
            limit="equal lengths",
            remedy="Pair the channels by SYNC index first.",
        )
    return arrays


def increasing(name: str, time: ArrayLike, *, minimum: int = 2) -> Array:
    """A time axis [s] of shape (n,) that increases strictly."""
    times = series(name, time, minimum=minimum)
    steps = np.diff(times)
    if steps.size and steps.min() <= 0.0:
        at = int(np.argmax(steps <= 0.0)) + 1
        raise IdentificationError(
            f"does not increase at index {at}",
            where=name,
            value=f"{times[at - 1]:.9g} s then {times[at]:.9g} s",
            limit="strictly increasing",
            remedy="Use the hardware stamp of each SYNC and drop doubled cycles.",
        )
    return times


def positive(name: str, value: float) -> float:
    """A number that must be finite and above zero."""
    if not np.isfinite(value) or value <= 0.0:
        raise IdentificationError(
            "must be a finite number above zero", where=name, value=value, limit="> 0"
        )
    return float(value)
