"""The files that describe a bench, as a run uses them: their bytes, to be kept with their hash."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from rig.bench.config.load import load_configuration
from rig.bench.config.schema import RigConfiguration
from rig.errors import ConfigurationError


@dataclass(frozen=True)
class UsedFile:
    """One file that a person wrote and a run uses: its name, what it is, its bytes."""

    name: str
    kind: Literal["rig description", "calibration"]
    content: bytes = field(repr=False)

    @property
    def sha256(self) -> str:
        """The SHA-256 of its bytes."""
        return hashlib.sha256(self.content).hexdigest()


def files_used(path: Path | None) -> tuple[UsedFile, ...]:
    """The description of a rig and the calibrations that it names; none without a description.

    Raises `ConfigurationError` for one that cannot be accepted.
    """
    if path is None or not path.is_file():
        return ()
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ConfigurationError(
            f"cannot be read: {error.strerror or error}", where=str(path)
        ) from error
    described = UsedFile(path.name, "rig description", content)
    return (described, *dict.fromkeys(_calibrations(load_configuration(path))))


def _calibrations(configuration: RigConfiguration) -> Iterator[UsedFile]:
    """The certificates of encoders that lie in files of their own."""
    for encoder in (configuration.motor_encoder, *configuration.counters):
        file = encoder.calibration.curve
        if file is not None:
            yield UsedFile(file.path, "calibration", file.content)
