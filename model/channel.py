"""What one count of a channel means: scale, offset, direction, wrap, and the certificate that says so.

SI = direction * scale * counts + offset. One description goes from the rig's configuration through
drivers and run file to the analysis: each floor passes the object on, none copies its fields.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from model.angle_certificate import AngleCertificate
from model.errors import ParameterError
from model.units import REVOLUTION

_Acquired = Literal["latched", "polled"]


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """Why a channel's scale can be believed. Uncertainties are standard uncertainties in the
    channel's unit or relative; `accuracy` is the half-width of an encoder's whole curve. None is not said, 0 is said to
    be none. `temperature` [degC] of its housing is where the scale of a motor's torque holds; None: 20. `lag` [s], with
    its standard uncertainty, is how late the reading is. `curve` is what a certificate states of an encoder, point by
    point. `sensor` names what the reading comes from, with the constant that makes it this quantity: channels of one
    sensor are one instrument. `laboratory` is who calibrated it.
    """

    certificate: str = ""
    date: str = ""
    due: str = ""
    sensor: str = ""
    laboratory: str = ""
    scale_relative_uncertainty: float | None = None
    offset_uncertainty: float | None = None
    accuracy: float | None = None
    temperature: float | None = None
    lag: float | None = None
    lag_uncertainty: float | None = None
    curve: AngleCertificate | None = None


@dataclass(frozen=True, kw_only=True)
class Channel:
    """One measured quantity.

    `scale` is in `unit` per count and positive; `direction` +1 or -1; `modulus` is the wrap range of
    the device's counter (0: it does not wrap; blocks and recordings always carry unwrapped counts).
    For encoders `lines` and `multiplication` are kept apart. `acquired`: "latched" at the SYNC of its
    cycle, or "polled" at a time of its own, which is no half of a pair. A recording that is not in counts
    (`is_counted` false) has plain numbers in their place.
    """

    name: str
    unit: str
    scale: float = 1.0
    offset: float = 0.0
    direction: int = 1
    modulus: int = 0
    is_counted: bool = True
    long_name: str = ""
    model: str = ""
    serial_number: str = ""
    lines: int = 0
    multiplication: int = 0
    acquired: _Acquired = "latched"
    calibration: Calibration = field(default_factory=Calibration)

    def __post_init__(self) -> None:
        if not self.scale > 0.0:
            raise ParameterError(
                "the scale of a channel must be positive",
                where=self.name,
                value=self.scale,
                limit="> 0",
            )
        if self.direction not in (-1, 1):
            raise ParameterError(
                "the direction of a channel is +1 or -1", where=self.name, value=self.direction
            )

    @property
    def gain(self) -> float:
        """The scale with the sign of the direction."""
        return self.direction * self.scale

    @property
    def quantum(self) -> float:
        """The size of one count in SI; 0 where the recording is not in counts."""
        return self.scale if self.is_counted else 0.0

    def to_si(self, counts: NDArray[Any]) -> NDArray[np.float64]:
        """Counts of any shape as SI values."""
        return counts.astype(np.float64) * self.gain + self.offset


def encoder_channel(name: str, *, lines: int, multiplication: int, **details: Any) -> Channel:
    """An angle channel of an incremental encoder with `lines` per revolution counted `multiplication`-fold."""
    if lines <= 0 or multiplication <= 0:
        raise ParameterError(
            "an encoder needs a positive number of lines and multiplication",
            where=name,
            value=f"{lines} lines, x{multiplication}",
            limit="> 0",
        )
    scale = REVOLUTION / (lines * multiplication)
    return Channel(
        name=name,
        unit="rad",
        scale=scale,
        lines=lines,
        multiplication=multiplication,
        **details,
    )
