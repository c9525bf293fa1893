"""Figures, maps and scanpaths in the formats that a person asks for."""

import json
from importlib.resources import files
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pandas
import pytest
from scipy.io import loadmat

import saccade
from saccade.attention.models import AttentionModel
from saccade.cli import output
from saccade.scale.pyramid import resize
from support.commands import json_of
from support.pictures import without_figures

DATA = Path(str(files("saccade") / "data"))
HALLWAY = (DATA / "hallway_1.jpg", DATA / "hallway_2.jpg")


@pytest.fixture(scope="module")
def photos(tmp_path_factory):
    """Two small photographs."""
    folder = tmp_path_factory.mktemp("photos")
    for number, path in enumerate(HALLWAY):
        small = cv2.resize(cv2.imread(str(path)), (160, 120), interpolation=cv2.INTER_AREA)
        cv2.imwrite(str(folder / f"{number}.png"), small)
    return folder


def test_maps_at_the_size_of_the_image_are_those_of_the_model(run, photos, tmp_path, monkeypatch):
    without_figures(monkeypatch)
    kinds = ["npy", "mat", "png", "tiff"]
    words = [word for kind in kinds for word in ("--maps", kind)]
    code, out, _ = run("look", photos / "0.png", "--model", "contrast", *words, "--json")
    assert code == 0
    (row,) = json.loads(out)["images"]
    image = saccade.read_image(photos / "0.png")
    model = AttentionModel(saccade.ContrastConfig())
    layers = model.maps(image).layers
    assert len(row["maps"]) == 4 * len(layers)
    folder = tmp_path / "saccade-look" / "maps"
    for name, layer in layers.items():
        expected = resize(layer, image.shape[:2])
        assert expected.shape == (120, 160)
        np.testing.assert_array_equal(np.load(folder / name / "0.npy"), expected)
        np.testing.assert_array_equal(loadmat(folder / name / "0.mat")["map"], expected)
        tiff, png = (
            cv2.imread(str(folder / name / f"0.{kind}"), cv2.IMREAD_UNCHANGED)
            for kind in ("tiff", "png")
        )
        np.testing.assert_array_equal(tiff, expected)
        np.testing.assert_allclose(png / 65535, expected, atol=1e-5)


def test_maps_of_the_chosen_layers_alone_are_written(run, photos, tmp_path, monkeypatch):
    without_figures(monkeypatch)
    words = ("look", photos / "0.png", "--model", "contrast", "--maps", "mat", "--layers")
    code, out, _ = run(*words, "saliency,color", "--json")
    assert code == 0
    (row,) = json.loads(out)["images"]
    folder = tmp_path / "saccade-look" / "maps"
    assert {path.name for path in folder.iterdir()} == {"saliency", "color"}
    assert len(row["maps"]) == 2
    code, _, err = run(*words, "motion")
    assert code != 0
    assert "layers: expected names of saliency, " in err


def test_progress_is_printed_in_lines_where_stderr_is_no_terminal(capsys, monkeypatch):
    seconds = [0.0]
    monkeypatch.setattr(output, "time", SimpleNamespace(monotonic=lambda: seconds[0]))
    for _ in output.tracked(range(8), "scoring", 8):
        seconds[0] += 4
    lines = capsys.readouterr().err.splitlines()
    assert lines == [f"saccade: scoring: {done} of 8" for done in (3, 6)]


@pytest.fixture(scope="module")
def looked(photos, tmp_path_factory):
    """The folder and the rows of `look` with both tables."""
    out = tmp_path_factory.mktemp("looked")
    words = ["look", photos, "--format", "csv", "--length", 4]
    with pytest.MonkeyPatch.context() as monkeypatch:
        without_figures(monkeypatch)
        return out, json_of(*words, "--out", out)


def test_scanpaths_are_a_tidy_table(looked):
    out, told = looked
    assert set(told["files"]) == {"scanpaths_csv", "samples_csv"}
    assert not list(out.glob("*.npz"))
    table = pandas.read_csv(out / "scanpaths.csv")
    for row in told["images"]:
        own = table[table.image == Path(row["image"]).name]
        assert own["index"].tolist() == list(range(len(row["scanpath"])))
        expected = np.array(row["scanpath"])
        np.testing.assert_allclose(own[["x", "y"]], expected[:, :2])
        np.testing.assert_allclose(own.onset_ms, 1000 * expected[:, 2])
        np.testing.assert_allclose(own.saliency, expected[:, 3], atol=1e-6)  # six decimals
        np.testing.assert_allclose(own.duration_ms[:-1], 1000 * np.diff(expected[:, 2]))
        assert np.isnan(own.duration_ms.iloc[-1])
    samples = pandas.read_csv(out / "samples.csv")
    assert samples.groupby(["image", "subject"]).size().tolist() == [4] * 200
    assert samples.notna().all(axis=None)


@pytest.mark.parametrize("command", ["fixations", "scanpaths"])
def test_fixations_on_absent_images_can_be_left_out(run, photos, tmp_path, command):
    names = ("0.png", "1.png", "absent.png")
    rows = [
        f"{name},{v},{k},{20 + 9 * v},{30 + k}" for name in names for v in (0, 1) for k in (0, 1, 2)
    ]
    (tmp_path / "seen.csv").write_text("\n".join(["image,viewer,index,x,y", *rows]) + "\n")
    words = ["evaluate", command, "--images", photos, "--fixations", "seen.csv"]
    code, _, err = run(*words, "--model", "symmetry")
    assert (code, err.count("\n")) == (2, 1)
    assert "1 of the 3 images of seen.csv are not in" in err
    assert "absent.png first; --only-present leaves them out" in err
    code, _, err = run(*words, "--model", "symmetry", "--only-present", "--json")
    assert code == 0, err
    assert "1 of the 3 images of seen.csv are not in" in err
