"""What the pages say can be done."""

import importlib.util
import re
from importlib.resources import files

import pytest

from conftest import ROOT
from extracting import check_whole, extract_here, photographs
from saccade.datasets import save_drive
from saccade.datasets.camera_file import read_calibration
from test_drive_writing import small_drive

PAGE = (ROOT / "docs" / "keypoints.md").read_text(encoding="utf-8")
SECTIONS = dict(zip(*[iter(re.split(r"^#+ (.+)$", PAGE, flags=re.MULTILINE)[1:])] * 2, strict=True))
EXPECTED = {
    "Interest points": lambda names: names["checked"].inliers.mean() > 0.6,
    "Coming from OpenCV": lambda names: (
        len(names["points"]) == len(names["keypoints"]) == 200 and len(names["described"]) > 100
    ),
    "Coming from scikit-image": lambda names: (
        len(names["pairs"]) > 50 and names["described"].descriptors.any(axis=1).all()
    ),
    "Points from elsewhere": lambda names: (
        len(names["dense"]) == len(names["grid"]) < len(names["turned"])
    ),
    "Settings": lambda names: (
        ((names["inside"].xy[:, 0] > 99) & (names["inside"].xy[:, 0] < 300)).all()
        and len(names["fast"]) < 0.6 * len(names["plain"])
        and len(names["strongest"]) == len(names["spread"]) == 200
    ),
    "Verification": lambda names: len(names["right"]) > 50,
    "Exchange": lambda names: (
        len(names["database"].matches["left.jpg", "right.jpg"]) == len(names["pairs"]) > 50
    ),
}
"""What holds when the code of a section has run."""


def code_of(section):
    return re.findall(r"```python\n(.*?)```", section, re.DOTALL)


def test_every_section_with_code_is_run():
    assert {name for name, text in SECTIONS.items() if code_of(text)} == EXPECTED.keys()


@pytest.mark.parametrize("name", EXPECTED)
def test_the_code_of_a_section_runs(name, tmp_path, monkeypatch):
    blocks = code_of(SECTIONS[name])
    for library in re.findall(r"(?:import|from) (skimage|pycolmap)", "".join(blocks)):
        if importlib.util.find_spec(library) is None:
            pytest.skip(f"{library}, the peer, is not installed")
    data = files("saccade") / "data"
    for number, photo in enumerate(("left.jpg", "right.jpg"), 1):
        (tmp_path / photo).write_bytes((data / f"hallway_{number}.jpg").read_bytes())
    monkeypatch.chdir(tmp_path)
    names = {}
    for block in blocks:
        exec(block, names)
    assert EXPECTED[name](names)


def test_the_code_of_the_page_on_symmetry_runs(tmp_path, monkeypatch):
    (code,) = code_of((ROOT / "docs" / "symmetry.md").read_text(encoding="utf-8"))
    photo = files("saccade") / "data" / "rocket.jpg"
    (tmp_path / "photo.jpg").write_bytes(photo.read_bytes())
    monkeypatch.chdir(tmp_path)
    names = {}
    exec(code, names)
    assert names["both"].saliency.max() == names["maps"].saliency.max() == 1
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
    assert read_calibration(tmp_path / "camera.toml").camera.place[2] == 0.7


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
    assert names["descriptors"].shape == (len(names["photo"]), 128)
