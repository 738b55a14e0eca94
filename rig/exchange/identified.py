"""What is known of a gear: its numbers with units and doubt, their joint covariance, and where they hold.

A parameter set alone gives each number its own standard uncertainty. Runs give more: numbers that were fitted together
err together, and a cause that is shared (the torque's scale) moves all of them at once.
What a budget holds beyond that belongs to one number alone and stands on the diagonal.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path

import numpy as np

from experiments import catalogue
from experiments.recording import RunMetadata
from experiments.result import Result
from model.arrays import FloatArray
from model.errors import ParameterError
from model.gear import HarmonicDrive, Mounting, Origin
from model.gear_file import harmonic_path, load_gear, shipped_gear
from model.units import RPM
from rig.analysis.adopt import adopt
from rig.analysis.fit.recorded import Fit, fit_in_force
from rig.analysis.in_force import InForce, in_force, newest_analysed
from rig.analysis.passport.followed import order_of
from rig.analysis.passport.gather import runs_of
from rig.content.phrase import quoted
from rig.errors import ConfigurationError, RunFileError
from rig.library.folder import run_named
from rig.runfile.header import ORIGIN_WORDS
from rig.runfile.read import close_recording, open_run

_EXPORTED = (
    "mesh_friction.coulomb",
    "mesh_friction.static",
    "mesh_friction.stribeck_velocity",
    "mesh_friction.shape",
    "mesh_friction.viscous",
    "bearing.friction_factor",
    "bearing.viscosity",
    "bearing.pitch_diameter",
    "bearing.damping",
    "damping.structural",
    "geometry.neutral_radius",
    "geometry.flexspline_diameter",
    "geometry.tooth_angle",
    "inertia.wave_generator",
    "inertia.flexspline",
    "inertia.output",
)
"""Paths of a parameter set that friction (equations 18-20), inertia and damping at input and output rest on."""
SPEEDS = (3.0 * RPM, 3000.0 * RPM)
"""rad/s at the input: where friction is held against what a target can say, unless runs say from where to where."""
_K = 2.0
"""Coverage factor of a set's numbers, which state a standard uncertainty alone."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """One number of an identified gear, SI; `standard_uncertainty` is NaN where none is stated."""

    name: str
    symbol: str
    value: float
    unit: str
    standard_uncertainty: float
    expanded_uncertainty: float
    provenance: str
    source: str
    description: str
    low: float = 0.0
    high: float = math.inf

    @property
    def is_positive(self) -> bool:
        """Whether it can be nothing but positive."""
        return self.low >= 0.0

    @property
    def is_uncertain(self) -> bool:
        """Whether its doubt is stated."""
        return math.isfinite(self.standard_uncertainty) and self.standard_uncertainty > 0.0


@dataclass(frozen=True, slots=True)
class _GearRun:
    """A run that the gear was identified from: its analysis in force."""

    run: str
    kind: str
    sha256: str
    analysis: int


@dataclass(frozen=True, kw_only=True)
class IdentifiedGear:
    """A gear with its numbers and the covariance (p, p) of those whose doubt is stated, in SI.

    `speeds` [rad/s at the input] and `temperatures` [degC, of the housing] are where friction was measured; empty
    where no run says it. `mark` is SIMULATED, REPLAY or IMPORTED where the runs are.
    """

    gear: HarmonicDrive
    parameters: tuple[Parameter, ...]
    uncertain: tuple[str, ...]
    covariance: FloatArray
    serial: str = ""
    mounting: Mounting = "circular-spline-fixed"
    speeds: tuple[float, ...] = ()
    temperatures: tuple[float, ...] = ()
    runs: tuple[_GearRun, ...] = ()
    mark: str = ""
    remarks: tuple[str, ...] = field(default=())

    @property
    def ratio(self) -> float:
        """Input revolutions per output revolution, as it is mounted."""
        return self.gear.mounted_ratio(self.mounting)

    @property
    def compared_over(self) -> tuple[float, float]:
        """Input speeds [rad/s] over which a target's friction is held against the gear's."""
        if not self.speeds:
            return SPEEDS
        return max(SPEEDS[0], self.speeds[0]), min(SPEEDS[1], self.speeds[1])


def identified_gear(
    source: str | Path | HarmonicDrive, folder: str | Path = "runs"
) -> IdentifiedGear:
    """An identified gear by a run (its file, or number in `folder`), a serial number with analysed runs in `folder`, a
    parameter set, or its name.

    Raises `RigError` for a run without an analysis and for a name that is none of these, `ParameterError` for a set
    that cannot be read.
    """
    if isinstance(source, HarmonicDrive):
        return of_set(source)
    text = str(source)
    if text.lower().endswith(".toml"):
        return of_set(load_gear(text))
    if text.lower().endswith(".h5"):
        return _of_run(Path(text))
    runs = runs_of(folder, text) if Path(folder).is_dir() else ()
    if runs:
        newest = newest_analysed(runs)
        fits = [fit_in_force(run.path, found) for run, found in newest.runs]
        if not fits:
            raise _nothing_identified(text, newest.passed_over)
        return _of_fits(fits, [found for _, found in newest.runs])
    if text[:1].isdigit() and Path(folder).is_dir():
        return _of_run(run_named(folder, text))
    return of_set(_shipped(text, folder))


def _shipped(name: str, folder: str | Path) -> HarmonicDrive:
    try:
        return shipped_gear(name)
    except ParameterError as error:
        raise ConfigurationError(
            "no gear of this name",
            where="GEAR|RUN",
            value=name,
            limit=f"a serial number with runs in {folder}, a run file (.h5), a parameter set (.toml), {error.limit}",
            remedy="Say where its runs lie with --runs.",
        ) from None


def of_set(gear: HarmonicDrive) -> IdentifiedGear:
    """A parameter set as it stands: every number with its own doubt, none of them together."""
    parameters = tuple(_parameters(gear))
    uncertain = [one for one in parameters if one.is_uncertain]
    return IdentifiedGear(
        gear=gear,
        parameters=parameters,
        uncertain=tuple(one.name for one in uncertain),
        covariance=np.diag([one.standard_uncertainty**2 for one in uncertain]),
        remarks=(
            "A parameter set alone: no covariance between its numbers, no range of speed or temperature.",
        ),
    )


def _of_run(path: Path) -> IdentifiedGear:
    # A run that is not there is said so in the words of all other commands.
    close_recording(open_run(path))
    found = in_force(path)
    if found.analysis is None or not found.of_this_run:
        raise _nothing_identified(path.name, (f"rig fit {quoted(path)}",))
    return _of_fits([fit_in_force(path, found)], [found])


def _nothing_identified(what: str, reasons: Sequence[str]) -> RunFileError:
    return RunFileError(
        "nothing was identified of it yet",
        where=what,
        value="; ".join(reasons) or "no analysis",
        limit="an analysis in force",
        remedy="Analyse its runs with `rig fit` first.",
    )


def _of_fits(fits: Sequence[Fit], found: Sequence[InForce]) -> IdentifiedGear:
    """The gear of these analyses, taken over one after the other, with the covariances that they state."""
    try:
        metadata = [fit.recording.metadata for fit in fits]
        mounted = [one for one in metadata if one.gear_mounted]
        if not mounted:
            raise _nothing_identified(fits[0].result.run, ("no gear was mounted",))
        results = [
            one.analysis.whole_result()
            for one, m in zip(found, metadata, strict=True)
            if one.analysis is not None and m.gear_mounted and _identifies(one.kind)
        ]
        base = fits[metadata.index(mounted[-1])].gear
        gear = adopt(base, results).gear
        return _with_results(gear, results, mounted[-1], _runs(fits, found), _of_all(mounted))
    finally:
        for fit in fits:
            close_recording(fit.recording)


def _of_all(metadata: Sequence[RunMetadata]) -> str:
    """The mark of the runs: of several origins the first that is no hardware."""
    words = [ORIGIN_WORDS[one.origin] for one in metadata]
    return next((word for word in words if word), "")


def _runs(fits: Sequence[Fit], found: Sequence[InForce]) -> tuple[_GearRun, ...]:
    return tuple(
        _GearRun(fit.result.run, fit.result.kind, fit.recording.metadata.sha256, one.number)
        for fit, one in zip(fits, found, strict=True)
        if fit.recording.metadata.gear_mounted and _identifies(one.kind)
    )


def _identifies(kind: str) -> bool:
    """Whether a kind of analysis writes numbers into a parameter set."""
    return catalogue.load(kind).identified is not None


def _with_results(
    gear: HarmonicDrive,
    results: Sequence[Result],
    metadata: RunMetadata,
    runs: tuple[_GearRun, ...],
    mark: str,
) -> IdentifiedGear:
    parameters = tuple(_parameters(gear))
    uncertain = tuple(one.name for one in parameters if one.is_uncertain)
    known = {one.name: one for one in parameters}
    covariance = np.diag([known[name].standard_uncertainty ** 2 for name in uncertain])
    for result in results:
        _put_block(covariance, uncertain, result, gear)
    run = next((one for one in results if one.kind == "friction"), None)
    # Where a run measured motor and gear together, the gear's friction is the set's, and so is where it holds.
    friction = run if run is not None and run.options.get("torque_is_of") == "gear" else None
    return IdentifiedGear(
        gear=gear,
        parameters=parameters,
        uncertain=uncertain,
        covariance=covariance,
        serial=metadata.gear_serial,
        mounting=metadata.mounting or "circular-spline-fixed",
        speeds=_speeds(friction),
        temperatures=_temperatures(friction),
        runs=runs,
        mark=mark,
        remarks=tuple(_remarks(results, run, friction)),
    )


def _remarks(
    results: Sequence[Result], run: Result | None, friction: Result | None
) -> Iterator[str]:
    if run is None:
        yield "No friction run: friction is that of the parameter set."
    elif friction is None:
        yield "The friction run has no motor tare: friction is that of the parameter set, not the run's."
    for result in results:
        for name, estimate in result.estimates.items():
            if estimate.identifiable == "no" and estimate.note:
                yield f"{result.quantity(name).titled(name)}: not identifiable, {estimate.note}"


def _put_block(
    covariance: FloatArray, uncertain: Sequence[str], result: Result, gear: HarmonicDrive
) -> None:
    """What a result says of numbers that err together; what their budgets hold beyond it stays on the diagonal."""
    if result.covariance is None:
        return
    stated = result.covariance.whole()
    places = {
        place: uncertain.index(name)
        for place, one in enumerate(result.covariance.names)
        if (name := _path_of(one, result.kind, gear)) in uncertain
    }
    if result.kind == "friction" and result.options.get("torque_is_of") != "gear":
        return
    for i, p in places.items():
        # A budget that is smaller than the fit's own variance would make numbers that err more together than apart.
        covariance[p, p] = max(covariance[p, p], stated[i, i])
        for j, q in places.items():
            if i != j:
                covariance[p, q] = stated[i, j]


def _path_of(name: str, kind: str, gear: HarmonicDrive) -> str:
    """The path of a fit's parameter in the set; "" for one that the set does not have."""
    if kind == "friction":
        return f"mesh_friction.{name}"
    part, _, label = name.partition("_")
    if kind != "kinematic-error" or part not in ("cosine", "sine"):
        return ""
    order = order_of(label, gear.ratio)
    near = [h.order for h in gear.kinematic_error if math.isclose(h.order, order, rel_tol=1e-9)]
    return f"{harmonic_path(near[0])}.{part}" if near else ""


def _parameters(gear: HarmonicDrive) -> Iterator[Parameter]:
    """The numbers that are exported, then the orders of the kinematic error by cosine and sine."""
    values = {one.path: one for one in gear.values()}
    ranges = {path: _range(gear, path) for path in _EXPORTED}
    for path in _EXPORTED:
        one = values[path]
        u = one.origin.standard_uncertainty
        yield Parameter(
            path,
            one.symbol,
            float(one.value),
            one.unit,
            *_doubt(u),
            one.origin.provenance,
            one.origin.source,
            one.description,
            *ranges[path],
        )
    for harmonic in gear.kinematic_error:
        path = harmonic_path(harmonic.order)
        origin = gear.origins.get(path, Origin("assumed"))
        for part, value in (("cosine", harmonic.cosine), ("sine", harmonic.sine)):
            yield Parameter(
                f"{path}.{part}",
                "",
                value,
                "rad",
                *_doubt(origin.standard_uncertainty),
                origin.provenance,
                origin.source,
                f"{part} of order {harmonic.order:.9g} of the kinematic error, at the output",
                low=-math.inf,
            )


def _range(gear: HarmonicDrive, path: str) -> tuple[float, float]:
    """What a number of the set may be."""
    section, _, name = path.partition(".")
    (meta,) = (f.metadata for f in fields(getattr(gear, section)) if f.name == name)
    return max(float(meta["low"]), float(meta["above"]), 0.0), float(meta["high"])


def _doubt(u: float | None) -> tuple[float, float]:
    return (math.nan, math.nan) if u is None else (u, _K * u)


def _speeds(friction: Result | None) -> tuple[float, ...]:
    """Least and greatest input speed [rad/s] of the points that friction was fitted to."""
    if friction is None:
        return ()
    table = next((t for t in friction.tables if t.name == "fitted-points"), None)
    if table is None or not table.rows:
        return ()
    speeds = [abs(float(row[table.columns.index("speed [r/min]")])) * RPM for row in table.rows]
    return min(speeds), max(speeds)


def _temperatures(friction: Result | None) -> tuple[float, ...]:
    """Least and greatest temperature of the housing [degC] while friction was measured."""
    if friction is None:
        return ()
    mean, span = (
        friction.metrics.get(f"housing_temperature{end}", math.nan) for end in ("", "_span")
    )
    return (mean - 0.5 * span, mean + 0.5 * span) if math.isfinite(mean + span) else ()
