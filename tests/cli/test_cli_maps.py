"""`saccade slam --map` as a person runs it."""

import json
from pathlib import Path

import numpy as np
import pytest

import saccade
from saccade import slam
from saccade.errors import ConfigError, LogError
from support.commands import json_of

PARK = Path(saccade.__file__).parent / "data" / "victoria_park.txt"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """With a short log, and the map of it."""
    folder = tmp_path_factory.mktemp("maps")
    lines = PARK.read_text().splitlines(keepends=True)
    (folder / "park.txt").write_text("".join(lines[:300]))
    map_file = folder / "park.npz"
    row = json_of("slam", folder / "park.txt", "--out", folder / "first", "--save-map", map_file)
    assert row["map"] is None
    assert row["files"]["map"] == str(map_file)
    return folder


@pytest.mark.parametrize("mode", ["continue", "localize"])
def test_a_run_begins_with_a_map(folder, mode, tmp_path):
    row = json_of(
        *("slam", folder / "park.txt", "--map", folder / "park.npz", "--start", "log"),
        *("--mode", mode, "--out", tmp_path),
    )
    saved = slam.Slam.load(folder / "park.npz")
    assert row["map"] == str(folder / "park.npz")
    assert row["map_landmarks"] == row["map_landmarks_observed"] == len(saved.map)
    assert row["map_landmarks_new"] == 0
    assert json.loads((tmp_path / "run.json").read_text()) == row
    assert "of the map that was loaded" in (tmp_path / "report.html").read_text()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--start", "here"], r"--start: expected last, search, log or X,Y,HEADING, found 'here'"),
        (["--mode", "localize", "--save-map", "x.npz"], r"--save-map: expected --mode continue"),
    ],
)
def test_options_that_contradict_are_named(folder, options, message, tmp_path):
    with pytest.raises(ConfigError, match=message):
        json_of(
            *("slam", folder / "park.txt", "--map", folder / "park.npz", "--out", tmp_path),
            *options,
        )


def test_maps_are_merged(folder, tmp_path):
    out = tmp_path / "both.npz"
    both = (folder / "park.npz", folder / "park.npz")
    row = json_of("merge", *both, "--out", out)
    (merged,) = row["merged"]
    assert row["landmarks"] == merged["common"] == len(slam.Slam.load(out).map)
    np.testing.assert_allclose(merged["transform"], 0, atol=1e-6)
    with pytest.raises(ConfigError, match="MAPS: expected two maps or more"):
        json_of("merge", folder / "park.npz", "--out", out)


def test_a_map_with_a_warning_is_merged_only_if_asked(folder, tmp_path):
    doubtful, out = slam.Slam.load(folder / "park.npz"), tmp_path / "both.npz"
    doubtful.warning = "two landmarks may be one"
    doubtful.save(tmp_path / "doubtful.npz")
    words = ("merge", folder / "park.npz", tmp_path / "doubtful.npz", "--out", out)
    with pytest.raises(LogError, match=r"doubtful.npz: .*two landmarks may be one.*--anyway"):
        json_of(*words)
    assert not out.exists()
    row = json_of(*words, "--anyway")
    assert "two landmarks may be one" in row["warning"]
