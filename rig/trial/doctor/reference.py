"""An amplifier by analog reference: what its contacts say now, and by which numbers its voltage is a speed."""

from __future__ import annotations

from collections.abc import Iterable

from drivers.bus.analog.amplifier import ReferenceAmplifier
from drivers.drive_state import POWERED_STATES, DriveState
from experiments.finding import Finding, Severity, passed_if
from model.units import RPM
from rig.content.phrase import yes_or_no


def inspect_reference(amplifier: ReferenceAmplifier) -> Iterable[Finding]:
    """State by its contacts, the scale of its reference, and what takes it away when the computer is lost."""
    group = f"node {amplifier.device.node_id}, {amplifier.kind}"
    word, state = amplifier.word(), amplifier.state()
    lines = amplifier.config.lines
    said = {"alarm": lines.alarm, "power": lines.power, "ready": lines.ready}
    text = ", ".join(f"{name} {yes_or_no(line.is_active(word))}" for name, line in said.items())
    yield passed_if(
        "contacts",
        state not in (*POWERED_STATES, DriveState.FAULT) and lines.ready.is_active(word),
        f"0x{word:02X}: {text}",
        "Look at the amplifier's panel, at the sense of each contact in [drive.lines], and at its wiring.",
        where=group,
        allowed="ready, no alarm, no power",
    )
    config = amplifier.config
    step = config.volts_per_count * config.speed_per_volt / RPM
    yield Finding(
        "reference",
        Severity.PASSED,
        f"1 V is {config.speed_per_volt / RPM:g} r/min, one count {step:.3g} r/min; stands at "
        f"{config.zero_volts:g} V; at most {config.largest_volts:g} V",
        where=group,
    )
    covered = tuple(amplifier.unwatched)
    yield passed_if(
        "loss of the computer",
        not covered,
        "; ".join(covered) or "the coupler takes servo-on and reference away by itself",
        "Cover it by hardware, and say it as `computer_loss_covered_by` in [drive].",
        where=group,
        otherwise=Severity.WARNS,
    )
