"""What can be said of a rig: bus, nodes, channels, scalings, limits, ratings, calibrations. Units stand in the words.

Every model is frozen and refuses unknown keys. Defaults are those of the standards or of the rig in
the paper; what only the nameplate can tell (lines, multiplication, node-IDs) has none. A field has
the name that the driver has for it, the word of the file where that differs is its alias: so
`Part.settings` yields what the driver's configuration is made of, and nothing is copied by hand.
"""

from __future__ import annotations

import datetime
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import (
    Field,
    model_validator,
)

from drivers import channel as names
from experiments.tares.same_rig import AGE_LIMIT
from model.unit_text import read
from model.units import RPM
from rig.bench.config.drives import AnyDrive, ReferenceDrive
from rig.bench.config.objects import read_object
from rig.bench.config.parts import (
    Direction,
    Encoder,
    Instrument,
    Milliseconds,
    NodeId,
    NotNegative,
    ObjectText,
    Part,
    Positive,
    Word,
)
from rig.bench.config.ranges import ALARM_RANGES
from rig.bench.config.sources import AnySource

FORMAT = "harmonic-rig-1"
"""The value of `format` in the files that this program reads."""


class General(Part):
    """The rig as a whole: its name, the SYNC rate, where runs go, what turns it and what is tested on it.

    `motor` and `gear` name a shipped parameter set or a TOML file beside this one. `tare_days` are the
    days after which a motor tare is not found any more.
    """

    name: str = Field(min_length=1)
    location: str = ""
    output: str = "runs"
    sample_rate_hz: Annotated[float, Field(strict=True, ge=1.0, le=10_000.0)] = 500.0
    motor: str = "sgmjv-02"
    gear: str = "csf-25-120"
    tare_days: Positive = AGE_LIMIT


class BenchName(Part):
    """Which bench this is: drawn once by `rig config new`, never used for another rig.

    It names a folder. Descriptions of version 0.1.0 have none; a run on hardware asks for it. A hub
    (`interface = "socketcand"`) goes by its address, whatever stands here.
    """

    id: str = Field(default="", pattern=r"^([a-z0-9]+(-[a-z0-9]+)*)?$", max_length=64)


class Bus(Part):
    """The CAN bus as python-can names it. `time_stamps`: what the stamps of frames are ("automatic": by the interface).

    `stamp_wrap_s` is the range of an adapter's clock that wraps (a 32-bit microsecond counter:
    4294.967296), 0 if it does not. `arguments` go to python-can as they stand (host and port of a
    socketcand hub, serial number of an adapter).
    """

    interface: str = Field(min_length=1)
    channel: str | int = "can0"
    bit_rate: Annotated[int, Field(strict=True, ge=10_000, le=8_000_000)] = 1_000_000
    time_stamps: Literal["automatic", "hardware", "device", "host"] = "automatic"
    stamp_wrap_s: NotNegative = 0.0
    own_node_id: NodeId = 127
    arguments: dict[str, str | int | float | bool] = {}


class MotorEncoder(Encoder):
    """The motor's encoder as the drive reports it in 0x6064; `modulus` is where that count wraps."""

    modulus: Annotated[int, Field(strict=True, ge=2, le=1 << 32)] = 1 << 32


class Counter(Encoder):
    """A counter on the bus (CiA 406, or any whose object, type and range are named here). `modulus`
    0: asked of the device.

    `largest_speed_rpm` of the shaft bounds a count's step per cycle; 0: from the motor's and the ratio.
    """

    objects: ClassVar[Mapping[str, str]] = {
        "position": "position value",
        "alarms": "alarms",
        "index_position": "index position",
        "index_status": "index marks seen",
    }

    node_id: NodeId
    channel: str = names.OUTPUT_ANGLE
    index_channel: str = names.OUTPUT_INDEX
    position: ObjectText = "0x6004:0 U32"
    modulus: Annotated[int, Field(strict=True, ge=0, le=1 << 32)] = 0
    operating_parameters: Annotated[int, Field(strict=True, ge=0, le=0xFFFF)] | None = None
    alarms: ObjectText | None = "0x6503:0 U16"
    alarm_mask: Word = 0xFFFF
    largest_speed: NotNegative = Field(default=0.0, alias="largest_speed_rpm")
    heartbeat_ms: Milliseconds = 100
    sdo_timeout_ms: Milliseconds = 300
    eds: str = ""

    def settings(self) -> dict[str, Any]:
        """As the driver has it: the speed in rad/s."""
        return super().settings() | {"largest_speed": self.largest_speed * RPM}


class AnalogInput(Instrument):
    """One analogue input. The torque port has `volts_per_rated_torque`; any other channel `unit`
    and `unit_per_volt`.
    """

    channel: str = names.TORQUE
    source: ObjectText = Field(default="0x6401:1 I16", alias="object")
    volts_per_count: Positive
    volts_per_rated_torque: Positive | None = None
    unit: str = ""
    unit_per_volt: Positive | None = None
    zero_volts: Annotated[float, Field(strict=True, allow_inf_nan=False)] = 0.0
    full_scale: Positive = Field(default=10.24, alias="full_scale_volts")
    open_level: Annotated[float, Field(strict=True, allow_inf_nan=False)] | None = Field(
        default=None, alias="open_level_volts"
    )
    status_bits: Annotated[int, Field(strict=True, ge=0, le=15)] = 0
    direction: Direction = 1

    @model_validator(mode="after")
    def _one_scale(self) -> AnalogInput:
        if self.calibration.curve is not None:
            raise ValueError("a curve over an angle is an encoder's, not that of an analogue input")
        is_torque = self.channel == names.TORQUE
        if is_torque and (
            self.volts_per_rated_torque is None or self.unit_per_volt is not None or self.unit
        ):
            raise ValueError(
                "the torque port needs volts_per_rated_torque, and neither unit nor unit_per_volt"
            )
        if not is_torque and (
            self.unit_per_volt is None or not self.unit or self.volts_per_rated_torque is not None
        ):
            raise ValueError(
                "a channel that is not the torque port needs unit and unit_per_volt, and no volts_per_rated_torque"
            )
        if self.unit and read(self.unit).zero:
            raise ValueError(
                f"a scale per volt has no zero of its own: unit = {self.unit!r}; write degC"
            )
        return self

    def input_settings(self, rated_torque: float) -> dict[str, Any]:
        """As the driver has it: the torque port in N m per volt, by the rated torque [N m] of the motor."""
        values = self.settings()
        volts, name = values.pop("volts_per_rated_torque"), f"analogue input of {self.channel}"
        if volts is not None:
            values |= {"unit": "N m", "unit_per_volt": rated_torque / volts}
            name = "torque monitor"
        elif self.unit_per_volt is not None:
            unit = read(self.unit)
            values |= {"unit": unit.si, "unit_per_volt": self.unit_per_volt * unit.scale}
        return values | {"source": read_object(self.source, name)}


class AnalogModule(Part):
    """An analogue input module (CiA 401)."""

    node_id: NodeId
    inputs: tuple[AnalogInput, ...] = Field(alias="input", min_length=1)
    heartbeat_ms: Milliseconds = 100
    sdo_timeout_ms: Milliseconds = 300
    eds: str = ""


class Readout(Part):
    """A HEIDENHAIN ND 287 on a serial line, for stop-and-read checks: device, pty or socket as one URL."""

    url: str = Field(min_length=1)
    baud: Annotated[int, Field(strict=True, ge=110, le=4_000_000)] = Field(
        default=9600, alias="baud_rate"
    )
    data_bits: Literal[7, 8] = 7
    parity: Literal["N", "E", "O"] = "E"
    stop_bits: Literal[1, 2] = 2
    xon_xoff: bool = False
    storage_delay_ms: NotNegative = 1.0
    answer_ms: Positive = 500.0


class GuardInput(Part):
    """The guard's contact as an input of a node: closed when (value AND mask) equals `closed`."""

    objects: ClassVar[Mapping[str, str]] = {"entry": "guard input"}

    node_id: NodeId
    entry: ObjectText = Field(default="0x60FD:0 U32", alias="object")
    mask: Annotated[int, Field(strict=True, ge=1, le=0xFFFF_FFFF)]
    closed: Word

    @model_validator(mode="after")
    def _reachable(self) -> GuardInput:
        if self.closed & ~self.mask:
            raise ValueError(
                f"closed = 0x{self.closed:X} has bits outside mask = 0x{self.mask:X}: it would never be closed"
            )
        return self


class Limits(Part):
    """Limits of this rig, tighter than those of gear, motor and drive where that is wanted; torques at the motor."""

    motor_torque_n_m: Positive | None = None
    rms_torque_n_m: Positive | None = None
    torsion_torque_n_m: Positive | None = None
    input_speed_rpm: Positive | None = None
    average_speed_rpm: Positive | None = None
    acceleration_rad_s2: Positive | None = None
    deceleration_rad_s2: Positive | None = None
    quick_stop_deceleration_rad_s2: Positive | None = None
    housing_temperature_deg_c: Positive | None = None


class OutputBearing(Part):
    """Friction of the bench's own bearing at the output, measured with the gear off, and its expanded uncertainty
    (k = 2). It is subtracted from the friction of every gear that is measured here.
    """

    friction_n_m: NotNegative
    uncertainty_n_m: NotNegative
    viscous_n_m_s: NotNegative = 0.0
    viscous_uncertainty_n_m_s: NotNegative = 0.0
    date: datetime.date
    source: str = Field(min_length=1)


class Ratings(Part):
    """Ratings of the gear as its nameplate or catalogue has them: they replace those of the parameter set."""

    source: str = ""
    repeated_peak_torque_n_m: Positive | None = None
    momentary_peak_torque_n_m: Positive | None = None
    maximum_input_speed_rpm: Positive | None = None
    average_input_speed_rpm: Positive | None = None

    @model_validator(mode="after")
    def _with_source(self) -> Ratings:
        given = [
            name
            for name in type(self).model_fields
            if name != "source" and getattr(self, name) is not None
        ]
        if given and not self.source:
            raise ValueError(
                "say in source where the ratings come from (catalogue and page, nameplate)"
            )
        return self


class RealTime(Part):
    """How the loop keeps time on this computer.

    `reaction_ms` of cycles are exchanged at once: so soon is the operator heard.
    `scheduler_priority` 1 to 99 asks Linux for the real-time class SCHED_FIFO, 0 does not ask.
    `lock_memory` keeps the process in memory.
    """

    reaction_ms: Annotated[float, Field(strict=True, ge=1.0, le=200.0)] = 20.0
    patience_cycles: Annotated[float, Field(strict=True, ge=1.0, le=1000.0)] = 5.0
    stale_cycles: Annotated[int, Field(strict=True, ge=1, le=10_000)] = 50
    scheduler_priority: Annotated[int, Field(strict=True, ge=0, le=99)] = 0
    lock_memory: bool = False


class Laboratory(Part):
    """Who tests and for whom, as it stands on a certificate. `logo` is a picture beside this file (PNG, JPEG, SVG).

    `place` is where the test was made, where that is not the address; `received` the day on which the item came;
    `deviations` what was done otherwise than the method says, `language` the certificate's: en, de, ja, or a file of
    sentences beside this one.
    """

    name: str = Field(min_length=1)
    address: str = ""
    logo: str = ""
    customer: str = ""
    order: str = ""
    method: str = ""
    deviations: str = ""
    place: str = ""
    received: datetime.date | None = None
    language: str = Field(default="en", min_length=1)


def _ranged(default: float, name: str) -> Any:
    low, high = ALARM_RANGES[name]
    return Field(default=default, ge=low, le=high)


class Alarms(Part):
    """How often a gear that does not change may be told to have changed (`rig report --passport`), and the golden gear.

    At most `false_alarms` of such gears within `over` runs after the first `baseline` ones. `golden_gear` is the serial
    of a gear that is kept to be measured again and again: what changes with it is the bench; `golden_days` is every how
    many days (0: nobody is reminded).
    """

    false_alarms: float = _ranged(0.05, "false_alarms")
    over: int = _ranged(20, "over")
    baseline: int = _ranged(10, "baseline")
    golden_gear: str = ""
    golden_days: float = Field(default=0.0, ge=0.0, le=3650.0)


class Notify(Part):
    """The `command` that is called when a run waits for somebody, has ended or has tripped: its words, then the state
    and the run file. It is called from the folder of this file, by a process beside the run, and ended after 5 s.
    """

    command: tuple[str, ...] = Field(min_length=1)


class RigConfiguration(Part):
    """A rig of hardware, as its `rig.toml` describes it."""

    format: Literal["harmonic-rig-1"]
    rig: General
    bench: BenchName = BenchName()
    bus: Bus
    drive: AnyDrive
    motor_encoder: MotorEncoder
    counters: tuple[Counter, ...] = Field(default=(), alias="counter")
    analog_modules: tuple[AnalogModule, ...] = Field(default=(), alias="analog_module")
    sources: tuple[AnySource, ...] = Field(default=(), alias="source")
    readout: Readout | None = None
    guard: GuardInput | None = None
    output_bearing: OutputBearing | None = None
    limits: Limits = Limits()
    ratings: Ratings = Ratings()
    real_time: RealTime = RealTime()
    laboratory: Laboratory | None = None
    alarms: Alarms = Alarms()
    notify: Notify | None = None

    @model_validator(mode="after")
    def _consistent(self) -> RigConfiguration:
        _each_once(_nodes_of(self), "node-ID")
        channels = [(f"counter on node {c.node_id}", c.channel) for c in self.counters]
        channels += [
            (f"input {a.source} of node {m.node_id}", a.channel)
            for m in self.analog_modules
            for a in m.inputs
        ]
        channels += [(f"source {s.kind} at {s.place}", s.channel) for s in self.sources]
        _each_once(channels, "channel")
        if isinstance(self.drive, ReferenceDrive) and names.INPUT_ANGLE not in dict(
            (channel, who) for who, channel in channels
        ):
            raise ValueError(
                f"a drive by analog reference counts nothing itself: a counter or source of {names.INPUT_ANGLE} is "
                "needed for the motor encoder's divided pulses"
            )
        node_ids = {
            self.drive.node_id,
            *(c.node_id for c in self.counters),
            *(m.node_id for m in self.analog_modules),
        }
        if self.guard is not None and self.guard.node_id not in node_ids:
            raise ValueError(
                f"guard.node_id = {self.guard.node_id} is no node of this rig: {sorted(node_ids)}"
            )
        return self


def _nodes_of(rig: RigConfiguration) -> list[tuple[str, int]]:
    """Who claims which node-ID. A coupler may hold several counters and inputs, and claims its own once: its counters
    are objects of terminals, not the position of an encoder.
    """
    at = {counter.node_id: f"counter {counter.channel}" for counter in rig.counters}
    terminals = {c.node_id for c in rig.counters if read_object(c.position).index != 0x6004}
    modules = [(f"analog_module {i + 1}", m.node_id) for i, m in enumerate(rig.analog_modules)]
    _each_once(modules, "node-ID")
    own = rig.drive.node_id
    beside = (*terminals, *(node_id for _, node_id in modules))
    is_terminal = isinstance(rig.drive, ReferenceDrive) and own in beside
    if is_terminal:
        terminals.add(own)
        at.setdefault(own, "drive")
    return [
        *([] if is_terminal else [("drive", own)]),
        ("bus.own_node_id", rig.bus.own_node_id),
        *(
            (f"counter {c.channel}", c.node_id)
            for c in rig.counters
            if read_object(c.position).index == 0x6004
        ),
        *((at[node_id], node_id) for node_id in sorted(terminals)),
        *((name, node_id) for name, node_id in modules if node_id not in terminals),
    ]


def _each_once(
    named: list[tuple[str, object]] | list[tuple[str, int]] | list[tuple[str, str]], what: str
) -> None:
    owner: dict[object, str] = {}
    for name, value in named:
        if value in owner:
            raise ValueError(f"{what} {value} is given twice: {owner[value]} and {name}")
        owner[value] = name
