"""Checks the size of tags, the focal length and the mounting of the camera that saw them.

Poses, errors of the odometry and errors of the calibration are estimated jointly, by sparse least
squares over the observations of tags and the odometry. Tags at surveyed positions determine all;
without a survey the positions are estimated too, and the scale follows from the odometry.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from saccade.diagnostics.findings import Finding
from saccade.errors import LogError
from saccade.landmark_names import name_texts
from saccade.plane import (
    point_covariance,
    relative_poses,
    relative_poses_of,
    rotated,
    rotations,
    to_points,
)
from saccade.slam import EkfConfig, Slam
from saccade.slam.recorded_log import run
from saccade.types import FloatArray, IntArray, LandmarkLog, LandmarkMap

CALIBRATION_STEPS = 6
"""Number of Gauss-Newton steps."""
HUBER = 3.0
"""Normalized residual above which an observation has less weight."""
MIN_TAG_OBSERVATIONS = 30
"""Minimum number of observations for an estimate."""
SIGNIFICANCE = 4.0
"""Minimum size of a finding in standard deviations."""
ODOMETRY_SIGMA = (0.03, 0.03)
"""Prior standard deviations of the odometry's scale, and of its turn in radians per meter."""
PARAMETERS = 7
"""Number of parameters: relative size and focal length, yaw, position ahead and left, and the
odometry's scale and turn per meter."""
MIN_ERRORS = (0.015, 0.015, 0.012, 0.04, 0.04)
"""Minimum errors of size and focal length (relative), yaw (rad) and position (m) that matter."""


@dataclass(frozen=True, eq=False)
class TagCalibration:
    """Estimated errors of a calibration."""

    value: FloatArray
    """(7,) see `PARAMETERS`: true minus declared, relative for size and focal length."""
    sigma: FloatArray
    """(7,) standard deviations."""


@dataclass(eq=False)
class _Rows:
    """Whitened rows of a sparse least-squares problem."""

    entries: list[tuple[IntArray, IntArray, FloatArray]] = field(default_factory=list)
    residuals: list[FloatArray] = field(default_factory=list)
    count: int = 0

    def add(self, residual: FloatArray, blocks: list[tuple[IntArray, FloatArray]]) -> None:
        """Adds n groups of d rows: residuals (n, d), and columns (n, c) with values (n, d, c)."""
        n, d = residual.shape
        row = self.count + np.arange(n * d).reshape(n, d)
        for column, value in blocks:
            shape = (n, d, column.shape[1])
            rows = np.broadcast_to(row[:, :, None], shape)
            columns = np.broadcast_to(column[:, None], shape)
            self.entries.append((rows.ravel(), columns.ravel(), value.ravel()))
        self.residuals.append(residual.ravel())
        self.count += n * d

    def solve(self, size: int) -> tuple[FloatArray, Any]:
        """The step (size,), and the factorization of the normal matrix."""
        from scipy.sparse import coo_array, csc_matrix
        from scipy.sparse.linalg import splu

        rows, columns, values = (np.concatenate(each) for each in zip(*self.entries, strict=True))
        A = csc_matrix(coo_array((values, (rows, columns)), shape=(self.count, size)))
        y = np.concatenate(self.residuals)
        factors = splu(csc_matrix(A.T @ A))
        return factors.solve(-(A.T @ y)), factors


def calibrate_tags(
    log: LandmarkLog, axis: FloatArray, survey: LandmarkMap | None = None
) -> TagCalibration | None:
    """Estimated errors of the calibration of the camera that observed the tags of a log.

    Args:
        log: labeled observations in the robot's frame.
        axis: (k, 3) position of the camera in the robot's frame and heading of its optical axis, at
            each observation.
        survey: true positions of tags; None if unknown.

    Returns:
        The errors; None for too few observations of tags.
    """
    try:
        initial = None if survey is None else Slam(map=survey, mode="localize")
        result = run(log, EkfConfig(smooth=True) if initial is None else None, initial=initial)
    except LogError:
        return None
    known = result.map if survey is None else survey
    row_of = {name: row for row, name in enumerate(known.names.tolist())}
    names = name_texts(log.landmark, log.text_names).tolist()
    rows = np.array([row_of.get(name, -1) for name in names], np.int64)
    used = (rows >= 0) & (result.association >= 0)
    if result.lost is not None:
        used &= ~result.lost[log.observation_pose]
    if used.sum() < MIN_TAG_OBSERVATIONS:
        return None
    problem = _Problem(log, axis, used, rows, known.xy, survey is not None)
    return problem.solve(result.trajectory.pose)


class _Problem:
    """The joint estimation of poses, calibration and, without a survey, tags."""

    def __init__(
        self,
        log: LandmarkLog,
        axis: FloatArray,
        used: Any,
        rows: IntArray,
        xy: FloatArray,
        surveyed: bool,
    ) -> None:
        self.pose_of, self.tag_of = log.observation_pose[used], rows[used]
        self.axis, self.surveyed, self.xy = axis[used], surveyed, xy
        z, R = log.observation[used], log.observation_covariance[used]
        self.C = point_covariance(z, R)
        self.local = rotated(to_points(z) - self.axis[:, :2], -self.axis[:, 2])
        steps = relative_poses_of(log)
        self.control, U = steps[0], steps[1]
        self.U = np.linalg.inv(np.linalg.cholesky(U + 1e-10 * np.eye(3)))
        self.num_poses = len(log.time)

    def solve(self, pose: FloatArray) -> TagCalibration | None:
        """The errors, from initial poses (t + 1, 3)."""
        x, xy = np.zeros(PARAMETERS), self.xy.copy()
        first = 3 * self.num_poses
        size = first + PARAMETERS + (0 if self.surveyed else 2 * len(xy))
        for _ in range(CALIBRATION_STEPS):
            rows = _Rows()
            self._add_odometry(rows, pose, x, first)
            self._add_tags(rows, pose, x, xy, first)
            self._add_priors(rows, pose, x, xy, first)
            try:
                step, factors = rows.solve(size)
            except RuntimeError:  # singular
                return None
            pose = pose + step[:first].reshape(-1, 3)
            x = x + step[first : first + PARAMETERS]
            if not self.surveyed:
                xy = xy + step[first + PARAMETERS :].reshape(-1, 2)
        units = np.eye(size)[:, first : first + PARAMETERS]
        sigma = np.sqrt(np.diagonal(factors.solve(units)[first : first + PARAMETERS]))
        return TagCalibration(x, sigma) if np.isfinite(x).all() else None

    def _add_odometry(self, rows: _Rows, pose: FloatArray, x: FloatArray, first: int) -> None:
        n = self.num_poses - 1
        u, distance = self.control, np.hypot(self.control[:, 0], self.control[:, 1])
        relative = relative_poses(pose[:-1], pose[1:])
        expected = u * (1 + x[5], 1 + x[5], 1.0)
        expected[:, 2] += x[6] * distance
        error = relative - expected
        error[:, 2] = np.angle(np.exp(1j * error[:, 2]))
        back = rotations(-pose[:-1, 2])
        J1, J2, K = np.zeros((n, 3, 3)), np.zeros((n, 3, 3)), np.zeros((n, 3, 2))
        J1[:, :2, :2], J2[:, :2, :2] = -back, back
        J1[:, 0, 2], J1[:, 1, 2] = relative[:, 1], -relative[:, 0]
        J1[:, 2, 2], J2[:, 2, 2] = -1.0, 1.0
        K[:, :2, 0], K[:, 2, 1] = -u[:, :2], -distance
        columns = 3 * np.arange(n)[:, None] + np.arange(3)
        ours = np.broadcast_to(first + np.array([5, 6]), (n, 2))
        blocks = [(columns, self.U @ J1), (columns + 3, self.U @ J2), (ours, self.U @ K)]
        rows.add(np.einsum("nij,nj->ni", self.U, error), blocks)

    def _add_tags(
        self, rows: _Rows, pose: FloatArray, x: FloatArray, xy: FloatArray, first: int
    ) -> None:
        size, focal, yaw, ahead, left = x[:5].tolist()
        at, k = pose[self.pose_of], len(self.pose_of)
        shape = np.array([(1 + size) * (1 + focal), 1 + size])
        heading = self.axis[:, 2] + yaw
        offset = rotated(self.local * shape, heading)
        point = self.axis[:, :2] + (ahead, left) + offset
        world = rotated(point, at[:, 2])
        error = at[:, :2] + world - xy[self.tag_of]
        R = rotations(at[:, 2])
        root = np.linalg.inv(np.linalg.cholesky(R @ self.C @ R.transpose(0, 2, 1)))
        norm = np.linalg.norm(np.einsum("kij,kj->ki", root, error), axis=1)
        root = root * np.sqrt(np.minimum(1.0, HUBER / np.maximum(norm, 1e-9)))[:, None, None]
        J, K = np.zeros((k, 2, 3)), np.zeros((k, 2, 5))
        J[:, 0, 0] = J[:, 1, 1] = 1.0
        J[:, 0, 2], J[:, 1, 2] = -world[:, 1], world[:, 0]
        total = heading + at[:, 2]
        K[:, :, 0] = rotated(self.local * np.array([1 + focal, 1.0]), total)
        K[:, :, 1] = rotated(self.local * np.array([1 + size, 0.0]), total)
        turned = rotated(offset, at[:, 2])
        K[:, 0, 2], K[:, 1, 2] = -turned[:, 1], turned[:, 0]
        K[:, :, 3:] = R
        columns = 3 * self.pose_of[:, None] + np.arange(3)
        ours = np.broadcast_to(first + np.arange(5), (k, 5))
        blocks = [(columns, root @ J), (ours, root @ K)]
        if not self.surveyed:
            tags = first + PARAMETERS + 2 * self.tag_of[:, None] + np.arange(2)
            blocks.append((tags, -root))
        rows.add(np.einsum("kij,kj->ki", root, error), blocks)

    def _add_priors(
        self, rows: _Rows, pose: FloatArray, x: FloatArray, xy: FloatArray, first: int
    ) -> None:
        """Priors of the odometry, wide ones of the rest, and the first pose without a survey."""
        sigma = np.array([0.5, 0.5, 1.0, 1.0, 1.0, *ODOMETRY_SIGMA])
        columns = first + np.arange(PARAMETERS)
        rows.add((x / sigma)[None], [(columns[None], np.diag(1 / sigma)[None])])
        if not self.surveyed:
            rows.add(np.zeros((1, 3)), [(np.arange(3)[None], 1e4 * np.eye(3)[None])])


def check_tags(
    log: LandmarkLog, axis: FloatArray, size: float | None, survey: LandmarkMap | None = None
) -> tuple[Finding, ...]:
    """Findings on the size of tags and on the calibration of their camera.

    Arguments as of `calibrate_tags`; `size` is the declared size in meters, None if several are.
    """
    found = calibrate_tags(log, axis, survey)
    if found is None:
        return ()
    findings = sorted(_findings(found, size), key=lambda each: -each[0])
    return tuple(finding for _, finding in findings)


def _findings(found: TagCalibration, size: float | None) -> Iterator[tuple[float, Finding]]:
    """Findings with their sizes in standard deviations."""
    errors = zip(found.value[:5].tolist(), found.sigma[:5].tolist(), MIN_ERRORS, strict=True)
    for number, (value, sigma, minimum) in enumerate(errors):
        significance = abs(value) / max(sigma, 1e-12)
        if significance < SIGNIFICANCE or abs(value) < minimum:
            continue
        percent = f"{100 * abs(value):.1f} ± {100 * sigma:.1f} %"
        if number == 0:
            what = f"the tags are {percent} {'larger' if value > 0 else 'smaller'} than declared"
            if size is not None:
                what += f": probably {size * (1 + value):.4f} m, not {size:g} m (--tag-size)"
            finding = Finding.of("tag size", what, 100 * value)
        elif number == 1:
            what = f"the focal length is {percent} {'longer' if value > 0 else 'shorter'} than "
            finding = Finding.of("focal length", f"{what}declared", 100 * value)
        elif number == 2:
            side = "left" if value > 0 else "right"
            degrees = f"{np.degrees(abs(value)):.1f} ± {np.degrees(sigma):.1f} degrees"
            what = f"the camera is turned {degrees} further to the {side} than declared"
            advice = "Correct the rotation in camera.toml"
            value = float(np.degrees(value))
            finding = Finding.of("camera yaw", what, value, advice=advice)
        else:
            way = (("ahead", "back"), ("to the left", "to the right"))[number - 3][int(value < 0)]
            what = f"the camera is mounted {abs(value):.2f} ± {sigma:.2f} m further {way} "
            advice = "Correct the position in camera.toml"
            finding = Finding.of("camera position", f"{what}than declared", value, advice=advice)
        yield significance, finding
