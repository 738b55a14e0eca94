"""`rig config certificate`: the file is that of the bench's own encoder, and a rig can name it as it stands."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from rig.bench.config.certificate_file import read_certificate
from rig.errors import ConfigurationError
from rig.main import app
from sim_backend.certificate import encoder_certificate
from sim_backend.imperfections import Imperfections
from sim_backend.world import World


def call(*words: str) -> str:
    called = CliRunner().invoke(app, ["config", "certificate", *words], catch_exceptions=False)
    assert called.exit_code == 0
    return called.output


@pytest.mark.parametrize("channel", ["input", "output"])
def test_it_writes_the_certificate_of_the_benchs_encoder(tmp_path: Path, channel: str) -> None:
    file = tmp_path / "encoder.csv"
    said = call("--bench-seed", "9545", "--channel", channel, "--output", str(file))
    assert 'curve = "encoder.csv"' in said
    read = read_certificate(tmp_path, "encoder.csv")
    made = encoder_certificate(Imperfections(), channel, World.of(9545))  # type: ignore[arg-type]
    np.testing.assert_allclose(read.curve.errors, made.errors, rtol=1e-7)
    assert read.header.certificate == f"simulated: {channel} encoder of bench 9545"
    other = tmp_path / "other.csv"
    call("--bench-seed", "9546", "--channel", channel, "--output", str(other))
    assert read_certificate(tmp_path, "other.csv").curve != read.curve


def test_a_file_that_is_there_is_left_alone(tmp_path: Path) -> None:
    file = tmp_path / "encoder.csv"
    file.write_text("mine")
    with pytest.raises(ConfigurationError, match="exists already and is left alone"):
        call("--bench-seed", "9545", "--output", str(file))
    assert file.read_text() == "mine"
