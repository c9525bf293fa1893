"""The wheel and the sdist are whole and hold nothing else; every picture has its license."""

import os
import re
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

import saccade
from support.paths import ROOT

SOURCE = ROOT / "src" / "saccade"


@pytest.fixture(scope="module")
def built():
    """The wheel and the sdist in $SACCADE_DIST, as `nox -s wheel` builds them."""
    if "SACCADE_DIST" not in os.environ:
        pytest.skip("nothing is built; nox -s wheel builds and runs this")
    out = Path(os.environ["SACCADE_DIST"])
    (wheel,), (sdist,) = out.glob("*.whl"), out.glob("*.tar.gz")
    return wheel, sdist


def test_the_wheel_holds_the_package_and_nothing_else(built):
    shipped = {
        path.relative_to(SOURCE.parent).as_posix()
        for path in SOURCE.rglob("*")
        if path.is_file() and path.parent.name != "__pycache__" and path.suffix[:3] != ".nb"
    }
    with zipfile.ZipFile(built[0]) as wheel:
        names = set(wheel.namelist())
        assert wheel.read("saccade/data/coffee.jpg") == (SOURCE / "data/coffee.jpg").read_bytes()
    info = f"pysaccade-{saccade.__version__}.dist-info"
    assert {name for name in names if not name.startswith(info)} == shipped
    assert {"saccade/py.typed", "saccade/viewing/web/charts.js"} < shipped
    licences = {name.removeprefix(f"{info}/licenses/") for name in names if "/licenses/" in name}
    assert licences == {"LICENSE", "src/saccade/data/README.md"}


def test_version_and_date_agree():
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    version, date = re.search(r"^## (\S+) \((.+)\)$", changelog, re.MULTILINE).groups()
    assert version == saccade.__version__
    assert f"\nversion: {version}\ndate-released: {date}\n" in citation


def test_the_page_names_the_oldest_libraries_that_are_required():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    required = [*project["dependencies"], *project["optional-dependencies"]["parquet"]]
    least = dict(each.split(">=") for each in required)
    page = (ROOT / "docs" / "robustness.md").read_text(encoding="utf-8")
    told = re.findall(r"(OpenCV|NumPy|SciPy|Numba|Arrow) from ([\d.]*\d)", page)
    assert len(told) == 5
    for name, version in told:
        library = {"OpenCV": "opencv-python-headless", "Arrow": "pyarrow"}.get(name, name.lower())
        assert f"{least[library]}.".startswith(f"{version}."), name


def test_every_picture_that_is_shipped_has_its_licence():
    told = (SOURCE / "data/README.md").read_text(encoding="utf-8")
    for path in (SOURCE / "data").iterdir():
        assert path.name == "README.md" or f"`{path.name}`" in told, path.name


def test_the_sdist_holds_what_it_takes_to_test(built):
    with tarfile.open(built[1]) as sdist:
        names = {name.partition("/")[2] for name in sdist.getnames()}
    files = {"pyproject.toml", "LICENSE", "tests/conftest.py", "src/saccade/py.typed"}
    assert files | {"docs/robustness.md", "zensical.toml", "noxfile.py"} < names
    assert not [name for name in names if re.search(r"__pycache__|\.py[co]$|\.nb[ic]$", name)]
