"""What two results rest on alike: systematic parts of their uncertainty that cancel in their difference.

    U^2 = k^2 (sum of all u^2),     U_own^2 = k^2 (sum of the u^2 of each alone + sum over shared causes of (u_a - u_b)^2)

A cause is shared where both runs used the same instrument with the same calibration, the same tare,
or the same values from the literature: then its unknown error is the same in both (correlation one;
GUM, F.1.2.3).
"""  # noqa: E501

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from experiments.recording import Recording, RunMetadata
from model.identify.estimate import COVERAGE_FACTOR
from rig.analysis.store import Analysis
from rig.runfile.read import FileSource

CAUSES: Mapping[str, tuple[str, ...]] = {
    "torque scale": ("torque channel",),
    "tare": ("torque channel", "tare"),
    "bearing no-load torque": ("parameter set",),
    "output encoder": ("output encoder as mounted",),
    "motor encoder": ("motor encoder as mounted",),
    "encoder accuracy at this order": ("output encoder as mounted", "motor encoder as mounted"),
}
"""How a line of a budget begins, and what must be the same for its error to be the same."""

Footing = Mapping[str, str]
"""What a result stands on: name of the thing, and text that tells one such thing from another ("" unknown)."""


@dataclass(frozen=True)
class CombinedUncertainty:
    """U of a difference: `independent`, as if nothing were shared; `own`, without what is; `shared` names what is."""

    independent: float
    own: float
    shared: tuple[str, ...]


def footing(recording: Recording, analysis: Analysis) -> Footing:
    """What an analysis of a run stands on."""
    m = recording.metadata
    channel = str(analysis.result.get("options", {}).get("channel") or "torque")
    mounted = f"{m.gear_serial}|{m.mounting}|{m.conditions.get('mounted_on', '')}"
    output, motor = _instrument(recording, "output_angle"), _instrument(recording, "input_angle")
    return {
        "torque channel": _instrument(recording, channel),
        "tare": str(analysis.content.get("tare", {}).get("sha256", "")),
        "parameter set": str(analysis.content.get("gear", "")),
        "output encoder as mounted": output and f"{output}|{mounted}",
        "motor encoder as mounted": motor and f"{motor}|{mounted}",
    }


def _instrument(recording: Recording, channel: str) -> str:
    """One instrument with one calibration; "" where nothing tells it from another one."""
    source = recording.source
    column = (
        next((c.channel for c in source.columns if c.name == channel), None)
        if isinstance(source, FileSource)
        else None
    )
    if column is None:
        return ""
    known = column.serial_number or column.calibration.certificate
    rig = simulated_bench(recording.metadata)
    if not known or (recording.metadata.origin == "simulated" and not rig):
        return ""
    parts = (
        recording.metadata.origin,
        rig,
        column.model,
        column.serial_number,
        column.gain,
        column.offset,
        column.calibration,
    )
    return "|".join(str(part) for part in parts)


def simulated_bench(metadata: RunMetadata) -> str:
    """Which simulated instruments were used: their seed; "" for a run that was not simulated."""
    if metadata.origin != "simulated":
        return ""
    truth = metadata.process.get("truth")
    seeds = truth.get("seeds") if isinstance(truth, Mapping) else None
    return str(
        seeds.get("bench", "") if isinstance(seeds, Mapping) else metadata.process.get("seed", "")
    )


def same_things(first: Footing, second: Footing) -> frozenset[str]:
    """What both stand on."""
    return frozenset(name for name, what in first.items() if what and second.get(name) == what)


def combined_uncertainty(
    first: Mapping[str, Any], second: Mapping[str, Any], same: frozenset[str]
) -> CombinedUncertainty | None:
    """U of the difference of two estimates as the analysis store keeps them; None where one has no uncertainty."""
    a, b = _parts(first), _parts(second)
    if a is None or b is None:
        return None
    shared = tuple(name for name in a if name in b and _is_shared(name, same))
    own = sum(u * u for part in (a, b) for name, u in part.items() if name not in shared)
    own += sum((a[name] - b[name]) ** 2 for name in shared)
    everything = sum(u * u for part in (a, b) for u in part.values())
    return CombinedUncertainty(
        COVERAGE_FACTOR * math.sqrt(everything), COVERAGE_FACTOR * math.sqrt(own), shared
    )


def _parts(estimate: Mapping[str, Any]) -> dict[str, float] | None:
    """Standard uncertainties by source; lines of type A are numbered, as two of one name are still two causes."""
    whole = estimate.get("expanded_uncertainty")
    if whole is None:
        return None
    found: dict[str, float] = {}
    for index, line in enumerate(estimate.get("budget") or ()):
        if line.get("standard_uncertainty") is None:
            return None
        name = str(line["source"]) if line["kind"] == "B" else f"A, line {index}"
        found[name] = math.hypot(found.get(name, 0.0), float(line["standard_uncertainty"]))
    return found or {"interval": float(whole) / COVERAGE_FACTOR}


def _is_shared(source: str, same: frozenset[str]) -> bool:
    return any(
        source.startswith(begin) and same.issuperset(needed) for begin, needed in CAUSES.items()
    )


def own_uncertainty(estimate: Mapping[str, Any], same: frozenset[str]) -> float:
    """U (k = 2) of one estimate without the causes that it shares with others which stand on the
    `same` things; NaN unknown.
    """
    parts = _parts(estimate)
    if parts is None:
        return math.nan
    return COVERAGE_FACTOR * math.sqrt(
        sum(u * u for name, u in parts.items() if not _is_shared(name, same))
    )
