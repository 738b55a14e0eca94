"""What prevailed while a run was made, and how well it was acquired: facts that are worked out, each in a sentence."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from experiments import catalogue
from experiments.recording import Recording, RunMetadata
from model.channel import Calibration
from model.gear import HarmonicDrive
from model.units import DEGREE, RPM
from rig.content.grid import Fact, Grid, capital, columns
from rig.content.phrase import phrase
from rig.content.wording import named, number
from rig.runfile.facts import figures_of, flat, temperature_ranges

EXPIRED = "EXPIRED WHEN THE RUN BEGAN"
CALIBRATED = frozenset({"input_angle", "output_angle", "torque"})
"""Channels whose certificate is asked for even where there is none."""
_SKEWS = {
    "encoder_skew": "skew, output after input",
    "torque_skew": "skew, torque port after drive",
}


def conditions_of(recording: Recording, gear: HarmonicDrive | None) -> tuple[Fact, ...]:
    """What prevailed during a run: speeds, duration, temperatures, load inertia (of a known gear),
    and what was noted. Reads the run from end to end.
    """
    facts = dict(_setpoints(recording))
    if recording.rows > 1:
        seconds = float(recording.time(slice(recording.rows - 1, recording.rows))[0])
        facts["duration"] = f"{number(seconds)} s in {number(recording.rows)} cycles"
    m = recording.metadata
    if math.isfinite(m.sample_rate):
        facts["sampling"] = f"{number(float(m.sample_rate))} Hz; time base: {m.time_base}"
    missed = sum(int((recording.flags(block) & 1 != 0).sum()) for block in recording.blocks())
    facts["incomplete cycles"] = f"{number(missed)} of {number(recording.rows)}"
    for name, (low, _, high) in temperature_ranges(recording).items():
        facts[named(name)[0]] = _range(low, high)
    if gear is not None:
        inertia = gear.value("inertia.output")
        source = f"{inertia.origin.provenance}: {inertia.origin.source}".rstrip(": ")
        facts["load inertia J_o"] = f"{number(inertia.value)} kg m² ({source})"
    worked_out = (Fact(title, text, "", "conditions") for title, text in facts.items())
    return (*worked_out, *flat("conditions", m.conditions))


def _range(low: float, high: float) -> str:
    if low > high:
        return "not recorded"
    if high - low >= 0.05:
        return f"{low:.1f} to {high:.1f} °C"
    return f"{low:.1f} °C"


def _setpoints(recording: Recording) -> Iterator[tuple[str, str]]:
    """What the rig was set to: speeds of the input, or places of the wave generator."""
    turning = [s for s in recording.segments if s.direction]
    both = ", both directions" if {s.direction for s in turning} >= {1, -1} else ""
    experiment = catalogue.declared(recording.metadata.experiment)
    if experiment is not None and experiment.setpoint == "position":
        places = sorted({round(s.setpoint / DEGREE, 3) for s in turning})
        if len(places) > 1:
            span = f"{len(places)} from {number(places[0])} to {number(places[-1])}°"
            yield "wave-generator positions", span + both
        elif places:
            yield "wave-generator positions", f"{number(places[0])}°{both}"
        return
    speeds = [abs(s.setpoint) / RPM for s in turning if s.setpoint]
    if speeds:
        span = dict.fromkeys((number(min(speeds)), number(max(speeds))))
        yield "input speeds", f"{' to '.join(span)} r/min{both}"


def world_facts(world: object) -> tuple[Fact, ...]:
    """In which simulated world a run was made; nothing for one that was made in none, or does not say."""
    if not isinstance(world, Mapping):
        return ()
    start = world["start"]
    correlation = world.get("day_correlation")
    warm = ", ".join(f"{name} {start[name]:.1f} degC" for name in start if name != "run")
    parts = (
        f"gear {world['gear_seed']}",
        phrase(" after {:g} h", world.get("hours")),
        f", bench {world['bench_seed']}, mounting {world['mount']}",
        _turned(world["mount_turn"], is_said_by_any="version" in world),
        f", day {world['day']}",
        "" if correlation is None else f" (days correlated by {correlation:g})",
        f", number {world['number']}, {world['population']} population; starts as ",
        phrase("run {1} ended ({0})", warm, start.get("run")) or "warm as the room",
        phrase("; repeats {}", world.get("repeats")),
    )
    return (Fact("world", "".join(parts), "", "acquisition"),)


def _turned(turn: float | None, *, is_said_by_any: bool) -> str:
    """The stated angle of a gear on the output flange; version 0.2.0 wrote 0 where nobody had stated one."""
    if turn is None or not (turn or is_said_by_any):
        return ""
    return f" turned by {math.degrees(turn):g} deg"


def late_words(metadata: RunMetadata) -> str:
    """What to blame where an analysis of time is refused: a computer that came too late and stamps the rows itself; ""
    where it did not, or where the hardware's clock stamps them.
    """
    overruns = figures_of(metadata.process.get("acquisition")).get("overruns", 0.0)
    if metadata.time_base != "host" or not overruns:
        return ""
    return (
        f"this computer was late by more than half a cycle {overruns:.0f} times, and its own clock stamps the rows: "
        "end what else it does, or lower the rate"
    )


def acquisition_facts(figures: object) -> Iterator[Fact]:
    """How well a run was acquired: rate and jitter, what was missed, index marks, torques, skew."""
    if not isinstance(figures, Mapping):
        return
    yield _sentence(
        "acquisition",
        figures,
        achieved_rate=("{:.6g} Hz achieved", 1.0),
        jitter_rms=("jitter {:.3g} µs r.m.s.", 1e6),
        jitter_max=("{:.3g} µs at most", 1e6),
        missed_share=("{:.3g} % missed", 100.0),
    )
    for name, group in _groups(figures.get("index_marks")):
        yield _sentence(
            "index marks",
            group,
            f"{name}: ",
            marks=("{:.0f} marks", 1.0),
            worst_excess=("at worst {:+.0f} counts off", 1.0),
        )
    torque = figures.get("torque_port_against_drive")
    if isinstance(torque, Mapping):
        yield _sentence(
            "torque port",
            torque,
            slope=("{:.4g} of what the drive reports", 1.0),
            offset=("{:+.3g} mN m apart on average", 1e3),
        )
    for name, group in _groups(figures.get("skew")):
        skew = _sentence(
            _SKEWS.get(name, name),
            group,
            value=("{:+.1f} µs", 1e6),
            expanded_uncertainty=("U {:.1f} µs", 1e6),
        )
        words = (
            skew.value,
            f"identifiable: {group.get('identifiability', '?')}",
            group.get("note"),
        )
        yield Fact(skew.title, ", ".join(str(one) for one in words if one), "", "acquisition")


def _groups(value: object) -> list[tuple[str, Mapping[str, Any]]]:
    groups = figures_of(value).items()
    return [(name, group) for name, group in groups if isinstance(group, Mapping)]


def _sentence(
    title: str, values: Mapping[str, Any], begin: str = "", /, **forms: tuple[str, float]
) -> Fact:
    """The numbers that are there, each in its form after its factor."""
    parts = [
        form.format(factor * values[name])
        for name, (form, factor) in forms.items()
        if isinstance(values.get(name), (int, float))
    ]
    return Fact(title, begin + ", ".join(parts), "", "acquisition")


def certificates_of(recording: Recording) -> Iterator[Fact]:
    """Certificate, date and due date of every calibrated channel, and loudly whether it had expired
    when the run began.
    """
    for title, c in _calibrated(recording):
        said = (
            c.certificate or "no certificate",
            c.date and f"of {c.date}",
            c.due and f"due {c.due}",
        )
        expired = f": {EXPIRED}" if _expired(recording, c) else ""
        text = ", ".join(part for part in said if part) + expired
        yield Fact(title, text, "", "calibrations")


def alarms_of(recording: Recording) -> Iterator[str]:
    """What makes the scales of a run doubtful: expired calibrations, and channels of hardware without a certificate."""
    for title, c in _calibrated(recording):
        if _expired(recording, c):
            certificate = c.certificate or "no certificate"
            yield f"The calibration of {title} ({certificate}) was due on {c.due}: {EXPIRED}."
        elif recording.metadata.origin == "hardware" and not c.certificate:
            yield f"{capital(title)} has no calibration certificate."


def _calibrated(recording: Recording) -> Iterator[tuple[str, Calibration]]:
    for column in getattr(recording.source, "columns", ()):
        c = column.channel.calibration
        if c.certificate or c.date or c.due or column.name in CALIBRATED:
            yield named(column.name)[0], c


def _expired(recording: Recording, calibration: Calibration) -> bool:
    begun = recording.metadata.start_time[:10]
    return bool(calibration.due and begun and calibration.due[:10] < begun)


def calibration_grid(recording: Recording) -> Grid:
    """One row per channel: what a count is worth and why that can be believed."""
    rows = []
    for channel in (column.channel for column in getattr(recording.source, "columns", ())):
        c, relative = channel.calibration, channel.calibration.scale_relative_uncertainty
        device = " ".join(part for part in (channel.model, channel.serial_number) if part)
        cells = (
            channel.name,
            number(channel.quantum) if channel.quantum else "",
            channel.unit,
            "" if relative is None else f"{100.0 * relative:.2g} %",
            "" if c.accuracy is None else f"{number(c.accuracy, 2)} {channel.unit}",
            c.certificate,
            c.date,
            f"{c.due} (overdue)" if _expired(recording, c) else c.due,
            device,
        )
        rows.append(tuple(cell or "–" for cell in cells))
    heads = columns(
        "channel",
        ("one count", "number"),
        ("unit", "unit"),
        ("scale uncertainty", "number"),
        ("accuracy", "number"),
        "certificate",
        "dated",
        "due",
        "device",
    )
    return Grid("Calibration of the channels", heads, rows)
