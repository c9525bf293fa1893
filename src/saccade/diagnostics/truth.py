"""Checks of a ground truth against odometry: poses that jump, and the heading at the start."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from saccade.diagnostics.findings import Finding, counted
from saccade.plane import path_of, relative_poses, relative_poses_of, rotated
from saccade.types import SAME_TIME, BoolArray, FloatArray, LandmarkLog, Trajectory

MIN_JUMP = 1.0
"""Minimum length in meters of a jump of the truth beyond the path of odometry."""
JUMP_SIGMAS = 10.0
"""Minimum length of a jump in robust standard deviations of its excess over odometry."""
SLACK = 0.3
"""Length that the truth may gain over the path of odometry, relative to that path."""
HEADING_PATH = 5.0
"""Length of the path in meters by which the heading at the start is compared."""
MIN_HEADING_ERROR = np.deg2rad(20.0)
"""Minimum error in radians of the heading at the start."""
MAX_HEADING_RESIDUAL = 0.3
"""Maximum residual of the turned path, relative to the residual as recorded."""


def jumps(truth: Trajectory, time: FloatArray, path: FloatArray) -> BoolArray:
    """(n,) True for poses of the truth that are farther from the others than odometry moves.

    The poses between two jumps are a segment; the kept segments are the longest sequence in which
    each is reached from the previous one by odometry.

    Args:
        truth: n poses.
        time: (t,) times of the poses of odometry, in seconds.
        path: (t, 3) these poses, in any frame.
    """
    wrong = np.zeros(len(truth), bool)
    if len(truth) < 3 or len(time) < 2:
        return wrong
    driven = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path[:, :2], axis=0).T))])
    reached, xy = np.interp(truth.time, time, driven), truth.pose[:, :2]
    excess = np.hypot(*np.diff(xy, axis=0).T) - np.diff(reached)
    sigma = 1.4826 * float(np.median(np.abs(excess - np.median(excess))))
    limit = max(MIN_JUMP, JUMP_SIGMAS * sigma)
    edges = np.flatnonzero(excess > limit) + 1
    if len(edges) == 0:
        return wrong
    first, last = np.append(0, edges), np.append(edges, len(truth)) - 1
    count, before = last - first + 1, np.full(len(first), -1)
    total = count.copy()
    for k in range(1, len(first)):
        distance = np.hypot(*(xy[first[k]] - xy[last[:k]]).T)
        allowed = (1 + SLACK) * (reached[first[k]] - reached[last[:k]]) + limit
        near = np.flatnonzero(distance <= allowed)
        if len(near):
            best = near[np.argmax(total[near])]
            total[k], before[k] = count[k] + total[best], best
    k = int(np.argmax(total))
    wrong[:] = True
    while k >= 0:
        wrong[first[k] : last[k] + 1] = False
        k = int(before[k])
    return wrong


def start_heading_error(truth: Trajectory, time: FloatArray, path: FloatArray) -> float | None:
    """Error in radians of the heading of the truth at the start; None if it is not large.

    It turns the first meters of odometry onto the positions of the truth.
    """
    covered = truth.covers(time)
    if not covered[0] or not np.isfinite(truth.pose[:, 2]).all():
        return None
    steps = np.hypot(*np.diff(path[:, :2], axis=0).T)
    near = covered & (np.append(0.0, np.cumsum(steps)) <= HEADING_PATH)
    true = truth.at(time[near])
    ours = relative_poses(np.tile(path[0], (near.sum(), 1)), path[near])[:, :2]
    theirs = relative_poses(np.tile(true[0], (len(true), 1)), true)[:, :2]
    if np.hypot(*theirs.T).max(initial=0.0) < HEADING_PATH / 5:
        return None
    dot = float((ours * theirs).sum())
    error = float(np.arctan2((ours[:, 0] * theirs[:, 1] - ours[:, 1] * theirs[:, 0]).sum(), dot))
    turned = rotated(ours, np.full(len(ours), error))
    residual, recorded = (float(np.hypot(*(each - theirs).T).mean()) for each in (turned, ours))
    wrong = abs(error) > MIN_HEADING_ERROR and residual < MAX_HEADING_RESIDUAL * recorded
    return -error if wrong else None


def check_truth_of_log(log: LandmarkLog, path: FloatArray) -> Iterator[Finding]:
    """Checks the truth of a log against the path (t + 1, 3) of odometry."""
    if log.truth is None:
        return
    wrong = jumps(log.truth, log.time, path)
    if wrong.any():
        numbers = np.flatnonzero(wrong)
        count = counted(len(numbers), "pose", "poses")
        what = (
            f"the truth jumps: {count} of {len(wrong)}, first at "
            f"{log.truth.time[numbers[0]] - log.time[0]:.1f} s after the first pose of the log, "
            "are farther from the others than odometry moves"
        )
        yield Finding.of("truth jumps", what, len(numbers))
    error = start_heading_error(log.truth, log.time, path) if not wrong.any() else None
    if error is not None:
        degrees = float(np.rad2deg(error))
        what = (
            f"the heading of the truth at the start is {abs(degrees):.0f} deg too far "
            f"{'left' if degrees > 0 else 'right'} for its own path"
        )
        yield Finding.of("truth heading", what, degrees)


def usable_truth(truth: Trajectory, time: FloatArray, path: FloatArray) -> Trajectory:
    """The truth without poses that jump, and without a first pose whose heading is wrong.

    Errors without alignment need the first pose, so that they are left out.

    Args:
        truth: the truth.
        time: (t,) times of the poses of odometry, in seconds.
        path: (t, 3) these poses, in any frame.
    """
    kept = ~jumps(truth, time, path)
    if kept.all() and start_heading_error(truth, time, path) is not None:
        kept = truth.time > time[0] + SAME_TIME
    if kept.all():
        return truth
    C = None if truth.covariance is None else truth.covariance[kept]
    return Trajectory(truth.time[kept], truth.pose[kept], C)


def with_usable_truth(log: LandmarkLog) -> LandmarkLog:
    """The log without poses of the truth that are wrong; see `usable_truth`."""
    if log.truth is None:
        return log
    path = path_of(relative_poses_of(log)[0])
    return replace(log, truth=usable_truth(log.truth, log.time, path))
