"""Files of a later version are refused; nothing is pickled."""

import h5py
import numpy as np
import pytest

from fuzz.targets import points
from saccade import exchange
from saccade.errors import KeypointsError
from saccade.io.files import FORMATS
from support.error_checks import refuses

LATER = FORMATS["points"] + 1


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
    write(path, points() if write is exchange.write_npz else {"a.png": points()})
    make_newer(path)
    with refuses(KeypointsError, str(path), "a later version of saccade has written it"):
        read(path)
