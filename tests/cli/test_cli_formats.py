"""Figures, maps and scanpaths in the formats that a person asks for."""

import json
from importlib.resources import files
from pathlib import Path

import cv2
import numpy as np
import pandas
import pytest
from scipy.io import loadmat

import saccade
from saccade.attention.models import AttentionModel
from saccade.scale.pyramid import resize
from saccade.viewing import save_figure
from support.circular_log import simulate
from support.commands import json_of

DATA = Path(str(files("saccade") / "data"))
HALLWAY = (DATA / "hallway_1.jpg", DATA / "hallway_2.jpg")
STARTS = {"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}


@pytest.fixture(scope="module")
def photos(tmp_path_factory):
    """Two small photographs."""
    folder = tmp_path_factory.mktemp("photos")
    for number, path in enumerate(HALLWAY):
        small = cv2.resize(cv2.imread(str(path)), (160, 120), interpolation=cv2.INTER_AREA)
        cv2.imwrite(str(folder / f"{number}.png"), small)
    return folder


def assert_figure(path, *formats):
    """The file of the first format is named, and each is there."""
    assert Path(path).suffix == f".{formats[0]}"
    for each in formats:
        assert Path(path).with_suffix(f".{each}").read_bytes().startswith(STARTS[each])
    for other in STARTS.keys() - set(formats):
        assert not Path(path).with_suffix(f".{other}").exists()


def test_figures_of_images_have_the_formats_asked_for(run, photos):
    words = ["--format", "pdf", "--format", "svg", "--json"]
    looked = run("look", photos / "0.png", "--format", "svg", "--model", "contrast", "--json")[1]
    (look,) = json.loads(looked)["images"]
    assert_figure(look["picture"], "svg")
    assert Path(look["arrays"]).exists()
    detected = run("detect", photos / "0.png", "--detector", "must", "--max", 5, *words)[1]
    (detect,) = json.loads(detected)["images"]
    assert_figure(detect["picture"], "pdf", "svg")
    assert_figure(detect["pairs"], "pdf", "svg")
    assert Path(detect["arrays"]).exists()
    text = Path(detect["picture"]).with_suffix(".svg").read_text()
    assert "5 interest points" in text  # as text, which other programs can edit


def test_figures_of_runs_have_the_formats_asked_for(run, rng, tmp_path):
    saccade.datasets.save(tmp_path / "log.csv", simulate(rng, steps=12)[0])
    words = ["--figure-format", "svg", "--figure-format", "png"]
    row = json.loads(run("slam", "log.csv", "--no-film", *words, "--json")[1])
    assert_figure(row["files"]["picture"], "svg", "png")
    assert_figure(row["files"]["innovation_picture"], "svg", "png")
    tum = "saccade-slam/trajectory.tum"
    code, _, _ = run("evaluate", "trajectory", tum, "--truth", tum, "--figure", "a.pdf")
    assert code == 0
    assert_figure("a.pdf", "pdf")
    code, _, err = run("evaluate", "trajectory", tum, "--truth", tum, "--figure", "a.gif")
    assert (code, err.count("\n")) == (2, 1)
    assert "Expected a .png, .svg or .pdf, found a.gif" in err


@pytest.mark.parametrize("suffix", STARTS)
def test_a_figure_is_the_same_to_the_byte(tmp_path, suffix):
    figures = [tmp_path / f"{number}.{suffix}" for number in range(2)]
    image = np.random.default_rng(5).random((40, 60, 3)).astype(np.float32)
    for path in figures:
        save_figure(saccade.viewing.keypoint_figure(image, saccade.Sift()(image)), path)
    assert figures[0].read_bytes() == figures[1].read_bytes()


def test_maps_at_the_size_of_the_image_are_those_of_the_model(run, photos, tmp_path):
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


@pytest.fixture(scope="module")
def looked(photos, tmp_path_factory):
    """The folder and the rows of `look` with both tables."""
    out = tmp_path_factory.mktemp("looked")
    words = ["look", photos, "--format", "csv", "--format", "mat", "--fixations", 4]
    return out, json_of(*words, "--out", out)


def test_scanpaths_are_a_tidy_table(looked):
    out, told = looked
    assert set(told["files"]) == {
        f"{stem}_{kind}" for stem in ("scanpaths", "samples") for kind in ("csv", "mat")
    }
    assert not list(out.glob("*.npz"))
    table = pandas.read_csv(out / "scanpaths.csv")
    for row in told["images"]:
        own = table[table.image == Path(row["image"]).name]
        assert own["index"].tolist() == list(range(len(row["scanpath"])))
        expected = np.array(row["scanpath"])
        np.testing.assert_allclose(own[["x", "y"]], expected[:, :2])
        np.testing.assert_allclose(own.onset_ms, 1000 * expected[:, 2])
        np.testing.assert_allclose(own.saliency, expected[:, 3])
        np.testing.assert_allclose(own.duration_ms[:-1], 1000 * np.diff(expected[:, 2]))
        assert np.isnan(own.duration_ms.iloc[-1])
    samples = pandas.read_csv(out / "samples.csv")
    assert samples.groupby(["image", "subject"]).size().tolist() == [4] * 200
    assert samples.notna().all(axis=None)


@pytest.mark.parametrize("stem", ["scanpaths", "samples"])
def test_matlab_reads_the_same_fixations(looked, stem):
    out, _ = looked
    table = pandas.read_csv(out / f"{stem}.csv")
    cells = loadmat(out / f"{stem}.mat", simplify_cells=True)["fixations"]
    rows = []
    for image in cells:
        subjects = image["subjects"]
        for eye in [subjects] if isinstance(subjects, dict) else subjects:
            keys = ("x", "y", "duration", "onset_ms", "saliency")
            columns = [np.atleast_1d(eye[f"fix_{key}"]) for key in keys]
            numbers = range(len(columns[0]))
            rows += [
                (image["img"], eye["subject"], k, *(column[k] for column in columns))
                for k in numbers
            ]
    pandas.testing.assert_frame_equal(pandas.DataFrame(rows, columns=table.columns), table)


def test_fixations_on_absent_images_can_be_left_out(run, photos, tmp_path):
    rows = [
        f"{name},{v},{k},{20 + 9 * v},{30 + k}"
        for name in ("0.png", "1.png", "absent.png")
        for v in (0, 1)
        for k in (0, 1, 2)
    ]
    (tmp_path / "seen.csv").write_text("\n".join(["image,viewer,index,x,y", *rows]) + "\n")
    data = ["--images", photos, "--fixations", "seen.csv", "--model", "symmetry"]
    for command in ("fixations", "scanpaths"):
        code, _, err = run("evaluate", command, *data)
        assert (code, err.count("\n")) == (2, 1)
        assert "1 of the 3 images of seen.csv are not in" in err
        assert "absent.png first; --only-present leaves them out" in err
        code, out, err = run("evaluate", command, *data, "--only-present", "--json")
        assert code == 0, err
        assert "1 of the 3 images of seen.csv are not in" in err
        if command == "fixations":
            assert set(json.loads(out)["images"]) == {"0.png", "1.png"}
    (tmp_path / "none.csv").write_text("image,viewer,index,x,y\nc.png,0,1,2,3\n")
    data[3] = "none.csv"
    code, _, err = run("evaluate", "fixations", *data, "--only-present")
    assert (code, err.count("\n")) == (2, 1)
    assert "1 of the 1 images of none.csv are not in" in err
