"""Relative poses of two frames of a calibrated recording, from matched keypoints.

    uv run python benchmarks/relative_pose.py kitti_stereo_60m --detector opencv-root sift \
        --points 1000 --gap 1 3

Quoted in docs/measured.md and docs/evaluation.md. The recording has KITTI's layout with poses.txt.
`verify` estimates the essential matrix; printed are the angles to the true motion and the area
under the cumulative curve of the larger up to 1, 3, 5 and 10 degrees, and below each later detector
the paired difference from the first. Pairs without motion are left out.
"""

from collections import defaultdict
from dataclasses import astuple, dataclass
from pathlib import Path

import numpy as np

from measuring import arguments
from saccade.datasets.drives.calibration import camera_matrix
from saccade.datasets.drives.loading import load_drive
from saccade.datasets.drives.sidecar_files import Poses, read_kitti_poses
from saccade.evaluation.detectors import Detector, find_detector
from saccade.evaluation.features import Features, mean_precision, mutual_matches
from saccade.evaluation.intervals import ScoreSet
from saccade.frames import Drive
from saccade.io.image import as_gray
from saccade.keypoints.verification import verify_positions
from saccade.types import FloatArray

THRESHOLD_PX = 1.0
"""Inlier tolerance of `verify` in pixels."""
FAILED = 180.0
"""Error in degrees where no pose can be estimated."""


@dataclass(frozen=True)
class RelativePose:
    """Scores of one pair of frames, or their means over several; angles in degrees."""

    matches: float
    rotation: float
    direction: float
    auc_1: float
    auc_3: float
    auc_5: float
    auc_10: float


class RelativePoses(ScoreSet[tuple[int, int], RelativePose]):
    """Scores of pairs of frames, named by their numbers."""

    seed = 20103


def score(first: Features, second: Features, matrix: FloatArray, truth: FloatArray) -> RelativePose:
    """Compare the pose by `verify` with the true (4, 4) from the first camera to the second."""
    _, kept, pairs = mutual_matches(first, second, np.eye(3), 0.8)
    i, j = pairs[kept].T
    matched = np.hstack([first.xy[i], second.xy[j]])
    sigma = np.stack([first.position_sigma[i], second.position_sigma[j]], axis=1)
    pose = verify_positions(matched, sigma, "essential", THRESHOLD_PX, 5, matrix).pose
    angles = np.full(2, FAILED)
    if pose is not None:
        cosine = (np.trace(pose.rotation.T @ truth[:3, :3]) - 1) / 2
        along = truth[:3, 3] / np.linalg.norm(truth[:3, 3])
        angles = np.degrees(np.arccos(np.clip([cosine, along @ pose.translation], -1, 1)))
    areas = (mean_precision(angles.max(keepdims=True), limit) for limit in (1, 3, 5, 10))
    return RelativePose(float(len(i)), *angles.tolist(), *areas)


def score_detector(
    detect: Detector, drive: Drive, poses: Poses, gaps: list[int]
) -> dict[int, RelativePoses]:
    """Scores by the number of frames between those of a pair; poses are true ones of the camera."""
    matrix, kept = camera_matrix(drive.camera), list[Features]()
    scores = defaultdict(dict)
    for number in range(len(drive)):
        gray = as_gray(drive.load(number).image)
        found = Features.of(detect(np.repeat(gray[:, :, None], 3, axis=2)), gray.shape)
        kept = [*kept, found][-max(gaps) - 1 :]
        for gap in gaps:
            first = number - gap
            if first < 0 or np.allclose(poses.position[first], poses.position[number]):
                continue
            truth, inverse = np.eye(4), poses.rotation[number].T
            truth[:3, :3] = inverse @ poses.rotation[first]
            truth[:3, 3] = inverse @ (poses.position[first] - poses.position[number])
            scores[gap][first, number] = score(kept[-1 - gap], kept[-1], matrix, truth)
    return {gap: RelativePoses([*each], [*each.values()]) for gap, each in scores.items()}


def main() -> None:
    given = arguments(
        __doc__,
        recording={"flags": "recording", "type": Path},
        detector=["sift"],
        points={"type": int},
        gap=[1],
    )
    drive = load_drive("kitti", given.recording)
    poses = read_kitti_poses(given.recording / "poses.txt", drive.time)
    print(f"{'':32}{'':12}matches  rotation  direction  AUC@1/3/5/10")
    reference: dict[int, RelativePoses] = {}
    for name in given.detector:
        detect = find_detector(name, None, given.points)
        for gap, scores in score_detector(detect, drive, poses, given.gap).items():
            shown = dict(zip(("", "95 % from", "95 % to"), scores.estimate(), strict=True))
            if reference.setdefault(gap, scores) is not scores:
                ends = ("difference", "diff. from", "diff. to")
                shown |= zip(ends, scores.minus(reference[gap]), strict=True)
            for words, each in shown.items():
                matches, rotation, direction, *areas = astuple(each)
                cells = f"{matches:7.0f}  {rotation:8.3f}  {direction:9.2f}  "
                print(f"{f'{name}, gap {gap}':32}{words:12}{cells}", *(f"{a:.3f}" for a in areas))


if __name__ == "__main__":
    main()
