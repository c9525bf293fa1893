"""Every reader of a file format, with a small good file of its kind to begin from."""

import sqlite3
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from warnings import catch_warnings

import cv2
import numpy as np
from scipy.io import savemat

from saccade import Keypoints, LogWarning, SiftConfig, exchange, slam
from saccade.batch import Job, extract, match_images, open_source
from saccade.batch.dataset import block_files, read_block, read_manifest, read_points
from saccade.batch.matching import MatchConfig, PairBlock, read_matches
from saccade.batch.pairs import read_pairs
from saccade.batch.sources import content_reader, decode
from saccade.batch.storage import Store
from saccade.datasets import load, load_drive, save, save_drive
from saccade.datasets.drives.sidecar_files import read_kitti_poses, read_tum_poses, read_turns
from saccade.datasets.fixations import read_fixations
from saccade.datasets.homography_pairs import homography_pairs
from saccade.evaluation.prediction import read_saliency_array
from saccade.io.image import read_image, read_stored
from saccade.io.video import VideoFrames, read_video, video_writer
from saccade.settings import load_settings
from saccade.types import LandmarkLog
from support.landmark_bags import drive as landmark_drive
from support.ros_bags import stereo, write_bag
from support.small_drive import small_drive


@dataclass(frozen=True)
class Target:
    """A reader, and what it reads."""

    make: Callable[[Path], object]
    """Writes a good input into an empty folder."""
    file: str
    """Which of its files is to be broken."""
    read: Callable[[Path], object]
    """Reads the folder; gives what it read or raises a SaccadeError."""


def a_file(name: str, write: Callable[[Path], object], read: Callable[[Path], object]) -> Target:
    """A target of one file, whose path both take."""
    return Target(lambda folder: write(folder / name), name, lambda folder: read(folder / name))


def a_text(name: str, text: str, read: Callable[[Path], object]) -> Target:
    """A target of one file of text."""
    return a_file(name, lambda path: path.write_text(text), read)


def a_log(motion="compose") -> LandmarkLog:
    """A robot that drives a curve among three landmarks."""
    steps, size = 6, 3 if motion == "compose" else 2
    return LandmarkLog(
        name="curve",
        start=np.zeros(3),
        time=np.arange(steps + 1) * 0.5,
        motion=motion,
        control=np.tile([0.5, 0.0, 0.1][-size:], (steps, 1)),
        control_covariance=np.tile(np.eye(size) * 1e-3, (steps, 1, 1)),
        observation_pose=np.repeat(np.arange(1, 5), 2),
        observation=np.column_stack([np.linspace(2, 4, 8), np.linspace(-1, 1, 8)]),
        observation_covariance=np.tile(np.eye(2) * 1e-2, (8, 1, 1)),
        landmark=np.arange(8) % 3,
    )


def a_picture(shape=(24, 32, 3)):
    """Noise with something in it."""
    return np.random.default_rng(5).integers(0, 256, shape).astype(np.uint8)


def write_pictures(folder: Path, *names: str, pixels=None) -> None:
    """Write the picture under some names."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        cv2.imwrite(str(folder / name), a_picture() if pixels is None else pixels)


def points(count=5) -> Keypoints:
    """Some, with descriptors."""
    rng = np.random.default_rng(2)
    found = Keypoints.at(rng.uniform(0, 30, (count, 2)).astype(np.float32), 3.0)
    return replace(found, descriptors=rng.integers(0, 255, (count, 128)).astype(np.uint8))


def run_log(path: Path) -> slam.SlamResult:
    """The result of the filter, which holds finite numbers."""
    with catch_warnings(action="ignore", category=LogWarning):
        result = slam.run(load("auto", path))
    for values in (result.trajectory.pose, result.trajectory.covariance, result.map.xy):
        assert np.isfinite(values).all()
    return result


def _log(name: str) -> Target:
    return a_file(name, lambda path: save(path, a_log()), run_log)


def _graph(name: str, edge: str, first: str = "", matrix: str = "40 1 0 40 0 80") -> Target:
    """Three steps, and a landmark that is seen from each pose."""
    edges = [f"{edge} {k} {k + 1} 1 0.1 0.2 {matrix}" for k in range(3)]
    seen = [f"LANDMARK {k} 9 {4 - k} {1 - k / 5} 20 1 30" for k in range(4)]
    return a_text(name, "\n".join([first, *edges, *seen]) + "\n", run_log)


def _mrclam(file: str) -> Target:
    texts = {
        "Barcodes.dat": "1 5\n6 72\n7 27\n",
        "Robot1_Odometry.dat": "# time speed turn\n" + "".join(f"{k} 1 0.1\n" for k in range(5)),
        "Robot1_Measurement.dat": "# time ...\n1 72 2 0.5\n2.3 27 1 0\n3 72 1.5 0.7\n",
    }

    def make(folder: Path) -> None:
        (folder / "robot").mkdir()
        for name, text in texts.items():
            (folder / "robot" / name).write_text(text)

    return Target(make, f"robot/{file}", lambda folder: run_log(folder / "robot"))


def _mrclam_npz(path: Path) -> None:
    np.savez(
        path,
        barcodes=np.array([[1, 5], [6, 72], [7, 27]]),
        robot1_odometry=np.column_stack([np.arange(5.0), np.ones(5), np.zeros(5)]),
        robot1_measurement=np.array([[1.0, 72, 2.0, 0.5], [2.3, 27, 1.0, 0.0]]),
    )


def _image(name: str, pixels) -> Target:
    def read(path: Path) -> object:
        return read_stored(path), read_image(path)

    return a_file(name, lambda path: cv2.imwrite(str(path), pixels), read)


def _video(path: Path) -> None:
    with video_writer(path, 10.0) as write:
        for _ in range(3):
            write(a_picture((32, 48, 3)))


def _drive(make: Callable[[Path], object], file: str, where: str = ".") -> Target:
    def read(folder: Path) -> object:
        drive = load_drive("auto", folder / where)
        return [drive.load(i) for i in range(min(len(drive), 2))]

    return Target(make, file, read)


def _kitti(folder: Path) -> None:
    save_drive(folder, small_drive())


def _kitti_calib(folder: Path) -> None:
    _kitti(folder)
    (folder / "camera.toml").unlink()


def _kitti_poses(folder: Path) -> None:
    _kitti(folder)
    rows = [f"1 0 0 0 0 1 0 0 0 0 1 {0.1 * i:.1f}" for i in range(5)]
    (folder / "poses.txt").write_text("\n".join(rows))


def _tum(folder: Path) -> None:
    names = [f"{i}.png" for i in range(3)]
    write_pictures(folder / "rgb", *names, pixels=cv2.resize(a_picture(), (640, 480)))
    write_pictures(folder / "depth", *names, pixels=np.full((480, 640), 2000, np.uint16))
    for kind in ("rgb", "depth"):
        rows = [f"{1305031102.175 + i / 30:.6f} {kind}/{name}" for i, name in enumerate(names)]
        (folder / f"{kind}.txt").write_text("\n".join(["# time file", *rows]))
    truth = [f"{1305031102.1 + i / 10} {i} 0 0 0 0 0 1" for i in range(4)]
    (folder / "groundtruth.txt").write_text("\n".join(truth))
    _camera_file(folder, 640, 480)


def _euroc(folder: Path) -> None:
    for side in (0, 1):
        camera = folder / f"cam{side}"
        names = [f"{1403636579763555584 + i * 50_000_000}.png" for i in range(2)]
        write_pictures(camera / "data", *names)
        pose = [*(1.0, 0.0, 0.0, 0.1 * side), *(0.0, 1.0, 0.0, 0.0), *(0.0, 0.0, 1.0, 0.0)]
        (camera / "sensor.yaml").write_text(
            f"T_BS:\n  cols: 4\n  rows: 4\n  data: {[*pose, 0.0, 0.0, 0.0, 1.0]}\n"
            "resolution: [32, 24]\nintrinsics: [20.0, 20.0, 16.0, 12.0]\n"
            "distortion_model: radial-tangential\ndistortion_coefficients: [0.1, 0, 0, 0]\n"
        )


def _camera_file(folder: Path, width: int = 32, height: int = 24) -> None:
    (folder / "camera.toml").write_text(
        f"width = {width}\nheight = {height}\nfx = 20.0\nfy = 20.0\ncx = 16.0\ncy = 12.0\n"
        "baseline = 0.2\nposition = [0.1, 0, 0.5]\ndistortion = [0.01, 0.0, 0.0, 0.0]\nrate = 10\n"
    )


def _folder(folder: Path) -> None:
    write_pictures(folder / "images", *(f"{i}.png" for i in range(3)))
    _camera_file(folder)
    (folder / "times.txt").write_text("0.0\n0.1\n0.2\n")
    (folder / "odometry.csv").write_text(
        "time_s,ahead_mps,turn_radps\n0,1,0.1\n0.1,1,0.1\n0.2,1,0\n"
    )
    (folder / "groundtruth.tum").write_text("0 0 0 0 0 0 0 1\n0.2 1 0 0 0 0 0 1\n")


def _camera_info(folder: Path) -> None:
    write_pictures(folder / "images", *(f"{i}.png" for i in range(3)))
    (folder / "camera_info.yaml").write_text(
        "image_width: 32\nimage_height: 24\ncamera_matrix:\n  rows: 3\n  cols: 3\n"
        "  data: [20.0, 0, 16, 0, 20, 12, 0, 0, 1]\ndistortion_model: plumb_bob\n"
        "distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [-0.1, 0.01, 0, 0, 0]\n"
    )


def _mcap(folder: Path) -> None:
    (write_bag(folder, 2, stereo, "mcap") / "metadata.yaml").unlink()


def _tracks(folder: Path) -> None:
    uvlr = np.tile([16.0, 12, 10, 12], (4, 1))
    np.savez(folder / "stereo_tracks.npz", frame=[0, 0, 1, 1], track=[1, 2, 1, 2], uvlr=uvlr)
    K = np.array([[20.0, 0, 16], [0, 20, 12], [0, 0, 1]])
    np.savez(folder / "calib.npz", K=K, b=0.2, cam_T_imu=np.eye(4))
    (folder / "times.txt").write_text("0.0\n0.1\n")


def _bag(version: int, file: str) -> Target:
    make = partial(write_bag, version=version, make=stereo)
    return _drive(make, file, file.partition("/")[0])


def _landmark_bag(version: int, kind: str, file: str) -> Target:
    seen = partial(landmark_drive, kind=kind)
    return Target(
        partial(write_bag, version=version, make=seen),
        file,
        lambda folder: run_log(folder / file.partition("/")[0]),
    )


def _fixations(folder: Path) -> None:
    write_pictures(folder, "a.png")
    (folder / "fixations.csv").write_text(
        "image,viewer,index,x,y\na.png,1,0,3.5,4\na.png,1,1,9,9\n"
    )


def _osie(path: Path) -> None:
    eye = {"fix_x": np.array([3.0, 4.0]), "fix_y": np.array([1.0, 2.0])}
    image = np.empty(2, object)
    image[:] = [{"img": f"100{i}.jpg", "subjects": np.array([eye, eye])} for i in range(2)]
    savemat(path, {"fixations": image})


def _homographies(folder: Path) -> None:
    write_pictures(folder, "1.png", "2.png")
    (folder / "H_1_2.txt").write_text("1 0 2\n0 1 3\n0 0 1\n")


def _colmap(path: Path) -> None:
    with sqlite3.connect(path) as database:
        database.executescript(
            "CREATE TABLE cameras (camera_id INTEGER PRIMARY KEY, model INTEGER, width INTEGER,"
            " height INTEGER, params BLOB);"
            "CREATE TABLE images (image_id INTEGER PRIMARY KEY, name TEXT, camera_id INTEGER);"
            "CREATE TABLE keypoints (image_id INTEGER, rows INTEGER, cols INTEGER, data BLOB);"
            "CREATE TABLE descriptors (image_id INTEGER, rows INTEGER, cols INTEGER, data BLOB);"
            "CREATE TABLE matches (pair_id INTEGER, rows INTEGER, cols INTEGER, data BLOB);"
            "INSERT INTO cameras VALUES (1, 0, 32, 24, NULL);"
            "INSERT INTO images VALUES (1, 'a.png', 1), (2, 'b.png', 1);"
        )
        rows = np.ones((5, 4), "<f4").tobytes()
        for image in (1, 2):
            database.execute("INSERT INTO keypoints VALUES (?, 5, 4, ?)", (image, rows))
            described = (image, points().descriptors.tobytes())
            database.execute("INSERT INTO descriptors VALUES (?, 5, 128, ?)", described)
        pair = (2147483647 + 2, np.array([[0, 1], [2, 3]], "<u4").tobytes())
        database.execute("INSERT INTO matches VALUES (?, 2, 2, ?)", pair)
    database.close()


def _map(path: Path) -> None:
    robot = slam.Slam()
    slam.run(a_log(), initial=robot)
    robot.save(path)


def _settings(name: str, text: str, kind: str) -> Target:
    return a_text(name, text, lambda path: load_settings(kind, path=path))


def _extracted(folder: Path) -> None:
    """Points of a picture, in files whose names do not depend on the settings."""
    write_pictures(folder / "photos", "a.png", pixels=cv2.resize(a_picture(), (128, 96)))
    source = open_source(str(folder / "photos"))
    extract(source, Job("sift", SiftConfig()), str(folder / "out"))
    (block,) = (folder / "out" / "sift").iterdir()
    block.rename(block.with_name("0.parquet"))


def _table(folder: Path) -> object:
    return list(read_points(str(folder / "out")))


def _again(folder: Path) -> object:
    store = Store(str(folder / "out"))
    records = [read_block(store, file)[0] for file in block_files(store, "sift")]
    return read_manifest(store), records


def _list(folder: Path) -> None:
    write_pictures(folder, "a.png")
    (folder / "photos.txt").write_text("# photographs\na.png\n./a.png\n")


def _sources(name: str) -> Callable[[Path], object]:
    def read(folder: Path) -> object:
        source = open_source(str(folder / name))
        return [decode(content_reader()(item), "a.png") for item in source]

    return read


def _matched(folder: Path) -> None:
    """Matches of two pictures, under a name that does not depend on the settings."""
    write_pictures(folder, "a.png", "b.png")
    job = Job("sift", SiftConfig(max_keypoints=20))
    match_images(str(folder), folder / "out", job=job, formats=["hdf5"])
    (block,) = (folder / "out" / "matches").iterdir()
    block.rename(block.with_name("0.npz"))


def _rematched(folder: Path) -> object:
    block = PairBlock([("a.png", "b.png")], [], "matches/0.npz")
    return read_matches(folder / "out", block, MatchConfig())


def _exchanged(name: str, write, read, content) -> Target:
    return a_file(name, lambda path: write(path, *content), read)


FOUND = {"a.png": points()}
MATCHED = {("a.png", "b.png"): np.array([[0, 1], [3, 2]])}, {"a.png": 4, "b.png": 3}
TARGETS = {
    "log-csv": _log("log.csv"),
    "g2o": _log("log.g2o"),
    "isam": _graph("log.isam", "EDGE2"),
    "toro": _graph("log.graph", "EDGE2", "VERTEX2 0 1 2 0.3", "40 1 40 80 0 0"),
    "gtsam": _graph("log.txt", "ODOMETRY"),
    "mrclam-odometry": _mrclam("Robot1_Odometry.dat"),
    "mrclam-measurement": _mrclam("Robot1_Measurement.dat"),
    "mrclam-npz": a_file("log.npz", _mrclam_npz, run_log),
    "map": a_file("map.npz", _map, slam.Slam.load),
    "png": _image("a.png", a_picture()),
    "jpeg": _image("a.jpg", a_picture()),
    "tiff": _image("a.tif", a_picture().astype(np.uint16) * 257),
    "webp": _image("a.webp", a_picture()),
    "bmp": _image("a.bmp", a_picture()),
    "video": a_file("film.mp4", _video, lambda path: [*read_video(path), VideoFrames(path)[0]]),
    "kitti-calib": _drive(_kitti_calib, "calib.txt"),
    "kitti-odometry": _drive(_kitti, "odometry.csv"),
    "kitti-poses": Target(
        _kitti_poses,
        "poses.txt",
        lambda f: read_kitti_poses(f / "poses.txt", load_drive("kitti", f).time),
    ),
    "tum-list": _drive(_tum, "rgb.txt"),
    "tum-truth": _drive(_tum, "groundtruth.txt"),
    "euroc": _drive(_euroc, "cam0/sensor.yaml"),
    "camera-toml": _drive(_folder, "camera.toml"),
    "camera-yaml": _drive(_camera_info, "camera_info.yaml"),
    "folder-times": _drive(_folder, "times.txt"),
    "folder-odometry": _drive(_folder, "odometry.csv"),
    "tracks": _drive(_tracks, "stereo_tracks.npz"),
    "tracks-calib": _drive(_tracks, "calib.npz"),
    "tum-poses": a_text(
        "poses.txt", "\n".join(f"{i} {i} 0 0 0 0 0 1" for i in range(4)), read_tum_poses
    ),
    "fixations": Target(
        _fixations, "fixations.csv", lambda f: read_fixations(f / "fixations.csv", say=print)
    ),
    "osie": a_file("fixations.mat", _osie, partial(read_fixations, say=print)),
    "homography": Target(_homographies, "H_1_2.txt", homography_pairs),
    "npz": _exchanged("a.npz", exchange.write_npz, exchange.read_npz, [points()]),
    "hdf5": _exchanged("a.h5", exchange.write_hdf5, exchange.read_hdf5, [FOUND]),
    "hloc-matches": _exchanged(
        "a.h5", exchange.write_hloc_matches, exchange.read_hloc_matches, MATCHED
    ),
    "matched-pairs": Target(_matched, "out/matches/0.npz", _rematched),
    "pairs": a_text("pairs.txt", "a.png b.png\nb c.png\tb/c.png\n", read_pairs),
    "colmap": a_file("points.db", _colmap, exchange.read_colmap),
    "settings": _settings("sift.toml", "max_keypoints = 7\nbase_sigma = 2\n", "sift"),
    "manifest": Target(_extracted, "out/manifest.json", _again),
    "list": Target(_list, "photos.txt", _sources("photos.txt")),
    "points-table": Target(_extracted, "out/sift/0.parquet", _table),
    "rosbag1": _bag(1, "way.bag"),
    "rosbag2": _bag(2, "way/way.db3"),
    "mcap": _drive(_mcap, "way/way.mcap", "way/way.mcap"),
    "rosbag2-metadata": _bag(2, "way/metadata.yaml"),
    "rosbag1-log": _landmark_bag(1, "ros1_tags", "way.bag"),
    "rosbag2-log": _landmark_bag(2, "fiducials", "way/way.db3"),
    "own-map": a_file("a.npy", lambda path: np.save(path, np.eye(9)), read_saliency_array),
    "gaze": a_text("gaze.csv", "pan_rad,tilt_rad,sigma_rad\n0.1,0,0.01\n", read_turns),
    "world": _settings("world.toml", "steps = 20\nlandmarks = 5\n", "world"),
    "drive-settings": _settings("drive.toml", "frames = 2\nimage_size = [64, 48]\n", "drive"),
}
