"""The pose of a robot by tags whose positions are known."""

from collections.abc import Mapping

import numpy as np

from saccade.plane import point_covariance, rotations, to_points
from saccade.slam.consistency import chi_square_gate
from saccade.types import FloatArray
from saccade.visual.points import RangeBearings

PROBABILITY = 0.99
"""Probability with which tags that did not move agree on the robot's pose."""
MIN_TAG_SEPARATION = 0.3
"""Minimum distance in meters between two tags that determine a heading."""
ROBOT_POSE_STEPS = 5
"""Number of Gauss-Newton steps."""
MAX_VARIANCE = 1.0
"""Largest variance in square meters of the position of a tag that was seen earlier."""


class LatestTags:
    """The latest sighting of each tag, in the present frame of the robot."""

    def __init__(self) -> None:
        self._seen = dict[str, tuple[FloatArray, FloatArray]]()  # (2,) meters, (2, 2) covariance

    def add(self, labels: list[str], observations: RangeBearings) -> None:
        """Adds the tags of a frame."""
        points = to_points(observations.z)
        covariances = point_covariance(observations.z, observations.covariance)
        self._seen |= dict(zip(labels, zip(points, covariances, strict=True), strict=True))

    def predict(self, u: FloatArray, U: FloatArray) -> None:
        """Moves the robot by a control (3,) with covariance (3, 3): meters and radians."""
        back = rotations(-u[2:])[0]
        kept = dict[str, tuple[FloatArray, FloatArray]]()
        for label, (point, C) in self._seen.items():
            moved = back @ (point - u[:2])
            J = np.column_stack([-back, [moved[1], -moved[0]]])
            covariance = back @ C @ back.T + J @ U @ J.T
            if covariance.trace() < 2 * MAX_VARIANCE:
                kept[label] = moved, covariance
        self._seen = kept

    def pose(
        self, places: Mapping[str, tuple[FloatArray, FloatArray]]
    ) -> tuple[FloatArray, FloatArray] | None:
        """Pose (3,) and covariance (3, 3) by the tags at known places: (2,) meters, (2, 2).

        One tag of three or more may contradict. None if fewer than two tags agree on a pose.
        """
        labels = sorted(self._seen.keys() & places.keys())
        found = self._fit(labels, places)
        if found is None and len(labels) > 2:
            others = ([each for each in labels if each != left_out] for left_out in labels)
            fits = [fit for some in others if (fit := self._fit(some, places)) is not None]
            found = fits[0] if len(fits) == 1 else None
        return found

    def _fit(
        self, labels: list[str], places: Mapping[str, tuple[FloatArray, FloatArray]]
    ) -> tuple[FloatArray, FloatArray] | None:
        """Least-squares pose by the tags with some labels; None if they do not agree."""
        if len(labels) < 2:
            return None
        m, P = (np.array(each) for each in zip(*(places[label] for label in labels), strict=True))
        q, C = (np.array(e) for e in zip(*(self._seen[label] for label in labels), strict=True))
        if np.hypot(*(m - m.mean(0)).T).max() < MIN_TAG_SEPARATION / 2:
            return None
        a, b = q - q.mean(0), m - m.mean(0)
        heading = np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum())
        pose = np.append(m.mean(0) - rotations(np.array([heading]))[0] @ q.mean(0), heading)
        for _ in range(ROBOT_POSE_STEPS):
            R = rotations(pose[2:])[0]
            arm = q @ R.T  # (k, 2)
            W = np.linalg.inv(R @ C @ R.T + P)
            J = np.zeros((len(q), 2, 3))
            J[:, 0, 0] = J[:, 1, 1] = 1.0
            J[:, 0, 2], J[:, 1, 2] = -arm[:, 1], arm[:, 0]
            error = m - pose[:2] - arm
            A = np.einsum("kia,kij,kjb->ab", J, W, J)
            pose = pose + np.linalg.solve(A, np.einsum("kia,kij,kj->a", J, W, error))
        squared = float(np.einsum("ki,kij,kj->", error, W, error))
        if squared > chi_square_gate(2 * len(q) - 3, PROBABILITY):
            return None
        pose[2] = np.angle(np.exp(1j * pose[2]))
        return pose, np.linalg.inv(A)
