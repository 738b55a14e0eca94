"""A compensation table from the kinematic-error runs of a gear: the orders that it shows, each direction on its own.

What a run shows is quasi-static, by the motor encoder as the drive counts it and by the output encoder as it is known
(its certificate, or what the bench learnt). A compensated-error run that proves a table gives the same table with its
proof.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from experiments.recording import Recording
from model.compensation import CompensationTable, DirectionTable, Proof
from model.compensation_file import compensation_from
from model.identify.directions import combine
from model.identify.encoders import Encoders
from model.identify.kinematic_error import KinematicErrorFit
from rig.analysis.fit.run import evidence_for
from rig.analysis.in_force import in_force
from rig.analysis.learnt import bench_of
from rig.content.phrase import quoted
from rig.errors import ConfigurationError
from rig.runfile.header import gear_name
from rig.runfile.read import close_recording, open_run
from rig.runfile.seal import sealed_sha256

KIND, PROOF_KIND = "kinematic-error", "compensated-error"


@dataclass(frozen=True, kw_only=True)
class _RunOrders:
    """One run: what it is of, its fits, and how its index marks stand."""

    path: Path
    recording: Recording
    fits: list[KinematicErrorFit]
    encoders: Encoders
    gap: float
    speed: float

    @property
    def same(self) -> dict[str, object]:
        """What all runs of a table have in common."""
        metadata = self.recording.metadata
        encoder = self.recording.signals["output_angle"]
        return {
            "gear": metadata.gear_serial,
            "part": gear_name(metadata),
            "mounting": metadata.mounting,
            "bench": bench_of(metadata),
            "origin": metadata.origin,
            "encoder": encoder.serial_number,
            "learnt": encoder.calibration.certificate if encoder.calibration.curve else "",
        }


def table_from(runs: Sequence[Path]) -> CompensationTable:
    """The table of kinematic-error runs of one gear as it is mounted. Raises `ConfigurationError` for none."""
    seen = [_orders_of_run(run) for run in runs]
    try:
        first = seen[0]
        for other in seen[1:]:
            _refuse_other(first, other)
        same = first.same
        metadata = first.recording.metadata
        speeds = [one.speed for one in seen]
        ratio = first.fits[0].ratio
        labels = _orders_shown([fit for one in seen for fit in one.fits])
        if not labels:
            raise ConfigurationError(
                "show no order above their noise: there is nothing to take out",
                where=", ".join(run.name for run in runs),
            )
        ways = {
            name: _direction(
                [fit for one in seen for fit in one.fits if fit.direction * sign > 0.0],
                labels,
                first.encoders,
            )
            for name, sign in (("forward", 1.0), ("reverse", -1.0))
        }
        return CompensationTable(
            **same,  # type: ignore[arg-type]
            ratio=ratio,
            sense=metadata.output_sense,
            index_gap=_mean_gap([one.gap for one in seen]),
            speed=(min(speeds), max(speeds)),
            temperature=_temperature([one.recording for one in seen]),
            runs=tuple(f"{run.name} {sealed_sha256(run)}" for run in runs),
            **ways,
        )
    finally:
        for one in seen:
            close_recording(one.recording)


def _orders_of_run(run: Path) -> _RunOrders:
    from experiments.protocols.kinematic_error.traverses import fitted_traverses

    recording, evidence = evidence_for(run, KIND)
    if recording.metadata.experiment != KIND:
        raise ConfigurationError(
            "is a run of another protocol",
            where=str(run),
            value=recording.metadata.experiment,
            limit=KIND,
        )
    # The drive follows the motor encoder as it counts: its errors are taken out with the gear's.
    signal = recording.signals["input_angle"]
    bare = replace(signal, calibration=replace(signal.calibration, curve=None))
    as_driven = replace(recording, signals={**recording.signals, "input_angle": bare})
    fits, reference, encoders = fitted_traverses(as_driven, evidence)
    ways = {fit.direction for fit in fits}
    if reference.what != "index marks" or ways != {1.0, -1.0}:
        close_recording(recording)
        raise ConfigurationError(
            "does not tell where a table would lie, in both directions",
            where=str(run),
            value=f"angles count from: {reference.what}; directions: {len(ways)}",
            limit="both index marks, both directions",
            remedy="Run `kinematic-error` over a whole output turn.",
        )
    speed = abs(recording.labelled("traverse")[0].setpoint)
    return _RunOrders(
        path=run,
        recording=recording,
        fits=fits,
        encoders=encoders,
        gap=reference.gap,
        speed=speed,
    )


def _refuse_other(first: _RunOrders, other: _RunOrders) -> None:
    for name, value in first.same.items():
        if other.same[name] != value:
            raise ConfigurationError(
                f"is of another {name} than {first.path.name}",
                where=str(other.path),
                value=other.same[name],
                limit=str(value),
                remedy="A table is of one gear, as it is mounted, on one bench.",
            )
    if abs(math.remainder(other.gap - first.gap, 1.0)) > 0.02:
        raise ConfigurationError(
            f"has its index marks elsewhere than {first.path.name}: the gear was mounted anew between them",
            where=str(other.path),
            value=f"{other.gap:.3f} input revolutions apart",
            limit=f"{first.gap:.3f}",
        )


def _orders_shown(fits: Sequence[KinematicErrorFit]) -> tuple[str, ...]:
    """The orders that the gear shows, by the mean of both directions of every pair of traverses: lowest first."""
    ahead = [fit for fit in fits if fit.direction > 0.0]
    back = [fit for fit in fits if fit.direction < 0.0]
    votes: dict[str, int] = {}
    orders: dict[str, float] = {}
    pairs = [
        combine(one, other)
        for one, other in zip(ahead, back, strict=False)
        if one.basis.orders == other.basis.orders
    ]
    for pair in pairs:
        for label, order in zip(pair.labels, pair.orders, strict=True):
            found = pair.estimates.get(f"phase_{label}")
            amplitude = pair.estimates.get(f"amplitude_{label}")
            if found is not None and amplitude is not None and amplitude.low > 0.0:
                votes[label] = votes.get(label, 0) + 1
                orders[label] = order
    chosen = [label for label, count in votes.items() if 2 * count > len(pairs)]
    return tuple(sorted(chosen, key=orders.__getitem__))


def _direction(
    fits: Sequence[KinematicErrorFit], labels: Sequence[str], encoders: Encoders
) -> DirectionTable:
    """The mean over all traverses of one direction, order by order; the larger of each one's own noise and their
    scatter.
    """
    values, blocks, encoder = [], [], []
    for label in labels:
        at = [(fit, fit.basis.labels.index(label)) for fit in fits if label in fit.basis.labels]
        vectors = np.array([fit.regression.values[2 + 2 * k : 4 + 2 * k] for fit, k in at])
        own = np.mean(
            [
                fit.regression.covariance[2 + 2 * k : 4 + 2 * k, 2 + 2 * k : 4 + 2 * k]
                for fit, k in at
            ],
            axis=0,
        )
        count = len(at)
        scatter = float(np.sum((vectors - vectors.mean(axis=0)) ** 2)) / max(count - 1, 1)
        wider = max(scatter / float(np.trace(own)), 1.0) if count > 1 else 1.0
        values.append(vectors.mean(axis=0))
        blocks.append(own * wider / count)
        fit, k = at[0]
        encoder.append(encoders.output_wave(fit.basis.orders[k], fit.ratio))
    wave = np.array(values)
    covariance = [(float(b[0, 0]), float(b[0, 1]), float(b[1, 1])) for b in blocks]
    return DirectionTable(
        labels=tuple(labels),
        cosine=tuple(wave[:, 0].tolist()),
        sine=tuple(wave[:, 1].tolist()),
        covariance=tuple(covariance),
        encoder=tuple(encoder),
        freedom=float(min(fit.regression.freedom for fit in fits)),
        rest=math.sqrt(float(np.mean([_rest(fit, labels) for fit in fits]))),
    )


def _rest(fit: KinematicErrorFit, labels: Sequence[str]) -> float:
    """Mean square of the orders that a traverse shows above its noise and the table leaves [rad2]."""
    total = 0.0
    for k, label in enumerate(fit.basis.labels):
        if label not in labels:
            at = slice(2 + 2 * k, 4 + 2 * k)
            own = float(np.trace(fit.regression.covariance[at, at]))
            total += 0.5 * (float(np.sum(fit.regression.values[at] ** 2)) - own)
    return max(total, 0.0)


def _mean_gap(gaps: Sequence[float]) -> float:
    """The mean on the circle of one input revolution."""
    return float(np.angle(np.mean(np.exp(2j * np.pi * np.array(gaps)))) / (2.0 * np.pi)) % 1.0


def _temperature(recordings: Sequence[Recording]) -> float | None:
    """Mean housing temperature [degC]; None where one was not recorded."""
    if not all(one.has("housing_temperature") for one in recordings):
        return None
    found = [
        float(np.mean(one.si("housing_temperature", slice(0, one.rows, max(one.rows // 1000, 1)))))
        for one in recordings
    ]
    return float(np.mean(found))


def proved_table(run: Path) -> CompensationTable:
    """The table that a compensated-error run was driven by, with what the run shows of it, by its analysis in force."""
    recording = open_run(run, rows=False)
    metadata = recording.metadata
    close_recording(recording)
    if metadata.experiment != PROOF_KIND:
        raise ConfigurationError(
            "is a run of another protocol",
            where=str(run),
            value=metadata.experiment,
            limit=PROOF_KIND,
        )
    found = in_force(run, PROOF_KIND)
    if found.analysis is None or found.stale:
        raise ConfigurationError(
            "has no analysis in force", where=str(run), remedy=f"Analyse it: rig fit {quoted(run)}"
        )
    result = found.analysis.whole_result()
    table = compensation_from(str(metadata.parameters["table"]), run.name)
    ratio, numbers = result.estimates["proof_ratio"], result.metrics
    return replace(
        table,
        proof=Proof(
            run=f"{run.name} {sealed_sha256(run)}",
            verdict=str(result.options["proof"]),
            speed=table.speed[1],
            ratio=ratio.value,
            low=ratio.low,
            high=ratio.high,
            removed=numbers["removed"],
            helps_up_to=numbers.get("helps_up_to"),
            harms_from=numbers.get("harms_from"),
        ),
    )


def kinds_of(runs: Sequence[Path]) -> Iterator[str]:
    """The protocol of each run."""
    for run in runs:
        recording = open_run(run, rows=False)
        yield recording.metadata.experiment
        close_recording(recording)
