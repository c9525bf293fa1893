"""What the pages say can be done."""

import importlib.util
import re
from importlib.resources import files

import numpy as np
import pytest
from cyclopts import CycloptsError

from saccade import Keypoints, Scanpath, Verification
from saccade.cli import app
from saccade.datasets import save_drive
from saccade.datasets.drives.calibration import read_calibration
from saccade.errors import SaccadeError
from saccade.io.files import one_line
from support.documentation import PAGES, code_of, commands_of, shell_of
from support.extraction import check_whole, extract_here, photographs
from support.paths import ROOT
from support.small_drive import small_drive

ELSEWHERE = {"drives", "extract", "slam", "system"}
"""Pages with tests of their own."""
WHOLE = {page.stem: page.read_text("utf-8") for page in PAGES if page.stem not in ELSEWHERE}
SECTIONS = re.split(r"^#+ (.+)$", WHOLE.pop("keypoints"), flags=re.MULTILINE)[1:]
TEXTS = WHOLE | dict(zip(SECTIONS[::2], SECTIONS[1::2], strict=True))
"""What is run in one piece: pages, and sections of that on keypoints."""
PEERS = re.compile(r"^(?:import|from) (skimage|pycolmap|torch)", re.M)


LOG_LINES = 1000
"""Number of lines of the recorded log that the pages map."""


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
    log = (data / "victoria_park.txt").read_text("utf-8").splitlines(keepends=True)
    (folder / "victoria_park.txt").write_text("".join(log[:LOG_LINES]), "utf-8")
    names = {}
    for block in blocks:
        exec(block, names)
    return names


def marks_of(text):
    return [
        pytest.mark.torch if name == "torch" else pytest.mark.peer for name in PEERS.findall(text)
    ]


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=marks_of(text)) for name, text in TEXTS.items() if code_of(text)],
)
def test_the_code_of_a_page_runs_and_finds_something(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("PIL.Image.Image.show", lambda image, title: None)
    for found, value in run_code(TEXTS[name], tmp_path).items():
        if isinstance(value, Keypoints | Scanpath):
            assert len(value) > 0, found
        if isinstance(value, Verification):
            assert value.inliers.any(), found


def test_every_command_of_a_page_can_be_pasted():
    """The command line takes it as it stands: no prose behind it, no option that is gone.

    A comment has a line of its own, without quotes: the shell of macOS passes what stands behind
    a command as arguments.
    """
    pages = {page: page.read_text("utf-8") for page in (ROOT / "README.md", *PAGES)}
    lines = [(page, line) for page, text in pages.items() for line in shell_of(text)]
    wrong = [
        f"{page.name}: {line}" for page, line in lines if re.search(r"\S\s+#|^#.*[';()]", line)
    ]
    commands = [(page, each) for page, text in pages.items() for each in commands_of(text)]
    assert len(commands) > 60
    for page, (_, *words) in commands:
        try:
            app.parse_args(words, print_error=False, exit_on_error=False)
        except (CycloptsError, SaccadeError) as error:
            wrong.append(f"{page.name}: saccade {' '.join(words)}: {one_line(error)}")
    assert not wrong, "\n".join(wrong)


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
