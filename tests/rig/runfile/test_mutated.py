"""Files with something changed at random: each is refused in our words, or read; `run_file_study` makes a thousand."""

from pathlib import Path

import pytest

from tests.rig.runfile.making import write_run
from tests.rig.runfile.mutated import mutated, outcome_of, uses

WRITTEN = Path(__file__).parents[2] / "data" / "0.1.0"
SEEDS = 40


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, ...]:
    return (
        write_run(tmp_path_factory.mktemp("sound"), 300),
        WRITTEN / "runs" / "00005-import-SN_010.h5",
    )


@pytest.mark.parametrize("seed", range(SEEDS))
def test_a_changed_file_is_refused_in_our_words_or_read(
    tmp_path: Path, sources: tuple[Path, ...], seed: int
) -> None:
    source = sources[seed % len(sources)]
    path, what, resealed = mutated(source, tmp_path, seed)
    is_same = path.read_bytes() == source.read_bytes()
    for name, use in uses(path).items():
        outcome = outcome_of(use)
        if not resealed and not is_same and name in ("read", "fit", "export"):
            # Nothing may be said of it before its seal was looked at, but that it is no run file.
            assert outcome in ("changed", "refused"), (what, name)
