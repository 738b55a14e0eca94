"""One order: what is said as options, keywords and words of a world is the same order, and consent is none of it."""

from __future__ import annotations

import dataclasses
import inspect
import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

import rig
from model.gear_file import save_gear, shipped_gear
from rig.bench.backends.order import (
    WORDS,
    WORLD_WORDS,
    Order,
    Setup,
    WorldChoice,
    arguments_of,
    world_of,
    world_said,
)
from rig.commands.ordering import Said, with_order
from rig.errors import ConfigurationError
from rig.run.ordering import order_of
from rig.run.parts import SessionParts
from rig.run.start import run_order
from rig.runfile.read import close_recording, open_run

CONSENT = re.compile(
    r"confirm|acknowledg|consent|answer|arm(ed|ing)|\bask|guard|sign|Ask|Guard|Prompt"
)
TYPED = "I-HAVE-LOOKED-AT-THE-RIG"
OPTIONS = tuple(name for name, words in WORDS.items() if words.option)


def heard(*arguments: str, world: tuple[str, ...] = tuple(WORLD_WORDS)) -> tuple[Any, str]:
    """What a command that takes every option hears of these arguments, and what is told on standard error."""
    heard: list[Mapping[str, Any]] = []

    @with_order(*OPTIONS, world=world)
    def command(said: Said) -> None:
        heard.append(said)

    app = typer.Typer()
    app.command()(command)
    result = CliRunner().invoke(app, list(arguments))
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    assert result.exit_code == 0, result.output
    return heard[0], result.stderr


def test_no_field_of_an_order_is_named_or_typed_as_consent() -> None:
    for kind in (Order, WorldChoice, Setup):
        for f in dataclasses.fields(kind):
            assert not CONSENT.search(f"{f.name} {f.type}"), f"{kind.__name__}.{f.name}"
    assert CONSENT.search("confirmation str")
    assert not {f.name for f in dataclasses.fields(Order)} & {
        f.name for f in dataclasses.fields(SessionParts)
    }


@pytest.mark.parametrize("name", ["confirmation", "confirm", "acknowledged", "ask", "guard"])
def test_consent_cannot_be_put_into_an_order(name: str) -> None:
    order: Any = Order(protocol="home")
    with pytest.raises(TypeError, match=name):
        Order(protocol="home", **{name: TYPED})
    with pytest.raises(TypeError, match=name):
        dataclasses.replace(order, **{name: TYPED})
    with pytest.raises(TypeError, match=name):
        order_of("home", {}, {name: TYPED})
    with pytest.raises(ConfigurationError, match="no such word"):
        world_of({name: TYPED})
    with pytest.raises((AttributeError, TypeError)):
        setattr(order, name, TYPED)
    with pytest.raises(AttributeError):
        object.__setattr__(order, name, TYPED)


def test_what_was_typed_and_answered_stands_in_no_file(tmp_path: Path) -> None:
    values = {"positions": 2, "zero_time": 0.5}
    order = Order(protocol="starting-torque", values=values, folder=tmp_path, serial="SN-1")
    report = run_order(order, confirmation=TYPED)
    assert report.outcome == "COMPLETED"
    assert TYPED not in repr(order)
    recording = open_run(report.path)
    told = f"{recording.metadata} {recording.events}"
    close_recording(recording)
    assert "SN-1" in told
    assert TYPED not in told
    kept = [path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()]
    assert kept
    assert not any(TYPED.encode() in content for content in kept)


def test_an_order_that_is_said_as_options_is_the_same_order(tmp_path: Path) -> None:
    gear = shipped_gear().with_values({"inertia.output": 0.08})
    file = tmp_path / "gear.toml"
    save_gear(gear, file)
    said = {
        "backend": "wire",
        "serial": "--SN 1",
        "operator": "A. Example",
        "folder": tmp_path / "runs",
        "seed": 7,
        "world": WorldChoice(
            gear_seed=5, mount=2, mount_turn=math.radians(90.0), population="wide"
        ),
        "gear": gear,
        "mounting": "flexspline-fixed",
        "sample_rate": 250.0,
        "block_cycles": 77,
        "acceptance": "demonstration",
    }
    order = order_of("home", {"input_passes": 1}, said)
    arguments = arguments_of(order, OPTIONS, gear=file)
    again, told = heard(*arguments)
    assert told == ""
    assert order_of("home", {"input_passes": 1}, again) == order
    assert heard()[0] == {}


def test_the_words_of_a_world_are_the_same_however_they_are_said() -> None:
    words = "gear-seed=5,mount=2,mount-turn-deg=90,day=3"
    wanted = WorldChoice(gear_seed=5, mount=2, mount_turn=math.pi / 2.0, day=3)
    assert heard(f"--world={words}") == ({"world": wanted}, "")
    assert world_of({"gear_seed": 5, "mount": 2, "mount_turn_deg": 90.0, "day": 3}) == wanted
    said, told = heard("--gear-seed", "5", "--mount=2", "--mount-turn", "90", "--day", "3")
    assert said == {"world": wanted}
    assert f"--world {words}" in "".join(told.split("\n"))


def test_the_help_shows_the_group_and_not_the_flags_of_before() -> None:
    @with_order("world", world=("gear_seed", "day"))
    def command(said: Said) -> None:
        raise AssertionError(said)

    app = typer.Typer()
    app.command()(command)
    shown = CliRunner().invoke(app, ["--help"], terminal_width=200).output
    assert "--world" in shown
    assert "gear-seed, day" in shown
    assert "--gear-seed" not in shown


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("gear-seed", "is no word with its value"),
        ("day=1,day=2", "is said twice"),
        ("weather=3", "no such word of a simulated world"),
        ("day=tomorrow", "a whole number"),
        ("mount-turn=90", "no such word"),
        ("day=0", "--world day"),
    ],
)
def test_what_is_no_world_is_refused(text: str, sentence: str) -> None:
    with pytest.raises(ConfigurationError, match=sentence):
        world_of(world_said(text))


def test_a_command_takes_only_the_words_that_it_has_a_use_for() -> None:
    with pytest.raises(ConfigurationError, match="allowed gear-seed"):
        heard("--world", "number=3", world=("gear_seed",))


def test_the_keywords_of_execute_are_the_fields_of_an_order() -> None:
    parameters = inspect.signature(rig.execute).parameters
    beside = {"protocol", "parameters", "confirm", "ask"}
    of_commands = {"protocol", "values", "block_cycles", "acceptance"}
    assert set(parameters) - beside == set(WORDS) - of_commands
    usual = {f.name: f.default for f in dataclasses.fields(Order)}
    for name in set(parameters) - beside:
        if parameters[name].default is not None:
            assert parameters[name].default == usual[name], name
