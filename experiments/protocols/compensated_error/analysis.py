"""Compensated error: what the table leaves, order by order, held against what was predicted of it.

proof    remainder over prediction at the table's own speeds (and an octave above), both directions, by F
seen     as this bench's encoder shows it; the proof is of this
true     seen and what the encoder adds, in quadrature: no run of this bench shows the difference
harm     the table harms where it leaves more than there was without it
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from experiments.angle.certified import CertifiedAngle, certified_angles
from experiments.angle.phase_reference import PhaseReference, phase_reference
from experiments.budget import budget_table
from experiments.contract import Evidence
from experiments.errors import AnalysisError, analysing
from experiments.evidence import check_recording, check_settings
from experiments.load import is_simulated
from experiments.protocols.compensated_error.declaration import NAME
from experiments.protocols.compensated_error.plots import by_order, by_speed, over_output
from experiments.protocols.compensated_error.quantities import QUANTITIES
from experiments.protocols.compensated_error.turns import (
    Turn,
    orders_left,
    traces_of,
    turns_of,
    waves_of,
)
from experiments.protocols.kinematic_error.traverses import spring_of
from experiments.recording import Recording
from experiments.result import Result, Table
from experiments.steps.follow import INDEX_GAP
from model.compensation import CompensationTable, table_of_set
from model.compensation_file import compensation_from
from model.errors import ModelError
from model.identify.estimate import BudgetLine, Estimate
from model.identify.least_squares import student_quantile
from model.identify.remainder import REFUSED, OrdersLeft, Remainder, bracket, remainder_of
from model.identify.torsion import Spring
from model.units import ARCSEC, RPM

PROVED_OCTAVE = 2.05
"""Times the fastest speed of the table's own runs up to which the proof is held: quasi-static as they are."""
AS_WARM = 10.0
"""K by which the housing may be warmer or colder than where the table was made before it is said."""
THE_DIFFERENCE = (
    "What the output encoder adds stands in the table and in what is seen alike: "
    "this bench cannot prove the difference between seen and true."
)


_PROOF_WORDS = {
    "PASS": "proof: PASS, as a right table",
    "MARGINAL": "proof: MARGINAL, not proved",
    "FAIL": "proof: FAIL, a wrong table",
}


@dataclass(frozen=True, kw_only=True)
class AtSpeed:
    """One speed [rad/s]: r.m.s. without the table [rad], each direction with it, and both together."""

    speed: float
    without: float
    without_uncertainty: float
    ways: tuple[OrdersLeft, ...]
    left: Remainder
    turns: tuple[Turn, ...]

    @property
    def name(self) -> str:
        """The speed as names and tables have it, in r/min."""
        return f"{self.speed / RPM:.4g}"


def table_in(recording: Recording) -> CompensationTable:
    """The table that a run was driven by: that of its parameters, else the series of its parameter set.

    Raises `AnalysisError` where it carries none.
    """
    metadata = recording.metadata
    text = str(metadata.parameters.get("table", ""))
    if not text and metadata.gear is not None:
        return table_of_set(metadata.gear, metadata.mounting)
    try:
        return compensation_from(text, f"{metadata.run_id}, parameters.table")
    except ModelError as error:
        raise AnalysisError(
            error.what, where=error.where, value=error.value, limit=error.limit
        ) from None


@dataclass(frozen=True, kw_only=True)
class _Given:
    """What a run is judged by: its table, where its angles count from, what corrects the output encoder."""

    table: CompensationTable
    reference: PhaseReference
    certified: dict[str, CertifiedAngle]
    warnings: tuple[str, ...]

    @property
    def gap(self) -> float:
        """How far the index marks lie from where the table has them [input revolutions]."""
        expected = self.table.index_gap
        return 0.0 if expected is None else math.remainder(self.reference.gap - expected, 1.0)


def analyse(recording: Recording, evidence: Evidence) -> Result:
    """Remainder, its prediction, the proof, and from which speed on the table harms."""
    check_settings(evidence.settings, (), NAME)
    given = _given(recording, evidence)
    table, run = given.table, recording.metadata.run_id
    spring = spring_of(evidence.gear, table.ratio, is_simulated=is_simulated(recording))
    with analysing(run):
        turns = list(turns_of(recording, table, given.reference, given.certified))
        speeds = _speeds(turns, table, spring)
        if not speeds:
            raise AnalysisError(
                "holds no speed with whole traverses both without the table and with it",
                where=run,
                remedy="Run it again; an aborted run proves nothing.",
            )
        judged = _judged(speeds, table)
        left = remainder_of([way for one in judged for way in one.ways])
    helps, harms = bracket(
        [one.speed for one in speeds],
        [one.without for one in speeds],
        [one.left.seen for one in speeds],
    )
    estimates, metrics = _numbers(speeds, judged, left, table)
    ends = {"helps_up_to": helps, "harms_from": harms, "index_gap": given.reference.gap}
    metrics |= {name: value for name, value in ends.items() if value is not None}
    remarks = [*_remarks(left, judged, given.gap, helps), *_warmth(recording, table)]
    return Result(
        run=run,
        kind=NAME,
        quantities=QUANTITIES,
        estimates=estimates,
        metrics=metrics,
        warnings=tuple(dict.fromkeys((*given.warnings, *remarks))),
        plots=(
            over_output(judged[0].turns, table),
            by_order(judged[0].turns, table),
            by_speed([(o.speed, o.without, o.left.seen, o.left.predicted) for o in speeds]),
        ),
        tables=(_speed_table(speeds), budget_table(estimates.values())),
        options=_options(recording, given, left),
    )


def _given(recording: Recording, evidence: Evidence) -> _Given:
    recording.require(NAME, "input_angle", "output_angle", "target_speed", "input_index")
    checked = check_recording(recording, NAME, evidence.maximum_missed_share)
    table = table_in(recording)
    reference = phase_reference(recording, table.index_gap)
    if reference.what != "index marks":
        raise AnalysisError(
            "without both index marks nobody knows where the table lies",
            where=recording.metadata.run_id,
            value=reference.what,
            remedy="Run a whole output turn on a rig whose encoders show their marks.",
        )
    certified, sentences = certified_angles(recording)
    # The drive follows the motor encoder as it counts.
    certified.pop("input_angle", None)
    warnings = (*checked.warnings, *sentences)
    return _Given(table=table, reference=reference, certified=certified, warnings=warnings)


def _options(recording: Recording, given: _Given, left: Remainder) -> dict[str, object]:
    options: dict[str, object] = {
        "mounting": recording.metadata.mounting,
        "ratio": given.table.ratio,
        "phases_count_from": given.reference.what,
        "proof": left.verdict,
        "true_and_seen": THE_DIFFERENCE,
    }
    if given.certified:
        names = sorted(given.certified)
        told = (recording.signals[name].calibration.certificate for name in names)
        options["certificates"] = "; ".join(told)
    return options


def _speeds(turns: Sequence[Turn], table: CompensationTable, spring: Spring) -> list[AtSpeed]:
    """The speeds that have both, slowest first."""
    found: list[AtSpeed] = []
    for speed in sorted({abs(turn.speed) for turn in turns}):
        here = tuple(turn for turn in turns if abs(turn.speed) == speed)
        ways = tuple(
            orders_left(along, table, spring)
            for way in (1.0, -1.0)
            if (along := [t for t in here if t.is_compensated and t.speed * way > 0.0])
        )
        without = [turn for turn in here if not turn.is_compensated]
        if not ways or not without:
            continue
        squares = [0.5 * float(np.sum(np.abs(waves_of(one.output)) ** 2)) for one in without]
        spread = [
            0.5 * float(np.sum(np.abs(waves_of(one.output)) ** 2 * traces_of(one.output)))
            for one in without
        ]
        rms = math.sqrt(sum(squares) / len(squares))
        found.append(
            AtSpeed(
                speed=speed,
                without=rms,
                without_uncertainty=math.sqrt(sum(spread)) / len(spread) / (2.0 * rms),
                ways=ways,
                left=remainder_of(ways),
                turns=here,
            )
        )
    return found


def _judged(speeds: Sequence[AtSpeed], table: CompensationTable) -> list[AtSpeed]:
    """The speeds at which the table's prediction holds; where all are faster, the slowest."""
    within = [one for one in speeds if one.speed <= PROVED_OCTAVE * table.speed[1]]
    return within or list(speeds[:1])


def _remarks(
    left: Remainder, judged: Sequence[AtSpeed], gap: float, helps: float | None
) -> list[str]:
    at = ", ".join(one.name for one in judged)
    interval = f"{left.ratio:.2f} ({left.low:.2f} to {left.high:.2f}) times what was predicted at {at} r/min"
    said: list[str] = []
    if left.verdict == "FAIL":
        said.append(
            f"The table is refused: it leaves {interval}, more than {REFUSED:g} for certain. Is its sign, phase, gear, "
            "mounting, direction, index mark or ratio another one?"
        )
    elif left.verdict == "MARGINAL":
        said.append(f"The table is not proved: it leaves {interval}; 1 lies outside.")
    if helps is None:
        said.append("The table helps at none of these speeds.")
    if abs(gap) > INDEX_GAP:
        said.append(
            f"The index marks lie {abs(gap):.2f} input revolutions from where the table has them: "
            "another gear, or mounted anew?"
        )
    return said


def _warmth(recording: Recording, table: CompensationTable) -> list[str]:
    """A sentence where the housing is much warmer or colder than where the table was made."""
    if table.temperature is None or not recording.has("housing_temperature"):
        return []
    now = float(np.mean(recording.si("housing_temperature", slice(0, recording.rows))))
    if abs(now - table.temperature) <= AS_WARM:
        return []
    return [
        f"The table was made at a housing temperature of {table.temperature:.1f} °C, this run at {now:.1f} °C: "
        "what friction winds up is another one."
    ]


def _numbers(
    speeds: Sequence[AtSpeed], judged: Sequence[AtSpeed], left: Remainder, table: CompensationTable
) -> tuple[dict[str, Estimate], dict[str, float]]:
    ways = [way for one in judged for way in one.ways]
    without = math.sqrt(sum(one.without**2 for one in judged) / len(judged))
    own = math.hypot(*(one.without * one.without_uncertainty for one in judged))
    noise = math.sqrt(
        sum(0.5 * float(np.sum(np.abs(w.remainder) ** 2 * w.variance)) for w in ways)
    ) / (2.0 * left.seen * len(ways))
    freedom = min(way.freedom for way in ways)
    estimates = {
        "proof_ratio": Estimate(
            name="proof_ratio",
            value=left.ratio,
            unit="1",
            low=left.low,
            high=left.high,
            note=_PROOF_WORDS[left.verdict],
            budget=(
                BudgetLine(
                    "what a right table leaves, by chance",
                    "A",
                    left.chance,
                    degrees_of_freedom=left.freedom,
                ),
                BudgetLine(
                    "prediction: table, spring, friction, another run",
                    "B",
                    left.doubt,
                    "each known to a quarter of itself",
                ),
            ),
        ),
        "remainder": _rms("remainder", left.seen, noise, freedom),
        "without_table": _rms("without_table", without, own / (len(judged) * without), freedom),
    }
    metrics = {
        "predicted_seen": left.predicted,
        "motor_part": _motor_part(ways),
        "predicted_true": math.hypot(left.predicted, table.encoder_rms),
        "removed": 1.0 - left.seen / without,
    }
    for one in speeds:
        metrics[f"remainder_{one.name}_rpm"] = one.left.seen
        metrics[f"without_table_{one.name}_rpm"] = one.without
        metrics[f"predicted_{one.name}_rpm"] = one.left.predicted
    return estimates, metrics


def _motor_part(ways: Sequence[OrdersLeft]) -> float:
    """R.m.s. at the output of what the motor does otherwise than it is sent [rad]."""
    squares = [0.5 * float(np.sum(np.abs(way.motor) ** 2)) for way in ways]
    return math.sqrt(sum(squares) / len(squares))


def _rms(name: str, value: float, uncertainty: float, freedom: float) -> Estimate:
    half = student_quantile(freedom) * uncertainty
    line = BudgetLine("noise of the orders", "A", uncertainty, degrees_of_freedom=freedom)
    return Estimate(
        name=name, value=value, unit="rad", low=value - half, high=value + half, budget=(line,)
    )


def _speed_table(speeds: Sequence[AtSpeed]) -> Table:
    rows = tuple(
        (
            float(one.name),
            one.without / ARCSEC,
            one.left.seen / ARCSEC,
            one.left.predicted / ARCSEC,
            one.left.ratio,
            one.left.low,
            one.left.high,
            _motor_part(one.ways) / ARCSEC,
            "helps" if one.left.seen < one.without else "harms",
        )
        for one in speeds
    )
    return Table(
        name="by_speed",
        title="With the table and without it, by speed",
        columns=(
            "input speed [r/min]",
            "without [arcsec]",
            "with [arcsec]",
            "predicted [arcsec]",
            "with over predicted",
            "from",
            "to",
            "of it the motor's [arcsec]",
            "the table",
        ),
        rows=rows,
        note="r.m.s. of the orders over one output revolution, as this bench's encoder shows it",
    )
