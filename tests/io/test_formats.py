"""What the first release wrote is read, what a later one writes is refused."""

import ast
import json
import shutil
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pyarrow.parquet as pq
import pytest

import saccade
from fuzz.targets import a_log, points
from saccade import SiftConfig, exchange, slam
from saccade.batch.dataset import read_manifest
from saccade.batch.storage import Store
from saccade.datasets import load
from saccade.datasets.drives.calibration import read_calibration
from saccade.errors import ConfigError, KeypointsError
from saccade.io.files import FORMATS
from saccade.io.npz import save_arrays
from saccade.settings import load_settings
from support.error_checks import refuses

FIRST = Path(__file__).parent.parent / "data" / "release-0.1"
LOADS = ("load", "savez", "savez_compressed", "read_array")
SOURCE = Path(saccade.__file__).parent


@pytest.mark.parametrize("suffix", ["npz", "csv", "h5"])
def test_points_of_the_first_release(suffix):
    read = {
        "npz": exchange.read_npz,
        "csv": exchange.read_csv,
        "h5": lambda path: exchange.read_hdf5(path)["a.png"],
    }[suffix]
    found, expected = read(FIRST / f"points.{suffix}"), points()
    for name in ("xy", "size", "angle", "response", "octave"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), atol=1e-6)
    if suffix != "csv":
        np.testing.assert_array_equal(found.descriptors, expected.descriptors)


@pytest.mark.parametrize("name", ["log.csv", "log.g2o", "log.isam", "log.graph"])
def test_logs_of_the_first_release(name):
    found, expected = load("auto", FIRST / name), a_log()
    np.testing.assert_allclose(found.control, expected.control, atol=1e-9)
    np.testing.assert_allclose(found.observation, expected.observation, atol=1e-9)
    _, numbers = np.unique(found.landmark, return_inverse=True)
    np.testing.assert_array_equal(numbers, expected.landmark)


def test_settings_of_the_first_release():
    expected = replace(
        SiftConfig.lowe2004(), ranking="signal-to-noise"
    )  # which it did not have: the default
    assert load_settings("sift", path=FIRST / "sift.toml") == expected
    assert read_calibration(FIRST / "camera.toml").camera.baseline == 0.2


def newer_points(folder, kind):
    """A file of points that a later release has written."""
    path = folder / f"points.{kind}"
    shutil.copy(FIRST / f"points.{kind}", path)
    if kind == "npz":
        with np.load(path) as arrays:
            np.savez(path, **{**arrays, "format": np.array(FORMATS["points"] + 1)})
    elif kind == "h5":
        with h5py.File(path, "a") as file:
            file.attrs["saccade_format"] = FORMATS["points"] + 1
    else:
        table = pq.read_table(path)
        note = json.dumps({"images": ["a.png"], "format": FORMATS["points"] + 1})
        pq.write_table(table.replace_schema_metadata({"saccade": note}), path)
    return path


@pytest.mark.parametrize(
    ("kind", "read"),
    [
        ("npz", exchange.read_npz),
        ("h5", exchange.read_hdf5),
        ("parquet", exchange.read_parquet),
    ],
)
def test_points_of_a_later_release_are_refused(tmp_path, kind, read):
    path = newer_points(tmp_path, kind)
    with refuses(KeypointsError, str(path), "a later version of saccade has written it"):
        read(path)


def test_a_folder_of_a_later_release_is_refused(tmp_path):
    (tmp_path / "manifest.json").write_text(json.dumps({"format": 99}))
    with refuses(ConfigError, "manifest.json", "a later version of saccade has written it"):
        read_manifest(Store(tmp_path))


def test_a_checkpoint_that_was_changed_or_is_of_another_version_is_said(tmp_path, caplog):
    path = tmp_path / "run.npz"
    slam.run(a_log(), checkpoint=slam.Checkpoint(path, None))
    with np.load(path) as saved:
        arrays = dict(saved)
    changed = {name: values for name, values in arrays.items() if values.dtype.kind == "f"}
    name = max(changed, key=lambda each: changed[each].size)
    for word, odd in (
        ("broken", {name: changed[name][:-1]}),
        ("another version", {"format": np.array(99)}),
    ):
        caplog.clear()
        np.savez(path, **{**arrays, **odd})
        slam.run(a_log(), checkpoint=slam.Checkpoint(path))
        assert word in caplog.text


@pytest.mark.parametrize("command", ["slam"])
def test_results_say_their_format(run, tmp_path, command):
    assert run(command, FIRST / "log.csv", "-o", "out", "--json")[0] == 0
    assert json.loads((tmp_path / "out" / "run.json").read_text())["format"] == FORMATS["run"]


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
