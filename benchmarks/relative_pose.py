"""Relative pose of two frames of a calibrated recording, estimated from matched keypoints.

    uv run python benchmarks/relative_pose.py kitti_stereo_60m --detector opencv-root \
        --detector sift --points 1000 --gap 1 --gap 3

The recording has KITTI's layout with poses.txt. `verify` estimates the essential matrix; printed
are the angles to the true motion and the area under the cumulative curve of the larger, and below
each later detector the paired difference from the first.
"""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass
from pathlib import Path

import numpy as np

from saccade.datasets.drives.calibration import camera_matrix
from saccade.datasets.drives.loading import load_drive
from saccade.datasets.drives.sidecar_files import Poses, read_kitti_poses
from saccade.errors import DriveError
from saccade.evaluation.detectors import Detector, find_detector
from saccade.evaluation.features import Features, mean_precision
from saccade.evaluation.intervals import ScoreSet
from saccade.frames import Drive
from saccade.io.image import as_gray
from saccade.keypoints.matching import nearest_neighbors
from saccade.keypoints.verification import verify_positions
from saccade.types import FloatArray

THRESHOLD_PX = 1.0
"""Inlier tolerance of `verify` in pixels."""
FAILED = 180.0
"""Error in degrees where no pose can be estimated."""


@dataclass(frozen=True)
class PoseScores:
    """Scores of one pair of frames, or their means over several."""

    matches: float
    """Number of mutual nearest neighbors that pass the ratio test."""
    rotation: float
    """Angle in degrees between estimated and true rotation."""
    direction: float
    """Angle in degrees between estimated and true direction of the translation."""
    auc_1: float
    """Area under the cumulative curve of the larger of the two angles, up to 1 degree."""
    auc_3: float
    auc_5: float
    auc_10: float


class RelativePoseScores(ScoreSet[tuple[int, int], PoseScores]):
    """Scores of pairs of frames, named by their numbers."""

    seed = 20103


def pose_errors(
    matched: FloatArray, sigma: FloatArray, matrix: FloatArray, truth: FloatArray
) -> tuple[float, float]:
    """Angles in degrees of rotation and of direction of the relative pose by `saccade.verify`.

    Args:
        matched: (m, 4) rows x1, y1, x2, y2 in pixels.
        sigma: (m, 2) standard deviations of both positions.
        matrix: (3, 3) intrinsics of the camera.
        truth: (4, 4) from the first camera's frame to the second's.

    Returns:
        The two angles; `FAILED` where no essential matrix can be estimated.
    """
    pose = verify_positions(matched, sigma, "essential", THRESHOLD_PX, 5, matrix).pose
    if pose is None:
        return FAILED, FAILED
    cosine = (np.trace(pose.rotation.T @ truth[:3, :3]) - 1) / 2
    along = truth[:3, 3] / np.linalg.norm(truth[:3, 3])
    angles = np.degrees(np.arccos(np.clip([cosine, along @ pose.translation], -1, 1)))
    return float(angles[0]), float(angles[1])


def score_relative_poses(
    detect: Detector,
    drive: Drive,
    poses: Poses,
    gaps: Sequence[int] = (1,),
    ratio: float = 0.8,
    progress: Callable[[int, int], object] | None = None,
) -> dict[int, RelativePoseScores]:
    """Score a detector on pairs of frames of a recording whose poses are known.

    Args:
        detect: the detector.
        drive: n frames with images.
        poses: (n,) true poses of the camera, x right, y down, z ahead.
        gaps: numbers of frames from the first of a pair to the second.
        ratio: threshold of the ratio test.
        progress: called with the frames done and their number.

    Returns:
        The scores by gap. Pairs without motion are left out, since the translation of
        these has no direction.

    Raises:
        DriveError: a frame has no image, or there are not as many poses as frames.
    """
    if len(poses.rotation) != len(drive):
        raise DriveError(
            f"{drive.name}: expected a true pose of each of {len(drive)} frames, "
            f"found {len(poses.rotation)}"
        )
    matrix = camera_matrix(drive.camera)
    kept: list[Features] = []
    names: dict[int, list[tuple[int, int]]] = {}
    scores: dict[int, list[PoseScores]] = {}
    for number in range(len(drive)):
        kept = [*kept, _features(detect, drive, number)][-max(gaps) - 1 :]
        for gap in gaps:
            if gap > number or np.allclose(poses.position[number - gap], poses.position[number]):
                continue
            truth = relative_pose(poses, number - gap, number)
            names.setdefault(gap, []).append((number - gap, number))
            scores.setdefault(gap, []).append(
                _score(kept[-1 - gap], kept[-1], matrix, truth, ratio)
            )
        if progress is not None:
            progress(number + 1, len(drive))
    return {key: RelativePoseScores(names[key], table) for key, table in scores.items()}


def relative_pose(poses: Poses, first: int, second: int) -> FloatArray:
    """(4, 4) from the camera's frame at the first pose to that at the second."""
    inverse = poses.rotation[second].T
    result = np.eye(4)
    result[:3, :3] = inverse @ poses.rotation[first]
    result[:3, 3] = inverse @ (poses.position[first] - poses.position[second])
    return result


def _features(detect: Detector, drive: Drive, number: int) -> Features:
    image = drive.load(number).image
    if image is None:
        raise DriveError(f"{drive.name}: expected an image of frame {number}, found none")
    gray = as_gray(image)
    return Features.of(detect(np.repeat(gray[:, :, None], 3, axis=2)), gray.shape)


def _score(
    first: Features, second: Features, matrix: FloatArray, truth: FloatArray, ratio: float
) -> PoseScores:
    pairs = np.zeros((0, 2), np.int64)
    if len(first.xy) and len(second.xy):
        nearest, distance, runner_up, back = nearest_neighbors(
            first.descriptors, second.descriptors
        )
        mutual = back[nearest] == np.arange(len(nearest))
        index = np.flatnonzero(mutual & (distance < ratio**2 * runner_up))
        pairs = np.stack([index, nearest[index]], axis=1)
    i, j = pairs.T
    matched = np.hstack([first.xy[i], second.xy[j]])
    sigma = np.stack([first.position_sigma[i], second.position_sigma[j]], axis=1)
    rotation, direction = pose_errors(matched, sigma, matrix, truth)
    worse = np.array([max(rotation, direction)])
    areas = (mean_precision(worse, limit) for limit in (1, 3, 5, 10))
    return PoseScores(float(len(pairs)), rotation, direction, *areas)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recording", type=Path)
    parser.add_argument("--detector", action="append", help="as of saccade evaluate features")
    parser.add_argument("--points", type=int)
    parser.add_argument("--gap", type=int, action="append", help="frames between those of a pair")
    options = parser.parse_args()
    drive = load_drive("kitti", options.recording)
    poses = read_kitti_poses(options.recording / "poses.txt", drive.time)
    print(f"{'':32}{'':12}matches  rotation  direction  AUC@1/3/5/10")
    first: dict[int, RelativePoseScores] = {}
    for name in options.detector or ["sift"]:
        detect = find_detector(name, None, options.points)
        for gap, scores in score_relative_poses(detect, drive, poses, options.gap or [1]).items():
            shown = dict(zip(("", "95 % from", "95 % to"), scores.estimate(), strict=True))
            if first.setdefault(gap, scores) is not scores:
                ends = ("difference", "diff. from", "diff. to")
                shown |= zip(ends, scores.minus(first[gap]), strict=True)
            for words, each in shown.items():
                matches, rotation, direction, *areas = astuple(each)
                cells = f"{matches:7.0f}  {rotation:8.3f}  {direction:9.2f}  "
                print(f"{f'{name}, gap {gap}':32}{words:12}{cells}", *(f"{a:.3f}" for a in areas))


if __name__ == "__main__":
    main()
