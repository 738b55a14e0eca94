"""What can be said of a source beside the bus: each kind brings its table along, and is named once, in `AnySource`.

Kinds of other packages are found by their entry point (`experiments.extensions`), where a description names one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Final, Literal

from pydantic import Discriminator, Field, Tag, ValidationError, WrapValidator
from pydantic.functional_validators import ModelWrapValidatorHandler

from drivers import channel as names
from drivers.clock import Clock
from drivers.source import Source
from experiments import extensions
from experiments.errors import ExtensionError
from model.units import RPM
from rig.bench.config.parts import Calibration, Encoder, NotNegative, Part, Positive


@dataclass(frozen=True)
class Shafts:
    """The greatest speeds [rad/s] of the shafts, with room: of the motor and, over the ratio, of the output."""

    motor: float
    output: float

    def of(self, channel: str) -> float:
        """That of the shaft on which a channel is measured."""
        return self.output if channel == names.OUTPUT_ANGLE else self.motor


class SourceDescription(Part):
    """The table `[[source]]` of a kind that another package brings; its own fields are added by deriving from it.

    `channel` is the first channel that it measures, `place` where it is reached.
    """

    kind: str
    channel: str = Field(min_length=1)

    @property
    def certified(self) -> Calibration | None:
        """By what its scale is believed."""
        return None

    @property
    def place(self) -> str:
        """Where it is reached, in words."""
        return self.kind


@dataclass(frozen=True)
class SourceKind:
    """A kind of source: what `rig.toml` says of one, and how it becomes a driver that is not yet connected."""

    described: type[SourceDescription]
    make: Callable[[Any, Shafts, Clock], Source]


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


OURS: Final = ("counter-box", "nd-287")
_ANOTHER = "of another package"


def _tag(table: Any) -> str:
    kind = table.get("kind") if isinstance(table, Mapping) else getattr(table, "kind", "")
    return kind if kind in OURS else _ANOTHER


def brought(kind: str) -> extensions.Extension | None:
    """What another package brings as a source of this kind; None for ours, and where there is none."""
    found = extensions.usable(("sources",), OURS)
    return next((one for one in found if one.name == kind), None)


def _brought(table: Any, handler: ModelWrapValidatorHandler[SourceDescription]) -> Any:
    if isinstance(table, SourceDescription):
        return table
    kind = str(table.get("kind", ""))
    one = brought(kind)
    if one is None:
        there = [*OURS, *(e.name for e in extensions.usable(("sources",), OURS))]
        raise ValueError(f"kind: no source is called {kind!r}; there are {', '.join(there)}")
    try:
        loaded: SourceKind = one.loaded(SourceKind)
        return loaded.described.model_validate(table)
    except ExtensionError as error:
        raise ValueError(str(error)) from error
    except ValidationError as error:
        first = error.errors()[0]
        raise ValueError(f"{'.'.join(map(str, first['loc']))}: {first['msg']}") from error


AnySource = Annotated[
    Annotated[CounterBox, Tag("counter-box")]
    | Annotated[PolledReadout, Tag("nd-287")]
    | Annotated[SourceDescription, WrapValidator(_brought), Tag(_ANOTHER)],
    Discriminator(_tag),
]
"""Every kind of source: a union of them, told apart by `kind`."""
