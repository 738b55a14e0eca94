"""Whoever wants a bus does not load what python-can imports for log files, and can still read such files."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ALL_DOORS = """
import sys
from drivers.bus.dictionary.device_file import read_device_file
read_device_file(b"[DeviceInfo]\\nVendorName=x\\n[MandatoryObjects]\\nSupportedObjects=0\\n[1000]\\nParameterName=t\\n")
import rig.trial.doctor.second_client
import drivers.bus.socketcand
assert "can" in sys.modules and "canopen" in sys.modules
assert "asammdf" not in sys.modules
import asammdf
print(asammdf.VERSION)
"""


def test_no_door_to_the_bus_imports_asammdf_and_it_can_be_imported_afterwards(
    tmp_path: Path,
) -> None:
    # Stands in for the package, so that the test means something where that is not installed.
    (tmp_path / "asammdf.py").write_text("VERSION = 'imported'\n", encoding="utf-8")
    ran = subprocess.run(
        [sys.executable, "-c", ALL_DOORS],
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.stdout == "imported\n", ran.stderr
