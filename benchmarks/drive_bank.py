"""Simulated drives along real trajectories, and recordings: joined estimate against its parts.

    uv run python benchmarks/drive_bank.py DRIVES               45 simulated drives, then recordings
    uv run python benchmarks/drive_bank.py DRIVES --variants 2 --frames 200 --no-recordings

Quoted in docs/measured.md. DRIVES is a folder with `kitti_poses/`, `kitti07/` and
`kitti_stereo_*/`. Each of the nine trajectories is driven five times: with the tracks and the
odometry of a course (all tracks end now and then), with tracks that are replaced one by one and
better odometry, and without odometry. The errors of the calibration are drawn for each drive.

A row has the errors of the joined estimate, of egomotion and of odometry: translation in % and
rotation in degrees per 100 m over segments, unaligned RMSE in metres; the largest and the mean
ratio of the three to the better of the parts; the NEES of the last pose, and the fraction inside
three sigma. The worst drives come first.
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from measuring import arguments
from saccade import datasets, visual
from saccade.datasets.drives.sidecar_files import camera_truth, read_kitti_poses
from saccade.evaluation.trajectory import path_length, score_drive
from saccade.frames import Drive
from saccade.plane import relative_poses
from saccade.slam.consistency import chi_square_band, normalized_squared
from saccade.slam.filter.robot_models import wrap
from saccade.types import FloatArray, Trajectory
from stereo_tracks import TrackConfig, simulate_tracks

FRAME_SECONDS = 0.1037
RECORDINGS = ("kitti07/stereo_tracks_clean.npz", "kitti_stereo_60m", "kitti_stereo_52m")
SEGMENTS = (25.0, 50.0, 100.0)
"""Lengths in metres over which relative errors are averaged."""


def relative_errors(estimate: Trajectory, truth: FloatArray) -> tuple[float, float]:
    """Translation in % and rotation in degrees per 100 m, over segments of true length."""
    travelled = path_length(truth[:, :2])
    values = []
    for length in SEGMENTS:
        first = np.arange(0, len(truth), 5)
        last = np.searchsorted(travelled, travelled[first] + length)
        first, last = first[last < len(truth)], last[last < len(truth)]
        moved, true = (relative_poses(pose[first], pose[last]) for pose in (estimate.pose, truth))
        distance = np.hypot(*(moved - true)[:, :2].T)
        turn = np.degrees(np.abs(wrap(moved[:, 2] - true[:, 2])))
        values.append(100 * np.stack([distance, turn], 1) / length)
    return tuple(np.concatenate(values).mean(0))


def variant(number: int, rng: np.random.Generator) -> TrackConfig:
    """Errors of one of the five drives along a trajectory."""
    camera = {
        "focal": rng.choice([-1, 1]) * rng.uniform(0.001, 0.005),
        "offset": rng.uniform(-1, 1) if number % 2 else rng.normal(0, 0.05),
        "slope": rng.normal(0, 0.3),
        "distortion": rng.normal(0, 0.01),
        "rotation": tuple(rng.normal(0, 0.2, 3).tolist()),
    }
    odometry: dict[str, Any] = {
        "speed_scale": rng.normal(0, 0.01),
        "turn_bias": rng.normal(0, 0.005),
    }
    if number == 2:
        wheels = {"speed_sigma": 0.1, "turn_sigma": 0.01, "declared": (0.016, 0.0064, 0.0065)}
        return TrackConfig(refresh=0, **camera, **odometry, **wheels)
    if number == 3:
        return TrackConfig(points=120, refresh=0, odometry=False, **camera)
    return TrackConfig(**camera, **odometry)


def bank(folder: Path, variants: int, frames: int) -> Iterator[Drive]:
    """Simulated drives along the trajectories of a folder."""
    camera = datasets.load_drive("tracks", folder / "kitti07").camera
    for file in sorted((folder / "kitti_poses").glob("*.txt")):
        with file.open() as lines:
            count = sum(1 for _ in lines)
        time = FRAME_SECONDS * np.arange(count)
        poses = read_kitti_poses(file, time)
        for number in range(variants):
            rng = np.random.default_rng([int(file.stem), number])
            length = min(frames, count)
            first = int(rng.integers(count - length + 1))
            part = slice(first, first + length)
            some = type(poses)(time[part], poses.rotation[part], poses.position[part])
            truth = camera_truth(some, camera, float(some.time[0]))
            assert truth is not None
            matrices = np.concatenate([some.rotation, some.position[:, :, None]], 2)
            config = variant(number, rng)
            name = f"{file.stem}/{number}"
            yield simulate_tracks(camera, matrices, truth, config, number, name)


def row(drive: Drive, config: visual.VisualConfig) -> dict[str, Any]:
    """Figures of a drive."""
    result = visual.run(drive, config)
    assert drive.truth is not None
    truth = drive.truth.at(drive.time)
    estimates = result.trajectory, result.visual_odometry, result.odometry
    scores = [score_drive(each, drive.truth) for each in estimates]
    errors = np.array(
        [
            (*relative_errors(each, truth), score.ate_unaligned_m)
            for each, score in zip(estimates, scores, strict=True)
        ]
    )
    ratio = errors[0] / errors[1:].min(0)
    return {
        "name": drive.name,
        "errors": errors,
        "ratio": ratio,
        "ate": [score.ate_m for score in scores],
        "nees": end_nees(result.trajectory, truth[-1]),
        "ego nees": end_nees(result.visual_odometry, truth[-1]),
        "inside": scores[0].inside_3sigma,
        "ego inside": scores[1].inside_3sigma,
    }


def end_nees(estimate: Trajectory, truth: FloatArray) -> float:
    """Normalized squared error of the last pose; NaN without covariance."""
    if estimate.covariance is None:
        return float("nan")
    error = estimate.pose[-1] - truth
    error[2] = wrap(error[2])
    return float(normalized_squared(error, estimate.covariance[-1]))


def report(rows: list[dict[str, Any]]) -> None:
    """Print rows, the worst first, and the summary."""
    print("drive          joined: %   deg     m | egomotion        | odometry         | ratios")
    for each in sorted(rows, key=lambda r: -r["ratio"].max()):
        values = " | ".join("{:5.2f} {:5.2f} {:6.2f}".format(*e) for e in each["errors"])
        ratios = "{:5.2f} {:5.2f} {:5.2f}".format(*each["ratio"])
        print(
            f"{each['name'][-14:]:14} {values} | {ratios} | NEES {each['nees']:6.1f} "
            f"({each['ego nees']:6.1f}) inside {each['inside']:.2f} ATE {each['ate'][0]:.3f}"
        )
    ratio = np.array([each["ratio"] for each in rows])
    for name, column in zip(("translation", "rotation", "unaligned"), ratio.T, strict=True):
        quantiles = np.quantile(column, [0.5, 0.9, 1.0])
        print("{:12} median {:.2f}, 90 % {:.2f}, worst {:.2f}".format(name, *quantiles))
    for name, nees, inside in (
        ("joined", "nees", "inside"),
        ("egomotion", "ego nees", "ego inside"),
    ):
        values = np.array([each[nees] for each in rows])
        low, high = chi_square_band(3, len(values))
        print(
            f"{name:12} NEES mean {values.mean():.2f}, median {np.median(values):.2f}, worst "
            f"{values.max():.1f} (band {low:.2f} to {high:.2f}); "
            f"least inside {min(each[inside] for each in rows):.2f}"
        )


def main() -> None:
    given = arguments(
        __doc__,
        folder={"flags": "folder", "type": Path},
        variants=5,
        frames=300,
        no_recordings=False,
    )
    config = replace(visual.VisualConfig(), max_landmarks=50, new_per_frame=1)
    with visual.dedicated_process():
        report([row(drive, config) for drive in bank(given.folder, given.variants, given.frames)])
        if not given.no_recordings:
            drives = (datasets.load_drive("auto", given.folder / name) for name in RECORDINGS)
            report([row(drive, visual.VisualConfig()) for drive in drives])


if __name__ == "__main__":
    main()
