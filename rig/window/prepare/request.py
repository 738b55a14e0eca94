"""From what the Prepare page was told to a run: the order, its preview, its checks, and the arguments of `rig run`.

No Qt in here: the page calls it from a worker thread, tests call it as it is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from experiments import catalogue
from experiments.errors import ExperimentError
from experiments.finding import Finding, Severity, passed_if
from model.errors import ModelError
from model.gear_file import save_gear, shipped_gear
from rig.bench.backends.order import Order, arguments_of
from rig.bench.backends.registry import HARDWARE
from rig.bench.identity import bench_of
from rig.content.phrase import phrase
from rig.content.wording import named, percent
from rig.errors import ConfigurationError, RigError
from rig.gears.card import GearCard, card_path, conditions_of, gear_of
from rig.gears.facts import GearFacts
from rig.present.preview.plan import PlanPreview, preview_plan
from rig.run.arming import WITHOUT_GEAR, Arming, refuse_unarmed
from rig.run.dry_run import PlannedRun
from rig.run.gear import acceptance_checks_of_card, card_checks
from rig.run.latch import TripLatch, latch_of
from rig.run.ordering import configuration_of, described
from rig.run.preflight import static_checks
from rig.run.progress import in_words as time_in_words
from rig.run.start import plan_order
from rig.trial.campaign.walk import Walk
from rig.window.shell.sentence import give_or_take

KNOWN_BY_THE_RIG = ("mounting", "sync_rate")
"""Parameters of protocols that follow from the gear card and the rig: not asked for twice."""

_SAID_TO_A_CHILD = (
    "backend",
    "folder",
    "mounting",
    "serial",
    "operator",
    "config",
    "gear",
    "sample_rate",
    "seed",
    "world",
)
"""The fields of an order that a window decides, as the command line of its child has them."""
SAID_OF_A_RUN = (*_SAID_TO_A_CHILD, "status")
"""Those of a run, or of a campaign's runs."""


@dataclass(frozen=True)
class RigChoice:
    """Which rig, described where, and where its runs go."""

    backend: str
    folder: Path
    configuration: Path | None = None
    status: Path | None = None
    """The page that is kept of how a run stands."""

    @property
    def is_hardware(self) -> bool:
        """Whether something real turns."""
        return self.backend == HARDWARE

    def latch(self) -> TripLatch:
        """The latch of this bench. Raises `ConfigurationError` for hardware without identity or state folder."""
        return latch_of(bench_of(self.backend, self.folder, self.configuration))


@dataclass(frozen=True, kw_only=True)
class Intent:
    """What somebody at the window wants to run. `facts` is the gear as the form has it, `card` as it is stored."""

    rig: RigChoice
    protocol: str
    values: Mapping[str, Any] = field(default_factory=dict)
    facts: GearFacts | None = None
    card: GearCard | None = None
    operator: str = ""
    confirmation: str = ""
    campaign: str = ""
    """A campaign that ships, or the file of a plan, instead of one run of `protocol`."""
    anew: bool = False
    """Whether that campaign begins again where an unfinished one could go on."""

    @property
    def serial(self) -> str:
        """The serial number of the gear; "" where none is said."""
        return self.facts.serial if self.facts is not None else ""


@dataclass(frozen=True)
class Outlook:
    """What came of an intent: the planned run with its preview and its checks, or why there is none."""

    intent: Intent
    order: Order | None = None
    planned: PlannedRun | None = None
    preview: PlanPreview | None = None
    checks: tuple[Finding, ...] = ()
    problem: Exception | None = None
    walk: Walk | None = None
    """Of a campaign: all its runs."""
    done: tuple[str, ...] = ()
    """Of a campaign that goes on: the run that counts for each stage, "" where there is none."""


def order_for(intent: Intent) -> Order:
    """The order of an intent. Raises `ConfigurationError`, `ParameterError`; nothing is connected."""
    rig, facts = intent.rig, intent.facts
    config = _described_by(rig)
    known = described(config)
    gear = known.pop("gear", None) or shipped_gear()
    mounted = catalogue.load(intent.protocol).gear_mounted
    if facts is not None:
        gear = gear_of(facts, gear)
        if facts.mounting:
            known["mounting"] = facts.mounting
        if mounted:
            known["serial"] = facts.serial
    if config is not None:
        from rig.bench.config.apply import with_ratings
        from rig.bench.config.load import load_configuration

        gear = with_ratings(gear, load_configuration(config).ratings)
    if intent.card is not None and mounted:
        known["conditions"] = conditions_of(intent.card)
    known |= {"gear": gear, "folder": rig.folder, "operator": intent.operator.strip()}
    known |= {"status": rig.status}
    return Order(protocol=intent.protocol, values=dict(intent.values), backend=rig.backend, **known)


def _described_by(rig: RigChoice) -> Path | None:
    """The file that describes a rig, where one does."""
    return configuration_of(rig.backend, rig.configuration)


def look_ahead(intent: Intent) -> Outlook:
    """Plan, preview and check an intent; what refuses it is part of the answer."""
    problem: Exception | None = None
    checks: list[Finding] = []
    order, planned, preview = None, None, None
    try:
        order = order_for(intent)
        planned = plan_order(order)
        preview = preview_plan(planned)
    except (RigError, ExperimentError, ModelError) as error:
        problem = error
    if planned is not None and preview is not None:
        checks += (
            parameters_check(planned, intent.rig),
            _plan_check(planned),
            *prediction_checks(preview),
        )
        checks += static_checks(planned, intent.rig.folder)
    if catalogue.load(intent.protocol).gear_mounted:
        checks[:0] = gear_checks(intent)
    checks += latch_checks(intent.rig)
    return Outlook(intent, order, planned, preview, tuple(checks), problem)


def gear_checks(intent: Intent) -> tuple[Finding, ...]:
    """What is looked at on the card of the gear, and on what the gear must show."""
    return (
        *(_for_this_rig(check, intent.rig) for check in card_checks(intent.card, intent.serial)),
        *acceptance_checks_of_card(intent.card),
    )


def _for_this_rig(check: Finding, rig: RigChoice) -> Finding:
    """What is merely unknown matters on hardware; of a simulated gear nobody can know it."""
    if check.severity is Severity.WARNS and not rig.is_hardware:
        return replace(check, severity=Severity.PASSED, found=f"{check.found} (a simulated gear)")
    return check


def parameters_check(planned: PlannedRun, rig: RigChoice) -> Finding:
    """What plan and prediction rest on: parameter set, mounting, load inertia and where that is from."""
    if not planned.experiment.gear_mounted:
        return Finding("parameters", Severity.PASSED, f"{planned.motor.name} without a gear")
    inertia = planned.gear.value("inertia.output")
    uncertainty = inertia.origin.standard_uncertainty
    doubt = give_or_take(uncertainty)
    evidence = (
        f"{planned.gear.name}, {planned.mounting.replace('-', ' ')}, ratio "
        f"{planned.load.ratio:g}; load inertia {inertia.value:g}"
        f"{doubt} kg m² ({inertia.origin.provenance}: {inertia.origin.source or 'no source'})"
    )
    doubtful = rig.is_hardware and inertia.origin.provenance not in ("measured", "identified")
    remedy = "Limits of ramps and torque rest on it: measure it and write it into the gear card."
    return passed_if("parameters", not doubtful, evidence, remedy, otherwise=Severity.WARNS)


def _plan_check(planned: PlannedRun) -> Finding:
    """The plan in one line."""
    turns = planned.input_revolutions
    evidence = (
        f"{len(planned.plan)} steps, {time_in_words(planned.nominal)} nominal, "
        f"{time_in_words(planned.longest)} at most, "
        f"{turns:.0f} input revolutions; smallest margin "
        f"{percent(min((m.margin for m in planned.margins), default=1.0))}"
    )
    return Finding("plan", Severity.PASSED, evidence)


def prediction_checks(preview: PlanPreview) -> tuple[Finding, ...]:
    """Every prediction that touches a limit; one good line where none does."""
    if preview.warnings:
        remedy = "Lower speed or acceleration, or know the parameter better."
        return tuple(
            Finding("prediction", Severity.WARNS, warning.text, remedy)
            for warning in preview.warnings
        )
    least = min(preview.margins, key=lambda margin: margin.least_margin, default=None)
    if least is None:
        return ()
    evidence = (
        f"no limit is touched; nearest {least.quantity.replace('_', ' ')}, "
        f"{percent(least.least_margin)} left at the upper "
        f"end of its uncertainty ({least.where})"
    )
    return (Finding("prediction", Severity.PASSED, evidence),)


def latch_checks(rig: RigChoice) -> tuple[Finding, ...]:
    """Whether an earlier trip is still latched."""
    try:
        trip = rig.latch().read()
    except ConfigurationError as error:
        return (Finding("bench", Severity.BLOCKS, short(error), error.remedy),)
    if trip is None:
        return (Finding("trip latch", Severity.PASSED, "no trip is latched"),)
    unsafe = "" if trip.standstill_verified else "; standstill was NOT verified"
    return (
        Finding(
            "trip latch",
            Severity.BLOCKS,
            f"{trip.cause.replace('_', ' ')} in run {trip.run}, {trip.time}{unsafe}",
            "Find and remove the cause, then press Acknowledge the trip.",
        ),
    )


def obstacles(intent: Intent, outlook: Outlook | None) -> list[str]:
    """Why a run cannot be started yet, apart from the sign-off: the most important first."""
    if outlook is None:
        return ["the plan is being worked out"]
    reasons = []
    if outlook.problem is not None:
        reasons.append(short(outlook.problem))
    reasons += [
        f"{check.what}: {check.found}"
        for check in outlook.checks
        if check.severity is Severity.BLOCKS
    ]
    if not intent.operator.strip():
        reasons.append("no operator is named")
    if intent.rig.is_hardware:
        try:
            # A campaign is armed run by run, each when it begins.
            typed = arming(intent, "").expected if intent.campaign else intent.confirmation
            refuse_unarmed(arming(intent, typed))
        except ConfigurationError as error:
            reasons.append(short(error))
    return reasons


def short(error: Exception) -> str:
    """A refusal in one sentence: what, value, limit; where it is from only if nothing else says so."""
    what, where = getattr(error, "what", str(error)), getattr(error, "where", "")
    value, limit = getattr(error, "value", None), getattr(error, "limit", "")
    text = phrase("{}: ", where) + str(what)
    text += f" ({value})" if value is not None else ""
    return text + phrase("; allowed {}", limit)


def write_parameters(order: Order) -> Path | None:
    """The gear of an order as a parameter file beside the cards, so that what is run is what was planned.

    None where the rig has this gear anyway. Raises `ParameterError` where it cannot be written.
    """
    gear = described(order.config).get("gear") or shipped_gear()
    if order.gear == gear:
        return None
    path = card_path(order.folder, order.serial)
    path = path.parent / "parameters" / path.name
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigurationError(
            f"cannot be made: {error.strerror or error}", where=str(path.parent)
        ) from error
    save_gear(order.gear, path)
    return path


def arguments_for(
    order: Order, confirmation: str = "", parameters: Path | None = None
) -> list[str]:
    """What follows `python -m rig` to start this order as a child that is spoken to in lines.

    `parameters` is the parameter file of the gear, `confirmation` what was typed to arm this one run.
    """
    words = ["run", order.protocol, *arguments_of(order, SAID_OF_A_RUN, parameters)]
    if confirmation:
        words.append(f"--confirm={confirmation}")
    words += [
        f"--{name.replace('_', '-')}={_as_text(value)}" for name, value in order.values.items()
    ]
    return [*words, "--events", "--stdin-control"]


def doctor_arguments(
    order: Order | None, rig: RigChoice, confirmation: str = "", parameters: Path | None = None
) -> list[str]:
    """What follows `python -m rig` to have this rig looked over; on hardware it moves only if the
    run would be armed.
    """
    words = ["doctor", "--stdin-control"]
    if order is None:
        bare = Order(
            protocol="doctor", backend=rig.backend, folder=rig.folder, config=rig.configuration
        )
        return [*words, *arguments_of(bare, ("backend", "folder", "config"))]
    words += arguments_of(order, _SAID_TO_A_CHILD, parameters)
    if rig.is_hardware and confirmation:
        words += [f"--confirm={confirmation}", "--move"]
    return words


def commission_arguments(
    order: Order, confirmation: str = "", parameters: Path | None = None
) -> list[str]:
    """What follows `python -m rig` to take this bench through the stages that are missing."""
    words = ["commission", *arguments_of(order, _SAID_TO_A_CHILD[:-1], parameters)]
    if confirmation:
        words.append(f"--confirm={confirmation}")
    return [*words, "--events", "--stdin-control"]


def arming(intent: Intent, typed: str) -> Arming:
    """What an intent says of who arms it, with what was typed."""
    return Arming(
        intent.operator,
        intent.serial,
        typed,
        catalogue.load(intent.protocol).gear_mounted,
        _limits_set_by_hand(intent.rig),
    )


def _limits_set_by_hand(rig: RigChoice) -> str:
    """The limits of a drive that does not tell them, in the words in which they are typed again."""
    from rig.bench.config.apply import limits_by_hand

    return limits_by_hand(_described_by(rig))


def to_be_typed(rig: RigChoice, is_mounted: bool) -> str:
    """What arms a run, in words: the gear, and limits that were set by hand; a description that cannot be read says so
    elsewhere.
    """
    what = "the gear's serial number" if is_mounted else WITHOUT_GEAR
    try:
        return f"{what} {_limits_set_by_hand(rig)}".strip()
    except ConfigurationError:
        return what


def is_armed(intent: Intent) -> bool:
    """Whether operator, gear and typed confirmation would arm this rig."""
    try:
        refuse_unarmed(arming(intent, intent.confirmation))
    except ConfigurationError:
        return False
    return True


def _as_text(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, (tuple, list)):
        return " ".join(f"{number:g}" for number in value)
    return str(value)


def sign_off_notes(checks: Sequence[Finding], name: str) -> tuple[str, ...]:
    """What a run keeps of its signed checklist: the good items in one line, every accepted warning
    with its evidence.
    """
    good = ", ".join(
        dict.fromkeys(check.what for check in checks if check.severity is Severity.PASSED)
    )
    return (
        *filter(None, (phrase("checklist signed by {1}: {0}", good, name),)),
        *(
            f"accepted by {name}: {c.what}: {c.found}"
            for c in checks
            if c.severity is Severity.WARNS
        ),
    )


def title_of(order: Order, planned: PlannedRun) -> str:
    """How the run is called in the window."""
    gear = order.serial if planned.experiment.gear_mounted else "no gear"
    return f"{planned.experiment.title} · {gear}"


def heading(name: str) -> str:
    """A field's name as a label."""
    words = named(name)[0]
    return words[:1].upper() + words[1:]
