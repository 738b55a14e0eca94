"""What can be said of a source beside the bus: each kind brings its table along, and is named once, in `AnySource`."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from drivers import channel as names
from model.units import RPM
from rig.bench.config.parts import Encoder, NotNegative


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

    def settings(self) -> dict[str, Any]:
        """As the driver has it: the speed in rad/s."""
        values = super().settings() | {"largest_speed": self.largest_speed * RPM}
        for name in ("index_position", "index_status", "index_mask", "kind", "host", "port"):
            del values[name]
        return values


AnySource = CounterBox
"""Every kind of source: a union of them, told apart by `kind`."""
