"""What every table of a rig's description is made of: checked words, calibrations, instruments, encoders.

A field has the name that the driver has for it, the word of the file where that differs is its alias: so
`Part.settings` yields what the driver's configuration is made of, and nothing is copied by hand.
"""

from __future__ import annotations

import datetime
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    PlainSerializer,
    PlainValidator,
    ValidationInfo,
    model_validator,
)

from drivers import channel as names
from rig.bench.config.certificate_file import CertificateFile, read_certificate
from rig.bench.config.objects import read_object

FOLDER = "folder"
"""What a description is validated with: where the files lie that it names."""


def _object_text(text: str) -> str:
    read_object(text)
    return text


def _certificate(name: object, info: ValidationInfo) -> CertificateFile | None:
    """The certificate that a word names, in the folder of the description."""
    if name is None or isinstance(name, CertificateFile):
        return name
    if not isinstance(name, str):
        raise ValueError("is not the name of a file")
    if not name:
        return None
    folder = (info.context or {}).get(FOLDER, Path())
    found = read_certificate(folder, name)
    if found.header.learnt:
        raise ValueError(
            f"{name} was learnt from gears: it belongs beside their runs, where an analysis leaves out what a gear "
            "taught of itself; name a laboratory's certificate here"
        )
    return found


NodeId = Annotated[int, Field(strict=True, ge=1, le=127)]
ObjectText = Annotated[str, AfterValidator(_object_text)]
"""An entry of an object dictionary as text: "0x6004:0 I32", or bytes of one: "0x2C00:1 U16 at byte 1 of 6"."""
Direction = Literal[-1, 1]
Positive = Annotated[float, Field(strict=True, gt=0.0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(strict=True, ge=0.0, allow_inf_nan=False)]
Milliseconds = Annotated[int, Field(strict=True, ge=1, le=60_000)]
Word = Annotated[int, Field(strict=True, ge=0, le=0xFFFF_FFFF)]
Curve = Annotated[
    CertificateFile | None,
    PlainValidator(_certificate),
    PlainSerializer(lambda file: "" if file is None else file.path, return_type=str),
]
"""The file of an encoder's certificate, beside the file that names it; "" for none."""


class Part(BaseModel):
    """A table of the file."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=False, str_strip_whitespace=True)
    objects: ClassVar[Mapping[str, str]] = {}
    """Fields that name entries of an object dictionary, and what to call the entry in a message."""

    def settings(self) -> dict[str, Any]:
        """Every value by the name that the driver has for it, in SI, with the entries of object dictionaries read."""
        values = {name: getattr(self, name) for name in type(self).model_fields}
        for name, what in self.objects.items():
            if values[name] is not None:
                values[name] = read_object(values[name], what)
        return values


class Calibration(Part):
    """Why a channel's scale can be believed: certificate, day, day on which it is due again, standard uncertainties.

    `offset_uncertainty` and `accuracy` are in the channel's SI unit (rad, N m, degC); `accuracy` is no standard
    uncertainty but half the width of an encoder's whole curve, as data sheets state it. What is left away is not zero:
    `experiments.assumed` says what is taken in its place. `curve` names the file of an
    encoder's certificate, beside this one; what it says of number and days need not be said again. `sensor` names what
    the reading comes from, with its constant: channels of one sensor are one instrument. `laboratory` is who
    calibrated it.
    """

    certificate: str = ""
    date: datetime.date | None = None
    due: datetime.date | None = None
    sensor: str = ""
    laboratory: str = ""
    scale_relative_uncertainty: NotNegative | None = None
    offset_uncertainty: NotNegative | None = None
    accuracy: NotNegative | None = None
    curve: Curve = None

    @model_validator(mode="after")
    def _as_certified(self) -> Calibration:
        """With number and days of the certificate's file; what is said twice is the same."""
        if self.curve is None:
            return self
        stated = {name: getattr(self.curve.header, name) for name in ("certificate", "date", "due")}
        for name, value in stated.items():
            if name in self.model_fields_set and getattr(self, name) != value:
                raise ValueError(
                    f"{name} = {getattr(self, name)} stands here and {value} in {self.curve.path}: leave it away here"
                )
        return self.model_copy(update=stated)

    @model_validator(mode="after")
    def _in_order(self) -> Calibration:
        if self.date is not None and self.due is not None and self.due < self.date:
            raise ValueError(f"it is due on {self.due}, before its date {self.date}")
        if (self.date is not None or self.due is not None) and not self.certificate:
            raise ValueError(
                "a date without a certificate: name the certificate, or the record of the check"
            )
        return self

    def settings(self) -> dict[str, Any]:
        """As the channel has it: days as text."""
        curve = None if self.curve is None else self.curve.curve
        days = {"date": str(self.date or ""), "due": str(self.due or "")}
        return super().settings() | days | {"curve": curve}


class Instrument(Part):
    """What every channel may tell of its instrument."""

    model: str = ""
    serial_number: str = ""
    calibration: Calibration = Calibration()

    def settings(self) -> dict[str, Any]:
        """As a driver has it, with the calibration of its channel."""
        return super().settings() | {
            "calibration": names.Calibration(**self.calibration.settings())
        }


class Encoder(Instrument):
    """An incremental encoder: lines and multiplication apart, sense, and the latch of its index
    mark where there is one.
    """

    objects: ClassVar[Mapping[str, str]] = {
        "index_position": "index position",
        "index_status": "index status",
    }

    lines: Annotated[int, Field(strict=True, ge=1, le=100_000_000)]
    multiplication: Annotated[int, Field(strict=True, ge=1, le=1_000_000)]
    direction: Direction = 1
    index_position: ObjectText | None = None
    index_status: ObjectText | None = None
    index_mask: Word = 0x0001

    @model_validator(mode="after")
    def _own_certificate(self) -> Encoder:
        file = self.calibration.curve
        if file is not None and file.header.serial_number not in ("", self.serial_number):
            raise ValueError(
                f"the certificate {file.path} is of serial number {file.header.serial_number!r}, "
                f"the encoder's is {self.serial_number!r}"
            )
        return self
