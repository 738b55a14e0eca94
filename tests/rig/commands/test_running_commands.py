"""`rig plan` and `rig run` as people type them: flags, help, refusals, JSON, exit codes."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any, cast

import pytest
import typer

from experiments import catalogue
from experiments.parameters import parameter_fields
from experiments.recording import Event
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig import exits
from rig.bench.backends.order import MOUNTINGS, Order, WorldChoice
from rig.bench.backends.registry import BACKENDS, make_port
from rig.commands.progress import progress_line
from rig.commands.running import read_flags, read_protocol
from rig.errors import ConfigurationError
from rig.main import app
from rig.main import run as main
from rig.run.parts import Progress
from rig.run.progress import in_words
from rig.run.start import plan_order, run_order

FAST = ("--zero-time", "0.5", "--positions", "2")


def rig(*arguments: str) -> int:
    with pytest.raises(SystemExit) as end:
        main([*arguments])
    return int(end.value.code or 0)


def test_flags_come_from_the_parameter_model() -> None:
    fields = parameter_fields(catalogue.load("friction").parameters)
    given = [
        "--lowest-rpm",
        "5",
        "--highest-rpm=100",
        "--no-up-and-down",
        "--speeds-rpm",
        "10",
        "20",
        "30",
        "--points",
        "4",
    ]
    values = read_flags("friction", fields, given)
    assert values == {
        "lowest_rpm": "5",
        "highest_rpm": "100",
        "up_and_down": False,
        "speeds_rpm": "10 20 30",
        "points": "4",
    }
    assert read_flags("friction", fields, ["--up-and-down"]) == {"up_and_down": True}
    assert read_flags("friction", fields, ["--up-and-down", "no", "--points", "2"]) == {
        "up_and_down": "no",
        "points": "2",
    }
    assert read_flags("friction", fields, ["--lowest-rpm", "-5"]) == {"lowest_rpm": "-5"}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "Name the protocol first"),
        (["--lowest-rpm", "3", "friction"], "Name the protocol first"),
        (["fricton"], "Did you mean friction"),
        (["motion"], "no such protocol"),
        (["friction", "--lowest-rmp", "3"], "Did you mean --lowest-rpm"),
        (["friction", "7"], "a value without a flag"),
        (["friction", "--points"], "needs a value"),
        (["friction", "--points", "3", "--points", "4"], "given twice"),
    ],
)
def test_what_cannot_be_understood_is_a_usage_error(arguments: list[str], words: str) -> None:
    with pytest.raises(typer.BadParameter, match=words):
        read_protocol(arguments)


def test_a_plan_says_of_which_speeds_u_is_of_use(capsys: pytest.CaptureFixture[str]) -> None:
    assert rig("plan", "friction", "--points", "3") == exits.DONE
    assert "U of running torque 500, 1000, 2000, 3500 r/min <= 10 mN m" in capsys.readouterr().out


def test_a_plan_in_json_is_one_object(capsys: pytest.CaptureFixture[str]) -> None:
    assert rig("plan", "velocity-steps", "--json", "--repeats", "1") == exits.DONE
    printed = capsys.readouterr()
    plan = json.loads(printed.out)
    assert printed.err == ""
    assert plan["protocol"] == "velocity-steps"
    assert plan["parameters"]["repeats"] == 1
    assert plan["duration"]["nominal"] < plan["duration"]["longest"]
    assert {margin["quantity"] for margin in plan["margins"]} >= {
        "input_speed",
        "motor_torque",
        "torsion_torque",
    }
    assert plan["limits"]["motor_torque"]["tier"] == "rig"


def test_a_plan_as_a_table(capsys: pytest.CaptureFixture[str]) -> None:
    assert rig("plan", "home") == exits.DONE
    printed = capsys.readouterr().out
    for words in ("duration", "samples", "Margins", "input", "motor", "torsion"):
        assert words in printed


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("plan", "friction", "--highest-rpm", "5700"), "5700"),
        (("plan", "friction", "--acceleration", "15000"), "would break the limit on acceleration"),
        (("plan", "friction", "--points", "many"), "whole number"),
        (("plan", "friction", "--points", "0"), "out of range"),
        (("plan", "no-such"), "no such protocol"),
        (("plan", "friction", "--mounting", "upside-down"), "no such mounting"),
        (("run", "home", "--backend", "dream"), "no such rig"),
        (("plan", "home", "--parameters", "missing.toml"), "cannot be read"),
        (
            ("run", "home", "--mount", "0"),
            "--world mount: names no simulated world; value 0, allowed 1",
        ),
        (("run", "home", "--gear-seed", "-1"), "--world gear-seed"),
        (("run", "home", "--number", "0"), "--world number"),
        (("run", "home", "--population", "huge"), "allowed narrow, wide"),
        (("run", "home", "--mount-turn", "nan"), "--world mount-turn-deg: is no angle"),
        (("run", "home", "--backend", "replay:none.h5", "--day", "2"), "only a simulated rig"),
    ],
)
def test_refusals_have_one_screen_and_exit_code_2(
    arguments: tuple[str, ...], words: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    extra = ("--output", str(tmp_path)) if arguments[0] == "run" else ()
    assert rig(*arguments, *extra) == exits.USAGE
    printed = capsys.readouterr()
    assert words in " ".join((printed.err + printed.out).replace("│", " ").split())
    assert "Traceback" not in printed.err
    assert list(tmp_path.iterdir()) == []


def test_help_shows_the_flags_of_a_protocol(capsys: pytest.CaptureFixture[str]) -> None:
    assert rig("run", "friction", "--help") == exits.DONE
    printed = capsys.readouterr().out
    assert "--lowest-rpm" in printed
    assert "r/min" in printed
    assert "--operator" in printed
    assert rig("run", "--help") == exits.DONE
    printed = capsys.readouterr().out
    for name in catalogue.names():
        assert name in printed


def test_a_run_on_the_simulated_rig(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    arguments = (
        "run",
        "starting-torque",
        *FAST,
        "--gear",
        "G7",
        "--operator",
        "Ada",
        "--output",
        str(tmp_path),
        "--seed",
        "4",
    )
    assert rig(*arguments, "--json") == exits.DONE
    printed = capsys.readouterr()
    report = json.loads(printed.out)
    # In the background it says how it is stopped as well.
    assert printed.err.startswith(
        "warning: G7 has no card: what is planned rests on the parameter set CSF-25-120-2UH.\n"
    )
    assert report["outcome"] == "COMPLETED"
    assert report["verdict"] == "NOT JUDGED"
    (because,) = report["because"]
    assert "no acceptance file is named for this gear" in because
    assert report["analysis_error"] == ""
    assert (report["analysis"]["kind"], report["analysis"]["number"]) == ("starting-torque", 1)
    assert report["values"]
    assert report["next"] == [f"rig report --gear G7 --runs {Path(report['path']).parent}"]
    assert report["make_safe"]["safe"]
    assert report["trip"] is None
    assert Path(report["path"]).is_file()
    assert 0.0 < report["margins"]["motor_torque"]["margin"] < 1.0
    assert rig(*arguments) == exits.DONE
    assert "standstill verified by" in capsys.readouterr().out


def test_a_run_says_its_world_and_is_made_again(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    from rig.runfile.read import close_recording, open_run

    def counts(path: str) -> bytes:
        recording = open_run(path)
        kept = b"".join(recording.stored(name).tobytes() for name in recording.signals)
        close_recording(recording)
        return kept

    world = ("--gear-seed", "3", "--bench-seed", "4", "--mount", "2", "--mount-turn", "90")
    world = (*world, "--hours", "500", "--day-correlation", "0.3")
    made = ("run", "starting-torque", *FAST, *world, "--day", "6", "--json", "--output")
    assert rig(*made, str(tmp_path)) == exits.DONE
    first = json.loads(capsys.readouterr().out)
    again = ("run", "--repeat", "1", "--output", str(tmp_path))
    for contradiction in (("--seed", "0"), ("--gear", "G2"), ("--day", "6"), ("friction",)):
        assert rig(*again, *contradiction) == exits.USAGE
        printed = " ".join(capsys.readouterr().err.replace("│", " ").split())
        assert f"{contradiction[0]}: the run that is repeated says this" in printed
    assert rig(*again, "--operator", "Ada", "--json") == exits.DONE
    second = json.loads(capsys.readouterr().out)
    assert counts(second["path"]) == counts(first["path"])
    assert rig("show", second["path"]) == exits.DONE
    shown = " ".join(capsys.readouterr().out.split())
    expected = (
        "gear 3 after 500 h, bench 4, mounting 2 turned by 90 deg, day 6 (days correlated by 0.3), "
        "number 1, narrow population;"
    )
    assert f"{expected} starts as warm as the room; repeats {first['run']}" in shown
    assert rig("show", second["path"], "--json") == exits.DONE
    told = json.loads(capsys.readouterr().out)["process"]
    assert (told["world"]["gear_seed"], told["world"]["day"], told["bench"]) == (3, 6, "4")


def test_one_seed_is_one_laboratory(tmp_path: Path) -> None:
    request = Order(
        protocol="starting-torque",
        gear=shipped_gear(),
        motor=shipped_motor(),
        folder=tmp_path,
        values={"positions": 2, "zero_time": 0.5},
        serial="G1",
        seed=5,
    )

    def counts(**changes: object) -> bytes:
        from dataclasses import replace

        from rig.runfile.read import close_recording, open_run

        report = run_order(replace(request, **changes))  # type: ignore[arg-type]
        assert report.outcome == "COMPLETED", report.message
        recording = open_run(report.path)
        kept = recording.stored("output_angle").tobytes() + recording.stored("torque").tobytes()
        close_recording(recording)
        return kept

    first = counts(world=WorldChoice(number=1))
    assert counts(world=WorldChoice(number=1, start_state="ambient")) == first
    again = {"number": 1, "start_state": "ambient"}
    assert counts(world=WorldChoice(**again), block_cycles=77) == first
    # The next number in the folder is another run of the same gear on the same bench.
    assert counts() != first
    assert counts(world=WorldChoice(**again, bench_seed=5)) == first
    for changes in ({"seed": 6}, {"serial": "G2"}):
        assert counts(world=WorldChoice(**again), **changes) != first


def test_what_the_rig_knows_is_not_asked_for_twice() -> None:
    gear, motor = shipped_gear(), shipped_motor()
    request = Order(
        protocol="kinematic-error",
        gear=gear,
        motor=motor,
        folder=Path(),
        values={},
        mounting="flexspline-fixed",
        sample_rate=500.0,
    )
    planned = plan_order(request)
    assert planned.parameters.mounting == "flexspline-fixed"
    assert planned.parameters.sync_rate == 500.0
    assert planned.load.ratio == 121.0


def test_an_unknown_rig_lists_those_there_are() -> None:
    with pytest.raises(ConfigurationError, match="no such rig") as refused:
        make_port(Order(protocol="", backend="another"))
    assert "sim" in refused.value.limit
    assert "sim" in BACKENDS


@pytest.mark.parametrize(
    ("seconds", "words"), [(47.6, "48 s"), (725.0, "12 min 05 s"), (9000.0, "2 h 30 min")]
)
def test_durations_are_told_as_people_say_them(seconds: float, words: str) -> None:
    assert in_words(seconds) == words


def test_the_progress_line_needs_a_terminal(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    now = Progress(
        step=3, steps=9, what="hold 30 r/min", elapsed=4.0, left=60.0, speed=3.14, events=0
    )
    bad = Event(0, "warning", "x", "test", "beware [of] brackets")
    with progress_line("friction G1", 64.0) as (on_progress, on_event):
        on_progress(now)
        on_event(bad)
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    with progress_line("friction G1", 64.0) as (on_progress, on_event):
        on_progress(now)
        on_event(bad)
    assert "warning: beware [of] brackets" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["plan", "run", "campaign", "doctor"])
def test_whoever_asks_for_a_card_takes_the_word_that_there_is_none(name: str) -> None:
    command = cast(Any, typer.main.get_command(app)).commands[name]
    assert {"--gear", "--no-card"} <= {flag for one in command.params for flag in one.opts}


def test_the_card_of_a_gear_tells_a_run_its_mounting_and_its_conditions(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from rig.commands.ordering import order_of
    from rig.gears.card import now_text, save_card, with_changes

    values = {"serial": "SN-7", "mounting": "flexspline-fixed", "lubricant": "SK-1A"}
    save_card(tmp_path, with_changes(None, values, "A. Example", now_text()))
    request = order_of("friction", {}, {"folder": tmp_path, "serial": "SN-7"})
    assert request.mounting == "flexspline-fixed"
    assert request.conditions["lubricant"] == "SK-1A"
    assert "never been confirmed" in capsys.readouterr().err
    with pytest.raises(ConfigurationError, match="rig gear set"):
        order_of("friction", {}, {"folder": tmp_path, "serial": "SN-7", "mounting": MOUNTINGS[0]})
    # A mistyped serial number is not another gear.
    with pytest.raises(ConfigurationError, match=r"no card.*SN-8.*Did you mean SN-7"):
        order_of("friction", {}, {"folder": tmp_path, "serial": "SN-8"})
    with pytest.raises(ConfigurationError, match="a path"):
        order_of("friction", {}, {"folder": tmp_path, "serial": "../SN-7"}, no_card=True)
    other = order_of("friction", {}, {"folder": tmp_path, "serial": "SN-8"}, no_card=True)
    assert other.mounting == MOUNTINGS[0]
