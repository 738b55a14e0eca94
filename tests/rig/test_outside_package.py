"""A package outside the product brings a protocol, a fit, a source and an importer, and each is found everywhere."""

from __future__ import annotations

import contextlib
import io
import json
import sys
from collections.abc import Iterator
from pathlib import Path

import h5py
import pytest

import rig.main
from drivers.clock import VirtualClock
from drivers.source import Source
from experiments import catalogue, extensions
from rig.analysis.passport.build import passport
from rig.bench.backends.sources import Shafts, extensions_of, sources_of
from rig.bench.config.load import load_configuration
from rig.errors import ConfigurationError
from rig.program import files_sha256
from rig.run.start import run_order
from rig.testing.protocol import check_protocol
from rig.testing.source import check_source
from tests import outside_package
from tests.outside_package import found_in, installed_into
from tests.rig.bench.test_hardware import RATE, armed_request, planned_drill
from tests.rig.served_rig import served_rig


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return installed_into(tmp_path_factory.mktemp("site"))


@pytest.fixture(autouse=True)
def _there(site: Path) -> Iterator[None]:
    with found_in(site):
        yield


def said(*words: str) -> tuple[int, str, str]:
    """What a command ends with, and what it prints."""
    out, errors = io.StringIO(), io.StringIO()
    code: object = 0
    with (
        pytest.MonkeyPatch.context() as patch,
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(errors),
    ):
        patch.setenv("COLUMNS", "160")
        try:
            rig.main.run(list(words))
        except SystemExit as ended:
            code = ended.code
    return int(str(code or 0)), out.getvalue(), errors.getvalue()


def told(*words: str) -> str:
    """What a command that must succeed prints."""
    code, out, errors = said(*words)
    assert code == 0, f"{words}: {out}{errors}"
    return out


@pytest.fixture(scope="module")
def turned(site: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of the package's protocol on the simulated rig, analysed as it ended."""
    folder = tmp_path_factory.mktemp("runs")
    with found_in(site):
        told("run", "torque-noise", "--duration", "1", "--gear", "A1", "--output", str(folder))
    (run,) = folder.glob("*.h5")
    return run


def test_its_names_are_listed_without_importing_it() -> None:
    assert catalogue.names()[-1] == "torque-noise"
    assert catalogue.kinds()[-2:] == ("torque-noise", "torque-drift")
    assert catalogue.entry("torque-noise").summary == (
        "What our laboratory adds to the rig (lab-noise 1.2)"
    )
    assert outside_package.IMPORTS not in sys.modules


def test_a_run_that_does_not_use_it_imports_nothing_of_it(tmp_path: Path) -> None:
    told("run", "home", "--gear", "A1", "--output", str(tmp_path))
    assert outside_package.IMPORTS not in sys.modules
    (run,) = tmp_path.glob("*.h5")
    with h5py.File(run) as file:
        assert "extensions" not in json.loads(file["entry/process/details"][()])


def test_the_run_file_and_the_analysis_say_whose_it_is(turned: Path, site: Path) -> None:
    whose = {
        "group": "protocols",
        "name": "torque-noise",
        "package": "lab-noise",
        "version": "1.2",
        "sha256": files_sha256(site, ("lab_noise",)),
    }
    with h5py.File(turned) as file:
        assert json.loads(file["entry/process/details"][()])["extensions"] == [whose]
    (analysis,) = turned.with_suffix(".analysis").glob("0*.json")
    assert json.loads(analysis.read_text(encoding="utf-8"))["extensions"] == [whose]
    assert "lab-noise" in told("show", str(turned))


def test_plan_help_fit_and_report_know_it(turned: Path, tmp_path: Path) -> None:
    assert "torque-noise" in told("run", "--help")
    assert "--duration" in told("plan", "torque-noise", "--help")
    found = json.loads(told("fit", str(turned), "--json"))["parameters"]["noise"]
    assert 0.0 < found["low"] < found["value"] < found["high"] < 0.01
    drift = json.loads(told("fit", "torque-drift", str(turned), "--json"))["parameters"]["drift"]
    assert drift["low"] < drift["value"] < drift["high"]
    page = tmp_path / "noise.html"
    told("report", str(turned), "--output", str(page))
    assert "noise of the torque port" in page.read_text(encoding="utf-8").lower()
    (series,) = passport(turned.parent, "A1").series
    assert series.title == "Noise of the torque port"


def test_a_certificate_names_it_and_its_manifest_holds_its_hash(
    turned: Path, site: Path, tmp_path: Path
) -> None:
    page = tmp_path / "A1.html"
    told("certificate", "--gear", "A1", "--runs", str(turned.parent), "--output", str(page))
    sentence = "By another package: torque-noise of lab-noise 1.2 (protocol, files "
    assert sentence in page.read_text(encoding="utf-8")
    manifest = (tmp_path / "A1.manifest.txt").read_text(encoding="utf-8")
    assert files_sha256(site, ("lab_noise",)) in manifest
    assert "made by different programs" not in told("verify", str(page))


def test_a_recording_says_whether_it_is_good_for_its_fit(tmp_path: Path) -> None:
    log = tmp_path / "old.lab"
    rows = "".join(f"{k * 0.001:.3f}|{0.05 + 1e-5 * (k % 7):.6f}\n" for k in range(400))
    log.write_text(f"#LAB time [s]|load [N m]\n{rows}", encoding="utf-8")
    channels = ("-c", "time=time", "-c", "torque=load")
    look = json.loads(told("import", "lab-log", str(log), *channels, "--check", "--json"))
    assert look["good_for"]["torque-drift"] == {"ok": True, "why": ""}
    told("import", "lab-log", str(log), *channels, "--output", str(tmp_path))
    (run,) = tmp_path.glob("*.h5")
    with h5py.File(run) as file:
        (whose,) = json.loads(file["entry/process/details"][()])["extensions"]
    assert (whose["group"], whose["name"]) == ("importers", "lab-log")
    log.write_text("no log\n", encoding="utf-8")
    code, _, errors = said("import", "lab-log", str(log), *channels, "--output", str(tmp_path))
    assert code == 6
    assert "does not begin with #LAB" in errors


def test_a_campaign_and_a_gears_limits_take_it(tmp_path: Path) -> None:
    plan = tmp_path / "noise.toml"
    plan.write_text(
        'format = "campaign-1"\nname = "noise"\n\n[[protocol]]\nname = "torque-noise"\n',
        encoding="utf-8",
    )
    listed = json.loads(
        told("campaign", "--plan", str(plan), "--gear", "A1", "--dry-run", "--json")
    )
    assert "torque-noise" in json.dumps(listed)


class Line:
    """A serial line that holds what the thermometer has written."""

    def __init__(self, *pieces: bytes) -> None:
        self.pieces = list(pieces)

    def read(self, size: int) -> bytes:
        return self.pieces.pop(0) if self.pieces else b""

    def close(self) -> None:
        self.pieces.clear()


def thermometer(clock: VirtualClock) -> Source:
    from lab_noise.thermometer import Thermometer

    return Thermometer(clock, lambda: Line(b"21.", b"50\nx\n", b"22.00\n"))


def test_what_it_brings_passes_the_checks_that_ours_pass() -> None:
    check_protocol(catalogue.load("torque-noise"))
    check_protocol(catalogue.load("torque-drift"))
    check_source(thermometer)


EXAMPLES = Path(rig.main.__file__).parent / "bench" / "config" / "examples"
DESCRIBED = '\n[[source]]\nkind = "lab-thermometer"\nurl = "loop://"\n'


def described(folder: Path, added: str) -> Path:
    """A description of a rig with this in it."""
    text = (EXAMPLES / "epos4.toml").read_text(encoding="utf-8")
    path = folder / "rig.toml"
    path.write_text(text + added, encoding="utf-8")
    return path


def test_a_description_names_its_source(tmp_path: Path) -> None:
    configuration = load_configuration(described(tmp_path, DESCRIBED))
    (source,) = sources_of(configuration, Shafts(600.0, 5.0), VirtualClock())
    assert [channel.name for channel in source.channels] == [
        "ambient_temperature",
        "ambient_temperature_taken",
    ]
    assert [one.package for one in extensions_of(configuration)] == ["lab-noise"]


@pytest.mark.realtime
def test_a_run_over_the_hub_reads_its_source_and_says_whose_it_is(tmp_path: Path) -> None:
    with served_rig(RATE) as served:
        config = served.configuration(tmp_path)
        config.write_text(config.read_text("utf-8") + DESCRIBED, "utf-8")
        report = run_order(armed_request(tmp_path, config), planned_drill(), confirmation="SN-1")
    assert report.safe, report.message
    with h5py.File(report.path) as file:
        assert "ambient_temperature" in file["entry/data"]
        (whose,) = json.loads(file["entry/process/details"][()])["extensions"]
    assert (whose["group"], whose["package"]) == ("sources", "lab-noise")


def test_what_a_description_says_wrongly_of_it_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"source\[0\].*baud.*[Ee]xtra"):
        load_configuration(described(tmp_path, DESCRIBED + "baud = 9600\n"))
    wrong = DESCRIBED.replace("lab-thermometer", "lab-barometer")
    with pytest.raises(
        ConfigurationError, match=r"no source is called 'lab-barometer'.*lab-thermometer"
    ):
        load_configuration(described(tmp_path, wrong))


PROJECT = """
[project]
name = "{name}"
version = "0.1"
description = "another one"
[project.entry-points."harmonic_rig.{group}"]
{point}
"""


def another(folder: Path, name: str, point: str, group: str = "protocols") -> Path:
    """Another package beside the one that is there."""
    return installed_into(folder, project=PROJECT.format(name=name, point=point, group=group))


@pytest.mark.parametrize(
    ("point", "why"),
    [
        ("broken = 'lab_noise.nowhere:EXPERIMENT'", "cannot be imported (ModuleNotFoundError"),
        ("broken = 'lab_noise.protocol:NAME'", "is a str, which is no Experiment"),
        ("broken = 'lab_noise.protocol:EXPERIMENT'", "calls itself 'torque-noise'"),
        ("torque-drift = 'lab_noise.drift:EXPERIMENT'", "has the name of another"),
        ("friction = 'lab_noise.protocol:EXPERIMENT'", "has the name of one that is there"),
    ],
)
def test_what_is_broken_is_named_and_left_out(tmp_path: Path, point: str, why: str) -> None:
    with found_in(another(tmp_path, "other-lab", point)):
        assert [one.name for one in catalogue.every()][:3] == list(catalogue.names()[:3])
        because = {
            whose.name: reason
            for whose, reason in extensions.left_out()
            if whose.package == "other-lab"
        }
        (name,) = because
        assert why in because[name]
        assert catalogue.load("friction").title != "Torque noise"
        if name != "friction":
            code, _, errors = said("plan", name)
            assert code == 2
            assert "other-lab" in errors
        code, _, errors = said("run", "--help")
        assert "other-lab" in errors


def test_a_fit_among_the_protocols_is_refused(tmp_path: Path) -> None:
    site = another(tmp_path, "other-lab", "torque-fall = 'lab_noise.fall:EXPERIMENT'")
    code = (site / "lab_noise" / "drift.py").read_text(encoding="utf-8")
    fall = code.replace('"torque-drift"', '"torque-fall"')
    (site / "lab_noise" / "fall.py").write_text(fall, encoding="utf-8")
    with found_in(site):
        list(catalogue.every())
        (reason,) = (reason for one, reason in extensions.left_out() if one.package == "other-lab")
        assert "belongs into the group harmonic_rig.fits" in reason
