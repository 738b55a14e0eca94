"""Tares: which protocol gives one, which analyses take one, and whether a run's may be subtracted from another's."""

from __future__ import annotations

from typing import TYPE_CHECKING

from experiments import catalogue
from rig.errors import RigError

if TYPE_CHECKING:
    from experiments.recording import Recording
    from experiments.result import Result


def tare_kind() -> str:
    """The protocol whose result is subtracted as a tare: the first of the catalogue that gives one."""
    return next(kind for kind in catalogue.kinds() if catalogue.load(kind).gives_tare)


def takes_tare(kind: str) -> bool:
    """Whether an analysis of this kind subtracts a tare where it is given one; False for a kind that is none."""
    return kind in catalogue.kinds() and catalogue.load(kind).takes_tare


def check_tare(recording: Recording, tare: Recording, result: Result) -> None:
    """Raise `RigError` unless the result of `tare` is one of the same kind of rig as the recording."""
    here, there = recording.metadata, tare.metadata
    if not catalogue.load(result.kind).gives_tare:
        protocol = tare_kind()
        raise RigError(
            f"only a {protocol} run (gear removed) can be subtracted as a tare",
            where=there.run_id,
            value=result.kind,
            limit=protocol,
            remedy=f"Run `rig run {protocol}` on this rig and give that run.",
        )
    if there.gear_mounted:
        raise RigError(
            "the tare was taken with a gear mounted, so that it holds the gear's own friction",
            where=there.run_id,
            remedy=f"Remove the gear and run {tare_kind()} again.",
        )
    if here.origin != there.origin:
        raise RigError(
            "tare and run do not come from the same kind of rig",
            where=there.run_id,
            value=there.origin,
            limit=here.origin,
            remedy="Take the tare on the rig on which the run was made.",
        )
