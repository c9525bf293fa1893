"""What is said where an optional dependency is missing, in a clone and in an installed package."""

import json
import re
import shlex
import sys
import tomllib

import pytest
from packaging.requirements import Requirement

from saccade.errors import ConfigError
from saccade.extras import import_optional
from support.paths import ROOT

EXTRAS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"][
    "optional-dependencies"
]
CLONE = {"url": "file:///home/me/saccade", "dir_info": {"editable": True}}
FOLDER = {"url": "file:///home/me/saccade", "dir_info": {}}
WHEEL = {"url": "file:///tmp/saccade.whl", "archive_info": {}}


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Make Python find a package `saccade` that was installed from `origin` (PEP 610)."""

    def call(origin):
        info = tmp_path / "saccade-0.1.0.dist-info"
        info.mkdir()
        required = [
            f"Requires-Dist: {line}; extra == '{extra}'"
            for extra, lines in EXTRAS.items()
            for line in lines
        ]
        head = ["Metadata-Version: 2.4", "Name: saccade", "Version: 0.1.0", "Requires-Dist: numpy"]
        (info / "METADATA").write_text("\n".join(head + required) + "\n")
        if origin is not None:
            (info / "direct_url.json").write_text(json.dumps(origin))
        monkeypatch.syspath_prepend(tmp_path)

    return call


def hint(extra):
    with pytest.raises(ConfigError) as caught:
        import_optional("no_such_library", extra)
    message, _, command = str(caught.value).partition("; ")
    assert message == f"{extra}: needs no_such_library, which is not installed"
    return command


@pytest.mark.parametrize("extra", EXTRAS)
def test_a_clone_is_told_to_sync(install, extra):
    install(CLONE)
    assert hint(extra) == f"uv sync --extra {extra}"


def test_sources_on_the_path_are_told_to_sync(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "path", [str(tmp_path)])
    assert hint("parquet") == "uv sync --extra parquet"


@pytest.mark.parametrize("origin", [None, FOLDER, WHEEL], ids=["index", "folder", "wheel"])
@pytest.mark.parametrize("extra", EXTRAS)
def test_an_installed_package_is_told_what_to_install(install, extra, origin):
    """By pip's own reading of the command; never by the name `saccade`, another's on PyPI."""
    install(origin)
    pip, verb, *required = shlex.split(hint(extra))
    assert (pip, verb) == ("pip", "install")
    assert {Requirement(line) for line in required} == {Requirement(x) for x in EXTRAS[extra]}


def test_every_extra_that_the_sources_name_exists():
    sources = "".join(path.read_text("utf-8") for path in (ROOT / "src").rglob("*.py"))
    named = set(re.findall(r'import_optional\("[^"]+", "([^"]+)"\)', sources))
    assert len(named) > 5
    assert named <= set(EXTRAS)


@pytest.mark.parametrize("path", ["README.md", *(p for p in ROOT.glob("docs/**/*.md"))], ids=str)
def test_no_page_installs_the_other_project_of_this_name(path):
    text = (ROOT / path).read_text(encoding="utf-8")
    assert not re.search(r"pip install '?saccade\b", text)
    assert set(re.findall(r"uv sync --extra (\w+)", text)) <= set(EXTRAS)
