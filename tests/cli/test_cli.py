"""The commands as a person runs them: what they print, write and return."""

import json
import re
import tomllib
from importlib.resources import files
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.io import savemat

import saccade
from saccade.cli.output import names_for
from saccade.cli.slam_options import SlamOptions
from saccade.settings import kinds, load_settings
from support.logs import between
from support.pictures import looks_like_a_picture, without_figures

DATA = Path(str(files("saccade") / "data"))
ROCKET = DATA / "rocket.jpg"
HALLWAY = (DATA / "hallway_1.jpg", DATA / "hallway_2.jpg")


def test_look(run, tmp_path):
    path = "--without-center-bias", "--scanpath", "winner-take-all", "--length", 4
    code, out, _ = run("look", ROCKET, *path, "--out", "looked", "--json")
    assert code == 0
    (row,) = json.loads(out)["images"]
    assert looks_like_a_picture(row["picture"])
    x, y, time, saliency = np.array(row["scanpath"]).T
    assert len(x) == 4
    assert ((x >= 0) & (x < row["width"]) & (y >= 0) & (y < row["height"])).all()
    assert (np.diff(time) > 0).all()
    maps = saccade.attention_saliency(saccade.read_image(ROCKET))
    expected = saccade.scanpath(maps, fixations=4).xy
    np.testing.assert_allclose(np.stack([x, y], 1), expected)
    with np.load(tmp_path / "looked" / "rocket.look.npz") as arrays:
        assert saliency[0] == pytest.approx(arrays["saliency"].max())
        for name, values in maps.layers.items():
            np.testing.assert_array_equal(arrays[name], values)
        np.testing.assert_allclose(arrays["scanpath_xy"], np.stack([x, y], axis=1))


def shrunken(source, path, width=160, height=120):
    """Writes a small copy of a photograph."""
    small = cv2.resize(cv2.imread(str(source)), (width, height), interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(path), small)
    return path


def test_settings_within_settings_can_be_handed_back(run, tmp_path, monkeypatch):
    without_figures(monkeypatch)
    photo = shrunken(ROCKET, tmp_path / "rocket.png")
    text = run("config", "attention", "--preset", "kootstra2010")[1]
    (tmp_path / "mine.toml").write_text(text)
    named = run("look", photo, "--preset", "kootstra2010", "--json")
    assert named[0] == 0
    path = "--without-center-bias", "--scanpath", "winner-take-all"
    assert run("look", photo, *path, "--config", "mine.toml", "--json") == named
    for broken, words in (("kind = 1", "symmetry: kind"), ("gain = -1", "symmetry: gain")):
        (tmp_path / "broken.toml").write_text(f"[symmetry]\n{broken}\n")
        code, _, err = run("look", photo, "--config", "broken.toml")
        assert code == 2
        assert f"broken.toml: {words}" in err


def test_demo_makes_a_page_of_four_results(run, tmp_path, monkeypatch):
    whole = SlamOptions.load
    monkeypatch.setattr(SlamOptions, "load", lambda *paths: between(whole(*paths), 0, 600))
    monkeypatch.setattr("saccade.cli.demo.FRAMES", 4)
    monkeypatch.setattr("saccade.workers.count_workers", lambda count: 1)
    code, out, err = run("demo")
    assert code == 0
    page = (tmp_path / "saccade-demo" / "index.html").read_text()
    assert page.count("<section") == 4
    assert "saccade-demo/index.html" in out.replace("\n", "")
    assert "try: saccade look" in err


@pytest.mark.nightly
def test_the_processes_of_the_demo_change_nothing(run, tmp_path, monkeypatch):
    for workers in (1, 2):
        monkeypatch.setattr("saccade.workers.count_workers", lambda _, n=workers: n)
        assert run("demo", "--out", f"by_{workers}")[0] == 0
    one, two = (tmp_path / f"by_{workers}" for workers in (1, 2))
    names = [each.relative_to(one) for each in one.rglob("*") if each.is_file()]
    assert {each.relative_to(two) for each in two.rglob("*") if each.is_file()} == set(names)
    for name in names:
        if name.name != "run.json":  # has the folder's name
            first, second = (_without_time((each / name).read_bytes()) for each in (one, two))
            assert first == second, name


def _without_time(page):
    return re.sub(rb"ms per frame</th><td>[\d.]+", b"", page)


@pytest.mark.parametrize("kind", kinds())
def test_config_prints_every_preset_as_toml(run, tmp_path, kind):
    code, out, _ = run("config", kind, "--all")
    assert code == 0
    presets = tomllib.loads(out)
    for name, table in presets.items():
        code, out, _ = run("config", kind, "--preset", name)
        assert (code, tomllib.loads(out)) == (0, table)
    assert run("config", kind)[1] == run("config", kind, "--preset", "default")[1]
    (tmp_path / "default.toml").write_text(run("config", kind)[1])
    assert load_settings(kind, path=tmp_path / "default.toml") == load_settings(kind)


BAD_INPUT = {
    "missing": (["look", "missing.png"], ["missing.png", "No such file"]),
    "nothing": (["look"], ["requires an argument"]),
    "no name": (["look", ""], ["empty name"]),
    "bad command": (["slan"], ['Did you mean "slam"?; see saccade --help']),
    "help of none": (["slan", "--help"], ['Did you mean "slam"?; see saccade --help']),
    "out of range": (
        ["match", *HALLWAY, "--tolerance", "0"],
        ["tolerance: expected at least 0.01"],
    ),
    "bad preset": (["look", ROCKET, "--preset", "best"], ["kootstra2010", "'best'"]),
    "bad kind": (["config", "soup"], ["contrast", "'soup'"]),
    "bad format": (["slam", DATA / "victoria_park.txt", "--kind", "x"], ["mrclam"]),
    "bad association": (
        ["slam", DATA / "victoria_park.txt", "--association", "x"],
        ["association", "'x'"],
    ),
    "unknown setting": (["detect", ROCKET, "--config", "a.toml"], ["a.toml", "'nonsense'"]),
    "other type": (["detect", ROCKET, "--config", "b.toml"], ["b.toml", "max_keypoints"]),
    "no TOML": (["detect", ROCKET, "--config", "c.toml"], ["c.toml", "expected TOML"]),
    "unwritable": (["look", ROCKET, "--out", ROCKET / "sub"], ["rocket.jpg"]),
}


@pytest.mark.parametrize("what", BAD_INPUT)
def test_bad_input_gets_one_clear_line(run, tmp_path, what):
    words, expected = BAD_INPUT[what]
    for name, text in (("a", "nonsense = 1"), ("b", 'max_keypoints = "many"'), ("c", "= 3")):
        (tmp_path / f"{name}.toml").write_text(text)
    code, out, err = run(*words)
    assert code == (1 if what == "unwritable" else 2)
    assert out == ""
    assert err.startswith("saccade: ")
    assert err.count("\n") == 1
    assert all(word in err for word in expected), err


def test_one_bad_image_does_not_stop_the_others(run, tmp_path, monkeypatch):
    without_figures(monkeypatch)
    (tmp_path / "bad.png").write_bytes(b"?")
    photo = shrunken(HALLWAY[0], tmp_path / "hallway_1.jpg")
    for words in (("detect", "--max", 5), ("look",)):
        code, out, err = run(*words, "bad.png", photo, "--out", "out", "--json")
        assert code == 1
        assert "bad.png" in err
        assert "1 of 2 images left out; out has the other results" in err
        assert [Path(row["image"]).name for row in json.loads(out)["images"]] == ["hallway_1.jpg"]
    found = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"hallway_1.keypoints.npz", "hallway_1.look.npz", "report.html"} < found


def write_video(path, frames):
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 10, (96, 64))
    for number in range(frames):
        frame = np.zeros((64, 96, 3), np.uint8)
        frame[20:36, 6 * number : 6 * number + 16] = 255
        writer.write(frame)
    writer.release()


def test_gaze_follows_what_moves_in_a_video(run, tmp_path):
    write_video(tmp_path / "moving.mp4", 8)
    code, out, _ = run("look", "moving.mp4", "--every", 2, "--json")
    assert code == 0
    (video,) = json.loads(out)["images"]
    with np.load(video["arrays"]) as arrays:
        np.testing.assert_allclose(arrays["time"], [0, 0.2, 0.4, 0.6])
        assert ((arrays["gaze"] >= 0) & (arrays["gaze"] <= (95, 63))).all()
        columns = [maps.sum(axis=0).argmax() / maps.shape[1] for maps in arrays["saliency"]]
    assert columns == sorted(columns)
    assert columns[-1] > columns[0]
    film = cv2.VideoCapture(video["film"])
    assert film.get(cv2.CAP_PROP_FRAME_COUNT) == video["frames"] == 4
    assert film.get(cv2.CAP_PROP_FPS) == 5
    assert film.get(cv2.CAP_PROP_FRAME_WIDTH) == 192


def test_images_are_folders_and_patterns(run, tmp_path):
    """Of every command that takes images; `detect` is the fastest."""
    (tmp_path / "photos").mkdir()
    for number, name in enumerate(("b.jpg", "a.jpg", "c.png")):
        shrunken(HALLWAY[number % 2], tmp_path / "photos" / name)
    (tmp_path / "photos" / "notes.txt").write_text("no image")
    code, out, _ = run("detect", "photos", "photos/*.png", "--max", 5, "--json")
    assert code == 0
    photos = json.loads(out)["images"]
    assert [Path(row["image"]).name for row in photos] == ["a.jpg", "b.jpg", "c.png"]


@pytest.fixture
def gazes(tmp_path, rng):
    """Two photographs, people who looked at their upper left, and maps that say so."""
    folder = tmp_path / "photos"
    folder.mkdir()
    rows = ["image,viewer,index,x,y"]
    for number, path in enumerate(HALLWAY):
        name = f"{number}.jpg"
        shrunken(path, folder / name, 128, 96)
        corner = 10 + 50 * number
        rows += [f"{name},{v},0,63,47" for v in range(5)]
        rows += [f"{name},{v},1,{corner + x},{8 + v}" for v, x in enumerate(rng.uniform(0, 4, 5))]
        saliency = np.zeros((96, 128), np.float32)
        saliency[:20, corner : corner + 15] = 1
        np.save(folder / f"{number}.npy", saliency)
    (tmp_path / "gazes.csv").write_text("\n".join(rows) + "\n")
    return folder


def test_evaluate_fixations_of_maps_that_a_user_brings(run, gazes):
    words = ["evaluate", "fixations", "--images", gazes, "--fixations", "gazes.csv"]
    code, out, _ = run(*words, "--model", gazes, "--json")
    assert code == 0
    found = json.loads(out)
    assert set(found["images"]) == {"0.jpg", "1.jpg"}
    assert found["mean"]["auc"] > 0.95
    assert found["mean"]["shuffled_auc"] == 1.0
    assert found["low"]["nss"] <= found["mean"]["nss"] <= found["high"]["nss"]


def test_models_are_compared(run, gazes, tmp_path):
    words = ["evaluate", "fixations", "--images", gazes, "--fixations", "gazes.csv", "--drop", 1]
    mat = tmp_path / "mat"
    mat.mkdir()
    for path in gazes.glob("*.npy"):
        savemat(mat / f"{path.stem}.mat", {"map": np.load(path)})
    models = ["--model", "contrast:itti1998", "--model", f"told={gazes}", "--model", mat]
    code, out, _ = run(*words, *models, "--references", "--json")
    assert code == 0
    found = json.loads(out)
    names = ["contrast:itti1998", "told", str(mat), "center", "shuffled", "people"]
    assert list(found["models"]) == names
    assert found["models"]["told"] == found["models"][str(mat)]
    told, first = (found["models"][name]["mean"]["auc"] for name in (names[1], names[0]))
    assert found["differences"]["told"]["mean"]["auc"] == pytest.approx(told - first)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--model", "soup"], "model: expected one of attention, contrast"),
        (["--model", "absent:run"], "absent:run: cannot be imported"),
        (["--model", "numpy:pi"], "expected a function, found float"),
        (["--model", "contrast", "--model", "contrast"], "another name for each"),
        (["--model", "a=contrast", "--model", "b=symmetry", "--preset", "itti1998"], "KIND:PRESET"),
        (["--model", "absent.toml"], "absent.toml: cannot be read"),
    ],
)
def test_models_that_are_none_are_named(run, gazes, options, words):
    code, out, err = run(
        "evaluate", "fixations", "--images", gazes, "--fixations", "gazes.csv", *options
    )
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert words in err


def test_a_model_is_fitted_and_looks(run, gazes, tmp_path, monkeypatch):
    without_figures(monkeypatch)
    with (tmp_path / "gazes.csv").open("a") as table:
        for number in (2, 3):
            (gazes / f"{number}.jpg").write_bytes((gazes / f"{number - 2}.jpg").read_bytes())
            table.write("".join(f"{number}.jpg,{v},1,{60 + v},{40 + v}\n" for v in range(3)))
    data = ["--images", gazes, "--fixations", "gazes.csv"]
    options = ["--out", "m.toml", "--folds", 2]
    code, out, _ = run("fit", *data, *options, "--json")
    assert code == 0
    names = ["fitted, by image", "fitted, by subject", "unfitted", "center", "shuffled", "people"]
    assert list(json.loads(out)["scores"]) == names
    model = saccade.load_model("m.toml")
    assert model.fitted_to == "4 images, subjects: 5"
    photo = gazes / "0.jpg"
    code, out, _ = run("look", photo, "--model", "m.toml", "--json", "--out", "looked")
    assert code == 0
    saliency = np.load("looked/0.look.npz")["saliency"]
    np.testing.assert_array_equal(saliency, model.maps(saccade.read_image(photo)).saliency)


def test_evaluate_fixations_leaves_out_who_looked_away(run, gazes, tmp_path):
    words = ["evaluate", "fixations", "--images", gazes, "--fixations", "gazes.csv"]
    before = json.loads(run(*words, "--json")[1])
    with (tmp_path / "gazes.csv").open("a") as table:
        table.write("0.jpg,6,1,-30,10\n1.jpg,6,1,128,10\n")
    code, out, err = run(*words, "--json")
    assert code == 0
    assert json.loads(out) == before
    assert "2 fixations outside their images are left out" in err
    code, _, err = run(*words, "--drop", 5)
    assert code == 2
    assert "lower --drop" in err


def test_evaluate_fixations_names_what_is_missing(run, gazes):
    words = ["evaluate", "fixations", "--images", gazes, "--fixations"]
    assert "nowhere.csv" in run(*words, "nowhere.csv")[2]
    (gazes / "1.npy").unlink()
    (gazes / "1.jpg").unlink()
    code, _, err = run(*words, "gazes.csv", "--model", gazes)
    assert code == 2
    assert "1.jpg" in err


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (KeyboardInterrupt(), 130, "interrupted"),
        (MemoryError("2 GiB"), 1, "not enough memory: 2 GiB"),
        (OSError(28, "No space left on device", "result"), 1, "result: No space left on device"),
    ],
)
def test_what_ends_a_run_is_one_line(run, monkeypatch, error, code, words):
    def ends(*_, **__):
        raise error

    monkeypatch.setattr("saccade.cli.detect.read_image", ends)
    monkeypatch.setattr("saccade.cli._discard_stdout", lambda: None)
    assert run("detect", ROCKET) == (code, "", f"saccade: {words}\n")


@pytest.mark.parametrize(
    ("paths", "names"),
    [
        (["x/a.png", "y/b.jpg"], ["a", "b"]),
        (["x/a.png", "y/a.jpg", "x/a.png"], ["x/a", "y/a"]),
        (["z/x/a.png", "z/y/a.jpg", "z/c.png"], ["x/a", "y/a", "c"]),
        (["a.png", "a.jpg"], ["a.png", "a.jpg"]),
    ],
)
def test_names_of_results_are_the_paths_of_images_where_stems_repeat(paths, names):
    assert [*names_for([Path(path) for path in paths]).values()] == names
