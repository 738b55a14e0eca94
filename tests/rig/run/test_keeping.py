"""What a run keeps of the files that people write: hashes, and a sealed copy of each calibration."""

from __future__ import annotations

from pathlib import Path

import pytest

from experiments.finding import first_blocking
from rig.analysis.chain import links_of_run
from rig.bench.config.used import UsedFile, files_used
from rig.errors import ChangedRunError
from rig.run.keeping import FOLDER, keep_files
from rig.runfile.seal import hash_path
from tests.rig.bench.test_certificate_file import HEADER, POINTS, WITH_CURVE
from tests.rig.library.stored import write
from tests.rig.runfile.making import header

CALIBRATION = UsedFile("output.csv", "calibration", (HEADER + POINTS).encode())


@pytest.fixture
def described(tmp_path: Path) -> Path:
    """The description of a rig, with a calibration that it names."""
    path = tmp_path / "rig.toml"
    path.write_text(WITH_CURVE, encoding="utf-8")
    (tmp_path / "output.csv").write_bytes(CALIBRATION.content)
    return path


def test_a_rig_and_its_calibration_are_noted_and_the_calibration_is_kept(described: Path) -> None:
    folder = described.parent / "runs"
    files = files_used(described)
    assert [(file.name, file.kind) for file in files] == [
        ("rig.toml", "rig description"),
        ("output.csv", "calibration"),
    ]
    noted, calibration = keep_files(files, folder)
    assert (noted["sha256"], noted["copy"]) == (files[0].sha256, "")
    kept = folder / calibration["copy"]
    assert kept.parent.name == FOLDER
    assert kept.read_bytes() == CALIBRATION.content
    assert hash_path(kept).read_text().split() == [CALIBRATION.sha256, kept.name]
    # The second run keeps nothing more; an edited original is another calibration.
    keep_files(files, folder)
    assert len(list(kept.parent.iterdir())) == 2
    original = described.parent / "output.csv"
    original.write_text(original.read_text().replace("0.4\n", "0.2\n"))
    keep_files(files_used(described), folder)
    assert len(list(kept.parent.iterdir())) == 4
    assert files_used(None) == files_used(described.with_name("none.toml")) == ()


def test_a_copy_that_was_changed_is_refused_and_one_cut_off_is_made_again(tmp_path: Path) -> None:
    kept = tmp_path / keep_files([CALIBRATION], tmp_path)[0]["copy"]
    hash_path(kept).unlink()
    keep_files([CALIBRATION], tmp_path)
    assert hash_path(kept).exists()
    kept.chmod(0o644)
    kept.write_bytes(CALIBRATION.content + b"\n")
    with pytest.raises(ChangedRunError, match="was changed since it was sealed"):
        keep_files([CALIBRATION], tmp_path)


def test_the_chain_of_a_run_holds_the_calibrations_that_it_used(tmp_path: Path) -> None:
    files = keep_files([CALIBRATION], tmp_path)
    process = {**header("x").metadata.process, "files": files}
    run = write(tmp_path, 1, process=process)
    assert [link.what for link in links_of_run(run)] == ["run", "calibration"]
    assert first_blocking(links_of_run(run)) is None
    kept = tmp_path / files[0]["copy"]
    kept.chmod(0o644)
    kept.write_bytes(b"another")
    broken = first_blocking(links_of_run(run))
    assert broken is not None
    assert (broken.what, Path(broken.where)) == ("calibration", kept)
