"""What the README says can be done."""

import re
from importlib.resources import files

from conftest import ROOT


def test_the_five_lines_of_python_run(tmp_path, monkeypatch):
    (code,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    data = files("saccade") / "data"
    (tmp_path / "photo.jpg").write_bytes((data / "rocket.jpg").read_bytes())
    (tmp_path / "victoria_park.txt").write_bytes((data / "victoria_park.txt").read_bytes())
    monkeypatch.chdir(tmp_path)
    names = {}
    exec(code, names)
    assert len(names["path"]) == 10
    assert len(names["keypoints"]) > 50
    assert len(names["run"].map) == 151


def test_every_link_of_the_readme_leads_somewhere():
    links = re.findall(r"\]\(([^)]+)\)", (ROOT / "README.md").read_text())
    assert links
    assert all((ROOT / link).exists() for link in links)
