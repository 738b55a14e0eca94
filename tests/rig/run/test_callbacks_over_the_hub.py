"""What callbacks raise in the middle of a run in real time, over the hub: the same as on the wire in virtual time."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.rig.raising import CASES, SPEED, Carrier, Raiser, judge
from tests.rig.served_rig import Served, served_rig

pytestmark = pytest.mark.realtime

RATE = 100.0
BY_API = {"serial": "SN-1", "operator": "A. Example", "confirm": "SN-1"}


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    log = tmp_path_factory.mktemp("plant") / "plant.log"
    with served_rig(RATE, "wire", log, lifetime=1500.0) as found:
        yield found


@pytest.mark.parametrize(("way", "which", "error"), CASES)
def test_a_run_over_the_hub_is_left_through_standstill_alone(
    way: str,
    which: str,
    error: type[BaseException],
    served: Served,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    served.forget()
    description = served.configuration(tmp_path)
    words = (
        *("--backend", "hardware", "--config", str(description), "--sample-rate", f"{RATE:g}"),
        *("--gear", "SN-1", "--operator", "A. Example", "--confirm", "SN-1"),
    )
    asked = {"backend": "hardware", "config": description, "sample_rate": RATE, **BY_API}
    carrier = Carrier(asked, words, tmp_path / "runs")
    began = time.monotonic_ns()
    raiser: Raiser = judge(carrier, way, which, error, monkeypatch)
    over = time.monotonic_ns()
    assert raiser.raised
    log = served.plant()
    run = log[(log[:, 0] >= began) & (log[:, 0] <= over)]
    # It turned, and when whoever called had it back it stood: by the plant's own word.
    assert np.abs(run[:, 1]).max() > 0.9 * SPEED
    assert abs(run[-1, 1]) < 0.5
