"""What two results rest on alike: systematic parts of their uncertainty that cancel in their difference.

    U^2 = k^2 (sum of all u^2),     U_own^2 = k^2 (sum of the u^2 of each alone + sum over shared causes of (u_a - u_b)^2)

with k by the effective degrees of freedom of what is summed.

A cause is shared where both runs used the same instrument with the same calibration, the same tare,
or the same values from the literature: then its unknown error is the same in both (correlation one;
GUM, F.1.2.3).
"""  # noqa: E501

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from experiments.recording import Recording, RunMetadata, mapping_of
from model.identify.estimate import (
    NORMAL_COVERAGE_FACTOR,
    BudgetLine,
    Cause,
    Estimate,
    Ground,
    coverage_factor_of,
)
from rig.analysis.store import Analysis
from rig.runfile.source import FileSource

Grounds = Mapping[Ground, str]
"""What a result rests on: a text that tells one such thing from another ("" unknown)."""

_Part = tuple[str, Cause | None]
"""A source of uncertainty in words, and its cause."""


@dataclass(frozen=True)
class _CombinedUncertainty:
    """U of a difference: `independent`, as if nothing were shared; `own`, without what is; `shared` names what is."""

    independent: float
    own: float
    shared: tuple[str, ...]


def grounds_of(recording: Recording, analysis: Analysis) -> Grounds:
    """What an analysis of a run rests on."""
    m = recording.metadata
    channel = str(analysis.result.options.get("channel") or "torque")
    mounted = f"{m.gear_serial}|{m.mounting}|{m.conditions.get('mounted_on', '')}"
    output, motor = _instrument(recording, "output_angle"), _instrument(recording, "input_angle")
    return {
        Ground.TORQUE_CHANNEL: _instrument(recording, channel)
        + str(analysis.result.options.get("torque_scale", "")),
        Ground.TARE: str(analysis.content.get("tare", {}).get("sha256", "")),
        Ground.PARAMETER_SET: str(analysis.content.get("gear", "")),
        Ground.OUTPUT_ENCODER: output and f"{output}|{mounted}",
        Ground.MOTOR_ENCODER: motor and f"{motor}|{mounted}",
    }


def _instrument(recording: Recording, channel: str) -> str:
    """One instrument with one calibration; "" where nothing tells it from another one."""
    source = recording.source
    column = None
    if isinstance(source, FileSource):
        column = next((c.channel for c in source.columns if c.name == channel), None)
    if column is None:
        return ""
    identity = column.serial_number or column.calibration.certificate
    rig = simulated_bench(recording.metadata)
    # Every simulated rig has the same serial numbers: without its seed it cannot be told from another.
    if not identity or (recording.metadata.origin == "simulated" and not rig):
        return ""
    parts = (
        recording.metadata.origin,
        rig,
        column.model,
        column.serial_number,
        column.gain,
        column.offset,
        # The word for what it comes from is newer than runs, and changes no reading.
        replace(column.calibration, sensor=""),
    )
    return "|".join(str(part) for part in parts)


def simulated_bench(metadata: RunMetadata) -> str:
    """Which simulated instruments were used: their seed; "" for a run that was not simulated."""
    if metadata.origin != "simulated":
        return ""
    world = metadata.process.get("world")
    if isinstance(world, Mapping):
        return str(world.get("bench_seed", ""))
    # Version 0.1.0 named its seeds elsewhere.
    seeds = mapping_of(metadata.process.get("truth")).get("seeds")
    if isinstance(seeds, Mapping):
        return str(seeds.get("bench", ""))
    return str(metadata.process.get("seed", ""))


def which_mounting(metadata: RunMetadata) -> str:
    """Since when a gear is mounted as it is; in a simulated world which of its mountings it is."""
    mount = mapping_of(metadata.process.get("world")).get("mount")
    turned = metadata.parameters.get("mounted_at_deg")
    told = (
        metadata.conditions.get("mounted_on", ""),
        "" if mount is None else f"mounting {mount}",
        "" if turned is None else f"at {turned:g} degrees",
    )
    return ", ".join(str(one) for one in told if one)


def common_grounds(first: Grounds, second: Grounds) -> frozenset[Ground]:
    """What both rest on."""
    return frozenset(ground for ground, what in first.items() if what and second[ground] == what)


def combined_uncertainty(
    first: Estimate, second: Estimate, common: frozenset[Ground]
) -> _CombinedUncertainty | None:
    """U of the difference of two estimates; None where one has no uncertainty."""
    a, b = _parts(first), _parts(second)
    if a is None or b is None:
        return None
    shared = tuple(part for part in a if part in b and _is_shared(part, common))
    own = [line for parts in (a, b) for part, line in parts.items() if part not in shared]
    own += [
        BudgetLine("", "B", a[part].standard_uncertainty - b[part].standard_uncertainty)
        for part in shared
    ]
    return _CombinedUncertainty(
        _expanded([*a.values(), *b.values()]),
        _expanded(own),
        tuple(source for source, _ in shared),
    )


def _expanded(lines: Sequence[BudgetLine]) -> float:
    """U of the sum of these contributions."""
    return coverage_factor_of(lines) * math.sqrt(
        sum(line.standard_uncertainty**2 for line in lines)
    )


def _parts(estimate: Estimate) -> dict[_Part, BudgetLine] | None:
    """The budget by source; lines of type A are numbered, as two of one name are still two causes."""
    whole = estimate.expanded_uncertainty
    if not math.isfinite(whole):
        return None
    # One that was stated with k = 2 keeps the U that it was stated with.
    stated = 2.0 / NORMAL_COVERAGE_FACTOR if estimate.stated_coverage_factor == 2.0 else 1.0
    parts: dict[_Part, BudgetLine] = {}
    for index, line in enumerate(estimate.budget):
        part: _Part = (f"A, line {index}", None)
        if line.kind == "B":
            part = (line.source, line.cause)
        # Two lines of type B with one source are one error; how well each is known is not told apart.
        before = parts[part].standard_uncertainty if part in parts else 0.0
        parts[part] = BudgetLine(
            part[0],
            line.kind,
            math.hypot(before, stated * line.standard_uncertainty),
            degrees_of_freedom=line.degrees_of_freedom,
            distribution=line.distribution,
        )
    return parts or {("interval", None): BudgetLine("", "A", whole / NORMAL_COVERAGE_FACTOR)}


def _is_shared(part: _Part, common: frozenset[Ground]) -> bool:
    _, cause = part
    return cause is not None and cause.grounds <= common


def own_uncertainty(estimate: Estimate, common: frozenset[Ground]) -> float:
    """U of one estimate without the causes that it shares with others which rest on the
    same grounds; NaN unknown.
    """
    parts = _parts(estimate)
    if parts is None:
        return math.nan
    return _expanded([line for part, line in parts.items() if not _is_shared(part, common)])
