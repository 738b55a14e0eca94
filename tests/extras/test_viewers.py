"""Other people's viewers open a run: xarray shows SI over a named time, silx the default plot with axes and units."""

from pathlib import Path

import h5py
import numpy as np

from tests.rig.runfile.making import CHANNELS, CYCLE_NS, EPOCH_NS, counts_of, write_run


def test_xarray_shows_si_over_time(tmp_path: Path) -> None:
    import xarray

    path = write_run(tmp_path)
    with xarray.open_dataset(path, engine="h5netcdf", group="entry/data") as dataset:
        assert dict(dataset.sizes) == {"time": 2500}
        assert dataset["torque"].dims == ("time",)
        for index, channel in enumerate(CHANNELS):
            expected = channel.to_si(counts_of(np.arange(2500))[:, index])
            np.testing.assert_allclose(
                dataset[channel.name].values, expected, rtol=1e-14, atol=1e-18
            )
            assert dataset[channel.name].attrs["units"] == channel.unit
        stamps = dataset["time"].values.astype("datetime64[ns]").astype(np.int64)
        np.testing.assert_array_equal(stamps, EPOCH_NS + np.arange(2500) * CYCLE_NS)
        assert dataset["input_angle"].attrs["long_name"] == "input angle (wave generator)"
        assert set(np.unique(dataset["flags"].values)) == {0, 1}
        middle = dataset["time"].values[1000:2000]
        assert dataset.sel(time=slice(middle[0], middle[-1])).sizes["time"] == 1000


def test_silx_finds_the_default_plot_with_axis_labels_and_units(tmp_path: Path) -> None:
    from silx.io import open as silx_open
    from silx.io.nxdata.parse import get_default

    with silx_open(str(write_run(tmp_path))) as file:
        data = get_default(file)
        assert data is not None
        assert data.is_valid
        assert not data.issues
        assert data.signal_dataset_name == "input_angle"
        assert data.signal_name == "input angle (wave generator)"
        signal = data.signal
        assert isinstance(signal, h5py.Dataset)
        assert signal.attrs["units"] == b"rad"
        # Counts as they are stored, with the factor beside them.
        np.testing.assert_array_equal(signal[:], counts_of(np.arange(2500))[:, 0])
        assert signal.attrs["scale_factor"] == CHANNELS[0].direction * CHANNELS[0].scale
        assert data.axes_dataset_names == ["time"]
        assert len(data.axes[0]) == 2500
        assert len(data.auxiliary_signals) == 3
