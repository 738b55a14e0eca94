"""The instruments that enter the verdict, and the title that a certificate may bear because of them.

CERTIFICATE is a claim of traceability: every instrument that enters a verdict had a certificate that was not past its
due date when the run was made. Where one had not, the paper is a TEST REPORT and says which; a simulated one is a
SIMULATION.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

from experiments.protocols.friction.quantities import at_reference
from experiments.quantity import Quantity
from experiments.recording import Recording
from experiments.result import Verdict
from model.channel import Channel
from rig.analysis.fit.recorded import Fit
from rig.analysis.learnt import vouchers
from rig.content.grid import capital
from rig.content.wording import named
from rig.present.certificate.gather import Certified
from rig.present.certificate.words import ENGLISH, Words
from rig.runfile.prevailing import CALIBRATED
from rig.runfile.read import close_recording, open_run

_TitleKind = Literal["certificate", "report", "simulation"]
NONE = "none"
"""How a description says that there is no certificate: "none: accuracy from the data sheet"."""
TORQUE, HOUSING = "torque", "housing_temperature"


@dataclass(frozen=True, kw_only=True)
class Instrument:
    """One channel as its calibration stood when a run was made.

    `tested` is the latest day on which it entered a verdict; days are ISO dates, "" for what nobody stated.
    """

    channel: str
    device: str
    serial: str
    certificate: str
    laboratory: str
    date: str
    due: str
    tested: str

    @property
    def title(self) -> str:
        """The channel in words."""
        return capital(named(self.channel)[0])

    @property
    def doubt(self) -> str:
        """Why it is not traceable, in English; "" where it is."""
        return self.doubt_in(ENGLISH)

    def doubt_in(self, words: Words) -> str:
        """Why it is not traceable; "" where it is."""
        if not self.certificate or self.certificate.lower().startswith(NONE):
            return words.NO_CERTIFICATE
        if self.due and self.tested and self.due[:10] < self.tested[:10]:
            return words.OVERDUE.format(due=self.due)
        return ""


@dataclass(frozen=True)
class Title:
    """What a certificate may call itself, and why not more."""

    kind: _TitleKind
    untraceable: str = ""
    words: Words = ENGLISH

    @property
    def word(self) -> str:
        """As it stands on the page."""
        return self.words.TITLES[self.kind]


def title_of(
    gathered: Certified, instruments: tuple[Instrument, ...], words: Words = ENGLISH
) -> Title:
    """The title that these instruments allow."""
    origins = dict.fromkeys(fit.recording.metadata.origin for fit in gathered.fits)
    if "simulated" in origins:
        return Title("simulation", words=words)
    reasons = [words.ANOTHER_ORIGIN[one] for one in origins if one in words.ANOTHER_ORIGIN]
    reasons += [
        f"{words.name(named(one.channel)[0])} ({doubt})"
        for one in instruments
        if (doubt := one.doubt_in(words))
    ]
    if not reasons:
        return Title("certificate", words=words)
    told = words.UNTRACEABLE.format(reasons=", ".join(dict.fromkeys(reasons)))
    return Title("report", told, words)


def instruments_of(gathered: Certified) -> tuple[Instrument, ...]:
    """The instruments that enter a verdict, each once with the latest day on which it did; of a gear without a limit
    all whose certificate is asked for.
    """
    found: dict[tuple[str, ...], Instrument] = {}
    for recording, names, learnt in _entering(gathered):
        for channel in _recorded(recording, names):
            one = _instrument(channel, recording.metadata.start_time[:10])
            if channel.name in learnt:
                # Whatever vouches for the device: the number rests on what the bench says of it.
                one = replace(one, certificate=learnt[channel.name], laboratory="", date="", due="")
            key = (one.channel, one.serial, one.certificate, one.due)
            known = found.get(key)
            if known is None or known.tested < one.tested:
                found[key] = one
    return tuple(found.values())


_Entering = tuple[Recording, tuple[str, ...], dict[str, str]]


def _entering(gathered: Certified) -> Iterator[_Entering]:
    """Each recording with the channels on which a judged number of it rests, its tare among them, and what its bench
    learnt of them.
    """
    judged = [
        (fit, line)
        for line in gathered.verdict.lines
        if (fit := gathered.fit_of(line.kind)) is not None
    ]
    for fit, line in judged:
        channels = tuple(_channels(fit, line))
        learnt = vouchers(fit.result.options)
        yield fit.recording, channels, learnt
        yield from ((tare, names, learnt) for tare, names in _of_tare(gathered, fit, channels))
    if not judged:
        every = tuple(sorted(CALIBRATED))
        yield from ((f.recording, every, vouchers(f.result.options)) for f in gathered.fits)


def _channels(fit: Fit, line: Verdict) -> Iterator[str]:
    quantity: Quantity = line.quantity
    options = fit.result.options
    for name, dependence in (quantity.rests_on or dict.fromkeys(sorted(CALIBRATED))).items():
        if dependence == "none":
            continue
        chosen = {"torque": "channel"}.get(name, name)
        yield str(options.get(chosen) or TORQUE) if chosen in ("channel", "effort") else name
    if line.estimate.name.endswith(at_reference("")):
        yield HOUSING


def _of_tare(
    gathered: Certified, fit: Fit, channels: tuple[str, ...]
) -> Iterator[tuple[Recording, tuple[str, ...]]]:
    """The same channels of the tare that was subtracted, as they were calibrated on the day of the tare."""
    tare = fit.tare_as_json()
    if not tare or fit.path is None:
        return
    known = next(
        (f.recording for f in gathered.fits if f.recording.metadata.run_id == tare.get("run")), None
    )
    if known is not None:
        yield known, channels
        return
    path = fit.path.parent / str(tare.get("file", ""))
    if path.is_file():
        recording = open_run(path, rows=False)
        try:
            yield recording, channels
        finally:
            close_recording(recording)


def _recorded(recording: Recording, names: tuple[str, ...]) -> list[Channel]:
    """The channels of these names; where a recording has none of them, all, with nothing that vouches for them."""
    columns = getattr(recording.source, "columns", ())
    found = [one.channel for one in columns if one.name in names]
    return found or [Channel(name=name, unit="1") for name in names]


def _instrument(channel: Channel, day: str) -> Instrument:
    c = channel.calibration
    return Instrument(
        channel=channel.name,
        device=channel.model,
        serial=channel.serial_number,
        certificate=c.certificate,
        laboratory=c.laboratory,
        date=c.date,
        due=c.due,
        tested=day,
    )
