"""Files of a later version are refused; nothing is pickled."""

import ast
from pathlib import Path

import h5py
import numpy as np
import pytest

import saccade
from fuzz.targets import points
from saccade import exchange
from saccade.errors import KeypointsError
from saccade.io.files import FORMATS
from saccade.io.npz import save_arrays
from support.error_checks import refuses

LOADS = ("load", "savez", "savez_compressed", "read_array")
SOURCE = Path(saccade.__file__).parent
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


def test_nothing_is_ever_unpickled():
    """No module that does is imported; NumPy is told not to as it loads, and saves in one place."""
    loads = 0
    for path in SOURCE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [each.name for each in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            barred = {"pickle", "cloudpickle", "dill", "joblib", "marshal", "shelve"}
            assert not {name.split(".")[0] for name in names} & barred, path
            called = ast.unparse(node.func) if isinstance(node, ast.Call) else ""
            if called.startswith("np.") and called.endswith(LOADS):
                told = {word.arg: ast.unparse(word.value) for word in node.keywords}
                assert told.get("allow_pickle") == "False", f"{path}:{node.lineno}"
                loads += 1
            assert not called.startswith("np.savez"), f"{path}:{node.lineno}: save_arrays does"
    assert loads >= 1


def test_objects_are_not_pickled(tmp_path):
    arrays = {"good": np.arange(3), "bad": np.array([{}], object)}
    with pytest.raises(TypeError, match="bad: expected numbers or text, found object"):
        save_arrays(tmp_path / "a.npz", arrays)
    assert not list(tmp_path.iterdir())
    save_arrays(tmp_path / "a.npz", {"good": arrays["good"], "text": "a"}, compressed=False)
    with np.load(tmp_path / "a.npz", allow_pickle=False) as found:
        assert dict(found) == {"good": pytest.approx(arrays["good"]), "text": "a"}
