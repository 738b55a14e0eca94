"""Packages that only some things need: imported when used, and named with their extra where they are missing."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

from rig.errors import RigError


def optional(package: str, purpose: str, extra: str = "python") -> ModuleType:
    """A package that is not installed with the base. Raises `RigError` that says how to install it."""
    try:
        return import_module(package)
    except ImportError:
        raise RigError(
            f"{purpose} needs the package {package.partition('.')[0]}, which is not installed",
            remedy=f"Install it: pip install 'harmonic-rig[{extra}]'.",
        ) from None
