"""Files of a later version are refused; nothing is pickled."""

import numpy as np
import pytest

from saccade import Keypoints, exchange
from saccade.errors import KeypointsError
from saccade.io.files import FORMATS
from support.error_checks import refuses

h5py = pytest.importorskip("h5py", reason="the extra hdf5 is not installed")
LATER = FORMATS["points"] + 1
POINTS = Keypoints.at([[3.0, 4.0]], size=2.0)


def make_npz_newer(path):
    with np.load(path) as arrays:
        newer = {**arrays, "format": np.array(LATER)}
    with path.open("wb") as file:
        np.savez(file, **newer)


def make_hdf5_newer(path):
    with h5py.File(path, "a") as file:
        file.attrs["saccade_format"] = LATER


@pytest.mark.parametrize(
    ("write", "make_newer", "read"),
    [
        (exchange.write_npz, make_npz_newer, exchange.read_npz),
        (exchange.write_hdf5, make_hdf5_newer, exchange.read_hdf5),
    ],
)
def test_points_of_a_later_release_are_refused(tmp_path, write, make_newer, read):
    path = tmp_path / "points"
    write(path, POINTS if write is exchange.write_npz else {"a.png": POINTS})
    make_newer(path)
    with refuses(KeypointsError, str(path), "a later version of saccade has written it"):
        read(path)
