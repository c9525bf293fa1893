"""How much the accuracy of a drive depends on the settings, beside its parts and a peer.

    uv run python benchmarks/drive_spread.py kitti07/stereo_tracks_clean.npz
    uv run python benchmarks/drive_spread.py kitti_stereo_60m      (docs/measured.md)

The defaults, `detect_interval` from 1 to 6, and each budget halved and doubled. The peer, where the
drive has tracks, is OpenCV's stereo PnP from each frame to the next, without odometry; where no
track is common to two frames it repeats the last motion.
"""

from dataclasses import replace
from pathlib import Path
from time import perf_counter

import cv2
import numpy as np

from measuring import arguments
from saccade import datasets, visual
from saccade.evaluation.trajectory import score_drive
from saccade.frames import Drive
from saccade.slam.models import compose
from saccade.types import Trajectory
from saccade.visual.camera import directions, intrinsics_of
from saccade.visual.depth import depth_of
from saccade.visual.egomotion import robot_motion

BUDGETS = ("max_tracks", "max_tracked", "max_landmarks", "max_points", "new_per_frame", "window")
MIN_POINTS = 6
"""Points from which the peer estimates a motion."""


def variations() -> list[tuple[str, visual.VisualConfig]]:
    """Settings around the defaults, with their names."""
    default = visual.VisualConfig()
    intervals = [("detect_interval", interval) for interval in range(1, 7)]
    values = [(name, getattr(default, name)) for name in BUDGETS]
    budgets = [(name, number) for name, v in values for number in (v // 2, 2 * v)]
    changed = [(f"{k} {v}", replace(default, **{k: v})) for k, v in intervals + budgets]
    return [("default", default), *changed]


def peer(drive: Drive) -> Trajectory:
    """OpenCV's stereo PnP from each frame to the next."""
    K = intrinsics_of(drive.camera).matrix
    control, pose, last = np.zeros(3), [drive.start], drive.load(0).tracks
    for number in range(1, len(drive)):
        tracks = drive.load(number).tracks
        assert tracks is not None
        assert last is not None
        _, old, new = np.intersect1d(last.id, tracks.id, return_indices=True)
        depth = depth_of(drive.camera, last.disparity[old])
        known = np.isfinite(depth)
        xyz = directions(drive.camera, last.xy[old])[known] * depth[known, None]
        xy = tracks.xy[new][known]
        if len(xy) >= MIN_POINTS:
            ok, *motion, inliers = cv2.solvePnPRansac(
                xyz, xy, K, None, reprojectionError=1.5, iterationsCount=200
            )
            if ok and inliers is not None and len(inliers) >= MIN_POINTS:
                some = inliers.ravel()
                motion = cv2.solvePnPRefineLM(xyz[some], xy[some], K, None, *motion)
                R, t = cv2.Rodrigues(motion[0])[0], np.ravel(motion[1])
                control = robot_motion(drive.camera, np.asarray(R, np.float64), t)[0]
        pose.append(compose(pose[-1], control)[0])
        last = tracks
    return Trajectory(drive.time, np.array(pose))


def main() -> None:
    given = arguments(__doc__, drive={"flags": "drive", "type": Path})
    drive = datasets.load_drive("auto", given.drive)
    print(f"{'':22} ATE (m)  visual odometry  odometry  inside 3 sigma  frames a second")
    ates = []
    for name, config in variations():
        begin = perf_counter()
        result = visual.run(drive, config)
        rate = len(drive) / (perf_counter() - begin)
        estimates = (result.trajectory, result.visual_odometry, result.odometry)
        ours, alone, odometry = (score_drive(each, drive.truth) for each in estimates)
        ates.append(ours.ate_m)
        print(
            f"{name:22} {ours.ate_m:7.3f}  {alone.ate_m:15.3f}  {odometry.ate_m:8.3f}"
            f"  {ours.inside_3sigma:14.3f}  {rate:15.0f}",
            flush=True,
        )
    change = 100 * float(np.abs(np.array(ates) / ates[0] - 1).max())
    print(f"largest change {change:.0f} %, {min(ates):.3f} to {max(ates):.3f} m")
    if drive.load(0).tracks is not None:
        print(f"OpenCV's stereo PnP {score_drive(peer(drive), drive.truth).ate_m:.3f}")


if __name__ == "__main__":
    main()
