"""The plan of a campaign: which protocols, in which order, with which parameters. A TOML file, or one that ships.

format = "campaign-1"
name = "acceptance"
title = "Acceptance of a gear"

[[protocol]]
name = "friction"
values = { points = 12 }        # parameters of the protocol that differ from their defaults
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any

from experiments import catalogue
from experiments.errors import PlanError
from experiments.parameters import make_parameters
from model import quantities
from model.errors import ParameterError
from rig.bench.backends.order import WORDS
from rig.errors import ConfigurationError, misstated

FORMAT = "campaign-1"
"""The value of `format` in the files that this program reads."""


@dataclass(frozen=True, kw_only=True)
class Key:
    """A key of a plan file: kind, what it may be, what stands for it where it is left away, and its meaning."""

    name: str
    kind: str
    what: str
    allowed: str = ""
    default: str = ""


TOP = (
    Key(
        name="format",
        kind="text",
        what="what kind of file this is",
        allowed=f'"{FORMAT}"',
        default="required",
    ),
    Key(
        name="name",
        kind="text",
        what="under which the campaign is found again when it goes on",
        allowed="not empty",
        default="required",
    ),
    Key(
        name="title",
        kind="text",
        what="a line for people",
        allowed="not empty",
        default="the name",
    ),
    Key(
        name="protocol",
        kind="list of tables [[protocol]]",
        what="the protocols, in the order in which they are run; one may stand there twice",
        allowed="at least one",
        default="required",
    ),
)
"""The keys of a plan file."""
STAGE = (
    Key(
        name="name",
        kind="text",
        what=WORDS["protocol"].help,
        allowed="a protocol of this program",
        default="required",
    ),
    Key(
        name="values",
        kind="table",
        what=WORDS["values"].help,
        allowed="names and ranges of the protocol",
        default="none",
    ),
)
"""The keys of one table `[[protocol]]`."""


@dataclass(frozen=True)
class Stage:
    """One protocol of a campaign, with the parameters that differ from its defaults."""

    protocol: str
    values: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class CampaignPlan:
    """What a campaign does: its stages in order. `path` is the file, or the name of one that ships."""

    name: str
    title: str
    stages: tuple[Stage, ...]
    path: str

    @property
    def sha256(self) -> str:
        """Of what is to be done: two plans with the same stages are the same."""
        stages = [[stage.protocol, dict(stage.values)] for stage in self.stages]
        return hashlib.sha256(json.dumps(stages, sort_keys=True).encode()).hexdigest()


def load_plan(path: str | Path) -> CampaignPlan:
    """The campaign plan at `path`. Raises `ConfigurationError` with file, table, key, value, limit and remedy."""
    try:
        content = quantities.read_toml(path)
    except ParameterError as error:
        raise misstated(error) from error
    return _plan(content, str(path))


def shipped_plan(name: str) -> CampaignPlan:
    """A plan that comes with the program. Raises `ConfigurationError` that lists them for another name."""
    names = shipped_names()
    if name not in names:
        raise ConfigurationError(
            "no such campaign",
            where="campaign",
            value=repr(name),
            limit=", ".join(names),
            remedy="Name one of these, or give a plan of your own with --plan FILE.",
        )
    text = (_shipped() / f"{name}.toml").read_bytes()
    return _plan(quantities.parse_toml(text, name), name)


def shipped_names() -> tuple[str, ...]:
    """The plans that come with the program."""
    names = [entry.name for entry in _shipped().iterdir() if entry.name.endswith(".toml")]
    return tuple(sorted(name.removesuffix(".toml") for name in names))


def _shipped() -> Any:
    return resources.files("rig.trial.campaign") / "plans"


def _plan(content: Mapping[str, Any], path: str) -> CampaignPlan:
    _refuse_unknown(content, TOP, path)
    if content.get("format") != FORMAT:
        raise ConfigurationError(
            "is no campaign plan of this program",
            where=f"{path}: format",
            value=repr(content.get("format")),
            limit=FORMAT,
        )
    rows = content.get("protocol")
    if not isinstance(rows, list) or not rows:
        raise ConfigurationError(
            "a campaign needs at least one protocol",
            where=f"{path}: [[protocol]]",
            remedy='Write a table [[protocol]] with name = "friction", for instance.',
        )
    stages = tuple(_stage(row, f"{path}: protocol {n}") for n, row in enumerate(rows, 1))
    name = _text(content, "name", path)
    return CampaignPlan(
        name=name, title=_text(content, "title", path, name), stages=stages, path=path
    )


def _stage(row: Any, where: str) -> Stage:
    if not isinstance(row, dict):
        raise ConfigurationError("is no table", where=where, value=repr(row), limit="[[protocol]]")
    _refuse_unknown(row, STAGE, where)
    protocol = _text(row, "name", where)
    if protocol not in catalogue.names():
        raise ConfigurationError(
            "no such protocol",
            where=f"{where}: name",
            value=repr(protocol),
            limit=", ".join(catalogue.names()),
        )
    values = row.get("values", {})
    if not isinstance(values, dict):
        raise ConfigurationError(
            "is no table of parameters",
            where=f"{where}: values",
            value=repr(values),
            limit="{ parameter = value, ... }",
        )
    try:
        make_parameters(catalogue.load(protocol).parameters, values, f"{where}: values")
    except PlanError as error:
        raise misstated(error) from error
    return Stage(protocol, values)


def _text(table: Mapping[str, Any], key: str, where: str, otherwise: str = "") -> str:
    text = table.get(key, otherwise)
    if not isinstance(text, str) or not text.strip():
        raise ConfigurationError(
            "needs a text", where=f"{where}: {key}", value=repr(text), limit="a text"
        )
    return text


def _refuse_unknown(table: Mapping[str, Any], known: tuple[Key, ...], where: str) -> None:
    names = [key.name for key in known]
    for key in table:
        if key not in names:
            raise ConfigurationError("no such key", where=f"{where}: {key}", limit=", ".join(names))
