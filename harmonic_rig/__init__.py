"""A harmonic-drive test rig in Python, by the name under which it stays: `import harmonic_rig`.

Everything of `rig` under the name that no other package has, and what a package of your own may import::

    harmonic_rig              load, execute, fit, report: what a script calls
    harmonic_rig.protocols    what a protocol or a fit declares, and the steps of a plan
    harmonic_rig.analyses     what an analysis computes with
    harmonic_rig.sources      a device beside the bus
    harmonic_rig.importers    a kind of file
    harmonic_rig.testing      the checks that ours pass, for your own suite

Here nothing is made: the names are only passed on. What they promise stands in `docs/reference/stable.md`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import rig

if TYPE_CHECKING:
    from rig import *  # noqa: F403

__all__: list[str] = []
__all__ += rig.__all__


def __getattr__(name: str) -> object:
    """A public name of `rig`, its module imported now."""
    if name not in __all__:
        raise AttributeError(f"module 'harmonic_rig' has no attribute {name!r}")
    return getattr(rig, name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
