"""Tests of what is optional: each is collected where its extra is installed.

The gate installs every extra and says so by HARMONIC_RIG_EXTRAS=all: one that is missing is then an
error, so that nothing is left out in silence.
"""

from __future__ import annotations

import os
from importlib.util import find_spec

FLEET = ("dask", "distributed", "pyarrow", "duckdb", "pytz")
NEEDS = {
    "test_fleet.py": FLEET,
    "test_fleet_parts.py": FLEET,
    "test_fleet_simulate.py": FLEET,
    "test_lot.py": FLEET,
    "test_gauge.py": FLEET,
    "test_capability.py": FLEET,
    "test_measurement_files.py": ("pyarrow", "nptdms", "asammdf"),
    "test_export_to_mujoco.py": ("mujoco",),
    "test_viewers.py": ("xarray", "h5netcdf", "silx"),
    "test_page_commands.py": ("pyarrow", "distributed", "duckdb", "mujoco"),
    "test_documentation_build.py": ("sphinx", "myst_parser", "furo"),
}
"""Test file: the modules that it cannot do without."""

collect_ignore = [
    name
    for name, modules in NEEDS.items()
    if os.environ.get("HARMONIC_RIG_EXTRAS") != "all" and not all(map(find_spec, modules))
]
