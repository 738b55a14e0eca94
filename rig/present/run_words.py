"""Facts of a run in words that the command line and the window share: how long it took, how well it was acquired."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any


def duration_text(seconds: float) -> str:
    """A duration as people say it."""
    if not math.isfinite(seconds):
        return "-"
    if seconds < 60.0:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes} min {rest:02d} s"


def world_facts(world: object) -> list[tuple[str, str]]:
    """In which simulated world a run was made; nothing for one that was made in none, or does not say."""
    if not isinstance(world, Mapping):
        return []
    start = world["start"]
    turned = _turned(world)
    hours, correlation = world.get("hours", 0.0), world.get("day_correlation")
    warm = ", ".join(f"{name} {start[name]:.1f} degC" for name in start if name != "run")
    parts = (
        f"gear {world['gear_seed']}",
        f" after {hours:g} h" if hours else "",
        f", bench {world['bench_seed']}, mounting {world['mount']}",
        "" if turned is None else f" turned by {turned:g} deg",
        f", day {world['day']}",
        "" if correlation is None else f" (days correlated by {correlation:g})",
        f", number {world['number']}, {world['population']} population; starts as ",
        f"run {start['run']} ended ({warm})" if warm else "warm as the room",
        f"; repeats {world['repeats']}" if "repeats" in world else "",
    )
    return [("world", "".join(parts))]


def _turned(world: Mapping[str, Any]) -> float | None:
    """The stated angle of a gear on the output flange [deg]; version 0.2.0 wrote 0 where nobody had stated one."""
    turn = world["mount_turn"]
    return math.degrees(turn) if turn or (turn is not None and "version" in world) else None


def acquisition_facts(figures: object) -> list[tuple[str, str]]:
    """How well a run was acquired, line by line: rate and jitter, what was missed, index marks, torques, skew."""
    if not isinstance(figures, Mapping):
        return []
    rate = _numbers(
        figures,
        {
            "achieved_rate": ("{:.6g} Hz achieved", 1.0),
            "jitter_rms": ("jitter {:.3g} µs r.m.s.", 1e6),
            "jitter_max": ("{:.3g} µs at most", 1e6),
            "missed_share": ("{:.3g} % missed", 100.0),
        },
    )
    facts = [("acquisition", rate)]
    for name, group in _groups(figures.get("index_marks")):
        text = _numbers(
            group,
            {"marks": ("{:.0f} marks", 1.0), "worst_excess": ("at worst {:+.0f} counts off", 1.0)},
        )
        facts.append(("index marks", f"{name}: {text}"))
    torque = figures.get("torque_port_against_drive")
    if isinstance(torque, Mapping):
        facts.append(
            (
                "torque port",
                _numbers(
                    torque,
                    {
                        "slope": ("{:.4g} of what the drive reports", 1.0),
                        "offset": ("{:+.3g} mN m apart on average", 1e3),
                    },
                ),
            )
        )
    for name, group in _groups(figures.get("skew")):
        value = _numbers(
            group, {"value": ("{:+.1f} µs", 1e6), "expanded_uncertainty": ("U {:.1f} µs", 1e6)}
        )
        verdict = f"identifiable: {group.get('identifiability', '?')}" + (
            f", {group['note']}" if group.get("note") else ""
        )
        facts.append((SKEWS.get(name, name), ", ".join(part for part in (value, verdict) if part)))
    return facts


SKEWS = {"encoder_skew": "skew, output after input", "torque_skew": "skew, torque port after drive"}


def _groups(value: object) -> list[tuple[str, Mapping[str, Any]]]:
    return (
        [(n, f) for n, f in value.items() if isinstance(f, Mapping)]
        if isinstance(value, Mapping)
        else []
    )


def _numbers(values: Mapping[str, Any], forms: Mapping[str, tuple[str, float]]) -> str:
    """The numbers that are there, each in its form after its factor."""
    return ", ".join(
        form.format(factor * values[name])
        for name, (form, factor) in forms.items()
        if isinstance(values.get(name), (int, float))
    )
