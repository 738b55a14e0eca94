"""Worked descriptions of rigs with named devices, from their documents: TOML files beside this one."""

from __future__ import annotations

from importlib import resources

from rig.errors import ConfigurationError


def _example_names() -> tuple[str, ...]:
    """The names of the worked examples."""
    files = resources.files(__name__).iterdir()
    return tuple(sorted(f.name[:-5] for f in files if f.name.endswith(".toml")))


def example_text(name: str) -> str:
    """The file of a worked example. Raises `ConfigurationError` for a name that there is not."""
    if name not in _example_names():
        raise ConfigurationError(
            "there is no such worked example",
            where="--example",
            value=repr(name),
            limit=", ".join(_example_names()),
        )
    return resources.files(__name__).joinpath(f"{name}.toml").read_text(encoding="utf-8")
