"""What can be said of a source beside the bus: each kind brings its table along, and is named once, in `AnySource`."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from drivers import channel as names
from model.units import RPM
from rig.bench.config.parts import Calibration, Encoder, NotNegative, Part, Positive


class CounterBox(Encoder):
    """An encoder counter on TCP. `latched_by` "trigger": by the SYNC, on the box's trigger line; "request": by the
    question itself, which is no half of a pair. `largest_speed_rpm` of its shaft bounds a count's step per cycle;
    0: from the motor's and the ratio.
    """

    kind: Literal["counter-box"]
    host: str = Field(min_length=1)
    port: Annotated[int, Field(strict=True, ge=1, le=65_535)]
    channel: str = names.OUTPUT_ANGLE
    latched_by: Literal["trigger", "request"] = "trigger"
    largest_speed: NotNegative = Field(default=0.0, alias="largest_speed_rpm")

    @property
    def certified(self) -> Calibration | None:
        """By what its scale is believed."""
        return self.calibration

    @property
    def place(self) -> str:
        """Where it is reached."""
        return f"{self.host}:{self.port}"

    def settings(self) -> dict[str, Any]:
        """As the driver has it: the speed in rad/s."""
        values = super().settings() | {"largest_speed": self.largest_speed * RPM}
        for name in ("index_position", "index_status", "index_mask", "kind", "host", "port"):
            del values[name]
        return values


class PolledReadout(Part):
    """A HEIDENHAIN ND 287 on a serial line beside the rig, recorded as `readout_angle` at times of its own.

    The words are those of [readout], which `rig doctor` reads once; both cannot name the same line.
    """

    kind: Literal["nd-287"]
    url: str = Field(min_length=1)
    baud: Annotated[int, Field(strict=True, ge=110, le=4_000_000)] = Field(
        default=9600, alias="baud_rate"
    )
    data_bits: Literal[7, 8] = 7
    parity: Literal["N", "E", "O"] = "E"
    stop_bits: Literal[1, 2] = 2
    xon_xoff: bool = False
    storage_delay_ms: NotNegative = 1.0
    answer_ms: Positive = 500.0

    @property
    def channel(self) -> str:
        """What it measures."""
        return "readout_angle"

    @property
    def certified(self) -> Calibration | None:
        """A second opinion needs no certificate."""
        return None

    @property
    def place(self) -> str:
        """Where it is reached."""
        return self.url

    def settings(self) -> dict[str, Any]:
        """As the driver has it."""
        values = super().settings()
        del values["kind"]
        return values


AnySource = Annotated[CounterBox | PolledReadout, Field(discriminator="kind")]
"""Every kind of source: a union of them, told apart by `kind`."""
