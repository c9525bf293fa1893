"""One contract over the formats of logs and drives: recognition, help and errors."""

from pathlib import Path

import numpy as np
import pytest

from fuzz.targets import TARGETS
from saccade.cli import run_command
from saccade.datasets import load, load_drive, save
from saccade.datasets.drives.formats import DRIVE_FORMATS
from saccade.datasets.logs.formats import LOG_FORMATS
from saccade.datasets.recordings import is_log
from saccade.errors import ConfigError, SaccadeError
from saccade.simulation import WorldConfig, simulate_world
from support.documentation import table_of
from support.error_checks import refuses

FREIBURG = "ODOMETRY 0.1 0.5 0.05\nSENSOR 3 2.0 0.3\nODOMETRY 0 0.5 0\nSENSOR 4 2.5 -0.3\n"
LOGS = {
    "csv": "log-csv",
    "g2o": "g2o",
    "isam": "gtsam",
    "mrclam": "mrclam-odometry",
    "rosbag": "rosbag1-log",
}
DRIVES = {
    "euroc": "euroc",
    "kitti": "kitti-odometry",
    "tum-rgbd": "tum-list",
    "rosbag": "rosbag1",
    "tracks": "tracks",
    "folder": "folder-times",
    "video": "video",
}
"""Fuzzing targets by the name of the format; a format that can be written needs none."""


def make(folder, kind, table):
    """A recording in a format."""
    if kind == "freiburg":
        (folder / "sensor_data.dat").write_text(FREIBURG)
        return folder / "sensor_data.dat"
    if kind not in (LOGS if table is LOG_FORMATS else DRIVES):
        write = getattr(table[kind], "write", None)
        assert write is not None, f"add a sample of the format {kind} to this file"
        path = folder / f"log{table[kind].suffixes[0]}"
        save(path, simulate_world(WorldConfig(steps=20), 0))
        return path
    target = TARGETS[(LOGS if table is LOG_FORMATS else DRIVES)[kind]]
    target.make(folder)
    if kind in ("mrclam", "kitti", "tum-rgbd", "tracks", "folder", "euroc"):
        return (folder / target.file).parent if kind == "mrclam" else folder
    return folder / target.file


@pytest.mark.filterwarnings("ignore::saccade.LogWarning")
@pytest.mark.parametrize(
    ("kind", "table"),
    [(kind, table) for table in (LOG_FORMATS, DRIVE_FORMATS) for kind in table],
)
def test_every_format_is_recognized_and_may_be_named(tmp_path, kind, table):
    path, read = make(tmp_path, kind, table), load if table is LOG_FORMATS else load_drive
    found, named = read("auto", path), read(kind, path)
    np.testing.assert_array_equal(found.time, named.time)
    np.testing.assert_array_equal(found.control, named.control)
    assert is_log(path) == (table is LOG_FORMATS)
    assert read(read_again, path).time[-1] == found.time[-1]
    assert read(f"{__name__}:read_again", path).time[-1] == found.time[-1]
    with refuses(ConfigError, "kind: expected one of auto, ", kind, "found 'carmen'"):
        read("carmen", path)


def read_again(path):
    """A reader of one's own."""
    return (load if is_log(path) else load_drive)("auto", path)


@pytest.mark.parametrize(("command", "table"), [("slam", LOG_FORMATS), ("drive", DRIVE_FORMATS)])
def test_the_help_names_every_format(capsys, command, table):
    run_command([command, "--help"])
    shown = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert f"[choices: {', '.join(table)}]" in shown


@pytest.mark.parametrize(
    ("page", "header", "table"),
    [
        ("slam.md", ("format", "files", "written"), LOG_FORMATS),
        ("drives.md", ("kind", "recognized by"), DRIVE_FORMATS),
    ],
)
def test_the_page_lists_every_format(page, header, table):
    rows = {name.strip("`"): cells for name, *cells in table_of(page, *header)}
    assert {*rows} == {*table}
    if "written" in header:
        written = {name for name, cells in rows.items() if cells[-1].startswith("yes")}
        assert written == {name for name, form in table.items() if form.write}


def test_a_written_log_may_have_any_suffix(tmp_path):
    """The content decides where the suffix does not."""
    log = load("auto", make(tmp_path, "isam", LOG_FORMATS))
    for kind, form in LOG_FORMATS.items():
        if form.write is not None:
            written = tmp_path / f"a{form.suffixes[0]}"
            save(written, log, kind)
            again = load("auto", written.rename(tmp_path / "other.dat"))
            np.testing.assert_allclose(again.observation, log.observation, atol=1e-9)


@pytest.mark.filterwarnings("ignore::saccade.LogWarning")
def test_a_log_of_the_freiburg_course(tmp_path):
    log = load("auto", make(tmp_path, "freiburg", LOG_FORMATS))
    expected = [[0.5 * np.cos(0.1), 0.5 * np.sin(0.1), 0.15], [0.5, 0, 0]]
    np.testing.assert_allclose(log.control, expected)
    assert log.observation_pose.tolist() == [1, 2]
    assert log.landmark.tolist() == [3, 4]
    np.testing.assert_array_equal(log.observation, [[2.0, 0.3], [2.5, -0.3]])
    (tmp_path / "sensor_data.dat").write_text(FREIBURG.replace("SENSOR 4", "SENSOR"))
    with refuses(SaccadeError, "sensor_data.dat, line 4: expected 4 words, found 3"):
        load("auto", tmp_path / "sensor_data.dat")


def test_a_file_in_no_format_is_refused(tmp_path):
    Path(tmp_path / "a.log").write_text("hello\n")
    with refuses(SaccadeError, "a.log: expected a landmark log: csv (.csv)", "found none of these"):
        load("auto", tmp_path / "a.log")
    (tmp_path / "a.mat").write_bytes(b"MATLAB 5.0 MAT-file, Platform: GLNXA64" + bytes(99))
    with refuses(SaccadeError, "a.mat: expected", "found a MATLAB file; write", "writetable"):
        load("auto", tmp_path / "a.mat")
