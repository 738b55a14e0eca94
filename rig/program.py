"""Which program this is: its version, the commit of its tree, and one hash over the files that it consists of.

A number is made by a recording, its settings and a program. Runs, analyses and certificates therefore hold these three,
and two numbers that were made by different programs are said to be so. The same files give the same hash wherever
they lie, in a clone or installed from a wheel, with the line ends of any system; numpy and what else comes
from other people is not in it. A package that brings a protocol, a fit, a source or an importer is named beside it,
with a hash of its own, where what it brought was used.
"""

from __future__ import annotations

import functools
import hashlib
import os
import subprocess
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from experiments.extensions import Extension
from rig.floors import DISTRIBUTION, KNOWN_FILES, OURS

PACKAGES = ("harmonic_rig", "rig", *KNOWN_FILES)
SHIPPED = frozenset({".py", ".typed", ".toml", ".csv", ".md", ".html", ".css", ".typ", ".json"})
"""Suffixes of the files that a wheel carries (`[tool.setuptools.package-data]` in pyproject.toml)."""
CHANGED = "+changed"
"""Stands behind a commit whose tree is not what was committed."""
EXTENSIONS = "extensions"
"""Under which runs and analyses hold what other packages brought to them."""
PROGRAM_KEYS = ("program_version", "git_commit", "program_sha256")
"""Under which runs, analyses and certificates hold it."""


@dataclass(frozen=True)
class Program:
    """A program by its version, its commit ("" where it was installed from a wheel) and the hash of its files."""

    version: str
    commit: str = ""
    sha256: str = ""

    def as_json(self) -> dict[str, str]:
        """The three under the keys of runs, analyses and certificates."""
        return dict(zip(PROGRAM_KEYS, (self.version, self.commit, self.sha256), strict=True))

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> Program:
        """The program that a run, an analysis or a certificate names; older ones did not name all three."""
        return cls(*(str(content.get(key, "")) for key in PROGRAM_KEYS))

    def in_words(self) -> str:
        """One line: version, the commit's first letters, the hash's first letters."""
        commit, changed = self.commit.partition("+")[0], self.commit.endswith(CHANGED)
        words = [f"version {self.version or 'not stated'}"]
        if commit:
            words.append(f"commit {commit[:12]}" + (CHANGED if changed else ""))
        words.append(f"files {self.sha256[:12] or 'not hashed'}")
        return ", ".join(words)


@functools.cache
def this_program() -> Program:
    """The program that is running; looked up once in a process, before its files may change."""
    return Program(version(), tree_commit(OURS), files_sha256(OURS))


@functools.cache
def version() -> str:
    """The version: of a clone the one in its pyproject.toml, which an older installation of it does not know."""
    project = OURS / "pyproject.toml"
    if project.is_file():
        stated = tomllib.loads(project.read_text(encoding="utf-8")).get("project", {})
        if stated.get("name") == DISTRIBUTION:
            return str(stated["version"])
    try:
        return metadata.version(DISTRIBUTION)
    except metadata.PackageNotFoundError:
        return "not installed"


def extension_records(used: Iterable[Extension | None]) -> dict[str, Any]:
    """What other packages brought, as a run or an analysis holds it under `EXTENSIONS`; empty where that is nothing."""
    records = [_record(one) for one in dict.fromkeys(used) if one is not None]
    return {EXTENSIONS: records} if records else {}


def _record(one: Extension) -> dict[str, str]:
    name = one.place.partition(":")[0].partition(".")[0]
    # Asked for without importing it.
    spec, sha256 = find_spec(name), ""
    if spec is not None and spec.origin:
        # A package is a folder itself, and lies in the one above it.
        is_package = spec.submodule_search_locations is not None
        sha256 = files_sha256(Path(spec.origin).parents[is_package], (name,))
    return {
        "group": one.group,
        "name": one.name,
        "package": one.package,
        "version": one.version,
        "sha256": sha256,
    }


def brought_by(content: Mapping[str, Any]) -> tuple[str, ...]:
    """What other packages brought to a run (its process) or an analysis, one phrase each."""
    return tuple(
        f"{one['name']} of {one['package']} {one['version']} ({one['group'].removesuffix('s')}, files "
        f"{one['sha256'][:12] or 'not hashed'})"
        for one in content.get(EXTENSIONS, ())
    )


def files_sha256(root: Path, packages: Sequence[str] = PACKAGES) -> str:
    """One SHA-256 over names and content of all shipped files of these packages or modules below a folder."""
    digest = hashlib.sha256()
    for name, path in sorted(_shipped(root, packages)):
        content = Path(path).read_bytes().replace(b"\r\n", b"\n")
        digest.update(f"{name}\0{len(content)}\0".encode() + content)
    return digest.hexdigest()


def _shipped(root: Path, packages: Sequence[str] = PACKAGES) -> Iterator[tuple[str, str]]:
    """Name from the root on with `/` between its parts, and path, of every shipped file."""
    for package in packages:
        if (module := root / f"{package}.py").is_file():
            yield module.name, str(module)
        for folder, _, names in os.walk(root / package):
            if os.path.basename(folder) == "__pycache__":
                continue
            inside = os.path.relpath(folder, root).replace(os.sep, "/")
            for name in names:
                if os.path.splitext(name)[1] in SHIPPED:
                    yield f"{inside}/{name}", os.path.join(folder, name)


def tree_commit(root: Path) -> str:
    """The commit of a source tree, `+changed` behind it where files of it were changed since, or packages
    hold files that are in no commit; "" where there is no such tree or no git.
    """
    if not (root / ".git").exists():
        return ""
    # Without the optional locks it disturbs nobody who commits at this moment.
    order = ["git", "--no-optional-locks", "-C", str(root)]
    order += ["status", "--porcelain=v2", "--branch", "--untracked-files=normal"]
    # Variables that git's own hooks set would lead it to another tree.
    own = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}
    try:
        done = subprocess.run(
            order, capture_output=True, text=True, timeout=5, check=False, env=own
        )
    except (OSError, subprocess.SubprocessError):
        return ""
    if done.returncode != 0:
        return ""
    commit, changed = "", False
    for line in done.stdout.splitlines():
        word, _, rest = line.partition(" ")
        if rest.startswith("branch.oid "):
            commit = rest.split()[-1].replace("(initial)", "")
        # A run's folder beside the packages is no change of the program; a module that git does not know is.
        elif word != "#":
            changed |= word != "?" or rest.strip('"').split("/")[0] in PACKAGES
    return commit + (CHANGED if changed and commit else "")
