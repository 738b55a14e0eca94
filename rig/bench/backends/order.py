"""What a run is asked for, said once: protocol, gear, bench, simulated world, limits, folder, verdict.

    Order ---- options ----> `rig run`, `plan`, `campaign`, `doctor`, `sim serve`     rig.commands.ordering
           |-- keywords ---> `rig.execute`                                            rig.api.executing
           |-- arguments --> the child of the window                                  rig.window.prepare.request
           |-- entries ----> the protocols of a campaign                              rig.trial.campaign.plan
           |-- rows -------> the page "What a run is asked for"                       docs/reference_pages/order.py

A field that a person says bears a `Spoken`: help, group, option, kind, unit, range. What was said is a mapping from
names of fields to values, and what was not said is not in it; `rig.run.ordering.order_of` makes an `Order` of it, with
what the configuration, the gear's card and a recorded run know.

Consent is no part of it. That somebody has looked at the rig, confirmed, acknowledged or answered is said for one run,
goes past the order to `rig.run.start.run_order`, and is kept nowhere: an order can be stored, sent and repeated, and
whoever repeats it has not looked. Neither is anything that a session is put together of (port, clock, latch, marker,
watchdog): that is `rig.run.parts.SessionParts`, which has no field in common with it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drivers.errors import DriverError
from rig.errors import ConfigurationError

if TYPE_CHECKING:
    # The command line reads these fields to show its help: nothing heavy may be imported for that.
    from model.gear import HarmonicDrive, Mounting
    from model.motor import ServoMotor
    from sim_backend.world import Population, World

AUTO, AMBIENT = "auto", "ambient"
"""How warm a simulated rig starts: as the latest run that fits ended, or as the room. Anything else names a run."""
MOUNTINGS: tuple[Mounting, ...] = ("circular-spline-fixed", "flexspline-fixed")
DEFAULT_SAMPLE_RATE = 1000.0
UNKNOWN = "unknown"
"""The serial number of a gear that nobody names."""


@dataclass(frozen=True, kw_only=True)
class Spoken:
    """How people say a field. `kind` is what text becomes, `factor` leads from `unit` to the field's own (SI)."""

    help: str
    group: str
    """What it belongs to: protocol, gear, bench, world, folder, verdict."""
    kind: type = str
    option: str = ""
    """Its flag on the command line; "" where it has none."""
    metavar: str | None = None
    unit: str = ""
    factor: float = 1.0
    least: float | None = None
    most: float | None = None


def spoken(help: str, group: str, **words: Any) -> dict[str, Spoken]:
    """The metadata of a field that people say."""
    return {"spoken": Spoken(help=help, group=group, **words)}


def words_of(kind: type) -> dict[str, Spoken]:
    """The fields of a dataclass that people say, by name, in their order."""
    return {f.name: f.metadata["spoken"] for f in fields(kind) if "spoken" in f.metadata}


@dataclass(frozen=True)
class StartState:
    """How warm a simulated rig starts: the temperatures [degC] with which a run ended; as the room without any."""

    run: str = ""
    temperatures: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class WorldChoice:
    """Which simulated world somebody wants. None: the gear's seed follows from its serial number, the bench's is the
    order's seed, the number is the next in the folder, the start state is looked for by `start_state`.

    `mount_turn` in rad, None where nobody states it; `day_correlation` None: that of the population; `version` of the
    draws, None: the newest; `repeats` names the run of which this is a repetition. Raises `ConfigurationError` for a
    value that names no world.
    """

    gear_seed: int | None = field(
        default=None,
        metadata=spoken(
            "Which individual gear; follows from the serial number.",
            "gear",
            kind=int,
            metavar="G",
        ),
    )
    hours: float = field(
        default=0.0,
        metadata=spoken(
            "How long the gear has run [h]: friction, order 2, stiffness and backlash wear at rates of its own.",
            "gear",
            kind=float,
            metavar="H",
        ),
    )
    bench_seed: int | None = field(
        default=None,
        metadata=spoken(
            "Which bench: encoders, torque port, motor, bearing; --seed without it.",
            "bench",
            kind=int,
            metavar="B",
        ),
    )
    mount: int = field(
        default=1,
        metadata=spoken(
            "How often the gear was fitted: a new number is a gear taken off and refitted.",
            "gear",
            kind=int,
            metavar="M",
        ),
    )
    mount_turn: float | None = field(
        default=None,
        metadata=spoken(
            "Angle on the output flange from where mounting 1 had the gear, as the encoder counts [deg]; "
            "with mount, because a gear that is turned is fitted anew. Without it nobody knows the angle.",
            "gear",
            kind=float,
            metavar="DEG",
            unit="deg",
            factor=math.radians(1.0),
        ),
    )
    day: int = field(
        default=1,
        metadata=spoken(
            "Which day: temperature of the room, zero of the torque port.",
            "world",
            kind=int,
            metavar="D",
        ),
    )
    day_correlation: float | None = field(
        default=None,
        metadata=spoken(
            "How much a day resembles the one before, 0 to 0.95; 0 without it, of a wide bench 0 to 0.4.",
            "world",
            kind=float,
            metavar="R",
        ),
    )
    number: int | None = field(
        default=None,
        metadata=spoken(
            "Number that owns noise and start angle; the next in the folder.",
            "world",
            kind=int,
            metavar="K",
        ),
    )
    population: Population = field(
        default="narrow",
        metadata=spoken(
            "narrow: gears of one series and a good bench; wide: as different as they come.",
            "world",
            metavar="NAME",
        ),
    )
    start_state: str = field(
        default=AUTO,
        metadata=spoken(
            "How warm it starts: auto (as the latest run of this gear, bench, mounting and day ended), ambient, "
            "or as the RUN ended whose number or file is given.",
            "world",
            metavar="STATE",
        ),
    )
    version: int | None = None
    start: StartState | None = None
    repeats: str = ""

    def __post_init__(self) -> None:
        try:
            self.world(0, 0)
        except DriverError as error:
            raise ConfigurationError(
                error.what,
                where=world_word(error.where),
                value=error.value,
                limit=error.limit,
                remedy=error.remedy,
            ) from None

    def world(self, gear_seed: int, bench_seed: int) -> World:
        """The world, with these seeds where none are chosen."""
        from sim_backend.world import VERSION, World

        chosen: dict[str, Any] = {f.name: getattr(self, f.name) for f in fields(World)}
        usual = {"gear_seed": gear_seed, "bench_seed": bench_seed, "number": 1, "version": VERSION}
        return World(**{**chosen, **{n: v for n, v in usual.items() if chosen[n] is None}})


WORLD_WORDS = words_of(WorldChoice)
"""The words of a simulated world, by field."""


def key_of(name: str) -> str:
    """A word of the world as it is written: its unit is part of it."""
    unit = WORLD_WORDS[name].unit if name in WORLD_WORDS else ""
    return f"{name}-{unit}".strip("-").replace("_", "-")


def world_word(name: str) -> str:
    """How a field of `WorldChoice` is called on the command line, for an error to name it."""
    return f"--world {key_of(name)}"


def world_of(said: Mapping[str, Any], taken: Iterable[str] = WORLD_WORDS) -> WorldChoice:
    """The choice that words make: text or numbers by key (`gear-seed` or `gear_seed`), in the units that keys name.

    `taken` are the fields that may be said. Raises `ConfigurationError` for another word or a value that is none.
    """
    names = {key_of(name): name for name in taken}
    chosen: dict[str, Any] = {}
    for written, value in said.items():
        name = names.get(str(written).replace("_", "-"))
        if name is None:
            raise ConfigurationError(
                "no such word of a simulated world",
                where="--world",
                value=written,
                limit=", ".join(names),
            )
        if value is None:
            continue
        words = WORLD_WORDS[name]
        try:
            number = words.kind(value) if isinstance(value, str) else value
        except ValueError:
            kind = "a whole number" if words.kind is int else "a number"
            raise ConfigurationError(
                "cannot be read", where=world_word(name), value=repr(value), limit=kind
            ) from None
        chosen[name] = number * words.factor if words.unit else number
    return WorldChoice(**chosen)


def world_said(text: str) -> dict[str, str]:
    """The words of `gear-seed=5,day=2`. Raises `ConfigurationError` for other text, and for a word said twice."""
    said: dict[str, str] = {}
    for part in filter(None, map(str.strip, text.split(","))):
        key, equals, value = part.partition("=")
        if not equals or key in said:
            raise ConfigurationError(
                "is said twice" if equals else "is no word with its value",
                where="--world",
                value=part,
                limit="word=value, once each, commas between",
                remedy="For instance: --world gear-seed=5,day=2",
            )
        said[key] = value
    return said


def _shipped_gear() -> HarmonicDrive:
    from model.gear_file import shipped_gear

    return shipped_gear()


def _shipped_motor() -> ServoMotor:
    from model.motor import shipped_motor

    return shipped_motor()


@dataclass(frozen=True, kw_only=True, slots=True)
class Order:
    """What a run is asked for. Fields that no person says come from the rig's configuration and the gear's card.

    `gear` and `motor` are the nominal ones; on a simulated rig `world` says which individuals are meant, and what it
    leaves open follows from `serial` (the gear) and `seed` (the bench). It has slots, so that nothing else can be hung
    onto it.
    """

    protocol: str = field(
        metadata=spoken(
            "Which protocol is run.",
            "protocol",
        ),
    )
    values: Mapping[str, Any] = field(
        default_factory=dict,
        metadata=spoken(
            "Parameters of the protocol that differ from their defaults.",
            "protocol",
            kind=dict,
        ),
    )
    backend: str = field(
        default="sim",
        metadata=spoken(
            "Which rig: sim (the default), wire (drivers and simulated devices), or hardware (see --config); "
            "a run also replay:RUN.h5.",
            "bench",
            option="--backend",
        ),
    )
    serial: str = field(
        default=UNKNOWN,
        metadata=spoken(
            "Serial number of the gear; its card tells part, mounting and load inertia.",
            "gear",
            option="--gear",
            metavar="SERIAL",
        ),
    )
    operator: str = field(
        default="",
        metadata=spoken(
            "Who runs it; named wherever hardware moves.",
            "bench",
            option="--operator",
            metavar="NAME",
        ),
    )
    folder: Path = field(
        default=Path("runs"),
        metadata=spoken(
            "Folder of run files and gear cards; runs, or that of the configuration.",
            "folder",
            kind=Path,
            option="--runs",
            metavar="DIR",
        ),
    )
    seed: int = field(
        default=0,
        metadata=spoken(
            "Seed of a simulated rig, 0 by default: another one is another bench.",
            "bench",
            kind=int,
            option="--seed",
            least=0,
        ),
    )
    world: WorldChoice = field(
        default_factory=WorldChoice,
        metadata=spoken(
            "Simulated world, as in gear-seed=5,day=2.",
            "world",
            option="--world",
            metavar="WORD=VALUE,...",
        ),
    )
    gear: HarmonicDrive = field(
        default_factory=_shipped_gear,
        metadata=spoken(
            "Parameter set of the gear (TOML).",
            "gear",
            kind=Path,
            option="--parameters",
            metavar="FILE",
        ),
    )
    mounting: Mounting = field(
        default="circular-spline-fixed",
        metadata=spoken(
            "circular-spline-fixed (ratio N, the default) or flexspline-fixed (ratio N + 1); known: by card.",
            "gear",
            option="--mounting",
        ),
    )
    sample_rate: float = field(
        default=DEFAULT_SAMPLE_RATE,
        metadata=spoken(
            "SYNC rate [Hz]; 1000, or that of the configuration.",
            "bench",
            kind=float,
            option="--sample-rate",
            metavar="HZ",
            unit="Hz",
            least=50.0,
            most=20000.0,
        ),
    )
    config: Path | None = field(
        default=None,
        metadata=spoken(
            "The rig's configuration (rig.toml): gear, motor, limits, rate, folder.",
            "bench",
            kind=Path,
            option="--config",
            metavar="FILE",
        ),
    )
    block_cycles: int = field(
        default=2000,
        metadata=spoken(
            "Cycles per exchange, 2000 by default; changes no count.",
            "bench",
            kind=int,
            option="--block",
            least=1,
            most=100_000,
        ),
    )
    acceptance: str = field(
        default="",
        metadata=spoken(
            "What the gear must show, instead of what its card names: TOML, or a shipped name.",
            "verdict",
            option="--acceptance",
            metavar="FILE",
        ),
    )
    status: Path | None = field(
        default=None,
        metadata=spoken(
            "Keeps a page (HTML) of how the run stands, for a phone or a wall: written every 2 s beside the run.",
            "folder",
            kind=Path,
            option="--status",
            metavar="FILE",
        ),
    )
    motor: ServoMotor = field(default_factory=_shipped_motor)
    limits: Mapping[str, float] = field(default_factory=dict)
    """Limits of the rig by quantity (SI)."""
    output_bearing: Mapping[str, Any] = field(default_factory=dict)
    """The bench's output bearing, as run files carry it."""
    conditions: Mapping[str, Any] = field(default_factory=dict)
    """Conditions of the gear, as its card states them."""
    calendar_ns: int | None = None
    """Calendar time at which the clock of a simulated rig begins; None: now."""


WORDS = words_of(Order)
"""The words of an order, by field."""
_ALWAYS_SAID = ("backend", "folder", "mounting")
"""Options that are said even as they are by default: a configuration or a card would say otherwise."""


def arguments_of(order: Order, names: Iterable[str], gear: Path | None = None) -> list[str]:
    """The options that say these fields of an order; what is as by default is not said. `gear` is its parameter file.

    Every value is tied to its flag by "=": none is taken for another flag.
    """
    usual = {f.name: f.default for f in fields(Order)}
    arguments = []
    for name in names:
        value = gear if name == "gear" else getattr(order, name)
        text = _text(value)
        if text and (value != usual[name] or name in _ALWAYS_SAID):
            arguments.append(f"{WORDS[name].option}={text}")
    return arguments


def _world_text(world: WorldChoice) -> str:
    """The words that are not as by default, as `--world` takes them."""
    usual = WorldChoice()
    chosen = {name: getattr(world, name) for name in WORLD_WORDS}
    return ",".join(
        f"{key_of(name)}={_text(value / WORLD_WORDS[name].factor if WORLD_WORDS[name].unit else value)}"
        for name, value in chosen.items()
        if value != getattr(usual, name)
    )


def _text(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, WorldChoice):
        return _world_text(value)
    return f"{value:.15g}" if isinstance(value, float) else str(value)


@dataclass(frozen=True, kw_only=True)
class Setup:
    """What the plan of a run says of the rig that its order asks for: whether a gear is mounted, and the inertia of the
    disc on its output [kg m2]. A replay must have been recorded with these `parameters` of the protocol.
    `watches_contact`: a simulated rig on the wire is to have its guard's contact watched.
    """

    gear_mounted: bool = True
    parameters: Mapping[str, object] = field(default_factory=dict)
    disc_inertia: float = 0.0
    watches_contact: bool = False
