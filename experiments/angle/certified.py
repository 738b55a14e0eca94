"""What an encoder's certificate takes off its angle: the curve, laid on the run by the index mark that the run saw.

A certificate counts from the index mark. A run that saw no mark of this encoder, or marks that do
not stand whole revolutions apart, does not tell where the curve begins: then nothing is taken off,
the encoder's class stays in the budget, and the result says so.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from experiments.angle.phase_reference import INPUT_SEEN, OUTPUT_SEEN
from experiments.recording import Recording
from model.angle_certificate import AngleCertificate
from model.arrays import FloatArray
from model.units import DEGREE, REVOLUTION

_MARKS_AGREE = 0.1 * DEGREE
"""rad; latches of one mark that stand further apart are not those of one curve: counts were lost."""
_ENDS = {
    "input_angle": ("motor encoder", "input_index", INPUT_SEEN),
    "output_angle": ("output encoder", "output_index", OUTPUT_SEEN),
}


@dataclass(frozen=True, kw_only=True)
class CertifiedAngle:
    """A certificate on the angle of a recording: where the mark stands in the channel's own angle [rad], and the sense
    of that angle against the encoder's counts.
    """

    certificate: AngleCertificate
    mark: float
    direction: int

    def corrected(self, angle: FloatArray) -> FloatArray:
        """The channel's angle [rad] without the encoder's errors; at the mark it stays as it is."""
        own = self.direction * (angle - self.mark)
        return angle - self.direction * self.certificate.error_at(own)


def certified_angle(recording: Recording, channel: str) -> tuple[CertifiedAngle | None, str]:
    """The certificate of "input_angle" or "output_angle" where it can be used; else None, and why it cannot ("" where
    the channel has none).
    """
    signal = recording.signals[channel]
    certificate = signal.calibration.curve
    if certificate is None:
        return None, ""
    mark, why = index_mark(recording, channel)
    if mark is None:
        return None, f"The certificate of the {_ENDS[channel][0]} is not used: {why}"
    return CertifiedAngle(certificate=certificate, mark=mark, direction=signal.direction), ""


def index_mark(recording: Recording, channel: str) -> tuple[float | None, str]:
    """Where the index mark of "input_angle" or "output_angle" stands in the channel's own angle [rad]; else why nobody
    knows.
    """
    _, index, bit = _ENDS[channel]
    marks = _marks(recording, index, bit)
    if not len(marks):
        return None, "the run saw no index mark of it, so that its curve has no zero."
    away = np.remainder(marks - marks[0] + 0.5 * REVOLUTION, REVOLUTION) - 0.5 * REVOLUTION
    apart = float(np.ptp(away))
    if apart > _MARKS_AGREE:
        return None, (
            f"its index marks stand {apart / DEGREE:.3g} degrees beside whole revolutions "
            f"(limit {_MARKS_AGREE / DEGREE:g}): counts were lost."
        )
    return float(marks[0] + np.median(away)), ""


def certified_angles(recording: Recording) -> tuple[dict[str, CertifiedAngle], list[str]]:
    """The encoders whose certificate can be used, by channel, and why that of another one cannot."""
    found = {name: certified_angle(recording, name) for name in _ENDS}
    used = {name: one for name, (one, _) in found.items() if one is not None}
    return used, [sentence for _, sentence in found.values() if sentence]


def angle_of(
    recording: Recording, channel: str, rows: slice, certified: Mapping[str, CertifiedAngle]
) -> FloatArray:
    """An encoder's angle [rad], without the errors that its certificate states."""
    angle = recording.si(channel, rows)
    curve = certified.get(channel)
    return angle if curve is None else curve.corrected(angle)


def _marks(recording: Recording, index: str, bit: int) -> FloatArray:
    """The different angles that were latched at the index marks [rad], in the order of their size."""
    if not recording.has(index, "index_seen"):
        return np.empty(0)
    latched: set[float] = set()
    for rows in recording.blocks(size=1 << 18):
        seen = (recording.stored("index_seen", rows).astype(np.int64) & bit) > 0
        latched.update(np.unique(recording.si(index, rows)[seen]).tolist())
    return np.array(sorted(latched))
