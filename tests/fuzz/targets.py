"""Every reader of a file format, with a small good file of its kind to begin from."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from warnings import catch_warnings

import cv2
import numpy as np

from saccade import Keypoints, LogWarning, SiftConfig, exchange, slam
from saccade.datasets import load, load_drive, save, save_drive
from saccade.datasets.drives.sidecar_files import read_kitti_poses, read_tum_poses
from saccade.datasets.fixations import read_fixations
from saccade.datasets.homography_pairs import homography_pairs
from saccade.frames import Camera, Drive, Frame
from saccade.io.image import read_image, read_stored
from saccade.io.video import VideoFrames, read_video, video_writer
from saccade.types import LandmarkLog, Trajectory


@dataclass(frozen=True)
class Target:
    """A reader, and what it reads."""

    make: Callable[[Path], object]
    """Writes a good input into an empty folder."""
    file: str
    """Which of its files is to be broken."""
    read: Callable[[Path], object]
    """Reads the folder; gives what it read or raises a SaccadeError."""


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


def a_drive() -> Drive:
    """Four frames of a stereo rig."""
    camera = Camera(width=32, height=24, fx=20.0, fy=20.0, cx=16.0, cy=12.0, baseline=0.2)
    time = np.arange(4) * 0.1
    image = a_picture((24, 32))
    return Drive(
        name="small",
        camera=camera,
        time=time,
        control=np.tile([0.1, 0.0, 0.0], (3, 1)),
        control_covariance=np.tile(np.eye(3) * 1e-4, (3, 1, 1)),
        load=lambda i: Frame(float(time[i]), image, right=image),
        truth=Trajectory(time, np.column_stack([time, 0 * time, 0 * time])),
    )


def points(count=5) -> Keypoints:
    """Some, with descriptors."""
    rng = np.random.default_rng(2)
    found = Keypoints.at(rng.uniform(0, 30, (count, 2)).astype(np.float32), 3.0)
    return replace(found, descriptors=rng.integers(0, 255, (count, 128)).astype(np.uint8))


def run_finite(log: LandmarkLog) -> slam.SlamResult:
    """The result of the filter, which holds finite numbers."""
    result = slam.run(log)
    for values in (result.trajectory.pose, result.trajectory.covariance, result.map.xy):
        assert np.isfinite(values).all()
    return result


def _log(name: str, motion: str = "compose") -> Target:
    kind = "gtsam" if name == "log.txt" else "auto"
    return Target(
        lambda folder: save(folder / name, a_log(motion), kind),
        name,
        lambda folder: run_finite(load("auto", folder / name)),
    )


def _mrclam(file: str) -> Target:
    timed = replace(a_log("turn_then_translate"), landmark=np.arange(8) % 3 + 6)
    return Target(
        lambda folder: save(folder / "robot", timed, "mrclam"),
        f"robot/{file}",
        lambda folder: run_finite(load("auto", folder / "robot")),
    )


def _mrclam_npz(folder: Path) -> None:
    odometry = np.column_stack([np.arange(5.0), np.ones(5), np.zeros(5)])
    seen = np.array([[1.0, 72, 2.0, 0.5], [2.3, 27, 1.0, 0.0]])
    np.savez(
        folder / "log.npz",
        barcodes=np.array([[1, 5], [6, 72], [7, 27]]),
        robot1_odometry=odometry,
        robot1_measurement=seen,
    )


def _park(folder: Path) -> None:
    from scipy.io import savemat

    time = np.arange(0, 2000, 25.0)
    scans = np.empty((5, 1), object)
    scans[:, 0] = [np.array([[8.0, 9.0], [1.5, 1.7], [0.4, 0.5]])] * 5
    u = np.array([np.ones(80), np.zeros(80)])
    held = {"time": time, "u": u, "TLsr": time[10::16], "zt": scans}
    savemat(folder / "log.mat", held, do_compression=False)
    savemat(folder / "aa3_gpsx.mat", {"timeGps": time, "La_m": time, "Lo_m": time})


def _image(name: str, pixels) -> Target:
    def read(folder: Path) -> object:
        read_stored(folder / name)
        return read_image(folder / name)

    return Target(lambda folder: cv2.imwrite(str(folder / name), pixels), name, read)


def _video(folder: Path) -> None:
    with video_writer(folder / "film.mp4", 10.0) as write:
        for _ in range(3):
            write(a_picture((32, 48, 3)))


def _read_video(folder: Path) -> object:
    for _ in read_video(folder / "film.mp4"):
        pass
    return VideoFrames(folder / "film.mp4")[0]


def _drive(make: Callable[[Path], object], file: str, where: str = ".") -> Target:
    def read(folder: Path) -> object:
        drive = load_drive("auto", folder / where)
        return [drive.load(i) for i in range(min(len(drive), 2))]

    return Target(make, file, read)


def _kitti(folder: Path) -> None:
    save_drive(folder, a_drive())


def _kitti_poses(folder: Path) -> None:
    _kitti(folder)
    rows = [f"1 0 0 0 0 1 0 0 0 0 1 {0.1 * i:.1f}" for i in range(4)]
    (folder / "poses.txt").write_text("\n".join(rows))


def _read_kitti_poses(folder: Path) -> object:
    return read_kitti_poses(folder / "poses.txt", load_drive("kitti", folder).time)


def _tum(folder: Path) -> None:
    for name in ("rgb", "depth"):
        (folder / name).mkdir()
        rows = []
        for i in range(3):
            pixels = np.full((480, 640), 2000, np.uint16) if name == "depth" else a_picture()
            pixels = pixels if name == "depth" else cv2.resize(pixels, (640, 480))
            cv2.imwrite(str(folder / name / f"{i}.png"), pixels)
            rows.append(f"{1305031102.175 + i / 30:.6f} {name}/{i}.png")
        (folder / f"{name}.txt").write_text("# time file\n" + "\n".join(rows))
    truth = [f"{1305031102.1 + i / 10} {i} 0 0 0 0 0 1" for i in range(4)]
    (folder / "groundtruth.txt").write_text("\n".join(truth))
    _camera_file(folder, 640, 480)


def _camera_file(folder: Path, width: int = 32, height: int = 24) -> None:
    (folder / "camera.toml").write_text(
        f"width = {width}\nheight = {height}\nfx = 20.0\nfy = 20.0\ncx = 16.0\ncy = 12.0\n"
        "baseline = 0.2\nplace = [0.1, 0.0, 0.5]\ndistortion = [0.01, 0.0, 0.0, 0.0]\nrate = 10\n"
    )


def _folder(folder: Path) -> None:
    (folder / "images").mkdir()
    for i in range(3):
        cv2.imwrite(str(folder / "images" / f"{i}.png"), a_picture())
    _camera_file(folder)
    (folder / "times.txt").write_text("0.0\n0.1\n0.2\n")
    (folder / "odometry.csv").write_text(
        "time_s,ahead_mps,turn_radps\n0,1,0.1\n0.1,1,0.1\n0.2,1,0\n"
    )
    (folder / "groundtruth.tum").write_text("0 0 0 0 0 0 0 1\n0.2 1 0 0 0 0 0 1\n")


SENSOR = """sensor_type: camera
T_BS:
  cols: 4
  rows: 4
  data: [0, -1.0, 0, 0.02, 1, 0, 0, -0.05, 0, 0, 1, 0.01, 0, 0, 0, 1]
rate_hz: 20
resolution: [32, 24]
camera_model: pinhole
intrinsics: [20, 20, 16, 12] #fu, fv, cu, cv
distortion_model: radial-tangential
distortion_coefficients: [-0.28, 0.07, 0.0002, 0.00002]
"""


def _euroc(folder: Path) -> None:
    stamps = [1403636579763555584 + 50_000_000 * i for i in range(3)]
    for name in ("cam0", "cam1"):
        place = folder / "mav0" / name
        (place / "data").mkdir(parents=True)
        for stamp in stamps:
            cv2.imwrite(str(place / "data" / f"{stamp}.png"), a_picture((24, 32)))
        rows = "\n".join(f"{stamp},{stamp}.png" for stamp in stamps)
        (place / "data.csv").write_text(f"#timestamp [ns],filename\n{rows}\n")
        place_of = SENSOR if name == "cam0" else SENSOR.replace("0.02,", "0.12,")
        (place / "sensor.yaml").write_text(place_of)
    (folder / "mav0" / "imu0").mkdir()
    rows = [f"{stamps[0] + 5_000_000 * i},0.1,0,0,9.8,0,0" for i in range(22)]
    (folder / "mav0" / "imu0" / "data.csv").write_text("#t,w\n" + "\n".join(rows))


def _tracks(folder: Path) -> None:
    uvlr = np.tile([16.0, 12, 10, 12], (4, 1))
    np.savez(folder / "stereo_tracks.npz", frame=[0, 0, 1, 1], track=[1, 2, 1, 2], uvlr=uvlr)
    K = np.array([[20.0, 0, 16], [0, 20, 12], [0, 0, 1]])
    np.savez(folder / "calib.npz", K=K, b=0.2, cam_T_imu=np.eye(4))
    (folder / "times.txt").write_text("0.0\n0.1\n")


def _fixations(folder: Path) -> None:
    cv2.imwrite(str(folder / "a.png"), a_picture())
    (folder / "fixations.csv").write_text(
        "image,viewer,index,x,y\na.png,1,0,3.5,4\na.png,1,1,9,9\n"
    )


def _osie(folder: Path) -> None:
    from scipy.io import savemat

    eye = {"fix_x": np.array([3.0, 4.0]), "fix_y": np.array([1.0, 2.0])}
    image = np.empty(2, object)
    image[:] = [{"img": f"100{i}.jpg", "subjects": np.array([eye, eye])} for i in range(2)]
    savemat(folder / "fixations.mat", {"fixations": image})


def _homographies(folder: Path) -> None:
    for number in (1, 2):
        cv2.imwrite(str(folder / f"{number}.png"), a_picture())
    (folder / "H_1_2.txt").write_text("1 0 2\n0 1 3\n0 0 1\n")


def _colmap(folder: Path) -> None:
    import sqlite3

    with sqlite3.connect(folder / "points.db") as database:
        database.executescript(
            "CREATE TABLE cameras (camera_id INTEGER PRIMARY KEY, width INTEGER, height INTEGER);"
            "CREATE TABLE images (image_id INTEGER PRIMARY KEY, name TEXT, camera_id INTEGER);"
            "CREATE TABLE keypoints (image_id INTEGER, rows INTEGER, cols INTEGER, data BLOB);"
            "CREATE TABLE descriptors (image_id INTEGER, rows INTEGER, cols INTEGER, data BLOB);"
            "CREATE TABLE matches (pair_id INTEGER, rows INTEGER, cols INTEGER, data BLOB);"
            "INSERT INTO cameras VALUES (1, 32, 24);"
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


def _checkpoint(folder: Path) -> None:
    slam.run(a_log(), checkpoint=slam.Checkpoint(folder / "run.npz", None))


def _resume(folder: Path) -> object:
    return slam.run(a_log(), checkpoint=slam.Checkpoint(folder / "run.npz"))


def _settings(folder: Path) -> object:
    from saccade.settings import load_settings

    return load_settings("sift", path=folder / "sift.toml")


def _extracted(folder: Path) -> None:
    from saccade import SiftConfig
    from saccade.batch import Job, extract, open_source
    from saccade.batch.engines import InProcess

    (folder / "photos").mkdir()
    cv2.imwrite(str(folder / "photos" / "a.png"), cv2.resize(a_picture(), (128, 96)))
    source = open_source(str(folder / "photos"))
    extract(source, Job("sift", SiftConfig()), str(folder / "out"), InProcess())
    (shard,) = (folder / "out" / "sift").iterdir()
    (record,) = (folder / "out" / "images").iterdir()
    shard.rename(folder / "out" / "sift" / "part-0.parquet")
    record.rename(folder / "out" / "images" / "part-0.parquet")


def _indexed(folder: Path) -> None:
    from saccade.batch.index import build_index

    _extracted(folder)
    build_index(folder / "out")


def _look_up(folder: Path) -> object:
    from saccade.batch.index import Index

    return Index(folder / "out").find(points())


def _table(folder: Path) -> object:
    from saccade.batch.dataset import read_points

    return list(read_points(str(folder / "out")))


def _list(folder: Path) -> None:
    cv2.imwrite(str(folder / "a.png"), a_picture())
    (folder / "photos.txt").write_text("# photographs\na.png\n./a.png\n")


def _listed(folder: Path) -> object:
    from saccade.batch import open_source
    from saccade.batch.sources import read_content

    source = open_source(str(folder / "photos.txt"))
    return [read_content(source[i]) for i in range(len(source))]


def _own_map(folder: Path) -> object:
    from saccade.evaluation.prediction import read_saliency_array

    return read_saliency_array(folder / "a.npy")


def _turns(folder: Path) -> object:
    from saccade.datasets.drives.sidecar_files import read_turns

    return read_turns(folder / "gaze.csv")


def _bag(version: int, file: str) -> Target:
    def make(folder: Path) -> None:
        from support.ros_bags import stereo, write_bag

        write_bag(folder, version, stereo)

    return _drive(make, file, file.partition("/")[0])


def _landmark_bag(version: int, kind: str, file: str) -> Target:
    def make(folder: Path) -> None:
        from support.landmark_bags import drive
        from support.ros_bags import write_bag

        write_bag(folder, version, lambda messages: drive(messages, kind))

    def read(folder: Path) -> object:
        with catch_warnings(action="ignore", category=LogWarning):
            return run_finite(load("auto", folder / file.partition("/")[0]))

    return Target(make, file, read)


def _written(name: str, text: str, kind: str) -> Target:
    from saccade.settings import load_settings

    return Target(
        lambda folder: (folder / name).write_text(text),
        name,
        lambda folder: load_settings(kind, path=folder / name),
    )


def _again(folder: Path) -> object:
    from saccade.batch.dataset import read_manifest, read_records
    from saccade.batch.sources import Store

    store = Store(str(folder / "out"))
    return read_manifest(store), list(read_records(store))


def _tar(folder: Path) -> None:
    import tarfile

    with tarfile.open(folder / "photos.tar", "w") as archive:
        cv2.imwrite(str(folder / "a.png"), a_picture())
        archive.add(folder / "a.png", "a.png")


def _untar(folder: Path) -> object:
    from saccade.batch import open_source
    from saccade.batch.sources import decode, read_content

    source = open_source(str(folder / "photos.tar"))
    return [decode(read_content(source[i]), "a.png") for i in range(len(source))]


def _matched(folder: Path) -> None:
    """Matches of two pictures, under a name that does not depend on the settings."""
    from saccade.batch import Job, match_images

    for name in ("a.png", "b.png"):
        cv2.imwrite(str(folder / name), a_picture())
    job = Job("sift", SiftConfig(max_keypoints=20), exact=True)
    match_images(str(folder), folder / "out", job=job, formats=["hdf5"])
    (part,) = (folder / "out" / "matches").glob("*.parquet")
    part.rename(part.with_name("part-0.parquet"))


def _rematched(folder: Path) -> object:
    from saccade.batch.matching import read_matches
    from saccade.batch.sources import Store

    store = Store(str(folder / "out"))
    return [read_matches(store, file) for file in store.list_files("matches")]


def _pairs(folder: Path) -> object:
    from saccade.batch.matching import read_pairs

    return read_pairs(folder / "pairs.txt")


def _exchanged(name: str, write, read) -> Target:
    return Target(lambda folder: write(folder / name), name, lambda folder: read(folder / name))


_TUM = "\n".join(f"{i} {i} 0 0 0 0 0 1" for i in range(4))
TARGETS = {
    "log-csv": _log("log.csv"),
    "g2o": _log("log.g2o"),
    "isam": _log("log.isam"),
    "toro": _log("log.graph"),
    "gtsam": _log("log.txt"),
    "mrclam-odometry": _mrclam("Robot1_Odometry.dat"),
    "mrclam-measurement": _mrclam("Robot1_Measurement.dat"),
    "mrclam-npz": Target(_mrclam_npz, "log.npz", lambda f: run_finite(load("auto", f / "log.npz"))),
    "matlab": Target(_park, "log.mat", lambda f: load("auto", f / "log.mat")),
    "matlab-gps": Target(_park, "aa3_gpsx.mat", lambda f: load("auto", f / "log.mat")),
    "checkpoint": Target(_checkpoint, "run.npz", _resume),
    "png": _image("a.png", a_picture()),
    "jpeg": _image("a.jpg", a_picture()),
    "tiff": _image("a.tif", a_picture().astype(np.uint16) * 257),
    "webp": _image("a.webp", a_picture()),
    "bmp": _image("a.bmp", a_picture()),
    "video": Target(_video, "film.mp4", _read_video),
    "kitti-calib": _drive(_kitti, "calib.txt"),
    "kitti-odometry": _drive(_kitti, "odometry.csv"),
    "kitti-poses": Target(_kitti_poses, "poses.txt", _read_kitti_poses),
    "tum-list": _drive(_tum, "rgb.txt"),
    "tum-truth": _drive(_tum, "groundtruth.txt"),
    "camera-toml": _drive(_folder, "camera.toml"),
    "folder-times": _drive(_folder, "times.txt"),
    "folder-odometry": _drive(_folder, "odometry.csv"),
    "euroc-sensor": _drive(_euroc, "mav0/cam0/sensor.yaml"),
    "euroc-list": _drive(_euroc, "mav0/cam1/data.csv"),
    "euroc-imu": _drive(_euroc, "mav0/imu0/data.csv"),
    "tracks": _drive(_tracks, "stereo_tracks.npz"),
    "tracks-calib": _drive(_tracks, "calib.npz"),
    "tum-poses": Target(
        lambda folder: (folder / "poses.txt").write_text(_TUM),
        "poses.txt",
        lambda folder: read_tum_poses(folder / "poses.txt"),
    ),
    "fixations": Target(
        _fixations, "fixations.csv", lambda f: read_fixations(f / "fixations.csv", say=print)
    ),
    "osie": Target(
        _osie, "fixations.mat", lambda f: read_fixations(f / "fixations.mat", say=print)
    ),
    "homography": Target(_homographies, "H_1_2.txt", homography_pairs),
    "npz": _exchanged("a.npz", lambda p: exchange.write_npz(p, points()), exchange.read_npz),
    "csv": _exchanged("a.csv", lambda p: exchange.write_csv(p, points()), exchange.read_csv),
    "hdf5": _exchanged(
        "a.h5", lambda p: exchange.write_hdf5(p, {"a.png": points()}), exchange.read_hdf5
    ),
    "parquet": _exchanged(
        "a.parquet",
        lambda p: exchange.write_parquet(p, {"a.png": points()}),
        exchange.read_parquet,
    ),
    "hloc-matches": _exchanged(
        "a.h5",
        lambda p: exchange.write_hloc_matches(
            p, {("a.png", "b.png"): np.array([[0, 1], [3, 2]])}, {"a.png": 4, "b.png": 3}
        ),
        exchange.read_hloc_matches,
    ),
    "matched-pairs": Target(_matched, "out/matches/part-0.parquet", _rematched),
    "pairs": Target(
        lambda folder: (folder / "pairs.txt").write_text("a.png b.png\nb c.png\tb/c.png\n"),
        "pairs.txt",
        _pairs,
    ),
    "colmap": Target(_colmap, "points.db", lambda f: exchange.read_colmap(f / "points.db")),
    "settings": Target(
        lambda folder: (folder / "sift.toml").write_text("max_keypoints = 7\nbase_sigma = 2\n"),
        "sift.toml",
        _settings,
    ),
    "manifest": Target(_extracted, "out/manifest.json", _again),
    "record": Target(_extracted, "out/images/part-0.parquet", _again),
    "tar": Target(_tar, "photos.tar", _untar),
    "list": Target(_list, "photos.txt", _listed),
    "points-table": Target(_extracted, "out/sift/part-0.parquet", _table),
    "points-record": Target(_extracted, "out/images/part-0.parquet", _table),
    "index-images": Target(_indexed, "out/index/images.json", _look_up),
    "index-places": Target(_indexed, "out/index/places.npy", _look_up),
    "index-vectors": Target(_indexed, "out/index/vectors.faiss", _look_up),
    "rosbag1": _bag(1, "way.bag"),
    "rosbag2": _bag(2, "way/way.db3"),
    "rosbag2-metadata": _bag(2, "way/metadata.yaml"),
    "rosbag1-log": _landmark_bag(1, "ros1_tags", "way.bag"),
    "rosbag2-log": _landmark_bag(2, "markers", "way/way.db3"),
    "own-map": Target(lambda f: np.save(f / "a.npy", np.eye(9)), "a.npy", _own_map),
    "gaze": Target(
        lambda f: (f / "gaze.csv").write_text("pan_rad,tilt_rad,sigma_rad\n0.1,0,0.01\n"),
        "gaze.csv",
        _turns,
    ),
    "world": _written("world.toml", "steps = 20\nlandmarks = 5\n", "world"),
    "drive-settings": _written("drive.toml", "frames = 2\nimage_size = [64, 48]\n", "drive"),
}
