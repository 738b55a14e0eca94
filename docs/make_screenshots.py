"""Pictures of the window for the documentation, made by driving it without a screen.

    python docs/make_screenshots.py                    # every state that a page shows, into docs/screenshots
    python docs/make_screenshots.py run-finished       # one of them
    python docs/make_screenshots.py --theme dark --scale 2 --size 1366x768 --output /tmp/pictures

A state is a function in `STATES`: it is given a `Stage` with an open window, brings the window into
the state, and returns. Every picture is of a simulated rig and says so.
"""

from __future__ import annotations

import argparse
import atexit
import functools
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import picture_sources

if TYPE_CHECKING:
    from PySide6.QtWidgets import QApplication

    from rig.window.main import MainWindow

HERE = Path(__file__).resolve().parent
SIZES = ("1366x768", "1920x1080")
KEPT_SIZE = SIZES[:1]
"""Size of the pictures that the documentation keeps."""
LONGEST = 120.0
"""s that a state may take."""
COLOURS = 256
"""Colours of a picture: a window has few, and the files stay small."""
SHORT_CAMPAIGN = """format = "campaign-1"
name = "short"
title = "Short inspection"

[[protocol]]
name = "motor-tare"
values = { points = 12, measure_time = 1.0 }

[[protocol]]
name = "home"

[[protocol]]
name = "starting-torque"
values = { positions = 4 }

[[protocol]]
name = "friction"
values = { points = 12, measure_time = 0.5, lowest_rpm = 10.0 }
"""
SHORT_FRICTION = ("--points", "12", "--measure-time", "0.5", "--lowest-rpm", "10")


@dataclass
class Stage:
    """A window over a folder of its own."""

    application: QApplication
    window: MainWindow
    folder: Path

    def settle(self, seconds: float = 0.3) -> None:
        """Let the window work for a while."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.application.processEvents()
            time.sleep(0.005)

    def wait(self, until: Callable[[], Any]) -> None:
        """Let the window work until something holds."""
        end = time.monotonic() + LONGEST
        while not until():
            if time.monotonic() > end:
                raise TimeoutError("the window did not come into the state")
            self.application.processEvents()
            time.sleep(0.005)

    def start(self, protocol: str, *flags: str) -> None:
        """Start a run on the simulated rig, as the Prepare page would."""
        from experiments import catalogue
        from experiments.parameters import parameter_fields
        from model.gear_file import shipped_gear
        from model.motor import shipped_motor
        from rig.bench.backends.order import Order
        from rig.commands.running import read_flags
        from rig.present.preview.plan import preview_plan
        from rig.run.start import plan_order
        from rig.window.work.prepared import PreparedRun

        values = read_flags(protocol, parameter_fields(catalogue.load(protocol).parameters), flags)
        request = Order(
            protocol=protocol,
            gear=shipped_gear(),
            motor=shipped_motor(),
            folder=self.folder,
            values=values,
            serial="SN-0815",
            operator="A. Example",
        )
        planned = plan_order(request)
        arguments = [
            "run",
            protocol,
            "--backend",
            "sim",
            "--gear",
            "SN-0815",
            "--operator",
            "A. Example",
        ]
        arguments += ["--runs", str(self.folder), *flags, "--events", "--stdin-control"]
        self.window.start(PreparedRun(request, planned, arguments, preview_plan(planned)))

    def finish(self) -> None:
        """Wait for the end of the run and for its results."""
        from rig.window.run.outcome_view import READING

        run = self.window.run
        self.wait(lambda: run.state.ended)
        self.wait(
            lambda: not run.outcome.results.isVisible() or run.outcome.results.text() != READING
        )
        self.settle()


def prepare_empty(stage: Stage) -> None:
    """The Prepare page of a new folder: no gear is known."""
    _prepared(stage, "kinematic-error", gear=False)


def prepare_new_gear(stage: Stage) -> None:
    """A new gear from its part number: what the makers' tables have of it, and what is only assumed."""
    stage.window.show_page("prepare")
    page = stage.window.prepare
    page.operator.setText("A. Example")
    page.gear.show_new(True)
    form = page.gear.new
    form.product.editor.setText("SHG-32-100-2UH")
    form.serial.editor.setText("SN-0816")
    form.look_up()
    popup = form.product.editor.completer().popup()
    if popup is not None:
        popup.hide()
    stage.wait(lambda: not page.is_stale)
    page.scroll_to(form.make_button)


def prepare_refused(stage: Stage) -> None:
    """A parameter that its model refuses, marked at its field."""
    _prepared(stage, "friction")
    page = stage.window.prepare
    row = page.protocol.form.rows["highest_rpm"]
    row.set_value("20000")
    stage.wait(lambda: not page.is_stale)
    page.scroll_to(page.protocol.form.rows["measure_time"].note)


def prepare_predicted(stage: Stage) -> None:
    """Velocity steps: predicted torque with its band, and the limit that it touches."""
    _prepared(stage, "velocity-steps")


def prepare_output(stage: Stage) -> None:
    """What the model expects of the output."""
    _prepared(stage, "friction")
    stage.window.prepare.plots.setCurrentIndex(1)


def prepare_margins(stage: Stage) -> None:
    """The margins to every limit, with the uncertainty of the prediction."""
    _prepared(stage, "friction")
    stage.window.prepare.plots.setCurrentIndex(3)


def prepare_ready(stage: Stage) -> None:
    """The rig was asked, everything is signed: the run may be started."""
    _prepared(stage, "friction")
    page = stage.window.prepare
    page.ask_the_rig()
    stage.wait(lambda: page.doctor_checks)
    page.checklist.tick_all()


def prepare_campaign(stage: Stage) -> None:
    """The acceptance campaign: all its runs walked, everything signed."""
    _prepared(stage, "campaign:acceptance")
    stage.window.prepare.checklist.tick_all()


def _campaign(stage: Stage) -> None:
    """A short campaign, started as the Prepare page does it."""
    plan = stage.folder / "short.toml"
    plan.write_text(SHORT_CAMPAIGN, encoding="utf-8")
    page = stage.window.prepare
    page.protocol._choose_plan = lambda: plan
    _prepared(stage, "campaign of a plan file …")
    page.checklist.tick_all()
    page.start()
    run = stage.window.run
    stage.wait(lambda: run.prompt.is_armed and run.prompt.give.isEnabled())
    run.prompt.give.click()


def run_campaign(stage: Stage) -> None:
    """A campaign in the middle: runs that are done, the one that is under way, those to come."""
    _campaign(stage)
    run = stage.window.run
    stage.wait(lambda: run.stages.rows[3].standing == "under way" and run.bar.value() > 400)
    stage.settle()


def run_campaign_finished(stage: Stage) -> None:
    """The end of a campaign: verdict with its reasons, and the certificate."""
    _campaign(stage)
    stage.wait(lambda: stage.window.run.state.ended)
    stage.settle()


def _prepared(stage: Stage, protocol: str, gear: bool = True) -> None:
    """The Prepare page with operator, gear card and protocol."""
    page = stage.window.prepare
    stage.window.show_page("prepare")
    if gear:
        page.operator.setText("A. Example")
        told = {
            "serial": "SN-0815",
            "part": "csf-25-120",
            "mounting": "circular-spline-fixed",
            "lubricant": "Harmonic Grease SK-1A",
            "hours": "12",
            "hours_counted": "log book",
            "load_inertia_kg_m2": "0.1",
            "load_inertia_uncertainty_kg_m2": "0.002",
            "output_radial_runout_um": "8",
            "output_axial_runout_um": "5",
            "acceptance": "demonstration",
        }
        for name, text in told.items():
            page.gear.form.rows[name].set_value(text)
        page.gear.confirm()
    page.protocol.choose(protocol)
    stage.wait(lambda: not page.is_stale)


def run_idle(stage: Stage) -> None:
    """The Run page before anything was started."""
    stage.window.show_page("run")


def run_armed(stage: Stage) -> None:
    """A run that looks whether the rig is fit."""
    stage.start("friction")


def run_running(stage: Stage) -> None:
    """A friction run in the middle, with a note."""
    stage.start("friction")
    run = stage.window.run
    stage.wait(lambda: run.bar.maximum() > 0 and run.bar.value() > 450 and run.plots.rows_read)
    run.process.note("grease seen at the output seal")
    stage.wait(lambda: any("grease" in text for text in run.events.texts) or run.state.ended)
    stage.settle(0.1)


def run_closing(stage: Stage) -> None:
    """The question when somebody closes the window in the middle of a run."""
    stage.start("friction")
    run = stage.window.run
    stage.wait(lambda: run.plots.rows_read)
    stage.window.close()
    stage.wait(run.close_question.isVisible)
    stage.settle(0.2)


def run_stopped(stage: Stage) -> None:
    """After a STOP."""
    stage.start("friction")
    run = stage.window.run
    stage.wait(lambda: run.plots.rows_read and run.bar.value() > 200)
    run.stop()
    stage.finish()


def run_finished(stage: Stage) -> None:
    """A friction run with its verdict and results."""
    stage.start("friction")
    stage.finish()


def run_kinematic_error(stage: Stage) -> None:
    """Kinematic error, built up revolution by revolution."""
    stage.start("kinematic-error")
    stage.finish()


def run_velocity_steps(stage: Stage) -> None:
    """The latest step over its prediction, with the residual."""
    stage.start("velocity-steps", "--repeats", "1")
    stage.finish()


def run_tripped(stage: Stage) -> None:
    """A drive that runs away on a simulated rig: the supervisor trips."""
    _play(stage, "trip", str(stage.folder))


def run_question(stage: Stage) -> None:
    """A question of the run to the operator."""
    _play(stage, "ask", end=False)
    stage.wait(lambda: stage.window.run.prompt.isVisible())


def run_lost(stage: Stage) -> None:
    """The acquisition was killed."""
    stage.start("friction")
    run = stage.window.run
    stage.wait(lambda: run.plots.rows_read and run.bar.value() > 100)
    os.kill(run.process.pid, 9)
    stage.wait(lambda: run.state.ended)
    stage.settle()


def review_results(stage: Stage) -> None:
    """A run with its results: interval, verdict and catalogue value beside each number."""
    runs = _reviewed(stage)
    stage.window.show_review(runs[3])
    header = stage.window.review.details.header
    stage.wait(lambda: header.verdict.text())


def review_figures(stage: Stage) -> None:
    """The figures of a run."""
    review_results(stage)
    details = stage.window.review.details
    details.tabs.setCurrentWidget(details.figures)
    stage.wait(lambda: details.gallery.plots)


def review_signals(stage: Stage) -> None:
    """The recorded channels over time, with segments and events, and two cursors with what lies between them."""
    review_results(stage)
    details = stage.window.review.details
    details.tabs.setCurrentWidget(details.signals)
    signals = details.signals
    torque = signals.curves["torque"].item
    stage.wait(lambda: torque.getOriginalDataset()[0] is not None)
    signals.cursors.switch.click()
    stage.wait(lambda: signals.cursors.table.rowCount() and not signals.is_busy)


def review_conditions(stage: Stage) -> None:
    """Conditions and calibration of a run."""
    review_results(stage)
    details = stage.window.review.details
    details.tabs.setCurrentWidget(details.conditions)
    stage.wait(lambda: "Calibration" in details.conditions.toPlainText())


def review_overlay(stage: Stage) -> None:
    """The friction of three runs over each other."""
    runs = _reviewed(stage)
    page = stage.window.review
    page.library.select(*runs[1:])
    page.show_overlay(runs[1:])
    stage.wait(lambda: len(page.overlay.overlaid) == len(runs[1:]))


def review_difference(stage: Stage) -> None:
    """What differs between two runs, with the significance of each difference."""
    runs = _reviewed(stage)
    page = stage.window.review
    page.library.select(*runs[1:3])
    page.show_difference(*runs[1:3])
    stage.wait(lambda: page.difference.difference)


def review_models(stage: Stage) -> None:
    """The ladder of friction judged by three runs."""
    runs = _reviewed(stage)
    page = stage.window.review
    page.library.select(*runs[1:])
    page.show_models(runs[1:])
    stage.wait(lambda: page.models.validation)


def review_passport(stage: Stage) -> None:
    """A gear over time."""
    _reviewed(stage)
    page = stage.window.review
    page.show_passport("SN-0815")
    stage.wait(lambda: page.passport.passport and not page.passport.is_busy)


def review_recording(stage: Stage) -> None:
    """A recording of another rig: its columns with their pictures, and what stays open."""
    stage.window.show_page("review")
    page = stage.window.review
    page.show_recording([HERE.parent / "tests" / "data" / "tiago_arm" / "arm_1.csv"])
    stage.wait(lambda: page.recording.proposal is not None)
    page.recording.columns.selectRow(2)
    stage.settle()


def fleet_lot(stage: Stage) -> None:
    """A lot of sixty gears on two benches."""
    sys.path.insert(0, str(HERE.parent))
    from tests.extras.lots import write_lot

    write_lot(stage.folder / "fleet-results")
    stage.window.show_page("fleet")
    stage.wait(lambda: stage.window.fleet.lot is not None)


def _reviewed(stage: Stage) -> list[Path]:
    """The Review page over a motor tare and three friction runs of a gear, all fitted."""
    shutil.copytree(_some_runs(), stage.folder, dirs_exist_ok=True)
    stage.window.show_page("review")
    page = stage.window.review
    stage.wait(lambda: len(page.library.model.runs) == 4)
    stage.wait(lambda: not page.library.desk.is_running)
    return sorted(stage.folder.glob("*.h5"))


@functools.cache
def _some_runs() -> Path:
    """A folder of runs, made once for all pictures and deleted when the program ends."""
    from experiments import catalogue
    from experiments.parameters import parameter_fields
    from model.gear_file import shipped_gear
    from model.motor import shipped_motor
    from rig.analysis.fit.recorded import store
    from rig.analysis.fit.run import Choices, fit_run
    from rig.bench.backends.order import Order
    from rig.commands.running import read_flags
    from rig.gears.card import save_card, with_changes
    from rig.run.start import run_order

    folder = Path(tempfile.mkdtemp())
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    tare: Path | None = None
    for protocol in ("motor-tare", "friction", "friction", "friction"):
        flags = SHORT_FRICTION if protocol == "friction" else ()
        values = read_flags(protocol, parameter_fields(catalogue.load(protocol).parameters), flags)
        serial = "" if protocol == "motor-tare" else "SN-0815"
        run_order(
            Order(
                protocol=protocol,
                gear=shipped_gear(),
                motor=shipped_motor(),
                folder=folder,
                values=values,
                serial=serial,
                operator="A. Example",
            )
        )
        path = max(folder.glob("*.h5"))
        store(fit_run(path, choices=Choices(tare=tare)), "2026-01-01T12:00:00+00:00")
        tare = tare or path
    facts = {"serial": "SN-0815", "acceptance": "demonstration"}
    save_card(folder, with_changes(None, facts, "A. Example", "2026-01-01T12:00:00+00:00"))
    return folder


def _play(stage: Stage, kind: str, *arguments: str, end: bool = True) -> None:
    """Be the parent of a run that the tests play."""
    from rig.window.work.child import RunProcess

    run = stage.window.run
    script = HERE.parent / "tests" / "rig" / "window" / "children.py"
    run._start_process = lambda _: RunProcess(
        [kind, *arguments], program=(sys.executable, str(script))
    )
    run._title = "Friction, gear SN-0815, A. Example"
    run._begin(run._start_process([]), None, None)
    stage.window.show_page("run")
    if end:
        stage.finish()


STATES: dict[str, Callable[[Stage], None]] = {
    "prepare-empty": prepare_empty,
    "prepare-new-gear": prepare_new_gear,
    "prepare-refused": prepare_refused,
    "prepare-predicted": prepare_predicted,
    "prepare-output": prepare_output,
    "prepare-margins": prepare_margins,
    "prepare-ready": prepare_ready,
    "prepare-campaign": prepare_campaign,
    "run-campaign": run_campaign,
    "run-campaign-finished": run_campaign_finished,
    "run-idle": run_idle,
    "run-armed": run_armed,
    "run-running": run_running,
    "run-question": run_question,
    "run-closing": run_closing,
    "run-stopped": run_stopped,
    "run-finished": run_finished,
    "run-kinematic-error": run_kinematic_error,
    "run-velocity-steps": run_velocity_steps,
    "run-tripped": run_tripped,
    "run-lost": run_lost,
    "review-results": review_results,
    "review-figures": review_figures,
    "review-signals": review_signals,
    "review-conditions": review_conditions,
    "review-overlay": review_overlay,
    "review-difference": review_difference,
    "review-models": review_models,
    "review-passport": review_passport,
    "review-recording": review_recording,
    "fleet-lot": fleet_lot,
}
"""Every state that is shown, by the name of its picture."""


def picture(
    application: QApplication, name: str, size: tuple[int, int], theme: str, target: Path
) -> None:
    """Bring a fresh window into a state and keep what it shows."""
    import pyqtgraph as pg

    from rig.window.main import MainWindow
    from rig.window.shell.session import WindowSession
    from rig.window.shell.theme import apply_theme

    pg.setConfigOptions(antialias=True)
    apply_theme(application, theme)
    with tempfile.TemporaryDirectory() as place:
        # The name of the folder is shown: it is the same in every picture.
        folder = Path(place) / "runs"
        folder.mkdir()
        before = Path.cwd()
        os.chdir(place)
        try:
            window = MainWindow(WindowSession(Path("runs"), theme=theme))
            window.resize(*size)
            window.show()
            stage = Stage(application, window, Path("runs"))
            STATES[name](stage)
            stage.settle()
            _grab(window, target)
            process = window.run.process
            if process is not None and process.is_running:
                process.let_go()
                stage.wait(lambda: not process.is_running)
            window.run.state = type(window.run.state)()
            window.close()
            window.deleteLater()
            stage.settle(0.05)
        finally:
            os.chdir(before)


def _grab(window: MainWindow, target: Path) -> None:
    """The window in few colours."""
    from PySide6.QtGui import QImage

    target.parent.mkdir(parents=True, exist_ok=True)
    window.grab().toImage().convertToFormat(QImage.Format.Format_RGB32).save(str(target))
    _shrink(target)


def _shrink(target: Path) -> None:
    """A palette instead of full colours, where the imaging library is there (it comes with matplotlib)."""
    try:
        from PIL import Image
    except ImportError:
        return
    with Image.open(target) as full:
        small = full.quantize(COLOURS, method=Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    small.save(target, optimize=True)


def states_of_pages() -> list[str]:
    """The states whose pictures stand in a page of the documentation."""
    pages = "".join(page.read_text(encoding="utf-8") for page in HERE.rglob("*.md"))
    return [name for name in STATES if f"screenshots/{name}-{KEPT_SIZE[0]}.png" in pages]


def main() -> int:
    """Make the pictures that were asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "states", nargs="*", help=f"which: {', '.join(STATES)} (default: those of pages)"
    )
    parser.add_argument(
        "--size",
        action="append",
        metavar="WIDTHxHEIGHT",
        help=f"of the window, such as {SIZES[1]} (default: that of the documentation)",
    )
    parser.add_argument("--theme", choices=("light", "dark"), default="light")
    parser.add_argument("--scale", default="1", help="pixels per logical pixel")
    parser.add_argument("--output", type=Path, default=HERE / "screenshots")
    chosen = parser.parse_args()
    unknown = set(chosen.states) - set(STATES)
    if unknown:
        parser.error(f"no such state: {', '.join(sorted(unknown))}; there are {', '.join(STATES)}")
    os.environ["QT_QPA_PLATFORM"] = "offscreen"
    os.environ["QT_SCALE_FACTOR"] = chosen.scale
    from PySide6.QtWidgets import QApplication

    from rig.window.shell.collector import collector_in_this_thread

    application = QApplication([])
    with collector_in_this_thread():
        for name in chosen.states or states_of_pages():
            for size in chosen.size or KEPT_SIZE:
                width, height = map(int, size.split("x"))
                end = "" if chosen.theme == "light" else f"-{chosen.theme}"
                target = chosen.output.resolve() / f"{name}-{size}{end}.png"
                picture(application, name, (width, height), chosen.theme, target)
                print(f"{target}  {target.stat().st_size // 1024} kB")
    if chosen.output == HERE / "screenshots" and not (chosen.states or chosen.size):
        picture_sources.keep()
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
