"""What the pages say can be done."""

import importlib.util
import re
from importlib.resources import files
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from saccade import exchange
from saccade.datasets import save_drive
from saccade.datasets.drives.calibration import read_calibration
from support.documentation import PAGES, code_of, prose_of
from support.extraction import check_whole, extract_here, photographs
from support.paths import ROOT
from support.small_drive import small_drive

DOCS = ROOT / "docs"
PAGE = (DOCS / "keypoints.md").read_text(encoding="utf-8")
SECTIONS = dict(zip(*[iter(re.split(r"^#+ (.+)$", PAGE, flags=re.MULTILINE)[1:])] * 2, strict=True))
OF_KEYPOINTS = {
    "Interest points": lambda names: names["checked"].inliers.mean() > 0.6,
    "Coming from scikit-image": lambda names: (
        len(names["points"]) > 50 and names["described"].descriptors.any(axis=1).all()
    ),
    "External points": lambda names: (
        len(names["dense"]) == len(names["grid"]) < len(names["turned"])
    ),
    "Settings": lambda names: (
        ((names["inside"].xy[:, 0] > 99) & (names["inside"].xy[:, 0] < 300)).all()
        and len(names["fast"]) < 0.6 * len(names["plain"])
        and len(names["strongest"]) == len(names["spread"]) == 200
    ),
}
"""What holds when the code of a section has run."""
OF_PAGES = {
    "boolean-maps.md": lambda names: (
        names["maps"].saliency.max() == names["source"].saliency.max() == 1
    ),
    "fitting.md": lambda names: (
        names["model"].features == ("attention", "border")
        and (names["maps"].faces is None) == (names["detector"] is None)
    ),
    "image.md": lambda names: names["image"].shape == (427, 640, 3),
    "attention.md": lambda names: (
        len(names["path"]) == 10 and names["contrast"].saliency.max() == 1
    ),
    "scanpaths.md": lambda names: (
        names["drawn"].xy.shape == (100, 10, 2)
        and abs(names["chance"].sum() - 1) < 1e-9
        and len(names["logs"]) == 10
    ),
    "matching.md": lambda names: (
        len(names["right"]) > 50 < names["each"].verification.inliers.sum()
    ),
    "exchange.md": lambda names: (
        len(names["database"].matches["left.jpg", "right.jpg"]) == len(names["pairs"]) > 50
        and len(names["found"]["left.jpg/right.jpg"][0]) == len(names["pairs"])
    ),
    "viewing.md": lambda names: Path("points.png").stat().st_size > 100_000,
    "map-files.md": lambda names: (
        len(names["localized"].map) == len(names["result"].map)
        and (names["localized"].session == 0).all()
        and len(names["merged"].common) == len(names["robot"].ekf)
        and abs(names["merged"].transform).max() < 1e-6
    ),
    "drive-simulation.md": lambda names: (
        names["frame"].image.shape == (240, 320)
        and len(names["log"].truth) == len(names["log"].time)
    ),
    "gaze.md": lambda names: (
        len(names["result"].trajectory) == 12 and names["control"].decisions[-1].pan != 0
    ),
    "live.md": lambda names: (
        12 < len(names["live"].ekf) <= 20 and (names["step"].association >= 0).all()
    ),
    "coming-from/opencv.md": lambda names: (
        len(names["points"]) == len(names["keypoints"]) == 200
        and len(names["described"]) > 100
        and np.allclose(names["points"][0].pt, names["keypoints"].xy[0])
        and names["mask"].sum() > 50 < names["checked"].inliers.sum()
        and len(names["matched"]) > 200
    ),
    "coming-from/hloc.md": lambda names: (
        len(names["run"].matched[0].indices) > 50
        and exchange.read_hloc_matches(names["matches"]).keys() == {"left.jpg/right.jpg"}
        and names["pairs"].read_text() == "left.jpg right.jpg\n"
    ),
    "coming-from/colmap.md": lambda names: (
        len(names["described"]) == len(names["theirs"]) > 100
        and names["database"].shapes[names["one"]] == names["shapes"][names["one"]][:2]
    ),
    "coming-from/saliencytoolbox.md": lambda names: len(names["path"]) == 10,
    "coming-from/mrpt.md": lambda names: (
        len(names["run"].map) >= 151 and len(names["ekf"]) == 1 and names["innovation"].nis < 6
    ),
    "coming-from/pythonrobotics.md": lambda names: (
        len(names["run"].map) == 1 and names["run"].trajectory.pose[-1, 2] > 0.4
    ),
}
"""The same of whole pages, whose blocks are run one after the other."""


PEERS = re.compile(r"^(?:import|from) (skimage|pycolmap)", re.M)


def each(texts):
    """Their names as parameters, those marked whose code needs a peer."""
    peer = pytest.mark.peer
    return [
        pytest.param(name, marks=[peer] if PEERS.search(text) else [])
        for name, text in texts.items()
    ]


def run_code(text, folder):
    """The names that the code leaves, run in a folder with photographs and a log."""
    blocks = code_of(text)
    for library in PEERS.findall("\n".join(blocks)):
        if importlib.util.find_spec(library) is None:
            pytest.skip(f"{library}, the peer, is not installed")
    data = files("saccade") / "data"
    (folder / "photos").mkdir()
    for number, name in enumerate(("left.jpg", "right.jpg"), 1):
        photo = (data / f"hallway_{number}.jpg").read_bytes()
        (folder / name).write_bytes(photo)
        (folder / "photos" / name).write_bytes(photo)
    (folder / "pairs.txt").write_text("left.jpg right.jpg\n")
    (folder / "photo.jpg").write_bytes((data / "rocket.jpg").read_bytes())
    (folder / "mine.toml").write_text('features = ["attention", "border"]\nweights = [1.2, 1.0]\n')
    (folder / "victoria_park.txt").write_bytes((data / "victoria_park.txt").read_bytes())
    names = {}
    for block in blocks:
        exec(block, names)
    return names


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_lists_and_tables_stand_apart_from_what_is_above(page):
    """Else they are set as a paragraph, signs and all."""
    lines = prose_of(page).splitlines()
    for above, line in pairwise(lines):
        begins = re.match(r"- |\|", line) and re.match(r"[^\s\-|]", above)
        assert not begins, f"{page.name}: {above!r} above {line!r}"


def test_every_section_with_code_is_run():
    assert {name for name, text in SECTIONS.items() if code_of(text)} == OF_KEYPOINTS.keys()


def test_every_page_with_code_is_run():
    """The others have tests of their own; that of the README is also the home page's."""
    with_code = {page for page in PAGES if code_of(page.read_text(encoding="utf-8"))}
    elsewhere = {"keypoints", "symmetry", "drives", "extract", "slam", "system"}
    named = {DOCS / name for name in OF_PAGES} | {DOCS / f"{name}.md" for name in elsewhere}
    assert with_code == named
    assert '--8<-- "README.md:ten-lines"' in (DOCS / "index.md").read_text()


@pytest.mark.parametrize("name", each({name: SECTIONS[name] for name in OF_KEYPOINTS}))
def test_the_code_of_a_section_runs(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert OF_KEYPOINTS[name](run_code(SECTIONS[name], tmp_path))


@pytest.mark.parametrize("name", each({name: (DOCS / name).read_text() for name in OF_PAGES}))
def test_the_code_of_a_page_runs(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert OF_PAGES[name](run_code((DOCS / name).read_text(encoding="utf-8"), tmp_path))


def test_the_code_of_the_page_on_symmetry_runs(tmp_path, monkeypatch):
    (code,) = code_of((ROOT / "docs" / "symmetry.md").read_text(encoding="utf-8"))
    photo = files("saccade") / "data" / "rocket.jpg"
    (tmp_path / "photo.jpg").write_bytes(photo.read_bytes())
    monkeypatch.chdir(tmp_path)
    names = {}
    exec(code, names)
    assert names["attention"].saliency.max() == names["maps"].saliency.max() == 1
    assert len(names["pairs"]) > 3
    assert len(names["points"]) > 100
    assert len(names["regions"]) == 50


def test_the_code_of_the_page_on_drives_runs(tmp_path, monkeypatch):
    page = (ROOT / "docs" / "drives.md").read_text(encoding="utf-8")
    (code,) = code_of(page)
    (settings,) = re.findall(r"```toml\n(.*?)```", page, re.DOTALL)
    save_drive(tmp_path / "kitti" / "07", small_drive())
    monkeypatch.chdir(tmp_path)
    names = {}
    exec(code, names)
    assert names["frame"].image.shape == (24, 32)
    assert (tmp_path / "copy" / "image_1" / "000004.png").exists()
    (tmp_path / "camera.toml").write_text(settings)
    assert read_calibration(tmp_path / "camera.toml").camera.position[2] == 0.7


def test_the_code_of_the_page_on_many_images_runs(tmp_path, monkeypatch):
    """As it stands there: in DuckDB, Polars and pandas."""
    page = (ROOT / "docs" / "extract.md").read_text(encoding="utf-8")
    photographs(tmp_path / "photos", 5)
    extract_here(tmp_path / "photos", tmp_path / "features")
    rows = check_whole(tmp_path / "features")
    monkeypatch.chdir(tmp_path)
    names = {}
    for block in code_of(page):
        exec(block, names)
    most = max(rows.values(), key=len)
    assert names["strongest"][0][1:] == (len(most), most.response.max())
    assert names["failed"].fetchall() == []
    assert len(names["large"]) == sum((each["size"] > 8).sum() for each in rows.values())
    every = np.concatenate([each.descriptors for each in names["keypoints"].values()])
    for form in ("of_all", "as_array"):
        np.testing.assert_array_equal(sorted(names[form].tolist()), sorted(every.tolist()))
    assert names["descriptors"].shape == (len(names["photo"]), 128)
