"""The hint where an optional dependency is missing, in a clone and in an installed package."""

import json
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


def hint(extra):
    with pytest.raises(ConfigError) as caught:
        import_optional("no_such_library", extra)
    message, _, command = str(caught.value).partition("; ")
    assert message == f"{extra}: needs no_such_library, which is not installed"
    return command


@pytest.mark.parametrize("editable", [True, False, None], ids=["clone", "wheel", "sources"])
def test_the_hint_installs_the_extra(tmp_path, monkeypatch, editable):
    """By pip's own reading of the command; never by the name `saccade`, another's on PyPI."""
    extra = "parquet"
    monkeypatch.setattr(sys, "path", [str(tmp_path)])
    if editable is not None:
        info = tmp_path / "saccade-0.1.0.dist-info"
        info.mkdir()
        required = [f"Requires-Dist: {each}; extra == '{extra}'" for each in EXTRAS[extra]]
        head = ["Metadata-Version: 2.4", "Name: saccade", "Version: 0.1.0", "Requires-Dist: numpy"]
        (info / "METADATA").write_text("\n".join(head + required) + "\n")
        origin = {"url": "file:///home/me/saccade", "dir_info": {"editable": editable}}
        (info / "direct_url.json").write_text(json.dumps(origin))
    if editable is not False:
        assert hint(extra) == f"uv sync --extra {extra}"
        return
    pip, verb, *required = shlex.split(hint(extra))
    assert (pip, verb) == ("pip", "install")
    assert {Requirement(line) for line in required} == {Requirement(x) for x in EXTRAS[extra]}
