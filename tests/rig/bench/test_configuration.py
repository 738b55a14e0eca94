"""The description of a rig: what is accepted, what is refused and how it is said, what the drivers are made of it."""

from __future__ import annotations

import re
import tomllib
from importlib import resources
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel

from experiments.finding import Finding
from model.motor import shipped_motor
from model.units import RPM
from rig.bench import limits as lim
from rig.bench.backends.hardware import bus_config, can_rig_config, readout_config
from rig.bench.config.apply import LIMITED, RATED, configured_rig, limits_by_hand
from rig.bench.config.load import (
    inspect_configuration,
    load_configuration,
    missing_files,
    words_of,
)
from rig.bench.config.objects import read_object
from rig.bench.config.schema import Limits, Ratings, RigConfiguration
from rig.errors import ConfigurationError

TEMPLATE = resources.files("rig.bench.config").joinpath("template.toml").read_text(encoding="utf-8")
BY_REFERENCE = (
    resources.files("rig.bench.config.examples")
    .joinpath("paper-sgdv-vref.toml")
    .read_text(encoding="utf-8")
)


def everything(text: str = TEMPLATE) -> str:
    """A description with every optional word in force."""
    return "\n".join(re.sub(r"^# (?=\[|[a-z_0-9]+ = )", "", line) for line in text.splitlines())


def written(folder: Path, text: str) -> Path:
    path = folder / "rig.toml"
    path.write_text(text, encoding="utf-8")
    return path


def problems(folder: Path, text: str) -> tuple[Finding, ...]:
    found = inspect_configuration(written(folder, text))
    assert not isinstance(found, RigConfiguration)
    return found


def replaced(old: str, new: str) -> str:
    assert old in TEMPLATE
    return TEMPLATE.replace(old, new)


def test_the_template_is_a_configuration_as_it_stands_and_with_every_word(tmp_path: Path) -> None:
    plain = load_configuration(written(tmp_path, TEMPLATE))
    assert plain.counters[0].lines * plain.counters[0].multiplication == 72000
    full = load_configuration(written(tmp_path, everything()))
    assert full.readout is not None
    assert full.guard is not None
    assert len(full.analog_modules[0].inputs) == 2


def test_the_template_explains_every_word_there_is() -> None:
    """A word that the template does not show is a word that nobody finds."""

    def tables(model: type[BaseModel]) -> set[type[BaseModel]]:
        found = {model}
        for field in model.model_fields.values():
            for kind in re.findall(r"[\w.]+", str(field.annotation)):
                name = kind.rpartition(".")[2]
                sub = getattr(__import__("rig.bench.config.schema", fromlist=["x"]), name, None)
                if isinstance(sub, type) and issubclass(sub, BaseModel) and sub is not model:
                    found |= tables(sub)
        return found

    # What only an amplifier by analog reference has is shown by the example of one.
    contents = [tomllib.loads(everything()), tomllib.loads(everything(BY_REFERENCE))]
    shown: set[str] = set()

    def collect(value: object) -> None:
        if isinstance(value, dict):
            shown.update(value)
            for entry in value.values():
                collect(entry)
        elif isinstance(value, list):
            for entry in value:
                collect(entry)

    collect(contents)
    words = {word for model in tables(RigConfiguration) for word in words_of(model)}
    assert words - shown == set()


def test_the_sensor_of_the_drives_torque_reaches_the_driver(tmp_path: Path) -> None:
    table = '[drive.torque_calibration]\nsensor = "T-12"\n\n[motor_encoder] '
    found = load_configuration(written(tmp_path, replaced("[motor_encoder] ", table)))
    assert found.drive.settings()["torque_calibration"].sensor == "T-12"


def test_what_stands_behind_a_hash_is_the_default(tmp_path: Path) -> None:
    """Optional words show their default, except where a default cannot be written: a file, a date,
    a node that is asked.
    """
    plain, full = tomllib.loads(TEMPLATE), tomllib.loads(everything())
    without_default = {
        "rated_torque_n_m",
        "velocity_unit_rad_s",
        "acceleration_unit_rad_s2",
        "torque_unit_n_m",
        "torque_limit_unit_n_m",
        "index_position",
        "index_status",
        "operating_parameters",
        "open_level_volts",
        "torque_calibration",
    }
    configuration = load_configuration(written(tmp_path, TEMPLATE)).model_dump(
        mode="json", by_alias=True
    )
    for table in ("rig", "bus", "drive", "real_time"):
        for word, value in full[table].items():
            if word not in plain[table] and word not in without_default:
                assert configuration[table][word] == value, f"{table}.{word}"


@pytest.mark.parametrize(
    ("old", "new", "path", "reason"),
    [
        ("bit_rate = 1000000", "bitrate = 1000000", "bus.bitrate", "Did you mean bit_rate?"),
        ("node_id = 1\n", "node_id = 128\n", "drive.node_id", "less than or equal to 127"),
        ("node_id = 1\n", "node_id = true\n", "drive.node_id", "integer"),
        ("lines = 8192", "lines = 0", "motor_encoder.lines", "greater than or equal to 1"),
        ("lines = 18000", "", "counter[0].lines", "is missing"),
        ("# modulus = 4294967296", "direction = 0 #", "motor_encoder.direction", "-1 or 1"),
        ('# position = "0x6004:0 U32"', 'position = "6004"', "counter[0].position", "0x6004:0 I32"),
        (
            '# position = "0x6004:0 U32"',
            'position = "0x6004:0 U7"',
            "counter[0].position",
            "no type",
        ),
        ("volts_per_rated_torque = 1.0", "", "analog_module[0].input[0]", "volts_per_rated_torque"),
        ("sample_rate_hz = 500.0", 'sample_rate_hz = "500"', "rig.sample_rate_hz", "number"),
        (
            "sample_rate_hz = 500.0",
            "sample_rate_hz = nan",
            "rig.sample_rate_hz",
            "less than or equal to",
        ),
        ('format = "harmonic-rig-1"', 'format = "harmonic-rig-9"', "format", "harmonic-rig-1"),
        ("# computer_lost_ms = 250", "computer_lost_ms = 60", "drive", "twice"),
        ("# abort_connection_option = 3", "abort_connection_option = 0", "drive", "turn on"),
        (
            "# input_speed_rpm = 3500.0",
            "input_speed_rpm = -1.0",
            "limits.input_speed_rpm",
            "greater than 0",
        ),
        (
            "# repeated_peak_torque_n_m = 167.0",
            "repeated_peak_torque_n_m = 167.0",
            "ratings",
            "source",
        ),
        (
            "node_id = 2\n",
            "node_id = 1\n",
            "the whole file",
            "node-ID 1 is given twice: drive and counter output_angle",
        ),
    ],
)
def test_a_wrong_value_is_named_with_path_and_reason(
    tmp_path: Path, old: str, new: str, path: str, reason: str
) -> None:
    found = problems(tmp_path, replaced(old, new))
    assert any(problem.what == path and reason in problem.sentence for problem in found), [
        str(p) for p in found
    ]
    with pytest.raises(ConfigurationError, match=re.escape(path)):
        load_configuration(tmp_path / "rig.toml")


def test_every_problem_is_told_at_once(tmp_path: Path) -> None:
    text = (
        replaced("lines = 8192", "lines = 0")
        .replace("lines = 18000", "lines = -3")
        .replace("bit_rate", "bitrate")
    )
    assert {p.what for p in problems(tmp_path, text)} == {
        "motor_encoder.lines",
        "counter[0].lines",
        "bus.bitrate",
    }


@pytest.mark.parametrize("content", [b"\xff\xfe", b"[rig", b"a = 1\na = 2", b""])
def test_what_is_no_configuration_is_refused_in_words(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "rig.toml"
    path.write_bytes(content)
    with pytest.raises(ConfigurationError, match=r"rig\.toml"):
        load_configuration(path)


def test_a_missing_file_says_how_to_write_one(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="rig config new"):
        load_configuration(tmp_path / "none.toml")


@given(st.text(max_size=30))
def test_any_text_is_an_object_or_a_value_error(text: str) -> None:
    try:
        found = read_object(text)
    except ValueError:
        return
    assert 0 <= found.index <= 0xFFFF
    assert found.data_type.is_number


def test_objects_are_read_long_and_short() -> None:
    assert read_object("0x6004:0 I32") == read_object("0x6004:0 INTEGER32")
    assert read_object("0x6403:2 R32").data_type.is_float


def test_only_the_terminals_of_a_coupler_share_a_node(tmp_path: Path) -> None:
    shared = TEMPLATE.replace("node_id = 3", "node_id = 2")
    assert any("node-ID 2 is given twice" in p.sentence for p in problems(tmp_path, shared))
    terminal = shared.replace(
        '# position = "0x6004:0 U32" ', 'position = "0x2C00:1 U16 at byte 1 of 6" '
    )
    assert terminal != shared
    assert isinstance(inspect_configuration(written(tmp_path, terminal)), RigConfiguration)
    with_drive = terminal.replace("node_id = 2", "node_id = 1", 1)
    assert any("node-ID 1 is given twice" in p.sentence for p in problems(tmp_path, with_drive))


def test_another_torque_limit_needs_its_unit(tmp_path: Path) -> None:
    other = everything().replace('torque_limit = "0x6072:0 U16"', 'torque_limit = "0x3001:2 U32"')
    told = re.sub(r"torque_limit_unit_n_m = .*", "", other)
    assert any("needs torque_limit_unit_n_m" in p.sentence for p in problems(tmp_path, told))
    assert isinstance(inspect_configuration(written(tmp_path, other)), RigConfiguration)


def test_a_guard_that_can_never_be_closed_is_refused(tmp_path: Path) -> None:
    text = everything().replace("closed = 0x00010000", "closed = 0x00020000")
    assert any("never be closed" in p.sentence for p in problems(tmp_path, text))


def test_a_guard_on_a_node_that_is_not_there_is_refused(tmp_path: Path) -> None:
    text = re.sub(r"(\[guard\].*\n)node_id = 1", r"\1node_id = 9", everything())
    assert any("guard.node_id = 9" in p.sentence for p in problems(tmp_path, text))


def test_calibration_dates_have_an_order_and_a_certificate(tmp_path: Path) -> None:
    swapped = everything().replace("due = 2027-03-01", "due = 2025-03-01")
    assert any("before its date" in p.sentence for p in problems(tmp_path, swapped))
    bare = everything().replace('certificate = "none: accuracy from the data sheet"\ndate', "date")
    assert any("without a certificate" in p.sentence for p in problems(tmp_path, bare))


def test_files_that_are_not_there_are_named(tmp_path: Path) -> None:
    text = replaced('gear = "csf-25-120"', 'gear = "mine.toml"').replace(
        '# eds = ""   ', 'eds = "d.eds" # ', 1
    )
    found = load_configuration(written(tmp_path, text))
    assert [p.what for p in missing_files(found, tmp_path)] == ["drive.eds", "rig.gear"]


def test_the_drivers_get_what_the_file_says(tmp_path: Path) -> None:
    path = written(tmp_path, everything())
    configuration = load_configuration(path)
    motor = shipped_motor()
    made = can_rig_config(configuration, motor, tmp_path, 4_000_000)
    assert made.cycle_ns == 4_000_000
    assert made.drive.velocity_unit == pytest.approx(RPM)
    assert made.drive.abort_connection_option == 3
    counter = made.counters[0]
    assert (counter.lines, counter.multiplication, counter.operating_parameters) == (18000, 4, 0)
    assert counter.index_position is not None
    assert counter.index_position.key == (0x2000, 1)
    torque = made.modules[0].inputs[0].as_channel()
    # One volt is 100 % of the rated torque; one count is 0.3125 mV.
    assert torque.scale == pytest.approx(0.3125e-3 * 0.637)
    assert torque.calibration.scale_relative_uncertainty == 0.01
    assert made.motor_encoder.calibration.due == "2027-03-01"
    silent = configuration.model_copy(
        update={
            "counters": [
                c.model_copy(update={"largest_speed": 0.0}) for c in configuration.counters
            ]
        }
    )
    fastest = can_rig_config(silent, motor, tmp_path, 4_000_000, 120.0).counters[0].largest_speed
    assert fastest == pytest.approx(1.5 * motor.maximum_speed / 120.0)
    assert bus_config(configuration).interface == "socketcan"
    readout = readout_config(configuration)
    assert readout is not None
    assert readout.parity == "E"


def test_limits_and_ratings_reach_the_plan_in_si(tmp_path: Path) -> None:
    text = TEMPLATE.replace("# input_speed_rpm = 3500.0", "input_speed_rpm = 600.0").replace(
        '# source = "n', 'source = "n'
    )
    text = text.replace("# repeated_peak_torque_n_m = 167.0", "repeated_peak_torque_n_m = 100.0")
    configured = configured_rig(written(tmp_path, text))
    assert configured.limits == {lim.INPUT_SPEED: pytest.approx(600.0 * RPM)}
    assert configured.gear.ratings.repeated_peak_torque == 100.0
    assert configured.gear.value("ratings.repeated_peak_torque").origin.source == "nameplate"
    limits = lim.derive_limits(configured.gear, configured.motor, configured=configured.limits)
    assert limits.value(lim.INPUT_SPEED) == pytest.approx(600.0 * RPM)
    assert limits.value(lim.TORSION_TORQUE) == pytest.approx(lim.TRIP_SHARE * 100.0)


BEARING = """
[output_bearing]
friction_n_m = 0.48
uncertainty_n_m = 0.04
date = 2026-05-02
source = "spun with a cord"
"""


def test_the_output_bearing_is_told_with_day_and_source(tmp_path: Path) -> None:
    assert configured_rig(written(tmp_path, TEMPLATE)).output_bearing == {}
    bearing = configured_rig(written(tmp_path, TEMPLATE + BEARING)).output_bearing
    assert bearing["source"] == "spun with a cord, 2026-05-02"
    assert (bearing["coulomb"], bearing["coulomb_u"], bearing["viscous"]) == (0.48, 0.04, 0.0)


@pytest.mark.parametrize("line", ["date = 2026-05-02", 'source = "spun with a cord"'])
def test_an_output_bearing_without_day_or_source_is_refused(tmp_path: Path, line: str) -> None:
    with pytest.raises(ConfigurationError, match="output_bearing"):
        configured_rig(written(tmp_path, TEMPLATE + BEARING.replace(line, "")))


def test_ratings_that_contradict_each_other_are_refused(tmp_path: Path) -> None:
    text = TEMPLATE.replace('# source = "n', 'source = "n')
    text = text.replace("# momentary_peak_torque_n_m = 304.0", "momentary_peak_torque_n_m = 1.0")
    with pytest.raises(ConfigurationError, match="momentary_peak_torque"):
        configured_rig(written(tmp_path, text))


def test_every_limit_and_rating_of_the_file_is_used() -> None:
    assert set(LIMITED) == set(Limits.model_fields)
    assert set(RATED) == set(Ratings.model_fields) - {"source"}
    assert {quantity for quantity, _ in LIMITED.values()} == set(lim.UNITS)


# An amplifier by analog reference -------------------------------------------------------------------


def by_reference(old: str = "", new: str = "") -> str:
    assert old in BY_REFERENCE
    return BY_REFERENCE.replace(old, new)


@pytest.mark.parametrize(
    ("old", "new", "path", "reason"),
    [
        (
            "volts_per_count = 0.00030517578125",
            "volts_per_count = 0.0",
            "drive.volts_per_count",
            "greater than 0",
        ),
        ('kind = "analog-reference"', 'kind = "pulse-train"', "drive", "analog-reference"),
        (
            "speed_per_volt_rpm",
            "speed_per_volt",
            "drive.speed_per_volt",
            "Did you mean speed_per_volt_rpm?",
        ),
        ("power = { mask = 0x02 } ", "# ", "drive.lines.power", "is missing"),
        (
            "power = { mask = 0x02 }",
            "power = { bit = 2 }",
            "drive.lines.power.bit",
            "There are: active_high, mask",
        ),
        (
            'set_by = "who set them"',
            'set_by = ""',
            "drive.limits_by_hand.set_by",
            "at least 1 character",
        ),
        ('channel = "input_angle"\n', 'channel = "other"\n', "", "counts nothing itself"),
    ],
)
def test_what_is_wrong_with_a_drive_by_reference_is_named(
    tmp_path: Path, old: str, new: str, path: str, reason: str
) -> None:
    found = problems(tmp_path, by_reference(old, new))
    assert any(path in problem.what and reason in problem.sentence for problem in found), found


def test_limits_set_by_hand_are_limits_of_the_plan_and_words_of_the_confirmation(
    tmp_path: Path,
) -> None:
    path = written(tmp_path, by_reference("torque_n_m = 0.637  ", "torque_n_m = 0.45  "))
    configured = configured_rig(path)
    assert configured.limits[lim.MOTOR_TORQUE] == 0.45
    assert configured.limits[lim.INPUT_SPEED] == pytest.approx(3000.0 * RPM)
    assert limits_by_hand(path) == "0.45 N m 3000 r/min"
    tighter = written(tmp_path, path.read_text() + "[limits]\nmotor_torque_n_m = 0.3\n")
    assert configured_rig(tighter).limits[lim.MOTOR_TORQUE] == 0.3
    assert limits_by_hand(written(tmp_path, TEMPLATE)) == ""
    assert limits_by_hand(None) == ""


def test_a_coupler_that_holds_the_amplifier_may_hold_other_inputs(tmp_path: Path) -> None:
    path = written(
        tmp_path, by_reference("[[analog_module]]\nnode_id = 3", "[[analog_module]]\nnode_id = 1")
    )
    assert load_configuration(path).analog_modules[0].node_id == 1
    twice = problems(tmp_path, by_reference("node_id = 4", "node_id = 2"))
    assert any("given twice" in problem.sentence for problem in twice)
