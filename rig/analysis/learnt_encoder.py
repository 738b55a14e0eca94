"""The output encoder of a bench, learnt from the gears that passed over it: from runs to a sealed certificate and back.

What a run shows at orders k/N is brought over the encoder's own angle from its index mark, by the analysis in force of
its kinematic error. What becomes of the file stands in `learnt`.
"""

from __future__ import annotations

import cmath
import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path

import numpy as np

from experiments.angle.certified import certified_angle, index_mark
from experiments.recording import Recording, RunMetadata, mapping_of
from experiments.result import Result
from model.angle_certificate import CERTIFIED_ORDERS, COVERAGE_FACTOR
from model.identify.encoder_contradiction import CHANCE, contradiction
from model.identify.encoder_curve import (
    ComplexArray,
    LearntCurve,
    Mounted,
    learnt_curve,
    left_out,
)
from model.units import ARCSEC, DEGREE
from rig.analysis.causes import which_mounting
from rig.analysis.in_force import in_force
from rig.analysis.learnt import CHANNEL, bench_of, is_known, with_learnt_curve
from rig.bench.config.certificate_file import (
    FORMAT,
    Header,
    certificate_text,
)
from rig.errors import ConfigurationError
from rig.gears.card import UNNAMED
from rig.runfile.read import close_recording, open_run
from rig.runfile.seal import sealed_sha256
from rig.runfile.sealed import write_new_sealed

KIND = "kinematic-error"
_NOT_TRACEABLE = "none: learnt on this bench"
"""How the certificate of a learnt curve begins: no laboratory vouches for it."""
_FARTHEST_ROWS = 1 << 18


@dataclass(frozen=True, kw_only=True)
class _Observation:
    """What one run says of the encoder of its bench. `skipped` says why it says nothing."""

    run: Path
    bench: str = ""
    encoder: str = ""
    gear: str = ""
    mounting: str = ""
    sha256: str = ""
    origin: str = ""
    start: str = ""
    mounted: Mounted | None = None
    skipped: str = ""


@dataclass(frozen=True, kw_only=True)
class Learnt:
    """What the runs of a bench teach of its output encoder."""

    bench: str
    encoder: str
    origin: str
    curve: LearntCurve
    mounted: tuple[Mounted, ...]
    taught: tuple[_Observation, ...]
    skipped: tuple[_Observation, ...]

    def certificate(self, today: date, due: date | None) -> str:
        """The text of its file. Raises `ConfigurationError` where the encoder is not parted from the gears."""
        gears, curve = self.curve.gears, self.curve
        basis = curve.basis
        if basis == "encoder and what the gears share":
            raise ConfigurationError(
                "is no certificate: encoder and what the gears share are one, and nothing is written",
                where=f"output encoder of bench {self.bench}",
                limit="gears at stated angles that are spread over the turn",
                remedy="Write each gear's angle on its card (mounted at deg), mount anew, and run again.",
            )
        count = f"{len(gears)} gears" if len(gears) > 1 else f"gear {next(iter(gears))}"
        header = Header(
            format=FORMAT,
            certificate=f"{_NOT_TRACEABLE} from {count}: {basis}, not traceable",
            date=today,
            due=due,
            serial_number=self.encoder,
            coverage_factor=COVERAGE_FACTOR,
            zero="index mark",
            sense="counting up",
            error="shown minus true",
            learnt=basis,
            bench=self.bench,
            runs=tuple(f"{one.run.name} {one.sha256}" for one in self.taught),
            without={gear: self._without(gear) for gear in gears},
        )
        return certificate_text(header, curve.certificate())

    def _without(self, gear: str) -> tuple[float, ...]:
        """What the other gears teach; nothing where they are too few."""
        found = left_out(self.mounted, gear)
        if isinstance(found, str):
            return ()
        numbers = (found.expanded_uncertainty, *found.waves.ravel().tolist())
        return tuple(float(f"{float(one) / ARCSEC:.6g}") for one in numbers)


def stated_angle(metadata: RunMetadata) -> float | None:
    """The angle of the gear on the output flange [rad] as world, run or card state it; None where nobody did."""
    turn = mapping_of(metadata.process.get("world")).get("mount_turn")
    if turn is not None:
        return float(turn)
    told = metadata.parameters.get("mounted_at_deg")
    if told is None:
        told = metadata.conditions.get("mounted_at_deg")
    return None if told in (None, "") else float(str(told)) * DEGREE


def learn(runs: Iterable[Path], bench: str = "") -> Learnt:
    """The output encoder of a bench by these runs. Raises `ConfigurationError` where they do not tell it."""
    seen = [observed(run) for run in runs]
    taught = [one for one in seen if one.mounted is not None and bench in ("", one.bench)]
    kinds = sorted({(one.origin, one.bench, one.encoder) for one in taught})
    only = kinds[0] if len(kinds) == 1 else None
    if only is None:
        told = "; ".join(f"bench {b}, encoder {e or 'without serial number'}" for _, b, e in kinds)
        what, remedy = "hold no run that tells of an encoder", "Analyse them first: rig fit RUN."
        if kinds:
            what, remedy = "are runs of several benches or encoders", "Name the bench: --bench ID."
        raise ConfigurationError(
            what,
            where="rig bench learn",
            value=told or "; ".join(sorted({one.skipped for one in seen}))[:300] or None,
            limit="kinematic-error runs of one bench and one encoder, analysed, with index marks",
            remedy=remedy,
        )
    taught.sort(key=lambda one: one.start)
    mounted = tuple(_by_mounting(taught))
    _refuse_contradiction(mounted, taught)
    curve = learnt_curve(mounted, assumed_seat())
    if isinstance(curve, str):
        raise ConfigurationError(
            "do not tell the encoder from the gears", where="these runs", value=curve
        )
    origin, found, encoder = only
    return Learnt(
        bench=found,
        encoder=encoder,
        origin=origin,
        curve=curve,
        mounted=mounted,
        taught=tuple(taught),
        skipped=tuple(one for one in seen if one.mounted is None),
    )


def _refuse_contradiction(mounted: Sequence[Mounted], taught: Sequence[_Observation]) -> None:
    """Raise `ConfigurationError` where the mountings cannot be of one encoder and one mark."""
    found = contradiction(mounted)
    if found is None:
        return

    gear = mounted[found.place].gear
    named = next(f"{one.run.name} (gear {gear})" for one in taught if one.gear == gear)
    words, remedy = {
        "exchanged": (
            f"are of two encoders, or their index mark slipped: from {named} on they do not go with those before",
            "Learn from the runs before it, or from those after.",
        ),
        "beside": (
            f"do not go together: {named} stands beside all others",
            "Look at its mounting and its index marks, or leave it out.",
        ),
    }[found.what]
    raise ConfigurationError(
        words,
        where="these runs",
        value=f"chance {found.chance:.1g}",
        limit=f">= {CHANCE:g}",
        remedy=remedy,
    )


def assumed_seat() -> float:
    """What an eccentric seat is assumed to give a component of order 1/N [rad], as the kinematic error assumes it."""
    from experiments.protocols.kinematic_error.traverses import OUTPUT_ECCENTRICITY

    return OUTPUT_ECCENTRICITY * ARCSEC / math.sqrt(2.0)


def _by_mounting(taught: Sequence[_Observation]) -> Iterator[Mounted]:
    """The runs of one mounting are one witness: their mean."""
    groups: dict[tuple[str, str, float | None], list[Mounted]] = defaultdict(list)
    for one in taught:
        assert one.mounted is not None
        groups[one.gear, one.mounting, one.mounted.angle].append(one.mounted)
    for several in groups.values():
        waves = np.mean([one.waves for one in several], axis=0)
        yield replace(several[0], waves=waves)


def observed(run: Path) -> _Observation:
    """What one run shows at the orders of the output encoder, over the encoder's own angle; or why nothing."""
    found = in_force(run, KIND)
    if found.analysis is None:
        return _Observation(run=run, skipped="no kinematic error of it is analysed")
    result = found.analysis.whole_result()
    recording = with_learnt_curve(open_run(run), run.parent)
    try:
        return _observed(run, recording, result)
    finally:
        close_recording(recording)


def _observed(run: Path, recording: Recording, result: Result) -> _Observation:
    metadata = recording.metadata
    if metadata.gear_serial in UNNAMED:
        return _Observation(run=run, skipped="it names no gear")
    if result.options.get("phases_count_from") != "index marks":
        return _Observation(run=run, skipped="it saw no index mark of both encoders")
    if not is_known(metadata, recording.signals[CHANNEL]):
        return _Observation(
            run=run, skipped="its bench, or the serial number of its output encoder, is not stated"
        )
    taken = _taken_off(recording, result)
    if taken is None:
        return _Observation(run=run, skipped="it is corrected by a curve that is gone: rig fit it")
    seen = _waves(recording, result)
    if seen is None:
        return _Observation(
            run=run, skipped="its output index marks do not stand whole turns apart"
        )
    angle = stated_angle(metadata)
    return _Observation(
        run=run,
        bench=bench_of(metadata),
        encoder=recording.signals[CHANNEL].serial_number,
        gear=metadata.gear_serial,
        mounting=which_mounting(metadata),
        sha256=sealed_sha256(run),
        origin=metadata.origin,
        start=metadata.start_time,
        mounted=Mounted(
            gear=metadata.gear_serial, angle=angle, waves=seen[0] + taken, unseen=tuple(seen[1])
        ),
    )


def _waves(recording: Recording, result: Result) -> tuple[ComplexArray, list[float]] | None:
    """Complex orders 1 to 8 of what the encoder shows too much, Re(Z e^(-i k phi)) over its own angle phi [rad], and
    how large those may be that do not stand out of the noise.

    The kinematic error is A cos(k (theta_i - theta_ref)/N - p), theta_ref the input angle from which phases count; the
    encoder's own angle turns with it or against it.
    """
    ratio, reference = (
        float(result.options["ratio"]),
        float(result.options["phase_reference_angle"]),
    )
    channel = recording.signals[CHANNEL]
    mark, _ = index_mark(recording, CHANNEL)
    if mark is None:
        return None
    sense, apart = _course(recording, ratio)
    own = channel.direction * (sense * (reference / ratio + apart) - mark)
    turn = sense * channel.direction
    waves = np.zeros(len(CERTIFIED_ORDERS), dtype=np.complex128)
    unseen = [0.0] * len(CERTIFIED_ORDERS)
    for place, order in enumerate(CERTIFIED_ORDERS):
        amplitude = result.estimates.get(f"amplitude_{order}/N")
        phase = result.estimates.get(f"phase_{order}/N")
        if amplitude is not None and phase is None:
            unseen[place] = amplitude.high
        elif amplitude is not None and phase is not None:
            size = turn * amplitude.value
            waves[place] = size * cmath.exp(1j * (order * own + turn * phase.value))
    return waves, unseen


def _taken_off(recording: Recording, result: Result) -> ComplexArray | None:
    """The orders of the curve that the analysis took off before (8,), which are the encoder's too; None where that
    curve is not the one that is there now.
    """
    if CHANNEL not in str(result.options.get("corrected_by_certificate", "")):
        return np.zeros(len(CERTIFIED_ORDERS), dtype=np.complex128)
    used, _ = certified_angle(recording, CHANNEL)
    named = recording.signals[CHANNEL].calibration.certificate
    if used is None or named not in str(result.options.get("certificates", "")):
        return None
    return np.asarray(used.certificate.waves @ np.array([1.0, 1.0j]), dtype=np.complex128)


def _course(recording: Recording, ratio: float) -> tuple[float, float]:
    """Whether the output angle grows with the input angle (+1) or against it (-1), and their distance on the output."""
    step = max(recording.rows // _FARTHEST_ROWS, 1)
    rows = slice(0, recording.rows)
    input_angle = recording.si("input_angle", rows)[::step]
    output_angle = recording.si(CHANNEL, rows)[::step]
    slope = float(np.polyfit(input_angle - input_angle.mean(), output_angle, 1)[0])
    sense = math.copysign(1.0, slope)
    return sense, float(np.median(sense * output_angle - input_angle / ratio))


def write_learnt(learnt: Learnt, path: Path, today: date, due: date | None) -> Path:
    """Write and seal the file; a name that is taken is left alone. Raises `ConfigurationError`, and for a curve that is
    no certificate.
    """
    return write_new_sealed(path, learnt.certificate(today, due).encode())
