"""The worked examples: every object in them is one that the device's documents have, and a device of such objects is
brought up, limited and turned by them.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import rig.bench.config
from drivers.bus.cia301 import ObjectRef
from drivers.bus.cia402 import tables as obj
from drivers.bus.cyclic import CanRig
from drivers.channel import INPUT_ANGLE, OUTPUT_ANGLE, TARGET_SPEED, TORQUE
from drivers.clock import VirtualClock
from drivers.drive_state import DriveState, drive_state
from drivers.port import Command, DriveLimits, Guard, Mode
from drivers.samples import CycleFlag
from experiments.finding import Severity
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig.bench.backends.assembly import AssembledRig
from rig.bench.backends.hardware import can_rig_config, read_guard
from rig.bench.backends.order import Order
from rig.bench.backends.simulated import reference_device
from rig.bench.config.apply import configured_limits
from rig.bench.config.load import load_configuration, missing_files
from rig.bench.config.objects import read_object
from rig.bench.config.schema import RigConfiguration
from rig.errors import ConfigurationError
from rig.main import app
from rig.run.dry_run import plan_run
from rig.run.preflight import limits_check
from rig.run.start import run_on
from rig.runfile.read import close_recording, open_run
from rig.trial.doctor.examine import examine
from rig.trial.drill.protocol import EXPERIMENT as DRILL
from rig.trial.drill.protocol import DrillParameters
from sim_backend.imperfections import Imperfections, Sizes
from sim_backend.wire.bench import WireBench
from tests.drivers.can_bench import servo
from tests.drivers.foreign_drive import ForeignCounter, ForeignDrive, ForeignInputs
from tests.drivers.foreign_slave import NOT_MAPPABLE, READ_ONLY, Slave, Traits, Wire
from tests.rig.bench import device_facts as facts

FOLDER = Path(rig.bench.config.__file__).parent / "examples"
NAMES = ("epos4", "elmo-gold", "sick-ahm36", "beckhoff-kl5111", "wago-750")
DRIVES = {"epos4": facts.EPOS4, "elmo-gold": facts.ELMO_GOLD}
COUNTERS = {"sick-ahm36": facts.AHM36, "beckhoff-kl5111": facts.KL5111}
MODULES = {"wago-750": facts.WAGO_750}
RPM = 2.0 * math.pi / 60.0
LIMITS = DriveLimits(0.2, 300.0, 1000.0, 1000.0, 2000.0)
SPEED_OBJECTS = (obj.CONTROLWORD, obj.STATUSWORD, obj.MODE, obj.MODE_DISPLAY, obj.POSITION)
"""What the drivers need of a drive beside what an example names."""


def example(name: str) -> RigConfiguration:
    return load_configuration(FOLDER / f"{name}.toml")


# What the examples name ---------------------------------------------------------------------------


def _drive_objects(configuration: RigConfiguration) -> Iterator[ObjectRef]:
    drive, guard = configuration.drive, configuration.guard
    yield from SPEED_OBJECTS
    yield from (obj.TARGET_VELOCITY, obj.TARGET_TORQUE, obj.QUICK_STOP_OPTION, obj.ABORT_OPTION)
    yield from (obj.MAX_MOTOR_SPEED, obj.ACCELERATION, obj.DECELERATION)
    yield obj.QUICK_STOP_DECELERATION
    yield read_object(drive.actual_torque)
    yield read_object(drive.torque_limit)
    yield from (read_object(text) for text in drive.gains)
    if guard is not None and guard.node_id == drive.node_id:
        yield read_object(guard.entry)


def _counter_objects(configuration: RigConfiguration) -> Iterator[ObjectRef]:
    for counter in configuration.counters:
        texts = [counter.position, counter.index_position, counter.index_status]
        # The alarms of CiA 406 are a default, and left out where the device lacks them.
        texts += [counter.alarms] if "alarms" in counter.model_fields_set else []
        yield from (read_object(text) for text in texts if text is not None)


def _input_objects(configuration: RigConfiguration) -> Iterator[ObjectRef]:
    for module in configuration.analog_modules:
        yield from (read_object(analog.source) for analog in module.inputs)


@pytest.mark.parametrize(
    ("objects", "devices"),
    [(_drive_objects, DRIVES), (_counter_objects, COUNTERS), (_input_objects, MODULES)],
)
def test_every_object_of_an_example_is_one_of_the_device_with_its_type(
    objects: object, devices: dict[str, facts.Device]
) -> None:
    for name, device in devices.items():
        used = list(objects(example(name)))  # type: ignore[operator]
        assert used
        for entry in used:
            fact = device.objects.get(entry.key)
            assert fact is not None, f"{name}: {entry} is not in {device.source}"
            kind = read_object(f"0x{entry.index:04X}:{entry.subindex} {fact.kind}").data_type
            assert entry.data_type == kind, f"{name}: {entry} is {fact.kind} in {device.source}"


def test_no_example_is_left_without_facts_and_none_has_been_run() -> None:
    assert {path.stem for path in FOLDER.glob("*.toml")} >= set(NAMES)
    assert set(NAMES) == {*DRIVES, *COUNTERS, *MODULES}
    for name in NAMES:
        text = (FOLDER / f"{name}.toml").read_text(encoding="utf-8")
        assert "FROM ITS DOCUMENTS, NEVER RUN" in text
        assert "Source: " in text
        assert "# yours" in text


def test_a_motor_that_nobody_has_described_is_asked_for() -> None:
    for name in DRIVES:
        assert [p.what for p in missing_files(example(name), FOLDER)] == ["rig.motor"]


@pytest.mark.parametrize("name", NAMES)
def test_an_example_is_written_with_an_identity_and_checked(name: str, tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    assert CliRunner().invoke(app, ["config", "new", str(path), "--example", name]).exit_code == 0
    assert load_configuration(path).bench.id
    done = CliRunner().invoke(app, ["config", "check", str(path), "--json"])
    asked = [problem["path"] for problem in json.loads(done.output)["problems"]]
    assert asked == (["rig.motor"] if name in DRIVES else [])


def test_an_example_that_there_is_not_lists_those_that_there_are(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    done = CliRunner().invoke(app, ["config", "new", str(path), "--example", "epos"])
    assert isinstance(done.exception, ConfigurationError)
    assert all(name in str(done.exception) for name in NAMES)
    assert not path.exists()


def test_what_the_examples_compute_is_what_they_say() -> None:
    epos, elmo = example("epos4").drive, example("elmo-gold").drive
    assert epos.rated_torque == pytest.approx(3.21 * 0.0711, rel=2e-3)
    assert epos.torque_limit_unit == pytest.approx(1e-3 * 0.0711)
    assert elmo.velocity_unit == pytest.approx(2.0 * math.pi / elmo.counts_per_revolution)
    assert elmo.acceleration_unit == elmo.velocity_unit
    assert example("wago-750").analog_modules[0].inputs[0].volts_per_count == pytest.approx(
        10.0 / 32768, rel=1e-6
    )
    ahm = example("sick-ahm36").counters[0]
    assert ahm.lines * ahm.multiplication == facts.AHM36.objects[0x6001, 0].default


SGDV_MONITOR = Sizes(torque_offset=0.0127, torque_lag=0.26e-3, torque_noise=0.0015)
"""A monitor as the maker states it: 20 mV of 1 V per rated torque, settled to 1 % in 1.2 ms."""


def papers_rig(name: str) -> tuple[AssembledRig, Order]:
    """The rig that one of the two descriptions has, in front of simulated devices that behave as the documents say."""
    configuration, gear, motor = example(name), shipped_gear(), shipped_motor()
    assert missing_files(configuration, FOLDER) == ()
    reference = None
    if name.endswith("vref"):
        reference = reference_device(Order(protocol="", gear=gear, motor=motor), motor)
    bench = WireBench(
        gear,
        motor,
        imperfections=Imperfections(sizes=SGDV_MONITOR),
        cycle_ns=2_000_000,
        clock=VirtualClock(1_790_000_000_000_000_000),
        reference=reference,
    )
    config = can_rig_config(configuration, motor, FOLDER, 2_000_000, ratio=120.0)
    port = CanRig(
        config, bench.clock, bench.bus, pump=bench.pump, time_base="hardware", origin="simulated"
    )
    guard = configuration.guard
    assert guard is not None
    rig = AssembledRig(
        name="wire",
        port=port,
        clock=bench.clock,
        nodes=lambda: port.nodes,
        guard=lambda: read_guard(port, guard),
    )
    request = Order(
        protocol="doctor",
        gear=gear,
        motor=motor,
        folder=Path(),
        backend="wire",
        sample_rate=configuration.rig.sample_rate_hz,
        limits=configured_limits(configuration),
    )
    return rig, request


@pytest.mark.parametrize("name", ["paper-sgdv", "paper-sgdv-vref"])
def test_the_papers_rig_is_looked_over_and_walked_as_its_page_says(
    name: str, tmp_path: Path
) -> None:
    """`rig doctor --motion` on either form: directions, ratio, index marks, torque, skew, limits, guard."""
    _, request = papers_rig(name)
    request = replace(request, folder=tmp_path, serial="SN-1", operator="A. Example")
    found = examine(lambda: papers_rig(name)[0], request, moves=True)
    lines = {(f.where, f.what): f for f in found.findings}
    assert [key for key, f in lines.items() if f.severity is Severity.BLOCKS] == []
    motion = {name: f.severity for (group, name), f in lines.items() if group == "motion"}
    for walked in ("input direction", "output direction", "ratio", "torque direction"):
        assert motion[walked] == "passed", lines["motion", walked].found
    skew = lines["motion", "skew of the encoders"]
    assert skew.severity == "passed", skew.found
    assert motion["index marks"] == "warns", "CiA 406 has no object for them"
    assert lines["safety", "guard"].severity is Severity.PASSED
    zero = lines["torque", "zero"]
    assert 0.0 < abs(zero.value) < 25.4, zero.found
    limits = lines["safety", "drive limits"]
    by_hand = name.endswith("vref")
    assert limits.severity == ("warns" if by_hand else "passed"), limits.found
    assert ("set by hand" in limits.found) is by_hand


@pytest.mark.parametrize("name", ["paper-sgdv", "paper-sgdv-vref"])
def test_a_run_of_the_papers_rig_is_recorded_with_every_channel_in_si(
    name: str, tmp_path: Path
) -> None:
    rig, request = papers_rig(name)
    parameters = DrillParameters(has_torque=not name.endswith("vref"))
    planned = plan_run(
        DRILL,
        parameters,
        request.gear,
        request.motor,
        sample_rate=request.sample_rate,
        configured=request.limits,
    )
    request = replace(request, protocol="drill", folder=tmp_path, operator="A. Example")
    report = run_on(rig, request, planned)
    assert report.outcome == "COMPLETED", report.message
    assert report.make_safe is not None
    assert report.make_safe.safe
    recording = open_run(report.path)
    (hold, *_) = recording.labelled("hold")
    angle, zero = recording.si("input_angle", hold), recording.labelled("zero-before")[0]
    speed = (angle[-1] - angle[0]) / (len(angle) - 1) * 500.0
    assert speed == pytest.approx(60.0, rel=0.01)
    torque = recording.si("torque", hold).mean() - recording.si("torque", zero).mean()
    assert 0.02 < torque < 0.3
    assert recording.signals["torque"].scale == pytest.approx(0.3125e-3 * 0.637)
    words = set(recording.stored("statusword", hold).tolist())
    assert {drive_state(word) for word in words} == {DriveState.ENABLED}
    close_recording(recording)


# Devices of those objects -------------------------------------------------------------------------


def _bytes_of(device: facts.Device) -> dict[facts.Key, bytes]:
    """Its objects as a slave has them."""
    found: dict[facts.Key, bytes] = {}
    for (index, sub), fact in device.objects.items():
        size = read_object(f"0x{index:04X}:{sub} {fact.kind}").data_type.size
        found[index, sub] = fact.default.to_bytes(size, "little")
    return found


class _Documented(Slave):
    """A slave whose application objects are those of a device's documents, and no others."""

    device: facts.Device

    def _factory(self) -> dict[facts.Key, bytes]:
        own = {key: data for key, data in super()._factory().items() if key[0] < 0x2000}
        return own | _bytes_of(self.device)

    def write(self, key: facts.Key, data: bytes) -> int:
        fact = self.device.objects.get(key)
        return READ_ONLY if fact is not None and fact.access == "ro" else super().write(key, data)

    def refuses_pdo(self, key: facts.Key, value: int) -> int:
        if key[0] & 0x200 and key[1]:
            fact = self.device.objects.get((value >> 16, value >> 8 & 0xFF))
            if fact is not None and not fact.is_mappable:
                return NOT_MAPPABLE
        return super().refuses_pdo(key, value)


def documented(kind: type[Slave], device: facts.Device) -> type[Slave]:
    """A slave that behaves as `kind` and has the objects of `device`."""
    return type(f"Documented{kind.__name__}", (_Documented, kind), {"device": device})


def rig_of(name: str, **drive_changes: object) -> tuple[CanRig, ForeignDrive]:
    """The rig that an example describes, in front of devices of those objects."""
    wire = Wire(VirtualClock())
    kind = documented(ForeignDrive, DRIVES[name]) if name in DRIVES else ForeignDrive
    drive = kind(wire, Traits())  # type: ignore[call-arg]
    assert isinstance(drive, ForeignDrive)
    place = (0x2C00, 1) if name == "beckhoff-kl5111" else (0x6004, 0)
    size = 6 if name == "beckhoff-kl5111" else 4
    counter = documented(ForeignCounter, COUNTERS[name]) if name in COUNTERS else ForeignCounter
    counter(wire, place=place, size=size, modulus=1 << 8 * size)  # type: ignore[call-arg]
    configuration = example(name)
    if configuration.analog_modules:
        inputs = documented(ForeignInputs, MODULES[name]) if name in MODULES else ForeignInputs
        made = inputs(wire, raw=0x4001)  # type: ignore[call-arg]
        made.od[0x6401, 1] = (0x4001).to_bytes(2, "little")
    cycle_ns = round(1e9 / configuration.rig.sample_rate_hz)
    config = can_rig_config(configuration, shipped_motor(), FOLDER, cycle_ns, ratio=120.0)
    config = replace(config, drive=replace(config.drive, **drive_changes))  # type: ignore[arg-type]
    return CanRig(config, wire.clock, lambda: wire, pump=wire.pump, origin="simulated"), drive


@pytest.mark.parametrize(
    ("name", "raw"),
    [("epos4", 100_000), ("elmo-gold", 13_653), ("sick-ahm36", 100), ("wago-750", 100)],
)
def test_a_device_of_those_objects_is_brought_up_limited_and_turned(name: str, raw: int) -> None:
    port, drive = rig_of(name)
    port.open()
    assert servo(port.nodes).readings.questions == ()
    assert "read back" in limits_check(LIMITS, port.write_limits(LIMITS)).found
    assert port.nodes.drive.unwatched == ()
    block = port.exchange(Command(Mode.SPEED, np.full(5, 100.0 * RPM)), 5, Guard())
    assert block.broken is None
    assert drive.speed == raw
    names = [channel.name for channel in port.channels]
    assert {INPUT_ANGLE, OUTPUT_ANGLE, TARGET_SPEED} <= set(names)
    if name == "wago-750":
        # 0x4001: 5 V, and a status bit that says that it is none.
        assert set(block.counts[:, names.index(TORQUE)]) == {0x4000}
        assert (block.flags & CycleFlag.SATURATED).all()
    port.close()
    assert not drive.is_powered


def test_the_terminal_of_the_example_is_read_at_its_bytes() -> None:
    port, _ = rig_of("beckhoff-kl5111")
    port.open()
    (position,) = [c for c in port.nodes.columns if c.channel.name == OUTPUT_ANGLE]
    field = port.nodes.layout.fields[position.field]
    assert (field.offset, field.data_type.name) == (1, "UNSIGNED16")
    assert position.channel.modulus == 1 << 16
    port.close()


def test_an_epos4_left_to_itself_is_asked_about_its_torque() -> None:
    """Its 0x6076 is in uN m: 228 231 is 0.228 N m, and would be read as 228."""
    port, _ = rig_of("epos4", rated_torque=None)
    port.open()
    (question,) = servo(port.nodes).readings.questions
    assert question.entry == "rated_torque_n_m"
    assert "0.228231 N m" in question.hint
    port.close()
