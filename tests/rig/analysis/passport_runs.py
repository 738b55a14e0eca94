"""A gear of fourteen runs with hand-made analyses, for the tests of its passport and its alarms."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

import pytest

from rig.analysis.passport.content import Passport, PassportSeries
from rig.library.index import LibraryIndex
from rig.library.place import index_path
from tests.rig.library.stored import RUNNING, analyse, estimate, start, write

VALUES = (80.0, 81.0, 79.0, 80.5, 79.5, 80.0, 81.0, 80.0, 79.0, 80.0, 80.5, 79.5, 80.0, 80.5)
"""Fourteen runs [mN m] of a gear that does not change."""
WORN = (*VALUES[:11], 90.0, 91.0, 90.5)
"""The same gear, changed in the twelfth run [mN m]."""


@pytest.fixture(scope="module")
def fourteen(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Fourteen friction runs of gear A1, one a day, none of them analysed."""
    folder = tmp_path_factory.mktemp("fourteen")
    for day in range(1, 15):
        write(folder, day, start_time=start(day))
    LibraryIndex(folder).refresh()
    return folder


def taken(source: Path, target: Path, most: int) -> Path:
    """The first runs of a folder under second names, with its index, which then holds for them too
    and saves reading them.
    """
    for run in runs_in(source)[:most]:
        for path in (run, run.with_name(run.name + ".sha256")):
            (target / path.name).hardlink_to(path)
    shutil.copy2(index_path(source), index_path(target))
    return target


@pytest.fixture
def history(fourteen: Path, tmp_path: Path) -> Path:
    """The fourteen runs in a folder of this test."""
    return taken(fourteen, tmp_path, 14)


@pytest.fixture
def folder(fourteen: Path, tmp_path: Path) -> Path:
    """The first four of them."""
    return taken(fourteen, tmp_path, 4)


def runs_in(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.h5"))


def analysed(folder: Path, values: Sequence[float], own: float = 0.2, scale: float = 0.0) -> None:
    """Lay running torques [mN m] beside the first runs of a folder."""
    for run, value in zip(runs_in(folder), values, strict=False):
        analyse(run, estimate(RUNNING, 1e-3 * value, own=1e-3 * own, scale=scale))


def series(found: Passport, quantity: str = RUNNING) -> PassportSeries:
    (one,) = [one for one in found.series if one.quantity == quantity]
    return one
