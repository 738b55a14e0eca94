"""One master per bench, on a hub as on hardware; a kill in motion latches the bench, wherever the runs go."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from typer.testing import CliRunner

from model.gear_file import shipped_gear
from model.motor import shipped_motor
from model.units import RPM
from rig import exits
from rig.bench.backends.order import Order
from rig.bench.backends.registry import HARDWARE
from rig.bench.held import HeldFile
from rig.bench.identity import Bench, bench_of
from rig.errors import BenchInUseError, RigError
from rig.main import app
from rig.run.bench_lock import LOCK_NAME, bench_lock
from rig.run.latch import CUT_OFF, LatchedTripError, latch_of
from rig.run.start import run_order
from tests.rig.served_rig import served_rig
from tests.rig.slow_computer import says_too_slow

RATE = 100.0
ROOT = Path(__file__).parents[3]


def bench_in(folder: Path) -> Bench:
    return Bench(id="bench-1", state=folder, scope="named", option="--config rig.toml")


def test_a_bench_is_let_go_at_the_end_of_the_block_however_it_ends(tmp_path: Path) -> None:
    bench = bench_in(tmp_path)
    with pytest.raises(ZeroDivisionError), bench_lock(bench, "rig run home"):
        raise ZeroDivisionError
    with (
        bench_lock(bench, "rig run friction"),
        pytest.raises(BenchInUseError) as caught,
        bench_lock(bench, "rig doctor"),
    ):
        raise AssertionError("two masters")
    assert f"process {os.getpid()}, rig run friction since 2" in str(caught.value.value)
    assert caught.value.where == "bench bench-1"
    assert exits.explain(caught.value) == (exits.BUSY, f"This bench is in use: {caught.value}")
    with bench_lock(bench, "rig doctor"):
        pass


def test_a_simulation_in_this_process_takes_no_lock(tmp_path: Path) -> None:
    bench = bench_of("sim", tmp_path)
    with bench_lock(bench, "one"), bench_lock(bench, "another"):
        assert not list(tmp_path.iterdir())


def test_a_bench_that_cannot_be_locked_is_refused(tmp_path: Path) -> None:
    (tmp_path / LOCK_NAME).mkdir()
    with pytest.raises(RigError, match="cannot be locked"), bench_lock(bench_in(tmp_path), "x"):
        raise AssertionError("without a lock")


def test_what_a_dead_holder_wrote_keeps_nobody_out(tmp_path: Path) -> None:
    held = HeldFile.hold(tmp_path / LOCK_NAME)
    assert held is not None
    held.write({"process": 1, "purpose": "rig run home", "time": "long ago"})
    held.close()
    with bench_lock(bench_in(tmp_path), "rig run friction"):
        assert "friction" in (tmp_path / LOCK_NAME).read_text()


class TooSlowError(Exception):
    """The run has ended by itself, because this computer could not keep its cycles."""


@contextmanager
def turning_run(description: Path, folder: Path) -> Iterator[subprocess.Popen[str]]:
    """A run over the hub, in a process of its own, that has begun to turn the rig."""
    command = [sys.executable, "-m", "rig", "run", "warm-up", "--at-most", "3600", "--events"]
    command += ["--tolerance", "1e-9", "--window", "60", "--zero-time", "0.5"]
    command += ["--backend", HARDWARE, "--config", str(description), "--output", str(folder)]
    command += ["--operator", "A. Example", "--gear", "SN-1", "--confirm", "SN-1"]
    command += ["--sample-rate", f"{RATE:g}"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT) as process:
        # A test that waits in vain ends all the same: with the process, its lines end.
        alarm = threading.Timer(180.0, process.kill)
        alarm.start()
        try:
            assert process.stdout is not None
            lines = []
            for line in process.stdout:
                lines.append(line)
                told = json.loads(line)
                if told["kind"] == "progress" and abs(told["speed"]) > 10.0 * RPM:
                    break
            else:
                assert says_too_slow("".join(lines)), "the rig never turned"
                raise TooSlowError
            yield process
        finally:
            alarm.cancel()
            process.kill()


@pytest.mark.realtime
def test_a_hub_has_one_master_and_remembers_the_one_that_was_killed(tmp_path: Path) -> None:
    with served_rig(RATE) as served:
        description = served.configuration(tmp_path)
        request = Order(
            protocol="home",
            gear=shipped_gear(),
            motor=shipped_motor(),
            folder=tmp_path / "another",
            backend=HARDWARE,
            operator="A. Example",
            serial="SN-1",
            sample_rate=RATE,
            config=description,
        )
        try:
            with turning_run(description, tmp_path / "runs") as process:
                with pytest.raises(BenchInUseError) as busy:
                    run_order(request, confirmation="SN-1")
                holder = str(busy.value.value)
                assert f"process {process.pid}, rig run warm-up" in holder
                assert holder.endswith("run 00001-warm_up-SN_1")
                words = ["doctor", "--backend", HARDWARE, "--config", str(description), "--no-move"]
                looked = CliRunner().invoke(app, words)
                assert isinstance(looked.exception, BenchInUseError)
                process.kill()
                process.communicate()
        except TooSlowError:
            return
        latch = latch_of(bench_of(HARDWARE, request.folder, description))
        trip = latch.read()
        assert trip is not None
        assert (trip.cause, trip.run) == (CUT_OFF, "00001-warm_up-SN_1")
        with pytest.raises(LatchedTripError, match="NOT verified"):
            run_order(request, confirmation="SN-1")
        assert not request.folder.exists()
        words = ["acknowledge", "--operator", "Ada", "--config", str(description), "--json"]
        acknowledged = CliRunner().invoke(app, words)
        assert json.loads(acknowledged.stdout)["acknowledged"]["part"] == trip.part
        assert Path(trip.part).is_file()
        latch.refuse()
