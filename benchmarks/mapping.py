"""Structure from motion on COLMAP's features and on ours (docs/measured.md).

    OMP_NUM_THREADS=1 uv run --extra colmap python benchmarks/mapping.py [--drives DIR]
        [--sets ring kitti07] [--budgets 2000 0] [--settings default mapping] [--starts 2]

COLMAP's incremental mapper gets images of one camera, which is known but in the hallway. COLMAP
detects, matches and verifies them, and so does saccade, with as many keypoints in each image as
COLMAP finds with the budget, which it exceeds; 0 stands for the defaults of each. Times are
CPU seconds of one thread for detection, and for matching and verification. Below come the medians
over the sets and starts of ours relative to COLMAP's, with 95 % bootstrap intervals, and the
smallest ratio of registered images.
"""

import tempfile
import time
import warnings
from collections.abc import Callable
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from measuring import arguments, require_one_thread, with_interval
from saccade import Sift, SiftConfig, match, verify
from saccade.datasets.drives.loading import load_drive
from saccade.evaluation.trajectory import umeyama
from saccade.exchange import ColmapCamera, read_colmap, write_colmap
from saccade.exchange.colmap import import_pycolmap
from saccade.frames import Drive
from saccade.simulation import DriveConfig, simulate_drive
from saccade.types import FloatArray, Keypoints

SETTINGS: dict[str, Callable[[], SiftConfig]] = {
    "default": SiftConfig,
    "mapping": SiftConfig.mapping,
    "colmap": SiftConfig.colmap,
}
ROOM_FRAMES = 160
"""Frames of a simulated lap of 30 m."""
INITIAL_ANGLES = (16.0, 8.0, 4.0, 2.0)
"""Smallest triangulation angles in degrees between the first two images, one for each start of the
mapper."""
COLUMNS = ("registered", "points", "track", "error px", "ATE mm", "detect s", "match s", "CPU s")
SEEDS = 4
"""Largest number of seeds of the mapper for each angle."""
RESAMPLES = 2000
"""Number of bootstrap samples of an interval."""


class ImageSet(NamedTuple):
    """Images of one camera."""

    images: list[np.ndarray]
    """Each (H, W) bytes."""
    camera: ColmapCamera | None
    """None where it is not known."""
    truth: FloatArray | None
    """(n, 3) positions of the camera in meters."""


def of_drive(drive: Drive, frames: range) -> ImageSet:
    """Frames of a drive."""
    images = [drive.load(i).image for i in frames]
    at, c = drive.truth.pose[frames, :2], drive.camera
    camera = ColmapCamera("PINHOLE", (c.fx, c.fy, c.cx + 0.5, c.cy + 0.5))
    return ImageSet(images, camera, np.c_[at, np.zeros(len(at))])


def kitti(folder: Path, truth: str, frames: range) -> ImageSet:
    """Frames of a drive of KITTI with its positions in space."""
    poses = np.loadtxt(folder / truth).reshape(-1, 3, 4)
    return of_drive(load_drive("kitti", folder), frames)._replace(truth=poses[frames, :, 3])


def room(config: DriveConfig, seed: int, frames: range) -> ImageSet:
    """Rendered images of a lap through rooms with posters on their walls."""
    lap = {"frames": ROOM_FRAMES, "frames_per_lap": ROOM_FRAMES}
    config = replace(config, image_size=(640, 480), baseline=None, **lap)
    return of_drive(simulate_drive(config, seed), frames)


def hallway(folder: Path, frames: range) -> ImageSet:
    """Photographs of a hallway on two laps by a camera that is not known, without truth."""
    paths = [folder / f"{i + lap}.jpg" for lap in (1, 41) for i in frames[: len(frames) // 2]]
    return ImageSet([cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in paths], None, None)


def image_sets(drives: Path | None, count: int, start: int) -> dict[str, Callable[[], ImageSet]]:
    """The image sets by name; each is read when it is called."""

    def frames(step: int) -> range:
        first = start * step * count // 2
        return range(first, first + step * count, step)

    sets = {
        "ring": lambda: room(DriveConfig.ring(), 1 + start, frames(1)),
        "rooms": lambda: room(DriveConfig.rooms(), 11 + start, frames(1)),
    }
    if drives is not None:
        sets |= {
            "60m": lambda: kitti(drives / "kitti_stereo_60m", "poses.txt", frames(2)),
            "52m": lambda: kitti(drives / "kitti_stereo_52m", "poses.txt", frames(2)),
            "kitti07": lambda: kitti(drives / "kitti07", "groundtruth_kitti.txt", frames(4)),
            "hallway": lambda: hallway(drives / "rtabmap_samples_loop", frames(1)),
        }
    return sets


def colmap_features(folder: Path, given: ImageSet, database: Path, budget: int) -> float:
    """Detects, matches and verifies with COLMAP on one thread; returns the time of detection."""
    pycolmap = import_pycolmap()
    reader, extraction = pycolmap.ImageReaderOptions(), pycolmap.FeatureExtractionOptions()
    if given.camera is not None:
        reader.camera_model = given.camera.model
        reader.camera_params = ",".join(map(str, given.camera.params))
    extraction.num_threads, extraction.use_gpu = 1, False
    if budget:
        extraction.sift.max_num_features = budget
    matching = pycolmap.FeatureMatchingOptions()
    matching.num_threads, matching.use_gpu = 1, False
    mode = pycolmap.CameraMode.SINGLE
    words = {"reader_options": reader, "extraction_options": extraction, "camera_mode": mode}
    start = time.process_time()
    pycolmap.extract_features(database, folder, **words)
    detection = time.process_time() - start
    pycolmap.match_exhaustive(database, matching_options=matching)
    return detection


def our_features(
    given: ImageSet, database: Path, config: SiftConfig, counts: list[int] | None
) -> float:
    """Detects `counts` keypoints, matches and verifies; returns the time of detection."""
    keypoints: dict[str, Keypoints] = {}
    start = time.process_time()
    for i, image in enumerate(given.images):
        if counts is not None:
            config = replace(config, max_keypoints=max(counts[i], 1), contrast_threshold=None)
        keypoints[f"{i:03}.png"] = Sift(config, threads=1)(image)
    detection = time.process_time() - start
    matches = {(a, b): match(keypoints[a], keypoints[b]) for a, b in combinations(keypoints, 2)}
    views = {pair: verify(*map(keypoints.get, pair), each) for pair, each in matches.items()}
    shapes = dict.fromkeys(keypoints, given.images[0].shape)
    camera = given.camera or ColmapCamera("SIMPLE_RADIAL")
    found = (keypoints, shapes, matches, views)
    write_colmap(database, *found, cameras=camera, camera_mode="single")
    return detection


def map_of(folder: Path, given: ImageSet, database: Path) -> list[float]:
    """Registered images, points, track length, reprojection error and ATE of COLMAP's map.

    The mapper may start from a wrong motion. It starts once for each angle, and again with other
    seeds until a map has all images. The map with the most images counts, and among equal numbers
    the smallest reprojection error.
    """
    pycolmap = import_pycolmap()
    options, maps = pycolmap.IncrementalPipelineOptions(), []
    options.num_threads, options.extract_colors, options.min_model_size = 1, False, 3
    options.ba_refine_focal_length = options.ba_refine_extra_params = given.camera is None
    options.mapper.init_max_forward_motion = 1.0
    for seed in range(SEEDS):
        for angle in INITIAL_ANGLES:
            options.random_seed, options.mapper.init_min_tri_angle = seed, angle
            found = pycolmap.incremental_mapping(database, folder, database.parent, options)
            maps += found.values()
        if any(each.num_reg_images() == len(given.images) for each in maps):
            break
    if not maps:
        return [0, *[np.nan] * 4]
    model = min(
        maps, key=lambda each: (-each.num_reg_images(), each.compute_mean_reprojection_error())
    )
    facts = [model.num_reg_images(), model.num_points3D(), model.compute_mean_track_length()]
    error = model.compute_mean_reprojection_error()
    return [*facts, error, position_error(model, given.truth)]


def position_error(model: object, truth: FloatArray | None) -> float:
    """RMS distance in millimeters of the cameras from the truth, after alignment with scale."""
    if truth is None:
        return np.nan
    registered = [model.image(i) for i in model.reg_image_ids()]
    found = np.array([each.projection_center() for each in registered])
    true = truth[[int(each.name[:3]) for each in registered]]
    gap = umeyama(found, true, with_scale=True)(found) - true
    return 1000 * float(np.sqrt((gap**2).sum(axis=1).mean()))


def measure(
    given: ImageSet, setting: str, budget: int, counts: list[int] | None
) -> tuple[list[float], list[int]]:
    """The columns of a set, and the numbers of keypoints in its images."""
    with tempfile.TemporaryDirectory() as name:
        folder, database = Path(name) / "images", Path(name) / "database.db"
        folder.mkdir()
        for i, image in enumerate(given.images):
            cv2.imwrite(str(folder / f"{i:03}.png"), image)
        start = time.process_time()
        if setting == "COLMAP":
            detection = colmap_features(folder, given, database, budget)
        else:
            detection = our_features(
                given, database, SETTINGS[setting](), counts if budget else None
            )
        seconds = time.process_time() - start
        found = read_colmap(database).keypoints
        row = [*map_of(folder, given, database), detection, seconds - detection, seconds]
        return row, [len(found[name]) for name in sorted(found)]


def main() -> None:
    given = arguments(
        __doc__,
        drives={"type": Path, "help": "folder of the drives of KITTI and of the hallway"},
        sets={"nargs": "+", "help": "names of sets; all by default"},
        budgets=[1000, 2000, 4000, 8000, 0],
        settings={"nargs": "+", "choices": SETTINGS, "default": ["default", "mapping"]},
        images=12,
        starts=1,
    )
    require_one_thread()
    cv2.setNumThreads(1)
    noise = Sift()(np.random.default_rng(0).random((200, 200)))
    verify(noise, noise, match(noise, noise))  # kernels are compiled or loaded at the first call
    rows: dict[tuple[int, str], list[list[float]]] = {}
    print("set      start budget features   " + " ".join(f"{name:>10}" for name in COLUMNS))
    for start in range(given.starts):
        for name, read in image_sets(given.drives, given.images, start).items():
            if given.sets and name not in given.sets:
                continue
            images = read()
            for budget in given.budgets:
                counts = None
                for setting in ("COLMAP", *given.settings):
                    row, found = measure(images, setting, budget, counts)
                    counts = counts or found
                    rows.setdefault((budget, setting), []).append(row)
                    cells = " ".join(f"{value:10.3f}" for value in row)
                    print(f"{name:8} {start:5} {budget:6} {setting:10} {cells}", flush=True)
    for (budget, setting), found in rows.items():
        ratios = np.array(found) / np.array(rows[budget, "COLMAP"])
        cells = " ".join(map(with_interval, median_intervals(ratios)))
        print(f"{budget:6} {setting:10} {cells} least registered {ratios[:, 0].min():.2f}")


def median_intervals(ratios: FloatArray) -> FloatArray:
    """(c, 3) medians of the columns of (n, c) ratios, with the ends of their 95 % intervals."""
    drawn = np.random.default_rng(0).integers(len(ratios), size=(RESAMPLES, len(ratios)))
    with warnings.catch_warnings(action="ignore"):  # samples without any truth
        medians = np.nanmedian(ratios[drawn], axis=1)  # (resamples, c)
        low, high = np.nanquantile(medians, (0.025, 0.975), axis=0)
    return np.stack([np.nanmedian(ratios, axis=0), low, high], axis=1)


if __name__ == "__main__":
    main()
