"""The modules that build the documentation, which is no package."""

from __future__ import annotations

import importlib
import os
import sys
from pathlib import Path
from types import ModuleType

from experiments import catalogue

DOCS = Path(__file__).parents[2] / "docs"


def building(name: str) -> ModuleType:
    """One of the modules in `docs`."""
    sys.path.insert(0, str(DOCS))
    try:
        return importlib.import_module(name)
    finally:
        sys.path.remove(str(DOCS))


_PRINTED = building("printed_output")


def commands_of(page: Path) -> list[str]:
    """Every command line of a page that begins with `rig`, in order, comments taken off."""
    return _PRINTED.commands_of(page)


def versions() -> str:
    """The analyses and their versions, a line each."""
    rows = ((name, catalogue.load(name).version) for name in catalogue.kinds())
    return "".join(f"{name} {version}\n" for name, version in rows)


def hold_against_kept(page: Path, printed: list[tuple[str, str]], folder: Path) -> None:
    """What the site shows under each command or cell of a page is what it printed; or it is written anew."""
    name = page.relative_to(DOCS).with_suffix("").as_posix()
    lines = [(what, _PRINTED.kept_lines(text, folder)) for what, text in printed]
    if os.environ.get("RENEW_PRINTED"):
        _PRINTED.write_printed(name, lines)
        _PRINTED.VERSIONS.write_text(versions(), encoding="utf-8")
    kept = _PRINTED.read_printed(name)
    assert list(dict.fromkeys(what for what, _ in lines)) == list(kept)
    # Of a command that stands on a page twice the first counts.
    for what, told in dict(reversed(lines)).items():
        assert _PRINTED.differing(kept[what], told) == [], f"{what}: RENEW_PRINTED=1 writes it anew"
