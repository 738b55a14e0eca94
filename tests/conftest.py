"""What every test has: benches' state and indexes of runs in folders of the session, never in this computer's own;
memory given back between files; and, on several cores, the order of the files and one thread of linear algebra each.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import gc
import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from rig.bench.state import VARIABLE
from rig.library.place import VARIABLE as INDEX_VARIABLE

TESTS = Path(__file__).parent
LONGEST_FIRST = (
    "rig/trial/test_drill.py",
    "rig/trial/test_drill_proofs.py",
    "docs/test_documentation.py",
    "end_to_end/test_coverage_study.py",
    "end_to_end/test_every_protocol.py",
    "end_to_end/test_truth_is_recovered.py",
    "rig/trial/test_demo.py",
    "rig/commands/test_ending_commands.py",
    "sim_backend/test_certificate.py",
    "experiments/test_certified.py",
)
"""Files that take long and have few tests. A worker takes a whole file: one that begins last is waited for alone."""


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


# Seven thousand tests are a million objects that live as long as the worker: to look them through every 700 new ones
# takes an eighth of all its time.
gc.set_threshold(100_000, 50, 50)


USERS_OF_QT = ("rig.window", "tests.rig.window", "pyqtgraph", "pytestqt", "PySide6")


@pytest.hookimpl(trylast=True)
def pytest_configure(config: pytest.Config) -> None:
    """Workers take the files in the order above; of itself xdist begins with those that have the most tests."""
    # Bytecode is written, whatever the machine's settings say: without it every process that a test starts would
    # compile the program again, and every worker all the tests.
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    sys.dont_write_bytecode = False
    if hasattr(config.option, "loadscopereorder"):
        config.option.loadscopereorder = False
    # pytest-qt has loaded Qt by now.
    if feature := sys.modules.get("shibokensupport.feature"):
        feature.__dict__["_mod_uses_pyside"] = uses_qt


def uses_qt(module: object) -> bool:
    """Whether a module uses Qt. The binding finds out by the source of every module that is imported after it, and the
    lines stay in `linecache`: a million of them, 100 MB of a worker, of two thousand modules that know nothing of Qt.
    """
    return getattr(module, "__name__", "").startswith(USERS_OF_QT)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest files first, the others as they were."""
    rank = {TESTS / name: place for place, name in enumerate(LONGEST_FIRST)}
    items.sort(key=lambda item: rank.get(item.path, len(rank)))


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


GROWTH = 30_000_000
"""Bytes that a file of tests may leave in the worker before what is behind them is asked to go."""
GENERATIONS = 11
"""Documents after which typst forgets what it kept of one, for the case that it is set once more."""
_resident = 0


@pytest.fixture(scope="module", autouse=True)
def memory_given_back() -> Iterator[None]:
    """A worker lives for thousands of tests: it keeps neither the pages that typst has set nor freed memory."""
    global _resident
    yield
    if resident() - _resident < GROWTH:
        return
    gc.collect()
    if typst := sys.modules.get("typst"):
        for _ in range(GENERATIONS):
            typst.compile(b"", ignore_system_fonts=True)
    # glibc keeps what was freed; elsewhere there is no such call.
    if sys.platform == "linux" and (name := ctypes.util.find_library("c")):
        trim = getattr(ctypes.CDLL(name), "malloc_trim", None)
        if trim is not None:
            trim(0)
    _resident = resident()


def resident() -> int:
    """Bytes of this process that lie in memory; 0 where the system has another way to say so."""
    try:
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return 0
