"""One contract over all readers: a defect is refused in one line that names the file and says how.

Values that are read, and round trips, are in the tests of each format.
"""

import shutil
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from fuzz.targets import TARGETS
from saccade.datasets import load, load_drive
from saccade.datasets.fixations import read_fixations
from saccade.errors import ConfigError, DriveError, LogError, SaccadeError
from support.error_checks import refuses, result_or_refusal

FILES = [
    *("log-csv", "g2o", "isam", "toro", "gtsam", "mrclam-odometry", "mrclam-measurement"),
    *("mrclam-npz", "kitti-calib", "kitti-odometry", "kitti-poses"),
    *("tum-list", "tum-truth", "camera-toml", "folder-times", "folder-odometry", "tracks"),
    *(
        "camera-yaml",
        "mcap",
        "tracks-calib",
        "tum-poses",
        "fixations",
        "osie",
        "homography",
        "gaze",
        "video",
    ),
    *("rosbag1", "rosbag2", "rosbag2-metadata", "rosbag1-log", "rosbag2-log", "own-map"),
]
"""Targets of the fuzzer with a reader of recorded data."""
OPTIONAL = [
    *("kitti-calib", "kitti-odometry", "tum-truth", "folder-times", "folder-odometry"),
    *("camera-toml", "camera-yaml", "rosbag2-metadata", "tum-list"),
]
"""Files without which a recording is read otherwise."""
TABLES = [
    *("log-csv", "g2o", "isam", "toro", "gtsam", "mrclam-odometry", "mrclam-measurement"),
    *("kitti-odometry", "kitti-poses", "tum-list", "tum-truth", "folder-times"),
    *("folder-odometry", "tum-poses", "fixations", "gaze"),
]
"""Targets whose file is a table of text."""


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A function that gives the folder of a target's whole recording."""

    @cache
    def made(name: str) -> Path:
        folder = tmp_path_factory.mktemp("whole")
        TARGETS[name].make(folder)
        return folder

    return made


@pytest.fixture
def recording(tmp_path, whole):
    """A function that copies the recording of a target, with a change of the bytes of its file."""

    def make(name: str, change: Callable[[bytes], bytes] | None) -> tuple[object, str]:
        target, folder = TARGETS[name], tmp_path / name
        shutil.copytree(whole(name), folder)
        file = folder / target.file
        if change is None:
            file.unlink()
        else:
            file.write_bytes(change(file.read_bytes()))
        return result_or_refusal(lambda: target.read(folder))

    return make


@pytest.mark.parametrize("name", FILES)
def test_a_whole_file_is_read(recording, name):
    found, refusal = recording(name, lambda whole: whole)
    assert found is not None, refusal


@pytest.mark.parametrize("name", [name for name in FILES if name not in OPTIONAL])
def test_a_missing_file_is_named(recording, name, tmp_path):
    found, refusal = recording(name, None)
    assert found is None
    assert str(tmp_path / name) in refusal


@pytest.mark.parametrize("part", [0.0, 0.4, 0.9])
@pytest.mark.parametrize("name", FILES)
def test_a_truncated_file_is_read_or_named(recording, name, part, tmp_path):
    found, refusal = recording(name, lambda whole: whole[: int(part * len(whole))])
    assert found is not None or str(tmp_path / name) in refusal


@pytest.mark.parametrize("name", [name for name in FILES if name not in ("video")])
def test_a_file_of_another_format_is_named(recording, name):
    found, refusal = recording(name, lambda whole: bytes(range(256)) * 10)
    assert found is None
    assert TARGETS[name].file.split("/")[0] in refusal


@pytest.mark.parametrize("name", TABLES)
def test_a_cell_too_many_is_named_with_its_line(recording, name):
    found, refusal = recording(name, lambda whole: whole.rstrip() + b" 7 7,7,7\n")
    assert found is None
    assert f"{Path(TARGETS[name].file).name}, line " in refusal


NOTED = (
    *("log-csv", "g2o", "isam", "toro", "gtsam", "mrclam-odometry", "mrclam-measurement"),
    *("tum-list", "tum-truth", "folder-times", "camera-toml", "camera-yaml", "tum-poses"),
)
"""Targets whose file may have comments."""


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-be", "utf-8-sig", "cp1252"])
@pytest.mark.parametrize("name", [*TABLES, "camera-toml", "camera-yaml"])
def test_text_is_read_in_the_encodings_of_other_programs(recording, name, encoding):
    note = "# Größe, naïve\n" if name in NOTED else ""
    mark = "\ufeff" if encoding.endswith("be") else ""
    found, refusal = recording(name, lambda whole: (mark + note + whole.decode()).encode(encoding))
    assert found is not None, refusal


@pytest.mark.parametrize("name", [*TABLES, "camera-toml", "camera-yaml"])
@pytest.mark.parametrize("bad", ["Größe 1".encode("utf-16-le"), b"\x81\x8d"])
def test_text_in_no_encoding_names_the_cure(recording, name, bad):
    found, refusal = recording(name, lambda whole: bad + whole)
    assert found is None
    assert Path(TARGETS[name].file).name in refusal
    assert "save it as UTF-8" in refusal


class Format(NamedTuple):
    """A good text file, and its reader."""

    file: str
    text: str
    read: Callable[[Path], object]


CAMERA = "width = 32\nheight = 24\nfx = 20\nfy = 20\ncx = 16\nrate = 5\ncy = 12\n"
SPEEDS = "time_s,ahead_mps,turn_radps\n0,1,1\n0.2,1,1\n0.4,1,1\n"
FORMATS = {
    "csv": Format(
        "log.csv",
        "time,forward,left,turn,cov_forward_forward,cov_left_left,cov_turn_turn,"
        "landmark,range,bearing,cov_range_range,cov_bearing_bearing\n"
        "0,,,,,,,,,,,\n"
        "0,,,,,,,7,2.5,0.1,0.01,0.0001\n"
        "1,0.5,0,0.1,0.01,0.01,0.001,,,,,\n"
        "1,,,,,,,,3.5,-0.1,0.01,0.0001\n",
        lambda path: load("auto", path),
    ),
    "isam": Format(
        "log.txt",
        "ODOMETRY 0 1 1 0 1.5707963 0.01 0 0 0.02 0.001 0.03\n"
        "LANDMARK 1 2 3 4 0.5 0.1 0.4\n"
        "ODOMETRY 1 3 2 0.5 0 0.01 0 0 0.02 0 0.03\n"
        "LANDMARK 3 7 -1 0 0.5 0 0.4\n",
        lambda path: load("auto", path),
    ),
    "mrclam": Format(
        "Robot1_Odometry.dat", "1 2 3\n5 2 1\n", lambda path: load("mrclam", path.parent)
    ),
    "camera": Format("camera.toml", CAMERA, lambda path: load_drive("folder", path.parent)),
    "odometry": Format("odometry.csv", SPEEDS, lambda path: load_drive("folder", path.parent)),
    "tum": Format(
        "rgb.txt", "1 rgb/0.png\n2 rgb/0.png\n", lambda path: load_drive("tum-rgbd", path.parent)
    ),
    "table": Format("seen.csv", "image,subject,index,x,y\na,0,0,1,2\na,0,1,3,2\n", read_fixations),
    "tobii": Format(
        "seen.tsv",
        "Participant name\tPresented Media name\tFixation point X\tFixation point Y\t"
        "Eye movement type\tEye movement type index\n1\ta\t9\t9\tFixation\t1\n",
        read_fixations,
    ),
    "eyelink": Format(
        "seen.asc",
        "EVENTS GAZE LEFT\nMSG 1 !V IMGLOAD FILL a.png\nEFIX L 2 3 1 3 4 5\n",
        read_fixations,
    ),
}
DEFECTS = [
    ("csv", FORMATS["csv"].text, "", "line 1: expected the columns time, forward, left, turn, "),
    ("csv", "bearing,", "azimuth,", "line 1: ", "found 'azimuth'"),
    ("csv", "landmark,range", "range,range", "line 1: ", "found range twice"),
    ("csv", ",bearing,", ",baring,", "line 1: expected the column bearing (see", "'baring'"),
    ("csv", ",cov_turn_turn", ",cov_trn_turn", "line 1: expected the column cov_turn_turn (see"),
    ("csv", ",cov_turn_turn", "", "found no cov_turn_turn"),
    (
        "csv",
        "0,,,,,,,,,,,\n",
        "",
        "line 2: expected the first pose, in a row with its time alone, found time, landmark",
    ),
    ("csv", "1,0.5,0,0.1", "1,0.5,0,", "line 4: expected a finite number for turn, found nothing"),
    ("csv", "1,0.5,0,0.1", "-1,0.5,0,0.1", "line 4: time goes back from 0.000 to -1.000 s"),
    ("csv", "0.001,,,,,", "0.001,,2,0.3,,", "line 4: ", "or range, bearing, found both"),
    ("csv", "1,,,,,,,,3.5,-0.1,", "1,,,,,,,,,,", "line 5: ", "found neither"),
    ("csv", "1,,,,,,,,3.5", "2,,,,,,,,3.5", "line 5: expected an observation at the time", "1, f"),
    ("csv", "7,2.5", "-3,2.5", "line 3: expected the name of a landmark", "found '-3'"),
    ("csv", "7,2.5", "7,-2.5", "line 3: expected a range of 0 m or more, found -2.5"),
    ("csv", "3.5,-0.1", "3.5,300", "line 5: expected a bearing", "found 300"),
    ("csv", "7,2.5", '7,"2,5"', "line 3: ", "found '2,5', with a decimal comma"),
    ("csv", "0.01,0.0001\n1", '0.01,"0.0001\n1', "line "),
    ("csv", "0.01,0.0001\n1", "-0.01,0.0001\n1", "line 3: expected a covariance of range"),
    ("isam", "ODOMETRY", "GPS", "line 1: expected EDGE_SE2, EDGE2, ODOMETRY", "'GPS'"),
    ("isam", " 0.1 0.4", "", "line 2: expected 8 fields in a line of LANDMARK"),
    ("isam", "-1 0 0.5", "nan 0 0.5", "line 4: expected a finite number", "'nan'"),
    ("isam", "-1 0 0.5", "0 0 0.5", "line 4: ", "found range 0"),
    ("isam", "LANDMARK 3 7", "LANDMARK 4 7", "line 4: expected a pose of the log"),
    ("isam", "0.5 0.1 0.4", "0.5 0.46 0.4", "line 2: ", "entries of a covariance"),
    ("isam", "ODOMETRY 1 3", "ODOMETRY 1 0", "line 3: ", "loop closures"),
    ("mrclam", "5 2 1", "5 2", "line 2: expected 3 numbers", "found 2"),
    ("mrclam", "5 2 1", "0.5 2 1", "line 2: time goes back from 1.000 to 0.500"),
    ("mrclam", "1 2 3\n5 2 1\n", "", "expected odometry of robot 1, found none"),
    ("mrclam", "5 2 1", "1e12 2 1", "expected times within 1000000 s"),
    ("camera", "cy = 12\n", "cy = 12\nfz = 3\n", "found 'fz'"),
    ("camera", "cy = 12\n", "cy = 12\nposition = [1, 2]\n", "position: expected three numbers"),
    ("camera", "cy = 12\n", "cy = 12\nrotation = [[1, 0, 0], [0, 1, 0], [0, 0, -1]]\n", "rotation"),
    (
        "camera",
        "cy = 12\n",
        "cy = 12\ndistortion = [0.1]\n",
        "distortion: expected 0, 4, 5",
    ),
    ("camera", "cy = 12\n", "cy = 12\nstart = [1, 2]\n", "start: expected"),
    ("camera", "cy = 12\n", "cy = 12\nposition = ''\n", "expected numbers, and lists of numbers"),
    ("camera", "cy = 12\n", "cy = \n", "expected TOML"),
    ("odometry", "time_s", "t", "expected the header ahead_m,left_m,turn_rad or time_s"),
    ("odometry", "0.2,1,1", "0.2,1", "line 3: expected 3 cells, found 2"),
    ("odometry", "0.4,1,1\n", "0.1,1,1\n", "line 4: time goes back from 0.200 to 0.100"),
    (
        "odometry",
        "0.2,1,1\n0.4,1,1\n",
        "0.1,1,1\n",
        "expected odometry over the time of the frames, 0.000 to 0.400 s",
    ),
    ("tum", "2 rgb/0.png", "2", "line 2: expected 2 cells (time, file), found 1: '2'"),
    ("table", FORMATS["table"].text, "", "image, subject, x and y are missing"),
    ("table", ",y", ",z", "y is missing"),
    ("table", "a,0,0,1,2\na,0,1,3,2\n", "", "found none"),
    ("table", "3,2", "one,2", "line 3"),
    ("table", "subject", "who", "subject is missing among image, who, index, x, y; --columns"),
    ("table", "subject,index", "viewer,participant", "--columns subject=viewer"),
    ("tobii", "\tEye movement type index", "\tindex", "Eye movement type index"),
    ("eyelink", "MSG 1 !V IMGLOAD FILL a.png\n", "", "!V IMGLOAD", "found 1 without"),
    ("eyelink", "GAZE", "HREF", "line 1: expected events of GAZE"),
    ("eyelink", "FILL a.png", "CENTER a.png 1", "line 2: expected IMGLOAD"),
    ("eyelink", " 3 4 5", "", "line 3: expected EFIX"),
]
"""Format, a part of its text, what replaces it, and words of the message in their order."""


@pytest.mark.filterwarnings("ignore::saccade.LogWarning")
@pytest.mark.parametrize(("name", "old", "new", "words"), [(*d[:3], d[3:]) for d in DEFECTS])
def test_a_defect_is_named(tmp_path, name, old, new, words):
    form = FORMATS[name]
    TARGETS["folder-times"].make(tmp_path)
    for file in ("times.txt", "odometry.csv", "groundtruth.tum"):
        (tmp_path / file).unlink()
    (tmp_path / "camera.toml").write_text(CAMERA)
    (tmp_path / "Barcodes.dat").write_text("1 5\n6 72\n")
    (tmp_path / "Robot1_Measurement.dat").write_text("2 72 2.0 0.1\n")
    path = tmp_path / form.file
    path.write_text(form.text)
    assert form.read(path) is not None
    assert old in form.text
    path.write_text(form.text.replace(old, new, 1))
    expected = DriveError if name in ("camera", "odometry", "tum") else LogError
    part = tmp_path.name if name == "mrclam" else form.file
    with refuses(expected, part, *words):
        form.read(path)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"track": None}, "track: expected numbers of shape (3), found only frame, uvlr"),
        ({"uvlr": np.zeros((3, 3))}, "uvlr: expected numbers of shape (3, 4), found float64"),
        ({"uvlr": np.full((3, 4), np.nan)}, "uvlr, row 0: expected finite numbers, found [nan"),
        ({"frame": np.zeros(3)}, "frame: expected numbers of shape (n), found float64"),
    ],
)
def test_a_defect_of_tracks_is_named(tmp_path, change, words):
    arrays = {"frame": np.zeros(3, int), "track": np.zeros(3, int), "uvlr": np.zeros((3, 4))}
    np.savez(tmp_path / "a.npz", **{n: v for n, v in (arrays | change).items() if v is not None})
    with refuses(DriveError, "a.npz", words):
        load_drive("auto", tmp_path / "a.npz")


@pytest.mark.parametrize(
    ("load", "kind", "name", "words"),
    [
        (load, "auto", "nothing", "expected a landmark log, found no such file or folder"),
        (
            load,
            "auto",
            "empty",
            "expected a folder with any of log.csv (csv), Barcodes.dat (mrclam)",
        ),
        (load, "auto", "a.db3", "a.db3: expected a ROS bag"),
        (load_drive, "auto", "a.mcap", "a.mcap: expected a ROS bag"),
        (load, "carmen", "a.csv", "kind: expected one of auto, csv, mrclam"),
        (load_drive, "auto", "nothing", "expected a camera drive, found no such file or folder"),
        (
            load_drive,
            "auto",
            "empty",
            "image_0, image_2 (kitti), rgb.txt (tum-rgbd)",
        ),
        (
            load_drive,
            "auto",
            "a.csv",
            "kitti, tum-rgbd, tracks (.npz), rosbag (.bag",
        ),
        (load_drive, "auto", "a.bag", "a.bag: expected a ROS bag"),
        (load_drive, "tracks", "", "expected stereo_tracks_clean.npz or stereo_tracks.npz"),
        (load_drive, "lego", "a.csv", "kind: expected one of auto, euroc, kitti"),
    ],
)
def test_another_suffix_or_kind_is_named(tmp_path, load, kind, name, words):
    (tmp_path / "empty").mkdir()
    for file in ("a.csv", "a.bag", "a.db3", "a.mcap"):
        (tmp_path / file).write_text("no bag at all")
    with refuses(SaccadeError, words):
        load(kind, tmp_path / name)


@pytest.mark.parametrize(
    "option",
    [
        {"robot": 1},
        {"sensor_sigma": (1.0, 1.0)},
        {"odometry_noise": object()},
        {"topic": ["/tags"]},
    ],
)
def test_an_option_that_a_format_does_not_have_is_named(tmp_path, option):
    (tmp_path / "log.txt").write_text(FORMATS["isam"].text)
    with refuses(ConfigError, next(iter(option)), "isam"):
        load("auto", tmp_path / "log.txt", **option)
