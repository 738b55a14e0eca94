"""What other packages bring: protocols, fits, sources and importers, found by their entry points.

A package names what it has in its own pyproject.toml::

    [project.entry-points."harmonic_rig.protocols"]
    torque-noise = "lab_noise.protocol:EXPERIMENT"

Names are read when somebody asks for them, modules when somebody uses them: nothing of such a package is imported into
a run that does not use it. One that cannot be imported, that is none of its kind, or whose name is taken is left out,
and said so; what is there already stays.
"""

from __future__ import annotations

import functools
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Literal, get_args

from experiments.errors import ExtensionError

Group = Literal["protocols", "fits", "sources", "importers"]
GROUPS: tuple[Group, ...] = get_args(Group)
PREFIX = "harmonic_rig."


@dataclass(frozen=True)
class Extension:
    """One thing that a package brings: its name, where it stands ("module:object"), and whose it is."""

    group: Group
    name: str
    place: str
    package: str
    version: str
    summary: str = ""

    @property
    def title(self) -> str:
        """In a sentence: "protocol torque-noise of lab-noise 1.2"."""
        return f"{self.group.removesuffix('s')} {self.name} of {self.package} {self.version}"

    def loaded(self, kind: type[Any]) -> Any:
        """The object itself, its module imported now. Raises `ExtensionError` for one that fails, or is no `kind`."""
        try:
            found = EntryPoint(self.name, self.place, PREFIX + self.group).load()
        except Exception as error:
            because = f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"
            raise self.refused(f"cannot be imported ({because})") from error
        if not isinstance(found, kind):
            raise self.refused(f"is a {type(found).__name__}, which is no {kind.__name__}")
        if getattr(found, "name", self.name) != self.name:
            raise self.refused(f"calls itself {found.name!r}")
        return found

    def refused(self, why: str) -> ExtensionError:
        """The error that names it, and its being left out from now on."""
        _LEFT_OUT[self] = why
        return ExtensionError(
            why,
            where=self.title,
            value=self.place,
            remedy=f"Correct or uninstall {self.package}; everything else works without it.",
        )


_LEFT_OUT: dict[Extension, str] = {}


def left_out() -> tuple[tuple[Extension, str], ...]:
    """What was left out so far in this process, each with the reason."""
    return tuple(_LEFT_OUT.items())


@functools.cache
def found(group: Group) -> tuple[Extension, ...]:
    """All that installed packages name in a group, by name; nothing of them is imported."""
    named = (_named(group, point) for point in entry_points(group=PREFIX + group))
    return tuple(sorted(named, key=lambda one: (one.name, one.package)))


def _named(group: Group, point: EntryPoint) -> Extension:
    distribution = point.dist
    if distribution is None:
        return Extension(group, point.name, point.value, "a package without a name", "")
    summary = distribution.metadata.json.get("summary", "")
    of = (distribution.name, distribution.version, str(summary))
    return Extension(group, point.name, point.value, *of)


def usable(groups: Iterable[Group], taken: Collection[str]) -> tuple[Extension, ...]:
    """Those of some groups whose name is theirs alone: two of one name are both left out, and so is a `taken` one."""
    candidates = [one for group in groups for one in found(group)]
    names = [one.name for one in candidates]
    for one in candidates:
        others = [other.package for other in candidates if other.name == one.name]
        if one.name in taken:
            _LEFT_OUT[one] = "has the name of one that is there already"
        elif names.count(one.name) > 1:
            _LEFT_OUT[one] = f"has the name of another: {', '.join(others)} bring it"
    return tuple(one for one in candidates if one not in _LEFT_OUT)
