"""The file of an encoder's certificate, and a rig that names one: senses, signs, numbers, days, refusals."""

from __future__ import annotations

from datetime import date
from pathlib import Path

import numpy as np
import pytest

from drivers.channel import encoder_channel
from model.angle_certificate import AngleCertificate
from model.motor import shipped_motor
from model.units import ARCSEC, DEGREE
from rig.bench.backends.hardware import can_rig_config
from rig.bench.config.certificate_file import certificate_text, read_certificate
from rig.bench.config.load import inspect_configuration, load_configuration
from rig.bench.config.schema import RigConfiguration
from rig.run.preflight import channel_checks
from tests.rig.bench.test_configuration import TEMPLATE, written

HEADER = """# format = "harmonic-rig-certificate-1"
# certificate = "D-K-15134 2026-03"
# date = 2026-03-01
# due = 2026-09-01
# coverage_factor = 2.0
# zero = "index mark"
# sense = "counting up"
# error = "shown minus true"
angle [deg],error [arcsec],expanded uncertainty [arcsec]
"""
ANGLES = np.arange(0.0, 360.0, 10.0)
ERRORS = 3.0 * np.cos(np.radians(ANGLES)) + np.sin(2.0 * np.radians(ANGLES))
POINTS = "".join(f"{a:g},{e:.9f},0.4\n" for a, e in zip(ANGLES, ERRORS, strict=True))
ACCURACY = (
    "accuracy = 2.4e-5                    # rad: 5 arcsec, half the width of its whole curve\n"
)
WITH_CURVE = TEMPLATE.replace(
    'certificate = "none: accuracy from the data sheet"\n' + ACCURACY, ACCURACY
).replace(ACCURACY, ACCURACY + 'curve = "output.csv"\n')


def stored(folder: Path, text: str = HEADER + POINTS) -> Path:
    path = folder / "output.csv"
    path.write_text(text, encoding="utf-8")
    return path


def curve_of(folder: Path, text: str) -> AngleCertificate:
    stored(folder, text)
    return read_certificate(folder, "output.csv").curve


def at(curve: AngleCertificate, degrees: float) -> float:
    return float(curve.error_at(np.array([degrees * DEGREE]))[0])


def expected(degrees: float) -> float:
    angle = degrees * DEGREE
    return ARCSEC * float(3.0 * np.cos(angle) + np.sin(2.0 * angle) - 3.0)


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    first = read_certificate(tmp_path, stored(tmp_path).name)
    again = curve_of(tmp_path, certificate_text(first.header, first.curve))
    np.testing.assert_allclose(again.angles, first.curve.angles, rtol=0, atol=1e-12)
    np.testing.assert_allclose(again.errors, first.curve.errors, rtol=0, atol=1e-6 * ARCSEC)
    np.testing.assert_allclose(
        again.expanded_uncertainties, first.curve.expanded_uncertainties, rtol=1e-8
    )
    assert at(again, 37.0) == pytest.approx(expected(37.0), abs=1e-6 * ARCSEC)


def test_units_stand_in_the_names_of_the_columns(tmp_path: Path) -> None:
    names = HEADER.replace("angle [deg],error [arcsec],expanded uncertainty [arcsec]", "")
    rows = "".join(
        f"{a * DEGREE:.15g},{e * ARCSEC * 1e6:.12g},{0.4 * ARCSEC:.12g}\n"
        for a, e in zip(ANGLES, ERRORS, strict=True)
    )
    text = f"{names.strip()}\nangle [rad],error [urad],expanded uncertainty [rad]\n{rows}"
    curve = curve_of(tmp_path, text)
    assert at(curve, 200.0) == pytest.approx(expected(200.0), abs=1e-5 * ARCSEC)
    assert curve.standard_uncertainty == pytest.approx(0.2 * ARCSEC, rel=1e-4)


@pytest.mark.parametrize(
    ("old", "new", "sense", "sign"),
    [
        ("shown minus true", "true minus shown", 1.0, -1.0),
        ("counting up", "counting down", -1.0, -1.0),
    ],
)
def test_sense_and_sign_are_those_of_the_counts(
    tmp_path: Path, old: str, new: str, sense: float, sign: float
) -> None:
    """An encoder that shows too much while counting down shows too little while counting up."""
    curve = curve_of(tmp_path, HEADER.replace(old, new) + POINTS)
    for degrees in (25.0, 130.0, 300.0):
        assert at(curve, degrees) == pytest.approx(
            sign * expected(sense * degrees), abs=1e-6 * ARCSEC
        )


def header_with(old: str, new: str) -> bytes:
    assert old in HEADER
    return (HEADER.replace(old, new) + POINTS).encode()


def points_with(old: str, new: str) -> bytes:
    assert old in POINTS
    return (HEADER + POINTS.replace(old, new, 1)).encode()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "header: format: field required"),
        (b"\xff\xfe\x00angle", "not text in UTF-8 at byte 0"),
        (header_with("# date", "# when"), "when = .*extra inputs are not permitted"),
        (header_with('"harmonic-rig-certificate-1"', '"mine"'), "format = 'mine'"),
        (header_with("# date = 2026-03-01\n", ""), "date: field required"),
        (header_with("2026-03-01", "2026-13-01"), 'the lines behind "#" are not TOML'),
        (header_with('# sense = "counting up"\n', ""), "sense: field required"),
        (header_with('"counting up"', '"clockwise"'), "sense = 'clockwise'"),
        (header_with('"index mark"', '"housing"'), "zero = 'housing'"),
        (header_with("= 2.0", "= 20.0"), "coverage_factor = 20.0"),
        (HEADER.encode(), "line 9: there is no table of points"),
        (header_with("angle [deg]", "angle"), "line 9: 'angle' is not angle .unit."),
        (header_with("[arcsec],exp", "[um],exp"), "line 9: 'error .um.' is not error"),
        (header_with("angle [deg],", ""), "line 9: 2 columns; expected"),
        (points_with("10,", "ten,"), "line 11, angle: 'ten' is not a number"),
        (points_with("20,", "nan,"), "line 12, angle: 'nan' is not a number"),
        (points_with(",0.4\n", ",0.4,1\n"), "line 10: 4 values; expected 3"),
        (points_with("20,", "5,"), "point 3 .*5 deg after 10 deg"),
        (points_with("350,", "3500,"), "point 36 .*3500 deg"),
        (points_with(",0.4\n", ",0\n"), "point 1 .*uncertainty is not positive"),
        (
            (HEADER + "".join(POINTS.splitlines(True)[::3])).encode(),
            r"after point \d+ .*30 deg, allowed 21.18",
        ),
    ],
)
def test_what_is_no_certificate_is_named_with_file_place_and_value(
    tmp_path: Path, content: bytes, words: str
) -> None:
    (tmp_path / "output.csv").write_bytes(content)
    with pytest.raises(ValueError, match=words) as caught:
        read_certificate(tmp_path, "output.csv")
    assert "output.csv" in str(caught.value)


def test_the_channel_gets_curve_number_and_days_of_the_certificate(tmp_path: Path) -> None:
    stored(tmp_path)
    configuration = load_configuration(written(tmp_path, WITH_CURVE))
    config = can_rig_config(configuration, shipped_motor(), tmp_path, 2_000_000)
    calibration = config.counters[0].calibration
    assert calibration.curve is not None
    assert at(calibration.curve, 40.0) == pytest.approx(expected(40.0), abs=1e-6 * ARCSEC)
    assert calibration.certificate == "D-K-15134 2026-03"
    assert (calibration.date, calibration.due) == ("2026-03-01", "2026-09-01")
    assert config.motor_encoder.calibration.curve is None
    shown = configuration.model_dump(mode="json", by_alias=True)
    assert shown["counter"][0]["calibration"]["curve"] == "output.csv"
    assert shown["motor_encoder"]["calibration"]["curve"] == ""


def test_an_expired_certificate_is_a_warning_before_the_run(tmp_path: Path) -> None:
    """As with any calibration that is overdue: the run goes on, and every page says so."""
    stored(tmp_path)
    configuration = load_configuration(written(tmp_path, WITH_CURVE))
    counter = can_rig_config(configuration, shipped_motor(), tmp_path, 2_000_000).counters[0]
    channels = [
        encoder_channel(name, lines=18000, multiplication=4, calibration=counter.calibration)
        for name in ("input_angle", "output_angle")
    ]
    for today, result in ((date(2026, 9, 1), "passed"), (date(2026, 9, 2), "warns")):
        found = [c for c in channel_checks(channels, (), today) if c.what == "calibration"]
        assert {c.severity for c in found} == {result}
        assert "output_angle" in found[1].found


@pytest.mark.parametrize(
    ("old", "new", "path", "words"),
    [
        ('"output.csv"', '"other.csv"', "counter[0].calibration.curve", "cannot be read"),
        (
            'curve = "output.csv"',
            'curve = "output.csv"\ndate = 2026-03-02',
            "counter[0].calibration",
            "date = 2026-03-02 stands here and 2026-03-01 in output.csv",
        ),
        (
            'certificate = "none: scale from the amplifier\'s manual"',
            'curve = "output.csv"',
            "analog_module[0].input[0]",
            "an encoder's, not that of an analogue input",
        ),
    ],
)
def test_a_rig_that_names_a_certificate_wrongly_is_refused(
    tmp_path: Path, old: str, new: str, path: str, words: str
) -> None:
    stored(tmp_path)
    assert old in WITH_CURVE
    found = inspect_configuration(written(tmp_path, WITH_CURVE.replace(old, new)))
    assert not isinstance(found, RigConfiguration)
    assert found[0].what == path
    assert words in found[0].sentence


def test_a_learnt_curve_belongs_beside_the_runs_and_not_into_the_description(
    tmp_path: Path,
) -> None:
    learnt = HEADER.replace("angle [deg]", '# learnt = "population mean"\nangle [deg]')
    stored(tmp_path, learnt + POINTS)
    found = inspect_configuration(written(tmp_path, WITH_CURVE))
    assert not isinstance(found, RigConfiguration)
    assert "belongs beside their runs" in found[0].sentence


def test_the_certificate_of_another_encoder_is_refused(tmp_path: Path) -> None:
    stored(tmp_path, '# serial_number = "123 456"\n' + HEADER + POINTS)
    found = inspect_configuration(written(tmp_path, WITH_CURVE))
    assert not isinstance(found, RigConfiguration)
    assert "is of serial number '123 456', the encoder's is ''" in found[0].sentence
    own = WITH_CURVE.replace(
        'model = "RON 285"\nserial_number = ""', 'model = "RON 285"\nserial_number = "123 456"'
    )
    assert isinstance(inspect_configuration(written(tmp_path, own)), RigConfiguration)
