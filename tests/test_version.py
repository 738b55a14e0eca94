"""The version in pyproject.toml is never that of an older release, and what else names a release names the newest."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest
from packaging.version import Version

ROOT = Path(__file__).resolve().parents[1]
HEADING = re.compile(r"^## \[(?P<name>[^\]]+)\](?: - (?P<date>\d{4}-\d\d-\d\d))?", re.MULTILINE)
UNRELEASED = "Unreleased"


def complaint(version: str, changelog: str) -> str:
    """What is wrong with a version beside a changelog; "" where nothing is."""
    headings = [found["name"] for found in HEADING.finditer(changelog)]
    newest = max((Version(name) for name in headings if name != UNRELEASED), default=Version("0"))
    if headings[0] != UNRELEASED:
        wrong = Version(version) != Version(headings[0])
        return f"{version} is not the release {headings[0]} of CHANGELOG.md" if wrong else ""
    if Version(version) <= newest:
        return f"{version} is no later than {newest}, which is released: raise it, with .dev0"
    return "" if Version(version).is_devrelease else f"{version} is not released: add .dev0"


def test_the_version_is_not_that_of_an_older_release() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert complaint(project["version"], (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")) == ""


@pytest.mark.parametrize(
    ("version", "changelog", "words"),
    [
        ("0.2.0", "## [Unreleased]\n## [0.2.0] - 2026-11-22\n", "no later than 0.2.0"),
        ("0.2.0.dev0", "## [Unreleased]\n## [0.2.0] - 2026-11-22\n", "no later than 0.2.0"),
        ("0.9.0", "## [Unreleased]\n## [0.10.0] - 2026-11-22\n", "no later than 0.10.0"),
        ("0.3.0", "## [Unreleased]\n## [0.2.0] - 2026-11-22\n", "not released"),
        ("0.3.0.dev0", "## [0.3.0] - 2026-12-01\n## [0.2.0] - 2026-11-22\n", "not the release"),
        ("0.3.0.dev0", "## [Unreleased]\n## [0.2.0] - 2026-11-22\n", ""),
        ("0.3.0", "## [0.3.0] - 2026-12-01\n## [0.2.0] - 2026-11-22\n", ""),
    ],
)
def test_the_rule_itself(version: str, changelog: str, words: str) -> None:
    said = complaint(version, changelog)
    assert words in said if words else not said


def test_the_citation_names_the_newest_release() -> None:
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    released = [found for found in HEADING.finditer(changelog) if found["name"] != UNRELEASED]
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f'version: "{released[0]["name"]}"' in citation
    assert f'date-released: "{released[0]["date"]}"' in citation
