"""Packages that only some things need: imported when used, and named with their extra where they are missing."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from types import ModuleType

from rig.errors import RigError


def optional(package: str, purpose: str, extra: str = "python") -> ModuleType:
    """A package that is not installed with the base. Raises `RigError` that says how to install it."""
    try:
        return import_module(package)
    except ImportError:
        raise _missing(package.partition(".")[0], purpose, extra) from None


def require(purpose: str, extra: str, *packages: str) -> None:
    """Raise `RigError` that says how to install the first of the packages that is missing; nothing is imported."""
    for name in packages:
        if find_spec(name) is None:
            raise _missing(name, purpose, extra)


def _missing(package: str, purpose: str, extra: str) -> RigError:
    return RigError(
        f"{purpose} needs the package {package}, which is not installed",
        remedy=f"Install it: pip install 'harmonic-rig[{extra}]'.",
    )
