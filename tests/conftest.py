"""What every test has: benches' state and indexes of runs in folders of the session, never in this computer's own;
and one thread of linear algebra, for processes fill the cores (`tests/__main__.py`).
"""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Iterator

import pytest
from hypothesis import HealthCheck, settings

from rig.bench.state import VARIABLE
from rig.library.place import VARIABLE as INDEX_VARIABLE

# An example may take as long as it takes: how long is the machine's affair, and no test's.
settings.register_profile(
    "any machine", deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("any machine")
ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
"""Read when a library is loaded. Workers fill the cores: its threads would wait for each other, a fifth of the time."""

for _variable in ONE_THREAD:
    # Here, not in a hook: the conftest of a room is loaded before any hook is called, and numpy with it.
    os.environ.setdefault(_variable, "1")


# What a room imports and collects is a million objects that live as long as the process: to look them through every
# 700 new ones takes an eighth of all its time.
gc.set_threshold(100_000, 50, 50)


USERS_OF_QT = ("rig.window", "tests.rig.window", "pyqtgraph", "pytestqt", "PySide6")


@pytest.hookimpl(trylast=True)
def pytest_configure() -> None:
    """Bytecode is kept, and Qt looks at nothing that is not its own."""
    # Bytecode is written, whatever the machine's settings say: without it every process that a test starts would
    # compile the program again, and every room the tests.
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    sys.dont_write_bytecode = False
    # pytest-qt has loaded Qt by now.
    if feature := sys.modules.get("shibokensupport.feature"):
        feature.__dict__["_mod_uses_pyside"] = uses_qt


def uses_qt(module: object) -> bool:
    """Whether a module uses Qt. The binding finds out by the source of every module that is imported after it, and the
    lines stay in `linecache`: a million of them, 100 MB of a worker, of two thousand modules that know nothing of Qt.
    """
    return getattr(module, "__name__", "").startswith(USERS_OF_QT)


def pytest_collection_finish() -> None:
    """What was collected stays: nobody looks it through again."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def state_folders(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Children inherit the variables: a hub's runs in a process of their own latch there too."""
    with pytest.MonkeyPatch.context() as environment:
        for variable, name in ((VARIABLE, "state"), (INDEX_VARIABLE, "indexes")):
            environment.setenv(variable, str(tmp_path_factory.mktemp(name)))
        yield
