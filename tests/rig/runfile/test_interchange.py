"""Other people's programs open a run: h5py shows counts with axes, labels and the factor."""

from pathlib import Path

import h5py
import numpy as np

from tests.rig.runfile.making import CHANNELS, counts_of, write_run


def test_h5py_shows_counts_with_axes_labels_and_factor(tmp_path: Path) -> None:
    with h5py.File(write_run(tmp_path)) as file:
        entry = file[file.attrs["default"].decode()]
        data = entry[entry.attrs["default"].decode()]
        assert [group.attrs["NX_class"] for group in (file, entry, data)] == [
            b"NXroot",
            b"NXentry",
            b"NXdata",
        ]
        assert data.attrs["signal"] == b"input_angle"
        assert list(data.attrs["axes"]) == [b"time"]
        assert list(data.attrs["auxiliary_signals"]) == [b"output_angle", b"torque", b"statusword"]
        for index, channel in enumerate(CHANNELS):
            dataset = data[channel.name]
            assert dataset.dtype.kind == "i"
            np.testing.assert_array_equal(dataset[:], counts_of(np.arange(2500))[:, index])
            assert dataset.dims[0].label == "time"
            assert dataset.dims[0][0] == data["time"]
            assert dataset.attrs["scale_factor"] == channel.direction * channel.scale
            assert dataset.attrs["add_offset"] == channel.offset
            assert (dataset.compression, dataset.compression_opts, dataset.shuffle) == (
                "gzip",
                1,
                True,
            )
        assert data["time"].is_scale


def test_the_descriptive_groups_are_plain(tmp_path: Path) -> None:
    with h5py.File(write_run(tmp_path)) as file:
        assert file["entry/run_id"][()] == b"00001-friction-A1"
        assert file["entry/outcome"][()] == b"COMPLETED"
        assert file["entry/status"][()] == b"complete"
        assert file["entry/user/name"].asstr()[()] == "Ada Grün"
        assert file["entry/process/origin_mark"][()] == b"SIMULATED"
        assert file["entry/process/rows_written"][()] == 2500
        assert file["entry/sample/gear_parameters_toml"][()].startswith(
            b"# Parameters of a harmonic drive"
        )
        assert file["entry/instrument/input_angle/counts_per_revolution"][()] == 32768
        assert file["entry/instrument/torque/calibration/certificate"][()] == b"PTB-17"
        assert file["entry/segments"]["label"].tolist() == [b"hold", b"hold"]


def test_counts_are_much_smaller_than_floats(tmp_path: Path) -> None:
    with h5py.File(write_run(tmp_path, 100_000)) as file:
        stored = sum(dataset.id.get_storage_size() for dataset in file["entry/data"].values())
        assert stored < 0.25 * 8 * 100_000 * len(file["entry/data"])
