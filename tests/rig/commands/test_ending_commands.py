"""How the process of a run can be ended from outside: signals, a closed terminal, kill."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from experiments.recording import Recording
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig import exits
from rig.bench.backends.order import Order
from rig.errors import RunFileError
from rig.main import app
from rig.run.latch import CUT_OFF, HISTORY_NAME, LatchedTripError, TripLatch
from rig.run.marker import PREFIX
from rig.run.ordering import order_of
from rig.run.start import run_order
from rig.runfile.read import close_recording, open_run
from rig.runfile.recover import recover_run
from rig.trial.doctor.surroundings import bench_lines
from rig.window.prepare.latch import trip_in_words
from rig.window.prepare.request import RigChoice, latch_checks
from tests.rig.paced import DEADLINE, LONG, PacedProcess, paced_process

fcntl = pytest.importorskip("fcntl", reason="terminals of POSIX")
pty = pytest.importorskip("pty", reason="terminals of POSIX")
termios = pytest.importorskip("termios", reason="terminals of POSIX")
pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals and terminals of POSIX")


@contextmanager
def moving_run(folder: Path, *arguments: str, **options: Any) -> Iterator[PacedProcess]:
    """A long run that has begun to turn its rig."""
    with paced_process([*LONG, "--output", str(folder), *arguments], **options) as paced:
        paced.until("moving")
        assert len(list(folder.glob(f"{PREFIX}*"))) == 1, "no rig turns without a marker"
        yield paced


def quick_request(folder: Path) -> Order:
    return Order(
        protocol="starting-torque",
        gear=shipped_gear(),
        motor=shipped_motor(),
        folder=folder,
        values={"positions": 2, "zero_time": 0.5},
    )


def ended(paced: PacedProcess) -> int:
    """The exit code of a run that was asked to end, with its pipes read to their end."""
    paced.process.communicate(timeout=DEADLINE)
    return paced.process.returncode


@contextmanager
def sealed_run(folder: Path) -> Iterator[Recording]:
    """The one run of a folder, sealed; nothing else is left there."""
    (path,) = folder.glob("*.h5")
    assert not list(folder.glob("*.part"))
    assert not list(folder.glob(f"{PREFIX}*"))
    assert TripLatch(folder).read() is None
    recording = open_run(path, verify=True)
    yield recording
    close_recording(recording)


def assert_stopped_by_a_ramp(folder: Path) -> None:
    with sealed_run(folder) as recording:
        assert recording.metadata.outcome == "ABORTED"
        codes = [event.code for event in recording.events]
        assert codes.count("STOP") == 1
        assert "ABORT" not in codes
        assert any("controlled stop: standstill verified" in e.text for e in recording.events)


def test_ctrl_c_in_motion_is_a_stop_and_the_file_is_sealed(tmp_path: Path) -> None:
    with moving_run(tmp_path, "--json") as paced:
        paced.process.send_signal(signal.SIGINT)
        out, err = paced.process.communicate(timeout=DEADLINE)
        assert paced.process.returncode == exits.ABORTED, err
        report = json.loads(out)
        assert report["make_safe"]["action"] == "controlled stop"
        assert report["make_safe"]["safe"]
        assert "STOP: controlled ramp" in err
    assert_stopped_by_a_ramp(tmp_path)


def test_a_terminal_closed_in_motion_costs_neither_ramp_nor_file(tmp_path: Path) -> None:
    def take_terminal() -> None:
        fcntl.ioctl(0, termios.TIOCSCTTY, 0)

    ours, theirs = pty.openpty()
    terminal: dict[str, Any] = dict.fromkeys(("stdin", "stdout", "stderr"), theirs)
    with moving_run(tmp_path, start_new_session=True, begin=take_terminal, **terminal) as paced:
        os.close(theirs)
        # Something is drawn by then, and there is more to be drawn.
        assert os.read(ours, 1)
        os.close(ours)
        assert ended(paced) == exits.ABORTED
    assert_stopped_by_a_ramp(tmp_path)


def test_readers_that_have_gone_cost_neither_ramp_nor_file(tmp_path: Path) -> None:
    with moving_run(tmp_path, "--events") as paced:
        assert paced.process.stdout is not None
        assert paced.process.stderr is not None
        paced.process.stdout.close()
        paced.process.stderr.close()
        paced.process.send_signal(signal.SIGQUIT)
        assert paced.process.wait(DEADLINE) == exits.ABORTED
        paced.process.stdout = paced.process.stderr = None
    assert_stopped_by_a_ramp(tmp_path)


def test_a_signal_that_was_to_be_ignored_stays_ignored(tmp_path: Path) -> None:
    # What `nohup` and a job in the background ignore; a termination request stops the run all the same.
    unheard = (signal.SIGHUP, signal.SIGINT, signal.SIGQUIT)

    def ignore() -> None:
        for number in unheard:
            signal.signal(number, signal.SIG_IGN)

    with moving_run(tmp_path, "--json", begin=ignore) as paced:
        for number in unheard:
            paced.process.send_signal(number)
        paced.process.send_signal(signal.SIGTERM)
        out, errors = paced.process.communicate(timeout=DEADLINE)
        assert json.loads(out)["outcome"] == "ABORTED"
        assert (
            f"SIGINT is ignored in this process (started in the background): stop it by `kill {paced.process.pid}`"
            in errors
        )
    assert_stopped_by_a_ramp(tmp_path)


def test_a_run_killed_in_motion_latches_the_folder_until_somebody_acknowledges(
    tmp_path: Path,
) -> None:
    with moving_run(tmp_path, "--gear", "SN-1") as paced:
        paced.until("flushed")
        (part,) = tmp_path.glob("*.part")
        live = TripLatch(tmp_path)
        live.refuse()
        assert live.read() is None, "a run beside a running one is no trip"
        with pytest.raises(RunFileError, match="still being written"):
            recover_run(part)
        paced.process.kill()
        paced.process.communicate()
        number = paced.process.pid
    trip = TripLatch(tmp_path).read()
    assert trip is not None
    assert (trip.cause, trip.run) == (CUT_OFF, "00001-warm_up-SN_1")
    assert (trip.part, trip.standstill_verified) == (str(part), False)
    assert f"process {number} (warm-up)" in trip.message
    assert "it was killed" in trip.message
    run = ["run", "starting-torque", "--output", str(tmp_path)]
    refused = CliRunner().invoke(app, run)
    assert isinstance(refused.exception, LatchedTripError)
    assert "NOT verified" in str(refused.exception)
    (line,) = latch_checks(RigChoice("sim", tmp_path))
    assert (line.severity, line.what) == ("blocks", "trip latch")
    assert "was cut off" in trip_in_words(trip)
    (latched,) = [
        f for f in bench_lines(order_of("home", {}, {"folder": tmp_path})) if f.what == "latch"
    ]
    assert latched.severity == "blocks"
    acknowledged = CliRunner().invoke(
        app, ["acknowledge", "--operator", "Ada", "--output", str(tmp_path)]
    )
    assert acknowledged.exit_code == 0
    assert f"rig recover {part}" in acknowledged.output.replace("\n", " ")
    assert trip.run in (tmp_path / HISTORY_NAME).read_text()
    assert TripLatch(tmp_path).read() is None
    assert recover_run(part).rows > 0
    assert run_order(quick_request(tmp_path)).outcome == "COMPLETED"


def test_three_runs_at_once_in_one_folder_do_not_refuse_each_other(tmp_path: Path) -> None:
    def marked() -> int:
        return len(list(tmp_path.glob(f"{PREFIX}*")))

    command = ["--times=3", *LONG, "--output", str(tmp_path), "--json"]
    with paced_process(command, start_new_session=True) as paced:
        paced.until("moving", times=3)
        assert marked() == 3
        os.killpg(paced.process.pid, signal.SIGTERM)
        assert ended(paced) == exits.ABORTED
    assert marked() == 0
    assert len(list(tmp_path.glob("*.h5"))) == 3
