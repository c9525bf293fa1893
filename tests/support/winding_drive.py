"""A robot on a winding course among points, as tracks of a stereo camera."""

import cv2
import numpy as np

from saccade.frames import Camera, Drive, Frame, Tracks
from saccade.plane import steps_between
from saccade.types import Trajectory

CAMERA = Camera(640, 480, 400.0, 400.0, 320.0, 240.0, 0.3, np.array([0.5, 0.1, 1.0]))
FRAMES = 240


def winding(tilt=0.0, camera=CAMERA, period=0.1):
    """A robot on a winding course among points, which are its tracks; odometry with honest noise.

    It pitches by `tilt` radians to and fro.
    """
    rng = np.random.default_rng(7)
    time = period * np.arange(FRAMES)
    heading = 1.2 * np.sin(0.5 * time) + 0.3 * np.sin(1.7 * time)
    ahead = 0.1 * np.stack([np.cos(heading), np.sin(heading)], 1)
    pose = np.column_stack([np.cumsum(ahead, 0), heading])
    points = rng.uniform([-15, -20, -1], [35, 20, 4], (4000, 3))
    seen = []
    for i, (x, y, angle) in enumerate(pose):
        pitch, _ = cv2.Rodrigues(np.array([0, tilt * np.sin(1.5 * time[i]), 0]))
        turn, _ = cv2.Rodrigues(np.array([0, 0, angle]))
        robot = turn @ pitch
        R = (robot @ camera.rotation).T
        t = -R @ (np.array([x, y, 0]) + robot @ camera.position)
        z = (points @ R.T + t)[:, 2]
        near = np.flatnonzero((z > 1) & (z < 15))
        xy, _ = cv2.projectPoints(
            points[near],
            cv2.Rodrigues(R)[0],
            t,
            np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]]),
            np.zeros(4),
        )
        xy = xy.reshape(-1, 2) + 0.1 * rng.standard_normal((len(near), 2))
        inside = ((xy > 0) & (xy < [camera.width, camera.height])).all(1)
        near, xy = near[inside][:150], xy[inside][:150]
        disparity = camera.fx * camera.baseline / z[near] + 0.1 * rng.standard_normal(len(near))
        seen.append(Tracks(near, xy, disparity))
    sigma = np.array([0.01, 0.003, 0.01])
    steps = steps_between(pose)
    return Drive(
        name="winding",
        camera=camera,
        time=time,
        control=steps + sigma * rng.standard_normal(steps.shape),
        control_covariance=np.tile(np.diag(sigma**2), (len(steps), 1, 1)),
        load=lambda i: Frame(time[i], tracks=seen[i]),
        start=pose[0],
        truth=Trajectory(time, pose),
    )
