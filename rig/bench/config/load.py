"""Reads `rig.toml`: every wrong value with its path, what was found and why it cannot be; unknown
keys with the nearest known.
"""

from __future__ import annotations

import itertools
import tomllib
import types
import typing
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from experiments.finding import Finding, Severity
from rig.bench.config.parts import FOLDER
from rig.bench.config.schema import FORMAT, Alarms, Laboratory, Notify, RigConfiguration
from rig.errors import ConfigurationError, nearest

_Table = TypeVar("_Table", bound=BaseModel)

TO_BE_SAID = "SAY: "
"""What a word begins with that a person must still say; what is asked stands behind it."""


def _problem(path: str, value: str, reason: str, remedy: str = "") -> Finding:
    """One thing that is wrong with a configuration: path of the value, what was found, why it cannot be."""
    return Finding(path, Severity.BLOCKS, value, remedy, follows=reason)


def load_configuration(path: str | Path) -> RigConfiguration:
    """The rig that a file describes. Raises `ConfigurationError` that lists everything that is wrong with it."""
    result = inspect_configuration(path)
    if isinstance(result, RigConfiguration):
        return result
    listed = "".join(f"\n  {problem.sentence}" for problem in result)
    count = "one value" if len(result) == 1 else f"{len(result)} values"
    raise ConfigurationError(
        f"{count} cannot be accepted:{listed}\n",
        where=str(path),
        remedy="Correct them; nothing has moved",
    )


def inspect_configuration(path: str | Path) -> RigConfiguration | tuple[Finding, ...]:
    """The configuration of a file, or all its problems. Raises `ConfigurationError` for a file that cannot be read."""
    path = Path(path)
    content = _content(path)
    open_words = tuple(_unsaid(content))
    if open_words:
        return open_words
    try:
        return RigConfiguration.model_validate(content, context={FOLDER: path.parent})
    except ValidationError as error:
        return tuple(_refused(entry) for entry in error.errors())


def _unsaid(content: object, place: tuple[str | int, ...] = ()) -> Iterator[Finding]:
    """Every word that is marked as still to be said."""
    if isinstance(content, str) and content.startswith(TO_BE_SAID):
        asked = content.removeprefix(TO_BE_SAID)
        yield _problem(_path_text(place), "", f"must still be said: {asked}")
    elif isinstance(content, Mapping):
        for name, one in content.items():
            yield from _unsaid(one, (*place, name))
    elif isinstance(content, list):
        for k, one in enumerate(content):
            yield from _unsaid(one, (*place, k))


def load_laboratory(path: str | Path) -> Laboratory | None:
    """The `[laboratory]` of a rig's description, whatever else the file says; None where it has none.

    Raises `ConfigurationError` for a file that cannot be read and for a table that cannot be accepted.
    """
    return _table(Path(path), "laboratory", Laboratory)


def load_alarms(path: str | Path) -> Alarms | None:
    """The `[alarms]` of a rig's description, read as `load_laboratory` reads."""
    return _table(Path(path), "alarms", Alarms)


def load_notify(path: str | Path) -> Notify | None:
    """The `[notify]` of a rig's description, read as `load_laboratory` reads."""
    return _table(Path(path), "notify", Notify)


def _table(path: Path, name: str, model: type[_Table]) -> _Table | None:
    table = _content(path).get(name)
    if table is None:
        return None
    try:
        return model.model_validate(table)
    except ValidationError as error:
        problem = _refused({**error.errors()[0], "loc": (name, *error.errors()[0]["loc"])})
        raise ConfigurationError(
            problem.follows,
            where=f"{path}: {problem.what}",
            value=problem.found or None,
            remedy=problem.remedy,
        ) from error


def _content(path: Path) -> dict[str, Any]:
    """A TOML file as it stands. Raises `ConfigurationError`."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigurationError(
            f"cannot be read: {error.strerror or error}",
            where=str(path),
            remedy="Write one with `rig config new`, or name another with --config.",
        ) from error
    except UnicodeDecodeError as error:
        raise ConfigurationError(
            "is not text in UTF-8", where=str(path), value=f"byte {error.start}"
        ) from error
    except tomllib.TOMLDecodeError as error:
        raise ConfigurationError(
            f"is not valid TOML: {error}", where=str(path), remedy="Correct the line."
        ) from error


def missing_files(configuration: RigConfiguration, folder: Path) -> tuple[Finding, ...]:
    """The files that a configuration names and that are not there; `folder` is where it lies itself."""
    named = [("drive.eds", configuration.drive.eds)]
    named += [(f"counter[{i}].eds", c.eds) for i, c in enumerate(configuration.counters)]
    named += [
        (f"analog_module[{i}].eds", m.eds) for i, m in enumerate(configuration.analog_modules)
    ]
    named += [(f"rig.{name}", getattr(configuration.rig, name)) for name in ("motor", "gear")]
    return tuple(
        _problem(where, repr(text), f"there is no file {folder / text}")
        for where, text in named
        if text
        and (where.endswith("eds") or text.endswith(".toml"))
        and not (folder / text).is_file()
    )


def _refused(error: Mapping[str, Any]) -> Finding:
    place = [
        part
        for part in error["loc"]
        if not (isinstance(part, str) and part.startswith("function-"))
    ]
    path = _path_text(place)
    kind, given = str(error["type"]), error.get("input")
    if kind == "extra_forbidden":
        return _problem(path, _quoted(given), "no such word here", _nearest(place))
    if kind == "missing":
        return _problem(path, "", "is missing")
    if path == "format":
        return _problem(
            path, _quoted(given), f'is not the format of a rig\'s description; expected "{FORMAT}"'
        )
    reason = str(error["msg"]).removeprefix("Value error, ")
    shown = "" if isinstance(given, Mapping | list) else _quoted(given)
    return _problem(path or "the whole file", shown, reason[:1].lower() + reason[1:])


def _path_text(place: Sequence[str | int]) -> str:
    """counter[0].lines out of ("counter", 0, "lines"); what pydantic adds for unions is left away."""
    text = ""
    for part in place:
        if isinstance(part, int):
            text += f"[{part}]"
        elif part.isidentifier():
            text += f".{part}"
    return text.removeprefix(".")


def _quoted(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 80 else text[:77] + "..."


def _nearest(place: Sequence[str | int]) -> str:
    """What may have been meant by an unknown key, among the words of its table."""
    model: type[BaseModel] = RigConfiguration
    for part, after in itertools.pairwise(place):
        if isinstance(part, str):
            model = _table_of(model, part, after) or model
    return nearest(str(place[-1]), sorted(words_of(model)))


def words_of(model: type[BaseModel]) -> Iterable[str]:
    """The keys that a table may have."""
    return (field.alias or name for name, field in model.model_fields.items())


def _table_of(model: type[BaseModel], key: str, kind: str | int) -> type[BaseModel] | None:
    """The model of a sub-table; where there are several, that of this kind."""
    for name, field in model.model_fields.items():
        if (field.alias or name) == key:
            tables = [
                table
                for table in _kinds(field.annotation)
                if isinstance(table, type) and issubclass(table, BaseModel)
            ]
            own = (
                table
                for table in tables
                if "kind" in table.model_fields
                and kind in typing.get_args(table.model_fields["kind"].annotation)
            )
            return next(itertools.chain(own, tables), None)
    return None


def _kinds(annotation: object) -> Iterable[object]:
    if typing.get_origin(annotation) in (tuple, typing.Union, types.UnionType, typing.Annotated):
        for part in typing.get_args(annotation):
            yield from _kinds(part)
    else:
        yield annotation
