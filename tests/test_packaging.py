"""What is shipped: whole, nothing else, and under licences that ask for nothing in return."""

import os
import re
import shutil
import subprocess
import sys
import tarfile
import zipfile
from importlib.metadata import distribution
from pathlib import Path

import pytest
from packaging.requirements import Requirement

import saccade
from support.limits import TIMEOUT
from support.paths import ROOT

SOURCE = ROOT / "src" / "saccade"
PERMISSIVE = {
    *("0BSD", "Apache-2.0", "Apache-2.0 WITH LLVM-exception", "BSD-2-Clause", "BSD-3-Clause"),
    *("CC0-1.0", "ISC", "MIT", "MIT-CMU", "PSF-2.0", "Zlib"),
}
"""Licences, after SPDX, that ask for no more than to be named."""
SAID = {
    "Apache 2.0": "Apache-2.0",
    "Apache Software License": "Apache-2.0",
    "BSD License": "BSD-3-Clause",
    "ISC License (ISCL)": "ISC",
    "MIT License": "MIT",
    "Python Software Foundation License": "PSF-2.0",
}
"""What older packages say instead."""
EITHER = {"python-dateutil"}
"""Packages whose several licences are alternatives."""


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """A wheel made from the sdist, and the sdist; or those that are in $SACCADE_DIST."""
    if "SACCADE_DIST" in os.environ:
        out = Path(os.environ["SACCADE_DIST"])
        (wheel,), (sdist,) = out.glob("*.whl"), out.glob("*.tar.gz")
        return wheel, sdist
    uv = shutil.which("uv")
    if uv is None:
        pytest.skip("uv, which builds, is not installed")
    out = tmp_path_factory.mktemp("dist")
    done = subprocess.run(
        [uv, "build", "--quiet", "--python", sys.executable, "--out-dir", str(out), str(ROOT)],
        capture_output=True,
        text=True,
        check=False,
        timeout=TIMEOUT,
    )
    assert done.returncode == 0, done.stderr
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
    info = f"saccade-{saccade.__version__}.dist-info"
    assert {name for name in names if not name.startswith(info)} == shipped
    assert {"saccade/py.typed", "saccade/viewing/web/charts.js"} < shipped
    licences = {name.removeprefix(f"{info}/licenses/") for name in names if "/licenses/" in name}
    assert licences == {"LICENSE", "src/saccade/data/README.md"}


def test_the_citation_and_the_package_are_of_one_version():
    (cited,) = re.findall(r"^version: (.+)$", (ROOT / "CITATION.cff").read_text("utf-8"), re.M)
    assert cited == saccade.__version__


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


def test_the_core_install_asks_for_nothing_in_return():
    """Every package that the core install brings, by what its own metadata says."""
    for name in core_packages():
        licences = licences_of(name)
        good = [licence in PERMISSIVE for licence in licences]
        assert any(good) if name in EITHER else good and all(good), f"{name}: {licences}"


def core_packages():
    met, found = set(), ["saccade"]
    while found:
        name = found.pop()
        if name in met:
            continue
        met.add(name)
        for line in distribution(name).requires or ():
            needed = Requirement(line)
            if needed.marker is None or needed.marker.evaluate({"extra": ""}):
                found.append(needed.name.lower())
    assert len(met) > 15
    return sorted(met)


def licences_of(name):
    told = distribution(name).metadata
    if told.get("License-Expression"):
        either, *_ = told["License-Expression"].split(" OR ")
        return either.split(" AND ")
    marks = [mark.rpartition(" :: ")[2] for mark in told.get_all("Classifier", ())]
    said = [SAID[mark] for mark in marks if mark in SAID]
    words = told.get("License") or "none"
    return said or [SAID.get(words, words)]
